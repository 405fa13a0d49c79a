"""Points of an intersection of discs: the closest to a target, and the farthest from the evader.

Seen from the evader, the points that it reaches before a pursuer at offset w = P − E form the disc

    κ‖x‖² + 2 w_xy·x ≤ ‖w‖²,   κ = δ² − 1,

Apollonius' circle (Li, Wang & Xie, section II-B). It is written without centre and radius, because these go to infinity
as δ → 1 and cost digits; at κ = 0 it is the half-plane on the evader's side of the bisector. Every disc holds the
evader, so any number of discs has an intersection, and it is convex.

Functions of two discs give the same bits when the discs change places.
"""

from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[Any]

Point: TypeAlias = tuple[Array, Array]
"""x and y, from the evader, m."""


class Discs(NamedTuple):
    """Discs along the last axis, every field (..., n).

    Attributes:
        curvature: κ = δ² − 1 of each pursuer, zero or more.
        x: of the pursuer from the evader, m.
        y: of the pursuer from the evader, m.
        z: height of the pursuer above the evader, less that of the stand-off disc, m.
    """

    curvature: Array
    x: Array
    y: Array
    z: Array

    def pick(self, index: Any) -> "Discs":  # noqa: ANN401 - whatever indexes an array
        """Return some of the discs."""
        return Discs(*(part[..., index] for part in self))


class Meeting(NamedTuple):
    """A point of an intersection: the one closest to a target, or the one farthest from the evader.

    Attributes:
        point: (...), x and y from the evader, m.
        distance: (...), from the target, or from the evader, m.
        first: (...), number of a disc that binds.
        second: (...), number of the other, or the same again where one binds alone. Both are named where the farthest
            point of the first lies on the rim of the second.
    """

    point: Point
    distance: Array
    first: Array
    second: Array


FEW = 8
"""Up to this number of discs every corner is tried."""


@lru_cache
def pairs_of(count: int) -> tuple[Array, Array]:
    """Return the numbers of both discs of every pair."""
    return np.triu_indices(count, 1)


def project(discs: Discs, target: Point, nearest: Point, distance: Array) -> Meeting:
    """Project a point on the intersection of discs.

    In the plane no more than two discs bind (the normal cone at a point has two edges), so the distance from the
    intersection is the largest of those from two discs at a time. For two discs it is the larger of the single
    distances where the one disc's closest point lies in the other; else the nearer corner of their lens, which is seen
    from the evader between the two closest points.

    Args:
        discs: the discs, (..., n).
        target: the point to project, (...), from the evader, m.
        nearest: of every disc the point closest to the target, (..., n), from the evader, m.
        distance: and how far that is from the target, (..., n), m; zero where the target lies in the disc.
    """
    i, j = pairs_of(distance.shape[-1])
    one, other = discs.pick(i), discs.pick(j)
    a, b = _of(nearest, i), _of(nearest, j)
    goal = target[0][..., None], target[1][..., None]
    corner, away = _nearer(goal, crossings(one, other))
    side = _cross(a, b)
    bind = (excess(other, a) > 0) & (excess(one, b) > 0)
    bind &= (_cross(a, corner) * side > 0) & (_cross(corner, b) * side > 0)
    bind &= (away > distance[..., i]) & (away > distance[..., j])
    every = np.concatenate([distance, np.where(bind, away, -np.inf)], axis=-1)
    best = np.argmax(every, axis=-1)
    point = tuple(taken(np.concatenate(parts, axis=-1), best) for parts in zip(nearest, corner, strict=True))
    first, second = _numbers(distance.shape[-1], i, j)
    return Meeting((point[0], point[1]), taken(every, best), first[best], second[best])


def farthest(discs: Discs, headings: Point, reach: Array) -> Meeting:
    """Find the farthest point of an intersection of discs from the evader.

    It is a disc's own farthest point if that is inside all others, or else a corner of two. All corners of a few discs
    are tried. Of many discs only a few matter: begin with the one that reaches least far, and add the disc that cuts
    the found point off most, until none does.

    Args:
        discs: the discs, (..., n).
        headings: directions to each disc's own farthest point, (..., n), of length 1.
        reach: and how far that is from the evader, (..., n), m.
    """
    count = reach.shape[-1]
    if count <= FEW:
        return _farthest_corner(discs, headings, reach)
    chosen = np.argmin(reach, axis=-1)[..., None]
    found = _of_chosen(discs, headings, reach, chosen)
    while chosen.shape[-1] < count:
        x, y = (part[..., None] / found.distance[..., None] for part in found.point)
        edge = rim(discs, (x, y))
        np.put_along_axis(edge, chosen, np.inf, axis=-1)
        worst = np.argmin(edge, axis=-1)
        cut = taken(edge, worst) < found.distance * (1.0 - 1e-13)
        if not cut.any():
            break
        chosen = np.concatenate([chosen, np.where(cut, worst, chosen[..., 0])[..., None]], axis=-1)
        again = _of_chosen(discs, headings, reach, chosen)
        point = tuple(np.where(cut, one, other) for one, other in zip(again.point, found.point, strict=True))
        rest = (np.where(cut, one, other) for one, other in zip(again[1:], found[1:], strict=True))
        found = Meeting((point[0], point[1]), *rest)
    return found


