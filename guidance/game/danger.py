"""The point of a target's shape that is most in danger: where the pursuer's margin over the evader is least.

The margin at a point X is the evader's time to X less the pursuer's. It grows along every ray from the evader, so the
least margin is on the edge of the shape. A shape is covered by its straight edges and a disc around each corner.

* **On a straight line** with the evader's foot e and the pursuer's foot p, the margin of the paper's game has one
  minimum on the side of e away from p, within v/√(u² − v²) times the evader's distance from e. If the pursuer is close
  to the line compared with the evader, it can have a second minimum behind p (`_behind`): the evader may run past the
  pursuer. In other games the line is searched in small intervals then.
* **On a circle** the same holds for the part that the evader sees, with angles for lengths.

At the minimum the ways of both players are those of refracted light. The first position that is tried is right for the
angle of the pursuer's way to the point nearest to the evader, or to the centre of Apollonius' circle, where the minimum
is if the margin is zero.

A line is searched only if it can have a smaller margin than the best corner. Both times are convex: the evader's is
above its tangents at the line's ends, and the pursuer's is below the straight line between its values there
(`_may_beat`).

A capture radius changes nothing where the pursuer cannot capture now: it shortens all of the pursuer's ways. Where it
can, only the evader's time counts, and the nearest point of the shape is in most danger; see `tad`.
"""

import math
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np

from guidance.game.arrays import (
    NUMPY,
    AnyRecord,
    Array,
    Library,
    Plane,
    Real,
    Truth,
    along2,
    cross2,
    dot2,
    in_plane,
    mapped,
    pair_length,
    plus2,
    times2,
)
from guidance.game.brackets import (
    NO_SPOT,
    Bracket,
    Pose,
    Spot,
    least_within,
    lesser_spot,
    scanned,
)
from guidance.game.extent import Extent
from guidance.game.game import NO_WIND, Game, least_square_in_hand
from guidance.game.meeting_times import ball_time, catch_in_ball
from guidance.game.pe import Geometry
from guidance.game.records import in_rows, is_zero
from guidance.game.sight import SeenArc, SeenLine

WIND_STEPS = 8
"""Newton steps to the time of reaching a stand-off disc in wind; three are usual."""

CLOSE = 1e-14
"""Share of a distance that counts as reached."""

_TRIES = 20
"""Intervals of a line that are searched in games with more than the paper's, if there may be several minima."""

SEEN = (0.0, 0.05, 0.12, 0.2, 0.3, 0.42, 0.56, 0.72, 0.88, 1.0)
"""Positions that are tried on a circle, over that of its edge as the evader sees it."""

_TRIED = 0.3
"""First position on a line behind the evader's foot in games with more than the paper's, over the farthest."""

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
        """True if it is the paper's game."""
        alone = is_zero(self.capture) and is_zero(self.radius)
        return alone and self.wind is None and self.drift is None


class Line(NamedTuple):
    """A straight edge, with the shape on its left; in arrays along the first axis it is several.

    Attributes:
        begin: from the target's position, m.
        along: its direction.
        length: m.
        is_open: whether the shape is nothing but this line, so that both its sides are seen.
    """

    begin: Plane
    along: Plane
    length: Real
    is_open: Truth


class Arc(NamedTuple):
    """A circle around a corner, m; in arrays along the first axis it is several."""

    centre: Plane
    radius: Real


class ShapePoint(NamedTuple):
    """A point of the shape from the target's position, m, and the margin there, s."""

    at: Plane
    margin: Real


class Judged(NamedTuple):
    """The margin at a point, s, and its gradient, s/m; the evader's time to it, s, and the gradient of that."""

    margin: Real
    gradient: Plane
    arrival: Real
    later: Plane


class FollowedLine(NamedTuple):
    """A straight edge in any game; positions are metres from its begin."""

    line: Line
    rivals: Rivals

    @property
    def curved(self) -> bool:
        """True if a pose has the derivatives of the slope."""
        return False

    @property
    def v(self) -> Real:
        """Speed of the evader, m/s."""
        return self.rivals.v

    def at(self, position: Real) -> Plane:
        """Return a point of the edge, from the target's position, m."""
        return plus2(self.line.begin, position, self.line.along)

    def pose(self, xp: Library, position: Real) -> Pose:
        """Return the margin at a position and its slope."""
        judged = _margin_at(xp, self.rivals, self.at(position))
        return Pose(judged.margin, dot2(judged.gradient, self.line.along))


