"""Gradients of the values by the positions of players and target, and the Hamilton-Jacobi-Isaacs residual.

Every game in the plane has its gradient here in closed form. With t_P(X) the pursuer's time to have an evader at X
captured and t_E(X) the evader's time to X, a value is the extremum of an objective over the edge t_P = t_E of the
evader's region, and its multiplier λ gives the gradient at once (the envelope theorem). PE, objective t_E:
∇_P V = λ ∇_P t_P and ∇_E V = (1 − λ) ∇_E t_E, with λ = 1/(1 − v n·∇_X t_P). TAD, objective ‖X − T‖: ∇_P V = λ ∇_P t_P
and ∇_E V = −λ ∇_E t_E. In the paper's game these are its derivatives ∂V/∂x_P … ∂V/∂y_E, eqs. (23) to (27) and (54) to
(58).

Any value function is the game's where its Hamilton-Jacobi-Isaacs residual is zero (eq. (10) of the paper):

    min over one player, max over the other, of  V̇ + running cost,   V̇ = ∇_P V·(u + w) + ∇_E V·v + ∇_T V·v_T

PE: the pursuer minimises, the evader maximises, the running cost is 1 (seconds per second). TAD, the pursuer wins: it
maximises the final distance and the evader minimises it, without running cost. TAD, the evader wins: the other way
round, and the value is the distance that the pursuer is short of a capture. The extreme point of a speed set in a
direction is known in closed form, so the residual needs only the gradient.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from array_api_compat import is_torch_array
from numpy.typing import ArrayLike

from guidance.game import Ball, Cylinder
from guidance.game.arrays import Array, Library, Plane, Space, component, components, dot2, vectors
from guidance.game.game import Game
from guidance.game.pe import Geometry, take_apart
from guidance.game.rows import leading_shape
from guidance.game.solution import Solution, solve

ValueFunction: TypeAlias = Callable[[Array, Array, Array | None], Array]
"""Value of the positions of P, E and T, (..., 3) each, or of P, E and None; (...)."""


class Gradient(NamedTuple):
    """Derivatives of a value with respect to the positions, each (..., 3); per metre."""

    pursuer: Array
    evader: Array
    target: Array


def value_gradient(
    game: Game, pursuer: ArrayLike, evader: ArrayLike, target: ArrayLike | None = None
) -> Gradient:
    """Return the gradient of `solve(...).value` in the plane; zero for the target in PE.

    It is zero for positions that do not matter, too. On the barrier it is that of the evader's side: from the other,
    the meeting point lies in no direction from T.

    Args:
        game: the game.
        pursuer: position P, (..., 3), m.
        evader: position E, (..., 3), m.
        target: position T, (..., 3), m, or None for PE.
    """
    xp, given = vectors(
        {"pursuer": pursuer, "evader": evader} | ({} if target is None else {"target": target})
    )
    shape = leading_shape(game, given)
    like = given["pursuer"]
    solution = solve(game, like, given["evader"], given.get("target"))
    with np.errstate(all="ignore"):
        state = take_apart(xp, game, components(like), components(given["evader"]), None)
        by_pursuer, by_evader, by_target = _by_regime(
            xp, game, state, solution, given.get("target")
        )
    return Gradient(
        xp.pack(shape, like, by_pursuer),
        xp.pack(shape, like, (*by_evader, 0.0)),
        xp.pack(shape, like, (*by_target, 0.0)),
    )


def _by_regime(
    xp: Library, game: Game, state: Geometry, solution: Solution, target: Array | None
) -> tuple[Space, Plane, Plane]:
    meeting = (component(solution.meeting_point_m, 0), component(solution.meeting_point_m, 1))
    run = (meeting[0] - state.evader[0], meeting[1] - state.evader[1])
    t = solution.meeting_time_s
    n = xp.unit2(run, xp.norm2(run))
    p, lift = _by_meeting_point(xp, game, state, run, t)
    v = game.evader_speed_m_s
    if target is None:
        weight = 1.0 / (1.0 - v * dot2(n, p))
        pull = (weight - 1.0) / v
        return _pursuer(weight, p, lift), (pull * n[0], pull * n[1]), (0.0 * t, 0.0 * t)
    adrift = game.target_velocity_m_s
    to_target = (component(target, 0) - state.evader[0], component(target, 1) - state.evader[1])
    left = (run[0] - to_target[0] - adrift[0] * t, run[1] - to_target[1] - adrift[1] * t)
    f = xp.unit2(left, xp.norm2(left))
    carried = dot2(f, adrift) / v
    objective = (f[0] - carried * n[0], f[1] - carried * n[1])
    normal = (p[0] - n[0] / v, p[1] - n[1] / v)
    weight = -dot2(objective, normal) / dot2(normal, normal)
    pull = carried + weight / v
    lost = solution.winner <= 0
    short = _short(xp, game, state, run, t)
    return (
        _select3(xp, lost, short[0], _pursuer(weight, p, lift)),
        xp.select2(lost, short[1], (pull * n[0], pull * n[1])),
        xp.select2(lost, short[2], (-f[0], -f[1])),
    )


def _pursuer(weight: Array, p: Plane, lift: Array) -> Space:
    return -weight * p[0], -weight * p[1], weight * lift


def _select3(xp: Library, condition: Array, yes: Space, no: Space) -> Space:
    return *xp.select2(condition, (yes[0], yes[1]), (no[0], no[1])), xp.select(
        condition, yes[2], no[2]
    )


def _sign(xp: Library, z: Array) -> Array:
    return xp.select(z > 0, 1.0, -1.0)


def _by_meeting_point(
    xp: Library, game: Game, state: Geometry, run: Plane, t: Array
) -> tuple[Plane, Array]:
    """Return ∇_X t_P in the plane and ∂t_P/∂z_P, s/m, at the end of the evader's run."""
    wind = game.wind_m_s
    y = (state.to_evader[0] + run[0] - wind[0] * t, state.to_evader[1] + run[1] - wind[1] * t)
    length = xp.norm2(y)
    e = xp.unit2(y, length)
    if isinstance(game.pursuer, Cylinder):
        rate = 1.0 / (game.pursuer.horizontal_m_s + dot2(e, wind))
        above = t <= xp.maximum(game.pursuer.level_time(xp, game.capture_radius_m, state.z), 0.0)
        lift = _sign(xp, state.z) / abs(game.pursuer.vertical(xp, (0.0, 0.0), state.z))
        return xp.select2(above, (0.0, 0.0), (rate * e[0], rate * e[1])), xp.select(
            above, lift, 0.0
        )
    reach = xp.maximum(length - game.standoff.radius_m, 0.0)
    distance = xp.norm2((reach, state.z))
    rate = 1.0 / (game.pursuer.horizontal_m_s * distance + reach * dot2(e, wind))
    return (rate * reach * e[0], rate * reach * e[1]), rate * state.z


