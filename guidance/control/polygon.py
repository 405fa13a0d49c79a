"""A polygon fence: its checks, and the geometry that limits and preflight ask of it."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations, pairwise

from guidance.errors import ConfigError
from guidance.frames import LocalFrame, Vector

Point = tuple[float, float]
Edge = tuple[Point, Point]

_SHORTEST_EDGE_M = 0.01


@dataclass(frozen=True, slots=True)
class Polygon:
    """A simple polygon on the ground, convex or not, clockwise or not.

    Attributes:
        corners_ne_m: Corners north and east of home in metres. The last one joins the first.

    Raises:
        ConfigError: If there are fewer than three corners, a corner is not finite, an edge has no length, or edges
            cross.
    """

    corners_ne_m: tuple[Point, ...]

    def __post_init__(self) -> None:
        corners = self.corners_ne_m
        if len(corners) < 3:
            raise ConfigError(f"fence_polygon has {len(corners)} corners: needs at least 3")
        for corner in corners:
            if not all(math.isfinite(value) for value in corner):
                raise ConfigError(f"fence_polygon corner {corner}: must be two finite numbers")
        for index, edge in enumerate(self.edges()):
            if math.dist(*edge) < _SHORTEST_EDGE_M:
                raise ConfigError(
                    f"fence_polygon edge {index} {edge} is shorter than {_SHORTEST_EDGE_M} m: omit it"
                )
        for (i, one), (j, other) in combinations(enumerate(self.edges()), 2):
            if _meet(one, other, neighbours=j - i in (1, len(corners) - 1)):
                raise ConfigError(
                    f"fence_polygon: edges {i} and {j} cross or touch; give the corners in order"
                )

    def edges(self) -> tuple[Edge, ...]:
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
        found = []
        for (north1, east1), (north2, east2) in self.edges():
            along_north = north2 - north1
            along_east = east2 - east1
            way = (point[0] - north1) * along_north + (point[1] - east1) * along_east
            share = min(1.0, max(0.0, way / (along_north**2 + along_east**2)))
            found.append((north1 + share * along_north, east1 + share * along_east))
        return tuple(found)


def corners_about_home(
    corners_deg: Iterable[Point], home_ned_m: Vector, frame: LocalFrame
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


def _on(edge: Edge, point: Point) -> bool:
    a, b = edge
    within = min(a[0], b[0]) <= point[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= point[1] <= max(
        a[1], b[1]
    )
    return within and _turn(a, b, point) == 0.0


def _meet(one: Edge, other: Edge, *, neighbours: bool) -> bool:
    """Return whether two edges cross or touch; neighbours, with a common corner, whether they fold back."""
    (a, b) = one
    (c, d) = other
    shared = {*one} & {*other} if neighbours else set()
    sides = (
        (_turn(a, b, c) > 0.0) != (_turn(a, b, d) > 0.0),
        (_turn(c, d, a) > 0.0) != (_turn(c, d, b) > 0.0),
    )
    ends = ((one, c), (one, d), (other, a), (other, b))
    return (not neighbours and all(sides)) or any(
        _on(edge, end) for edge, end in ends if end not in shared
    )