def _of_chosen(discs: Discs, headings: Point, reach: Array, chosen: Array) -> Meeting:
    """Return the farthest point of the intersection of some discs, whose numbers are (..., k)."""
    some = Discs(*(np.take_along_axis(part, chosen, axis=-1) for part in discs))
    to = [np.take_along_axis(part, chosen, axis=-1) for part in headings]
    found = _farthest_corner(some, (to[0], to[1]), np.take_along_axis(reach, chosen, axis=-1))
    return found._replace(first=taken(chosen, found.first), second=taken(chosen, found.second))


def _farthest_corner(discs: Discs, headings: Point, reach: Array) -> Meeting:
    """Try every disc's own farthest point and every corner.

    Along each such heading the distance to the edge of the intersection is computed, so that the result is a point of
    the intersection despite rounding. Of equally far points the one with the larger y, then the larger x is taken.
    """
    count = reach.shape[-1]
    i, j = pairs_of(count)
    corners = crossings(discs.pick(i), discs.pick(j))
    units = [_unit(corner) for corner in corners]
    x, y = (np.concatenate([headings[axis], units[0][axis], units[1][axis]], axis=-1) for axis in (0, 1))
    along = rim(Discs(*(part[..., None, :] for part in discs)), (x[..., None], y[..., None]))
    own = np.arange(count)
    along[..., own, own] = reach
    edge = np.min(along, axis=-1)
    edge = np.where(np.isfinite(edge), edge, -np.inf)
    tied = edge == np.max(edge, axis=-1, keepdims=True)
    north = np.where(tied, y, -2.0)
    tied = north == np.max(north, axis=-1, keepdims=True)
    best = np.argmax(np.where(tied, x, -2.0), axis=-1)
    length = taken(edge, best)
    first, second = _numbers(count, i, j, times=2)
    met = taken(np.argmin(along, axis=-1), best)
    point = length * taken(x, best), length * taken(y, best)
    return Meeting(point, length, first[best], np.where(best < count, met, second[best]))


def multipliers(
    discs: Discs, speeds: tuple[Array, Array], goal: Point | None, point: Point, binds: tuple[Array, Array]
) -> Array:
    """Return by how much the value changes for each second that a pursuer starts late, (..., n).

    X* maximises the evader's time t_E (PE), or minimises its distance from the target (TAD), among the points with
    t_E(X) ≤ tᵢ(X) for every pursuer. The multipliers λᵢ of that problem solve

        Σ λᵢ ∇(t_E − tᵢ) = ∇t_E  (PE),    Σ λᵢ ∇(t_E − tᵢ) = −∇‖X − T‖  (TAD).

    Args:
        discs: the discs, (..., n).
        speeds: of the pursuers and the evader, (..., n), m/s.
        goal: the target, (...), from the evader, m; None in PE.
        point: X*, (...), from the evader, m.
        binds: numbers of the two pursuers that decide it, (...), or of one, twice.
    """
    (u, v), (x, y) = speeds, point
    run = _unit(point)
    along = run if goal is None else _unit((goal[0] - x, goal[1] - y))
    q = []
    for who in binds:
        px, py, pz = (taken(part, who) for part in discs[1:])
        dx, dy = x - px, y - py
        away = np.sqrt(dx * dx + dy * dy + pz * pz) * taken(u, who)
        slow = taken(v, who)
        q.append((run[0] / slow - dx / away, run[1] / slow - dy / away))
    pull = (along[0] / v[..., 0], along[1] / v[..., 0]) if goal is None else along
    turn = _cross(q[0], q[1])
    single = binds[0] == binds[1]
    own = (pull[0] * q[0][0] + pull[1] * q[0][1]) / (q[0][0] * q[0][0] + q[0][1] * q[0][1])
    first = np.where(single, own, _cross(pull, q[1]) / turn)
    second = np.where(single, own, _cross(q[0], pull) / turn)
    every = np.arange(u.shape[-1])
    found = np.where(every == binds[1][..., None], second[..., None], 0.0)
    found = np.where(every == binds[0][..., None], first[..., None], found)
    return np.where(np.isfinite(found), np.maximum(found, 0.0), 0.0)


