"""The least margin on an interval of a target's edge: the zero of its slope, within a bracket.

The slope has no unit of length, so the precision does not depend on the size of the edge.
"""

import math
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from guidance.game.arrays import NUMPY, Array, Library, Real, Truth
from guidance.game.records import in_rows

STEEP = 1e-7
"""Slope of the margin, times v, that counts as zero: the margin is then right to 1e-14 of the time of the run."""

_STEPS = 80
"""Most steps to a point of zero slope; Newton's method needs three, the secant method seven."""

CURVED_STEPS = 3
"""Halley's steps on a course that knows its curvature; from a refracted position 99 of 100 rows need no more."""

NEARLY = 1e-6
"""Slope, times v, small enough for Halley's step to reach the last digits: the error of the step is its cube."""

TOGETHER = 4
"""Steps of all rows, before the rows that need more go on by themselves."""

_TRACED_STEPS = 16
"""Steps for libraries that trace and cannot stop early."""


class Pose(NamedTuple):
    """The margin at a position, s, and its slope, s/m; of a course that is `curved`, the slope's derivatives, too.

    Attributes:
        margin: s.
        slope: s/m.
        bend: first derivative of the slope by the position.
        twist: second derivative.
    """

    margin: Real
    slope: Real
    bend: Real = math.nan
    twist: Real = math.nan


class MarginEdge(Protocol):
    """An edge along which the margin is followed: a record whose numbers may be arrays, one for each row."""

    @property
    def curved(self) -> bool:
        """True if a pose has the derivatives of the slope."""

    @property
    def v(self) -> Real:
        """Speed of the evader, m/s."""

    def pose(self, xp: Library, position: Real) -> Pose:
        """Return the margin at a position and its derivatives."""


class Bracket(NamedTuple):
    """An interval of a course, and the slopes at its ends: the first is negative, the second positive."""

    low: Real
    high: Real
    falling: Real
    rising: Real
    trial: Real
    """The first position to try."""


class Spot(NamedTuple):
    """A position on a course, and the margin there, s."""

    position: Real
    margin: Real


NO_SPOT = Spot(0.0, math.inf)


def lesser_spot(xp: Library, best: Spot, rival: Spot) -> Spot:
    """Return the spot with the lesser margin."""
    return xp.select_all(rival.margin < best.margin, rival, best)


def least_within(xp: Library, course: MarginEdge, bracket: Bracket, enclosed: Truth) -> Spot:
    """Return the spot of zero slope in the rows whose bracket encloses one, nowhere in the others."""
    spot = in_rows(enclosed, NO_SPOT, partial(_zero_of_slope, xp), course, bracket)
    # Libraries that trace compute all rows; a bracket that encloses nothing may lead off the edge.
    return xp.select_all(enclosed, spot, NO_SPOT) if xp.differentiates else spot


def scanned(xp: Library, course: MarginEdge, positions: tuple[Real, ...]) -> Spot:
    """Return the least margin at and between positions, in ascending or descending order."""
    if xp is NUMPY:
        return _scanned_at_once(course, np.stack(np.broadcast_arrays(*positions)))
    before = positions[0]
    pose = course.pose(xp, before)
    best = Spot(before, pose.margin)
    for position in positions[1:]:
        after = course.pose(xp, position)
        best = lesser_spot(xp, best, Spot(position, after.margin))
        bracket = _between(xp, (before, pose), (position, after))
        enclosed = (bracket.falling < 0.0) & (bracket.rising > 0.0)
        best = lesser_spot(xp, best, least_within(xp, course, bracket, enclosed))
        before = position
        pose = after
    return best


def _scanned_at_once(course: MarginEdge, positions: Array) -> Spot:
    """Return the same with NumPy: positions are along the first axis."""
    pose = course.pose(NUMPY, positions)
    margins: Array = pose.margin
    slopes: Array = pose.slope
    before = (positions[:-1], Pose(margins[:-1], slopes[:-1]))
    after = (positions[1:], Pose(margins[1:], slopes[1:]))
    bracket = _between(NUMPY, before, after)
    enclosed = (bracket.falling < 0.0) & (bracket.rising > 0.0)
    between = least_within(NUMPY, course, bracket, enclosed)
    best = Spot(positions[0], margins[0])
    for number in range(1, len(positions)):
        best = lesser_spot(NUMPY, best, Spot(positions[number], margins[number]))
    if between is NO_SPOT:
        return best
    places: Array = between.position
    least: Array = between.margin
    for number in range(len(positions) - 1):
        best = lesser_spot(NUMPY, best, Spot(places[number], least[number]))
    return best


def _between(xp: Library, before: tuple[Real, Pose], after: tuple[Real, Pose]) -> Bracket:
    """Return the interval between two positions in either order."""
    position, pose = before
    next_position, next_pose = after
    ascends = next_position > position
    return Bracket(
        low=xp.select(ascends, position, next_position),
        high=xp.select(ascends, next_position, position),
        falling=xp.select(ascends, pose.slope, next_pose.slope),
        rising=xp.select(ascends, next_pose.slope, pose.slope),
        trial=0.5 * (position + next_position),
    )


