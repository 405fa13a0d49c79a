"""The sweep file and its plan: policies, seed and values of every row, and the columns of the table.

A row depends on the plan and the row's number only.
"""

import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple, Self

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import BeforeValidator, ConfigDict, Field, model_validator

from guidance.config import Section, find, load
from guidance.errors import ConfigError
from guidance.sim.outcome import Outcome
from guidance.sim.scenario import EvaderPolicy, PursuerPolicy, Scenario
from guidance.sim.scenario_file import FOLDER as SCENARIOS
from guidance.sim.scenario_file import has_teams, load_any
from guidance.sim.teams import TeamOutcome, TeamScenario
from guidance.sweeps.axes import Axis, flat, grid_axis, random_axis

Way = Literal["maths", "fast"]
"""A row is point masses (maths), or a flight of the mock in virtual time (fast)."""

FOLDER: Final = "sweeps"
ROW: Final = "row"
Rows = NDArray[np.int64]

_TYPES: Final[dict[Any, pa.DataType]] = {str: pa.string(), int: pa.int64(), float: pa.float64()}


class Pair(NamedTuple):
    """Policies of both players."""

    pursuer: str
    evader: str


class Policies(Section):
    """Policies of both players; every pursuer's policy plays every evader's."""

    pursuer: PursuerPolicy | tuple[PursuerPolicy, ...] | None = Field(
        None, description="one or several; default: the scenario's own"
    )
    evader: EvaderPolicy | tuple[EvaderPolicy, ...] | None = Field(None, description="likewise")

    def pairs(self) -> Iterator[tuple[str | None, ...]]:
        """Yield every pursuer's policy with every evader's; None is the scenario's own."""
        return itertools.product(
            *(names if isinstance(names, tuple) else (names,) for names in (self.pursuer, self.evader))
        )


class Seeds(Section):
    """Seeds: `count` of them beginning with `from`, or a list."""

    model_config = ConfigDict(populate_by_name=True)

    begin: int = Field(0, alias="from", ge=0, description="the first")
    count: int = Field(1, ge=1, description="how many")
    values: tuple[Annotated[int, Field(ge=0)], ...] = Field((), alias="list", description="these, instead of both")

    def __len__(self) -> int:
        """Number of seeds."""
        return len(self.values) or self.count

    def at(self, number: Rows) -> Rows:
        """Return the seeds with these numbers."""
        return np.array(self.values, dtype=np.int64)[number] if self.values else number + self.begin


def _seeds(given: Any) -> Any:  # noqa: ANN401 - from a file
    if isinstance(given, int) and not isinstance(given, bool):
        return {"count": given}
    return {"list": given, "count": max(1, len(given))} if isinstance(given, list) else given


class Sweep(Section):
    """A whole sweep file.

    Seeds change fastest from row to row, then the grid, then the policies. A random draw depends on the seed and the
    key only, so rows with equal seeds can be compared pairwise.
    """

    title: str = Field("", description="a few words")
    description: str = Field("", description="what it shows, and why it is as it is")
    scenario: str = Field(description="a scenario's name or path; beside the sweep's file, or with the package")
    way: Way = Field("maths", alias="as", description="maths: point masses; fast: flights of the mock in virtual time")
    rows: int | None = Field(None, ge=1, description="number of rows, instead of seeds")
    seeds: Annotated[Seeds, BeforeValidator(_seeds, json_schema_input_type=int | list[int] | Seeds)] = Field(
        Seeds(), description="how many, a list, or { from = 100, count = 50 }; default: one, 0"
    )
    grid: dict[str, Any] = Field({}, description="keys of the scenario and their values; all combinations are played")
    random: dict[str, Any] = Field({}, description="keys of the scenario and their distributions; one draw a seed")
    policies: tuple[Policies, ...] = Field((), description="which policies play; default: the scenario's own")

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The axes of the grid, then the random ones."""
        grid, random = flat(self.grid), flat(self.random, tables=True)
        return (
            *(grid_axis(key, spec) for key, spec in grid.items()),
            *(random_axis(key, spec) for key, spec in random.items()),
        )

    @property
    def pairs(self) -> Sequence[tuple[str | None, ...]]:
        """The pairs of policies; None is the scenario's own."""
        return [pair for given in self.policies for pair in given.pairs()] or [(None, None)]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.rows is not None and "seeds" in self.model_fields_set:
            raise ValueError("rows, seeds: give only one; rows = seeds × grid points × pairs of policies")
        if len(set(self.pairs)) < len(self.pairs):
            pursuer, evader = next(pair for pair in self.pairs if self.pairs.count(pair) > 1)
            raise ValueError(f"policies: {pursuer} against {evader} is given twice")
        if len(set(self.seeds.values)) < len(self.seeds.values):
            raise ValueError(f"seeds = {list(self.seeds.values)}: a seed is given twice")
        return self


class Cases(NamedTuple):
    """Policies, seeds and values of some rows.

    Attributes:
        row: Numbers of the rows, (n,).
        pair: Numbers of the pairs of policies, (n,).
        seed: (n,).
        values: Of every axis, n each.
    """

    row: Rows
    pair: Rows
    seed: Rows
    values: tuple[list[Any], ...]


