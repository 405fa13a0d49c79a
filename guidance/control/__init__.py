"""From the velocity that the game asks for to a setpoint within the limits.

Following:
    follow: one cycle of it, with a `FollowMemory`; `Following` has the settings of one vehicle.
    ServoGains, Approach: settings of its parts.
    Gaps: distances to the disc. Speeds: horizontal speed, climb rate and descent rate.
    hold_altitude: keeps a height, with an `AltitudeHold`. keep_station: stops and stays at a place.

What the vehicle can do:
    Acceleration, late_start: cost of accelerating.
    observe_speed: compares the speed asked for with the one flown, in a `SpeedMemory`.

Limiting, always last:
    limit: turns a command into a setpoint, `Limited`, with a `LimitMemory`; `start` returns the first one.
    Situation: state of the vehicle and the evader. `measure_walls` returns every `Wall` there.
    held_back: reduces a desired velocity before walls.
    Limits: the section of a file. Envelope: the same with the vehicle's Dynamics.
    StandOffLimit: the space about the evader that is never entered. Limiter: names of the limits.
    Polygon: corners of a fence, in metres about home.
"""

from guidance.control.braking_law import held_back
from guidance.control.capability import (
    Acceleration,
    SpeedMemory,
    late_start,
    observe_speed,
)
from guidance.control.follow import Approach, Following, FollowMemory, Gaps, follow
from guidance.control.limits import Dynamics, Envelope, Limiter, Limits, Speeds, StandOffLimit
from guidance.control.polygon import Polygon
from guidance.control.servo import AltitudeHold, ServoGains, hold_altitude, keep_station
from guidance.control.setpoint_limiter import Limited, LimitMemory, limit, start
from guidance.control.walls import Situation, Wall, measure_walls

__all__ = [
    "Acceleration",
    "AltitudeHold",
    "Approach",
    "Dynamics",
    "Envelope",
    "FollowMemory",
    "Following",
    "Gaps",
    "LimitMemory",
    "Limited",
    "Limiter",
    "Limits",
    "Polygon",
    "ServoGains",
    "Situation",
    "SpeedMemory",
    "Speeds",
    "StandOffLimit",
    "Wall",
    "follow",
    "held_back",
    "hold_altitude",
    "keep_station",
    "late_start",
    "limit",
    "measure_walls",
    "observe_speed",
    "start",
]
