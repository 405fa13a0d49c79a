"""Array libraries (NumPy, PyTorch, JAX), and vectors as components.

Kernels work on components: x, y and z are separate arrays of the leading shape. They use only + − × ÷, √, comparison
and selection, because IEEE arithmetic rounds these correctly in every case. So NumPy gives the same bits for one state
and for a million, and Python's floats (`FLOATS`) give them for a single state ten times faster than NumPy's scalars. A
sum over the last axis, `hypot`, `sin` or a BLAS dot product would not give the same bits.
"""

import math
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from types import SimpleNamespace
from typing import Any, Protocol, TypeAlias

import numpy as np
from array_api_compat import array_namespace, is_array_api_obj, is_jax_array, is_numpy_namespace
from array_api_compat import device as device_of
from numpy.typing import NDArray

from guidance.errors import ConfigError

Array: TypeAlias = NDArray[Any] | Any
"""An array in an answer: of NumPy, or of the library whose arrays were given (PyTorch, JAX).

Arguments may be any `numpy.typing.ArrayLike`: numbers, lists, arrays of these libraries. Type checkers see answers as
NumPy arrays; use `typing.cast` for another library.
"""


class Rows(Protocol):
    """An array as a game's parameter: one number for each row of a batch."""

    @property
    def shape(self) -> Any: ...  # noqa: ANN401, D102 - every library has its own type
    @property
    def dtype(self) -> Any: ...  # noqa: ANN401, D102


Library: TypeAlias = Any
"""An array library's module."""

Real: TypeAlias = float | Any
"""A number, or an array with one number for each game of a batch; read from a game it may be used as a float."""

Truth: TypeAlias = bool | Any
"""A truth value, or one for each game of a batch."""

Plane: TypeAlias = tuple[Real, Real]
"""The x and y components of a vector in the evader's plane."""

Space: TypeAlias = tuple[Real, Real, Real]
"""The x, y and z components of a vector."""

FLOATS: Library = SimpleNamespace(sqrt=math.sqrt, maximum=max, sign=lambda value: (value > 0) - (value < 0))
"""The library for single states: the functions that kernels use, for floats."""


class Differentiating:
    """A library that differentiates, with functions of the kernels that the array API standard lacks."""

    def __init__(self, library: Library) -> None:
        self._library = library

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - any function of the library
        return getattr(self._library, name)

    def sqrt(self, square: Real) -> Real:
        """Return a square root whose derivative at zero is finite."""
        if isinstance(square, float):
            return math.sqrt(square)
        some = square > 0
        return select(self, some, self._library.sqrt(select(self, some, square, 1.0)), square)

    def maximum(self, a: Array, b: Real) -> Array:
        """Return the larger of two numbers elementwise; the second may be a float."""
        return self._library.maximum(a, constant(self._library, a, b))


DOUBLE = np.dtype(np.float64)


def vectors(given: dict[str, Any], parameters: Sequence[Array] = ()) -> tuple[Library, dict[str, Array]]:
    """Convert named vectors to real arrays of the widest precision among them and some arrays of parameters.

    Returns:
        The array library, and the vectors as its arrays.

    Raises:
        ConfigError: one is no array of numbers, or they belong to different libraries.
    """
    if all(type(value) is np.ndarray and value.dtype is DOUBLE for value in (*given.values(), *parameters)):
        return np, given
    known = [value for value in given.values() if is_array_api_obj(value)]
    try:
        xp: Library = array_namespace(*known) if known else np
    except TypeError:
        kinds = ", ".join(f"{name}: {type(value).__name__}" for name, value in given.items())
        raise ConfigError(f"arrays of different libraries cannot be mixed: {kinds}") from None
    xp = np if is_numpy(xp) else Differentiating(xp)
    taken = {name: _as_array(xp, name, value) for name, value in given.items()}
    wide = xp.result_type(*(array.dtype for array in (*taken.values(), *parameters)))
    return xp, {name: array if array.dtype == wide else xp.astype(array, wide) for name, array in taken.items()}


def _as_array(xp: Library, name: str, value: object) -> Array:
    if isinstance(value, np.ma.MaskedArray):
        raise ConfigError(f"{name} = {value!r}: must not be a masked array; fill it, or leave those rows out")
    try:
        return as_reals(value if is_array_api_obj(value) else xp.asarray(value))
    except (TypeError, ValueError, RuntimeError):
        raise ConfigError(f"{name} = {value!r}: must be an array of shape (..., 3) of real numbers") from None


