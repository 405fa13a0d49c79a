"""An axis of a sweep: one key of the scenario, as `evader.position_m[0]`, with its values on a grid or at random.

A random draw depends on the seed and the key only. So it is equal for all policies, grid points and workers.
"""

import json
import math
import operator
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from hashlib import blake2b
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy import stats

from guidance.config import as_toml
from guidance.errors import ConfigError
from guidance.strategies import uniform

Seeds = NDArray[np.int64]
Array = NDArray[np.float64]

_PART = re.compile(r"(?P<name>[a-z_][a-z0-9_]*)(?P<places>(\[\d+\])*)")

_FIXED = {
    "title": "it names the scenario",
    "description": "it describes the scenario",
    "game": "use one sweep for each game and compare them",
    "seed": "use seeds = 100, or a list of seeds",
    "expect": "a sweep has a report and no expectations",
    "policy": "use policies = [{ pursuer = …, evader = … }]",
    "waypoints_m": "set it in the scenario, beside its policy",
    "track": "set it in the scenario, beside its policy",
}
"""Keys that cannot be swept, and what to do instead."""

_RANGE = {"from", "to", "count"}


def path_of(key: str) -> tuple[str | int, ...]:
    """Return the names and places of a key.

    Raises:
        ConfigError: If it is not a key, or cannot be swept.
    """
    path: list[str | int] = []
    for part in key.split("."):
        found = _PART.fullmatch(part)
        if found is None:
            raise ConfigError(f"{key!r}: must be a scenario's key, as pursuer.speed_m_s or evader.position_m[0]")
        path += [found["name"], *(int(place) for place in re.findall(r"\d+", found["places"]))]
    names = [part for part in path if isinstance(part, str)]
    for name in (names[0], names[-1]):
        if name in _FIXED:
            raise ConfigError(f"{key}: cannot be swept; {_FIXED[name]}")
    return tuple(path)


class Random(NamedTuple):
    """A distribution; a draw outside a key's range makes an invalid row.

    Attributes:
        extremes: The bounds of its values, or their median if they are unbounded.
        draw: Makes a value for each seed from two random numbers for each, from 0 to 1.
        plane: Whether a value is a position (x, y), m.
    """

    extremes: Sequence[Any]
    draw: Callable[[Array, Array], list[Any]]
    plane: bool = False


@dataclass(frozen=True, slots=True)
class Axis:
    """One swept key.

    Attributes:
        key: Of the scenario.
        path: Its names and places.
        values: On a grid; empty for a random axis.
        random: The distribution of a random axis; None on a grid.
    """

    key: str
    path: tuple[str | int, ...]
    values: tuple[Any, ...] = ()
    random: Random | None = None

    @property
    def extremes(self) -> Sequence[Any]:
        """The values to check before anything runs."""
        return self.values if self.random is None else self.random.extremes

    def draw(self, seed: Seeds) -> list[Any]:
        """Draw a value of a random axis for each seed; the key has a stream of random numbers of its own."""
        stream = int.from_bytes(blake2b(self.key.encode(), digest_size=7).digest(), "big")
        return self.random.draw(uniform(seed, stream, 0), uniform(seed, stream, 1)) if self.random else []

    def settings(self, value: Any) -> Iterator[tuple[tuple[str | int, ...], Any]]:  # noqa: ANN401 - any value of a key
        """Yield the paths that a value sets; a position (x, y) keeps the height."""
        if self.random is not None and self.random.plane:
            yield (*self.path, 0), value[0]
            yield (*self.path, 1), value[1]
        else:
            yield self.path, value

    @property
    def width(self) -> int:
        """Number of columns of a vector, one for each element; 0 for a single column."""
        shapes = {len(value) if _is_vector(value) else 0 for value in self.extremes}
        return shapes.pop() if len(shapes) == 1 else 0

    def columns(self) -> dict[str, pa.DataType]:
        """Return names and types of the columns that hold the values."""
        if self.width:
            return {f"{self.key}[{place}]": pa.float64() for place in range(self.width)}
        return {self.key: _type_of(self.extremes)}

    def cells(self, values: Sequence[Any]) -> Iterator[pa.Array]:
        """Yield values as columns, in the order of `columns`."""
        if self.width:
            table = np.array(values, dtype=np.float64).reshape(len(values), self.width)
            yield from (pa.array(column) for column in table.T)
            return
        (kind,) = self.columns().values()
        texts = pa.types.is_string(kind)
        cells = [value if not texts or isinstance(value, str) else json.dumps(value) for value in values]
        yield pa.array(cells, kind)


