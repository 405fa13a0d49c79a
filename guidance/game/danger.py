"""The point of a target's shape that is most in danger: where the pursuer's margin over the evader is least.

The margin at a point X is the evader's time to X less the pursuer's. It grows along every ray from the evader, so the
least margin is on the edge of the shape. A shape is covered by its straight edges and a disc around each corner.

* **On a straight line** with the evader's foot e and the pursuer's foot p, the margin of the paper's game has one
  minimum on the side of e away from p, within v/√(u² − v²) times the evader's distance from e. If the pursuer is close
  to the line compared with the evader, it can have a second minimum behind p (`_behind`): the evader may run past the
  pursuer. In other games the line is searched in small intervals then.
* **On a circle** the same holds for the part that the evader sees, with angles for lengths.

In each interval the zero of the slope is found by the secant method within a bracket. The slope has no unit of length,
so the precision does not depend on the size of the shape.
"""

import math
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np

from guidance.game.arrays import (
    Library,
    Plane,
    Real,
    Truth,
    cross2,
    dot2,
    in_plane,
    pair_length,
    plus2,
    times2,
)
from guidance.game.extent import Extent
from guidance.game.game import STILL, Game, least_square_in_hand
from guidance.game.meeting_times import ball_time
from guidance.game.pe import Geometry
from guidance.game.records import in_rows, is_zero

STEEP = 1e-7
"""Slope of the margin, times v, that counts as zero: the margin is then right to 1e-14 of the time of the run."""

STEPS = 80
"""Most steps to a point of zero slope; Newton's method needs four, the secant method seven."""

TOGETHER = 4
"""Steps of all rows, before the rows that need more go on by themselves."""

TRACED_STEPS = 16
"""Steps for libraries that trace and cannot stop early."""

WIND_STEPS = 8
"""Newton steps to the time in which a stand-off disc is reached in wind; three are usual."""

CLOSE = 1e-14
"""Share of a distance that counts as reached."""

TRIES = 20
"""Intervals of a line that are searched in games with more than the paper's, if there may be several minima."""

SEEN = tuple(
    sign * share
    for sign, shares in (
        (-1.0, (1.0, 0.88, 0.72, 0.56, 0.42, 0.3, 0.2, 0.12, 0.05)),
        (1.0, (0.0, 0.05, 0.12, 0.2, 0.3, 0.42, 0.56, 0.72, 0.88, 1.0)),
    )
    for share in shares
)
"""Positions that are tried on a circle, over that of its edge as the evader sees it."""

TRIED = 0.3
"""First position on a line behind the evader's foot, over the farthest."""

LEAST = 1e-6
"""Least square of the pursuer's distance from a line, over that of the evader's."""


class Rivals(NamedTuple):
    """Both players and their abilities, positions from the target's position.

    For a speed set with a vertical speed of its own they are those of the horizontal game.

    Attributes:
        u: speed of the pursuer, m/s.
        v: speed of the evader, m/s.
        capture: capture radius, m.
        radius: radius of the stand-off disc, m.
        z: height of the pursuer above the disc, m.
        lag: distance that the evader may have run unseen, m.
        reach: v/√(u² − (v + ‖w‖)²): see the module.
        evader: position, m.
        pursuer: horizontal position, m.
        wind: velocity of the air, m/s; None in calm air.
        drift: velocity of the target, m/s; None if it rests.
    """

    u: Real
    v: Real
    capture: Real
    radius: Real
    z: Real
    lag: Real
    reach: Real
    evader: Plane
    pursuer: Plane
    wind: Plane | None
    drift: Plane | None

    @property
    def plain(self) -> bool:
        """Whether it is the paper's game."""
        alone = is_zero(self.capture) and is_zero(self.radius)
        return alone and self.wind is None and self.drift is None


class Line(NamedTuple):
    """A straight edge, with the shape on its left; positions on it are metres from its begin.

    Attributes:
        begin: from the target's position, m.
        along: its direction.
        length: m.
        is_open: whether the shape is nothing but this line, so that both its sides are seen.
    """

    begin: Plane
    along: Plane
    length: Real
    is_open: bool


class Arc(NamedTuple):
    """A circle, m; positions on it are tangents of half the angle from `ahead`, the direction to the evader."""

    centre: Plane
    ahead: Plane
    radius: Real


Piece: TypeAlias = Line | Arc


class Point(NamedTuple):
    """A point of the shape from the target's position, m, and the margin there, s."""

    at: Plane
    margin: Real