def _short(
    xp: Library, game: Game, state: Geometry, goal: Plane, t: Array
) -> tuple[Space, Plane, Plane]:
    """Return the gradients of the distance that the pursuer is short of where the evader wins, at its arrival t."""
    wind = game.wind_m_s
    adrift = game.target_velocity_m_s
    v = game.evader_speed_m_s
    y = (state.to_evader[0] + goal[0] - wind[0] * t, state.to_evader[1] + goal[1] - wind[1] * t)
    length = xp.norm2(y)
    e = xp.unit2(y, length)
    n = xp.unit2(goal, xp.norm2(goal))
    beside = length - game.standoff.radius_m
    above = abs(state.z)
    if isinstance(game.pursuer, Cylinder):
        fall = abs(game.pursuer.vertical(xp, (0.0, 0.0), state.z))
        beside = beside - game.capture_radius_m - game.pursuer.horizontal_m_s * t
        above = xp.maximum(above - game.capture_radius_m - fall * t, 0.0)
    beside = xp.maximum(beside, 0.0)
    distance = xp.norm2((beside, above))
    share = beside / distance
    rise = above / distance
    if isinstance(game.pursuer, Cylinder):
        closing = share * game.pursuer.horizontal_m_s + rise * fall
    else:
        closing = game.pursuer.horizontal_m_s
    by_time = share * (dot2(e, adrift) - dot2(e, wind)) - closing
    later = by_time / (v - dot2(n, adrift))
    return (
        (-share * e[0], -share * e[1], rise * _sign(xp, state.z)),
        (-later * n[0], -later * n[1]),
        (share * e[0] + later * n[0], share * e[1] + later * n[1]),
    )


