"""A target with an extent: a point, a disc, a segment or a convex polygon about the target's position.

The evader's region stays what it is, and the value of TAD is the distance between the region and the target's set
(arXiv 2109.07075, 2104.00717). With X* of the region and T* of the set the closest pair, the gradients of the value are
those of the game with the point T* as target (envelope theorem). So every formula for a point holds with T* for T.

If the set meets the region, the evader wins: it runs to the point of the set where it arrives sooner than the pursuer
by most. That point lies on the edge of the set, which consists of straight lines and, with a radius, of arcs.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from guidance.errors import ConfigError
from guidance.game.arrays import FLOATS, Library, Plane, Real, Truth, norm2, select, select2
from guidance.game.records import is_finite, require

GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
SEARCHED = 32
"""Steps of a golden section search: the place is found to 2e-7 of its line's length, the least value to 1e-13."""


class Piece(NamedTuple):
    """A straight line or an arc of a set's edge, with a parameter from 0 to 1.

    The point is begin + t · way + `out`, turned by the angle with the tangent t · turn of its half.
    """

    begin: tuple[float, float]
    way: tuple[float, float]
    out: tuple[float, float]
    turn: float

    def at(self, t: Real) -> Plane:
        """Return the point of a parameter."""
        tangent = t * self.turn
        scale = 1.0 / (1.0 + tangent * tangent)
        cosine, sine = (1.0 - tangent * tangent) * scale, 2.0 * tangent * scale
        (x, y), (way_x, way_y), (out_x, out_y) = self.begin, self.way, self.out
        return x + t * way_x + cosine * out_x - sine * out_y, y + t * way_y + cosine * out_y + sine * out_x


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
        given = [tuple(corner) for corner in self.corners_m]
        if not given or any(len(corner) != 2 or not all(map(is_finite, corner)) for corner in given):
            raise ConfigError(f"corners_m = {self.corners_m!r}: must be one or more pairs of finite numbers (x, y), m")
        corners = [(float(x), float(y)) for x, y in given]
        hull = _hull(corners)
        for corner in corners:
            if corner not in hull or corners.count(corner) > 1:
                raise ConfigError(
                    f"corners_m: ({corner[0]:g}, {corner[1]:g}) is no corner of a convex polygon with the others; "
                    "leave it out, or use a convex polygon around all of them"
                )
        object.__setattr__(self, "corners_m", hull)
        object.__setattr__(self, "radius_m", float(self.radius_m))

    @property
    def is_point(self) -> bool:
        """Whether the set is one point."""
        return len(self.corners_m) == 1 and self.radius_m == 0.0

    def distance_m(self, target: Sequence[float], place: Sequence[float]) -> float:
        """Return the horizontal distance of a place from the set about a target's position, m; zero inside."""
        offset = (place[0] - target[0], place[1] - target[1])
        return float(norm2(FLOATS, to_set(FLOATS, self, offset)))

    def outline_m(self) -> list[tuple[float, float]]:
        """Return points around the set's edge, for pictures: x and y from the target's position."""
        steps = [0.125 * number for number in range(8)]
        return [piece.at(t) for piece in _pieces(self) for t in (steps if piece.turn else [0.0, 1.0])]


