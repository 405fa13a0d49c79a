"""Checks of parameters, with errors that name the parameter, its value and what is allowed."""

import math
from dataclasses import fields
from typing import TYPE_CHECKING

from guidance.errors import ConfigError
from guidance.game.arrays import Real

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def require_fields(record: "DataclassInstance", *, zero_allowed: bool = False) -> None:
    """Refuse a record with a number out of range."""
    for field in fields(record):
        require(field.name, getattr(record, field.name), zero_allowed=zero_allowed)


def require(name: str, value: Real, *, zero_allowed: bool = False) -> None:
    """Refuse a number out of range by its name. Arrays are judged row by row in `solve`."""
    if is_array(value):
        return
    if not is_finite(value) or value < 0 or (value == 0 and not zero_allowed):
        allowed = "zero or more" if zero_allowed else "more than zero"
        raise ConfigError(f"{name} = {value!r}: must be a finite number, {allowed}")


def require_pair(name: str, pair: object) -> None:
    """Refuse what is not two finite numbers."""
    if not isinstance(pair, tuple) or len(pair) != 2 or not all(is_finite(part) for part in pair):
        raise ConfigError(f"{name} = {pair!r}: must be a tuple of two finite numbers (x, y), m/s")


def is_finite(value: Real) -> bool:
    """Say whether a value is a finite number."""
    try:
        return math.isfinite(value)
    except TypeError:
        return False


def is_array(value: Real) -> bool:
    """Say whether a parameter holds one number for each row of a batch."""
    return getattr(value, "shape", ()) != ()


def is_zero(value: Real) -> bool:
    """Say whether a parameter is switched off; an array of them never is."""
    return not is_array(value) and bool(value == 0)