class FollowedArc(NamedTuple):
    """A circle in any game; positions are tangents of half the angle from `ahead`, the direction to the evader."""

    arc: Arc
    ahead: Plane
    rivals: Rivals

    @property
    def curved(self) -> bool:
        """True if a pose has the derivatives of the slope."""
        return False

    @property
    def v(self) -> Real:
        """Speed of the evader, m/s."""
        return self.rivals.v

    def outward(self, position: Real) -> Plane:
        """Return the direction from the centre."""
        scale = 1.0 / (1.0 + position * position)
        turn = ((1.0 - position * position) * scale, (position + position) * scale)
        return in_plane(self.ahead, turn)

    def at(self, position: Real) -> Plane:
        """Return a point of the edge, from the target's position, m."""
        return plus2(self.arc.centre, self.arc.radius, self.outward(position))

    def pose(self, xp: Library, position: Real) -> Pose:
        """Return the margin at a position and its slope."""
        outward = self.outward(position)
        judged = _margin_at(xp, self.rivals, plus2(self.arc.centre, self.arc.radius, outward))
        return Pose(judged.margin, cross2(outward, judged.gradient))


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
    lag = v * game.information_age_s
    wind = None if game.calm else game.wind_m_s
    drift = None if game.target_velocity_m_s == NO_WIND else game.target_velocity_m_s
    if wind is None and drift is None and is_zero(radius):
        # The margin at every point, where no capture is possible now, changes by the same
        capture = 0.0
        lag = 0.0
    hand = least_square_in_hand(game)
    evader = (-to_target[0], -to_target[1])
    return Rivals(
        u=game.pursuer.horizontal_m_s,
        v=v,
        capture=capture,
        radius=radius,
        z=z,
        lag=lag,
        reach=v / xp.sqrt(hand),
        evader=evader,
        pursuer=plus2(evader, -1.0, state.to_evader),
        wind=wind,
        drift=drift,
    )


def most_in_danger(xp: Library, extent: Extent, rivals: Rivals) -> Plane:
    """Return the point of a shape with the least margin, from the target's position, m.

    Args:
        xp: array library.
        extent: the shape, which is no point; the evader is outside.
        rivals: both players.
    """
    points = []
    lines = _several(xp, _lines(extent), rivals)
    if extent.radius_m > 0.0:
        circles = tuple(Arc(corner, extent.radius_m) for corner in extent.corners_m)
        for arc in _several(xp, circles, rivals):
            points.extend(_each(xp, extent, _around(xp, arc, rivals)))
        ends = [
            (
                _margin_at(xp, rivals, line.begin),
                _margin_at(xp, rivals, plus2(line.begin, line.length, line.along)),
            )
            for line in lines
        ]
    else:
        corners = _several(xp, extent.corners_m, rivals)
        judged = [_margin_at(xp, rivals, corner) for corner in corners]
        if xp is NUMPY and len(extent.corners_m) > 2:
            points.append(_least_corner(corners[0], judged[0].margin))
        else:
            for corner, here in zip(corners, judged, strict=True):
                at = corner
                if xp.differentiates:
                    # A traced library needs the corner in every row
                    nothing = 0.0 * here.margin
                    at = (corner[0] + nothing, corner[1] + nothing)
                points.append(ShapePoint(at, here.margin))
        # A line ends at the corner that follows its begin; with NumPy all corners are along the first axis.
        following = judged[1:] + judged[:1]
        if len(judged) == 1:
            following = [mapped(lambda part: np.concatenate((part[1:], part[:1])), judged[0])]
        ends = list(zip(judged, following, strict=True))
    best = points[0]
    for point in points[1:]:
        best = _lesser(xp, best, point)
    for line, both in zip(lines, ends, strict=False):
        for point in _each(xp, extent, _least_in_line(xp, line, both, rivals, best.margin)):
            best = _lesser(xp, best, point)
    return best.at


