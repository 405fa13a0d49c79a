"""From the velocity that the game asks for to a setpoint that may be sent: follow it, and limit whatever is sent.

Following:
    follow: one cycle of it, with a `FollowMemory`; `Following` says how one vehicle is made to fly a velocity.
    ServoGains, Approach: its parts: the servo, and how the disc is arrived at.
    Gaps: distances to the disc. Speeds: horizontal speed, climb rate and descent rate.
    hold_altitude: keeps a height, with an `AltitudeHold`, and returns what is `Held`.
    keep_station: stops over the ground and stays.
    with_drift, less_drift: a velocity over the ground in an autopilot's own terms, and back.

What the vehicle can do:
    Acceleration, late_start: what accelerating costs.
    observe_speed: compares the speed asked for with the one flown, in a `SpeedMemory`.

Limiting, always last:
    limit: makes a setpoint of a command that the envelope allows, `Limited`, with a `LimitMemory`; `start` begins one.
    Situation: where the vehicle and the evader are.
    Limits: the section of a file. Envelope: the same with the vehicle's Dynamics, for the limiter.
    StandOffLimit: the space about the evader that is never entered. Limiter: what changed a command, by name.
    keep_inside: holds a velocity back at a fence. measure_fence: where a vehicle is to its fences, `FenceGeometry`.
    Polygon, NorthEast: corners of a fence, and a place, in metres about home.
"""

from guidance.control.capability import (
    Acceleration,
    SpeedMemory,
    late_start,
    observe_speed,
)
from guidance.control.envelope import Dynamics, Envelope, Limiter, Situation, StandOffLimit
from guidance.control.fence import FenceGeometry, keep_inside, measure_fence
from guidance.control.follow import Approach, Following, FollowMemory, Gaps, follow, less_drift, with_drift
from guidance.control.hold import AltitudeHold, Held, NorthEast, hold_altitude, keep_station
from guidance.control.limits import Limits, Speeds
from guidance.control.polygon import Polygon
from guidance.control.servo import ServoGains
from guidance.control.setpoint_limiter import Limited, LimitMemory, limit, start

__all__ = [
    "Acceleration",
    "AltitudeHold",
    "Approach",
    "Dynamics",
    "Envelope",
    "FenceGeometry",
    "FollowMemory",
    "Following",
    "Gaps",
    "Held",
    "LimitMemory",
    "Limited",
    "Limiter",
    "Limits",
    "NorthEast",
    "Polygon",
    "ServoGains",
    "Situation",
    "SpeedMemory",
    "Speeds",
    "StandOffLimit",
    "follow",
    "hold_altitude",
    "keep_inside",
    "keep_station",
    "late_start",
    "less_drift",
    "limit",
    "measure_fence",
    "observe_speed",
    "start",
    "with_drift",
]