def excess(discs: Discs, point: Point) -> Array:
    """Return κ‖x‖² + 2 w_xy·x − ‖w‖², m²: positive outside of a disc, zero on its rim."""
    x, y = point
    power = discs.x * discs.x + discs.y * discs.y + discs.z * discs.z
    return np.asarray(discs.curvature * (x * x + y * y) + 2.0 * (discs.x * x + discs.y * y) - power)


def rim(discs: Discs, heading: Point) -> Array:
    """Return how far, m, the rim of a disc is from the evader along a heading of length 1."""
    power = discs.x * discs.x + discs.y * discs.y + discs.z * discs.z
    half = discs.x * heading[0] + discs.y * heading[1]
    root = np.sqrt(half * half + discs.curvature * power)
    ahead = half > 0
    over = np.where(ahead, half + root, discs.curvature)
    return np.asarray(np.where(ahead, power, root - half) / over)


def crossings(one: Discs, other: Discs) -> tuple[Point, Point]:
    """Return the two points where the rims of two discs cross, from the evader, m; NaN where they do not.

    They lie on a line a·x = b and on the mean of both circles. The formula uses differences of positions, which are
    exact for pursuers close to each other, and the root of the quadratic that does not cancel.
    """
    tilt = (one.curvature - other.curvature) / (one.curvature + other.curvature)
    apart = [p - q for p, q in zip(one[1:], other[1:], strict=True)]
    whole = [p + q for p, q in zip(one[1:], other[1:], strict=True)]
    a = [difference - tilt * total for difference, total in zip(apart[:2], whole[:2], strict=True)]
    # The difference of ‖w‖² is exact as a product; the sum is ½(‖w₁ + w₂‖² + ‖w₁ − w₂‖²).
    difference = apart[0] * whole[0] + apart[1] * whole[1] + apart[2] * whole[2]
    total = 0.5 * (
        (whole[0] * whole[0] + whole[1] * whole[1] + whole[2] * whole[2])
        + (apart[0] * apart[0] + apart[1] * apart[1] + apart[2] * apart[2])
    )
    length = np.sqrt(a[0] * a[0] + a[1] * a[1])
    e = a[0] / length, a[1] / length
    foot = 0.5 * (difference - tilt * total) / length
    curvature = 0.5 * (one.curvature + other.curvature)
    half = 0.5 * (whole[1] * e[0] - whole[0] * e[1])
    inside = 0.5 * total - foot * (curvature * foot + (whole[0] * e[0] + whole[1] * e[1]))
    root = half + np.copysign(np.sqrt(half * half + curvature * inside), half)
    near, far = inside / root, -root / curvature
    return (foot * e[0] - near * e[1], foot * e[1] + near * e[0]), (foot * e[0] - far * e[1], foot * e[1] + far * e[0])


def taken(array: Array, index: Array) -> Array:
    """Take one element along the last axis, (..., n) → (...)."""
    rows = index.size
    flat = array.reshape(rows, array.shape[-1])
    return np.asarray(flat[np.arange(rows), index.reshape(rows)].reshape(index.shape))


def _nearer(goal: Point, corners: tuple[Point, Point]) -> tuple[Point, Array]:
    """Return the corner nearer to a point and its distance; arbitrary if there is no corner."""
    away = [_length((corner[0] - goal[0], corner[1] - goal[1])) for corner in corners]
    second = away[1] < away[0]
    x, y = (np.where(second, corners[1][axis], corners[0][axis]) for axis in (0, 1))
    return (x, y), np.where(second, away[1], away[0])


def _numbers(count: int, i: Array, j: Array, times: int = 1) -> tuple[Array, Array]:
    """Return the numbers of the discs of each candidate: each disc alone, then the pairs, `times` over."""
    own = np.arange(count)
    return np.concatenate([own, *[i] * times]), np.concatenate([own, *[j] * times])


def _of(point: Point, index: Array) -> Point:
    return point[0][..., index], point[1][..., index]


def _cross(a: Point, b: Point) -> Array:
    return np.asarray(a[0] * b[1] - a[1] * b[0])


def _length(v: Point) -> Array:
    return np.asarray(np.sqrt(v[0] * v[0] + v[1] * v[1]))


def _unit(v: Point) -> Point:
    length = _length(v)
    return v[0] / length, v[1] / length
