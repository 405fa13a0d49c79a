"""A polygon fence: its checks, and the geometry that limits and preflight ask of it."""

import math
from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import InitVar, dataclass
from itertools import combinations, pairwise
from typing import Final

from guidance.errors import ConfigError
from guidance.frames import LocalFrame, Ned

Point = tuple[float, float]
_Edge = tuple[Point, Point]

MOST_CORNERS: Final = 200
"""Most corners of a fence. Every edge is a wall in every cycle; PX4 and ArduCopter store 64 and 84 corners."""

_SHORTEST_EDGE_M: Final = 0.01


@dataclass(frozen=True, slots=True)
class Polygon:
    """A simple polygon on the ground, convex or not, clockwise or not.

    Attributes:
        corners_ne_m: Corners north and east of home in metres. The last one joins the first.
        unchecked: Whether the corners are those of a polygon that was checked, about another home. Checking takes too
            long for a cycle.

    Raises:
        ConfigError: If there are fewer than three corners or more than `MOST_CORNERS`, a corner is not finite, an edge
            has no length, or edges cross.
    """

    corners_ne_m: tuple[Point, ...]
    unchecked: InitVar[bool] = False

    def __post_init__(self, unchecked: bool) -> None:
        if unchecked:
            return
        corners = self.corners_ne_m
        if len(corners) < 3:
            raise ConfigError(f"fence_polygon has {len(corners)} corners: needs at least 3")
        if len(corners) > MOST_CORNERS:
            raise ConfigError(
                f"fence_polygon has {len(corners)} corners: at most {MOST_CORNERS} are allowed; simplify it"
            )
        for corner in corners:
            if not all(math.isfinite(value) for value in corner):
                raise ConfigError(f"fence_polygon corner {corner}: must be two finite numbers")
        edges = self.edges()
        for index, edge in enumerate(edges):
            if math.dist(*edge) < _SHORTEST_EDGE_M:
                raise ConfigError(
                    f"fence_polygon edge {index} {edge} is shorter than {_SHORTEST_EDGE_M} m: omit it"
                )
        if crossing_edges(edges) is not None:
            # The error names the first crossing in the order of the corners; only here all pairs are compared.
            pairs = combinations(range(len(edges)), 2)
            first, second = next(pair for pair in pairs if _edges_cross(edges, *pair))
            raise ConfigError(
                f"fence_polygon: edges {first} and {second} cross or touch; give the corners in order"
            )

    def edges(self) -> tuple[_Edge, ...]:
        """The edges as pairs of corners."""
        return tuple(pairwise((*self.corners_ne_m, self.corners_ne_m[0])))

    def contains(self, point: Point) -> bool:
        """Return whether a point is inside. Counts the edges that a ray to the east crosses."""
        north, east = point
        inside = False
        for (north1, east1), (north2, east2) in self.edges():
            if (north1 > north) != (north2 > north):
                crossing_east = east1 + (north - north1) / (north2 - north1) * (east2 - east1)
                inside ^= east < crossing_east
        return inside

    def outward(self, index: int) -> Point:
        """Outward unit normal (north, east) of an edge."""
        (north1, east1), (north2, east2) = self.edges()[index]
        doubled_area = sum(n1 * e2 - n2 * e1 for (n1, e1), (n2, e2) in self.edges())
        scale = math.copysign(math.hypot(north2 - north1, east2 - east1), doubled_area)
        return ((east2 - east1) / scale, (north1 - north2) / scale)

    def nearest_points(self, point: Point) -> tuple[Point, ...]:
        """The nearest point of every edge."""
        points = []
        for (north1, east1), (north2, east2) in self.edges():
            along_north = north2 - north1
            along_east = east2 - east1
            projected = (point[0] - north1) * along_north + (point[1] - east1) * along_east
            share = min(1.0, max(0.0, projected / (along_north**2 + along_east**2)))
            points.append((north1 + share * along_north, east1 + share * along_east))
        return tuple(points)


def corners_about_home(
    corners_deg: Iterable[Point], home_ned_m: Ned, frame: LocalFrame
) -> tuple[Point, ...]:
    """Return places in metres north and east of home, with the map projection of the frame.

    Args:
        corners_deg: Latitude and longitude of each place.
        home_ned_m: Home in the local frame.
        frame: The vehicle's local frame.
    """
    north_m, east_m, _ = home_ned_m
    places = [
        frame.ned_from_wgs84(latitude, longitude, frame.altitude)
        for latitude, longitude in corners_deg
    ]
    return tuple((north - north_m, east - east_m) for north, east, _ in places)


def _turn(a: Point, b: Point, c: Point) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _on(edge: _Edge, point: Point) -> bool:
    a, b = edge
    if not min(a[0], b[0]) <= point[0] <= max(a[0], b[0]):
        return False
    if not min(a[1], b[1]) <= point[1] <= max(a[1], b[1]):
        return False
    return _turn(a, b, point) == 0.0


def crossing_edges(edges: Sequence[_Edge]) -> tuple[int, int] | None:
    """Return two edges of a closed line that cross, touch or fold back, by their numbers; None if it is simple.

    A line sweeps over the plane, and only edges that are neighbours on it are compared: O(n log n) comparisons. Source:
    M. Shamos and D. Hoey, Geometric intersection problems, 1976.
    """
    spans = [(min(edge), max(edge)) for edge in edges]
    begins = [(span[0], False, index) for index, span in enumerate(spans)]
    ends = [(span[1], True, index) for index, span in enumerate(spans)]
    swept: list[int] = []
    # An edge that begins where another one ends meets it, so that beginnings come first.
    for _, is_end, index in sorted(begins + ends):
        if is_end:
            position = swept.index(index)
            del swept[position]
            pairs = list(pairwise(swept[max(0, position - 1) : position + 1]))
        else:
            span = spans[index]
            position = bisect_left(swept, 1, key=lambda number: int(_is_above(spans[number], span)))
            swept.insert(position, index)
            pairs = list(pairwise(swept[max(0, position - 1) : position + 2]))
        for pair in pairs:
            first = min(pair)
            second = max(pair)
            if _edges_cross(edges, first, second):
                return first, second
    return None


def _edges_cross(edges: Sequence[_Edge], first: int, second: int) -> bool:
    """True if two edges of a closed line, by their numbers in order, have more in common than a corner."""
    neighbours = second - first in (1, len(edges) - 1)
    return edges_meet(edges[first], edges[second], neighbours=neighbours)


def _is_above(span: _Edge, beginning: _Edge) -> bool:
    """True if an edge on the sweeping line is above the edge that begins there; where both meet, beyond it."""
    turn = _turn(*span, beginning[0])
    if turn == 0.0:
        turn = _turn(*span, beginning[1])
    return turn < 0.0


def edges_meet(edge: _Edge, second_edge: _Edge, *, neighbours: bool) -> bool:
    """Return whether two edges cross or touch; neighbours, with a common corner, whether they fold back."""
    a, b = edge
    c, d = second_edge
    if neighbours:
        shared = {a, b} & {c, d}
        return len(shared) == 2 or any(
            _on(line, end)
            for line, end in ((edge, c), (edge, d), (second_edge, a), (second_edge, b))
            if end not in shared
        )
    if (_turn(a, b, c) > 0.0) != (_turn(a, b, d) > 0.0) and (_turn(c, d, a) > 0.0) != (
        _turn(c, d, b) > 0.0
    ):
        return True
    ends = ((edge, c), (edge, d), (second_edge, a), (second_edge, b))
    return any(_on(line, end) for line, end in ends)
