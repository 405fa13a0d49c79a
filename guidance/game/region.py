"""The point of the evader's region closest to its target: g* of the paper, and its counterpart in every other game.

The region holds the points that the evader reaches before the pursuer can capture it there. In the paper's game it is
the Apollonius disc, with a closed form (`tad.closest_of_circle`). In other games one unknown is left, the evader's
heading; it leads to a point of the region's edge (`headings`). The region is convex while the information is young
enough (`guaranteed_age_s`), so that the distance from T has one minimum along its edge. Newton's method finds that by
the first and second derivative of the capture time, a few steps from the closest point of a circle that touches the
edge. A few rows need more steps, or a bracket around the minimum. With old information the region can have
a dent in front of the pursuer and several minima; `solve` gives no value there (`Reason.NO_REGION`).
"""

from typing import NamedTuple

import numpy as np

from guidance.game.arrays import (
    Library,
    Plane,
    Real,
    Truth,
    cross2,
    dot2,
    in_plane,
    is_array,
    plus2,
    times2,
)
from guidance.game.game import NO_WIND, Game
from guidance.game.headings import (
    AimedHeading,
    HeadingRun,
    Hunt,
    aimed_at,
    clipped,
    hunt_for,
    judge,
    way_along,
)
from guidance.game.pe import Geometry
from guidance.game.records import in_rows, is_zero

_STEPS = 3
"""Newton steps of every row."""

_ROUNDS = 6
"""Rounds from circle to circle in a game with only a disc; most rows then need a single Newton step."""

_NEWTON_STEPS = 7
"""Newton steps of a row that needs more, before bisection."""

MORE_STEPS = 80
"""Steps within a bracket, enough to reach the last bit in every row."""

DISC_STEPS = 5
"""Rounds that find the best point of the stand-off disc."""

HEADINGS = 32
"""Intervals of the headings over which the distance from the target may fall and rise once."""

_TRACED_STEPS = 12
"""Steps for libraries that trace and cannot stop early."""


class Closest(NamedTuple):
    """The evader's end: the vector of its run, m; the time, s; the distance from its target, m."""

    run: Plane
    time: Real
    distance: Real


def is_circle(game: Game) -> Truth:
    """Return whether the region (for a Cylinder its planar part) is the paper's disc; row by row if that differs."""
    if not game.calm or game.target_velocity_m_s != NO_WIND:
        return False
    lengths = (game.capture_radius_m, game.standoff.radius_m, game.information_age_s)
    if all(is_zero(length) for length in lengths):
        return True
    if any(is_array(length) and not isinstance(length, np.ndarray) for length in lengths):
        # The paper's formulas do not depend on these lengths, so their derivatives would be zero.
        return False
    return (lengths[0] == 0) & (lengths[1] == 0) & (lengths[2] == 0)


def closest_point(
    xp: Library, game: Game, state: Geometry, target: Plane, goal: Plane, selected: Truth
) -> Closest:
    """Return the closest point of the evader's region (for a Cylinder its planar part) to its target.

    Args:
        xp: array library.
        game: the game, whose region is not the paper's disc.
        state: the state.
        target: vector from the evader to the target's position now, m.
        goal: vector from the evader to the point where it could meet its target, m.
        selected: which rows to compute; the others have an arbitrary answer.
    """
    if selected is False:
        return Closest(target, 0.0, 0.0)
    hunt = hunt_for(xp, game, state, target, goal)
    return in_rows(selected, Closest(target, 0.0, 0.0), lambda hunt: _closest(xp, hunt), hunt)


def is_missed(
    xp: Library,
    game: Game,
    state: Geometry,
    ways: tuple[Plane, Plane, Real],
    selected: Truth,
    *,
    falling_s: Real = 0.0,
) -> Truth:
    """Return whether the region may have a closer point: its distance has several minima, or is less elsewhere.

    Args:
        xp: array library.
        game: the game.
        state: the state.
        ways: vectors from the evader to the target's position now and to the point where it could meet its target,
            and the least distance that was found, m.
        selected: which rows to judge; the others have been found.
        falling_s: time until a Cylinder is at the evader's height. The region has the disc that the evader reaches
            before; 0 judges the planar part alone.
    """
    if selected is False:
        return False
    target, goal, least = ways
    hunt = hunt_for(xp, game, state, target, goal)
    if game.pursuer.separate:
        hunt = hunt._replace(met_s=falling_s, met_m=hunt.radius + hunt.capture + hunt.u * falling_s)
    nothing = least < 0.0
    return (
        in_rows(selected, nothing, lambda hunt, least: _missed(xp, hunt, least), hunt, least)
        & selected
    )


