"""All limits in space together: one velocity that keeps every one of them."""

import math
from typing import NamedTuple

from guidance.control.envelope import Envelope, Limiter
from guidance.control.fence import FenceGeometry, circle_constraint, keep_in_circle, polygon_constraints
from guidance.control.situation import Situation
from guidance.control.velocity_constraints import (
    VelocityConstraint,
    drift_ned_m,
    floor_and_ceiling,
    shrink,
    slide,
    stand_off_constraints,
    stop,
    surge_ned_m,
)
from guidance.frames import Vector


class Feasible(NamedTuple):
    """A velocity that every limit in space allows, and the constraints that took something away from the one asked."""

    velocity_ned_m_s: Vector
    active: tuple[VelocityConstraint, ...]


def feasible_velocity(
    velocity_ned_m_s: Vector, situation: Situation, fence: FenceGeometry, envelope: Envelope
) -> Feasible:
    """Slide along every limit in turn, then scale until all hold at once.

    The sliding keeps as much of the motion as may be; the scaling makes it exact where limits meet in a corner, and
    leaves the circle's law alone: what may be may also be slower. Speed over the ground and vertical speed never rise.

    Args:
        velocity_ned_m_s: What is asked for.
        situation: Where vehicle and evader are.
        fence: Where the vehicle is to the fences.
        envelope: What is allowed.
    """
    seconds, drift = stop(velocity_ned_m_s, envelope), drift_ned_m(situation.velocity_ned_m_s, envelope)
    surge = surge_ned_m(situation.velocity_ned_m_s, situation.acceleration_ned_m_s2, envelope)
    going = (drift[0] + surge[0], drift[1] + surge[1], drift[2])
    constraints = (
        *stand_off_constraints(velocity_ned_m_s, situation, envelope),
        *polygon_constraints(fence, envelope, seconds, going),
        *floor_and_ceiling(situation.position_ned_m[2], envelope, seconds, drift),
    )
    active: list[VelocityConstraint] = []
    velocity = velocity_ned_m_s
    for one in constraints:
        slid = slide(velocity, one)
        if slid is not velocity:
            active.append(one)
            velocity = slid
    inside = keep_in_circle(velocity, fence, envelope, seconds, going)
    if inside is not velocity:
        active.append(circle_constraint(fence))
        velocity = inside
    for one in constraints if active else ():
        velocity = shrink(velocity, one)
    return Feasible(velocity, tuple(active))


OVER_SPEED = 0.05
"""Share of a speed limit over which what a feed-forward may push along it fades away, once the vehicle flies faster."""


def full_speed_constraints(
    velocity_ned_m_s: Vector, flown_ned_m_s: Vector, envelope: Envelope
) -> tuple[VelocityConstraint, ...]:
    """Where a speed limit is commanded, it constrains the feed-forward as well, of m/s² for a distance.

    A feed-forward may turn the velocity, and hold it against drag, which takes several m/s² at full speed: along a
    limit it may push as long as the vehicle itself flies no faster, and not at all from `OVER_SPEED` above it on.
    """
    (north, east, down), flown = velocity_ned_m_s, flown_ned_m_s
    ground_m_s = math.hypot(north, east)
    found = []
    if ground_m_s >= envelope.speed_m_s * (1.0 - 1e-9):
        along = (north / ground_m_s, east / ground_m_s, 0.0)
        push = _push(flown[0] * along[0] + flown[1] * along[1], envelope.speed_m_s, envelope.acceleration_m_s2)
        found.append(VelocityConstraint(Limiter.SPEED, along, push))
    vertical_m_s2 = envelope.vertical_acceleration_m_s2
    if down >= envelope.descent_m_s * (1.0 - 1e-9):
        push = _push(flown[2], envelope.descent_m_s, vertical_m_s2)
        found.append(VelocityConstraint(Limiter.VERTICAL_SPEED, (0.0, 0.0, 1.0), push))
    if -down >= envelope.climb_m_s * (1.0 - 1e-9):
        push = _push(-flown[2], envelope.climb_m_s, vertical_m_s2)
        found.append(VelocityConstraint(Limiter.VERTICAL_SPEED, (0.0, 0.0, -1.0), push))
    return tuple(found)


def _push(flown_m_s: float, limit_m_s: float, most_m_s2: float) -> float:
    """Return the acceleration that a vehicle at this speed may still be given along a speed limit."""
    over = (flown_m_s - limit_m_s) / (OVER_SPEED * limit_m_s)
    return most_m_s2 * min(1.0, max(0.0, 1.0 - over))
