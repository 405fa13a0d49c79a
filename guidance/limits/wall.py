"""A wall: the part of a velocity that closes on it may use up no more than the distance to it before the stop.

Only closing parts are ever taken away, each towards zero: a wall adds no motion, reverses nothing and pushes nowhere.
Standing still satisfies every wall, so that any number of walls has a common answer.
"""

import math
from typing import NamedTuple

from guidance.frames import Vector
from guidance.limits.limiter import Limiter
from guidance.limits.stopping import Stop


class Wall(NamedTuple):
    """`normal_ned_s` points at what is forbidden, scaled by the seconds until the stop; `distance_m` is never negative.

    Law: max(0, ground part of normal · velocity) + max(0, vertical part of it) ≤ distance.
    """

    limiter: Limiter
    normal_ned_s: Vector
    distance_m: float

    def forbidding_all(self) -> "Wall":
        """The same wall with nothing allowed: for accelerations, which must not lean on a wall that is acting."""
        return self._replace(distance_m=0.0)


def wall(limiter: Limiter, normal_ned: Vector, distance_m: float, stop: Stop, drift_ned_m: Vector) -> Wall:
    """Build a wall from a unit normal, the distance to what is forbidden (≤ 0 beyond it) and the vehicle's drift."""
    north, east, down = normal_ned
    drift_m = max(0.0, north * drift_ned_m[0] + east * drift_ned_m[1]) + max(0.0, down * drift_ned_m[2])
    return Wall(
        limiter,
        (north * stop.ground_s, east * stop.ground_s, down * stop.vertical_s),
        max(distance_m - drift_m, 0.0),
    )


def slide(velocity_ned_m_s: Vector, wall: Wall) -> Vector:
    """Take away what closes too fast and keep what goes along the wall."""
    closing_ground, closing_vertical = _closing(velocity_ned_m_s, wall)
    used_m = closing_ground + closing_vertical
    if used_m <= wall.distance_m:
        return velocity_ned_m_s
    taken = 1.0 - wall.distance_m / used_m
    north, east, down = velocity_ned_m_s
    if closing_ground > 0.0:
        normal_north, normal_east, _ = wall.normal_ned_s
        size_s = math.hypot(normal_north, normal_east)
        part = taken * closing_ground / size_s
        north, east = north - part * (normal_north / size_s), east - part * (normal_east / size_s)
    if closing_vertical > 0.0:
        down -= taken * down
    return (north, east, down)


def shrink(velocity_ned_m_s: Vector, wall: Wall) -> Vector:
    """Scale down, direction kept, until the wall is respected; what respected other walls before still does."""
    closing_ground, closing_vertical = _closing(velocity_ned_m_s, wall)
    used_m = closing_ground + closing_vertical
    if used_m <= wall.distance_m:
        return velocity_ned_m_s
    share = wall.distance_m / used_m
    north, east, down = velocity_ned_m_s
    if closing_ground > 0.0:
        north, east = share * north, share * east
    if closing_vertical > 0.0:
        down *= share
    return (north, east, down)


def leans(velocity_ned_m_s: Vector, wall: Wall) -> bool:
    """Whether a velocity asks for more than the wall allows."""
    return sum(_closing(velocity_ned_m_s, wall)) > wall.distance_m


def _closing(velocity_ned_m_s: Vector, wall: Wall) -> tuple[float, float]:
    (north, east, down), (normal_north, normal_east, normal_down) = velocity_ned_m_s, wall.normal_ned_s
    return max(0.0, north * normal_north + east * normal_east), max(0.0, down * normal_down)
