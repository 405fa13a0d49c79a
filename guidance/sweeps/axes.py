"""An axis of a sweep: one key of the scenario, as `evader.position_m[0]`, with its values on a grid or at random.

A random draw depends on the seed and the key only. So it is equal for all policies, grid points and workers.
"""

import contextlib
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from hashlib import blake2b
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from guidance.config import Section
from guidance.game.arrays import FloatArray
from guidance.strategies import uniform

Integers = NDArray[np.int64]
Two = tuple[float, float]

_NAME: Final = r"[a-z_][a-z0-9_]*(\[\d+\])*"
_KEY: Final = re.compile(rf"{_NAME}(\.{_NAME})*")

_FIXED: Final = {
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


def path_of(key: str) -> tuple[str | int, ...]:
    """Return the names and places of a key.

    Raises:
        ValueError: If it is not a key, or cannot be swept.
    """
    if not _KEY.fullmatch(key):
        raise ValueError(
            f"{key!r}: must be a scenario's key, as pursuer.speed_m_s or evader.position_m[0]"
        )
    names = re.findall(r"[a-z_]\w*", key)
    for name in (names[0], names[-1]):
        if name in _FIXED:
            raise ValueError(f"{key}: cannot be swept; {_FIXED[name]}")
    parts = re.findall(r"\w+", key)
    return tuple(int(part) if part.isdigit() else part for part in parts)


class Distribution(Section):
    """A distribution; a draw outside a key's range makes an invalid row."""

    uniform: Two | None = Field(None, description="{ uniform = [low, high] } with low < high")
    log_uniform: Two | None = Field(
        None, description="{ log_uniform = [low, high] } with 0 < low < high"
    )
    normal: Two | None = Field(
        None, description="{ normal = [mean, deviation] } with a deviation above 0"
    )
    choice: tuple[Any, ...] = Field((), min_length=1, description="{ choice = [value, …] }")
    disc: float | None = Field(
        None, description="{ disc = radius } in m, with about_m = [x, y] if its centre is not zero"
    )
    annulus: Two | None = Field(
        None,
        description="{ annulus = [inner, outer] } in m, with 0 <= inner < outer, and about_m as for a disc",
    )
    about_m: Two = (0.0, 0.0)

    def _faults(self) -> Iterator[str]:
        forms = {
            name: field.description
            for name, field in type(self).model_fields.items()
            if name != "about_m"
        }
        kinds = [*self.model_fields_set - {"about_m"}]
        if len(kinds) != 1:
            yield f"must be one of {'; '.join(map(str, forms.values()))}"
        if "about_m" in self.model_fields_set and not self.radii_m:
            yield "about_m: only with disc or annulus"
        has_valid_numbers = True
        if self.radii_m:
            inner, outer = self.radii_m
            has_valid_numbers = 0.0 <= inner < outer
        if has_valid_numbers and self.distribution is not None:
            has_valid_numbers = math.isfinite(self.distribution.median())
        if not has_valid_numbers:
            yield f"must be {forms[kinds[0]]}"

    @property
    def radii_m(self) -> Two | None:
        """Radii between which a position (x, y) is uniform by area; None if a value is no position."""
        if self.disc is not None:
            return 0.0, self.disc
        return self.annulus

    @cached_property
    def distribution(self) -> Any:  # noqa: ANN401 - SciPy has no type for it
        """SciPy's distribution of a number; None if a value is a position or a choice."""
        if self.radii_m or self.choice:
            return None
        from scipy import stats  # noqa: PLC0415 - takes half a second, and a grid needs none

        if self.uniform:
            low, high = self.uniform
            return stats.uniform(low, high - low)
        if self.log_uniform:
            return stats.loguniform(*self.log_uniform)
        return stats.norm(*self.normal) if self.normal else None

    @property
    def extremes(self) -> Sequence[Any]:
        """The bounds of its values, or their median if they are unbounded."""
        if self.radii_m:
            (x, y) = self.about_m
            (_, outer) = self.radii_m
            return [[x + outer, y], [x - outer, y], [x, y + outer], [x, y - outer]]
        if self.choice:
            return self.choice
        if self.normal:
            return [float(self.distribution.median())]
        return [float(end) for end in self.distribution.support()]

    def draw(self, first: FloatArray, second: FloatArray) -> list[Any]:
        """Make a value for each seed from two random numbers for each, from 0 to 1."""
        if self.radii_m:
            (inner, outer) = self.radii_m
            (x, y) = self.about_m
            inner_square = inner**2
            outer_square = outer**2
            radius_m = np.sqrt(inner_square + (outer_square - inner_square) * first)
            angle_rad = 2.0 * np.pi * second
            east_m = x + radius_m * np.cos(angle_rad)
            north_m = y + radius_m * np.sin(angle_rad)
            return list(np.stack([east_m, north_m], axis=-1).tolist())
        if self.choice:
            indices = (first * len(self.choice)).astype(int)
            return [self.choice[index] for index in indices.tolist()]
        draws = self.distribution.ppf(first)
        low, high = self.distribution.support()
        # Rounding can put a draw just outside the support.
        return list(np.clip(draws, low, high).tolist())


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
    values: Sequence[Any] = ()
    random: Distribution | None = None

    @property
    def extremes(self) -> Sequence[Any]:
        """The values to check before anything runs."""
        return self.random.extremes if self.random else self.values

    def at(self, place: Integers, seed: Integers) -> list[Any]:
        """Return the value of each row by its place on the grid, or drawn by its seed; each key has its own stream."""
        if self.random is None:
            return [self.values[index] for index in place.tolist()]
        digest = blake2b(self.key.encode(), digest_size=7).digest()
        stream = int.from_bytes(digest, "big")
        first = uniform(seed, stream, 0)
        second = uniform(seed, stream, 1)
        return self.random.draw(first, second)

    def settings(self, value: Any) -> Iterator[tuple[tuple[str | int, ...], Any]]:  # noqa: ANN401 - any value of a key
        """Yield the paths that a value sets; a position (x, y) keeps the height."""
        if self.random is not None and self.random.radii_m:
            for index, part in enumerate(value):
                yield (*self.path, index), part
        else:
            yield self.path, value

    def columns(self) -> dict[str, pa.DataType]:
        """Return names and types of the columns of the values; vectors of one length have one for each element."""
        sizes = set()
        for value in self.extremes:
            is_vector = isinstance(value, list) and _type_of(value) != pa.string()
            sizes.add(len(value) if is_vector else 0)
        if len(sizes) == 1 and (size := sizes.pop()):
            return {f"{self.key}[{index}]": pa.float64() for index in range(size)}
        return {self.key: _type_of(self.extremes)}

    def cells(self, values: Sequence[Any]) -> list[pa.Array]:
        """Return values as columns, in the order of `columns`."""
        kind = self.columns().get(self.key)
        if kind is None:
            columns = np.array(values, dtype=np.float64).T
            return [pa.array(column) for column in columns]
        if kind == pa.string():
            texts = [value if isinstance(value, str) else json.dumps(value) for value in values]
            return [pa.array(texts, kind)]
        return [pa.array(values, kind)]


def _type_of(values: Sequence[Any]) -> pa.DataType:
    kinds = {type(value) for value in values}
    if kinds in ({bool}, {int}):
        return pa.bool_() if kinds == {bool} else pa.int64()
    return pa.float64() if kinds <= {int, float} else pa.string()


MOST_VALUES: Final = 100_000
"""Most values of one key of the grid. They are all held in memory."""


class _Evenly(Section):
    begin: float = Field(alias="from")
    end: float = Field(alias="to")
    count: int = Field(ge=2, le=MOST_VALUES)


def grid_values(spec: Any) -> list[Any]:  # noqa: ANN401 - from a file
    """Return the values of a key of the grid: a list, or those of `{ from = 1, to = 5, count = 9 }`.

    Raises:
        ValueError: If it is neither.
    """
    if isinstance(spec, Mapping):
        with contextlib.suppress(ValidationError):
            even = _Evenly.model_validate(spec)
            if even.begin != even.end:
                return list(np.linspace(even.begin, even.end, even.count).tolist())
        allowed = (
            f"two different numbers, and the number of evenly spaced values, 2 to {MOST_VALUES}"
        )
        raise ValueError(f"must be {{ from = …, to = …, count = … }}: {allowed}")
    if not isinstance(spec, list) or not spec:
        raise ValueError("must be a list of values or { from = …, to = …, count = … }")
    if any(isinstance(value, Mapping) for value in spec):
        raise ValueError("a value must be a number, a text or a vector; sweep a section key by key")
    if len({_hashable(value) for value in spec}) < len(spec):
        raise ValueError("a value is given twice")
    return spec


def _hashable(value: Any) -> Any:  # noqa: ANN401 - any value of a key
    return tuple(map(_hashable, value)) if isinstance(value, list) else value


def flat(
    table: Mapping[str, Any], inner: type | tuple[type, ...], prefix: str = ""
) -> Iterator[tuple[str, Any]]:
    """Turn nested tables, as TOML reads `pursuer.speed_m_s = …`, into keys with dots.

    Args:
        table: Of a sweep file.
        inner: What a table of keys may hold; other tables are values.
        prefix: Names of the enclosing tables.
    """
    for name, value in table.items():
        if (
            isinstance(value, Mapping)
            and value
            and all(isinstance(part, inner) for part in value.values())
        ):
            yield from flat(value, inner, f"{prefix}{name}.")
        else:
            yield prefix + name, value
