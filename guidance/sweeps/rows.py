"""Rows of a plan: their scenarios, played or flown, as the bytes of a Parquet file."""

import gc
import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from io import BytesIO
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
from pyarrow import parquet
from pydantic import ValidationError

from guidance.clock import VirtualClock
from guidance.config import explain, parse
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
_LARGEST_CHUNK: Final = 8192
"""The games solve this many rows at once; more are slower, as they leave the cache."""
_CHUNK_S: Final = 10.0
"""Computing time of a chunk: rows are written, and progress is shown, that often."""
_CHUNKS_A_WORKER: Final = 4
_TRIED: Final = (8, 64, 512, 4096)
_LEAST_SHARE: Final = 1.0 / 8.0

Model = type[Scenario] | type[TeamScenario]


class Scenarios:
    """Builds the scenarios of a plan's rows.

    Sections without a swept key are validated once and shared. The other sections, and all checks between sections, are
    validated for every row.
    """

    def __init__(self, plan: Plan) -> None:
        self._model = _model_of(plan)
        swept = {str(axis.key.path[0]) for axis in plan.axes}
        self._shared: list[dict[str, Any]] = []
        self._varied: list[dict[str, Any]] = []
        for pair in plan.pairs:
            document = _with_policies(plan.scenario, pair)
            base = parse(self._model, document, source=f"policies {pair.pursuer} and {pair.evader}")
            self._shared.append({name: getattr(base, name) for name in self._model.model_fields if name not in swept})
            # Some value for each axis, so that optional sections exist; every row sets its own.
            some = [axis.extremes()[0] for axis in plan.axes]
            self._varied.append(_with_values({name: document[name] for name in swept}, plan.axes, some))
        self._paths = [[key.path for key, _ in axis.settings(axis.extremes()[0])] for axis in plan.axes]
        inner = {path[:depth] for paths in self._paths for path in paths for depth in range(1, len(path))}
        self._copied = sorted(inner, key=len)

    def of(self, cases: Cases) -> Iterator[Scenario | TeamScenario | str]:
        """Yield the scenario of every row, or the reason why it is invalid."""
        drawn = list(zip(*cases.values, strict=True)) if cases.values else [()] * len(cases.row)
        for pair, seed, values in zip(cases.pair.tolist(), cases.seed.tolist(), drawn, strict=True):
            document = {**self._shared[pair], **self._varied[pair], "seed": seed}
            for path in self._copied:
                node = _at(document, path[:-1])
                node[path[-1]] = node[path[-1]].copy()
            for paths, value in zip(self._paths, values, strict=True):
                for path, part in zip(paths, [value] if len(paths) == 1 else value, strict=True):
                    _at(document, path[:-1])[path[-1]] = part
            try:
                yield self._model.model_validate(document)
            except ValidationError as error:
                yield "; ".join(explain(self._model, dict(fault)) for fault in error.errors())


def scenario_of(plan: Plan, row: int) -> Scenario | TeamScenario | str:
    """Return the scenario of a row, or the reason why it is invalid."""
    return next(iter(Scenarios(plan).of(plan.cases(np.array([row], dtype=np.int64)))))


def _model_of(plan: Plan) -> Model:
    return TeamScenario if plan.teams else Scenario


def _at(node: Any, path: Sequence[str | int]) -> Any:  # noqa: ANN401 - any part of a document
    for part in path:
        node = node[part]
    return node


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
        for key, part in axis.settings(value):
            document = _placed(document, key.path, part)
    return document


def _placed(node: Any, path: tuple[str | int, ...], value: Any) -> Any:  # noqa: ANN401 - any part of a document
    if not path:
        return value
    head, rest = path[0], path[1:]
    if isinstance(head, int):
        if not isinstance(node, (list, tuple)) or head >= len(node):
            raise LookupError(head)
        elements = list(node)
        elements[head] = _placed(elements[head], rest, value)
        return elements
    section = node or {}
    return {**section, head: _placed(section.get(head), rest, value)}


def check(plan: Plan, source: str) -> None:
    """Refuse unknown policies and keys, and values outside a key's range, before anything runs.

    Rules between keys, as the speed ratio, are checked row by row: such a row is invalid.

    Raises:
        ConfigError: One line for each fault, with the key, the value and what is allowed.
    """
    _check_policies(plan, source)
    base, model = _with_policies(plan.scenario, plan.pairs[0]), _model_of(plan)
    faults = [fault for axis in plan.axes for value in axis.extremes() for fault in _faults(model, base, axis, value)]
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


def _faults(model: Model, base: dict[str, Any], axis: Axis, value: Any) -> Iterator[str]:  # noqa: ANN401 - any value of a key
    try:
        model.model_validate(_with_values(base, (axis,), (value,)))
    except LookupError as error:
        yield f"{axis.key.text}: the scenario has no element {error.args[0]} there"
    except ValidationError as error:
        for fault in error.errors():
            if fault["loc"][: len(axis.key.path)] == axis.key.path:
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


class ChunkSize(NamedTuple):
    """Rows of a chunk, and how long it should take, s; NaN if it was not measured."""

    rows: int
    lasts_s: float


