"""Checked tables (from files or requests): keys with meaning, default and allowed values."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from sitl_mock.errors import ConfigError

if TYPE_CHECKING:
    from pathlib import Path

REQUIRED: Final = object()


@dataclass(frozen=True)
class Option:
    """One key of a table.

    Attributes:
        meaning: Description with unit.
        default: Default value; REQUIRED if there is none.
        check: Converts a value from a file; raises ValueError with the allowed values.
    """

    meaning: str
    default: Any
    check: Callable[[Any], Any]


def read_toml(path: Path, name: str) -> dict[str, Any]:
    """Return the values of a TOML file.

    Args:
        path: The file.
        name: Names the file in an error.

    Raises:
        ConfigError: The file cannot be read, or is no TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{name} {path}: cannot be read ({error.strerror})") from None
    except RecursionError:
        raise ConfigError(
            f"{name} {path}: not valid TOML here: arrays or tables are nested too deeply"
        ) from None
    except ValueError as error:  # not TOML, not UTF-8, or an integer with thousands of digits
        raise ConfigError(f"{name} {path}: not valid TOML: {error}") from None


def filled(values: Mapping[str, Any], options: Mapping[str, Option], where: str) -> dict[str, Any]:
    """Return the checked value or the default of every key.

    Args:
        values: The given table; keys without an option are ignored.
        options: Options by key.
        where: Names the table in an error.

    Raises:
        ConfigError: A key is missing, or its value is not allowed.
    """
    result = {}
    for name, option in options.items():
        if name in values:
            result[name] = checked(f"{where}.{name}", values[name], option)
        elif option.default is REQUIRED:
            raise ConfigError(f"{where}.{name} is missing: {option.meaning}")
        else:
            result[name] = option.default
    return result


def table(values: Any, options: Mapping[str, Option], where: str) -> dict[str, Any]:  # noqa: ANN401 - as below
    """Do as `filled`, but refuse other keys.

    Args:
        values: The given table.
        options: Options by key.
        where: Names the table in an error.

    Raises:
        ConfigError: It is not a table, a key is unknown or missing, or its value is not allowed.
    """
    if not isinstance(values, Mapping):
        raise ConfigError(f"{where} = {values!r}: allowed is a table of keys")
    unknown = sorted(values.keys() - options.keys())
    if unknown:
        raise ConfigError(
            f"{where}.{unknown[0]} = {values[unknown[0]]!r} is not known; allowed are {', '.join(options)}"
        )
    return filled(values, options, where)


def checked(where: str, value: Any, option: Option) -> Any:  # noqa: ANN401 - anything may stand in a file
    """Return a checked value.

    Raises:
        ConfigError: The value is not allowed.
    """
    try:
        return option.check(value)
    except ValueError as error:
        allowed = str(error) or "only the default of the kind"
        raise ConfigError(f"{where} = {value!r}: allowed is {allowed}") from None


def number(low: float, high: float) -> Callable[[Any], float]:
    """Accept a number within limits."""

    def check(value: Any) -> float:  # noqa: ANN401 - anything may stand in a file
        if (
            isinstance(value, bool)
            or not isinstance(value, (int, float))
            or not low <= value <= high
        ):
            raise ValueError(f"a number from {low:g} to {high:g}")
        return float(value)

    return check


def integer(low: int, high: int) -> Callable[[Any], int]:
    """Accept a whole number within limits."""

    def check(value: Any) -> int:  # noqa: ANN401 - anything may stand in a file
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise ValueError(f"a whole number from {low} to {high}")
        return value

    return check


def integers(low: int, high: int) -> Callable[[Any], frozenset[int]]:
    """Accept one whole number or a list of them."""
    one = integer(low, high)

    def check(value: Any) -> frozenset[int]:  # noqa: ANN401 - anything may stand in a file
        if isinstance(value, (list, tuple)):
            items = value
        else:
            items = [value]
        try:
            return frozenset(one(item) for item in items)
        except ValueError:
            raise ValueError(f"whole numbers from {low} to {high}") from None

    return check


def text(value: Any) -> str:  # noqa: ANN401 - anything may stand in a file
    """Accept a text that is not empty."""
    if not isinstance(value, str) or not value:
        raise ValueError("a text")
    return value


def words(value: Any) -> tuple[str, ...]:  # noqa: ANN401 - anything may stand in a file
    """Accept a word or a list of them."""
    if isinstance(value, str):
        items = [value]
    else:
        items = value
    if not isinstance(items, (list, tuple)) or not all(
        isinstance(item, str) and item for item in items
    ):
        raise ValueError("a word or a list of words")
    return tuple(items)


def choice(*allowed: str) -> Callable[[Any], str]:
    """Accept one of some words."""

    def check(value: Any) -> str:  # noqa: ANN401 - anything may stand in a file
        if value not in allowed:
            raise ValueError(", ".join(allowed))
        return str(value)

    return check


def flag(value: Any) -> bool:  # noqa: ANN401 - anything may stand in a file
    """Accept true or false."""
    if not isinstance(value, bool):
        raise ValueError("true or false")  # noqa: TRY004 - one kind of error for every wrong value
    return value


def matching(pattern: str, meaning: str) -> Callable[[Any], str]:
    """Accept a text that matches a pattern as a whole."""

    def check(value: Any) -> str:  # noqa: ANN401 - anything may stand in a file
        if not isinstance(value, str) or not re.fullmatch(pattern, value):
            raise ValueError(meaning)
        return value

    return check


def place(value: Any) -> tuple[float, float, float]:  # noqa: ANN401 - anything may stand in a file
    """Accept three finite numbers."""
    if not isinstance(value, (list, tuple)) or len(value) != 3 or not all(map(_finite, value)):
        raise ValueError("three numbers")
    north, east, down = value
    return float(north), float(east), float(down)


def numbers(value: Any) -> dict[str, float]:  # noqa: ANN401 - anything may stand in a file
    """Accept a table of finite numbers."""
    if not isinstance(value, Mapping) or not all(map(_finite, value.values())):
        raise ValueError("a table of numbers")
    return {str(name): float(number) for name, number in value.items()}


def _finite(value: Any) -> bool:  # noqa: ANN401 - as above
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