@dataclass(frozen=True)
class Plan:
    """A sweep with its scenario; small, and equal wherever it is unpickled.

    Attributes:
        sweep: The sweep file.
        scenario: The scenario as plain values, including all defaults.
        way: "maths" or "fast".
    """

    sweep: Sweep
    scenario: Mapping[str, Any]
    way: Way

    @cached_property
    def teams(self) -> bool:
        """True if teams play; a game then has one table row for each evader."""
        return has_teams(self.scenario)

    @property
    def model(self) -> type[Scenario] | type[TeamScenario]:
        """The model of a row's scenario."""
        return TeamScenario if self.teams else Scenario

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """The swept keys."""
        return self.sweep.axes

    @cached_property
    def pairs(self) -> tuple[Pair, ...]:
        """The pairs of policies, with the names of the scenario's own."""
        own_p, own_e = policy_in(self.scenario["pursuer"]), policy_in(self.scenario["evader"])
        return tuple(Pair(pursuer or own_p, evader or own_e) for pursuer, evader in self.sweep.pairs)

    @cached_property
    def points(self) -> int:
        """Number of grid points."""
        return math.prod(len(axis.values) for axis in self.axes if axis.random is None)

    @property
    def seeds(self) -> int:
        """Number of seeds."""
        if self.sweep.rows is not None:
            return self.sweep.rows // (self.points * len(self.pairs))
        return len(self.sweep.seeds)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.seeds * self.points * len(self.pairs)

    def places(self, row: Rows) -> tuple[Rows, Rows, Rows]:
        """Return pair of policies, grid point and seed of rows, (n,) each."""
        rest, number = np.divmod(row, self.seeds)
        pair, point = np.divmod(rest, self.points)
        return pair, point, self.sweep.seeds.at(number)

    def cases(self, row: Rows) -> Cases:
        """Return policies, seeds and values of rows, by their numbers (n,)."""
        pair, point, seed = self.places(row)
        values: list[list[Any]] = []
        size = self.points
        for axis in self.axes:
            if axis.random is not None:
                values.append(axis.draw(seed))
            else:
                size //= len(axis.values)
                values.append([axis.values[place] for place in (point // size % len(axis.values)).tolist()])
        return Cases(row, pair, seed, tuple(values))

    @cached_property
    def schema(self) -> pa.Schema:
        """Columns of the table: number of the row, swept values, outcome."""
        swept = (column for axis in self.axes for column in axis.columns().items())
        outcome = (TeamOutcome if self.teams else Outcome).__annotations__
        texts = pa.list_(pa.string())
        return pa.schema(
            [(ROW, pa.int64()), *swept, *((name, _TYPES.get(kind, texts)) for name, kind in outcome.items())]
        )

    @cached_property
    def document(self) -> dict[str, Any]:
        """The plan as plain values for the sweep's folder; `plan_of` reads it."""
        sweep = self.sweep.model_dump(mode="json", by_alias=True, exclude_unset=True)
        return {"as": self.way, "sweep": sweep, "scenario": dict(self.scenario)}

    @cached_property
    def decisive(self) -> dict[str, Any]:
        """The part of the document that determines the rows: without titles and descriptions."""
        texts = {"sweep": {"title", "description"}, "scenario": {"description"}}
        return {
            name: {key: value for key, value in part.items() if key not in texts[name]} if name in texts else part
            for name, part in self.document.items()
        }

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the decisive part."""
        return sha256(json.dumps(self.decisive, sort_keys=True).encode()).hexdigest()


def policy_in(section: Any) -> str:  # noqa: ANN401 - a player's section, or the tables of a team
    """Return the policy of a player or a team; different policies of a team are joined by "+"."""
    groups = section if isinstance(section, (list, tuple)) else [section]
    return "+".join(dict.fromkeys(str(group["policy"]) for group in groups))


def plan_of(document: Mapping[str, Any]) -> Plan:
    """Return the plan of a document."""
    return Plan(Sweep.model_validate(document["sweep"]), document["scenario"], document["as"])


def load_sweep(name: str) -> tuple[Path, Sweep]:
    """Read a sweep by path, or by the name of one that comes with the package.

    Raises:
        ConfigError: If there is none, or a key is wrong.
    """
    path = find(name, FOLDER)
    return path, load(Sweep, path)


def laid_out(sweep: Sweep, path: Path, way: Way | None = None) -> Plan:
    """Return the plan of a sweep file.

    Args:
        sweep: The sweep file.
        path: Its path; a scenario beside it is preferred.
        way: Overrides the file's.

    Raises:
        ConfigError: If the scenario is wrong, a key is swept twice, or `rows` is not a multiple of the combinations.
    """
    beside = path.parent / sweep.scenario
    found, scenario = load_any(str(beside) if beside.is_file() else str(find(sweep.scenario, SCENARIOS)))
    plan = Plan(sweep, scenario.model_dump(mode="json"), way or sweep.way)
    if plan.teams and plan.way != "maths":
        raise ConfigError(f'{path}: as = "{plan.way}": {found.name} has teams, which can only be played as maths')
    try:
        columns = [name for axis in plan.axes for name in axis.columns()]
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    for name in columns:
        if columns.count(name) > 1:
            raise ConfigError(f"{path}: {name}: swept twice")
    step = plan.points * len(plan.pairs)
    if sweep.rows is not None and sweep.rows % step:
        raise ConfigError(
            f"{path}: rows = {sweep.rows}: must be a multiple of {step} ({plan.points} grid points × "
            f"{len(plan.pairs)} pairs of policies); the nearest is {max(1, round(sweep.rows / step)) * step}"
        )
    return plan
