"""The Apollonius circle, the sphere of the paper's remark, the barrier, and what a race to a target comes to.

Li, Wang & Xie, sections II-B and IV. What the paper writes in δ is computed from both speeds, its fractions multiplied
by v², so that δ² − 1 = (u − v)(u + v)/v² keeps its digits as δ → 1.
"""

from typing import NamedTuple

from numpy.typing import ArrayLike

from guidance.errors import ConfigError
from guidance.game.arrays import (
    Array,
    Library,
    Plane,
    Real,
    component,
    dot2,
    is_array,
    norm2,
    root,
    select,
    select2,
    unit2,
    vectors,
)
from guidance.game.records import is_finite


class Apollonius(NamedTuple):
    """The points that both players reach at the same time.

    Attributes:
        centre_m: (..., 3); of the circle in the evader's plane.
        radius_m: (...).
    """

    centre_m: Array
    radius_m: Array


class Race(NamedTuple):
    """What both players' race to a target comes to in the paper's game.

    Attributes:
        margin: B as a time: how much sooner the pursuer can be there, s.
        final_distance: L, m; negative where the evader wins.
        run: vector from E to g*, the point of the circle closest to the target, m.
    """

    margin: Array
    final_distance: Array
    run: Plane


def apollonius_circle(pursuer: ArrayLike, evader: ArrayLike, speed_ratio: Real) -> Apollonius:
    """Return the circle in the evader's plane: the points (x, y, 0) with ‖X − P‖ = δ‖X − E‖, eqs. (4), (5).

    Its centre is (δ² E − P_xy)/(δ² − 1), eq. (6), its radius √(z²/(δ² − 1) + δ² d²/(δ² − 1)²), eq. (7): the section of
    `apollonius_sphere` with the plane.

    Args:
        pursuer: position P, (..., 3), m.
        evader: position E, (..., 3), m.
        speed_ratio: δ = u/v > 1.

    Raises:
        ConfigError: δ is not a finite number above 1.
    """
    xp, P, E, ratio = _given(pursuer, evader, speed_ratio)
    centre, hand = _centre(P, E, ratio), (ratio - 1.0) * (ratio + 1.0)
    w = P - E
    x, y, z = (component(w, index) for index in range(3))
    radius = root(xp, z * z * hand + ratio * ratio * (x * x + y * y)) / hand
    foot = xp.stack((centre[..., 0], centre[..., 1], 0.0 * centre[..., 2] + E[..., 2]), axis=-1)
    return Apollonius(foot, radius)


def apollonius_sphere(pursuer: ArrayLike, evader: ArrayLike, speed_ratio: Real) -> Apollonius:
    """Return the sphere for an evader in space: c = (δ² E − P)/(δ² − 1), r = δ‖P − E‖/(δ² − 1).

    Args:
        pursuer: position P, (..., 3), m.
        evader: position E, (..., 3), m.
        speed_ratio: δ = u/v > 1.

    Raises:
        ConfigError: δ is not a finite number above 1.
    """
    xp, P, E, ratio = _given(pursuer, evader, speed_ratio)
    w = P - E
    x, y, z = (component(w, index) for index in range(3))
    hand = (ratio - 1.0) * (ratio + 1.0)
    return Apollonius(_centre(P, E, ratio), ratio * root(xp, x * x + y * y + z * z) / hand)


def barrier(pursuer: ArrayLike, evader: ArrayLike, target: ArrayLike, speed_ratio: Real) -> Array:
    """Return B = δ²‖E − T‖² − ‖P − T‖², m², of eqs. (33) and (34): positive where the pursuer wins, else the evader.

    It belongs to the paper's own game; `Solution.margin_s` is the same line drawn in every game, in seconds.

    Args:
        pursuer: position P, (..., 3), m.
        evader: position E, (..., 3), m.
        target: position T, (..., 3), m.
        speed_ratio: δ = u/v.
    """
    _, taken = vectors({"pursuer": pursuer, "evader": evader, "target": target})
    to_evader, to_pursuer = taken["evader"] - taken["target"], taken["pursuer"] - taken["target"]
    near = sum(component(to_evader, index) * component(to_evader, index) for index in range(3))
    far = sum(component(to_pursuer, index) * component(to_pursuer, index) for index in range(3))
    return speed_ratio * speed_ratio * near - far


def race(xp: Library, speeds: tuple[Real, Real], to_evader: Plane, z: Real, to_target: Plane) -> Race:
    """Return how the race for a target ends in the paper's game.

    L = ‖c − T‖ − r = d_δ/(δ² − 1) − r, eq. (41), is the difference of two lengths that grow without bound as δ → 1.
    Times their sum it is the barrier B over δ² − 1, which cancels nothing and is zero exactly where B is:

        L = B / (d_δ + √((δ² − 1) z² + δ² d²))

    Args:
        xp: array library.
        speeds: u and v, m/s.
        to_evader: horizontal vector from P to E, m.
        z: height of P above E's plane, m.
        to_target: horizontal vector from E to T, m.
    """
    u, v = speeds
    hand = (u - v) * (u + v)
    from_target = (v * v * to_evader[0] - hand * to_target[0], v * v * to_evader[1] - hand * to_target[1])
    d_delta = norm2(xp, from_target)
    span = v * root(xp, hand * (z * z) + (u * u) * dot2(to_evader, to_evader))
    way = (to_evader[0] + to_target[0], to_evader[1] + to_target[1])
    near, far = dot2(to_target, to_target), dot2(way, way) + z * z
    b = (u * u) * near - (v * v) * far
    left = root(xp, near)
    both = u * left + v * root(xp, far)
    direction = unit2(xp, from_target, d_delta)
    final = b / select(xp, b == 0, 1.0, d_delta + span)
    # g* from E's side of the circle, or from T: whichever is the shorter way, and so the one that loses fewer digits
    by_target = span > hand * left
    scale = span / hand
    centre = (v * v / hand * to_evader[0], v * v / hand * to_evader[1])
    base = select2(xp, by_target, to_target, centre)
    length = select(xp, by_target, final, -scale)
    run = (base[0] + length * direction[0], base[1] + length * direction[1])
    return Race(b / (u * v * select(xp, b == 0, 1.0, both)), final, run)


def _given(pursuer: ArrayLike, evader: ArrayLike, speed_ratio: Real) -> tuple[Library, Array, Array, Real]:
    xp, taken = vectors({"pursuer": pursuer, "evader": evader})
    if not is_array(speed_ratio):
        if not (is_finite(speed_ratio) and speed_ratio > 1):
            raise ConfigError(f"speed_ratio = {speed_ratio!r}: must be a finite number above 1")
        speed_ratio = float(speed_ratio)
    return xp, taken["pursuer"], taken["evader"], speed_ratio


def _centre(P: Array, E: Array, ratio: Array) -> Array:
    hand = (ratio - 1.0) * (ratio + 1.0)
    if is_array(hand):
        ratio, hand = ratio[..., None], hand[..., None]
    return (ratio * ratio * E - P) / hand
