"""Array libraries (NumPy, PyTorch, JAX), and vectors as components.

Kernels work on components: x, y and z are separate arrays of the leading shape. They use only + − × ÷, √, comparison
and selection, because IEEE arithmetic rounds these correctly in every case. So NumPy gives the same bits for one state
and for a million, and Python's floats (`FLOATS`) give them for a single state ten times faster than NumPy's scalars. A
sum over the last axis, `hypot`, `sin` or a BLAS dot product would not give the same bits.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any, TypeAlias, TypeVar, cast

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

FloatArray: TypeAlias = NDArray[np.float64]
"""A NumPy array of numbers."""

Real: TypeAlias = float | Any
"""A number, or an array with one number for each game of a batch; read from a game it may be used as a float."""

Truth: TypeAlias = bool | Any
"""A truth value, or one for each game of a batch."""

Plane: TypeAlias = tuple[Real, Real]
"""The x and y components of a vector in the evader's plane."""

Space: TypeAlias = tuple[Real, Real, Real]
"""The x, y and z components of a vector."""

AnyRecord = TypeVar("AnyRecord", bound=Any)


class Library:
    """An array library, and the further functions that the kernels need."""

    differentiates = False
    """True if it traces or differentiates: then every row takes every step, and derivatives must be finite."""

    def __init__(self, module: Any) -> None:  # noqa: ANN401 - a module has no type of its own
        self.module = module

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - any function of the library
        return getattr(self.module, name)

    def select(self, condition: Truth, yes: Real, no: Real) -> Real:
        """Choose elementwise like `where`, but return an argument itself if it is chosen everywhere."""
        if condition is True or condition is False:
            return yes if condition else no
        return self.where(condition, yes, no)

    def any(self, condition: Truth, /) -> bool:
        """Return whether a condition may hold in some row; a library that traces does not know, and takes the step."""
        return condition is not False

    def select2(self, condition: Truth, yes: Plane, no: Plane) -> Plane:
        """Choose between two plane vectors elementwise."""
        return self.select(condition, yes[0], no[0]), self.select(condition, yes[1], no[1])

    def select_all(self, condition: Truth, yes: AnyRecord, no: AnyRecord) -> AnyRecord:
        """Choose between two numbers, or records of numbers and vectors, elementwise."""
        return mapped(partial(self.select, condition), yes, no)

    def norm2(self, v: Plane) -> Real:
        """Return the length of a plane vector."""
        return self.sqrt(v[0] * v[0] + v[1] * v[1])

    def norm3(self, v: Space) -> Real:
        """Return the length of a vector in space."""
        return self.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])

    def unit2(self, v: Plane, length: Real) -> Plane:
        """Return the direction of a plane vector of known length; the x axis if the length is zero."""
        nonzero = length > 0
        inverse = 1.0 / self.select(nonzero, length, 1.0)
        return self.select(nonzero, v[0] * inverse, 1.0), v[1] * inverse

    def within_one(self, share: Real) -> Real:
        """Return the share that is nearest and from 0 to 1."""
        least = self.select(share < 0.0, 0.0 * share, share)
        return self.select(least > 1.0, 0.0 * least + 1.0, least)

    def half_of_digits(self, value: Any) -> float:  # noqa: ANN401 - an array
        """Return √ε: after a Newton step this small the next is below ε, so none is needed."""
        return 2.0**-26 if isinstance(value, float) else math.sqrt(self.finfo(value.dtype).eps)

    def constant(self, like: Array, value: Real | Sequence[float]) -> Array:
        """Return a value as an array in the precision and on the device of `like`; an array stays as it is."""
        options = {} if is_jax_array(like) else {"device": device_of(like)}
        return (
            value if hasattr(value, "dtype") else self.asarray(value, dtype=like.dtype, **options)
        )

    def pack(
        self, shape: tuple[int, ...], like: Array, value: Real | tuple[Real, ...], plus: Real = 0.0
    ) -> Array:
        """Spread a number over the leading shape, or put n components together into (*shape, n).

        Args:
            shape: the leading shape.
            like: an array with the precision and device of the answer.
            value: a number or an array that broadcasts to the shape, or components of a vector.
            plus: added to it, (...): 0, or NaN in rows without an answer.
        """
        if isinstance(value, tuple):
            return self.stack([self.pack(shape, like, part, plus) for part in value], axis=-1)
        return self.broadcast_to(self.constant(like, value + plus), shape)


class Differentiating(Library):
    """PyTorch or JAX."""

    differentiates = True

    def sqrt(self, square: Real) -> Real:
        """Return a square root whose derivative at zero is finite."""
        if isinstance(square, float):
            return math.sqrt(square)
        positive = square > 0
        return self.select(positive, self.module.sqrt(self.select(positive, square, 1.0)), square)

    def maximum(self, a: Array, b: Real) -> Array:
        """Return the larger of two numbers elementwise; the second may be a float."""
        return self.module.maximum(a, self.constant(a, b))