class Judged(NamedTuple):
    """The margin at a point, s, the gradients of the evader's and the pursuer's time, s/m, and their ways, m."""

    margin: Real
    arrives: Plane
    guards: Plane
    run: Real
    flight: Real


class Pose(NamedTuple):
    """A point of a piece, the slope of the margin along the piece, s/m, and the rate of the slope by the position.

    The rate is None in games with more than the paper's.
    """

    point: Point
    slope: Real
    bend: Real | None


class Bracket(NamedTuple):
    """An interval of a piece, and the slopes at its ends, of which the first is negative and the second positive."""

    low: Real
    high: Real
    falling: Real
    rising: Real
    trial: Real
    """The first position to try."""


def rivals_of(xp: Library, game: Game, state: Geometry, to_target: Plane) -> Rivals:
    """Return both players.

    Args:
        xp: array library.
        game: speeds, capture radius, stand-off, age, wind and drift.
        state: the state.
        to_target: vector from the evader to the target's position, m.
    """
    radius, capture, z = game.pursuer.planar(
        xp, game.standoff.radius_m, game.capture_radius_m, state.z
    )
    v = game.evader_speed_m_s
    hand = least_square_in_hand(game)
    evader = (-to_target[0], -to_target[1])
    return Rivals(
        u=game.pursuer.horizontal_m_s,
        v=v,
        capture=capture,
        radius=radius,
        z=z,
        lag=v * game.information_age_s,
        reach=v / xp.sqrt(hand),
        evader=evader,
        pursuer=plus2(evader, -1.0, state.to_evader),
        wind=None if game.calm else game.wind_m_s,
        drift=None if game.target_velocity_m_s == STILL else game.target_velocity_m_s,
    )


def most_in_danger(xp: Library, extent: Extent, rivals: Rivals) -> Plane:
    """Return the point of a shape with the least margin, from the target's position, m.

    Args:
        xp: array library.
        extent: the shape, which is no point; the evader is outside.
        rivals: both players.
    """
    corners = extent.corners_m
    sides = _sides(corners)
    if extent.radius_m > 0.0:
        best = _around(xp, extent.radius_m, corners[0], rivals)
        for corner in corners[1:]:
            best = _lesser(xp, best, _around(xp, extent.radius_m, corner, rivals))
        for begin, end in sides:
            line = _line(begin, end, extent.radius_m)
            last = plus2(line.begin, line.length, line.along)
            ends = (_judged(xp, rivals, line.begin), _judged(xp, rivals, last))
            best = _along(xp, line, ends, rivals, best)
        return best.at
    judged = [_judged(xp, rivals, corner) for corner in corners]
    best = _corner(corners[0], judged[0])
    for corner, corner_margin in zip(corners[1:], judged[1:], strict=True):
        best = _lesser(xp, best, _corner(corner, corner_margin))
    # A segment has one line.
    for index, (begin, end) in enumerate(sides if len(corners) > 2 else sides[:1]):
        ends = (judged[index], judged[(index + 1) % len(corners)])
        line = _line(begin, end, 0.0, is_open=len(corners) == 2)
        best = _along(xp, line, ends, rivals, best)
    return best.at


def _sides(corners: tuple[tuple[float, float], ...]) -> list[tuple[Plane, Plane]]:
    """Return begin and end of each side, counterclockwise; a segment has two."""
    if len(corners) == 1:
        return []
    return list(zip(corners, corners[1:] + corners[:1], strict=True))


def _line(begin: Plane, end: Plane, outward: float, *, is_open: bool = False) -> Line:
    """Return a side, moved outward."""
    side = plus2(end, -1.0, begin)
    length = math.hypot(*side)
    along = (side[0] / length, side[1] / length)
    return Line(plus2(begin, outward, (along[1], -along[0])), along, length, is_open)


def _lesser(xp: Library, best: Point, rival: Point) -> Point:
    """Return the point with the lesser margin."""
    closer = rival.margin < best.margin
    return Point(
        xp.select2(closer, rival.at, best.at), xp.select(closer, rival.margin, best.margin)
    )