@lru_cache(maxsize=64)
def _lines(extent: Extent) -> tuple[Line, ...]:
    """Return the straight edges, counterclockwise; a segment has one, which is seen from both sides."""
    corners = extent.corners_m
    is_open = len(corners) == 2 and extent.radius_m == 0.0
    lines: list[Line] = []
    if len(corners) == 1:
        return ()
    for begin, end in zip(corners, corners[1:] + corners[:1], strict=True):
        side = plus2(end, -1.0, begin)
        length = math.hypot(*side)
        along = (side[0] / length, side[1] / length)
        outward = (along[1], -along[0])
        lines.append(Line(plus2(begin, extent.radius_m, outward), along, length, is_open))
    return tuple(lines[:1] if is_open else lines)


def _several(xp: Library, pieces: tuple[AnyRecord, ...], rivals: Rivals) -> list[AnyRecord]:
    """Return pieces as records to go through; with NumPy as one record of arrays, along the first axis."""
    if xp is not NUMPY or len(pieces) < 3:
        return list(pieces)
    return [_as_one(pieces, np.ndim(rivals.evader[0]))]


@lru_cache(maxsize=64)
def _as_one(pieces: tuple[AnyRecord, ...], dimensions: int) -> AnyRecord:
    def array(*numbers: Real) -> Real:
        return np.array(numbers).reshape(-1, *(1,) * dimensions)

    return mapped(array, *pieces)


def _each(xp: Library, extent: Extent, point: ShapePoint) -> list[ShapePoint]:
    """Return the points of pieces that were one record, see `_several`."""
    count = len(extent.corners_m)
    if xp is not NUMPY or count < 3:
        return [point]
    if point.margin is NO_SPOT.margin:
        return []
    x: Array = point.at[0]
    y: Array = point.at[1]
    margin: Array = point.margin
    return [ShapePoint((x[number], y[number]), margin[number]) for number in range(count)]


def _lesser(xp: Library, best: ShapePoint, rival: ShapePoint) -> ShapePoint:
    """Return the point with the lesser margin."""
    closer = rival.margin < best.margin
    return ShapePoint(
        xp.select2(closer, rival.at, best.at), xp.select(closer, rival.margin, best.margin)
    )


def _margin_at(xp: Library, rivals: Rivals, at: Plane) -> Judged:
    """Return the margin at a point, from the target's position, and its gradient."""
    run = plus2(at, -1.0, rivals.evader)
    drift = rivals.drift
    if drift is None:
        length = xp.norm2(run)
        arrival = (length if is_zero(rivals.lag) else length - rivals.lag) / rivals.v
        later = times2(1.0 / (rivals.v * xp.select(length > 0.0, length, 1.0)), run)
        guard, guarded = _guard(xp, rivals, plus2(at, -1.0, rivals.pursuer))
        gradient = (later[0] - guarded[0], later[1] - guarded[1])
        return Judged(arrival - guard, gradient, arrival, later)
    # When the evader can be at the point that drifts.
    pace = xp.sqrt(0.0 * run[0] + dot2(drift, drift))
    hand = (rivals.v - pace) * (rivals.v + pace)
    half = dot2(run, drift) - rivals.v * rivals.lag
    arrival, _ = ball_time(xp, hand, half, dot2(run, run) - rivals.lag * rivals.lag)
    run = plus2(run, arrival, drift)
    length = xp.norm2(run)
    rate = rivals.v * length - dot2(run, drift)
    moves = (rate > 0.0) & (arrival > 0.0)
    later = times2(xp.select(moves, 1.0 / xp.select(moves, rate, 1.0), 0.0 * rate), run)
    met = plus2(plus2(at, -1.0, rivals.pursuer), arrival, drift)
    guard, guarded = _guard(xp, rivals, met)
    guarded = plus2(guarded, dot2(guarded, drift), later)
    return Judged(arrival - guard, plus2(later, -1.0, guarded), arrival, later)


