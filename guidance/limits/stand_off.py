"""The stand-off: an upright cylinder about the target, from below it to a height above it, that is not entered."""

import math

from guidance.frames import Vector
from guidance.limits.envelope import Envelope
from guidance.limits.limiter import Limiter
from guidance.limits.situation import Situation
from guidance.limits.stopping import Stop, stop
from guidance.limits.wall import Wall

_STILL: Vector = (0.0, 0.0, 0.0)


def stand_off_walls(velocity_ned_m_s: Vector, situation: Situation, envelope: Envelope) -> tuple[Wall, ...]:
    """The nearest point of the cylinder is a wall; beside, above, or across its rim where both gaps are open.

    A target that flees takes the wall with it: only the closing speed beyond its own has to be braked. One that
    comes nearer does not push: the law then is that of a target at rest. Inside, what leads deeper is forbidden.
    """
    zone, target = envelope.stand_off, situation.target_position_ned_m
    if zone is None or target is None:
        return ()
    north, east = target[0] - situation.position_ned_m[0], target[1] - situation.position_ned_m[1]
    distance_m = math.hypot(north, east)
    toward = (north / distance_m, east / distance_m) if distance_m > 0.0 else (0.0, 0.0)
    beside_m = max(0.0, distance_m - zone.radius_m)
    above_m = max(0.0, target[2] - situation.position_ned_m[2] - zone.height_m)

    flight = situation.target_velocity_ned_m_s or _STILL
    fleeing_m_s = max(0.0, flight[0] * toward[0] + flight[1] * toward[1])
    closing = (
        velocity_ned_m_s[0] - fleeing_m_s * toward[0],
        velocity_ned_m_s[1] - fleeing_m_s * toward[1],
        velocity_ned_m_s[2],
    )
    seconds = stop(closing, envelope)
    fleeing_m = fleeing_m_s * seconds.ground_s

    gap_m = math.hypot(beside_m, above_m)
    if gap_m > 0.0:
        level, steep = beside_m / gap_m, above_m / gap_m
        return (_wall(level, steep, toward, seconds, gap_m + level * fleeing_m),)
    return (_wall(1.0, 0.0, toward, seconds, fleeing_m), _wall(0.0, 1.0, toward, seconds, 0.0))


def _wall(level: float, steep: float, toward: tuple[float, float], seconds: Stop, distance_m: float) -> Wall:
    ground_s = level * seconds.ground_s
    return Wall(Limiter.STAND_OFF, (toward[0] * ground_s, toward[1] * ground_s, steep * seconds.vertical_s), distance_m)
