"""The point of a team's least margin on a target with an extent: the team has to defend this point first.

The margin at a point of the set is how much sooner a pursuer can be there than the evader, the best of all pursuers.
It grows along every ray from the evader, so it is least on the set's edge: straight sides, and arcs around the corners
of a set with a radius. Each of these pieces is tried at points that are equally far apart as the evader sees them, and
then around its best one, closer and closer.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from guidance.game import pe
from guidance.game.arrays import NUMPY, Array, Plane, components, cross2, dot2, mapped, plus2
from guidance.game.extent import Extent, to_set
from guidance.game.game import NO_WIND, Game
from guidance.game.meeting_times import catch_in_ball
from guidance.game.pe import Geometry
from guidance.game.tad import guard_time

_TRIED = 65
"""Points of a piece that are tried first."""

_MINIMA = 4
"""Lowest minima among these points that are followed; the margin of a team has kinks and several minima."""

_CLOSER = 33
"""Points between both neighbours of the best one, in each further round."""

_ROUNDS = 7
"""Rounds: the point is found to 1e-10 of its piece, and the least margin as exactly if it is a kink."""

ON_THE_LINE = 1e-9
"""Least distance of the evader from a side's line that is used, over the side's length."""


class Danger(NamedTuple):
    """The point of a target's set where a margin is least, (..., 3), m, and that margin, (...), s."""

    point_m: Array
    margin_s: Array


class Pieces(NamedTuple):
    """The pieces of a set's edge, from the target's position, along the first axis of arrays.

    Attributes:
        begin: of a side, or centre of an arc, (p, 1, ...), m.
        along: direction of a side, (p, 1, ...); zero for an arc.
        radius: of an arc, m; zero for a side.
        foot: position of the evader's foot on a side, m; zero for an arc.
        apart: distance of the evader from a side's line, m; zero for an arc.
        low: first angle of each piece, rad: seen from the evader for a side, around its centre for an arc.
        high: last angle.
        length: of a side, m.
    """

    begin: Plane
    along: Plane
    radius: Array
    foot: Array
    apart: Array
    low: Array
    high: Array
    length: Array

    def at(self, angle: Array) -> Plane:
        """Return the points at some angles, (p, k, ...), from the target's position, m."""
        position = np.clip(self.foot + self.apart * np.tan(angle), 0.0, self.length)
        if not self.radius.any():
            return plus2(self.begin, position, self.along)
        position = np.where(self.radius > 0.0, 0.0, position)
        x, y = plus2(self.begin, position, self.along)
        return x + self.radius * np.cos(angle), y + self.radius * np.sin(angle)


def team_most_in_danger(game: Game, P: Array, E: Array, T: Array) -> Danger:
    """Return the point of the target's set where a team's margin is least.

    Args:
        game: with the target's extent; its numbers may be arrays (..., n).
        P: positions of the pursuers, (..., n, 3), m.
        E: position of the evader, (..., 3), m.
        T: position of the target, (..., 3), m.
    """
    extent = game.target_extent
    evader_of_each = components(E[..., None, :])
    state = pe.take_apart(NUMPY, game, components(P), evader_of_each, None)
    way = T - E
    to_target = (way[..., 0], way[..., 1])
    evader = (-to_target[0], -to_target[1])
    x, y = _least(game, state, to_target, _pieces(extent, evader))
    inside = to_set(NUMPY, extent, evader)
    arrived = dot2(inside, inside) == 0.0
    x = np.where(arrived, evader[0], x)
    y = np.where(arrived, evader[1], y)
    margin_here = _margins(game, state, plus2(to_target, 1.0, (x, y)))
    target_x, target_y, height = components(T)
    point = np.stack([target_x + x, target_y + y, height], axis=-1)
    return Danger(point, margin_here)


def _least(game: Game, state: Geometry, to_target: Plane, pieces: Pieces) -> Plane:
    """Return the point of some pieces with the least margin, from the target's position, m."""
    angle, step = _points_between(pieces.low, pieces.high, _TRIED)
    margin = _margins(game, state, plus2(to_target, 1.0, pieces.at(angle)))
    # Indices over all pieces of the lowest minima along them, (MINIMA, ...)
    beyond = np.full_like(margin[:, :1], np.inf)
    before = np.concatenate([beyond, margin[:, :-1]], axis=1)
    after = np.concatenate([margin[:, 1:], beyond], axis=1)
    is_minimum = (margin <= before) & (margin <= after)
    lowest = np.where(is_minimum, margin, np.inf)
    minima = np.argsort(_joined(lowest), axis=0)[:_MINIMA]
    middle = np.take_along_axis(_joined(angle), minima, axis=0)[:, None]
    number = minima // _TRIED
    # Each minimum is followed on its piece
    pieces = mapped(lambda part: np.take_along_axis(part[:, 0], number, axis=0)[:, None], pieces)
    step = np.take_along_axis(step[:, 0], number, axis=0)[:, None]
    for _ in range(_ROUNDS):
        low = np.maximum(middle - step, pieces.low)
        high = np.minimum(middle + step, pieces.high)
        angle, step = _points_between(low, high, _CLOSER)
        margin = _margins(game, state, plus2(to_target, 1.0, pieces.at(angle)))
        best = np.argmin(margin, axis=1)[:, None]
        middle = np.take_along_axis(angle, best, axis=1)
    least = np.take_along_axis(margin, best, axis=1)[:, 0]
    piece = np.argmin(least, axis=0)[None]
    points = [np.asarray(part)[:, 0] for part in pieces.at(middle)]
    x = np.take_along_axis(points[0], piece, axis=0)
    y = np.take_along_axis(points[1], piece, axis=0)
    return x[0], y[0]