def as_reals(array: Array) -> Array:
    """Return an array as floating point numbers; floating point arrays are not changed.

    Raises:
        TypeError: it holds complex numbers, or no numbers.
        ValueError: an object in it is no number.
    """
    xp = array_namespace(array)
    if is_numpy(xp) and array.dtype.kind == "O":
        return array.astype(np.float64)
    if xp.isdtype(array.dtype, ("integral", "bool")):
        return xp.astype(array, xp.float64)
    if not xp.isdtype(array.dtype, "real floating"):
        raise TypeError(f"{array.dtype} are no real numbers")
    return array


def is_numpy(xp: Library) -> bool:
    """Return whether the library is NumPy."""
    return xp is np or bool(is_numpy_namespace(xp))


def component(array: Array, index: int) -> Real:
    """Return one component, (..., 3) → (...); a scalar for a single state."""
    return array[..., index][()] if isinstance(array, np.ndarray) else array[..., index]


def components(array: Array) -> Space:
    """Return all three components, (..., 3) → three of (...)."""
    return component(array, 0), component(array, 1), component(array, 2)


def components_or_none(array: Array | None) -> Space | None:
    """Return all three components, or None."""
    return None if array is None else components(array)


def select(xp: Library, condition: Truth, yes: Real, no: Real) -> Real:
    """Choose elementwise like `where`, but return an argument itself if it is chosen everywhere.

    That saves a copy, because most conditions are about rare states.

    Args:
        xp: array library.
        condition: truth values, (...).
        yes: values where the condition is true.
        no: values elsewhere.
    """
    if condition is True:
        return yes
    if condition is False:
        return no
    if isinstance(condition, np.ndarray):
        count = np.count_nonzero(condition)
        if count == 0:
            return no
        if count == condition.size:
            return yes
    elif isinstance(condition, np.bool_):
        return yes if condition else no
    return xp.where(condition, yes, no)


def choose(xp: Library, condition: Truth, yes: Real, no: Real) -> Real:
    """Choose elementwise like `where`, in the full shape.

    Args:
        xp: array library.
        condition: truth values, (...).
        yes: values where the condition is true.
        no: values elsewhere.
    """
    if isinstance(condition, (np.bool_, bool)):
        return yes if condition else no
    return xp.where(condition, yes, no)


def quiet(xp: Library) -> AbstractContextManager[object]:
    """Silence NumPy's warnings about rows that `Reason` reports."""
    return np.errstate(all="ignore") if is_numpy(xp) else nullcontext()


def is_array(value: Real) -> bool:
    """Return whether a parameter is an array, with one number for each row of a batch."""
    return type(value) is not float and getattr(value, "shape", ()) != ()


def pair_length(pair: Plane) -> Real:
    """Return the length of a pair of parameters, with the same bits for numbers and arrays."""
    square = pair[0] * pair[0] + pair[1] * pair[1]
    return array_namespace(square).sqrt(square) if is_array(square) else math.sqrt(square)


def less_length(u: Real, v: Real, w: Plane) -> Real:
    """Return u − v − ‖w‖ without losing digits if it is small.

    It is ((u − v)² − ‖w‖²) / ((u − v) + ‖w‖), with every square as a sum of two floats: the rounded one and its error.
    """
    difference = u - v
    if not any(is_array(part) for part in w) and w == (0.0, 0.0):
        return difference
    back = u - difference
    lost = (u - (difference + back)) + (back - v)
    (a, a_lost), (b, b_lost), (c, c_lost) = (_square(part) for part in (difference, *w))
    both = b + c
    both_lost = b - (both - (both - b)) + (c - (both - b))
    rest = (a - both) + (a_lost - b_lost - c_lost - both_lost + 2.0 * difference * lost)
    return rest / (difference + pair_length(w))


def _square(value: Real) -> tuple[Real, Real]:
    """Return the rounded square and its rounding error (Dekker, for double precision)."""
    square, scaled = value * value, 134217729.0 * value
    high = scaled - (scaled - value)
    low = value - high
    return square, ((high * high - square) + 2.0 * high * low) + low * low


def half_of_digits(value: Real) -> float:
    """Return √ε: after a Newton step this small the next is below ε, so none is needed."""
    if isinstance(value, float):
        return 2.0**-26
    xp = np if isinstance(value, np.ndarray) else array_namespace(value)
    return math.sqrt(xp.finfo(value.dtype).eps)