def _missed(xp: Library, hunt: Hunt, least: Real) -> Truth:
    zero = 0.0 * (hunt.to_evader[0] + hunt.target[0] + hunt.ahead[0])
    aim = AimedHeading(zero - 1.0, hunt.ahead)
    _, path = settled(xp, hunt, aim, DISC_STEPS)
    before = xp.norm2(path.from_target)
    rises: Truth = False
    # Less than this share of a distance is no change.
    less = 1.0 - xp.half_of_digits(before)
    missed = before < least * less
    for number in range(1, HEADINGS + 1):
        aim = AimedHeading(zero + (2.0 * number / HEADINGS - 1.0), path.to)
        _, path = settled(xp, hunt, aim, 2)
        distance = xp.norm2(path.from_target)
        missed = missed | (distance < least * less)
        missed = missed | (rises & (distance < before * less))
        rises = rises | (distance * less > before)
        before = distance
    return missed


def _closest(xp: Library, hunt: Hunt) -> Closest:
    """Find it, by Newton's method unless the pursuer's height alone ends the run."""
    met, _ = aimed_at(xp, hunt, hunt.met_s)
    far = xp.norm2(met)
    straight = xp.unit2(met, far)
    rho = hunt.v * hunt.met_s + hunt.lag
    y = plus2(hunt.to_evader, rho, straight)
    if hunt.wind is not None:
        y = plus2(y, -hunt.met_s, hunt.wind)
    within = dot2(y, y) <= hunt.met_m * hunt.met_m
    if xp.differentiates:
        # Rows within do not use the search; a state with finite derivatives replaces theirs.
        beyond = hunt.met_m + hunt.lag + hunt.v * hunt.met_s + 1.0
        hunt = hunt._replace(to_evader=xp.select2(within, (beyond, 0.0 * beyond), hunt.to_evader))
    path = way_along(xp, hunt, search(xp, hunt, within))
    return Closest(
        xp.select2(within, times2(rho, straight), times2(path.rho, path.n)),
        xp.select(within, hunt.met_s, path.t),
        xp.select(within, abs(far - rho), xp.norm2(path.from_target)),
    )


def search(xp: Library, hunt: Hunt, within: Truth) -> AimedHeading:
    """Return the heading that ends closest to the target, for the rows that are not `within`."""
    start = touch(xp, hunt)
    if xp.differentiates:
        return bracket(xp, hunt, start, _TRACED_STEPS)
    aim, converged = newton(xp, hunt, start, within, 1 if _is_bare(hunt) else _STEPS, _NEWTON_STEPS)
    converged = within | (converged & (abs(aim.s - start.s) <= 2.0))
    return in_rows(
        converged == 0, aim, lambda hunt, aim: bracket(xp, hunt, aim, MORE_STEPS), hunt, start
    )


def newton(
    xp: Library, hunt: Hunt, aim: AimedHeading, converged: Truth, steps: int, limit: int
) -> tuple[AimedHeading, Truth]:
    """Take some steps, then single steps, up to `limit`, in rows that have not converged; return which have."""
    for _ in range(steps):
        path = way_along(xp, hunt, aim)
        turn, _, sound = judge(hunt, path)
        aim = AimedHeading(aim.s + 0.5 * turn * (1.0 + aim.s * aim.s), path.to)
    converged = converged | (sound & (abs(turn) <= xp.half_of_digits(turn)))
    if steps == limit:
        return aim, converged
    result = (aim, converged)
    return in_rows(
        converged == 0,
        result,
        lambda hunt, aim: newton(xp, hunt, aim, False, 1, limit - steps),
        hunt,
        aim,
    )


def _is_bare(hunt: Hunt) -> bool:
    """Return whether the disc is the only difference from the paper's game."""
    alone = is_zero(hunt.capture) and is_zero(hunt.lag) and not is_zero(hunt.radius)
    return alone and hunt.wind is None and hunt.drift is None


