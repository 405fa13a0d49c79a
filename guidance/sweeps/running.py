"""What `guidance sweep FILE` does: what is there already is left, the rest is computed and written as it is done.

How far it is, a bar shows on a terminal, and a plain line now and then elsewhere.
"""

import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from guidance.errors import ConfigError
from guidance.screen import console, redraws
from guidance.sweeps.chunk import rows_for
from guidance.sweeps.executors import Executor, executor, workers_by_default
from guidance.sweeps.folder import MANIFEST, Folder, alone, opened
from guidance.sweeps.plan import Plan, laid_out
from guidance.sweeps.row_scenarios import Scenarios, check
from guidance.sweeps.sweep_file import Way, load_sweep

Told = Callable[[int], None]
"""Is told how many rows were written just now."""

SAMPLE = 1000
"""So many rows are looked at before anything runs."""

UNITS: dict[Way, str] = {"maths": "games", "fast": "flights"}
LINE_S = 10.0
"""Where nothing can be redrawn, so often at most."""


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


def run_sweep(
    name: str, *, way: Way | None, workers: int | None, scheduler: str | None, out: Path | None, chunk: int | None
) -> Path:
    """Run a sweep, or go on with it; return its folder.

    Args:
        name: A file, or one of those that come along.
        way: How each row is run; None takes what the file says.
        workers: How many processes; None takes one a processor.
        scheduler: Address of a Dask scheduler, None for processes of our own.
        out: The folder; None names it after the sweep.
        chunk: Rows in one file; None chooses.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    there = console(stderr=True)
    plan = planned(name, way)
    path = out if out is not None else Path("sweeps") / f"{Path(name).stem}-{plan.way}"
    unit = UNITS[plan.way]
    size = workers if workers is not None else workers_by_default()
    with alone(path):
        there.print(f"[bold]{plan.sweep.title or Path(name).stem}[/bold]: {plan.rows} {unit}")
        if chunk is None and plan.way == "maths" and not (path / MANIFEST).is_file():
            there.print("a few are played first, to see how long they take")
        work = begun(plan, path, chunk, size)
        count = len(work.missing)
        if work.rows_there:
            there.print(f"{work.rows_there} of them there already")
        if count:
            size = min(size, count)
            there.print(f"{count} chunks of {work.folder.chunk_rows}, {_by(size, scheduler)}")
            begun_s = time.monotonic()
            with (
                shown(there, plan.rows, work.rows_there, unit=unit) as progress,
                executor(size, scheduler, progress.played) as working,
            ):
                _finish(work, working, progress.kept)
            took_s = time.monotonic() - begun_s
            rows = plan.rows - work.rows_there
            there.print(f"{rows} {unit} in {took_s:.1f} s, {rows / took_s:.3g} a second")
    return path


def _finish(work: Work, working: Executor, told: Told) -> None:
    """As `finish`; who interrupts it learns what there is."""
    kept = work.rows_there

    def count(rows: int) -> None:
        nonlocal kept
        kept += rows
        told(rows)

    try:
        finish(work, working, count)
    except KeyboardInterrupt:
        raise Interrupted(kept, work.folder.plan.rows) from None


class Interrupted(KeyboardInterrupt):
    """Ctrl-C; its text says what was kept."""

    def __init__(self, kept: int, rows: int) -> None:
        said = f"{kept} of {rows} rows are kept" if kept else "no row had been written yet"
        super().__init__(f"interrupted: {said}; the same command goes on from there")


def _by(size: int, scheduler: str | None) -> str:
    if scheduler is not None:
        return f"by the cluster at {scheduler}"
    return "by this process" if size == 1 else f"by {size} processes"


def checked_way(text: str | None) -> Way | None:
    """Read --as.

    Raises:
        ConfigError: If it is neither.
    """
    for way in UNITS:
        if text == way:
            return way
    if text is None:
        return None
    raise ConfigError(f"--as {text}: allowed are {', '.join(UNITS)}; fly in real time with guidance scenario run")


class Shown:
    """What is shown of a sweep while it lasts.

    Args:
        rows: How many there will be.
        there: How many there are already, which count for nothing in the rate.
        unit: What a row is: "games" or "flights".
    """

    def __init__(self, rows: int, there: int, unit: str) -> None:
        self._rows, self._there, self._unit = rows, there, unit
        self._played = self._kept = 0
        self._begun_s = time.monotonic()

    @property
    def done(self) -> int:
        """Rows that were played, kept or not. What a worker that died had played is played again."""
        return min(self._rows, self._there + max(self._played, self._kept))

    def played(self, count: int) -> None:
        """So many more games have ended."""
        self._played += count
        self._show()

    def kept(self, count: int) -> None:
        """So many more rows were written."""
        self._kept += count
        self._show()

    def _rate(self) -> float:
        return max(1e-9, self.done - self._there) / max(1e-9, time.monotonic() - self._begun_s)

    def _show(self) -> None:
        """Show it, if it is time."""


class _Lines(Shown):
    def __init__(self, console: Console, rows: int, there: int, unit: str) -> None:
        super().__init__(rows, there, unit)
        self._console = console
        self._said_s = self._begun_s

    def _show(self) -> None:
        if time.monotonic() - self._said_s < LINE_S:
            return
        self._said_s = time.monotonic()
        rate = self._rate()
        self._console.print(
            f"{self.done} of {self._rows} {self._unit}, {self._there + self._kept} kept, {rate:.3g} a second, "
            f"{_clock((self._rows - self.done) / rate)} left"
        )


class _Bar(Shown):
    def __init__(self, bar: Progress, rows: int, there: int, unit: str) -> None:
        super().__init__(rows, there, unit)
        self._bar = bar
        self._task = bar.add_task("", total=rows, completed=there, rate="")

    def _show(self) -> None:
        rate = f"{self._rate():.3g} {self._unit}/s, {self._there + self._kept} kept"
        self._bar.update(self._task, completed=self.done, rate=rate)


@contextmanager
def shown(console: Console, rows: int, there: int, *, unit: str) -> Iterator[Shown]:
    """Show rows as they are played and written; arguments as `Shown`."""
    if not redraws(console):
        yield _Lines(console, rows, there, unit)
        return
    columns = (BarColumn(20), MofNCompleteColumn(), TextColumn("{task.fields[rate]}"), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        yield _Bar(bar, rows, there, unit)


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}"
