"""A target with an extent: a point, a disc, a segment or a convex polygon about the target's position.

The evader's region does not change, and the value of TAD is the distance between the region and the target's set
(arXiv 2109.07075, 2104.00717). With X* of the region and T* of the set the closest pair, the gradients of the value are
those of the game with the point T* as target (envelope theorem). So every formula for a point holds with T* for T.

If the set meets the region, the evader wins: it runs to the point of the set where it arrives sooner than the pursuer
by most. That point lies on the edge of the set, which consists of straight lines and, with a radius, of arcs.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from guidance.errors import ConfigError
from guidance.game.arrays import FLOATS, Library, Plane, Real, Truth, cross2, times2
from guidance.game.records import is_finite, require

OUTLINE = 64
"""Number of directions; the outermost points in these directions are the outline of a set."""


@dataclass(frozen=True, slots=True)
class Extent:
    """The convex polygon of some corners, widened by a radius; by default a point.

    One corner with a radius is a disc, two corners are a segment. Corners may be given in any order.

    Attributes:
        corners_m: x and y from the target's position, m.
        radius_m: distance from the polygon that still belongs to the set, m.

    Raises:
        ConfigError: a number is not finite, the radius is negative, or a corner does not stand out from the others.
    """

    corners_m: tuple[tuple[float, float], ...] = ((0.0, 0.0),)
    radius_m: float = 0.0

    def __post_init__(self) -> None:
        require("radius_m", self.radius_m, zero_allowed=True)
        pairs = [tuple(corner) for corner in self.corners_m]
        if not pairs or any(
            len(corner) != 2 or not all(map(is_finite, corner)) for corner in pairs
        ):
            raise ConfigError(
                f"corners_m = {self.corners_m!r}: must be one or more pairs of finite numbers (x, y), m"
            )
        # Counterclockwise, as seen from the first, an extreme corner.
        first, *others = sorted((float(x), float(y)) for x, y in pairs)
        others.sort(
            key=lambda corner: (
                math.atan2(corner[1] - first[1], corner[0] - first[0]),
                math.dist(corner, first),
            )
        )
        corners = (first, *others)
        for before, (x, y), after in zip(corners, others, (*others[1:], first), strict=False):
            turn = cross2((x - before[0], y - before[1]), (after[0] - x, after[1] - y))
            if corners.count((x, y)) > 1 or (len(corners) > 2 and turn <= 0.0):
                remedy = "leave it out, or use a convex polygon around all of them"
                raise ConfigError(
                    f"corners_m: ({x:g}, {y:g}) is no corner of a convex polygon with the others; {remedy}"
                )
        object.__setattr__(self, "corners_m", corners)
        object.__setattr__(self, "radius_m", float(self.radius_m))

    @property
    def is_point(self) -> bool:
        """True if the set is one point."""
        return len(self.corners_m) == 1 and self.radius_m == 0.0

    def distance_m(self, target: Sequence[float], place: Sequence[float]) -> float:
        """Return the horizontal distance of a place from the set about a target's position, m; zero inside."""
        return float(
            FLOATS.norm2(to_set(FLOATS, self, (place[0] - target[0], place[1] - target[1])))
        )

    def outline_m(self) -> list[tuple[float, float]]:
        """Return points around the set's edge, for pictures: x and y from the target's position; of a point none."""
        outline: list[tuple[float, float]] = []
        if self.is_point:
            return outline
        for number in range(OUTLINE):
            x = math.cos(math.tau * number / OUTLINE)
            y = math.sin(math.tau * number / OUTLINE)
            corner = max(self.corners_m, key=lambda corner: corner[0] * x + corner[1] * y)
            outline.append((corner[0] + self.radius_m * x, corner[1] + self.radius_m * y))
        return list(dict.fromkeys(outline))


POINT = Extent()
ORIGIN = (0.0, 0.0)


def nearest(xp: Library, extent: Extent, point: Plane) -> tuple[Plane, Truth]:
    """Return the point of the polygon nearest to a point, and whether it lies on a line and not at a corner.

    Args:
        xp: array library.
        extent: the polygon, whose radius is not used.
        point: from the target's position, m.
    """
    edges = _edges(extent)
    closest: Plane = extent.corners_m[0]
    if not edges:
        return closest, False
    share_there: Real = 0.0
    least: Real = math.inf
    inside: Truth = len(edges) > 1
    for a_x, a_y, way_x, way_y, square in edges:
        x = point[0] - a_x
        y = point[1] - a_y
        share = (x * way_x + y * way_y) / square
        clamped = xp.within_one(share)
        foot = (a_x + clamped * way_x, a_y + clamped * way_y)
        east = point[0] - foot[0]
        north = point[1] - foot[1]
        apart = east * east + north * north
        closer = apart < least
        closest = xp.select2(closer, foot, closest)
        share_there = xp.select(closer, share, share_there)
        least = xp.select(closer, apart, least)
        if inside is not False:
            inside = inside & (way_x * y - way_y * x >= 0.0)
    return xp.select2(inside, point, closest), (share_there > 0.0) & (share_there < 1.0)


@lru_cache(maxsize=64)
def _edges(extent: Extent) -> tuple[tuple[float, float, float, float, float], ...]:
    """Return the edges, counterclockwise; a segment has one: begin, way to the end, and the square of its length."""
    corners = extent.corners_m
    ends = corners[1:] + (corners[:1] if len(corners) > 2 else ())
    edges = []
    for (a_x, a_y), (b_x, b_y) in zip(corners, ends, strict=False):
        way_x = b_x - a_x
        way_y = b_y - a_y
        edges.append((a_x, a_y, way_x, way_y, way_x * way_x + way_y * way_y))
    return tuple(edges)


def is_inside(xp: Library, extent: Extent, point: Plane) -> Truth:
    """Return whether a point, which is given from the target's position, belongs to the set."""
    corners = extent.corners_m
    radius = extent.radius_m
    if len(corners) == 1:
        away = (point[0] - corners[0][0], point[1] - corners[0][1])
        return away[0] * away[0] + away[1] * away[1] <= radius * radius
    if radius > 0.0 or len(corners) == 2:
        offset = to_set(xp, extent, point)
        return (offset[0] == 0.0) & (offset[1] == 0.0)
    inside: Truth = True
    for (a_x, a_y), (b_x, b_y) in zip(corners, corners[1:] + corners[:1], strict=True):
        left = (b_x - a_x) * (point[1] - a_y) - (b_y - a_y) * (point[0] - a_x)
        inside = inside & (left >= 0.0)
    return inside


def from_set(centre: Plane, offset: Plane) -> Plane:
    """Return the vector to a point of the set, given from the target's position, from that to the position."""
    if type(offset[0]) is float and offset == ORIGIN:
        return centre
    return centre[0] + offset[0], centre[1] + offset[1]


def to_set(xp: Library, extent: Extent, point: Plane) -> Plane:
    """Return the vector from a point, which is given from the target's position, to the nearest point of the set."""
    (x, y), _ = nearest(xp, extent, point)
    offset = (x - point[0], y - point[1])
    length = xp.norm2(offset)
    outside = length > extent.radius_m
    share = xp.select(
        outside, 1.0 - extent.radius_m / xp.select(outside, length, 1.0), 0.0 * length
    )
    return times2(share, offset)
