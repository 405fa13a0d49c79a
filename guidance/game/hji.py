"""The Hamilton-Jacobi-Isaacs residual of a value function: zero where the value is the game's (eq. (10) of the paper).

    min over one player, max over the other, of  V̇ + running cost,   V̇ = ∇_P V·(u + w) + ∇_E V·v + ∇_T V·v_T

PE: the pursuer minimises, the evader maximises, the running cost is 1 (seconds per second). TAD, the pursuer wins: it
maximises the final distance and the evader minimises it, without running cost; the evader wins: the other way round,
the value being what the pursuer is short of. The extreme point of a speed set in a direction is known in closed form,
so that the residual needs nothing but the gradient, by finite differences or by automatic differentiation.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Literal, TypeAlias

from array_api_compat import array_namespace, is_jax_array, is_torch_array

from guidance.errors import ConfigError
from guidance.game.arrays import Array, Library, Plane, component, constant, dot2, norm2, root, select, vectors
from guidance.game.game import Game
from guidance.game.gradient import Gradient
from guidance.game.solution import solve
from guidance.game.speeds import Ball

ValueFunction: TypeAlias = Callable[[Array, Array, Array | None], Array]
"""Value of the positions of P, E and T, (..., 3) each, or of P, E and None; (...)."""


METHODS = ("finite", "automatic")


def hji_residual(
    game: Game,
    pursuer: Array,
    evader: Array,
    target: Array | None = None,
    *,
    value: ValueFunction | None = None,
    method: Literal["finite", "automatic"] = "finite",
    step_m: float = 1e-3,
) -> Array:
    """Return the residual at every state, (...): in PE a pure number, in TAD in m/s.

    Args:
        game: what is played.
        pursuer: position P, (..., 3), m.
        evader: position E, (..., 3), m.
        target: position T, (..., 3), m, or None for PE.
        value: any function of the positions; the value of `solve` by default. Who wins is always asked of `solve`.
        method: "finite" differences, or "automatic" differentiation (PyTorch, JAX).
        step_m: step of the finite differences.

    Raises:
        ConfigError: as `solve`; the method is unknown, or the array library cannot differentiate.
    """
    if method not in METHODS:
        raise ConfigError(f"method = {method!r}: must be one of {', '.join(METHODS)}")
    xp, given = vectors({"pursuer": pursuer, "evader": evader} | ({} if target is None else {"target": target}))
    pursuer, evader, target = given["pursuer"], given["evader"], given.get("target")
    asked = value or (lambda P, E, T: solve(game, P, E, T).value)
    if method == "automatic":
        gradient = automatic_gradient(asked, pursuer, evader, target)
    else:
        gradient = finite_differences(asked, pursuer, evader, target, step_m=step_m)
    if target is None:
        return 1.0 + _drift(game, gradient) + _saddle(xp, game, gradient, 1.0)
    minimises = select(xp, solve(game, pursuer, evader, target).winner > 0, -1.0, 1.0)
    return _drift(game, gradient) + minimises * _saddle(xp, game, gradient, minimises)


def finite_differences(
    value: ValueFunction, pursuer: Array, evader: Array, target: Array | None, *, step_m: float
) -> Gradient:
    """Differentiate by central differences of fourth order, whose error falls with `step_m`⁴."""
    xp = array_namespace(pursuer, evader)

    def along(place: int) -> Array:
        given = [pursuer, evader, target]
        if given[place] is None:
            return 0.0 * pursuer
        slopes = []
        for axis in range(3):
            shift = constant(xp, pursuer, [step_m if axis == index else 0.0 for index in range(3)])

            def moved(steps: float, shift: Array = shift) -> Array:
                return value(*(array + steps * shift if index == place else array for index, array in enumerate(given)))

            slopes.append((8.0 * (moved(1.0) - moved(-1.0)) - (moved(2.0) - moved(-2.0))) / (12.0 * step_m))
        return xp.stack(slopes, axis=-1)

    return Gradient(along(0), along(1), along(2))


def automatic_gradient(value: ValueFunction, pursuer: Array, evader: Array, target: Array | None) -> Gradient:
    """Differentiate by the array library.

    Raises:
        ConfigError: the library is neither PyTorch nor JAX.
    """
    given = [array for array in (pursuer, evader, target) if array is not None]
    if is_torch_array(pursuer):
        leaves = [array.detach().requires_grad_() for array in given]
        value(*leaves, *([] if target is not None else [None])).sum().backward()
        slopes = [leaf.grad for leaf in leaves]
    elif is_jax_array(pursuer):
        total = lambda *arrays: value(*arrays, *([] if target is not None else [None])).sum()  # noqa: E731
        slopes = list(import_module("jax").grad(total, argnums=tuple(range(len(given))))(*given))
    else:
        raise ConfigError(
            f"method = 'automatic': {type(pursuer).__module__} arrays cannot be differentiated; use 'finite'"
        )
    return Gradient(slopes[0], slopes[1], slopes[2] if target is not None else 0.0 * pursuer)


def _drift(game: Game, gradient: Gradient) -> Array:
    """What wind and moving target do to the value, whatever the players do."""
    return dot2(_plane(gradient.pursuer), game.wind_m_s) + dot2(_plane(gradient.target), game.target_velocity_m_s)


def _saddle(xp: Library, game: Game, gradient: Gradient, minimises: Array) -> Array:
    """What the best of both adds, turned so that the pursuer minimises."""
    x, y, z = (-minimises * component(gradient.pursuer, index) for index in range(3))
    if isinstance(game.pursuer, Ball):
        pursuer = game.pursuer.speed_m_s * root(xp, x * x + y * y + z * z)
    else:
        vertical = select(xp, z > 0, game.pursuer.climb_m_s * z, -game.pursuer.descent_m_s * z)
        pursuer = game.pursuer.horizontal_m_s * norm2(xp, (x, y)) + vertical
    a, b, c = (component(gradient.evader, index) for index in range(3))
    free = c if game.evader_space == "space" else 0.0 * c
    return game.evader_speed_m_s * root(xp, a * a + b * b + free * free) - pursuer


def _plane(vectors: Array) -> Plane:
    return component(vectors, 0), component(vectors, 1)
