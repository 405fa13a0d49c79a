"""A sweep laid out: which values, policies and seed a row has, and in which columns of Arrow it is told.

A pure function of the plan and the row's number.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from guidance.config import find
from guidance.errors import ConfigError
from guidance.sim.outcome import Outcome
from guidance.sim.scenario_file import FOLDER as SCENARIOS
from guidance.sim.scenario_file import has_teams, load_any
from guidance.sim.team_maths import TeamOutcome
from guidance.sweeps.axes import Axis
from guidance.sweeps.sweep_file import Pair, Sweep, Way

_KINDS: Final[dict[Any, pa.DataType]] = {str: pa.string(), int: pa.int64(), float: pa.float64()}

ROW = "row"
Rows = NDArray[np.int64]


def _schema(row: type) -> pa.Schema:
    words = pa.list_(pa.string())
    return pa.schema([(name, _KINDS.get(kind, words)) for name, kind in row.__annotations__.items()])


SCHEMA: Final = _schema(Outcome)
TEAM_SCHEMA: Final = _schema(TeamOutcome)


class Cases(NamedTuple):
    """What some rows play.

    Attributes:
        row: Numbers of the rows, (n,).
        pair: Which pair of policies, (n,).
        point: Which point of the grid, (n,).
        seed: (n,).
        values: Of every axis, n each.
    """

    row: Rows
    pair: Rows
    point: Rows
    seed: Rows
    values: tuple[list[Any], ...]


@dataclass(frozen=True)
class Plan:
    """A sweep laid out; small, and the same wherever it is unpacked.

    Attributes:
        sweep: The sweep file.
        scenario: The scenario that is varied, as plain values with every default filled in.
        way: "maths" or "fast".
    """

    sweep: Sweep
    scenario: Mapping[str, Any]
    way: Way

    @cached_property
    def teams(self) -> bool:
        """Whether the scenario is one of teams: then a game has a row in the table for every evader."""
        return has_teams(self.scenario)

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """What is swept."""
        return self.sweep.axes

    @cached_property
    def pairs(self) -> tuple[Pair, ...]:
        """The pairs of policies, the scenario's own by their names."""
        own = {player: policy_in(self.scenario[player]) for player in ("pursuer", "evader")}
        return tuple(Pair(pair.pursuer or own["pursuer"], pair.evader or own["evader"]) for pair in self.sweep.pairs)

    @cached_property
    def points(self) -> int:
        """How many points the grid has."""
        return math.prod(len(axis.values) for axis in self.axes if axis.distribution is None)

    @property
    def seeds(self) -> int:
        """How many seeds there are."""
        if self.sweep.rows is not None:
            return self.sweep.rows // (self.points * len(self.pairs))
        given = self.sweep.seeds
        return 1 if given is None else len(given.values) or given.count

    @property
    def rows(self) -> int:
        """How many rows there are."""
        return self.seeds * self.points * len(self.pairs)

    def cases(self, row: Rows) -> Cases:
        """Lay out rows by their numbers, (n,): seeds change fastest, so that games played in one batch are alike."""
        rest, number = np.divmod(row, self.seeds)
        pair, point = np.divmod(rest, self.points)
        given = self.sweep.seeds
        if given is not None and given.values:
            seed = np.array(given.values, dtype=np.int64)[number]
        else:
            seed = number + (0 if given is None else given.begin)
        values: list[list[Any]] = []
        size = self.points
        for axis in self.axes:
            if axis.distribution is not None:
                values.append(axis.distribution.draw(seed, axis.stream))
            else:
                size //= len(axis.values)
                values.append([axis.values[place] for place in (point // size % len(axis.values)).tolist()])
        return Cases(row, pair, point, seed, tuple(values))

    def row_of(self, pair: Rows, point: Rows, seed: Rows) -> Rows:
        """Return the number of a case's row, (n,); -1 where the sweep has no such seed."""
        given = self.sweep.seeds
        if given is not None and given.values:
            order = np.argsort(given.values)
            place = np.searchsorted(np.array(given.values)[order], seed)
            number = order[np.minimum(place, len(order) - 1)]
            there = np.array(given.values)[number] == seed
        else:
            number = seed - (0 if given is None else given.begin)
            there = (number >= 0) & (number < self.seeds)
        return np.where(there, (pair * self.points + point) * self.seeds + number, -1)

    @cached_property
    def swept(self) -> dict[str, pa.DataType]:
        """Names and types of the columns that show what is swept."""
        return {name: kind for axis in self.axes for name, kind in axis.columns().items()}

    @cached_property
    def schema(self) -> pa.Schema:
        """The columns of the sweep's table: the row's number, what is swept, and the outcome."""
        return pa.schema([(ROW, pa.int64()), *self.swept.items(), *(TEAM_SCHEMA if self.teams else SCHEMA)])

    @cached_property
    def document(self) -> dict[str, Any]:
        """The plan as plain values, for the sweep's folder; `plan_of` reads it."""
        sweep = self.sweep.model_dump(mode="json", by_alias=True, exclude_unset=True)
        return {"as": self.way, "sweep": sweep, "scenario": dict(self.scenario)}

    @cached_property
    def decisive(self) -> dict[str, Any]:
        """The part of the document that decides the rows: all but what is only said about them."""
        said = {"sweep": {"title", "description"}, "scenario": {"description"}}
        return {
            name: {key: value for key, value in part.items() if key not in said[name]} if name in said else part
            for name, part in self.document.items()
        }

    @cached_property
    def digest(self) -> str:
        """SHA-256 of what is decisive."""
        return sha256(json.dumps(self.decisive, sort_keys=True).encode()).hexdigest()


def policy_in(section: Any) -> str:  # noqa: ANN401 - a player's section, or the tables of a team
    """Return how a player plays, or a team; different policies in it are joined by "+"."""
    groups = section if isinstance(section, (list, tuple)) else [section]
    return "+".join(dict.fromkeys(str(group["policy"]) for group in groups))


def plan_of(document: Mapping[str, Any]) -> Plan:
    """Lay out a sweep from the document of a plan."""
    return Plan(Sweep.model_validate(document["sweep"]), document["scenario"], document["as"])


def laid_out(sweep: Sweep, path: Path, way: Way | None = None) -> Plan:
    """Lay out a sweep that was read from a file.

    Args:
        sweep: The sweep file.
        path: Where it was; a scenario is looked for beside it first.
        way: In place of the file's.

    Raises:
        ConfigError: If the scenario is none, a key is swept twice, or the rows do not come out even.
    """
    beside = path.parent / sweep.scenario
    found, scenario = load_any(str(beside) if beside.is_file() else str(find(sweep.scenario, SCENARIOS)))
    plan = Plan(sweep, scenario.model_dump(mode="json"), way or sweep.way)
    if plan.teams and plan.way != "maths":
        raise ConfigError(f'{path}: as = "{plan.way}": {found.name} has teams, which only mathematics plays yet')
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
            f"{path}: rows = {sweep.rows}: must be a multiple of {step} ({plan.points} points of the grid × "
            f"{len(plan.pairs)} pairs of policies); the nearest is {max(1, round(sweep.rows / step)) * step}"
        )
    return plan
