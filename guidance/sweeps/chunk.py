"""One chunk of a sweep: its rows played, as a Parquet file's bytes. Runs wherever the work is."""

import gc
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from guidance.errors import GuidanceError
from guidance.scenarios.maths import play
from guidance.scenarios.model import Scenario
from guidance.scenarios.outcome import SCHEMA, Outcome, invalid
from guidance.sweeps.plan import Cases, Plan
from guidance.sweeps.rows import Scenarios

FEWEST_GAMES, MOST_GAMES, FLIGHTS = 4096, 16384, 8
"""Rows of a chunk. Games played side by side share the cost of a step, up to some thousands of each kind; flights share
nothing, and a chunk of them is some seconds' work."""


def rows_of(plan: Plan, chunk: int, size: int) -> range:
    """Return the numbers of a chunk's rows."""
    return range(chunk * size, min(plan.rows, (chunk + 1) * size))


def default_rows(plan: Plan) -> int:
    """Return how many rows a chunk has where nothing else is asked for: a matter of the plan, not of the workers."""
    return FLIGHTS if plan.way == "fast" else min(MOST_GAMES, max(FEWEST_GAMES, plan.rows // 16))


def chunks_of(plan: Plan, size: int) -> int:
    """Return how many chunks there are."""
    return math.ceil(plan.rows / size)


def computed(plan: Plan, rows: range) -> bytes:
    """Play rows and return the bytes of their Parquet file: a pure function of both.

    Raises:
        GuidanceError: If a flight cannot be flown for a reason that is not the row's.
    """
    sink = BytesIO()
    with _all_kept():
        parquet.write_table(table_of(plan, rows), sink, compression="zstd")
    return sink.getvalue()


@contextmanager
def _all_kept() -> Iterator[None]:
    """Look for no garbage: a chunk's scenarios and outcomes live until its end, and visiting them all takes a fifth."""
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
    games = [scenario for scenario in found if isinstance(scenario, Scenario)]
    played = iter(play(games) if plan.way == "maths" else [_flown(scenario) for scenario in games])
    outcomes = [
        next(played) if isinstance(scenario, Scenario) else _no_game(plan, cases, place, scenario)
        for place, scenario in enumerate(found)
    ]
    return as_table(plan, cases, outcomes)


def as_table(plan: Plan, cases: Cases, outcomes: Sequence[Outcome]) -> pa.Table:
    """Put rows into columns."""
    cells: list[Any] = [pa.array(cases.row)]
    for axis, values in zip(plan.axes, cases.values, strict=True):
        cells.extend(axis.cells(values))
    columns = zip(*outcomes, strict=True) if outcomes else [[] for _ in Outcome._fields]
    cells.extend(pa.array(column, field.type) for column, field in zip(columns, SCHEMA, strict=True))
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
    from guidance.sweeps.flight import flown  # noqa: PLC0415 - the mock, and only where something is flown

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