def _zero_of_slope(xp: Library, course: MarginEdge, bracket: Bracket) -> Spot:
    """Find the zero of the slope in a bracket, by Halley's method or, where that fails, by narrowing the bracket."""
    if xp.differentiates or not course.curved:
        return _bracketed(xp, course, bracket)
    position = bracket.trial
    for _ in range(CURVED_STEPS):
        pose = course.pose(xp, position)
        # Halley's next position; it is arbitrary where the slope falls.
        step = pose.slope / pose.bend
        position = position - step / (1.0 - 0.5 * step * pose.twist / pose.bend)
    inside = (pose.bend > 0.0) & (position > bracket.low) & (position < bracket.high)
    return in_rows(
        (inside & (abs(pose.slope) * course.v <= NEARLY)) == 0,
        Spot(position, pose.margin),
        partial(_bracketed, xp),
        course,
        bracket._replace(trial=xp.select(inside, position, bracket.trial)),
    )


def _bracketed(xp: Library, course: MarginEdge, bracket: Bracket) -> Spot:
    """Find it by steps that narrow the bracket, from its trial if that is inside."""
    inside = (bracket.trial > bracket.low) & (bracket.trial < bracket.high)
    trial = xp.select(inside, bracket.trial, _secant(xp, bracket))
    steps = _TRACED_STEPS if xp.differentiates else _STEPS
    return _stepped(xp, course, bracket._replace(trial=trial), 0.0 * trial, steps)


def _stepped(xp: Library, course: MarginEdge, bracket: Bracket, sign: Real, steps: int) -> Spot:
    """Take some steps, and more in rows that need them.

    Args:
        xp: array library.
        course: the edge.
        bracket: the interval, with the position to try.
        sign: of the last slope; 0 at first.
        steps: how many are allowed.
    """
    converged: Truth = False
    spot = NO_SPOT
    for number in range(steps if xp.differentiates else min(steps, TOGETHER)):
        pose = course.pose(xp, bracket.trial)
        bracket = _narrowed(xp, course, bracket, pose, sign)
        middle = 0.5 * (bracket.low + bracket.high)
        last = bracket.trial
        if course.curved:
            # Newton's next position, unless that is outside the bracket
            convex = pose.bend > 0.0
            position = bracket.trial - pose.slope / xp.select(convex, pose.bend, 1.0)
            inside = convex & (position > bracket.low) & (position < bracket.high)
            last = xp.select(inside, position, last)
            position = xp.select(inside, position, middle)
        else:
            sign = xp.select(pose.slope < 0.0, 0.0 * middle - 1.0, 0.0 * middle + 1.0)
            halved = number % TOGETHER == TOGETHER - 1
            position = middle if halved else _secant(xp, bracket)
        # Newton's last step counts too, but no step after a row has converged
        spot = xp.select_all(converged, spot, Spot(last, pose.margin))
        tight = (middle <= bracket.low) | (middle >= bracket.high)
        converged = converged | tight | (abs(pose.slope) * course.v <= STEEP)
        if not xp.any(converged == 0):
            return spot
        bracket = bracket._replace(trial=position)
    if xp.differentiates or steps <= TOGETHER:
        return spot
    return in_rows(
        converged == 0,
        spot,
        lambda course, bracket, sign: _stepped(xp, course, bracket, sign, steps - TOGETHER),
        course,
        bracket,
        sign,
    )


def _narrowed(xp: Library, course: MarginEdge, bracket: Bracket, pose: Pose, sign: Real) -> Bracket:
    """Return the bracket with an end at the position that was tried.

    For the secant method, the slope of an end that stays a second time counts half.
    """
    slope = pose.slope
    falls = slope < 0.0
    rises = slope > 0.0
    low = xp.select(falls, bracket.trial, bracket.low)
    high = xp.select(rises, bracket.trial, bracket.high)
    if course.curved:
        return bracket._replace(low=low, high=high)
    falling = xp.select(rises & (sign > 0.0), 0.5 * bracket.falling, bracket.falling)
    rising = xp.select(falls & (sign < 0.0), 0.5 * bracket.rising, bracket.rising)
    return Bracket(
        low=low,
        high=high,
        falling=xp.select(falls, slope, falling),
        rising=xp.select(rises, slope, rising),
        trial=bracket.trial,
    )


def _secant(xp: Library, bracket: Bracket) -> Real:
    """Return where a straight line through the slopes at both ends is zero."""
    rise = bracket.rising - bracket.falling
    share = -bracket.falling / xp.select(rise > 0.0, rise, 1.0)
    return bracket.low + xp.select(rise > 0.0, share, 0.5) * (bracket.high - bracket.low)
