"""True if our fence lies inside the areas of an uploaded fence.

Every area is a ring of corners, judged by even-odd as PX4 and ArduPilot judge it, so a ring may cross itself. A circle
becomes a ring with so many corners that it hardly differs. The judgement is exact for rings: their edges are cut where
they cross each other and our fence, and one point of each piece decides for the whole piece.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from guidance.control.polygon import Point

Points = NDArray[np.float64]
"""Points north and east of home in metres, shape (count, 2)."""

_Flags = NDArray[np.bool_]

MOST_EDGES: Final = 3000
"""Most edges of all areas. Judging them takes about a tenth of a second."""

TOLERANCE_M: Final = 0.1
"""Our fence may touch an uploaded one: degrees on the wire have steps of 1 cm, and our commands stay further inside."""

_SAG_M: Final = 0.02
_FEWEST_SIDES: Final = 36
_MOST_SIDES: Final = 720  # at 10 km, the largest fence of ours, the ring is less than `TOLERANCE_M` inside the circle
_ROWS: Final = 128
"""Edges that are cut at once; bounds the memory."""


class Ring(NamedTuple):
    """A closed outline: its corners, and whether the autopilot keeps the vehicle inside it or outside."""

    corners_m: tuple[Point, ...]
    inclusion: bool


def circle_sides(radius_m: float) -> int:
    """Return the number of corners of the ring that replaces a circle."""
    sides = math.ceil(math.pi * math.sqrt(radius_m / (2.0 * _SAG_M)))
    return min(_MOST_SIDES, max(_FEWEST_SIDES, sides))


def ring_of_circle(centre_m: Point, radius_m: float, *, larger: bool) -> tuple[Point, ...]:
    """Return the corners of a ring that replaces a circle.

    Args:
        centre_m: North and east of home.
        radius_m: Its radius.
        larger: Whether the ring encloses the circle; otherwise the circle encloses the ring.
    """
    sides = circle_sides(radius_m)
    half_side_rad = math.pi / sides
    if larger:
        radius_m /= math.cos(half_side_rad)
    turns_rad = [2.0 * half_side_rad * side for side in range(sides)]
    north_m, east_m = centre_m
    return tuple(
        (north_m + radius_m * math.cos(turn), east_m + radius_m * math.sin(turn))
        for turn in turns_rad
    )


def contains(ring: Sequence[Point], points_m: Points) -> _Flags:
    """Return which points are inside a ring by even-odd: a ray to the east crosses an odd number of edges."""
    starts, ends = _edges(ring)
    north = points_m[:, :1]
    east = points_m[:, 1:]
    rise = ends[:, 0] - starts[:, 0]
    crosses = (starts[:, 0] > north) != (ends[:, 0] > north)
    share = (north - starts[:, 0]) / np.where(rise == 0.0, 1.0, rise)
    crossing_east = starts[:, 1] + share * (ends[:, 1] - starts[:, 1])
    inside: _Flags = np.count_nonzero(crosses & (east < crossing_east), axis=1) % 2 == 1
    return inside


def distance_m(ring: Sequence[Point], points_m: Points) -> Points:
    """Return the distance of every point from the outline of a ring."""
    starts, ends = _edges(ring)
    along = ends - starts
    offset = points_m[:, np.newaxis] - starts
    square = np.maximum(np.vecdot(along, along), 1e-12)
    share = np.clip(np.vecdot(offset, along) / square, 0.0, 1.0)
    nearest = offset - share[..., np.newaxis] * along
    shortest: Points = np.sqrt(np.vecdot(nearest, nearest)).min(axis=1)
    return shortest


@lru_cache(maxsize=8)
def acts_inside(
    ours: tuple[tuple[Point, ...], ...], areas: tuple[Ring, ...], *, one_inclusion_is_enough: bool
) -> Point | None:
    """Return a point inside our fence where the autopilot's fence acts, or None if it acts nowhere inside.

    The result is kept, because the same fence is judged twice a second.

    Args:
        ours: Rings of our fence; the vehicle stays inside all of them.
        areas: The uploaded areas, with at most `MOST_EDGES` corners.
        one_inclusion_is_enough: Whether the vehicle may be in one of several inclusion areas, or has to be in all.
    """
    outline_m = np.concatenate([middles_of(ring, [*ours, *_rings(areas)]) for ring in ours])
    outline_m = outline_m[_inside_ours(ours, outline_m, -TOLERANCE_M)]
    for index, area in enumerate(areas):
        edge_m = middles_of(area.corners_m, [*ours, *_rings(areas)])
        edge_m = edge_m[_inside_ours(ours, edge_m, TOLERANCE_M)]
        if len(edge_m) and area.inclusion and one_inclusion_is_enough:
            others = [ring for ring in areas[:index] + areas[index + 1 :] if ring.inclusion]
            for ring in others:
                edge_m = edge_m[~contains(ring.corners_m, edge_m)]
        if len(edge_m):
            return _first_point(edge_m)
    # Find the points of our outline where the fence acts. An area allows the points on its own outline.
    inclusions = [area for area in areas if area.inclusion]
    outside = np.zeros(len(outline_m), dtype=bool)
    if inclusions:
        allowed = [
            contains(area.corners_m, outline_m)
            | (distance_m(area.corners_m, outline_m) <= TOLERANCE_M)
            for area in inclusions
        ]
        combine = np.logical_or if one_inclusion_is_enough else np.logical_and
        outside = ~combine.reduce(allowed)
    for area in areas:
        if not area.inclusion:
            deep = distance_m(area.corners_m, outline_m) > TOLERANCE_M
            outside |= contains(area.corners_m, outline_m) & deep
    return _first_point(outline_m[outside]) if outside.any() else None


def _inside_ours(ours: Sequence[Sequence[Point]], points_m: Points, depth_m: float) -> _Flags:
    """Return which points are inside our fence by more than `depth_m`; a negative depth allows points outside."""
    inside = np.ones(len(points_m), dtype=bool)
    for ring in ours:
        within = contains(ring, points_m)
        # Only near the outline does the distance decide.
        judged = within if depth_m > 0.0 else ~within
        near = distance_m(ring, points_m[judged]) <= abs(depth_m)
        within[judged] = ~near if depth_m > 0.0 else near
        inside &= within
    return inside


def _rings(areas: Sequence[Ring]) -> list[tuple[Point, ...]]:
    return [area.corners_m for area in areas]


def _edges(ring: Sequence[Point]) -> tuple[Points, Points]:
    starts = np.array(ring)
    return starts, np.roll(starts, -1, axis=0)


def middles_of(ring: Sequence[Point], cutting: Sequence[Sequence[Point]]) -> Points:
    """Return the middle of every piece into which the other rings cut the edges of a ring."""
    starts, ends = _edges(ring)
    others = [_edges(cutter) for cutter in cutting]
    other_starts = np.concatenate([start for start, _ in others])
    other_along = np.concatenate([end - start for start, end in others])
    middles = [
        _middles_of_edges(
            starts[row : row + _ROWS], ends[row : row + _ROWS], other_starts, other_along
        )
        for row in range(0, len(starts), _ROWS)
    ]
    return np.concatenate(middles)


def _middles_of_edges(
    starts: Points, ends: Points, other_starts: Points, other_along: Points
) -> Points:
    along = ends - starts
    offset = other_starts - starts[:, np.newaxis]
    across = _cross(along[:, np.newaxis], other_along)
    parallel = across == 0.0
    divisor = np.where(parallel, 1.0, across)
    share = _cross(offset, other_along) / divisor
    other_share = _cross(offset, along[:, np.newaxis]) / divisor
    cuts = ~parallel & (other_share >= -1e-9) & (other_share <= 1.0 + 1e-9)
    # A share beyond the edge, or of no crossing, becomes its end: a piece without length changes nothing.
    shares = np.where(cuts, np.clip(share, 0.0, 1.0), 1.0)
    bounds = np.sort(np.concatenate([np.zeros((len(starts), 1)), shares], axis=1))
    bounds = np.concatenate([bounds, np.ones((len(starts), 1))], axis=1)
    rows, columns = np.nonzero(np.diff(bounds) > 1e-9)
    middle = 0.5 * (bounds[rows, columns] + bounds[rows, columns + 1])
    points: Points = starts[rows] + middle[:, np.newaxis] * along[rows]
    return points


def _cross(a: Any, b: Any) -> Any:  # noqa: ANN401 - arrays of any shape
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _first_point(points_m: Points) -> Point:
    north_m, east_m = points_m[0]
    return float(north_m), float(east_m)


def without_repeats(corners: Sequence[Point]) -> tuple[Point, ...]:
    """Return the corners without those that repeat the one before. A closed ring loses its last corner."""
    distinct = [corners[0], *(corner for before, corner in pairwise(corners) if corner != before)]
    if len(distinct) > 1 and distinct[-1] == distinct[0]:
        distinct.pop()
    return tuple(distinct)