def _judged(xp: Library, rivals: Rivals, at: Plane) -> Judged:
    """Return the margin at a point, from the target's position, and its gradient."""
    run = plus2(at, -1.0, rivals.evader)
    drift = rivals.drift
    if drift is None:
        length = xp.norm2(run)
        arrival = (length - rivals.lag) / rivals.v
        later = times2(1.0 / (rivals.v * xp.select(length > 0.0, length, 1.0)), run)
        guard, guarded, distance = _guard(xp, rivals, plus2(at, -1.0, rivals.pursuer))
        return Judged(arrival - guard, later, guarded, length, distance)
    arrival = _arrival(xp, rivals, run, drift)
    run = plus2(run, arrival, drift)
    length = xp.norm2(run)
    rate = rivals.v * length - dot2(run, drift)
    later = times2(1.0 / xp.select(rate > 0.0, rate, 1.0), run)
    met = plus2(plus2(at, -1.0, rivals.pursuer), arrival, drift)
    guard, guarded, distance = _guard(xp, rivals, met)
    guarded = plus2(guarded, dot2(guarded, drift), later)
    return Judged(arrival - guard, later, guarded, length, distance)


def _arrival(xp: Library, rivals: Rivals, run: Plane, drift: Plane) -> Real:
    """Return the time until the evader can be at a point that drifts, s."""
    pace = xp.sqrt(0.0 * run[0] + dot2(drift, drift))
    hand = (rivals.v - pace) * (rivals.v + pace)
    half = dot2(run, drift) - rivals.v * rivals.lag
    return ball_time(xp, hand, half, dot2(run, run) - rivals.lag * rivals.lag)[0]


def _guard(xp: Library, rivals: Rivals, away: Plane) -> tuple[Real, Plane, Real]:
    """Return the time until the pursuer could capture an evader at a place, s, its gradient, and the way, m.

    The time is zero if it can now.
    """
    u = rivals.u
    wind = rivals.wind
    if wind is None:
        distance, towards = _to_disc(xp, rivals, away)
        time = (distance - rivals.capture) / u
        guarded = times2(1.0 / u, towards)
        if is_zero(rivals.capture) and is_zero(rivals.radius):
            return time, guarded, distance
    else:
        time = _guard_in_wind(xp, rivals, away, wind)
        distance, towards = _to_disc(xp, rivals, plus2(away, -time, wind))
        guarded = times2(1.0 / (u + dot2(towards, wind)), towards)
    later = time > 0.0
    guarded = xp.select2(later, guarded, times2(0.0, guarded))
    return xp.select(later, time, 0.0 * time), guarded, distance


def _guard_in_wind(xp: Library, rivals: Rivals, away: Plane, wind: Plane) -> Real:
    """Return the time by Newton's method on a convex function, from below; exact if there is no disc or no height."""
    u = rivals.u
    time = 0.0 * away[0]
    for _ in range(WIND_STEPS):
        distance, towards = _to_disc(xp, rivals, plus2(away, -time, wind))
        missing = distance - u * time - rivals.capture
        time = time + missing / (u + dot2(towards, wind))
        if not xp.differentiates and np.all(abs(missing) <= CLOSE * (distance + u)):
            break
    return time


def _to_disc(xp: Library, rivals: Rivals, away: Plane) -> tuple[Real, Plane]:
    """Return the distance of the pursuer from the stand-off disc around a place, and its gradient by the place."""
    if is_zero(rivals.radius) and type(rivals.z) is float and rivals.z == 0.0:
        distance = xp.norm2(away)
        return distance, times2(1.0 / xp.select(distance > 0.0, distance, 1.0), away)
    if is_zero(rivals.radius):
        distance = xp.sqrt(dot2(away, away) + rivals.z * rivals.z)
        return distance, times2(1.0 / xp.select(distance > 0.0, distance, 1.0), away)
    beside = xp.norm2(away)
    short = xp.maximum(beside - rivals.radius, 0.0)
    distance = xp.sqrt(short * short + rivals.z * rivals.z)
    product = distance * beside
    return distance, times2(short / xp.select(product > 0.0, product, 1.0), away)


def _corner(at: Plane, judged: Judged) -> Point:
    nothing = 0.0 * judged.margin
    return Point((at[0] + nothing, at[1] + nothing), judged.margin)


def _place(piece: Piece, position: Real) -> tuple[Plane, Plane]:
    """Return a point of a piece, and the direction in which it moves there."""
    if isinstance(piece, Line):
        return plus2(piece.begin, position, piece.along), piece.along
    scale = 1.0 / (1.0 + position * position)
    turn = ((1.0 - position * position) * scale, (position + position) * scale)
    outward = in_plane(piece.ahead, turn)
    return plus2(piece.centre, piece.radius, outward), (-outward[1], outward[0])


