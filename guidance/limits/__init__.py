"""The envelope and the last word before the wire: `limit` turns any command into a setpoint that may be sent."""

from guidance.limits.altitude_hold import AltitudeHold, Held, hold_altitude
from guidance.limits.envelope import Envelope, StandOffLimit
from guidance.limits.last_word import Limited, limit
from guidance.limits.limiter import Limiter
from guidance.limits.memory import LimitMemory, start
from guidance.limits.polygon import Polygon
from guidance.limits.situation import Situation
from guidance.limits.speeds import SpeedLimits, Speeds

__all__ = [
    "AltitudeHold",
    "Envelope",
    "Held",
    "LimitMemory",
    "Limited",
    "Limiter",
    "Polygon",
    "Situation",
    "SpeedLimits",
    "Speeds",
    "StandOffLimit",
    "hold_altitude",
    "limit",
    "start",
]
