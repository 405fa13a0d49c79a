"""The one place that knows which array library holds the numbers, and how a vector is taken apart and put together.

Kernels work on components, (x, y, z) as separate arrays of the leading shape, with nothing but + − × ÷, √, comparison and
selection. Each of those is correctly rounded in IEEE arithmetic, alone or in a SIMD lane, so that one state and a million
give the same bits; a sum over the last axis, `hypot`, `sin` or a BLAS dot product would not promise that.
"""

from typing import Any, TypeAlias

import numpy as np
from array_api_compat import array_namespace, is_jax_array, is_numpy_namespace
from array_api_compat import device as device_of

Array: TypeAlias = Any
"""An array of any library of the Python array API: NumPy, PyTorch, JAX."""

Real: TypeAlias = Any
"""A number, or an array with one number for each game of a batch."""

Plane: TypeAlias = tuple[Any, Any]
"""The x and y components of a vector in the evader's plane."""

Space: TypeAlias = tuple[Any, Any, Any]
"""The x, y and z components of a vector."""


def namespace(*arrays: Array) -> Any:  # noqa: ANN401 - a module has no narrower type
    """Return the array library of the arguments; plain NumPy without a look-up, for the sake of a 20 ms loop."""
    for array in arrays:
        if type(array) is not np.ndarray:
            return array_namespace(*arrays)
    return np


def is_numpy(xp: Any) -> bool:  # noqa: ANN401 - a module has no narrower type
    """Say whether the library is NumPy itself."""
    return xp is np or bool(is_numpy_namespace(xp))


def component(array: Array, index: int) -> Array:
    """Take one component, (..., 3) → (...). A single state gives a NumPy scalar, ten times quicker than a 0-d array."""
    return array[..., index][()] if isinstance(array, np.ndarray) else array[..., index]


def select(xp: Any, condition: Array, yes: Real, no: Real) -> Array:  # noqa: ANN401
    """Choose elementwise, as `where` does. A single state skips the array machinery and picks the very same value."""
    if isinstance(condition, (np.bool_, bool)):
        return yes if condition else no
    return xp.where(condition, yes, no)


def positive_part(value: Array) -> Array:
    """Return max(value, 0) by exact arithmetic, without a library call; NaN stays NaN."""
    return 0.5 * (value + abs(value))


def larger(xp: Any, a: Array, b: Array) -> Array:  # noqa: ANN401
    """Return the larger of two numbers elementwise."""
    return select(xp, a > b, a, b)


def norm2(xp: Any, v: Plane) -> Array:  # noqa: ANN401
    """Length of a plane vector."""
    return xp.sqrt(v[0] * v[0] + v[1] * v[1])


def unit2(xp: Any, v: Plane, length: Array) -> Plane:  # noqa: ANN401
    """Direction of a plane vector of known length; the x axis where the length is zero, so that it stays finite."""
    some = length > 0
    inverse = 1.0 / select(xp, some, length, 1.0)
    return select(xp, some, v[0] * inverse, 1.0), v[1] * inverse


def pack(xp: Any, shape: tuple[int, ...], like: Array, *components: Real) -> Array:  # noqa: ANN401
    """Put components together into (*shape, n), in the precision and on the device of `like`."""
    if is_numpy(xp):
        packed = np.empty((*shape, len(components)), dtype=like.dtype)
        for index, part in enumerate(components):
            packed[..., index] = part
        return packed
    return xp.stack([spread(xp, shape, like, part) for part in components], axis=-1)


def spread(xp: Any, shape: tuple[int, ...], like: Array, value: Real) -> Array:  # noqa: ANN401
    """Spread a number or an array over the leading shape, in the precision and on the device of `like`."""
    if is_numpy(xp):
        filled = np.empty(shape, dtype=like.dtype)
        filled[...] = value
        return filled
    where = {} if is_jax_array(like) else {"device": device_of(like)}
    return xp.broadcast_to(xp.asarray(value, dtype=like.dtype, **where), shape)