class NumPy(Library):
    """NumPy, which fills arrays in place."""

    sqrt = staticmethod(np.sqrt)
    maximum = staticmethod(np.maximum)
    minimum = staticmethod(np.minimum)

    def select(self, condition: Truth, yes: Real, no: Real) -> Real:
        """Choose as every library does. Most conditions are about rare states, so this saves copies."""
        if condition is True or condition is False:
            return yes if condition else no
        count = np.count_nonzero(condition)
        if count == 0:
            return no
        return yes if count == condition.size else np.where(condition, yes, no)

    def any(self, condition: Truth, /) -> bool:
        """Return whether a condition holds in some row."""
        return bool(np.count_nonzero(condition))

    def select2(self, condition: Truth, yes: Plane, no: Plane) -> Plane:
        """Choose between two plane vectors, and count the rows once."""
        if condition is True or condition is False or yes is no:
            return yes if condition is not False else no
        count = np.count_nonzero(condition)
        if count == 0:
            return no
        if count == condition.size:
            return yes
        return np.where(condition, yes[0], no[0]), np.where(condition, yes[1], no[1])

    def unit2(self, v: Plane, length: Real) -> Plane:
        """Return the direction of a plane vector; few batches have a length of zero."""
        nonzero = length > 0
        if np.count_nonzero(nonzero) < np.size(nonzero):
            return super().unit2(v, length)
        inverse = 1.0 / length
        return v[0] * inverse, v[1] * inverse

    def within_one(self, share: Real) -> Real:
        """Return the share that is nearest and from 0 to 1."""
        return np.minimum(np.maximum(share, 0.0), 1.0)

    def pack(
        self, shape: tuple[int, ...], like: Array, value: Real | tuple[Real, ...], plus: Real = 0.0
    ) -> Array:
        """Make an array and fill it."""
        packed = np.empty(
            (*shape, len(value)) if isinstance(value, tuple) else shape, dtype=like.dtype
        )
        self.fill(packed, value, plus)
        return packed

    def fill(self, array: Array, value: Real | tuple[Real, ...], plus: Real) -> None:
        """Write value + plus to an array."""
        if isinstance(value, tuple) and array.ndim > 1:
            for index, part in enumerate(value):
                array[..., index] = part
            array += plus[..., np.newaxis] if isinstance(plus, np.ndarray) else plus
        elif isinstance(value, tuple):
            for index, part in enumerate(value):
                array[index] = part + plus
        elif array.ndim and array.dtype.kind == "f":
            np.add(value, plus, out=array, casting="same_kind")
        else:
            array[...] = value + plus


class Floats(Library):
    """Python's floats, for single states."""

    sqrt = staticmethod(math.sqrt)
    maximum = staticmethod(max)
    minimum = staticmethod(min)
    any = staticmethod(bool)

    def select(self, condition: Truth, yes: Real, no: Real) -> Real:
        """Choose one of two numbers."""
        return yes if condition else no

    def select2(self, condition: Truth, yes: Plane, no: Plane) -> Plane:
        """Choose one of two plane vectors."""
        return yes if condition else no

    def select_all(self, condition: Truth, yes: AnyRecord, no: AnyRecord) -> AnyRecord:
        """Choose one of two records."""
        return yes if condition else no

    def unit2(self, v: Plane, length: Real) -> Plane:
        """Return the direction of a plane vector of known length; the x axis if the length is zero."""
        inverse = 1.0 / (length if length > 0 else 1.0)
        return v[0] * inverse if length > 0 else 1.0, v[1] * inverse

    def within_one(self, share: Real) -> Real:
        """Return the share that is nearest and from 0 to 1."""
        if share < 0.0:
            return 0.0
        return 1.0 if share > 1.0 else share

    def sign(self, value: float) -> int:
        """Return 1, 0 or −1."""
        return (value > 0) - (value < 0)


NUMPY = NumPy(np)
FLOATS = Floats(math)

DOUBLE = np.dtype(np.float64)


def vectors(
    named: dict[str, Any], parameters: Sequence[Array] = ()
) -> tuple[Library, dict[str, Array]]:
    """Convert named vectors to real arrays of the widest precision among them and some arrays of parameters.

    Returns:
        The array library, and the vectors as its arrays.

    Raises:
        ConfigError: one is no array of numbers, or they belong to different libraries.
    """
    if all(
        type(value) is np.ndarray and value.dtype is DOUBLE
        for value in (*named.values(), *parameters)
    ):
        return NUMPY, named
    arrays = {name: value for name, value in named.items() if is_array_api_obj(value)}
    arrays |= {f"parameter {number + 1}": value for number, value in enumerate(parameters)}
    module = library_of(arrays) if arrays else np
    xp = NUMPY if is_numpy_namespace(module) else Differentiating(module)
    taken: dict[str, Array] = {}
    for name, value in named.items():
        if isinstance(value, np.ma.MaskedArray):
            raise ConfigError(
                f"{name} = {value!r}: must not be a masked array; fill it, or leave those rows out"
            )
        try:
            taken[name] = as_reals(value if is_array_api_obj(value) else xp.asarray(value))
        except (TypeError, ValueError, RuntimeError):
            raise ConfigError(
                f"{name} = {value!r}: must be an array of shape (..., 3) of real numbers"
            ) from None
    wide = xp.result_type(*(array.dtype for array in (*taken.values(), *parameters)))
    return xp, {
        name: array if array.dtype == wide else xp.astype(array, wide)
        for name, array in taken.items()
    }


