"""Records of numbers: each number is checked and kept as a float, each array as a floating point array.

Records are equal, and have the same hash, if their numbers are equal; the types given do not matter.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np

from guidance.errors import ConfigError
from guidance.game.arrays import AnyRecord, Array, Real, Truth, as_reals, is_array, mapped


@dataclass(frozen=True, slots=True, eq=False)
class Numbers:
    """A record of numbers that are checked; two are equal if they hold the same, arrays compared as a whole."""

    zero_allowed = False

    def __post_init__(self) -> None:
        for part in fields(self):
            take(self, part.name, zero_allowed=self.zero_allowed)

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple[Any, ...]:
        return tuple(_key(getattr(self, part.name)) for part in fields(self) if part.init)


def names_of(record: Numbers) -> tuple[str, ...]:
    """Return the names of a record's fields."""
    kind: Any = type(record)
    names = _NAMES.get(kind)
    if names is None:
        names = tuple(part.name for part in fields(kind))
        _NAMES[kind] = names
    return names


_NAMES: Final[dict[Any, tuple[str, ...]]] = {}
"""Names by kind of record, kept because a flight needs them in every cycle."""


def exchanged(record: AnyRecord, **values: object) -> AnyRecord:
    """Return a record with other values, without checking them."""
    kind = type(record)
    names = _NAMES.get(kind)
    if names is None:
        names = names_of(record)
    copy: AnyRecord = object.__new__(kind)
    for name in names:
        object.__setattr__(copy, name, values[name] if name in values else getattr(record, name))
    return copy


def _key(value: Any) -> Any:  # noqa: ANN401 - whatever a record holds
    if isinstance(value, tuple):
        return tuple(map(_key, value))
    return (value.shape, (np.asarray(value) + 0.0).tobytes()) if is_array(value) else value


def rows_of(value: Any, rows: Callable[[Array], Array]) -> Any:  # noqa: ANN401 - a record, a tuple, a number
    """Return a record of numbers and arrays with the rows that `rows` takes from each array, also in records in it."""
    return mapped(lambda part: rows(part) if is_array(part) else part, value)


def in_rows(
    selected: Truth,
    default: AnyRecord,
    function: Callable[..., AnyRecord],
    *records: Any,  # noqa: ANN401
) -> AnyRecord:
    """Replace the selected rows of a record by a function of the same rows of other records.

    Without NumPy, the function is applied to all rows.
    """
    if isinstance(selected, (bool, np.bool_)):
        return function(*records) if selected else default
    if not isinstance(selected, np.ndarray):
        return function(*records)
    count = np.count_nonzero(selected)
    if count == selected.size:
        return function(*records)
    if count == 0:
        return default
    shape = selected.shape
    rows = np.flatnonzero(selected)
    axes = np.unravel_index(rows, shape) if len(shape) > 1 else (rows,)

    def few(array: Array) -> Array:
        if array.shape == shape:
            return array.take(rows)
        lengths = array.shape
        places = axes[len(shape) - len(lengths) :]
        return array[
            tuple(
                place if length > 1 else np.zeros_like(place)
                for place, length in zip(places, lengths, strict=True)
            )
        ]

    def filled(all_rows: Real, values: Array) -> Array:
        full = np.empty(shape, dtype=np.result_type(values))
        full[...] = all_rows
        full.reshape(-1)[rows] = values
        return full

    return mapped(filled, default, function(*(rows_of(record, few) for record in records)))


def take(record: Numbers, name: str, *, zero_allowed: bool = False) -> None:
    """Check a number of a record and keep it as a float; `solve` checks arrays row by row."""
    value = getattr(record, name)
    if not is_array(value):
        require(name, value, zero_allowed=zero_allowed)
    if type(value) is not float:
        object.__setattr__(record, name, _reals(name, value) if is_array(value) else float(value))


def take_pair(record: Numbers, name: str, *, rows_allowed: bool = False) -> None:
    """Check a velocity in the plane and keep it as two floats, or as rows of them."""
    pair = getattr(record, name)
    try:
        parts = tuple(pair)
    except TypeError:
        parts = ()
    if [(rows_allowed and is_array(part)) or is_finite(part) for part in parts] != [True, True]:
        raise ConfigError(f"{name} = {pair!r}: must be two finite numbers (x, y), m/s")
    object.__setattr__(
        record, name, tuple(_reals(name, part) if is_array(part) else float(part) for part in parts)
    )


def _reals(name: str, value: Array) -> Array:
    try:
        return as_reals(value)
    except (TypeError, ValueError) as error:
        raise ConfigError(
            f"{name} = {value!r}: must be an array of real numbers; {error}"
        ) from None


def require_kind(name: str, value: object, kinds: tuple[type, ...], allowed: str) -> None:
    """Refuse a value of another type.

    Args:
        name: of the field.
        value: as given.
        kinds: the types that are allowed.
        allowed: description of the allowed values for the message.
    """
    if not isinstance(value, kinds):
        raise ConfigError(f"{name} = {value!r}: must be {allowed}")


def require(name: str, value: Real, *, zero_allowed: bool = False) -> None:
    """Refuse a number that is out of range."""
    if not is_finite(value) or value < 0 or (value == 0 and not zero_allowed):
        allowed = "zero or more" if zero_allowed else "more than zero"
        raise ConfigError(f"{name} = {value!r}: must be a finite number, {allowed}")


def is_finite(value: Real) -> bool:
    """Return whether a value is a finite number."""
    try:
        return math.isfinite(value)
    except (TypeError, OverflowError):
        return False


def is_zero(value: Real) -> bool:
    """Return whether a parameter is zero, a NumPy array in every row."""
    if type(value) is float:
        return value == 0.0
    return (
        not value.any()
        if isinstance(value, np.ndarray)
        else not is_array(value) and bool(value == 0)
    )