def _guard(xp: Library, rivals: Rivals, away: Plane) -> tuple[Real, Plane]:
    """Return the time until the pursuer could capture an evader at a place, s, and its gradient.

    The time is zero if it can now.
    """
    u = rivals.u
    wind = rivals.wind
    if wind is None:
        distance, towards = _to_disc(xp, rivals, away)
        guarded = times2(1.0 / u, towards)
        if is_zero(rivals.capture) and is_zero(rivals.radius):
            return distance / u, guarded
        time = (distance - rivals.capture) / u
    else:
        if is_zero(rivals.radius):
            time = catch_in_ball(xp, u, rivals.capture, away, times2(-1.0, wind), rivals.z)
        else:
            # By Newton's method on a convex function, from below.
            time = 0.0 * away[0]
            for _ in range(WIND_STEPS):
                distance, towards = _to_disc(xp, rivals, plus2(away, -time, wind))
                missing = distance - u * time - rivals.capture
                time = time + missing / (u + dot2(towards, wind))
                if not xp.any(abs(missing) > CLOSE * (distance + u)):
                    break
        distance, towards = _to_disc(xp, rivals, plus2(away, -time, wind))
        guarded = times2(1.0 / (u + dot2(towards, wind)), towards)
    later = time > 0.0
    guarded = xp.select2(later, guarded, times2(0.0, guarded))
    return xp.select(later, time, 0.0 * time), guarded


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


def _least_corner(corners: Plane, margins: Array) -> ShapePoint:
    """Return the corner with the least margin of corners that are along the first axis."""
    least = margins[0]
    numbers = np.zeros(least.shape, dtype=np.intp)
    for number in range(1, len(margins)):
        numbers[margins[number] < least] = number
        least = np.minimum(least, margins[number])
    x: Array = corners[0]
    y: Array = corners[1]
    return ShapePoint((x.take(numbers), y.take(numbers)), least)


def _least_in_line(
    xp: Library, line: Line, ends: tuple[Judged, Judged], rivals: Rivals, best: Real
) -> ShapePoint:
    """Return the least margin within a line, with a margin of infinity where it is at an end or not below the best.

    Args:
        xp: array library.
        line: a straight edge.
        ends: its begin and end.
        rivals: both players.
        best: the least margin of the points that are known, s.
    """
    slopes = (dot2(ends[0].gradient, line.along), dot2(ends[1].gradient, line.along))
    outside = cross2(plus2(rivals.evader, -1.0, line.begin), line.along)
    beside = cross2(line.along, plus2(rivals.pursuer, -1.0, line.begin))
    # From the inside of an edge, others are closer. A segment is seen from both sides.
    visible = (outside > 0.0) | line.is_open
    if xp is not NUMPY or not rivals.plain:
        visible = visible & _may_beat(xp, line, ends, rivals, best)
    enclosed = visible & (slopes[0] < 0.0) & (slopes[1] > 0.0)
    if rivals.drift is None or xp.differentiates:
        near = visible & _is_near(xp, rivals, abs(outside), abs(beside))
    else:
        near = visible & (_has_one_minimum(xp, line, ends, rivals, rivals.drift) == 0)
    nowhere = ShapePoint((0.0, 0.0), NO_SPOT.margin)
    if not xp.any(enclosed | near):
        return nowhere
    if not rivals.plain:
        return _followed(xp, line, slopes, rivals, (enclosed, near))
    point = in_rows(enclosed | near, nowhere, partial(_seen, xp), line, slopes, near, rivals)
    return xp.select_all(enclosed | near, point, nowhere) if xp.differentiates else point


def _may_beat(
    xp: Library, line: Line, ends: tuple[Judged, Judged], rivals: Rivals, best: Real
) -> Truth:
    """Return whether the margin may be less than the best within a line; its ends are known.

    The evader's time is above the tangents at both ends, and least where they cross. The pursuer's time is below the
    straight line between its times at both ends. If the target drifts, the evader meets it sooner than on the straight
    line between its times, so elsewhere: the pursuer loses at most the time for that way.
    """
    first, last = ends
    length = line.length
    slope = dot2(first.later, line.along)
    last_slope = dot2(last.later, line.along)
    rise = last.arrival - first.arrival
    bends = last_slope - slope
    crosses = bends > 0.0
    share = (last_slope - rise / length) / xp.select(crosses, bends, 1.0)
    share = xp.select(crosses, share, 0.5)
    soonest = first.arrival + share * (slope * length)
    between = first.arrival + share * rise
    margin = first.margin + share * (last.margin - first.margin)
    least = margin - (between - soonest)
    if rivals.drift is not None:
        slower = rivals.u if rivals.wind is None else rivals.u - pair_length(rivals.wind)
        least = least - (pair_length(rivals.drift) / slower) * (between - soonest)
    return least < best


