"""Rows of a batch: their shape, the game of some rows, and which rows are refused."""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from guidance.errors import ConfigError
from guidance.game.arrays import Array, Library, Real, Space, components, dot3, is_array, vectors
from guidance.game.game import Game, Reason, parameters, speed_in_hand
from guidance.game.records import rows_of

_SIGNED = ("wind_x_m_s", "wind_y_m_s")
ZERO_ALLOWED = ("capture_radius_m", "information_age_s", "radius_m", "height_m")

_PIECE: Final = 8192
"""Length of vectors whose scalar product NumPy computes in one thread."""


def leading_shape(game: Game, named: dict[str, Array]) -> tuple[int, ...]:
    """Return the common leading shape of named vectors and of parameters that are arrays.

    Raises:
        ConfigError: a vector is not an array (..., 3), or the shapes do not broadcast.
    """
    shapes = {}
    for name, array in named.items():
        shape = array.shape
        if not shape or shape[-1] != 3:
            raise ConfigError(
                f"{name} = {array!r}: must be an array of shape (..., 3), not {tuple(shape)}"
            )
        shapes[name] = tuple(shape[:-1])
    if game.varies:
        shapes |= {
            name: tuple(getattr(value, "shape", ())) for name, value in parameters(game).items()
        }
    different = set(shapes.values())
    return different.pop() if len(different) == 1 else fitting(shapes)


def fitting(shapes: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """Return the common shape of leading axes.

    Raises:
        ConfigError: they do not fit each other.
    """
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        raise ConfigError(f"the leading shapes do not fit each other: {shapes}") from None


def vector_of(
    kernel: Callable[..., Space], game: Game, named: Mapping[str, ArrayLike | None]
) -> Array:
    """Return the vector, (..., 3), that a kernel computes from the components of named vectors; None stays None.

    Raises:
        ConfigError: one is no array (..., 3) of numbers, or the shapes do not fit each other.
    """
    xp, arrays = vectors(
        {name: value for name, value in named.items() if value is not None}, varying(game)
    )
    shape = leading_shape(game, arrays)
    with np.errstate(all="ignore"):
        parts = (components(arrays[name]) if name in arrays else None for name in named)
        return xp.pack(shape, next(iter(arrays.values())), kernel(xp, game, *parts))


def varying(game: Game) -> list[Array]:
    """Return the parameters of a game that are arrays."""
    return [value for value in parameters(game).values() if is_array(value)] if game.varies else []


def for_rows(game: Game, rows: Callable[[Array], Array]) -> Game:
    """Return the game of some rows; `rows` takes them from each parameter that is an array."""
    selected: Game = rows_of(game, rows) if game.varies else game
    return selected


def simplified(game: Game) -> Game:
    """Return the same game with a number in place of every NumPy array that repeats it.

    If no game allows the number, the array stays, so that `solve` gives the reason in every row.
    """
    if not game.varies or not any(map(_is_single, parameters(game).values())):
        return game
    try:
        return for_rows(game, lambda value: value.item(0) if _is_single(value) else value)
    except ConfigError:
        return game


def _is_single(value: Real) -> bool:
    if not isinstance(value, np.ndarray) or value.dtype != np.float64 or value.size == 0:
        return False
    first = value.item(0)
    return value.item(-1) == first and bool((value == first).all())


def refused_rows(xp: Library, game: Game, fault: Real) -> Real:
    """Return a reason for each row whose parameters are not allowed, else the fault that was given.

    Args:
        xp: array library.
        game: with parameters that are arrays.
        fault: 0, or another reason why a row has no answer.
    """
    fault = xp.select(speed_in_hand(game) > 0, fault, int(Reason.PURSUER_TOO_SLOW))
    for name, value in parameters(game).items():
        allowed = value - value == 0
        if name not in _SIGNED:
            allowed = allowed & (value >= 0 if name in ZERO_ALLOWED else value > 0)
        fault = xp.select(allowed, fault, int(Reason.OUT_OF_RANGE))
    return fault


def squares(named: dict[str, Array]) -> Real:
    """Return the sum of the squares of all components, row by row."""
    return sum(dot3(vector, vector) for vector in map(components, named.values()))


def most_squares(named: dict[str, Array]) -> float:
    """Return an upper bound of `squares` for all rows of NumPy arrays: the squares of all rows, in a tenth of the time.

    A scalar product of a longer piece would be computed by several threads, whose start takes longer than the product.
    """
    total = 0.0
    for array in named.values():
        flat = array.reshape(-1)
        for start in range(0, flat.size, _PIECE):
            piece = flat[start : start + _PIECE]
            total += float(piece @ piece)
    return 2.0 * total  # more than is lost by rounding