def _on(xp: Library, piece: Piece, position: Real, rivals: Rivals) -> Pose:
    """Return a point of a piece, and how the margin changes along the piece."""
    at, along = _place(piece, position)
    judged = _judged(xp, rivals, at)
    arrives = dot2(judged.arrives, along)
    guards = dot2(judged.guards, along)
    slope = arrives - guards
    if not rivals.plain:
        return Pose(Point(at, judged.margin), slope, None)
    across = (rivals.v * arrives, rivals.u * guards)
    run = (1.0 - across[0] * across[0]) / (rivals.v * judged.run)
    flight = (1.0 - across[1] * across[1]) / (rivals.u * judged.flight)
    bend = run - flight
    if isinstance(piece, Arc):
        # Towards the centre, by a right angle from the direction of the piece
        inward = (-along[1], along[0])
        gradient = plus2(judged.arrives, -1.0, judged.guards)
        bend = bend + dot2(gradient, inward) / piece.radius
        bend = 2.0 * piece.radius / (1.0 + position * position) * bend
    return Pose(Point(at, judged.margin), slope, bend)


def _along(
    xp: Library, line: Line, ends: tuple[Judged, Judged], rivals: Rivals, best: Point
) -> Point:
    """Return the least of a line's points and the best so far; the shape lies to the left of the line.

    Args:
        xp: array library.
        line: a straight edge.
        ends: its begin and end.
        rivals: both players.
        best: the best so far, which counts the line's ends.
    """
    first, last = (dot2(plus2(end.arrives, -1.0, end.guards), line.along) for end in ends)
    from_begin = plus2(rivals.evader, -1.0, line.begin)
    foot = dot2(from_begin, line.along)
    outside = cross2(from_begin, line.along)
    apart = abs(outside)
    to_pursuer = plus2(rivals.pursuer, -1.0, line.begin)
    passed = dot2(to_pursuer, line.along)
    beside = abs(cross2(line.along, to_pursuer))
    forward = passed >= foot
    window = rivals.reach * apart
    bracket = Bracket(
        low=0.0 * foot,
        high=0.0 * foot + line.length,
        falling=first,
        rising=last,
        trial=xp.select(forward, foot - TRIED * window, foot + TRIED * window),
    )
    # From the inside of an edge, others are closer. A segment is seen from both sides.
    visible = (outside > 0.0) | line.is_open
    enclosed = visible & (first < 0.0) & (last > 0.0)
    best = _lesser(xp, best, _bracketed(xp, line, bracket, rivals, (enclosed, best)))
    near = visible & _is_near(xp, rivals, apart, beside)
    places = (foot, passed, apart, beside)
    return _lesser(
        xp, best, in_rows(near, best, partial(_both_sides, xp), line, places, rivals, best)
    )


def _both_sides(
    xp: Library, line: Line, places: tuple[Real, Real, Real, Real], rivals: Rivals, best: Point
) -> Point:
    """Return the least margin on both sides of a pursuer close to a line, or the best so far.

    Args:
        xp: array library.
        line: the line.
        places: the positions of the evader's and of the pursuer's foot, and the distances of both, m.
        rivals: both players.
        best: the best so far.
    """
    foot, passed, apart, beside = places
    forward = passed >= foot
    if not rivals.plain:
        window = 2.0 * rivals.reach * apart + rivals.radius
        low = _held(xp, xp.select(forward, foot, passed) - window, line.length)
        high = _held(xp, xp.select(forward, passed, foot) + window, line.length)
        tried = [low + (number / TRIES) * (high - low) for number in range(TRIES + 1)]
        every = (0.0 * foot, *tried, 0.0 * foot + line.length)
        return _scanned(xp, line, every, rivals, best)
    sign = xp.select(forward, 0.0 * foot + 1.0, 0.0 * foot - 1.0)
    step = sign * _behind(xp, rivals, abs(passed - foot), apart, beside)
    turning = _held(xp, passed + step, line.length)
    rate = sign * _on(xp, line, turning, rivals).slope

    def between(
        line: Line, foot: Real, turning: Real, sign: Real, rivals: Rivals, best: Point
    ) -> Point:
        end = xp.select(sign > 0.0, 0.0 * foot + line.length, 0.0 * foot)
        stops = (line.length - end, _held(xp, foot, line.length), turning, end)
        return _scanned(xp, line, stops, rivals, best)

    return in_rows(rate < 0.0, best, between, line, foot, turning, sign, rivals, best)


