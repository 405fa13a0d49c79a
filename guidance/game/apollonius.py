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
from guidance.game.arrays import Array, Library, Real, Space, Truth, components, dot3, is_array, plus3, times3, vectors
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
    xp, P, E, ratio = _given(pursuer, evader, speed_ratio)
    centre, hand = _centre(P, E, ratio), (ratio - 1.0) * (ratio + 1.0)
    x, y, z = components(P - E)
    radius = xp.sqrt(z * z * hand + ratio * ratio * (x * x + y * y)) / hand
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
    return Apollonius(_centre(P, E, ratio), ratio * xp.norm3(components(P - E)) / ((ratio - 1.0) * (ratio + 1.0)))


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
    near, far = (components(taken[name] - taken["target"]) for name in ("evader", "pursuer"))
    return speed_ratio * speed_ratio * dot3(near, near) - dot3(far, far)


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


def play_in_space(xp: Library, game: Game, P: Space, E: Space, T: Space | None, seen: Space | None) -> StateSolution:
    """StateSolution the game of an evader in space; see `solve` for the meaning of the answer.

    Args:
        xp: array library.
        game: of the set Ball, with an evader in space.
        P: position of the pursuer, m.
        E: position of the evader, m.
        T: position of the target, m, or None for PE.
        seen: the evader's observed velocity, m/s, or None.
    """
    to_evader = plus3(E, -1.0, P)
    first, far = _unit(xp, to_evader if T is None else plus3(T, -1.0, E))
    along = dot3(to_evader, first)
    second, across = _across(xp, to_evader, first, along)
    zero, still = 0.0 * along, (0.0, 0.0)
    if T is None:
        state = Geometry((zero, zero), zero, (along, zero), zero, None, still)
        play = pursuit(xp, game, state)
    else:
        state = Geometry((zero, zero), zero, (along, across), zero, None, still)
        play = defence(xp, game, state, (far, zero))

    def unfold(v: Space) -> Space:
        return plus3(times3(v[0], first), v[1], second)

    meeting = plus3(E, 1.0, unfold(play.meeting_point_m))
    flown = unfold(play.pursuer_velocity_m_s)
    if seen is not None:
        flown = _follow(xp, game, play.meeting_time_s <= 0, seen, flown)
    evading = unfold(play.evader_velocity_m_s)
    return play._replace(meeting_point_m=meeting, pursuer_velocity_m_s=flown, evader_velocity_m_s=evading)


def _across(xp: Library, v: Space, first: Space, along: Real) -> tuple[Space, Real]:
    """Return the direction and length of a vector's component across the first axis."""
    second, across = _unit(xp, plus3(v, -along, first))
    return plus3(second, -dot3(second, first), first), across


def _follow(xp: Library, game: Game, caught: Truth, seen: Space, flown: Space) -> Space:
    """Follow a captured evader, at most at its speed bound."""
    direction, length = _unit(xp, seen)
    pace = xp.select(length > game.evader_speed_m_s, game.evader_speed_m_s, length)
    return xp.select_all(caught, times3(pace, direction), flown)


def _unit(xp: Library, v: Space) -> tuple[Space, Real]:
    """Direction and length; the x axis where the length is zero."""
    length = xp.norm3(v)
    some = length > 0
    x, y, z = times3(1.0 / xp.select(some, length, 1.0), v)
    return (xp.select(some, x, 1.0), y, z), length
