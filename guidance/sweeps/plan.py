"""The plan of a sweep, which its file describes: policies, seed and values of every row, and the columns of the table.

A row depends on the plan and the row's number only.
"""

import itertools
import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import cached_property
from hashlib import sha256
from typing import Annotated, Any, Final, Literal, NamedTuple

import numpy as np
import pyarrow as pa
from pydantic import BeforeValidator, Field, ValidationInfo, WithJsonSchema, field_validator

from guidance.config import Section
from guidance.sim.outcome import Outcome
from guidance.sim.scenario import EvaderPolicy, PursuerPolicy, Scenario
from guidance.sim.scenario_file import has_teams
from guidance.sim.teams import TeamOutcome, TeamScenario
from guidance.sweeps.axes import Axis, Distribution, Integers, flat, grid_values, path_of

RunKind = Literal["maths", "fast"]
"""A row is point masses (maths), or a flight of the mock in virtual time (fast)."""

SWEEP_FOLDER: Final = "sweeps"
ROW: Final = "row"

MOST_GAMES: Final = 10**9
"""Most games of a sweep: two days on two cores. The numbers of the missing parts are held in memory."""

MOST_PAIRS: Final = 10_000
"""Most pairs of policies, counted before duplicates are removed."""

_TYPES: Final[dict[Any, pa.DataType]] = {str: pa.string(), int: pa.int64(), float: pa.float64()}


class Pair(NamedTuple):
    """Policies of both players."""

    pursuer: str
    evader: str


class Policies(Section):
    """Policies of both players; every pursuer's policy plays every evader's."""

    pursuer: PursuerPolicy | tuple[PursuerPolicy, ...] = Field(
        (), description="one or several; default: the scenario's own"
    )
    evader: EvaderPolicy | tuple[EvaderPolicy, ...] = Field((), description="likewise")

    @property
    def pairs_listed(self) -> int:
        """Number of pairs, also of policies given twice."""
        pursuers = _policy_names(self.pursuer, "")
        evaders = _policy_names(self.evader, "")
        return len(pursuers) * len(evaders)


class Seeds(Section):
    """Seeds: `count` of them beginning with `from`, or a list."""

    begin: int = Field(0, alias="from", ge=0, le=2**53, description="the first")
    count: int = Field(1, ge=1, description="how many")
    values: tuple[Annotated[int, Field(ge=0, le=2**53)], ...] = Field(
        (), alias="list", description="these, instead of both"
    )

    def __len__(self) -> int:
        """Number of seeds."""
        return len(self.values) if self.values else self.count

    def at(self, number: Integers) -> Integers:
        """Return the seeds with these numbers."""
        if not self.values:
            return number + self.begin
        seeds = np.array(self.values, dtype=np.int64)
        return seeds[number]


def _seeds(seeds: Any) -> Any:  # noqa: ANN401 - from a file
    keys = {int: "count", list: "list"}
    key = keys.get(type(seeds))
    return seeds if key is None else {key: seeds}


AnySeeds = Annotated[Seeds, BeforeValidator(_seeds, json_schema_input_type=int | list[int] | Seeds)]
Document = Annotated[dict[str, Any], WithJsonSchema({"type": "string"})]


class Cases(NamedTuple):
    """Policies, seeds and values of some rows.

    Attributes:
        row: Numbers of the rows, (n,).
        pair: Numbers of the pairs of policies, (n,).
        seed: (n,).
        values: Of every axis, n each.
    """

    row: Integers
    pair: Integers
    seed: Integers
    values: tuple[list[Any], ...]