def grid_axis(key: str, spec: Any) -> Axis:  # noqa: ANN401 - from a file
    """Parse an axis of the grid: a list of values, or `{ from = 1, to = 5, count = 9 }`.

    Raises:
        ConfigError: If it is neither, or the key cannot be swept.
    """
    path = path_of(key)
    if isinstance(spec, Mapping):
        return Axis(key, path, _spaced(key, spec))
    if not isinstance(spec, list) or not spec:
        raise ConfigError(f"grid.{key} = {spec!r}: must be a list of values or {{ from = …, to = …, count = … }}")
    if any(isinstance(value, Mapping) for value in spec):
        raise ConfigError(f"grid.{key}: a value must be a number, a text or a vector; sweep a section key by key")
    if any(value in spec[:place] for place, value in enumerate(spec)):
        raise ConfigError(f"grid.{key} = {spec!r}: a value is given twice")
    return Axis(key, path, tuple(spec))


def random_axis(key: str, spec: Any) -> Axis:  # noqa: ANN401 - from a file
    """Parse a random axis: `{ uniform = [1, 5] }`, `{ disc = 40, about_m = [0, 10] }`.

    Raises:
        ConfigError: If the distribution is unknown or its numbers are wrong, or the key cannot be swept.
    """
    path = path_of(key)
    random = _random(key, spec if isinstance(spec, Mapping) else {str(spec): None})
    if random.plane and not str(path[-1]).endswith("position_m"):
        raise ConfigError(
            f"random.{key} = {as_toml(spec)}: a disc or an annulus is a position: use it for pursuer.position_m or "
            "evader.position_m as a whole; give each number of another key its own distribution"
        )
    return Axis(key, path, random=random)


def flat(table: Mapping[str, Any], prefix: str = "", *, tables: bool = False) -> dict[str, Any]:
    """Turn nested tables, as TOML reads `pursuer.speed_m_s = …`, into keys with dots.

    Args:
        table: Of a sweep file.
        prefix: Names of the enclosing tables.
        tables: Whether the values are tables, as distributions are.
    """
    found: dict[str, Any] = {}
    for name, value in table.items():
        inner = isinstance(value, Mapping) and not set(value) & {*_RANGE, *_KINDS} and bool(value)
        if inner and not (tables and any(not isinstance(part, Mapping) for part in value.values())):
            found |= flat(value, f"{prefix}{name}.", tables=tables)
        else:
            found[prefix + name] = value
    return found


def _random(key: str, table: Mapping[str, Any]) -> Random:
    kind, *more = [name for name in table if name in _KINDS] or [""]
    if kind not in _KINDS or more or set(table) - {kind, "about_m"}:
        allowed = "; ".join(form for form, _ in _KINDS.values())
        raise ConfigError(f"random.{key} = {as_toml(table)}: must be one of {allowed}")
    if "about_m" in table and kind not in {"disc", "annulus"}:
        raise ConfigError(f"random.{key}.about_m: only with disc or annulus")
    form, made = _KINDS[kind]
    try:
        return made(table[kind], table.get("about_m", (0.0, 0.0)))
    except (TypeError, ValueError):
        raise ConfigError(f"random.{key} = {as_toml(table)}: must be {form}") from None


def _pair(value: Any, allowed: Callable[[float, float], bool] = lambda *_: True) -> tuple[float, float]:  # noqa: ANN401
    """Return two finite numbers.

    Raises:
        TypeError, ValueError: If they are none, or not allowed.
    """
    first, second = map(_number, value)
    if not (math.isfinite(first + second) and allowed(first, second)):
        raise ValueError
    return first, second