def _has_one_minimum(
    xp: Library, line: Line, ends: tuple[Judged, Judged], rivals: Rivals, drift: Plane
) -> Truth:
    """Return whether the margin within a line of a drifting target surely has one minimum at most.

    With the evader's run A and the pursuer's distance B, a position where the slope is zero is a minimum if
    B (u − ‖w‖) > A (v + ‖w‖), with the drift w. If that holds everywhere, there is no maximum between two minima. Both
    times have to be positive everywhere.
    """
    pace = pair_length(drift)
    v = rivals.v
    if rivals.wind is not None:
        return line.length < 0.0
    first, last = ends
    arrivals = first.arrival + last.arrival
    longest = v * xp.maximum(first.arrival, last.arrival) + rivals.lag
    guards = arrivals - (first.margin + last.margin)
    # The place where the evader meets the target moves at most this far along the line
    moved = line.length * (v / (v - pace))
    closest = 0.5 * (rivals.u * guards - moved)
    away = (closest > 0.0) & (is_zero(rivals.lag) | (arrivals * (v - pace) > line.length))
    return away & ((closest + rivals.capture) * (rivals.u - pace) > longest * (v + pace))


def _seen(
    xp: Library, line: Line, slopes: tuple[Real, Real], near: Truth, rivals: Rivals
) -> ShapePoint:
    """Return the least margin within a line in the paper's game.

    Args:
        xp: array library.
        line: the line.
        slopes: of the margin at its begin and end, s/m.
        near: whether there may be a second minimum behind the pursuer.
        rivals: both players.
    """
    from_begin = plus2(rivals.evader, -1.0, line.begin)
    to_pursuer = plus2(rivals.pursuer, -1.0, line.begin)
    foot = dot2(from_begin, line.along)
    ahead = dot2(to_pursuer, line.along) - foot
    apart = cross2(from_begin, line.along)
    beside = cross2(line.along, to_pursuer)
    forward = ahead >= 0.0
    sign = xp.select(forward, 0.0 * foot + 1.0, 0.0 * foot - 1.0)
    course = SeenLine(
        u=rivals.u,
        v=rivals.v,
        apart_square=apart * apart,
        between=abs(ahead),
        height_square=beside * beside + rivals.z * rivals.z,
    )
    hand = (rivals.u - rivals.v) * (rivals.u + rivals.v)
    bracket = Bracket(
        low=xp.select(forward, -foot, foot - line.length),
        high=xp.select(forward, line.length - foot, foot),
        falling=xp.select(forward, slopes[0], -slopes[1]),
        rising=xp.select(forward, slopes[1], -slopes[0]),
        trial=0.0 * foot,
    )
    # From the point nearest to the centre of Apollonius' circle, which is right where the margin is zero
    centre = (-rivals.v * rivals.v / hand) * course.between
    centre = xp.maximum(xp.minimum(centre, bracket.high), bracket.low)
    bracket = bracket._replace(trial=course.refracted(xp, centre))
    enclosed = (bracket.falling < 0.0) & (bracket.rising > 0.0)
    spot = least_within(xp, course, bracket, enclosed)
    # Behind the pursuer's foot the slope is at least sin α/v − 1/u, and sin α grows.
    near = near & (
        hand * (course.between * course.between) < (rivals.v * rivals.v) * course.apart_square
    )
    spot = in_rows(near, spot, partial(_both_sides, xp), course, bracket, spot)
    return ShapePoint(plus2(line.begin, foot + sign * spot.position, line.along), spot.margin)


def _both_sides(xp: Library, course: SeenLine, bracket: Bracket, spot: Spot) -> Spot:
    """Return the least margin on both sides of a pursuer close to a line.

    Args:
        xp: array library.
        course: the line.
        bracket: the whole line.
        spot: a minimum on it.
    """
    turning = course.between + _behind(xp, course)
    turning = xp.maximum(xp.minimum(turning, bracket.high), bracket.low)
    slope = course.pose(xp, turning).slope

    def both(course: SeenLine, bracket: Bracket, turning: Real, slope: Real, spot: Spot) -> Spot:
        behind = bracket._replace(low=turning, falling=slope, trial=0.5 * (turning + bracket.high))
        passed = least_within(xp, course, behind, behind.rising > 0.0)
        # At the evader's foot the slope is positive
        nothing = 0.0 * turning
        before = bracket._replace(high=nothing, rising=nothing + 1.0 / course.u)
        ahead = (bracket.low < 0.0) & (bracket.high > 0.0) & (bracket.falling < 0.0)
        missed = ahead & (course.between > 0.0) & (spot.position >= 0.0)
        other = least_within(xp, course, before, missed)
        return lesser_spot(xp, lesser_spot(xp, spot, passed), other)

    return in_rows(slope < 0.0, spot, both, course, bracket, turning, slope, spot)