def _held(xp: Library, position: Real, length: Real) -> Real:
    """Keep a position on a line."""
    position = xp.select(position > 0.0, position, 0.0 * position)
    return xp.select(position < length, position, 0.0 * position + length)


def _around(xp: Library, radius: float, corner: tuple[float, float], rivals: Rivals) -> Point:
    """Return the point of a disc around a corner with the least margin, for an evader outside the disc."""
    out = plus2(rivals.evader, -1.0, corner)
    distance = xp.norm2(out)
    apart = xp.maximum(distance - radius, 0.0 * distance)
    arc = Arc(corner, xp.unit2(out, distance), radius)
    edge = xp.sqrt(apart / (distance + radius))
    middle = _on(xp, arc, 0.0 * distance, rivals)
    ahead = middle.slope <= 0.0
    # Where the evader sees the edge of the disc, the margin grows outwards at its steepest.
    steepest = 1.0 / rivals.v
    trial = 0.5 * xp.minimum(edge, rivals.reach * apart / radius)
    bracket = Bracket(
        low=xp.select(ahead, 0.0 * edge, -edge),
        high=xp.select(ahead, edge, 0.0 * edge),
        falling=xp.select(ahead, middle.slope, 0.0 * edge - steepest),
        rising=xp.select(ahead, 0.0 * edge + steepest, middle.slope),
        trial=xp.select(ahead, trial, -trial),
    )
    enclosed = apart > 0.0
    best = _lesser(xp, middle.point, _bracketed(xp, arc, bracket, rivals, (enclosed, middle.point)))
    beside = abs(xp.norm2(plus2(rivals.pursuer, -1.0, corner)) - radius)
    near = enclosed & _is_near(xp, rivals, apart, beside)

    def seen(arc: Arc, edge: Real, rivals: Rivals, best: Point) -> Point:
        return _scanned(xp, arc, tuple(share * edge for share in SEEN), rivals, best)

    return _lesser(xp, best, in_rows(near, best, seen, arc, edge, rivals, best))


def _is_near(xp: Library, rivals: Rivals, apart: Real, beside: Real) -> Truth:
    """Return whether the pursuer is so close to a line that the margin can have a second minimum behind it.

    If the target moves, other places are possible too.

    Args:
        xp: array library.
        rivals: both players.
        apart: the evader's distance from the line, m.
        beside: the pursuer's horizontal distance from the line, m.
    """
    if rivals.drift is not None:
        return apart >= 0.0
    short = xp.maximum(beside - rivals.radius, 0.0 * beside)
    slower = rivals.u if rivals.wind is None else rivals.u - pair_length(rivals.wind)
    height = short * short + rivals.z * rivals.z
    return slower * slower * height < rivals.v * rivals.v * (apart * apart)


def _behind(xp: Library, rivals: Rivals, between: Real, apart: Real, beside: Real) -> Real:
    """Return how far behind the pursuer's foot the margin falls fastest, m.

    With the distances a and b of evader and pursuer from the line and D of their feet, the slope of the margin of the
    paper's game is least where a²/(v A³) = b²/(u B³), A² = (x + D)² + a², B² = x² + b². The cube root is replaced by a
    power of 21/64.

    Args:
        xp: array library.
        rivals: both players.
        between: distance of the feet, m.
        apart: the evader's distance from the line, m.
        beside: the pursuer's horizontal distance from the line, m.
    """
    square = apart * apart
    height = beside * beside + rivals.z * rivals.z + LEAST * square
    ratio = rivals.u * square / (rivals.v * xp.select(height > 0.0, height, 1.0))
    fourth = xp.sqrt(xp.sqrt(ratio))
    sixteenth = xp.sqrt(xp.sqrt(fourth))
    root = fourth * sixteenth * xp.sqrt(xp.sqrt(sixteenth))
    excess = root * root - 1.0
    turns = excess > 0.0
    excess = xp.select(turns, excess, 1.0)
    half = xp.maximum(
        between * between + excess * (between * between + square - root * root * height),
        0.0 * between,
    )
    return xp.select(turns, (between + xp.sqrt(half)) / excess, 0.0 * half)


