"""An axis of a sweep: a key of the scenario with the values it takes, on a grid or at random, and its columns.

A key is named as `pursuer.speed_m_s` or `evader.position_m[0]`.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from guidance.config import as_toml
from guidance.errors import ConfigError
from guidance.sweeps.distributions import DISTRIBUTIONS, Annulus, Distribution, distribution_of

_PART = re.compile(r"(?P<name>[a-z_][a-z0-9_]*)(?P<places>(\[\d+\])*)")

_FIXED = {
    "title": "it names the scenario",
    "description": "it says what the scenario is about",
    "game": "give each game a sweep of its own, and compare the two",
    "seed": "use seeds = 100, or a list of them",
    "expect": "a sweep has a report and no expectations",
    "policy": "use policies = [{ pursuer = …, evader = … }]",
    "waypoints_m": "it belongs to a policy; put it into the scenario",
    "track": "it belongs to a policy; put it into the scenario",
}
"""What is not swept, and what is to be done instead."""

_RANGE = {"from", "to", "count"}


class Key(NamedTuple):
    """A key of a scenario: its text, and the way to it by name and place."""

    text: str
    path: tuple[str | int, ...]

    def at(self, place: int) -> "Key":
        """Return the key of one element of a vector."""
        return Key(f"{self.text}[{place}]", (*self.path, place))


def key_of(text: str) -> Key:
    """Read a key's name.

    Raises:
        ConfigError: If it is none, or one that is not swept.
    """
    path: list[str | int] = []
    for part in text.split("."):
        found = _PART.fullmatch(part)
        if found is None:
            raise ConfigError(f"{text!r}: must be a scenario's key as in pursuer.speed_m_s or evader.position_m[0]")
        path.append(found["name"])
        path.extend(int(place) for place in re.findall(r"\d+", found["places"]))
    names = [part for part in path if isinstance(part, str)]
    for name in (names[0], names[-1]):
        if name in _FIXED:
            raise ConfigError(f"{text}: cannot be swept; {_FIXED[name]}")
    return Key(text, tuple(path))


def placed(node: Any, path: tuple[str | int, ...], value: Any) -> Any:  # noqa: ANN401 - any part of a document
    """Return a copy of a part of a document with a value at a path; nothing that is given is changed.

    Raises:
        LookupError: If an element is asked for where there is no vector, or beyond its end.
    """
    if not path:
        return value
    head, rest = path[0], path[1:]
    if isinstance(head, int):
        if not isinstance(node, (list, tuple)) or head >= len(node):
            raise LookupError(head)
        elements = list(node)
        elements[head] = placed(elements[head], rest, value)
        return elements
    section = node or {}
    return {**section, head: placed(section.get(head), rest, value)}


@dataclass(frozen=True, slots=True)
class Axis:
    """One swept key.

    Attributes:
        key: Of the scenario.
        values: On a grid; empty if drawn at random.
        distribution: What it is drawn from at random; None on a grid.
    """

    key: Key
    values: tuple[Any, ...] = ()
    distribution: Distribution | None = None

    @property
    def stream(self) -> int:
        """The key's own stream of random numbers, whatever else is swept."""
        return int.from_bytes(blake2b(self.key.text.encode(), digest_size=7).digest(), "big")

    def extremes(self) -> list[Any]:
        """Values to check before anything runs: all of a grid's, a distribution's bounds."""
        return list(self.values) if self.distribution is None else self.distribution.extremes()

    def settings(self, value: Any) -> Iterator[tuple[Key, Any]]:  # noqa: ANN401 - any value of a scenario's key
        """What a value sets: a place at random sets x and y and leaves the height."""
        if isinstance(self.distribution, Annulus):
            yield self.key.at(0), value[0]
            yield self.key.at(1), value[1]
        else:
            yield self.key, value

    @property
    def width(self) -> int:
        """How many columns a vector has of its own; 0 for one column."""
        shapes = {len(value) if _is_vector(value) else 0 for value in self.extremes()}
        return shapes.pop() if len(shapes) == 1 else 0

    def columns(self) -> dict[str, pa.DataType]:
        """The columns that show the values, one for each element of a vector."""
        if self.width:
            return {self.key.at(place).text: pa.float64() for place in range(self.width)}
        return {self.key.text: _type_of(self.extremes())}

    def cells(self, values: Sequence[Any]) -> Iterator[pa.Array]:
        """Values as columns, in the order of `columns`."""
        if self.width:
            table = np.array(values, dtype=np.float64).reshape(len(values), self.width)
            yield from (pa.array(column) for column in table.T)
            return
        (kind,) = self.columns().values()
        texts = pa.types.is_string(kind)
        cells = [value if not texts or isinstance(value, str) else json.dumps(value) for value in values]
        yield pa.array(cells, kind)


