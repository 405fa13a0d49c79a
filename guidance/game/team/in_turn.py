"""Two captures that one pursuer surely makes in turn, for any play of both evaders: a lower bound.

A pursuer flies parallel: it keeps the direction r from an evader to itself and closes along it at the rate

    κ(w) = w·r + √(u² − ‖w − (w·r) r‖²)

while the evader runs with w (Petrov's strategy of parallel pursuit). κ is concave in w and at least u − v. The capture
comes when the integral of κ is the distance less the capture radius l, and the evader is then where the integral of w
has taken it. For a measure of velocities with that integral of κ, the time of the capture t and the pursuer's place Y
then are linear in the measure. So t + ‖Y − T‖/u is convex in it, and largest at an extreme point: one velocity that is
kept. Then the pursuer flies straight to Y, and Y lies in the Apollonius disc of the pursuer and the evader moved by
l r. So for any play of the first evader, the pursuer can have captured it and be at the target T within

    max over Y of that disc of (‖Y − P‖ + ‖Y − T‖)/u,

which the edge of the disc attains. If a second evader needs longer to its target, less l/u for the capture there, the
pursuer wins against it from Y: the one that can be at the target first wins (Li, Wang & Xie, section IV). The first
evader never gets to its own target if that lies outside its disc.

This holds for a `Ball` without a disc to stand off, in calm air, and for targets that are points at rest. Velocities
that are held and seen a step late cost up to a few steps of both players' way.
"""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from guidance.game.arrays import Array
from guidance.game.game import NO_WIND, Game
from guidance.game.policies import Known
from guidance.game.records import is_zero

_TRIED: Final = 48
"""Points of the disc's edge that are tried; the longest way has at most two maxima along it."""

_CLOSER: Final = 9
_ROUNDS: Final = 5
"""Points around each of the two best ones in each further round, and rounds: the way is found to 1e-8 of the disc."""


def can_be_in_turn(game: Game) -> bool:
    """Return whether the bound holds for a game."""
    is_point = game.target_extent.is_point and game.target_velocity_m_s == NO_WIND
    free = game.calm and is_zero(game.standoff.radius_m)
    return is_point and free and game.pursuer.isotropic


def way_by_a_capture(  # noqa: PLR0914
    game: Game, P: Array, E: Array, own: Array, T: Array
) -> Array:
    """Return the longest way of pursuers to the capture of an evader and from there to a target, (...), m.

    Args:
        game: numbers are single or (...).
        P: positions of the pursuers, (..., 3), m.
        E: positions of the evaders, (..., 3), m.
        own: targets of these evaders, (..., 3), m.
        T: targets to which the pursuers fly then, (..., 3), m.

    Returns:
        The way; infinite where the evader could reach its own target first.
    """
    u = game.pursuer.horizontal_m_s
    ratio = np.asarray(u / game.evader_speed_m_s)
    capture = np.asarray(game.capture_radius_m)
    up = np.array([0.0, 0.0, 1.0])
    height = np.asarray(game.standoff.height_m)[..., None]
    w = P - E - height * up
    away = np.sqrt(np.sum(w**2, axis=-1))
    share = np.minimum(capture / np.where(away > 0.0, away, 1.0), 1.0)
    moved = share[..., None] * w
    q = w - moved
    level = np.sqrt(q[..., 0] ** 2 + q[..., 1] ** 2)
    hand = (ratio - 1.0) * (ratio + 1.0)
    radius = np.sqrt(q[..., 2] ** 2 / hand + (ratio * level / hand) ** 2)
    centre = moved[..., :2] - q[..., :2] / hand[..., None]
    to_target = T - E

    def way(angle: Array) -> Array:
        x = centre[..., None, 0] + radius[..., None] * np.cos(angle)
        y = centre[..., None, 1] + radius[..., None] * np.sin(angle)
        out = (x - w[..., None, 0]) ** 2 + (y - w[..., None, 1]) ** 2 + q[..., None, 2] ** 2
        back_x = x - to_target[..., None, 0]
        back_y = y - to_target[..., None, 1]
        return np.sqrt(out) + np.sqrt(back_x**2 + back_y**2 + moved[..., None, 2] ** 2)

    shape = np.broadcast_shapes(radius.shape, to_target.shape[:-1])
    angle = np.broadcast_to(np.arange(_TRIED) * (2.0 * np.pi / _TRIED), (*shape, _TRIED))
    ways = way(angle)
    is_maximum = (ways >= np.roll(ways, 1, axis=-1)) & (ways >= np.roll(ways, -1, axis=-1))
    best = np.argsort(np.where(is_maximum, -ways, 0.0), axis=-1)[..., :2]
    middle = np.take_along_axis(angle, best, axis=-1)
    step = 2.0 * np.pi / _TRIED
    shares = np.linspace(-1.0, 1.0, _CLOSER)
    for _ in range(_ROUNDS):
        near = middle[..., None] + step * shares
        ways = way(near.reshape(*shape, 2 * _CLOSER)).reshape(near.shape)
        middle = np.take_along_axis(near, np.argmax(ways, axis=-1)[..., None], axis=-1)[..., 0]
        step *= 2.0 / (_CLOSER - 1)
    longest = ways.max(axis=(-2, -1))
    to_own = own - E
    guarded = np.sqrt(np.sum((to_own + moved - w) ** 2, axis=-1))
    run = np.sqrt(np.sum(to_own[..., :2] ** 2, axis=-1))
    return np.asarray(np.where(guarded < ratio * run, longest, np.inf))


def parallel_policy(
    game: Game,
    pursuer: ArrayLike,
    evader: ArrayLike,
    target: Known = None,  # noqa: ARG001 - as `Policy`
    evader_velocity_m_s: Known = None,
) -> Array:
    """Return the velocities of pursuers that fly parallel to evaders: a `Policy` that needs the evader's velocity."""
    E = np.asarray(evader)
    run_m_s = np.asarray(evader_velocity_m_s)
    u = np.asarray(game.pursuer.horizontal_m_s)
    up = np.array([0.0, 0.0, 1.0])
    r = np.asarray(pursuer) - E - np.asarray(game.standoff.height_m)[..., None] * up
    away = np.sqrt(np.sum(r**2, axis=-1, keepdims=True))
    r = np.where(away > 0.0, r / np.where(away > 0.0, away, 1.0), up)
    along = np.sum(run_m_s * r, axis=-1)
    across = np.sum(run_m_s**2, axis=-1) - along**2
    closing = along + np.sqrt(np.maximum(u**2 - across, 0.0))
    return np.asarray(run_m_s - closing[..., None] * r)
