"""The Apollonius circle, the sphere of the paper's remark, and the barrier (Li, Wang & Xie, sections II-B and IV-A)."""

from typing import NamedTuple

from guidance.errors import ConfigError
from guidance.game.arrays import Array, Real, component, namespace
from guidance.game.checks import is_array, is_finite


class Apollonius(NamedTuple):
    """The points that both players reach at the same time.

    Attributes:
        centre_m: (..., 3); of the circle in the evader's plane.
        radius_m: (...).
    """

    centre_m: Array
    radius_m: Array


def apollonius_circle(pursuer: Array, evader: Array, speed_ratio: Real) -> Apollonius:
    """Return the circle in the evader's plane, of the points (x, y, 0) with ‖X − P‖ = δ‖X − E‖.

    Its centre is (δ² E − P_xy)/(δ² − 1), its radius √(z²/(δ² − 1) + δ² d²/(δ² − 1)²): the section of
    `apollonius_sphere` with the plane.

    Args:
        pursuer: position P, (..., 3), m.
        evader: position E, (..., 3), m.
        speed_ratio: δ = u/v > 1.

    Raises:
        ConfigError: δ is not a finite number above 1.
    """
    centre, hand = _centre(pursuer, evader, speed_ratio), speed_ratio * speed_ratio - 1.0
    xp = namespace(pursuer, evader)
    w = pursuer - evader
    x, y, z = (component(w, index) for index in range(3))
    radius = xp.sqrt(z * z * hand + speed_ratio * speed_ratio * (x * x + y * y)) / hand
    foot = xp.stack((centre[..., 0], centre[..., 1], 0.0 * centre[..., 2] + evader[..., 2]), axis=-1)
    return Apollonius(foot, radius)


def apollonius_sphere(pursuer: Array, evader: Array, speed_ratio: Real) -> Apollonius:
    """Return the sphere for an evader in space: c = (δ² E − P)/(δ² − 1), r = δ‖P − E‖/(δ² − 1).

    Args:
        pursuer: position P, (..., 3), m.
        evader: position E, (..., 3), m.
        speed_ratio: δ = u/v > 1.

    Raises:
        ConfigError: δ is not a finite number above 1.
    """
    centre = _centre(pursuer, evader, speed_ratio)
    xp = namespace(pursuer, evader)
    w = pursuer - evader
    x, y, z = (component(w, index) for index in range(3))
    hand = speed_ratio * speed_ratio - 1.0
    return Apollonius(centre, speed_ratio * xp.sqrt(x * x + y * y + z * z) / hand)


def barrier(pursuer: Array, evader: Array, target: Array, speed_ratio: Real) -> Array:
    """Return B = δ²‖E − T‖² − ‖P − T‖², m² (section IV-A): positive where the pursuer wins, else the evader.

    It belongs to the paper's own game; `Solution.margin_s` is the same line drawn in every game, in seconds.
    """
    to_evader, to_pursuer = evader - target, pursuer - target
    near = sum(component(to_evader, index) * component(to_evader, index) for index in range(3))
    far = sum(component(to_pursuer, index) * component(to_pursuer, index) for index in range(3))
    return speed_ratio * speed_ratio * near - far


def _centre(pursuer: Array, evader: Array, speed_ratio: Real) -> Array:
    if not is_array(speed_ratio) and not (is_finite(speed_ratio) and speed_ratio > 1):
        raise ConfigError(f"speed_ratio = {speed_ratio!r}: must be a finite number above 1")
    squared = speed_ratio * speed_ratio
    if is_array(squared):
        squared = squared[..., None]
    return (squared * evader - pursuer) / (squared - 1.0)
