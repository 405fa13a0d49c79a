"""One chunk of a sweep: its rows played, or flown, as a Parquet file's bytes. Runs wherever the work is."""

import gc
import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from guidance.clock import VirtualClock
from guidance.errors import GuidanceError
from guidance.sim.maths import play
from guidance.sim.outcome import Outcome, invalid
from guidance.sim.scenario import Scenario
from guidance.sim.team_maths import TeamOutcome, invalid_teams, play_teams
from guidance.sim.teams import TeamScenario
from guidance.sweeps.plan import SCHEMA, TEAM_SCHEMA, Cases, Plan
from guidance.sweeps.row_scenarios import Scenarios

MOST_GAMES = 16384
"""Games played side by side share the cost of a step, up to some thousands of each kind."""

CHUNK_S = 10.0
"""A chunk should take about so long: rows are kept, and progress is seen, that often."""

CHUNKS_A_WORKER = 4

OnEnd = Callable[[], None]


def _unheard() -> None:
    """For who need not know."""


_TRIED = (8, 64, 512)
_SHARED_AT_MOST = 8.0


def rows_of(plan: Plan, chunk: int, size: int) -> range:
    """Return the numbers of a chunk's rows."""
    return range(chunk * size, min(plan.rows, (chunk + 1) * size))


def rows_for(plan: Plan, workers: int, clock: Callable[[], float] = time.process_time) -> int:
    """Return how many rows a chunk should have, after playing a few: the rows are the same whatever it is.

    Args:
        plan: What is swept.
        workers: How many will compute chunks; each should have several.
        clock: Seconds of this process alone: on a busy machine time passes without it.
    """
    if plan.way == "fast":
        return 1  # a flight takes longer than a game by thousands
    fair = max(1, math.ceil(plan.rows / (CHUNKS_A_WORKER * workers)))
    if fair <= _TRIED[0]:
        return fair
    tried = [_timed(plan, _TRIED[0], clock)]
    for count in _TRIED[1:]:
        if tried[-1][1] > CHUNK_S / 2:
            break
        if fair <= count:
            return fair
        tried.append(_timed(plan, count, clock))
    if len(tried) == 1:
        tried.append(_timed(plan, 2 * _TRIED[0], clock))
    # Of the last two: few rows may leave out a pair of policies, and its steps with it.
    return max(1, min(_rows_in(CHUNK_S, *tried[-2:]), fair, MOST_GAMES))


def _timed(plan: Plan, count: int, clock: Callable[[], float]) -> tuple[int, float]:
    """Play some rows, from all over the plan; return how many there are, and the seconds that they took."""
    spread = np.unique(np.linspace(0, plan.rows - 1, count).round().astype(np.int64))
    began_s = clock()
    _outcomes(plan, plan.cases(spread))
    return len(spread), max(clock() - began_s, 1e-6)


def _rows_in(chunk_s: float, fewer: tuple[int, float], more: tuple[int, float]) -> int:
    """Return how many rows take so long, by what two numbers of them took.

    A chunk costs its steps, which all its games share, and something for each game. Where the steps alone take longer
    than that, a chunk has so many games that they cost as much again.
    """
    (few, few_s), (many, many_s) = fewer, more
    # Two measurements that differ by chance alone must not make a game cost nothing.
    each_s = max((many_s - few_s) / (many - few), many_s / many / _SHARED_AT_MOST)
    shared_s = max(0.0, many_s - many * each_s)
    return int(max(chunk_s - shared_s, shared_s) / each_s)


def chunks_of(plan: Plan, size: int) -> int:
    """Return how many chunks there are."""
    return math.ceil(plan.rows / size)


def computed(plan: Plan, rows: range, on_end: OnEnd = _unheard) -> bytes:
    """Play rows and return the bytes of their Parquet file: a pure function of both.

    Args:
        plan: What is swept.
        rows: Numbers of the rows.
        on_end: Called whenever a game of mathematics has ended.

    Raises:
        GuidanceError: If a flight cannot be flown for a reason that is not the row's.
    """
    sink = BytesIO()
    with nothing_collected():  # scenarios and outcomes live until the chunk's end; visiting them all takes a fifth
        parquet.write_table(table_of(plan, rows, on_end), sink, compression="zstd")
    return sink.getvalue()


