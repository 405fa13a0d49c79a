"""What `guidance sweep FILE` does around the work: the folder, the crew, the bar, the last word."""

import time
from pathlib import Path

from guidance.errors import ConfigError
from guidance.screen import console
from guidance.sweeps.executors import Executor, executor, workers_by_default
from guidance.sweeps.folder import MANIFEST, alone
from guidance.sweeps.model import Way
from guidance.sweeps.progress import shown
from guidance.sweeps.running import Told, Work, begun, finish, planned

UNITS: dict[Way, str] = {"maths": "games", "fast": "flights"}


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