def library_of(arrays: dict[str, Array]) -> Any:  # noqa: ANN401 - a module has no type of its own
    """Return the module of named arrays.

    Raises:
        ConfigError: they belong to different libraries.
    """
    try:
        return array_namespace(*arrays.values())
    except TypeError:
        kinds = ", ".join(f"{name}: {type(value).__name__}" for name, value in arrays.items())
        raise ConfigError(
            f"arrays of different libraries cannot be mixed: {kinds}; convert states and parameters to one library"
        ) from None


def as_reals(array: Array) -> Array:
    """Return an array as floating point numbers; floating point arrays are not changed.

    Raises:
        TypeError: it holds complex numbers, or no numbers.
        ValueError: an object in it is no number.
    """
    xp = array_namespace(array)
    if is_numpy_namespace(xp) and array.dtype.kind == "O":
        return array.astype(np.float64)
    if xp.isdtype(array.dtype, ("integral", "bool")):
        return xp.astype(array, xp.float64)
    if not xp.isdtype(array.dtype, "real floating"):
        raise TypeError(f"{array.dtype} are no real numbers")
    return array


def mapped(function: Callable[..., Any], first: AnyRecord, *others: AnyRecord) -> AnyRecord:
    """Return the record of a function's results for the numbers at the same place of each record.

    A record is a tuple, named or not, or a dataclass. It has numbers and records in it.
    """
    if isinstance(first, tuple):
        parts = tuple(
            mapped(function, *fields_at) for fields_at in zip(first, *others, strict=True)
        )
        return cast("AnyRecord", type(first)(*parts) if hasattr(first, "_fields") else parts)
    if hasattr(first, "__dataclass_fields__"):
        names = [part.name for part in fields(first) if part.init]
        parts = mapped(
            function,
            *(tuple(getattr(record, name) for name in names) for record in (first, *others)),
        )
        return replace(first, **dict(zip(names, parts, strict=True)))
    return cast("AnyRecord", function(first, *others))


def component(array: Array, index: int) -> Real:
    """Return one component, (..., 3) → (...); a scalar for a single state."""
    return array[..., index][()] if isinstance(array, np.ndarray) else array[..., index]


def components(array: Array) -> Space:
    """Return all three components, (..., 3) → three of (...)."""
    return component(array, 0), component(array, 1), component(array, 2)


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
    back = u - difference
    lost = (u - (difference + back)) + (back - v)
    (a, a_lost), (b, b_lost), (c, c_lost) = (_square(part) for part in (difference, *w))
    total = b + c
    total_lost = b - (total - (total - b)) + (c - (total - b))
    remainder = (a - total) + (a_lost - b_lost - c_lost - total_lost + 2.0 * difference * lost)
    return remainder / (difference + pair_length(w))


def _square(value: Real) -> tuple[Real, Real]:
    """Return the rounded square and its rounding error (Dekker, for double precision)."""
    square = value * value
    scaled = 134217729.0 * value
    high = scaled - (scaled - value)
    low = value - high
    return square, ((high * high - square) + 2.0 * high * low) + low * low


def dot2(a: Plane, b: Plane) -> Real:
    """Scalar product of two plane vectors."""
    return a[0] * b[0] + a[1] * b[1]


def dot3(a: Space, b: Space) -> Real:
    """Scalar product of two vectors in space."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def plus3(a: Space, factor: Real, b: Space) -> Space:
    """Return a + factor·b."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


def times3(factor: Real, a: Space) -> Space:
    """Return factor·a."""
    return factor * a[0], factor * a[1], factor * a[2]


def cross2(a: Plane, b: Plane) -> Real:
    """Cross product of two plane vectors: positive if b lies to the left of a."""
    return a[0] * b[1] - a[1] * b[0]


def along2(n: Plane, v: Plane) -> Plane:
    """Return the components of a plane vector along and across a direction."""
    return v[0] * n[0] + v[1] * n[1], v[1] * n[0] - v[0] * n[1]


def in_plane(n: Plane, v: Plane) -> Plane:
    """Return a vector that is given by its components along and across n."""
    return v[0] * n[0] - v[1] * n[1], v[0] * n[1] + v[1] * n[0]


def times2(factor: Real, a: Plane) -> Plane:
    """Return factor·a."""
    return factor * a[0], factor * a[1]


def plus2(a: Plane, factor: Real, b: Plane) -> Plane:
    """Return a + factor·b."""
    return a[0] + factor * b[0], a[1] + factor * b[1]