def touch(xp: Library, hunt: Hunt) -> AimedHeading:
    """Begin with the closest point of a circle that touches the region's edge on the way to the target.

    It is the paper's, of the virtual pursuer that has the evader there, seen from where both would have started without
    the lead that age, capture radius and wind give. With nothing but a disc that pursuer is the disc's point towards
    the closest point of its own circle, which is found in rounds.
    """
    hand = (hunt.u - hunt.v) * (hunt.u + hunt.v)
    to_target, _ = aimed_at(xp, hunt, 0.0)
    end = plus2(hunt.to_evader, 1.0, to_target)
    disc = xp.unit2(end, xp.norm2(end))
    if _is_bare(hunt):
        away = times2(hand, hunt.to_evader)
        goal = times2(hand, to_target)
        height = hand * hunt.z2
        for _ in range(_ROUNDS):
            run = _circle(xp, hunt, plus2(hunt.to_evader, -hunt.radius, disc), height, goal)
            end = plus2(run, 1.0, away)
            disc = xp.unit2(end, xp.norm2(end))
        return AimedHeading(_half_angle(xp, hunt, run), disc)
    path = way_along(xp, hunt, AimedHeading(0.0 * end[0], disc))
    # The vector from the virtual pursuer without lead to the evader, and its height squared.
    e0 = hunt.to_evader
    z2 = hunt.z2
    if not is_zero(hunt.radius):
        e0 = plus2(e0, -hunt.radius, path.to)
    if not is_zero(hunt.capture):
        near = xp.norm2(path.flight)
        distance = xp.sqrt(near * near + z2)
        share = hunt.capture / xp.select(distance > 0, distance, 1.0)
        e0 = plus2(e0, -share, in_plane(path.n, path.flight))
        z2 = ((1.0 - share) * (1.0 - share)) * z2
    if hunt.wind is not None:
        e0 = plus2(e0, -path.t, hunt.wind)
    lag = times2(hunt.lag, path.n)
    goal = plus2(to_target, -1.0, lag)
    if hunt.drift is not None:
        goal = plus2(goal, path.t, hunt.drift)
    run = plus2(_circle(xp, hunt, plus2(e0, 1.0, lag), hand * z2, times2(hand, goal)), hand, lag)
    s = _half_angle(xp, hunt, run)
    if is_zero(hunt.radius):
        return AimedHeading(s, path.to)
    end = plus2(run, hand, hunt.to_evader)
    if hunt.wind is not None:
        end = plus2(end, -hand * path.t, hunt.wind)
    return AimedHeading(s, xp.unit2(end, xp.norm2(end)))


def _circle(xp: Library, hunt: Hunt, to_evader: Plane, height: Real, goal: Plane) -> Plane:
    """Return the vector from E to the point of the paper's circle that is closest to a goal, times u² − v².

    `height`, the square of the pursuer's height, and the vector `goal` from E are given times that, too.
    """
    u = hunt.u
    v = hunt.v
    centre = times2(v * v, to_evader)
    back = plus2(centre, -1.0, goal)
    span = v * xp.sqrt(height + (u * u) * dot2(to_evader, to_evader))
    length = xp.norm2(back)
    return plus2(centre, -span / xp.select(length > 0, length, 1.0), back)


def _half_angle(xp: Library, hunt: Hunt, run: Plane) -> Real:
    """Return the heading of a run, at most 90° from straight ahead."""
    divisor = xp.norm2(run) + dot2(run, hunt.ahead)
    return clipped(xp, cross2(hunt.ahead, run) / xp.select(divisor > 0, divisor, 1.0))


def bracket(xp: Library, hunt: Hunt, start: AimedHeading, steps: int) -> AimedHeading:
    """Find the heading by Newton's method in a bracket, with bisection if a step would leave it."""
    aim = start
    before = 2.0
    converged = start.s != start.s
    ends = not xp.differentiates
    low = 0.0 * start.s - 1.0
    high = 0.0 * start.s + 1.0
    for _ in range(steps):
        _, path = settled(xp, hunt, aim, DISC_STEPS if ends else 2)
        turn, slope, sound = judge(hunt, path)
        converged = converged | (sound & (slope == 0))
        falls = slope < 0
        low = xp.select(falls, aim.s, low)
        high = xp.select(falls, high, aim.s)
        new = aim.s + 0.5 * turn * (1.0 + aim.s * aim.s)
        near = sound & (abs(turn) <= xp.half_of_digits(turn))
        taken = near | (sound & (new > low) & (new < high) & (abs(new - aim.s) <= 0.5 * before))
        new = xp.select(converged, aim.s, xp.select(taken, new, 0.5 * (low + high)))
        before = abs(new - aim.s)
        aim = AimedHeading(new, xp.select2(converged, aim.disc, path.to))
        converged = converged | near
        if not xp.any(converged == 0):
            break
    return aim


def settled(
    xp: Library, hunt: Hunt, aim: AimedHeading, rounds: int
) -> tuple[AimedHeading, HeadingRun]:
    """Follow a heading and find the best point of the stand-off disc, which gives the slope of the edge."""
    for _ in range(1 if is_zero(hunt.radius) else rounds):
        path = way_along(xp, hunt, aim, with_height=True)
        aim = AimedHeading(aim.s, path.to)
    return aim, path