def _continuous(frozen: Any) -> Random:  # noqa: ANN401 - SciPy's distribution with its parameters
    ends = tuple(float(end) for end in frozen.support())
    return Random(ends if all(map(math.isfinite, ends)) else (float(frozen.median()),), partial(_quantiles, frozen))


def _quantiles(frozen: Any, draw: Array, _: Array) -> list[float]:  # noqa: ANN401
    # Rounding can put a draw just outside the support.
    return list(np.clip(frozen.ppf(draw), *frozen.support()).tolist())


def _choice(values: Any, _: Any) -> Random:  # noqa: ANN401 - from a file
    if not isinstance(values, list) or not values:
        raise ValueError
    return Random(values, partial(_chosen, values))


def _chosen(values: Sequence[Any], draw: Array, _: Array) -> list[Any]:
    return [values[place] for place in (draw * len(values)).astype(int).tolist()]


def _annulus(radii: Any, about: Any) -> Random:  # noqa: ANN401 - from a file
    """Return positions that are uniform by area between two radii about a centre."""
    (inner, outer), (x, y) = _pair(radii, lambda inner, outer: 0.0 <= inner < outer), _pair(about)
    edge = [[x + outer, y], [x - outer, y], [x, y + outer], [x, y - outer]]
    return Random(edge, partial(_placed, inner**2, outer**2, (x, y)), plane=True)


def _placed(inner_m2: float, outer_m2: float, about_m: tuple[float, float], draw: Array, turn: Array) -> list[Any]:
    radius, angle = np.sqrt(inner_m2 + (outer_m2 - inner_m2) * draw), 2.0 * np.pi * turn
    x, y = about_m
    return list(np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=-1).tolist())


def _uniform(value: Any, _: Any) -> Random:  # noqa: ANN401 - from a file
    low, high = _pair(value, operator.lt)
    return _continuous(stats.uniform(low, high - low))


_KINDS: Final[Mapping[str, tuple[str, Callable[[Any, Any], Random]]]] = {
    "uniform": ("{ uniform = [low, high] } with low < high", _uniform),
    "log_uniform": (
        "{ log_uniform = [low, high] } with 0 < low < high",
        lambda value, _: _continuous(stats.loguniform(*_pair(value, lambda low, high: 0.0 < low < high))),
    ),
    "normal": (
        "{ normal = [mean, deviation] } with a deviation above 0",
        lambda value, _: _continuous(stats.norm(*_pair(value, lambda _, deviation: deviation > 0.0))),
    ),
    "choice": ("{ choice = [value, …] }", _choice),
    "disc": (
        "{ disc = radius } in m, with about_m = [x, y] if its centre is not zero",
        lambda radius, about: _annulus((0.0, radius), about),
    ),
    "annulus": (
        "{ annulus = [inner, outer] } in m, 0 <= inner < outer, with about_m = [x, y] if its centre is not zero",
        _annulus,
    ),
}
"""Form of each distribution, and what makes it of the values of its key and of about_m."""


def _spaced(key: str, spec: Mapping[str, Any]) -> tuple[float, ...]:
    begin, end = (_number(spec.get(name)) for name in ("from", "to"))
    count = spec.get("count")
    if set(spec) != _RANGE or not math.isfinite(begin - end) or not isinstance(count, int) or count < 2 or begin == end:
        raise ConfigError(
            f"grid.{key} = {as_toml(spec)}: must be {{ from = …, to = …, count = … }}: two different numbers, and the "
            "number of evenly spaced values, at least 2"
        )
    return tuple(np.linspace(begin, end, count).tolist())


def _number(value: Any) -> float:  # noqa: ANN401 - from a file
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else math.nan


def _is_vector(value: Any) -> bool:  # noqa: ANN401 - from a file
    return isinstance(value, list) and bool(value) and all(isinstance(one, (int, float)) for one in value)


def _type_of(values: Sequence[Any]) -> pa.DataType:
    kinds = {type(value) for value in values}
    if kinds in ({bool}, {int}):
        return pa.bool_() if kinds == {bool} else pa.int64()
    return pa.float64() if kinds <= {int, float} else pa.string()
