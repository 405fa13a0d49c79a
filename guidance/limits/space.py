"""All limits in space together: one velocity that keeps every one of them."""

import math
from typing import NamedTuple

from guidance.frames import Vector
from guidance.limits.altitude import floor_and_ceiling
from guidance.limits.envelope import Envelope
from guidance.limits.fence import keep_in_circle, outward_wall, polygon_walls
from guidance.limits.limiter import Limiter
from guidance.limits.situation import Situation
from guidance.limits.stand_off import stand_off_walls
from guidance.limits.stopping import stop
from guidance.limits.wall import Wall, leans, shrink, slide


class Allowed(NamedTuple):
    """A velocity that every limit in space allows, and the walls that took something away from the one asked for."""

    velocity_ned_m_s: Vector
    leaning: tuple[Wall, ...]


def walls(velocity_ned_m_s: Vector, situation: Situation, envelope: Envelope) -> tuple[Wall, ...]:
    """Every wall as this velocity meets it: stand-off, polygon, floor and ceiling."""
    seconds = stop(velocity_ned_m_s, envelope)
    return (
        *stand_off_walls(velocity_ned_m_s, situation, envelope),
        *polygon_walls(situation, envelope, seconds),
        *floor_and_ceiling(situation, envelope, seconds),
    )


def keep_within(velocity_ned_m_s: Vector, situation: Situation, envelope: Envelope) -> Allowed:
    """Slide along every limit in turn, then scale until all hold at once.

    The sliding keeps as much of the motion as may be; the scaling makes it exact where limits meet in a corner, and
    leaves the circle's law alone: what may be may also be slower. Speed over the ground and vertical speed never rise.
    """
    seconds = stop(velocity_ned_m_s, envelope)
    obstacles = walls(velocity_ned_m_s, situation, envelope)
    leaning: list[Wall] = []
    velocity = velocity_ned_m_s
    for one in obstacles:
        if leans(velocity, one):
            leaning.append(one)
            velocity = slide(velocity, one)
    inside = keep_in_circle(velocity, situation, envelope, seconds)
    if inside is not velocity:
        leaning.append(outward_wall(situation, envelope))
        velocity = inside
    for one in obstacles:
        velocity = shrink(velocity, one)
    return Allowed(velocity, tuple(leaning))


def full_speed_walls(velocity_ned_m_s: Vector, envelope: Envelope) -> tuple[Wall, ...]:
    """At a speed limit, the limit is a wall to acceleration: a feed-forward may turn the velocity, not raise it."""
    north, east, down = velocity_ned_m_s
    ground_m_s = math.hypot(north, east)
    found = []
    if ground_m_s >= envelope.speed_m_s * (1.0 - 1e-9):
        found.append(Wall(Limiter.SPEED, (north, east, 0.0), 0.0))
    if down >= envelope.descent_m_s * (1.0 - 1e-9):
        found.append(Wall(Limiter.VERTICAL_SPEED, (0.0, 0.0, 1.0), 0.0))
    if -down >= envelope.climb_m_s * (1.0 - 1e-9):
        found.append(Wall(Limiter.VERTICAL_SPEED, (0.0, 0.0, -1.0), 0.0))
    return tuple(found)
