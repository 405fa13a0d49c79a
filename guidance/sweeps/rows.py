"""Rows of a plan: their scenarios, played or flown, as the bytes of a Parquet file."""

import contextlib
import gc
import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from io import BytesIO
from typing import Any, Final

import numpy as np
import pyarrow as pa
from pyarrow import parquet
from pydantic import ValidationError

from guidance.clock import VirtualClock
from guidance.config import Section, explain, parse
from guidance.errors import ConfigError, GuidanceError
from guidance.game import EVADER_POLICIES, PURSUER_POLICIES
from guidance.sim.maths import play
from guidance.sim.outcome import Outcome, outcome_of
from guidance.sim.scenario import PURSUER, Scenario
from guidance.sim.teams import TeamOutcome, TeamScenario, play_teams
from guidance.strategies import EVADER_STRATEGIES, PURSUER_STRATEGIES
from guidance.sweeps.axes import Axis
from guidance.sweeps.plan import Cases, Pair, Plan, policy_in

_COURSE_KEYS: Final = {"waypoints": "waypoints_m", "recorded": "track"}
_SAMPLE: Final = 1000


class Scenarios:
    """Builds the scenarios of a plan's rows.

    Sections without a swept key are validated once and shared. The other sections, and all checks between sections, are
    validated for every row.
    """

    def __init__(self, plan: Plan) -> None:
        self._model, self._axes = plan.model, plan.axes
        swept = {str(axis.path[0]) for axis in plan.axes}
        self._bases: list[dict[str, Any]] = []
        for pair in plan.pairs:
            document = _with_policies(plan.scenario, pair)
            checked = parse(self._model, document, source=f"policies {pair.pursuer} and {pair.evader}")
            own = {name: getattr(checked, name) for name in self._model.model_fields if name not in swept}
            self._bases.append(own | {name: document[name] for name in swept})

    def of(self, cases: Cases) -> Iterator[Scenario | TeamScenario | str]:
        """Yield the scenario of every row, or the reason why it is invalid."""
        drawn = list(zip(*cases.values, strict=True)) if cases.values else [()] * len(cases.row)
        for pair, seed, values in zip(cases.pair.tolist(), cases.seed.tolist(), drawn, strict=True):
            document = {**_with_values(self._bases[pair], self._axes, values), "seed": seed}
            try:
                yield self._model.model_validate(document)
            except ValidationError as error:
                yield "; ".join(explain(self._model, dict(fault)) for fault in error.errors())


def scenario_of(plan: Plan, row: int) -> Scenario | TeamScenario | str:
    """Return the scenario of a row, or the reason why it is invalid."""
    return next(iter(Scenarios(plan).of(plan.cases(np.array([row], dtype=np.int64)))))


def _with_policies(scenario: Mapping[str, Any], pair: Pair) -> dict[str, Any]:
    """Return a scenario's document with other policies; a course stays with its own policy."""
    document = dict(scenario)
    for player, policy in pair._asdict().items():
        if isinstance(document[player], list):
            if policy != policy_in(document[player]):
                document[player] = [{**group, "policy": policy} for group in document[player]]
            continue
        section = {**document[player], "policy": policy}
        for of, key in _COURSE_KEYS.items():
            if policy != of:
                section.pop(key, None)
        document[player] = section
    return document


def _with_values(document: dict[str, Any], axes: Sequence[Axis], values: Sequence[Any]) -> dict[str, Any]:
    """Return a copy of a document with one value of every axis."""
    for axis, value in zip(axes, values, strict=True):
        for path, part in axis.settings(value):
            document = _placed(document, path, part)
    return document


def _placed(node: Any, path: Sequence[str | int], value: Any) -> Any:  # noqa: ANN401 - any part of a document
    """Return a copy of a part of a document with a value at a path."""
    if not path:
        return value
    head, rest = path[0], path[1:]
    if isinstance(head, int):
        if not isinstance(node, (list, tuple)) or head >= len(node):
            raise LookupError(head)
        return [*node[:head], _placed(node[head], rest, value), *node[head + 1 :]]
    section = node or {}
    return {**section, head: _placed(section.get(head), rest, value)}


def check(plan: Plan, source: str) -> None:
    """Refuse unknown policies and keys, and values outside a key's range, before anything runs.

    Rules between keys, as the speed ratio, are checked row by row: such a row is invalid.

    Raises:
        ConfigError: One line for each fault, with the key, the value and what is allowed.
    """
    _check_policies(plan, source)
    base = _with_policies(plan.scenario, plan.pairs[0])
    faults = [one for axis in plan.axes for value in axis.extremes for one in _faults(plan.model, base, axis, value)]
    if faults:
        raise ConfigError(f"{source}:\n" + "\n".join(f"  {fault}" for fault in dict.fromkeys(faults)))
    Scenarios(plan)


