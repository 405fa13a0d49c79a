"""A sweep from file to folder: what is there already is left, the rest is computed and written as it is done."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from guidance.errors import ConfigError
from guidance.sweeps.chunk import rows_for
from guidance.sweeps.executors import Executor
from guidance.sweeps.folder import Folder, opened
from guidance.sweeps.model import Way, load_sweep
from guidance.sweeps.plan import Plan, laid_out
from guidance.sweeps.rows import Scenarios, check

Told = Callable[[int], None]
"""Is told how many rows were written just now."""

SAMPLE = 1000
"""So many rows are looked at before anything runs."""


class Work(NamedTuple):
    """What is to be done in a folder: chunks that are not there, and how many rows are."""

    folder: Folder
    missing: list[int]
    rows_there: int


def planned(name: str, way: Way | None = None) -> Plan:
    """Read a sweep by path or name, and check it as far as that can be done without running it.

    Raises:
        ConfigError: With the key, the value and what is allowed.
    """
    path, sweep = load_sweep(name)
    plan = laid_out(sweep, path, way)
    check(plan, str(path))
    return plan


def begun(plan: Plan, out: Path, chunk_rows: int | None, workers: int = 1) -> Work:
    """Begin a sweep's folder, or find what is missing in it.

    Args:
        plan: What is swept.
        out: The folder.
        chunk_rows: Rows of a chunk; None chooses so that a chunk takes some seconds and every worker has several.
        workers: How many will compute them.

    Raises:
        ConfigError: If the folder is another's, or its rows allow no game.
        OutputError: If it cannot be written.
    """
    refuse_without_games(plan)
    folder = opened(out, plan, chunk_rows, lambda: rows_for(plan, workers))
    missing = [chunk for chunk in range(folder.chunks) if not folder.has(chunk)]
    return Work(folder, missing, plan.rows - sum(len(folder.rows(chunk)) for chunk in missing))


def refuse_without_games(plan: Plan) -> None:
    """Refuse a sweep whose rows allow no game, as far as rows spread over all of it tell.

    Raises:
        ConfigError: With the commonest reason.
    """
    rows = np.unique(np.linspace(0, plan.rows - 1, SAMPLE).round().astype(np.int64))
    found = list(Scenarios(plan).of(plan.cases(rows)))
    reasons = Counter(one for one in found if isinstance(one, str))
    if reasons.total() == len(found):
        reason, count = reasons.most_common(1)[0]
        raise ConfigError(f"no row allows a game, of {len(found)} looked at; {count} of them because of\n  {reason}")


def finish(work: Work, executor: Executor, told: Told) -> None:
    """Compute and write what is missing.

    Raises:
        OutputError: If a chunk cannot be written; those before it stay.
        GuidanceError: If one cannot be computed.
    """
    folder = work.folder
    for done in executor.work(folder.plan, ((chunk, folder.rows(chunk)) for chunk in work.missing)):
        folder.keep(done.chunk, done.content)
        told(len(folder.rows(done.chunk)))
