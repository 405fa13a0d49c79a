"""Records of numbers: each is checked and kept as a float, an array of them as a floating point array.

So that a record is the same whichever kind of number it was written with, equal and hashed by its numbers.
"""

import math
from collections.abc import Callable
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from guidance.errors import ConfigError
from guidance.game.arrays import Array, Real, as_reals, is_array

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def same_record(one: "DataclassInstance", other: object) -> bool:
    """Say whether two records hold the same numbers; an array is compared as a whole, not row by row."""
    return type(one) is type(other) and _numbers(one) == _numbers(other)


def record_hash(record: "DataclassInstance") -> int:
    """Return what equal records share."""
    return hash(_numbers(record))


def _numbers(record: "DataclassInstance") -> tuple[Any, ...]:
    """Return a record's numbers as something that can be compared and hashed."""
    return tuple(_key(getattr(record, part.name)) for part in fields(record) if part.init)


def _key(value: Any) -> Any:  # noqa: ANN401 - whatever a record holds
    if isinstance(value, tuple):
        return tuple(map(_key, value))
    return (value.shape, (np.asarray(value) + 0.0).tobytes()) if is_array(value) else value


def rows_of(record: "DataclassInstance", rows: Callable[[Array], Array]) -> dict[str, Any]:
    """Return every number of a record that is an array, as `rows` takes its rows from it."""
    values = {part.name: getattr(record, part.name) for part in fields(record) if part.init}
    return {name: rows(value) for name, value in values.items() if is_array(value)}


def take_fields(record: "DataclassInstance", *, zero_allowed: bool = False) -> None:
    """Check every number of a record."""
    for part in fields(record):
        take(record, part.name, zero_allowed=zero_allowed)


def take(record: "DataclassInstance", name: str, *, zero_allowed: bool = False) -> None:
    """Check a number of a record and keep it as a float; an array is judged row by row in `solve`."""
    value = getattr(record, name)
    if type(value) is not float:
        object.__setattr__(record, name, as_reals(value) if is_array(value) else _float(value))
    if not is_array(value):
        require(name, value, zero_allowed=zero_allowed)


def take_pair(record: "DataclassInstance", name: str, *, rows_allowed: bool = False) -> None:
    """Check a velocity in the plane and keep it as two floats, or as rows of them."""
    pair = getattr(record, name)
    try:
        parts = tuple(pair)
    except TypeError:
        parts = ()
    rows = rows_allowed and any(map(is_array, parts))
    if [(rows and is_array(part)) or is_finite(part) for part in parts] != [True, True]:
        raise ConfigError(f"{name} = {pair!r}: must be two finite numbers (x, y), m/s")
    object.__setattr__(record, name, tuple(as_reals(part) if is_array(part) else float(part) for part in parts))


def require_kind(name: str, value: object, kinds: tuple[type, ...], allowed: str) -> None:
    """Refuse a value that is none of some kinds, by its name and with what is allowed.

    Args:
        name: of the field.
        value: as given.
        kinds: the types that are allowed.
        allowed: what is allowed, for people.
    """
    if not isinstance(value, kinds):
        raise ConfigError(f"{name} = {value!r}: must be {allowed}")


def _float(value: Real) -> Real:
    return float(value) if is_finite(value) else value


def require(name: str, value: Real, *, zero_allowed: bool = False) -> None:
    """Refuse a number out of range by its name."""
    if not is_finite(value) or value < 0 or (value == 0 and not zero_allowed):
        allowed = "zero or more" if zero_allowed else "more than zero"
        raise ConfigError(f"{name} = {value!r}: must be a finite number, {allowed}")


def is_finite(value: Real) -> bool:
    """Say whether a value is a finite number."""
    try:
        return math.isfinite(value)
    except (TypeError, OverflowError):
        return False


def is_zero(value: Real) -> bool:
    """Say whether a parameter is switched off, an array of NumPy in every row."""
    if type(value) is float:
        return value == 0.0
    return not value.any() if isinstance(value, np.ndarray) else not is_array(value) and bool(value == 0)
