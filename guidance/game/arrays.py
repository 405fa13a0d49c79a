"""The one place that knows which array library holds the numbers, and how a vector is taken apart and put together.

Kernels work on components, x, y and z as separate arrays of the leading shape, with nothing but + − × ÷, √, comparison
and selection. IEEE arithmetic rounds each of those correctly, alone or in a SIMD lane, so that one state and a million
give the same bits, and a single state may as well be Python's own floats (`FLOATS`), whose operations cost a tenth of
those of NumPy's scalars. A sum over the last axis, `hypot`, `sin` or a BLAS dot product would not promise that.
"""

import math
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from types import SimpleNamespace
from typing import Any, TypeAlias

import numpy as np
from array_api_compat import array_namespace, is_array_api_obj, is_jax_array, is_numpy_namespace
from array_api_compat import device as device_of
from numpy.typing import NDArray

from guidance.errors import ConfigError

Array: TypeAlias = NDArray[Any] | Any
"""An array as it is handed back: NumPy's, or that of the library whose arrays were given (PyTorch, JAX).

What is given may be any `numpy.typing.ArrayLike`: numbers of every kind, lists of them, arrays of these libraries. A
type checker takes an answer for NumPy's; who gave arrays of another library casts it (`typing.cast`).
"""

Library: TypeAlias = Any
"""The functions of such a library."""

Real: TypeAlias = float | Any
"""A number, or an array with one number for each game of a batch; read from a game it may be used as a float."""

Truth: TypeAlias = bool | Any
"""Whether something holds, or for which games of a batch."""

Plane: TypeAlias = tuple[Real, Real]
"""The x and y components of a vector in the evader's plane."""

Space: TypeAlias = tuple[Real, Real, Real]
"""The x, y and z components of a vector."""

FLOATS: Library = SimpleNamespace(sqrt=math.sqrt, maximum=max)
"""What the kernels ask of a library, for the floats of a single state."""


class Differentiating:
    """A library that differentiates, with what the kernels ask of it beyond the array API standard."""

    def __init__(self, library: Library) -> None:
        self._library = library

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever the library has
        return getattr(self._library, name)

    def sqrt(self, square: Real) -> Real:
        """Return a square root, with a derivative at zero that is finite."""
        if isinstance(square, float):
            return math.sqrt(square)
        some = square > 0
        return select(self, some, self._library.sqrt(select(self, some, square, 1.0)), square)

    def maximum(self, a: Array, b: Real) -> Array:
        """Return the larger of two numbers elementwise, of which the second may be a float."""
        return self._library.maximum(a, constant(self._library, a, b))


DOUBLE = np.dtype(np.float64)


def vectors(given: dict[str, Any], parameters: Sequence[Array] = ()) -> tuple[Library, dict[str, Array]]:
    """Take named vectors as real numbers, all in the widest precision among them and some arrays of parameters.

    Integers, fractions and lists are numbers like any others.

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
    try:
        return as_reals(value if is_array_api_obj(value) else xp.asarray(value))
    except (TypeError, ValueError, RuntimeError):
        raise ConfigError(f"{name} = {value!r}: must be an array of shape (..., 3) of real numbers") from None


def as_reals(array: Array) -> Array:
    """Return an array of numbers of any kind as one of floating point numbers; what is not whole stays as it is.

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
    """Say whether the library is NumPy itself."""
    return xp is np or bool(is_numpy_namespace(xp))


def component(array: Array, index: int) -> Real:
    """Take one component, (..., 3) → (...); of a single state a scalar."""
    return array[..., index][()] if isinstance(array, np.ndarray) else array[..., index]


def components(array: Array) -> Space:
    """Take all three, (..., 3) → three of (...)."""
    return component(array, 0), component(array, 1), component(array, 2)


def components_or_none(array: Array | None) -> Space | None:
    """Take all three of what may not be there."""
    return None if array is None else components(array)


