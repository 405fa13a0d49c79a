"""The Apollonius circle, the barrier, and the sphere: the game of an evader that moves in all three dimensions.

Li, Wang & Xie, sections II-B and IV, in the paper's own δ. `solve` uses `tad.race` for the circle.

The evader in space is from the paper's remark. P, E and T lie in one plane and neither player gains by leaving it, so
the game is the planar one (z_P = 0) in that plane; its circle is the section of the sphere. The state is transformed
into the plane, with the first axis from E to T (PE: from P to E), solved there, and the answer is transformed back. If
all three are on one line, the second axis is a rounding error; its component along the first is removed, so that no
velocity exceeds its bound.
"""

from typing import NamedTuple

from numpy.typing import ArrayLike

from guidance.errors import ConfigError
from guidance.game.arrays import (
    Array,
    Library,
    Real,
    Space,
    components,
    dot3,
    is_array,
    plus3,
    times3,
    vectors,
)
from guidance.game.game import Game
from guidance.game.pe import Geometry, StateSolution, pursuit
from guidance.game.records import is_finite
from guidance.game.tad import defence


class Apollonius(NamedTuple):
    """The points that both players reach at the same time.

    Attributes:
        centre_m: (..., 3); of the circle in the evader's plane.
        radius_m: (...).
    """

    centre_m: Array
    radius_m: Array


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
    xp, E, (x, y, z), ratio, hand, centre = _sphere(pursuer, evader, speed_ratio)
    level_square = x * x + y * y
    radius = xp.sqrt(z * z * hand + ratio * ratio * level_square) / hand
    ground = 0.0 * centre[..., 2] + E[..., 2]
    foot = xp.stack((centre[..., 0], centre[..., 1], ground), axis=-1)
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
    xp, _, away, ratio, hand, centre = _sphere(pursuer, evader, speed_ratio)
    return Apollonius(centre, ratio * xp.norm3(away) / hand)


def barrier(pursuer: ArrayLike, evader: ArrayLike, target: ArrayLike, speed_ratio: Real) -> Array:
    """Return B = δ²‖E − T‖² − ‖P − T‖², m², of eqs. (33) and (34): positive where the pursuer wins, else the evader.

    It belongs to the paper's game; `Solution.margin_s` is the barrier of every game, in seconds.

    Args:
        pursuer: position P, (..., 3), m.
        evader: position E, (..., 3), m.
        target: position T, (..., 3), m.
        speed_ratio: δ = u/v.
    """
    _, taken = vectors({"pursuer": pursuer, "evader": evader, "target": target})
    T = taken["target"]
    near = components(taken["evader"] - T)
    far = components(taken["pursuer"] - T)
    return speed_ratio * speed_ratio * dot3(near, near) - dot3(far, far)


def _sphere(
    pursuer: ArrayLike, evader: ArrayLike, ratio: Array
) -> tuple[Library, Array, Space, Array, Array, Array]:
    """Return the library, E, the components of P − E, δ, δ² − 1 and the centre of the sphere."""
    xp, taken = vectors({"pursuer": pursuer, "evader": evader})
    P = taken["pursuer"]
    E = taken["evader"]
    if not is_array(ratio):
        if not (is_finite(ratio) and ratio > 1):
            raise ConfigError(f"speed_ratio = {ratio!r}: must be a finite number above 1")
        ratio = float(ratio)
    hand = (ratio - 1.0) * (ratio + 1.0)
    factor = ratio
    divisor = hand
    if is_array(ratio):
        factor = ratio[..., None]
        divisor = hand[..., None]
    centre = (factor * factor * E - P) / divisor
    return xp, E, components(P - E), ratio, hand, centre


def play_in_space(
    xp: Library, game: Game, P: Space, E: Space, T: Space | None, observed: Space | None
) -> StateSolution:
    """Solve the game of an evader in space; see `solve` for the meaning of the answer.

    Args:
        xp: array library.
        game: of the set Ball, with an evader in space.
        P: position of the pursuer, m.
        E: position of the evader, m.
        T: position of the target, m, or None for PE.
        observed: the evader's observed velocity, m/s, or None.
    """
    to_evader = plus3(E, -1.0, P)
    first, far = _direction(xp, to_evader if T is None else plus3(T, -1.0, E))
    along = dot3(to_evader, first)
    second, across = _direction(xp, plus3(to_evader, -along, first))
    second = plus3(second, -dot3(second, first), first)
    zero = 0.0 * along
    state = Geometry((zero, zero), zero, (along, zero if T is None else across), zero, (0.0, 0.0))
    play = pursuit(xp, game, state) if T is None else defence(xp, game, state, (far, zero))

    def unfold(v: Space) -> Space:
        return plus3(times3(v[0], first), v[1], second)

    meeting = plus3(E, 1.0, unfold(play.meeting_point_m))
    velocity = unfold(play.pursuer_velocity_m_s)
    if observed is not None:  # a captured evader is followed, at most at its speed bound
        direction, length = _direction(xp, observed)
        pace = xp.select(length > game.evader_speed_m_s, game.evader_speed_m_s, length)
        velocity = xp.select_all(play.meeting_time_s <= 0, times3(pace, direction), velocity)
    evading = unfold(play.evader_velocity_m_s)
    return play._replace(
        meeting_point_m=meeting, pursuer_velocity_m_s=velocity, evader_velocity_m_s=evading
    )


def _direction(xp: Library, v: Space) -> tuple[Space, Real]:
    """Direction and length; the x axis where the length is zero."""
    length = xp.norm3(v)
    nonzero = length > 0
    x, y, z = times3(1.0 / xp.select(nonzero, length, 1.0), v)
    return (xp.select(nonzero, x, 1.0), y, z), length
