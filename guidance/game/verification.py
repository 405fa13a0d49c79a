"""Check a value: its gradient, the Hamilton-Jacobi-Isaacs residual, and the angles of the paper's policies.

A function of the positions is the value of a game where the residual of eq. (10) of the paper is zero:

    min over one player, max over the other, of  V̇ + running cost,   V̇ = ∇_P V·(u + w) + ∇_E V·v + ∇_T V·v_T

In PE the pursuer minimises, and the running cost is 1. In TAD the pursuer maximises the final distance if it wins, and
minimises the distance that it is short of a capture if it loses. For NumPy; `solve` on PyTorch or JAX can be
differentiated by these libraries.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from guidance.game.arrays import Array
from guidance.game.game import Game, Winner
from guidance.game.solution import solve


class Gradient(NamedTuple):
    """Derivatives of a value by the positions of P, E and T, each (..., 3), per metre; zero for T in PE."""

    pursuer: Array
    evader: Array
    target: Array


class Angles(NamedTuple):
    """The angles of the paper's policies, (...), rad.

    Attributes:
        alpha: heading of the evader, from the x axis to the y axis; θ in PE, α in TAD, eq. (44).
        beta: heading of the pursuer; θ in PE, β in TAD, eq. (49).
        gamma: descent of the pursuer below the horizontal; φ in PE, γ in TAD.
        psi: direction from the target to the centre of the Apollonius circle, eq. (39); NaN in PE.
    """

    alpha: Array
    beta: Array
    gamma: Array
    psi: Array


def value_gradient(
    game: Game,
    pursuer: ArrayLike,
    evader: ArrayLike,
    target: ArrayLike | None = None,
    *,
    step_m: float = 1e-3,
) -> Gradient:
    """Return the gradient of `solve(...).value` by central differences, whose error falls with `step_m`⁴.

    Args:
        game: the game.
        pursuer: position P, (..., 3), m.
        evader: position E, (..., 3), m; without a derivative by its height if it moves in a plane.
        target: position T, (..., 3), m, or None for PE.
        step_m: step of the differences, m; a value that bends within it has no gradient.

    Raises:
        ConfigError: as `solve`.
    """
    places = [np.asarray(position, float) for position in (pursuer, evader)]
    if target is not None:
        places.append(np.asarray(target, float))
    places = list(np.broadcast_arrays(*places))
    slopes = [np.zeros(position.shape) for position in places]
    for number in range(len(places)):
        flat = number > 0 and game.evader_space == "plane"
        for axis in range(2 if flat else 3):
            total = np.zeros(places[0].shape[:-1])
            for steps, weight in ((1.0, 8.0), (-1.0, -8.0), (2.0, -1.0), (-2.0, 1.0)):
                moved = list(places)
                moved[number] = places[number].copy()
                moved[number][..., axis] += steps * step_m
                total = total + weight * solve(game, *moved).value
            slopes[number][..., axis] = total / (12.0 * step_m)
    if target is None:
        slopes.append(np.zeros(places[0].shape))
    return Gradient(*slopes)


def hji_residual(
    game: Game,
    pursuer: ArrayLike,
    evader: ArrayLike,
    target: ArrayLike | None = None,
    *,
    step_m: float = 1e-3,
) -> Array:
    """Return the Hamilton-Jacobi-Isaacs residual, (...): in PE a pure number, in TAD in m/s; zero for a value.

    Args:
        game: the game.
        pursuer: position P, (..., 3), m.
        evader: position E, (..., 3), m.
        target: position T, (..., 3), m, or None for PE.
        step_m: step of the differences, m.

    Raises:
        ConfigError: as `solve`.
    """
    gradient = value_gradient(game, pursuer, evader, target, step_m=step_m)
    wind = np.array([*game.wind_m_s, 0.0])
    drift = np.array([*game.target_velocity_m_s, 0.0])
    carried = gradient.pursuer @ wind + gradient.target @ drift
    evading = game.evader_speed_m_s * np.linalg.norm(gradient.evader, axis=-1)
    if target is None:
        return 1.0 + carried + evading - game.pursuer.support(-gradient.pursuer)
    won = solve(game, pursuer, evader, target).winner == Winner.PURSUER
    sign = np.where(won, 1.0, -1.0)
    pursuing = game.pursuer.support(sign[..., None] * gradient.pursuer)
    return np.asarray(carried + sign * (pursuing - evading))


def angles(
    game: Game, pursuer: ArrayLike, evader: ArrayLike, target: ArrayLike | None = None
) -> Angles:
    """Return the angles of both optimal velocities, and of the centre of the Apollonius circle.

    Args:
        game: the game.
        pursuer: position P, (..., 3), m.
        evader: position E, (..., 3), m.
        target: position T, (..., 3), m, or None for PE.

    Raises:
        ConfigError: as `solve`.
    """
    answer = solve(game, pursuer, evader, target)
    velocity = answer.pursuer_velocity_m_s
    run = answer.evader_velocity_m_s
    beta = np.arctan2(velocity[..., 1], velocity[..., 0])
    psi = np.full(beta.shape, np.nan)
    if target is not None:
        speed_ratio = game.pursuer.horizontal_m_s / game.evader_speed_m_s
        scaled = speed_ratio * speed_ratio * (np.asarray(evader, float) - target)
        from_target = scaled - (np.asarray(pursuer, float) - target)
        psi = np.arctan2(from_target[..., 1], from_target[..., 0])
    return Angles(
        alpha=np.arctan2(run[..., 1], run[..., 0]),
        beta=beta,
        gamma=np.arctan2(-velocity[..., 2], np.hypot(velocity[..., 0], velocity[..., 1])),
        psi=psi,
    )
