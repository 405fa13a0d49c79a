"""What `guidance sweep FILE` does around the work: the folder, the crew, the bar, the last word."""

import time
from pathlib import Path

from rich.console import Console

from guidance.errors import ConfigError
from guidance.sweeps.crew import gathered, workers_by_default
from guidance.sweeps.folder import alone
from guidance.sweeps.model import Way
from guidance.sweeps.progress import shown
from guidance.sweeps.running import begun, finish, planned

UNITS: dict[Way, str] = {"maths": "games", "fast": "flights"}


def run_sweep(
    name: str, *, way: Way | None, workers: int | None, scheduler: str | None, out: Path | None, chunk: int | None
) -> Path:
    """Run a sweep, or go on with it; return its folder.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    console = Console(stderr=True)
    plan = planned(name, way)
    path = out if out is not None else Path("sweeps") / f"{Path(name).stem}-{plan.way}"
    unit = UNITS[plan.way]
    crew_size = workers if workers is not None else workers_by_default()
    with alone(path):
        work = begun(plan, path, chunk)
        count = len(work.missing)
        there = f", {work.rows_there} of them there already" if work.rows_there else ""
        console.print(f"[bold]{plan.sweep.title or Path(name).stem}[/bold]: {plan.rows} {unit}{there}", highlight=False)
        if count:
            crew_size = min(crew_size, count)
            begun_s = time.monotonic()
            with gathered(crew_size, scheduler) as crew, shown(console, plan.rows, work.rows_there, unit=unit) as told:
                finish(work, crew, told)
            took_s = time.monotonic() - begun_s
            rows = plan.rows - work.rows_there
            console.print(f"{rows} {unit} in {took_s:.1f} s, {rows / took_s:.3g} a second", highlight=False)
    return path


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