def _behind(xp: Library, course: SeenLine) -> Real:
    """Return how far behind the pursuer's foot the margin falls fastest, m.

    With the distances a and b of evader and pursuer from the line and D of their feet, the slope of the margin of the
    paper's game is least where a²/(v A³) = b²/(u B³), A² = (x + D)² + a², B² = x² + b². The cube root is replaced by a
    power of 21/64.
    """
    between = course.between
    square = course.apart_square
    height = course.height_square + LEAST * square
    ratio = course.u * square / (course.v * xp.select(height > 0.0, height, 1.0))
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


def _followed(
    xp: Library,
    line: Line,
    slopes: tuple[Real, Real],
    rivals: Rivals,
    judged: tuple[Truth, Truth],
) -> ShapePoint:
    """Return the least margin within a line in a game with more than the paper's.

    Args:
        xp: array library.
        line: the line.
        slopes: of the margin at its begin and end, s/m.
        rivals: both players.
        judged: whether the slopes enclose a minimum, and whether there may be more than one.
    """
    enclosed, near = judged
    from_begin = plus2(rivals.evader, -1.0, line.begin)
    foot = dot2(from_begin, line.along)
    window = rivals.reach * abs(cross2(from_begin, line.along))
    passed = dot2(plus2(rivals.pursuer, -1.0, line.begin), line.along)
    forward = passed >= foot
    bracket = Bracket(
        low=0.0 * foot,
        high=0.0 * foot + line.length,
        falling=slopes[0],
        rising=slopes[1],
        trial=xp.select(forward, foot - _TRIED * window, foot + _TRIED * window),
    )
    course = FollowedLine(line, rivals)
    spot = least_within(xp, course, bracket, enclosed)

    def searched(course: FollowedLine, foot: Real, passed: Real, window: Real) -> Spot:
        low = xp.select(passed >= foot, foot, passed) - (2.0 * window + course.rivals.radius)
        high = xp.select(passed >= foot, passed, foot) + (2.0 * window + course.rivals.radius)
        low = _held(xp, low, course.line.length)
        high = _held(xp, high, course.line.length)
        tried = [low + (number / _TRIES) * (high - low) for number in range(_TRIES + 1)]
        ends = (0.0 * foot, 0.0 * foot + course.line.length)
        return scanned(xp, course, (ends[0], *tried, ends[1]))

    other = in_rows(near, NO_SPOT, searched, course, foot, passed, window)
    if xp.differentiates:
        other = xp.select_all(near, other, NO_SPOT)
    spot = lesser_spot(xp, spot, other)
    return ShapePoint(course.at(spot.position), spot.margin)


def _held(xp: Library, position: Real, length: Real) -> Real:
    """Keep a position on a line."""
    position = xp.select(position > 0.0, position, 0.0 * position)
    return xp.select(position < length, position, 0.0 * position + length)