def _scanned(
    xp: Library, piece: Piece, positions: tuple[Real, ...], rivals: Rivals, best: Point
) -> Point:
    """Return the least margin between consecutive positions, in ascending or descending order, or the best so far."""
    before = positions[0]
    pose = _on(xp, piece, before, rivals)
    for position in positions[1:]:
        after = _on(xp, piece, position, rivals)
        best = _lesser(xp, best, after.point)
        ascends = position > before
        bracket = Bracket(
            low=xp.select(ascends, before, position),
            high=xp.select(ascends, position, before),
            falling=xp.select(ascends, pose.slope, after.slope),
            rising=xp.select(ascends, after.slope, pose.slope),
            trial=0.5 * (before + position),
        )
        enclosed = (bracket.falling < 0.0) & (bracket.rising > 0.0)
        best = _lesser(xp, best, _bracketed(xp, piece, bracket, rivals, (enclosed, best)))
        before = position
        pose = after
    return best


def _bracketed(
    xp: Library, piece: Piece, bracket: Bracket, rivals: Rivals, otherwise: tuple[Truth, Point]
) -> Point:
    """Return the point of a bracket whose slope is zero.

    Args:
        xp: array library.
        piece: the piece.
        bracket: the bracket.
        rivals: both players.
        otherwise: which brackets enclose such a point, and what to return in the other rows.
    """
    enclosed, best = otherwise
    level = in_rows(enclosed, best, partial(_level, xp), piece, bracket, rivals)
    # Libraries that trace compute all rows; a bracket that encloses nothing may lead off the piece.
    return xp.select_all(enclosed, level, best) if xp.differentiates else level


def _level(xp: Library, piece: Piece, bracket: Bracket, rivals: Rivals) -> Point:
    """Find the zero of the slope in a bracket, from its trial if that is inside."""
    new = _secant(xp, *bracket[:4])
    inside = (bracket.trial > bracket.low) & (bracket.trial < bracket.high)
    bracket = bracket._replace(trial=xp.select(inside, bracket.trial, new))
    steps = TRACED_STEPS if xp.differentiates else STEPS
    return _stepped(xp, piece, bracket, rivals, (0.0 * new, steps))


def _stepped(
    xp: Library, piece: Piece, bracket: Bracket, rivals: Rivals, progress: tuple[Real, int]
) -> Point:
    """Take some steps, and more in rows that need them: Newton's, or secant steps where an end that stays counts half.

    Args:
        xp: array library.
        piece: the piece.
        bracket: the bracket, with the position to try.
        rivals: both players.
        progress: the sign of the last slope (0 at first), and how many steps are allowed.
    """
    sign, steps = progress
    low, high, falling, rising, new = bracket
    converged: Truth = False
    for number in range(steps if xp.differentiates else min(steps, TOGETHER)):
        pose = _on(xp, piece, new, rivals)
        slope = pose.slope
        falls = slope < 0.0
        rises = slope > 0.0
        low = xp.select(falls, new, low)
        high = xp.select(rises, new, high)
        middle = 0.5 * (low + high)
        converged = (
            converged | (abs(slope) * rivals.v <= STEEP) | (middle <= low) | (middle >= high)
        )
        if not xp.differentiates and np.all(converged):
            return pose.point
        if pose.bend is None:
            falling = xp.select(
                falls, slope, xp.select(rises & (sign > 0.0), 0.5 * falling, falling)
            )
            rising = xp.select(rises, slope, xp.select(falls & (sign < 0.0), 0.5 * rising, rising))
            sign = xp.select(falls, 0.0 * slope - 1.0, 0.0 * slope + 1.0)
            halved = number % TOGETHER == TOGETHER - 1
            to = middle if halved else _secant(xp, low, high, falling, rising)
        else:
            convex = pose.bend > 0.0
            to = new - slope / xp.select(convex, pose.bend, 1.0)
            to = xp.select(convex & (to > low) & (to < high), to, middle)
        new = xp.select(converged, new, to)
    if xp.differentiates or steps <= TOGETHER:
        return pose.point
    bracket = Bracket(low, high, falling, rising, new)
    return in_rows(
        converged == 0,
        pose.point,
        lambda piece, bracket, rivals, sign: _stepped(
            xp, piece, bracket, rivals, (sign, steps - TOGETHER)
        ),
        piece,
        bracket,
        rivals,
        sign,
    )


def _secant(xp: Library, low: Real, high: Real, falling: Real, rising: Real) -> Real:
    """Return where a straight line through two slopes is zero."""
    rise = rising - falling
    share = -falling / xp.select(rise > 0.0, rise, 1.0)
    return low + xp.select(rise > 0.0, share, 0.5) * (high - low)