def select(xp: Library, condition: Truth, yes: Real, no: Real) -> Real:
    """Choose elementwise, as `where` does, except that the answer is only as long as it has to be.

    A single NumPy state picks the very same number, and a NumPy batch of one mind the very same array or number,
    without the copy: most conditions are about rare states.

    Args:
        xp: array library.
        condition: whether to take the first, (...).
        yes: what is taken where that holds.
        no: what is taken elsewhere.
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
    """Choose elementwise, as `where` does, in the full shape; a single NumPy state picks the number without it.

    Args:
        xp: array library.
        condition: whether to take the first, (...).
        yes: what is taken where that holds.
        no: what is taken elsewhere.
    """
    if isinstance(condition, (np.bool_, bool)):
        return yes if condition else no
    return xp.where(condition, yes, no)


def quiet(xp: Library) -> AbstractContextManager[object]:
    """Keep NumPy from warning about the rows that `Reason` reports."""
    return np.errstate(all="ignore") if is_numpy(xp) else nullcontext()


def is_array(value: Real) -> bool:
    """Say whether a parameter holds one number for each row of a batch."""
    return type(value) is not float and getattr(value, "shape", ()) != ()


def pair_length(pair: Plane) -> Real:
    """Return the length of a pair of parameters, to the same bits for a number and for rows of it."""
    square = pair[0] * pair[0] + pair[1] * pair[1]
    return array_namespace(square).sqrt(square) if is_array(square) else math.sqrt(square)


def less_length(u: Real, v: Real, w: Plane) -> Real:
    """Return u − v − ‖w‖ to the last digits of the numbers given, however small it is beside them.

    (u − v)² − ‖w‖² over (u − v) + ‖w‖, with every square as a sum of two floats whose second is what the first lost.
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
    """Return the square as rounded, and what rounding took from it (Dekker, for double precision)."""
    square, scaled = value * value, 134217729.0 * value
    high = scaled - (scaled - value)
    low = value - high
    return square, ((high * high - square) + 2.0 * high * low) + low * low


def half_of_digits(value: Real) -> float:
    """Return √ε: a step of Newton's method after which none is needed, as the next would be its square."""
    if isinstance(value, float):
        return 2.0**-26
    return math.sqrt(array_namespace(value).finfo(value.dtype).eps)


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
    """Direction of a plane vector of known length; the x axis where that is zero, so that it stays finite."""
    some = length > 0
    if some is True:
        return v[0] * (1.0 / length), v[1] * (1.0 / length)
    inverse = 1.0 / select(xp, some, length, 1.0)
    return select(xp, some, v[0] * inverse, 1.0), v[1] * inverse


def select2(xp: Library, condition: Truth, yes: Plane, no: Plane) -> Plane:
    """Choose between two plane vectors.

    Args:
        xp: array library.
        condition: whether to take the first, (...).
        yes: what is taken where that holds.
        no: what is taken elsewhere.
    """
    if condition is True or condition is False:
        return yes if condition else no
    return select(xp, condition, yes[0], no[0]), select(xp, condition, yes[1], no[1])


def pack(xp: Library, shape: tuple[int, ...], like: Array, components: Sequence[Real], plus: Real = 0.0) -> Array:
    """Put components together into (*shape, n).

    Args:
        xp: array library.
        shape: the leading shape.
        like: an array whose precision and device the answer has.
        components: n numbers or arrays that broadcast to the shape.
        plus: added to each of them on the way, (...): 0, or NaN where a row shall be lost.
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
        like: an array whose precision and device the answer has.
        value: a number, or an array that broadcasts to the shape.
        plus: added to it, (...): 0, or NaN where a row shall be lost.
    """
    if is_numpy(xp):
        filled = np.empty(shape, dtype=like.dtype)
        fill(filled, value, plus)
        return filled
    return xp.broadcast_to(constant(xp, like, value + plus), shape)


def fill(place: Array, value: Real, plus: Real) -> None:
    """Write a sum to where it shall be: a batch in one pass, a single number by the shorter way."""
    if place.ndim:
        np.add(value, plus, out=place, casting="same_kind")
    else:
        place[...] = value + plus


def codes(xp: Library, shape: tuple[int, ...], like: Array, value: Real) -> Array:
    """Spread small integers over the leading shape, on the device of `like`.

    Args:
        xp: array library.
        shape: the leading shape.
        like: an array whose device the answer has.
        value: an integer of eight bits, or an array of them that broadcasts to the shape.
    """
    return xp.broadcast_to(xp.asarray(value, dtype=xp.int8, **_place(like)), shape)


def constant(xp: Library, like: Array, value: Real | Sequence[float]) -> Array:
    """Return a value as an array in the precision and on the device of `like`; an array stays as it is."""
    if hasattr(value, "dtype"):
        return value
    return xp.asarray(value, dtype=like.dtype, **_place(like))


def _place(like: Array) -> dict[str, Any]:
    """Return the argument that makes a new array on the device of `like`; JAX finds it itself, even while tracing."""
    return {} if is_jax_array(like) else {"device": device_of(like)}