def dot2(a: Plane, b: Plane) -> Real:
    """Scalar product of two plane vectors."""
    return a[0] * b[0] + a[1] * b[1]


def norm2(xp: Library, v: Plane) -> Real:
    """Length of a plane vector."""
    return xp.sqrt(v[0] * v[0] + v[1] * v[1])


def norm3(xp: Library, vectors: Array) -> Real:
    """Length of vectors, (..., 3) → (...)."""
    x, y, z = components(vectors)
    return xp.sqrt(x * x + y * y + z * z)


def unit2(xp: Library, v: Plane, length: Real) -> Plane:
    """Direction of a plane vector of known length; the x axis if the length is zero."""
    some = length > 0
    if some is True:
        return v[0] * (1.0 / length), v[1] * (1.0 / length)
    inverse = 1.0 / select(xp, some, length, 1.0)
    return select(xp, some, v[0] * inverse, 1.0), v[1] * inverse


def select2(xp: Library, condition: Truth, yes: Plane, no: Plane) -> Plane:
    """Choose between two plane vectors.

    Args:
        xp: array library.
        condition: truth values, (...).
        yes: values where the condition is true.
        no: values elsewhere.
    """
    if condition is True or condition is False:
        return yes if condition else no
    return select(xp, condition, yes[0], no[0]), select(xp, condition, yes[1], no[1])


def select_all(xp: Library, condition: Truth, yes: Any, no: Any) -> Any:  # noqa: ANN401 - records of numbers
    """Choose between two records of numbers and vectors elementwise; see `select`."""
    if not isinstance(yes, tuple):
        return select(xp, condition, yes, no)
    parts = [select_all(xp, condition, one, other) for one, other in zip(yes, no, strict=True)]
    return type(yes)(*parts) if hasattr(yes, "_fields") else tuple(parts)


def pack(xp: Library, shape: tuple[int, ...], like: Array, components: Sequence[Real], plus: Real = 0.0) -> Array:
    """Put components together into (*shape, n).

    Args:
        xp: array library.
        shape: the leading shape.
        like: an array with the precision and device of the answer.
        components: n numbers or arrays that broadcast to the shape.
        plus: added to each component, (...): 0, or NaN in rows without an answer.
    """
    if is_numpy(xp):
        packed = np.empty((*shape, len(components)), dtype=like.dtype)
        for index, part in enumerate(components):
            fill(packed[..., index], part, plus)
        return packed
    return xp.stack([spread(xp, shape, like, part + plus) for part in components], axis=-1)


def spread(xp: Library, shape: tuple[int, ...], like: Array, value: Real, plus: Real = 0.0) -> Array:
    """Spread a number or an array, `plus` added, over the leading shape, in the precision and place of `like`.

    Args:
        xp: array library.
        shape: the leading shape.
        like: an array with the precision and device of the answer.
        value: a number, or an array that broadcasts to the shape.
        plus: added to it, (...): 0, or NaN in rows without an answer.
    """
    if is_numpy(xp):
        filled = np.empty(shape, dtype=like.dtype)
        fill(filled, value, plus)
        return filled
    return xp.broadcast_to(constant(xp, like, value + plus), shape)


def fill(place: Array, value: Real, plus: Real) -> None:
    """Write value + plus to an array, in one pass for a batch."""
    if place.ndim:
        np.add(value, plus, out=place, casting="same_kind")
    else:
        place[...] = value + plus


def codes(xp: Library, shape: tuple[int, ...], like: Array, value: Real) -> Array:
    """Spread small integers over the leading shape, on the device of `like`.

    Args:
        xp: array library.
        shape: the leading shape.
        like: an array on the device of the answer.
        value: an integer of eight bits, or an array of them that broadcasts to the shape.
    """
    small = xp.astype(value, xp.int8) if hasattr(value, "dtype") else xp.asarray(value, dtype=xp.int8, **_place(like))
    return xp.broadcast_to(small, shape)


def constant(xp: Library, like: Array, value: Real | Sequence[float]) -> Array:
    """Return a value as an array in the precision and on the device of `like`; an array stays as it is."""
    if hasattr(value, "dtype"):
        return value
    return xp.asarray(value, dtype=like.dtype, **_place(like))


def _place(like: Array) -> dict[str, Any]:
    """Return the argument that makes a new array on the device of `like`; JAX needs none."""
    return {} if is_jax_array(like) else {"device": device_of(like)}
