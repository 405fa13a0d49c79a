"""From the velocity that the game asks for to a setpoint within the limits.

Following:
    Following: the settings of one vehicle. ServoGains, Approach: settings of its parts.
    Gaps: distances to the disc. Speeds: horizontal speed, climb rate and descent rate.
    hold_altitude: keeps a height, with an `AltitudeHold`. keep_station: stops and stays at a place.

What the vehicle can do:
    Acceleration, late_start: cost of accelerating.
    observe_speed: compares the speed asked for with the one flown, in a `SpeedMemory`.

Limiting, always last:
    limit: turns a command into a setpoint, with a `LimitMemory`.
    Situation: state of the vehicle and the evader. `measure_walls` returns every `Wall` there.
    held_back: reduces a desired velocity before walls.
    Limits: the section of a file. Envelope: the same with the vehicle's Dynamics.
    Limiter: names of the limits.
    Polygon: corners of a fence, in metres about home.
"""

from guidance.control.braking_law import held_back
from guidance.control.capability import Acceleration, SpeedMemory, late_start, observe_speed
from guidance.control.follow import Approach, Following, Gaps
from guidance.control.limits import Dynamics, Envelope, Limiter, Limits, Speeds
from guidance.control.polygon import Polygon
from guidance.control.servo import AltitudeHold, ServoGains, hold_altitude, keep_station
from guidance.control.setpoint_limiter import LimitMemory, limit
from guidance.control.walls import Situation, Wall, measure_walls

__all__ = [
    "Acceleration",
    "AltitudeHold",
    "Approach",
    "Dynamics",
    "Envelope",
    "Following",
    "Gaps",
    "LimitMemory",
    "Limiter",
    "Limits",
    "Polygon",
    "ServoGains",
    "Situation",
    "SpeedMemory",
    "Speeds",
    "Wall",
    "held_back",
    "hold_altitude",
    "keep_station",
    "late_start",
    "limit",
    "measure_walls",
    "observe_speed",
]
