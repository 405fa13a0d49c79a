"""The last metres: the disc is reached without overshoot, at the evader's own velocity.

The game closes at full speed to the very rim. A vehicle has to stop closing there, and what counts is the motion seen
from the evader. Of the distance left, the vehicle uses up some before it answers; over the rest it may close only as
fast as it can surely brake (`approach_speed`):

    v · settle + v² / (2 · braking) = gap − margin − lag · (closing speed now)

An evader that flees is thus followed at its own speed to the rim, as it has to be if it is to be captured at all. One
that stops dead there is flown past, above it at the height of the disc: `stand_off_walls` sees to it that a
vehicle below that height keeps the distance in which it could stop.

What the game wants across the line of sight fades as the closing does, so that at the rim the velocity is the
evader's, and inside it the vehicle backs off gently. The height is approached by the same law.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from guidance.control.shaping import approach_speed
from guidance.frames import Vector
from guidance.game import StandOff


@dataclass(frozen=True, slots=True, kw_only=True)
class Approach:
    """How one vehicle arrives at the disc.

    Attributes:
        braking_m_s2: Deceleration over the ground that is planned with.
        vertical_braking_m_s2: The same vertically.
        lag_s: How long the vehicle goes on as it does before it answers.
        settle_s: Time constant of the last part, horizontally; it damps what is noise in the positions.
        vertical_settle_s: The same vertically.
        margin_m: How far outside the rim it comes to rest.
        backing_m_s: Largest speed at which it backs off from inside.
    """

    braking_m_s2: float
    vertical_braking_m_s2: float
    lag_s: float = 0.3
    settle_s: float = 0.3
    vertical_settle_s: float = 0.6
    margin_m: float = 0.15
    backing_m_s: float = 1.0


class Gaps(NamedTuple):
    """To the stand-off disc: horizontally to its rim (negative inside), and the height above it; unit vector to E."""

    ground_m: float
    height_m: float
    towards_north: float
    towards_east: float


def gaps_to_disc(position_ned_m: Vector, evader_ned_m: Vector, standoff: StandOff) -> Gaps:
    """Return how far a place is from the stand-off disc of an evader."""
    north, east = evader_ned_m[0] - position_ned_m[0], evader_ned_m[1] - position_ned_m[1]
    distance_m = math.hypot(north, east)
    scale = 1.0 / distance_m if distance_m > 0.0 else 0.0
    height_m = evader_ned_m[2] - position_ned_m[2] - standoff.height_m
    return Gaps(distance_m - standoff.radius_m, height_m, north * scale, east * scale)


class Approached(NamedTuple):
    """The velocity to fly, and whether the approach has slowed the closing down."""

    velocity_ned_m_s: Vector
    braking: bool


def closing_allowed(left_m: float, braking_m_s2: float, settle_s: float, backing_m_s: float) -> float:
    """Return the speed, m/s, at which a distance may be closed; negative, backing off, where none is left.

    Args:
        left_m: The distance that is left; negative inside of what may be closed on.
        braking_m_s2: What brakes, m/s².
        settle_s: The time constant of the last stretch.
        backing_m_s: The most that is backed off with.
    """
    if left_m > 0.0:
        return approach_speed(left_m, braking_m_s2, settle_s)
    return max(-backing_m_s, 0.5 * left_m / settle_s)


def approach(
    desired_ned_m_s: Vector, flown_ned_m_s: Vector, evader_ned_m_s: Vector, gaps: Gaps, settings: Approach
) -> Approached:
    """Slow a velocity down near the disc.

    Args:
        desired_ned_m_s: What is desired without regard to braking.
        flown_ned_m_s: What the vehicle flies.
        evader_ned_m_s: What the evader does, as estimated.
        gaps: To the disc.
        settings: How the vehicle brakes.
    """
    north, east, braking = _over_ground(desired_ned_m_s, flown_ned_m_s, evader_ned_m_s, gaps, settings)
    return Approached((north, east, _vertical(desired_ned_m_s[2], flown_ned_m_s[2], gaps.height_m, settings)), braking)


def _over_ground(
    desired: Vector, flown: Vector, evader: Vector, gaps: Gaps, settings: Approach
) -> tuple[float, float, bool]:
    to_north, to_east = gaps.towards_north, gaps.towards_east
    north, east = desired[0] - evader[0], desired[1] - evader[1]
    closing = north * to_north + east * to_east
    closing_now = (flown[0] - evader[0]) * to_north + (flown[1] - evader[1]) * to_east
    left_m = gaps.ground_m - settings.margin_m - settings.lag_s * closing_now
    allowed = closing_allowed(left_m, settings.braking_m_s2, settings.settle_s, settings.backing_m_s)
    if closing <= allowed:
        return desired[0], desired[1], False
    across = max(0.0, allowed / closing) if closing > 0.0 else 0.0
    return (
        evader[0] + across * (north - closing * to_north) + allowed * to_north,
        evader[1] + across * (east - closing * to_east) + allowed * to_east,
        True,
    )


def _vertical(desired_m_s: float, flown_m_s: float, height_m: float, settings: Approach) -> float:
    """Return the vertical speed (down positive), slowed down near the height of the disc; never away from it."""
    closing_now = math.copysign(flown_m_s, height_m * flown_m_s)
    left_m = max(0.0, abs(height_m) - settings.lag_s * closing_now)
    allowed = approach_speed(left_m, settings.vertical_braking_m_s2, settings.vertical_settle_s)
    return max(-allowed, min(allowed, desired_m_s))