def _around(xp: Library, arc: Arc, rivals: Rivals) -> ShapePoint:
    """Return the point of a disc around a corner with the least margin, for an evader outside the disc."""
    out = plus2(rivals.evader, -1.0, arc.centre)
    distance = xp.norm2(out)
    apart = xp.maximum(distance - arc.radius, 0.0 * distance)
    ahead = xp.unit2(out, distance)
    edge = xp.sqrt(apart / (distance + arc.radius))
    to_pursuer = plus2(rivals.pursuer, -1.0, arc.centre)
    near = (apart > 0.0) & _is_near(xp, rivals, apart, abs(xp.norm2(to_pursuer) - arc.radius))
    if not rivals.plain:
        return _followed_around(xp, FollowedArc(arc, ahead, rivals), apart, edge, near)
    to_pursuer = along2(ahead, to_pursuer)
    course = SeenArc(
        u=rivals.u,
        v=rivals.v,
        radius=arc.radius,
        apart=apart,
        pursuer=(to_pursuer[0], abs(to_pursuer[1])),
        height_square=rivals.z * rivals.z + 0.0 * apart,
    )
    bracket = Bracket(
        low=-edge,
        high=0.0 * edge,
        # The margin grows outwards at its steepest at the edge of the disc as the evader sees it.
        falling=0.0 * edge - 1.0 / rivals.v,
        rising=0.0 * edge,
        trial=course.refracted(xp),
    )
    spot = least_within(xp, course, bracket, apart > 0.0)
    near = near & (_surely_convex(xp, rivals, spot.margin) == 0) & _may_run_past(xp, course)

    def passed(course: SeenArc, edge: Real, spot: Spot) -> Spot:
        return lesser_spot(xp, spot, scanned(xp, course, tuple(share * edge for share in SEEN)))

    spot = in_rows(near, spot, passed, course, edge, spot)
    position = xp.select(to_pursuer[1] < 0.0, -spot.position, spot.position)
    return ShapePoint(FollowedArc(arc, ahead, rivals).at(position), spot.margin)


def _surely_convex(xp: Library, rivals: Rivals, margin: Real) -> Truth:
    """Return whether the points with at most some margin are surely convex in the paper's game.

    They are a section of a Cartesian oval of revolution, |XE|/v − |XP|/u ≤ margin, which has a dent in front of the
    pursuer unless u v margin ≤ (u − v) |PE|.
    """
    to_evader = plus2(rivals.evader, -1.0, rivals.pursuer)
    far = xp.sqrt(dot2(to_evader, to_evader) + rivals.z * rivals.z)
    return rivals.u * rivals.v * margin <= (rivals.u - rivals.v) * far


def _may_run_past(xp: Library, course: SeenArc) -> Truth:
    """Return whether the margin may have a second minimum on a circle, behind the pursuer.

    Behind the pursuer's foot its slope is at least sin α/v − 1/u, and sin α grows up to the edge that the evader sees.
    So the evader has to see the foot, and sin α is less than v/u there.
    """
    evader = course.radius + course.apart
    far = xp.norm2(course.pursuer)
    ahead = evader * course.pursuer[0]
    aside = (course.u * evader) * course.pursuer[1]
    square = far * (course.radius * course.radius + evader * evader) - 2.0 * course.radius * ahead
    visible = ahead > course.radius * far
    return visible & (aside * aside < (course.v * course.v) * (far * square))


def _followed_around(
    xp: Library, course: FollowedArc, apart: Real, edge: Real, near: Truth
) -> ShapePoint:
    """Return the least margin on a circle in a game with more than the paper's.

    Args:
        xp: array library.
        course: the circle.
        apart: distance of the evader from it, m.
        edge: position of the edge that the evader sees.
        near: whether there may be several minima.
    """
    rivals = course.rivals
    nothing = 0.0 * edge
    middle = course.pose(xp, nothing)
    ahead = middle.slope <= 0.0
    steepest = 1.0 / rivals.v
    trial = 0.5 * xp.minimum(edge, rivals.reach * apart / course.arc.radius)
    bracket = Bracket(
        low=xp.select(ahead, nothing, -edge),
        high=xp.select(ahead, edge, nothing),
        falling=xp.select(ahead, middle.slope, nothing - steepest),
        rising=xp.select(ahead, nothing + steepest, middle.slope),
        trial=xp.select(ahead, trial, -trial),
    )
    spot = least_within(xp, course, bracket, apart > 0.0)
    spot = lesser_spot(xp, Spot(nothing, middle.margin), spot)

    def searched(course: FollowedArc, edge: Real, spot: Spot) -> Spot:
        positions = [-share * edge for share in reversed(SEEN[1:])]
        positions.extend(share * edge for share in SEEN)
        return lesser_spot(xp, spot, scanned(xp, course, tuple(positions)))

    spot = in_rows(near, spot, searched, course, edge, spot)
    return ShapePoint(course.at(spot.position), spot.margin)


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
    short = beside if rivals.plain else xp.maximum(beside - rivals.radius, 0.0 * beside)
    slower = rivals.u if rivals.wind is None else rivals.u - pair_length(rivals.wind)
    height = short * short + rivals.z * rivals.z
    return slower * slower * height < rivals.v * rivals.v * (apart * apart)