def _joined(array: Array) -> Array:
    """Return an array with its first two axes made one."""
    return array.reshape(-1, *array.shape[2:])


def _points_between(low: Array, high: Array, count: int) -> tuple[Array, Array]:
    """Return points between two ends, (p, count, ...), and the distance of two."""
    width = high - low
    share = _shares(count).reshape(1, count, *(1,) * (low.ndim - 2))
    return low + share * width, width / (count - 1)


@lru_cache(maxsize=4)
def _shares(count: int) -> Array:
    """Return numbers from 0 to 1."""
    shares = np.linspace(0.0, 1.0, count)
    shares.flags.writeable = False
    return shares


def _margins(game: Game, state: Geometry, heading: Plane) -> Array:
    """Return the margin of the best pursuer, (...), s, at points given from the evader, m."""
    x, y = (np.asarray(part)[..., None] for part in heading)
    v = game.evader_speed_m_s
    adrift = game.target_velocity_m_s
    if adrift == NO_WIND:
        arrival = NUMPY.norm2((x, y)) / v
        goal = (x, y)
    else:
        arrival = catch_in_ball(NUMPY, v, 0.0, (x, y), adrift, 0.0)
        goal = (x + adrift[0] * arrival, y + adrift[1] * arrival)
    margin = arrival - guard_time(NUMPY, game, state, goal)
    return np.asarray(margin).max(axis=-1)


def _pieces(extent: Extent, evader: Plane) -> Pieces:
    """Return the edge of a set, as an evader sees it that is given from the target's position, (...)."""
    corners = extent.corners_m
    radius = extent.radius_m
    if len(corners) == 1:
        centre = corners[0]
        middle = np.arctan2(evader[1] - centre[1], evader[0] - centre[0])
        circle = _arc(centre, radius, middle - math.pi, middle + math.pi, evader)
        return _stacked([circle])
    pieces = []
    before = _normal(corners[-1], corners[0])
    for begin, end in zip(corners, corners[1:] + corners[:1], strict=True):
        normal = _normal(begin, end)
        if radius > 0.0:
            first = math.atan2(before[1], before[0])
            turn = math.atan2(cross2(before, normal), dot2(before, normal)) % math.tau
            nothing = 0.0 * evader[0]
            low = first + nothing
            high = first + turn + nothing
            pieces.append(_arc(begin, radius, low, high, evader))
        outer_begin = plus2(begin, radius, normal)
        outer_end = plus2(end, radius, normal)
        pieces.append(_side(outer_begin, outer_end, evader))
        before = normal
    return _stacked(pieces)


def _normal(begin: Plane, end: Plane) -> Plane:
    """Return the direction out of a set on the left of a side."""
    length = math.dist(begin, end)
    return (end[1] - begin[1]) / length, (begin[0] - end[0]) / length


def _arc(centre: Plane, radius: float, low: Array, high: Array, evader: Plane) -> Pieces:
    nothing = 0.0 * evader[0]
    return Pieces(
        begin=(centre[0] + nothing, centre[1] + nothing),
        along=(nothing, nothing),
        radius=radius + nothing,
        foot=nothing,
        apart=nothing,
        low=low,
        high=high,
        length=nothing,
    )


def _side(begin: Plane, end: Plane, evader: Plane) -> Pieces:
    length = math.dist(begin, end)
    x, y = begin
    along_x = (end[0] - x) / length
    along_y = (end[1] - y) / length
    along = (along_x, along_y)
    from_begin = plus2(evader, -1.0, begin)
    foot = dot2(from_begin, along)
    apart = np.maximum(abs(cross2(along, from_begin)), ON_THE_LINE * length)
    nothing = 0.0 * foot
    return Pieces(
        begin=(x + nothing, y + nothing),
        along=(along_x + nothing, along_y + nothing),
        radius=nothing,
        foot=foot,
        apart=apart,
        low=np.arctan2(-foot, apart),
        high=np.arctan2(length - foot, apart),
        length=length + nothing,
    )


def _stacked(pieces: list[Pieces]) -> Pieces:
    """Return pieces along a first axis, with a second one for points."""

    def joined(*parts: Array) -> Array:
        return np.stack(parts)[:, None]

    begin = tuple(joined(*(piece.begin[axis] for piece in pieces)) for axis in (0, 1))
    along = tuple(joined(*(piece.along[axis] for piece in pieces)) for axis in (0, 1))
    columns = (joined(*parts) for parts in zip(*(piece[2:] for piece in pieces), strict=True))
    return Pieces((begin[0], begin[1]), (along[0], along[1]), *columns)