def _hull(points: list[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Return the corners of the convex hull, counterclockwise (Andrew's monotone chain)."""
    ordered = sorted(set(points))
    if len(ordered) < 3:
        return tuple(ordered)
    chains = []
    for side in (ordered, ordered[::-1]):
        chain: list[tuple[float, float]] = []
        for x, y in side:
            while len(chain) > 1 and (chain[-1][0] - chain[-2][0]) * (y - chain[-2][1]) <= (
                chain[-1][1] - chain[-2][1]
            ) * (x - chain[-2][0]):
                chain.pop()
            chain.append((x, y))
        chains.append(chain[:-1])
    return tuple(chains[0] + chains[1])


POINT = Extent()
ORIGIN = (0.0, 0.0)


def lines(extent: Extent) -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
    """Yield both ends of the straight lines of a polygon, counterclockwise."""
    corners = extent.corners_m
    for number in range(len(corners) if len(corners) > 2 else len(corners) - 1):
        yield corners[number], corners[(number + 1) % len(corners)]


def nearest(xp: Library, extent: Extent, place: Plane) -> tuple[Plane, Truth]:
    """Return the nearest point of the polygon to a place, and whether it lies on a line and not at a corner.

    Args:
        xp: array library.
        extent: the polygon, whose radius is not used.
        place: from the target's position, m.
    """
    found: Plane = extent.corners_m[0]
    flat: Truth = False
    if len(extent.corners_m) == 1:
        return found, flat
    least: Real = float("inf")
    inside: Truth = len(extent.corners_m) > 2
    for (a_x, a_y), (b_x, b_y) in lines(extent):
        way_x, way_y = b_x - a_x, b_y - a_y
        x, y = place[0] - a_x, place[1] - a_y
        share = (x * way_x + y * way_y) / (way_x * way_x + way_y * way_y)
        held = select(xp, share < 0.0, 0.0 * share, select(xp, share > 1.0, 0.0 * share + 1.0, share))
        foot = (a_x + held * way_x, a_y + held * way_y)
        apart = (place[0] - foot[0]) * (place[0] - foot[0]) + (place[1] - foot[1]) * (place[1] - foot[1])
        closer = apart < least
        within = (share > 0.0) & (share < 1.0)
        flat = select(xp, closer, within, flat)
        found, least = select2(xp, closer, foot, found), select(xp, closer, apart, least)
        inside = inside & (way_x * y - way_y * x >= 0.0)
    return select2(xp, inside, place, found), flat


def from_set(centre: Plane, offset: Plane) -> Plane:
    """Return the vector to a point of the set, given from the target's position, from that to the position."""
    if type(offset[0]) is float and offset == ORIGIN:
        return centre
    return centre[0] + offset[0], centre[1] + offset[1]


def to_set(xp: Library, extent: Extent, place: Plane) -> Plane:
    """Return the vector from a place, which is given from the target's position, to the nearest point of the set."""
    (x, y), _ = nearest(xp, extent, place)
    way = (x - place[0], y - place[1])
    if extent.radius_m == 0.0:
        return way
    length = norm2(xp, way)
    outside = length > extent.radius_m
    share = select(xp, outside, 1.0 - extent.radius_m / select(xp, outside, length, 1.0), 0.0 * length)
    return share * way[0], share * way[1]


def least_at(xp: Library, extent: Extent, value: Callable[[Plane], Real]) -> Plane:
    """Return where on the set's edge a function is least, from the target's position.

    Args:
        xp: array library.
        extent: the set.
        value: of points from the target's position, with one minimum along each piece of the edge.
    """
    best: Plane | None = None
    for piece in _pieces(extent):
        found, reached = _least_on(xp, piece, value)
        if best is None:
            best, least = found, reached
        else:
            closer = reached < least
            best, least = select2(xp, closer, found, best), select(xp, closer, reached, least)
    return extent.corners_m[0] if best is None else best


def _least_on(xp: Library, piece: Piece, value: Callable[[Plane], Real]) -> tuple[Plane, Real]:
    """Search a piece by golden section; its ends are tried as well."""
    zero = 0.0 * value(piece.at(0.0))
    low, high = zero, zero + 1.0
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left, at_right = value(piece.at(left)), value(piece.at(right))
    for _ in range(SEARCHED):
        falls = at_right < at_left
        low, high = select(xp, falls, left, low), select(xp, falls, high, right)
        new = select(xp, falls, low + GOLDEN * (high - low), high - GOLDEN * (high - low))
        at_new = value(piece.at(new))
        left, right = select(xp, falls, right, new), select(xp, falls, new, left)
        at_left, at_right = select(xp, falls, at_right, at_new), select(xp, falls, at_new, at_left)
    best, least = left, at_left
    for t in (zero, zero + 1.0):
        reached = value(piece.at(t))
        best, least = select(xp, reached <= least, t, best), select(xp, reached <= least, reached, least)
    return piece.at(best), least


def _pieces(extent: Extent) -> Iterator[Piece]:
    """Yield the pieces of a set's edge; none of a point."""
    corners, radius = list(extent.corners_m), extent.radius_m
    if extent.is_point:
        return
    if len(corners) == 1:
        for out in ((radius, 0.0), (0.0, radius), (-radius, 0.0), (0.0, -radius)):
            yield Piece(corners[0], (0.0, 0.0), out, 1.0)
        return
    ways = [(b[0] - a[0], b[1] - a[1]) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    outs = [(radius * y / math.hypot(x, y), -radius * x / math.hypot(x, y)) for x, y in ways]
    for number, (corner, way, out) in enumerate(zip(corners, ways, outs, strict=True)):
        if radius > 0.0:
            before = outs[number - 1]
            angle = math.atan2(before[0] * out[1] - before[1] * out[0], before[0] * out[0] + before[1] * out[1])
            half = 0.5 * (angle if angle > 0.0 else math.pi)
            middle = (
                before[0] * math.cos(half) - before[1] * math.sin(half),
                before[1] * math.cos(half) + before[0] * math.sin(half),
            )
            for begin in (before, middle):
                yield Piece(corner, (0.0, 0.0), begin, math.tan(0.5 * half))
        if number == 0 or len(corners) > 2 or radius > 0.0:
            yield Piece(corner, way, out, 0.0)
