"""From the velocity that the game asks for to a setpoint that may be sent: follow it, and limit whatever is sent."""

from guidance.control.approach import Approach
from guidance.control.catch_up import CatchUp
from guidance.control.envelope import Envelope, Limiter, SpeedLimits, Speeds, StandOffLimit
from guidance.control.fence import FenceGeometry, keep_inside, measure_fence
from guidance.control.follow import Following, FollowMemory, follow, less_drift, with_drift
from guidance.control.hold import AltitudeHold, Held, NorthEast, hold_altitude, keep_station
from guidance.control.late_start import Acceleration
from guidance.control.polygon import Polygon
from guidance.control.servo import ServoGains
from guidance.control.setpoint_limiter import Limited, LimitMemory, limit, start
from guidance.control.situation import Situation

__all__ = [
    "Acceleration",
    "AltitudeHold",
    "Approach",
    "CatchUp",
    "Envelope",
    "FenceGeometry",
    "FollowMemory",
    "Following",
    "Held",
    "LimitMemory",
    "Limited",
    "Limiter",
    "NorthEast",
    "Polygon",
    "ServoGains",
    "Situation",
    "SpeedLimits",
    "Speeds",
    "StandOffLimit",
    "follow",
    "hold_altitude",
    "keep_inside",
    "keep_station",
    "less_drift",
    "limit",
    "measure_fence",
    "start",
    "with_drift",
]