def grid_axis(text: str, spec: Any) -> Axis:  # noqa: ANN401 - from a file
    """Read an axis of the grid: a list of values, or `{ from = 1, to = 5, count = 9 }`.

    Raises:
        ConfigError: If it is neither, or the key is none that is swept.
    """
    key = key_of(text)
    if isinstance(spec, Mapping):
        return Axis(key, _spaced(text, spec))
    if not isinstance(spec, list) or not spec:
        raise ConfigError(f"grid.{text} = {spec!r}: must be a list of values or {{ from = …, to = …, count = … }}")
    if any(isinstance(value, Mapping) for value in spec):
        raise ConfigError(f"grid.{text}: a value must be a number, a text or a vector; sweep a section key by key")
    if any(value in spec[:place] for place, value in enumerate(spec)):
        raise ConfigError(f"grid.{text} = {spec!r}: a value is given twice")
    return Axis(key, tuple(spec))


def random_axis(text: str, spec: Any) -> Axis:  # noqa: ANN401
    """Read an axis drawn at random; see `distribution_of`.

    Raises:
        ConfigError: If it is none, or the key is none that is swept.
    """
    key = key_of(text)
    distribution = distribution_of(text, spec if isinstance(spec, Mapping) else {str(spec): None})
    if isinstance(distribution, Annulus) and not str(key.path[-1]).endswith("position_m"):
        raise ConfigError(
            f"random.{text} = {as_toml(spec)}: a disc or an annulus is a place: for pursuer.position_m or "
            "evader.position_m as a whole; give each number of another key its own distribution"
        )
    return Axis(key, distribution=distribution)


def flat(table: Mapping[str, Any], prefix: str = "", *, tables: bool = False) -> dict[str, Any]:
    """Bring `pursuer.speed_m_s = …`, which TOML takes for tables in tables, back to whole keys.

    Args:
        table: Of a sweep file.
        prefix: The tables around it.
        tables: Whether the values are tables, as distributions are; one with a value in it is a value then.
    """
    found: dict[str, Any] = {}
    for name, value in table.items():
        inner = isinstance(value, Mapping) and not set(value) & {*_RANGE, *DISTRIBUTIONS} and bool(value)
        if inner and not (tables and any(not isinstance(part, Mapping) for part in value.values())):
            found |= flat(value, f"{prefix}{name}.", tables=tables)
        else:
            found[prefix + name] = value
    return found


def _spaced(text: str, spec: Mapping[str, Any]) -> tuple[float, ...]:
    begin, end = (_number(spec.get(name)) for name in ("from", "to"))
    count = spec.get("count")
    if set(spec) != _RANGE or not math.isfinite(begin - end) or not isinstance(count, int) or count < 2 or begin == end:
        raise ConfigError(
            f"grid.{text} = {as_toml(spec)}: must be {{ from = …, to = …, count = … }}: two different numbers, and how "
            "many values, 2 at least, are spread evenly from one to the other"
        )
    return tuple(np.linspace(begin, end, count).tolist())


def _number(value: Any) -> float:  # noqa: ANN401
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else math.nan


def _is_vector(value: Any) -> bool:  # noqa: ANN401
    return isinstance(value, list) and bool(value) and all(isinstance(one, (int, float)) for one in value)


def _type_of(values: Sequence[Any]) -> pa.DataType:
    kinds = {type(value) for value in values}
    if kinds == {bool}:
        return pa.bool_()
    if kinds == {int}:
        return pa.int64()
    return pa.float64() if kinds <= {int, float} else pa.string()
