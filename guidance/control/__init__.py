"""From the game's velocity to a setpoint within the limits; the cycle calls the modules themselves.

Following (`follow`, `servo`):
    Handling: how one vehicle flies. ServoGains, Approach: settings of its parts.
    Gaps: distances to the disc. Speeds: horizontal speed, climb rate and descent rate.

Limiting, always last (`braking_law`, `setpoint_limiter`):
    Situation: state of the vehicle and the evader; `braking_law.measure_walls` returns every wall there.
    Limits: the section of a file. Envelope: the same with the vehicle's Dynamics. Acceleration: the guaranteed one.
    Limiter: names of the limits.
"""

from guidance.control.braking_law import Situation
from guidance.control.follow import Approach, Gaps, Handling
from guidance.control.limits import Acceleration, Dynamics, Envelope, Limiter, Limits, Speeds
from guidance.control.servo import ServoGains

__all__ = [
    "Acceleration",
    "Approach",
    "Dynamics",
    "Envelope",
    "Gaps",
    "Handling",
    "Limiter",
    "Limits",
    "ServoGains",
    "Situation",
    "Speeds",
]