def _check_policies(plan: Plan, source: str) -> None:
    alone, teams = (PURSUER_STRATEGIES, EVADER_STRATEGIES), (tuple(PURSUER_POLICIES), tuple(EVADER_POLICIES))
    known = dict(zip(("pursuer", "evader"), teams if plan.teams else alone, strict=True))
    for pair in plan.pairs:
        for player, policy in pair._asdict().items():
            if policy not in known[player] and policy != policy_in(plan.scenario[player]):
                raise ConfigError(f"{source}: policies.{player} = {policy!r}: allowed are {', '.join(known[player])}")


def _faults(model: type[Section], base: dict[str, Any], axis: Axis, value: Any) -> Iterator[str]:  # noqa: ANN401 - any value of a key
    try:
        model.model_validate(_with_values(base, (axis,), (value,)))
    except LookupError as error:
        yield f"{axis.key}: the scenario has no element {error.args[0]} there"
    except ValidationError as error:
        for fault in error.errors():
            if fault["loc"][: len(axis.path)] == axis.path:
                yield explain(model, dict(fault))


def refuse_without_games(plan: Plan) -> None:
    """Refuse a sweep if all of a sample of its rows are invalid.

    Raises:
        ConfigError: With the most common reason.
    """
    spread = np.unique(np.linspace(0, plan.rows - 1, _SAMPLE).round().astype(np.int64))
    found = list(Scenarios(plan).of(plan.cases(spread)))
    reasons = Counter(one for one in found if isinstance(one, str))
    if reasons.total() == len(found):
        reason, count = reasons.most_common(1)[0]
        raise ConfigError(f"all {len(found)} rows of a sample are invalid; reason of {count} of them:\n  {reason}")


def computed(plan: Plan, rows: range) -> bytes:
    """Play rows and return the bytes of their Parquet file, which depend on the arguments only.

    Raises:
        GuidanceError: If a flight fails for a reason other than its row.
    """
    sink = BytesIO()
    with uncollected():  # all objects live until the end of the chunk; visiting them takes a fifth of the time
        parquet.write_table(table_of(plan, rows), sink, compression="zstd")
    return sink.getvalue()


@contextlib.contextmanager
def uncollected() -> Iterator[None]:
    """Switch garbage collection off."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def table_of(plan: Plan, rows: range) -> pa.Table:
    """Play rows and return their table."""
    cases = plan.cases(np.arange(rows.start, rows.stop, dtype=np.int64))
    found = list(Scenarios(plan).of(cases))
    played = iter(_played(plan, [scenario for scenario in found if not isinstance(scenario, str)]))
    outcomes = [
        [_invalid(plan, cases, place, one)] if isinstance(one, str) else next(played) for place, one in enumerate(found)
    ]
    return as_table(plan, cases, outcomes)


def as_table(plan: Plan, cases: Cases, outcomes: Sequence[Sequence[Any]]) -> pa.Table:
    """Return the table of cases and the outcomes of each: one, or of teams one for every evader."""
    swept = [pa.array(cases.row)]
    for axis, values in zip(plan.axes, cases.values, strict=True):
        swept.extend(axis.cells(values))
    places = np.repeat(np.arange(len(outcomes)), [len(rows) for rows in outcomes])
    columns = zip(*itertools.chain.from_iterable(outcomes), strict=True)
    fields = list(plan.schema)[len(swept) :]
    cells = [pa.array(column, field.type) for column, field in zip(columns, fields, strict=True)]
    return pa.Table.from_arrays([*(column.take(pa.array(places)) for column in swept), *cells], schema=plan.schema)


def _played(plan: Plan, games: list[Any]) -> Iterable[Sequence[Any]]:
    """Return the outcomes of each game: one, or of teams one for every evader."""
    if plan.teams:
        return play_teams(games)
    return ([outcome] for outcome in (play(games) if plan.way == "maths" else map(flown, games)))


def _invalid(plan: Plan, cases: Cases, place: int, reason: str) -> Outcome | TeamOutcome:
    policies, seed = plan.pairs[cases.pair[place]], int(cases.seed[place])
    kind = partial(TeamOutcome if plan.teams else Outcome, plan.scenario["title"], plan.way, plan.scenario["game"])
    names = policies.pursuer or "", policies.evader or ""
    return kind(pursuer_policy=names[0], evader_policy=names[1], seed=seed, reason=reason)


def flown(scenario: Scenario) -> Outcome:
    """Fly a scenario against the mock in virtual time, in this process and without a record."""
    from guidance.session.mission import Mission  # noqa: PLC0415 - flights only: imports the mock
    from guidance.session.result import outcome_of_flight  # noqa: PLC0415
    from guidance.sim.stepped import SteppedWorld  # noqa: PLC0415

    clock = VirtualClock()
    try:
        with contextlib.closing(SteppedWorld(scenario, clock)) as world:
            return outcome_of_flight(Mission(scenario, world, clock).fly().vehicles[PURSUER], "fast")
    except GuidanceError as error:
        return outcome_of(scenario, "fast", end="failed", reason=str(error))