class Plan(Section):
    """A whole sweep file.

    Seeds change fastest from row to row, then the grid, then the policies. A random draw depends on the seed and the
    key only, so rows with equal seeds can be compared pairwise.
    """

    title: str = Field("", description="a few words")
    description: str = Field("", description="what it shows, and why it is as it is")
    scenario: Document = Field(
        description="a scenario's name or path; beside the sweep's file, or with the package"
    )
    way: RunKind = Field(
        "maths",
        alias="as",
        description="maths: point masses; fast: flights of the mock in virtual time",
    )
    number: int | None = Field(
        None, alias="rows", ge=1, description="number of rows, instead of seeds"
    )
    seeds: AnySeeds = Field(
        Seeds(), description="how many, a list, or { from = 100, count = 50 }; default: one, 0"
    )
    grid: dict[str, Annotated[list[Any], BeforeValidator(grid_values)]] = Field(
        {}, description="keys of the scenario and their values; all combinations are played"
    )
    random: dict[str, Distribution] = Field(
        {}, description="keys of the scenario and their distributions; one draw a seed"
    )
    policies: tuple[Policies, ...] = Field(
        (), description="which policies play; default: the scenario's own"
    )

    @field_validator("grid", "random", mode="before", json_schema_input_type=dict[str, Any])
    @classmethod
    def _flatten(cls, document: Any, info: ValidationInfo) -> Any:  # noqa: ANN401 - from a file
        if not isinstance(document, Mapping):
            return document
        if info.field_name == "random":
            return dict(flat(document, Mapping))
        return dict(flat(document, (Mapping, list)))

    def _faults(self) -> Iterator[str]:
        pairs_listed = sum(policies.pairs_listed for policies in self.policies)
        if pairs_listed > MOST_PAIRS:
            yield f"policies: {pairs_listed} pairs; at most {MOST_PAIRS} are allowed"
        if self.rows > MOST_GAMES:
            yield (
                f"seeds, grid, policies: {self.rows} games; at most {MOST_GAMES} are allowed, "
                "so play it in several sweeps"
            )
        if self.teams and self.way != "maths":
            yield f'as = "{self.way}": the scenario has teams, which can only be played as maths'
        if self.number is not None and "seeds" in self.model_fields_set:
            yield "rows, seeds: give only one; rows = seeds × grid points × pairs of policies"
        for key, random in self.random.items():
            if random.radii_m and not key.endswith("position_m"):
                use = "use it for pursuer.position_m or evader.position_m as a whole"
                advice = "give each number of another key its own distribution"
                yield f"random.{key}: a disc or an annulus is a position: {use}; {advice}"
        columns = list[str]()
        for axis in self.axes:
            columns += axis.columns()
        pairs = [" against ".join(pair) for pair in self.pairs]
        lists = {"policies": pairs, "seeds": self.seeds.values, "grid, random": columns}
        for key, names in lists.items():
            repeated = [name for name, count in Counter(names).items() if count > 1]
            if repeated:
                yield f"{key}: {repeated[0]} is given twice"
        pair_count, points, _ = self.shape
        step = pair_count * points
        if self.number is not None and self.number % step:
            counts = f"{points} grid points × {pair_count} pairs of policies"
            steps = max(1, round(self.number / step))
            allowed = f"must be a multiple of {step} ({counts}); the nearest is {steps * step}"
            yield f"rows = {self.number}: {allowed}"

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
        """The axes of the grid, then the random ones."""
        grid = [Axis(key, path_of(key), values) for key, values in self.grid.items()]
        random = [Axis(key, path_of(key), random=draws) for key, draws in self.random.items()]
        return (*grid, *random)

    @cached_property
    def pairs(self) -> tuple[Pair, ...]:
        """The pairs of policies."""
        scenario_pursuer = policy_in(self.scenario["pursuer"])
        scenario_evader = policy_in(self.scenario["evader"])
        if not self.policies:
            return (Pair(scenario_pursuer, scenario_evader),)
        pairs: list[Pair] = []
        for policies in self.policies:
            pursuers = _policy_names(policies.pursuer, scenario_pursuer)
            evaders = _policy_names(policies.evader, scenario_evader)
            for pursuer, evader in itertools.product(pursuers, evaders):
                pairs.append(Pair(pursuer, evader))
        return tuple(pairs)

    @cached_property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of pairs of policies, of grid points and of seeds."""
        pairs = len(self.pairs)
        points = math.prod(self._lengths)
        seeds = len(self.seeds)
        if self.number is not None:
            seeds = self.number // (points * pairs)
        return pairs, points, seeds

    @property
    def _lengths(self) -> tuple[int, ...]:
        """Number of values on every axis; 1 on a random axis."""
        return tuple(max(1, len(axis.values)) for axis in self.axes)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return math.prod(self.shape)

    def places(self, row: Integers) -> tuple[Integers, Integers, Integers]:
        """Return pair of policies, grid point and seed of rows, (n,) each."""
        pair, point, number = np.unravel_index(row, self.shape)
        return pair, point, self.seeds.at(number)

    def on_axes(self, point: Integers) -> tuple[Integers, ...]:
        """Return the place of grid points on every axis, (n,) each; 0 on a random axis."""
        # The leading 1 also serves a plan without axes
        _, *places = np.unravel_index(point, (1, *self._lengths))
        return tuple(places)

    def cases(self, row: Integers) -> Cases:
        """Return policies, seeds and values of rows, by their numbers (n,)."""
        pair, point, seed = self.places(row)
        places = zip(self.axes, self.on_axes(point), strict=True)
        values = tuple(axis.at(index, seed) for axis, index in places)
        return Cases(row, pair, seed, values)

    @cached_property
    def schema(self) -> pa.Schema:
        """Columns of the table: number of the row, swept values, outcome."""
        columns: list[tuple[str, pa.DataType]] = [(ROW, pa.int64())]
        for axis in self.axes:
            columns.extend(axis.columns().items())
        outcome = TeamOutcome if self.teams else Outcome
        texts = pa.list_(pa.string())
        for name, kind in outcome.__annotations__.items():
            columns.append((name, _TYPES.get(kind, texts)))
        return pa.schema(columns)

    @property
    def document(self) -> dict[str, Any]:
        """The plan as plain values for the sweep's folder; `plan_of_manifest` reads it."""
        sweep = self.model_dump(
            mode="json", by_alias=True, exclude_defaults=True, exclude={"way", "scenario"}
        )
        return {"as": self.way, "sweep": sweep, "scenario": self.scenario}

    @cached_property
    def decisive(self) -> dict[str, Any]:
        """The plan as plain values, without titles and descriptions: what determines the rows."""
        texts: dict[str, Any] = {"title": True, "description": True, "scenario": {"description"}}
        return self.model_dump(mode="json", by_alias=True, exclude_defaults=True, exclude=texts)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the decisive part."""
        text = json.dumps(self.decisive, sort_keys=True)
        return sha256(text.encode()).hexdigest()


def _policy_names(names: str | tuple[str, ...], default: str) -> tuple[str, ...]:
    if isinstance(names, str):
        return (names,)
    if names:
        return names
    return (default,)


def policy_in(section: Any) -> str:  # noqa: ANN401 - a player's section, or the tables of a team
    """Return the policy of a player or a team; different policies of a team are joined by "+"."""
    if not isinstance(section, (list, tuple)):
        return str(section["policy"])
    policies = [str(group["policy"]) for group in section]
    return "+".join(dict.fromkeys(policies))


def plan_of_manifest(document: Mapping[str, Any]) -> Plan:
    """Return the plan of a sweep's manifest."""
    keys = document["sweep"] | {"as": document["as"], "scenario": document["scenario"]}
    return Plan.model_validate(keys)
