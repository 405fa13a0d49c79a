"""The one place that knows which array library holds the numbers, and how a vector is taken apart and put together.

Kernels work on components, x, y and z as separate arrays of the leading shape, with nothing but + − × ÷, √, comparison
and selection. IEEE arithmetic rounds each of those correctly, alone or in a SIMD lane, so that one state and a million
give the same bits. A sum over the last axis, `hypot`, `sin` or a BLAS dot product would not promise that, and a single
state, whose components are NumPy scalars, would pay ten times as much for each of its operations.
"""

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from array_api_compat import array_namespace, is_jax_array, is_numpy_namespace
from array_api_compat import device as device_of

Array: TypeAlias = Any
"""An array of any library of the Python array API: NumPy, PyTorch, JAX."""

Library: TypeAlias = Any
"""The functions of such a library."""

Real: TypeAlias = Any
"""A number, or an array with one number for each game of a batch."""

Plane: TypeAlias = tuple[Any, Any]
"""The x and y components of a vector in the evader's plane."""

Space: TypeAlias = tuple[Any, Any, Any]
"""The x, y and z components of a vector."""


def namespace(*arrays: Array) -> Library:
    """Return the array library of the arguments; NumPy without a look-up, for the sake of a 20 ms loop."""
    for array in arrays:
        if type(array) is not np.ndarray:
            return array_namespace(*arrays)
    return np


def is_numpy(xp: Library) -> bool:
    """Say whether the library is NumPy itself."""
    return bool(is_numpy_namespace(xp))


def component(array: Array, index: int) -> Array:
    """Take one component, (..., 3) → (...); of a single NumPy state a scalar."""
    return array[..., index][()] if isinstance(array, np.ndarray) else array[..., index]


def select(xp: Library, condition: Array, yes: Real, no: Real) -> Array:
    """Choose elementwise, as `where` does, except that the answer is only as long as it has to be.

    A single NumPy state picks the very same number, and a NumPy batch of one mind the very same array or number,
    without the copy: most conditions are about rare states.
    """
    if isinstance(condition, (np.bool_, bool)):
        return yes if condition else no
    if isinstance(condition, np.ndarray):
        if not condition.any():
            return no
        if condition.all():
            return yes
    return xp.where(condition, yes, no)


def choose(xp: Library, condition: Array, yes: Real, no: Real) -> Array:
    """Choose elementwise, as `where` does, in the full shape; a single NumPy state picks the number without it."""
    if isinstance(condition, (np.bool_, bool)):
        return yes if condition else no
    return xp.where(condition, yes, no)


def positive_part(value: Array) -> Array:
    """Return max(value, 0), exactly and without a library call; NaN stays NaN."""
    return 0.5 * (value + abs(value))


def larger(xp: Library, a: Array, b: Array) -> Array:
    """Return the larger of two numbers elementwise."""
    return select(xp, a > b, a, b)


def dot2(a: Plane, b: Plane) -> Array:
    """Scalar product of two plane vectors."""
    return a[0] * b[0] + a[1] * b[1]


def norm2(xp: Library, v: Plane) -> Array:
    """Length of a plane vector."""
    return xp.sqrt(v[0] * v[0] + v[1] * v[1])


def norm3(xp: Library, vectors: Array) -> Array:
    """Length of vectors, (..., 3) → (...)."""
    x, y, z = (component(vectors, index) for index in range(3))
    return xp.sqrt(x * x + y * y + z * z)


def unit2(xp: Library, v: Plane, length: Array) -> Plane:
    """Direction of a plane vector of known length; the x axis where that is zero, so that it stays finite."""
    some = length > 0
    inverse = 1.0 / select(xp, some, length, 1.0)
    return select(xp, some, v[0] * inverse, 1.0), v[1] * inverse


def select2(xp: Library, condition: Array, yes: Plane, no: Plane) -> Plane:
    """Choose between two plane vectors."""
    return select(xp, condition, yes[0], no[0]), select(xp, condition, yes[1], no[1])


def bounded2(xp: Library, v: Plane, bound: Real) -> Plane:
    """Shorten a plane vector to a bound, keeping its direction."""
    scale = bound / larger(xp, norm2(xp, v), bound)
    return v[0] * scale, v[1] * scale


def pack(xp: Library, shape: tuple[int, ...], like: Array, components: Sequence[Real], plus: Real = 0.0) -> Array:
    """Put components together into (*shape, n), in the precision and on the device of `like`.

    `plus`, (...), is added to each of them on the way: 0, or NaN where a row shall be lost.
    """
    if is_numpy(xp):
        packed = np.empty((*shape, len(components)), dtype=like.dtype)
        for index, part in enumerate(components):
            _fill(packed[..., index], part, plus)
        return packed
    return xp.stack([spread(xp, shape, like, part + plus) for part in components], axis=-1)


def spread(xp: Library, shape: tuple[int, ...], like: Array, value: Real, plus: Real = 0.0) -> Array:
    """Spread a number or an array, `plus` added, over the leading shape, in the precision and place of `like`."""
    if is_numpy(xp):
        filled = np.empty(shape, dtype=like.dtype)
        _fill(filled, value, plus)
        return filled
    return xp.broadcast_to(constant(xp, like, value + plus), shape)


def _fill(place: Array, value: Real, plus: Real) -> None:
    """Write a sum to where it shall be: a batch in one pass, a single number by the shorter way."""
    if place.ndim:
        np.add(value, plus, out=place, casting="same_kind")
    else:
        place[...] = value + plus


def codes(xp: Library, shape: tuple[int, ...], like: Array, value: Real) -> Array:
    """Spread small integers over the leading shape, on the device of `like`."""
    if is_numpy(xp):
        filled = np.empty(shape, dtype=np.int8)
        filled[...] = value
        return filled
    return xp.broadcast_to(xp.asarray(value, dtype=xp.int8, **_place(like)), shape)


def constant(xp: Library, like: Array, value: Real | Sequence[float]) -> Array:
    """Return a value as an array in the precision and on the device of `like`; an array stays as it is."""
    if hasattr(value, "dtype"):
        return value
    return xp.asarray(value, dtype=like.dtype, **_place(like))


def _place(like: Array) -> dict[str, Any]:
    """Return the argument that makes a new array on the device of `like`; JAX finds it itself, even while tracing."""
    return {} if is_jax_array(like) else {"device": device_of(like)}
