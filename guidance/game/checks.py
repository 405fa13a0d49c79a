"""Checks of parameters, with errors that name the parameter, its value and what is allowed."""

import math
from dataclasses import fields
from typing import Any

from guidance.errors import ConfigError
from guidance.game.arrays import Real


def require_fields(record: Any, *, zero_allowed: bool = False) -> None:  # noqa: ANN401
    """Check every field of a frozen record."""
    for field in fields(record):
        require(field.name, getattr(record, field.name), zero_allowed=zero_allowed)


def require(name: str, value: Real, *, zero_allowed: bool = False) -> None:
    """Refuse a number out of range by its name; arrays are judged row by row in `solve`."""
    if is_array(value):
        return
    if not is_finite(value) or value < 0 or (value == 0 and not zero_allowed):
        allowed = "zero or more" if zero_allowed else "more than zero"
        raise ConfigError(f"{name} = {value!r}: must be a finite number, {allowed}")


def is_finite(value: Real) -> bool:
    return not isinstance(value, (str, bytes, type(None))) and math.isfinite(value)


def is_array(value: Real) -> bool:
    return hasattr(value, "shape") and value.shape != ()


def is_number(value: Real) -> bool:
    return not is_array(value)
