"""Floor and ceiling, above home."""

from guidance.frames import Vector
from guidance.limits.envelope import Envelope
from guidance.limits.limiter import Limiter
from guidance.limits.situation import Situation
from guidance.limits.stopping import Stop, drift_ned_m
from guidance.limits.wall import Wall, wall

_DOWN: Vector = (0.0, 0.0, 1.0)
_UP: Vector = (0.0, 0.0, -1.0)


def floor_and_ceiling(situation: Situation, envelope: Envelope, stop: Stop) -> tuple[Wall, Wall]:
    """The vehicle would come to rest at or above the floor and at or below the ceiling.

    Below the floor nothing descends, above the ceiling nothing climbs; the way back is free and not taken by itself
    (`hold_altitude` takes it).
    """
    height_m = envelope.home_ned_m[2] - situation.position_ned_m[2]
    drift = drift_ned_m(situation.velocity_ned_m_s, envelope)
    return (
        wall(Limiter.FLOOR, _DOWN, height_m - envelope.floor_m, stop, drift),
        wall(Limiter.CEILING, _UP, envelope.ceiling_m - height_m, stop, drift),
    )