def automatic_residual(
    game: Game, pursuer: Array, evader: Array, target: Array | None = None
) -> Array:
    """Return the residual at every state, (...), by automatic differentiation: in PE a pure number, in TAD in m/s.

    Args:
        game: the game.
        pursuer: position P, (..., 3), m, an array of PyTorch or JAX.
        evader: position E, (..., 3), m.
        target: position T, (..., 3), m, or None for PE.
    """
    xp, _ = vectors({"pursuer": pursuer, "evader": evader})
    asked = lambda P, E, T: solve(game, P, E, T).value  # noqa: E731
    gradient = automatic_gradient(asked, pursuer, evader, target)
    if target is None:
        return 1.0 + _drift(game, gradient) + _saddle(xp, game, gradient, 1.0)
    minimises = xp.select(solve(game, pursuer, evader, target).winner > 0, -1.0, 1.0)
    return _drift(game, gradient) + minimises * _saddle(xp, game, gradient, minimises)


def automatic_gradient(
    value: ValueFunction, pursuer: Array, evader: Array, target: Array | None
) -> Gradient:
    """Differentiate by the array library.

    Args:
        value: any function of the positions, in operations of the library.
        pursuer: position P, (..., 3), m, an array of PyTorch or JAX.
        evader: position E, (..., 3), m.
        target: position T, (..., 3), m, or None for PE.
    """
    given: list[Any] = [array for array in (pursuer, evader, target) if array is not None]
    if is_torch_array(pursuer):
        leaves = [array.detach().requires_grad_() for array in given]
        value(*leaves, *([] if target is not None else [None])).sum().backward()
        slopes = [leaf.grad for leaf in leaves]
    else:
        total = lambda *arrays: value(*arrays, *([] if target is not None else [None])).sum()  # noqa: E731
        slopes = list(import_module("jax").grad(total, argnums=tuple(range(len(given))))(*given))
    return Gradient(slopes[0], slopes[1], slopes[2] if target is not None else 0.0 * pursuer)


def _drift(game: Game, gradient: Gradient) -> Array:
    """Change of the value by wind and moving target alone."""
    return dot2(_plane(gradient.pursuer), game.wind_m_s) + dot2(
        _plane(gradient.target), game.target_velocity_m_s
    )


def _saddle(xp: Library, game: Game, gradient: Gradient, minimises: Array) -> Array:
    """Change of the value by both optimal velocities, with the sign for a minimising pursuer."""
    x, y, z = (-minimises * component(gradient.pursuer, index) for index in range(3))
    if isinstance(game.pursuer, Ball):
        pursuer = game.pursuer.horizontal_m_s * xp.sqrt(x * x + y * y + z * z)
    else:
        vertical = xp.select(z > 0, game.pursuer.climb_m_s * z, -game.pursuer.descent_m_s * z)
        pursuer = game.pursuer.horizontal_m_s * xp.norm2((x, y)) + vertical
    a, b, c = (component(gradient.evader, index) for index in range(3))
    free = c if game.evader_space == "space" else 0.0 * c
    return game.evader_speed_m_s * xp.sqrt(a * a + b * b + free * free) - pursuer


def _plane(vectors: Array) -> Plane:
    return component(vectors, 0), component(vectors, 1)
