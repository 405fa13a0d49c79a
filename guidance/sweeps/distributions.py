"""Distributions of swept values. A draw is a function of the seed and the key alone, so that every worker, every policy
and every point of a grid draws the same numbers for one seed.
"""  # noqa: D205 - one sentence needs two lines

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from guidance.config import as_toml
from guidance.errors import ConfigError
from guidance.strategies import uniform

Seeds = NDArray[np.int64]

_WIDE: Final = 2.5
"""So many standard deviations of a normal distribution are shown in bins."""


class Distribution(Protocol):
    """What the values of a key are drawn from."""

    def draw(self, seed: Seeds, stream: int) -> list[Any]:
        """Draw one value for each seed."""

    def extremes(self) -> list[Any]:
        """Values that bound what is drawn, or, without bounds, one from the middle."""


@dataclass(frozen=True, slots=True)
class Number:
    """A number by one of scipy's continuous distributions; what it draws beyond a key's range is an invalid row.

    Attributes:
        frozen: scipy's distribution with its parameters.
    """

    frozen: Any

    def draw(self, seed: Seeds, stream: int) -> list[Any]:
        """See `Distribution`."""
        # Rounding may put a draw beside the end of its range.
        return list(np.clip(self.frozen.ppf(uniform(seed, stream, 0)), *self.frozen.support()).tolist())

    def extremes(self) -> list[Any]:
        """See `Distribution`."""
        ends = [float(end) for end in self.frozen.support()]
        return ends if all(map(math.isfinite, ends)) else [float(self.frozen.median())]

    @property
    def shown(self) -> tuple[float, float]:
        """From where to where it is shown in bins."""
        low, high = (float(end) for end in self.frozen.support())
        mean, wide = float(self.frozen.mean()), _WIDE * float(self.frozen.std())
        return max(low, mean - wide) if math.isinf(low) else low, min(high, mean + wide) if math.isinf(high) else high


@dataclass(frozen=True, slots=True)
class Choice:
    """Any of some values, all as likely."""

    values: tuple[Any, ...]

    def draw(self, seed: Seeds, stream: int) -> list[Any]:
        """See `Distribution`."""
        places = (uniform(seed, stream, 0) * len(self.values)).astype(int)
        return [self.values[place] for place in places.tolist()]

    def extremes(self) -> list[Any]:
        """See `Distribution`."""
        return list(self.values)


@dataclass(frozen=True, slots=True)
class Annulus:
    """A place (x, y) evenly by area, from one radius to another about a centre, m."""

    inner_m: float
    outer_m: float
    centre_m: tuple[float, float]

    def draw(self, seed: Seeds, stream: int) -> list[Any]:
        """See `Distribution`."""
        inner, outer = self.inner_m**2, self.outer_m**2
        radius = np.sqrt(inner + (outer - inner) * uniform(seed, stream, 0))
        angle = 2.0 * np.pi * uniform(seed, stream, 1)
        x, y = self.centre_m
        return list(np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=-1).tolist())

    def extremes(self) -> list[Any]:
        """See `Distribution`."""
        (x, y), r = self.centre_m, self.outer_m
        return [[x + r, y], [x - r, y], [x, y + r], [x, y - r]]


def distribution_of(name: str, table: Mapping[str, Any]) -> Distribution:
    """Read the distribution of a key.

    Args:
        name: Key, for messages.
        table: As in a sweep file: `{ uniform = [1, 5] }`, `{ disc = 40, about_m = [0, 10] }`.

    Raises:
        ConfigError: If it is none; the message says what is allowed.
    """
    kinds = [kind for kind in table if kind in _KINDS]
    if len(kinds) != 1 or set(table) - {kinds[0], "about_m"}:
        raise ConfigError(f"random.{name} = {as_toml(table)}: must be one of {_ALLOWED}")
    kind = kinds[0]
    if "about_m" in table and kind not in {"disc", "annulus"}:
        raise ConfigError(f"random.{name}.about_m: only with disc or annulus")
    try:
        return _KINDS[kind](table)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"random.{name} = {as_toml(table)}: must be {_FORMS[kind]}") from error


def _pair(value: Any) -> tuple[float, float]:  # noqa: ANN401 - from a file
    low, high = value
    if any(isinstance(one, bool) or not isinstance(one, (int, float)) or not math.isfinite(one) for one in value):
        raise ValueError
    return float(low), float(high)


def _rising(value: Any, *, above: float = -math.inf) -> tuple[float, float]:  # noqa: ANN401
    low, high = _pair(value)
    if not above < low < high:
        raise ValueError
    return low, high


def _uniform(table: Mapping[str, Any]) -> Distribution:
    low, high = _rising(table["uniform"])
    return Number(stats.uniform(low, high - low))


def _normal(table: Mapping[str, Any]) -> Distribution:
    mean, deviation = _pair(table["normal"])
    if deviation <= 0.0:
        raise ValueError
    return Number(stats.norm(mean, deviation))


def _choice(table: Mapping[str, Any]) -> Distribution:
    values = table["choice"]
    if not isinstance(values, list) or not values:
        raise ValueError
    return Choice(tuple(values))


def _annulus(table: Mapping[str, Any]) -> Distribution:
    inner, outer = (0.0, table["disc"]) if "disc" in table else table["annulus"]
    inner, outer = _pair((inner, outer))
    if not 0.0 <= inner < outer:
        raise ValueError
    return Annulus(inner, outer, _pair(table.get("about_m", (0.0, 0.0))))


_KINDS: Mapping[str, Callable[[Mapping[str, Any]], Distribution]] = MappingProxyType(
    {
        "uniform": _uniform,
        "log_uniform": lambda table: Number(stats.loguniform(*_rising(table["log_uniform"], above=0.0))),
        "normal": _normal,
        "choice": _choice,
        "disc": _annulus,
        "annulus": _annulus,
    }
)
_FORMS: Final = MappingProxyType(
    {
        "uniform": "{ uniform = [low, high] } with low < high",
        "log_uniform": "{ log_uniform = [low, high] } with 0 < low < high",
        "normal": "{ normal = [mean, deviation] } with a deviation above 0",
        "choice": "{ choice = [value, …] }",
        "disc": "{ disc = radius } in m, with about_m = [x, y] if not about zero",
        "annulus": "{ annulus = [inner, outer] } in m with 0 <= inner < outer, with about_m = [x, y] if not about zero",
    }
)
_ALLOWED: Final = "; ".join(_FORMS.values())
DISTRIBUTIONS: Final = tuple(_KINDS)
"""Names of the distributions."""