def chunk_size(plan: Plan, workers: int, clock: Callable[[], float] = time.process_time) -> ChunkSize:
    """Play some rows to choose the size of a chunk: about 10 s of work, and several chunks for each of several workers.

    Args:
        plan: Of the sweep.
        workers: Number of processes.
        clock: Processor time, s: wall time depends on what else the machine does.
    """
    if plan.way == "fast":
        return ChunkSize(1, math.nan)  # a flight takes a thousand times as long as a game
    fair = plan.rows if workers == 1 else math.ceil(plan.rows / (_CHUNKS_A_WORKER * workers))
    if fair <= _TRIED[0]:
        return ChunkSize(fair, math.nan)
    tried = [_timed(plan, _TRIED[0], clock)]
    for count in _TRIED[1:]:
        if tried[-1][1] > _CHUNK_S / 2:
            break
        tried.append(_timed(plan, min(count, fair), clock))
    if len(tried) == 1:
        tried.append(_timed(plan, 2 * _TRIED[0], clock))
    (few, few_s), (many, many_s) = tried[-2:]
    # A chunk costs its steps, which all games share, and something for each game. The lower bound is for measurements
    # that differ by chance.
    each_s = max((many_s - few_s) / max(1, many - few), many_s / many * _LEAST_SHARE)
    shared_s = max(0.0, many_s - many * each_s)
    # If the steps alone take longer than a chunk should, the games cost as much again.
    rows = max(1, min(int(max(_CHUNK_S - shared_s, shared_s) / each_s), fair, _LARGEST_CHUNK))
    return ChunkSize(rows, shared_s + rows * each_s)


def _timed(plan: Plan, count: int, clock: Callable[[], float]) -> tuple[int, float]:
    begin = (plan.rows - count) // 2  # neighbours, as in a chunk: they share their steps
    began_s = clock()
    _outcomes(plan, plan.cases(np.arange(begin, begin + count)))
    return count, max(clock() - began_s, 1e-6)


def computed(plan: Plan, rows: range) -> bytes:
    """Play rows and return the bytes of their Parquet file, which depend on the arguments only.

    Raises:
        GuidanceError: If a flight fails for a reason other than its row.
    """
    sink = BytesIO()
    with uncollected():  # all objects live until the end of the chunk; visiting them takes a fifth of the time
        parquet.write_table(table_of(plan, rows), sink, compression="zstd")
    return sink.getvalue()


@contextmanager
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
    return as_table(plan, *_outcomes(plan, plan.cases(np.arange(rows.start, rows.stop, dtype=np.int64))))


def as_table(plan: Plan, cases: Cases, outcomes: Sequence[Any]) -> pa.Table:
    """Return the table of cases and their outcomes."""
    cells: list[Any] = [pa.array(cases.row)]
    for axis, values in zip(plan.axes, cases.values, strict=True):
        cells.extend(axis.cells(values))
    schema = list(plan.schema)[len(cells) :]
    columns = zip(*outcomes, strict=True) if outcomes else [[] for _ in schema]
    cells.extend(pa.array(column, field.type) for column, field in zip(columns, schema, strict=True))
    return pa.Table.from_arrays(cells, schema=plan.schema)


def _outcomes(plan: Plan, cases: Cases) -> tuple[Cases, list[Any]]:
    """Return the outcomes, and the cases that belong to them: of teams one for every evader."""
    found = list(Scenarios(plan).of(cases))
    played = _played(plan, [scenario for scenario in found if not isinstance(scenario, str)])
    outcomes: list[Any] = []
    places: list[int] = []
    for place, scenario in enumerate(found):
        rows = [_invalid(plan, cases, place, scenario)] if isinstance(scenario, str) else next(played)
        outcomes += rows
        places += [place] * len(rows)
    if not plan.teams:
        return cases, outcomes
    values = tuple([axis[place] for place in places] for axis in cases.values)
    whose = np.array(places, dtype=np.intp)
    return Cases(cases.row[whose], cases.pair[whose], cases.point[whose], cases.seed[whose], values), outcomes


def _played(plan: Plan, games: list[Any]) -> Iterator[Sequence[Any]]:
    """Yield the outcomes of each game: one, or of teams one for every evader."""
    if plan.teams:
        return iter(play_teams(games))
    return ([outcome] for outcome in (play(games) if plan.way == "maths" else map(_flown, games)))


def _invalid(plan: Plan, cases: Cases, place: int, reason: str) -> Outcome | TeamOutcome:
    policies, seed = plan.pairs[cases.pair[place]], int(cases.seed[place])
    kind = partial(TeamOutcome if plan.teams else Outcome, plan.scenario["title"], plan.way, plan.scenario["game"])
    names = policies.pursuer or "", policies.evader or ""
    return kind(pursuer_policy=names[0], evader_policy=names[1], seed=seed, reason=reason)


def _flown(scenario: Scenario) -> Outcome:
    try:
        return flown(scenario)
    except GuidanceError as error:
        return outcome_of(scenario, "fast", end="failed", reason=str(error))


def flown(scenario: Scenario) -> Outcome:
    """Fly a scenario against the mock in virtual time, in this process and without a record.

    Raises:
        GuidanceError: If it cannot be flown.
    """
    from guidance.session.fly import fly  # noqa: PLC0415 - flights only: imports the mock
    from guidance.session.result import outcome_of_flight  # noqa: PLC0415
    from guidance.sim.stepped import SteppedWorld  # noqa: PLC0415

    clock = VirtualClock()
    world = SteppedWorld(scenario, clock)
    try:
        result = fly(scenario, world, clock)
    finally:
        world.close()
    return outcome_of_flight(result.vehicles[PURSUER], "fast")
