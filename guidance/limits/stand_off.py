"""The stand-off: an upright cylinder about the evader, from below it to a height above it, that is not entered."""

import math

from guidance.frames import Vector
from guidance.limits.envelope import Envelope
from guidance.limits.limiter import Limiter
from guidance.limits.situation import Situation
from guidance.limits.stopping import drift_ned_m, stop
from guidance.limits.wall import Wall, wall

COVER_M = 0.5
"""Height above the lid from which on an evader that flees is trusted to go on."""

_STILL: Vector = (0.0, 0.0, 0.0)


def stand_off_walls(velocity_ned_m_s: Vector, situation: Situation, envelope: Envelope) -> tuple[Wall, ...]:
    """The nearest point of the cylinder is a wall; beside, above, or across its rim where both gaps are open.

    Above the cylinder, an evader that flees takes the wall with it: only the closing speed beyond its own has to be
    braked. Should it stop dead, the vehicle flies past over it, at the height that it has. Beside the cylinder there is
    nothing to fly past over, and the law is that of an evader at rest, however fast it flees: it may stop at any time.
    In between, the last `COVER_M` above the lid, the one law goes over into the other. An evader that comes nearer does
    not push: its law is that of an evader at rest. Inside, what leads deeper is forbidden.
    """
    zone, evader = envelope.stand_off, situation.evader_position_ned_m
    if zone is None or evader is None:
        return ()
    north, east = evader[0] - situation.position_ned_m[0], evader[1] - situation.position_ned_m[1]
    distance_m = math.hypot(north, east)
    toward = (north / distance_m, east / distance_m) if distance_m > 0.0 else (0.0, 0.0)
    beside_m = max(0.0, distance_m - zone.radius_m)
    above_m = max(0.0, evader[2] - situation.position_ned_m[2] - zone.height_m)

    flight = situation.evader_velocity_ned_m_s or _STILL
    fleeing_m_s = max(0.0, flight[0] * toward[0] + flight[1] * toward[1]) * min(1.0, above_m / COVER_M)
    wall_velocity = (fleeing_m_s * toward[0], fleeing_m_s * toward[1])
    seconds = stop(_less_over_ground(velocity_ned_m_s, wall_velocity), envelope)
    drift = drift_ned_m(_less_over_ground(situation.velocity_ned_m_s, wall_velocity), envelope)

    gap_m = math.hypot(beside_m, above_m)
    normals = [(beside_m / gap_m, above_m / gap_m)] if gap_m > 0.0 else [(1.0, 0.0), (0.0, 1.0)]
    found = []
    for level, steep in normals:
        one = wall(Limiter.STAND_OFF, (level * toward[0], level * toward[1], steep), gap_m, seconds, drift)
        found.append(one._replace(distance_m=one.distance_m + level * fleeing_m_s * seconds.ground_s))
    return tuple(found)


def _less_over_ground(velocity: Vector, other: tuple[float, float]) -> Vector:
    return (velocity[0] - other[0], velocity[1] - other[1], velocity[2])