@contextmanager
def nothing_collected() -> Iterator[None]:
    """Look for no garbage meanwhile."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def table_of(plan: Plan, rows: range, on_end: OnEnd = _unheard) -> pa.Table:
    """Play rows and return their table."""
    cases = plan.cases(np.arange(rows.start, rows.stop, dtype=np.int64))
    return as_table(plan, *_outcomes(plan, cases, on_end))


def _outcomes(plan: Plan, cases: Cases, on_end: OnEnd = _unheard) -> tuple[Cases, list[Any]]:
    """Return the outcomes, one a row, and the cases of the rows: each once, or of teams once for every evader."""
    found = list(Scenarios(plan).of(cases))
    if plan.teams:
        return _of_teams(plan, cases, found)
    games = [scenario for scenario in found if isinstance(scenario, Scenario)]
    played = iter(play(games) if plan.way == "maths" else [_flown(scenario) for scenario in games])
    return cases, [
        _no_game(plan, cases, place, scenario) if isinstance(scenario, str) else next(played)
        for place, scenario in enumerate(found)
    ]


def _of_teams(plan: Plan, cases: Cases, found: Sequence[object]) -> tuple[Cases, list[Any]]:
    played = iter(play_teams([scenario for scenario in found if isinstance(scenario, TeamScenario)]))
    outcomes: list[TeamOutcome] = []
    places: list[int] = []
    for place, scenario in enumerate(found):
        pair = plan.pairs[cases.pair[place]]
        title, game, seed = plan.scenario["title"], plan.scenario["game"], int(cases.seed[place])
        none = invalid_teams(title, game, pair.pursuer or "", pair.evader or "", seed, str(scenario))
        rows = [none] if isinstance(scenario, str) else next(played)
        outcomes += rows
        places += [place] * len(rows)
    values = tuple([axis[place] for place in places] for axis in cases.values)
    whose = np.array(places, dtype=np.intp)
    return Cases(cases.row[whose], cases.pair[whose], cases.point[whose], cases.seed[whose], values), outcomes


def as_table(plan: Plan, cases: Cases, outcomes: Sequence[Any]) -> pa.Table:
    """Put rows into columns."""
    cells: list[Any] = [pa.array(cases.row)]
    for axis, values in zip(plan.axes, cases.values, strict=True):
        cells.extend(axis.cells(values))
    schema = TEAM_SCHEMA if plan.teams else SCHEMA
    columns = zip(*outcomes, strict=True) if outcomes else [[] for _ in schema]
    cells.extend(pa.array(column, field.type) for column, field in zip(columns, schema, strict=True))
    return pa.Table.from_arrays(cells, schema=plan.schema)


def _no_game(plan: Plan, cases: Cases, place: int, reason: str) -> Outcome:
    pair = plan.pairs[cases.pair[place]]
    return invalid(plan.scenario["title"], plan.way, reason)._replace(
        game=plan.scenario["game"],
        pursuer_policy=pair.pursuer,
        evader_policy=pair.evader,
        seed=int(cases.seed[place]),
    )


def _flown(scenario: Scenario) -> Outcome:
    try:
        return flown(scenario)
    except GuidanceError as error:
        return invalid(scenario.title, "fast", str(error))._replace(
            game=scenario.game,
            pursuer_policy=scenario.pursuer.policy,
            evader_policy=scenario.evader.policy,
            seed=scenario.seed,
            end="failed",
        )


def flown(scenario: Scenario) -> Outcome:
    """Fly a scenario against the mock in this process, in virtual time and without a record.

    Raises:
        GuidanceError: If it cannot be flown.
    """
    from guidance.session.fly import fly  # noqa: PLC0415 - the mock, and only where something is flown
    from guidance.session.result import outcome_of_flight  # noqa: PLC0415
    from guidance.sim.stepped import SteppedWorld  # noqa: PLC0415

    clock = VirtualClock()
    world = SteppedWorld(scenario, clock)
    try:
        result = fly(scenario, world, clock)
    finally:
        world.close()
    return outcome_of_flight(result, "fast")
