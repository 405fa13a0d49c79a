"""How far a sweep is: a bar on a terminal, a plain line now and then elsewhere."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from guidance.screen import redraws
from guidance.sweeps.running import Told

LINE_S = 10.0
"""Without a terminal, so often at most."""


@contextmanager
def shown(console: Console, rows: int, there: int, *, unit: str) -> Iterator[Told]:
    """Show rows as they are written.

    Args:
        console: Where.
        rows: How many there will be.
        there: How many there are already, which count for nothing in the rate.
        unit: What a row is: "games" or "flights".
    """
    begun_s, written = time.monotonic(), 0

    def rate() -> float:
        return written / max(1e-9, time.monotonic() - begun_s)

    if not redraws(console):
        said_s = begun_s

        def say(count: int) -> None:
            nonlocal written, said_s
            written += count
            if time.monotonic() - said_s >= LINE_S:
                said_s = time.monotonic()
                left_s = (rows - there - written) / rate()
                console.print(f"{there + written} of {rows} {unit}, {rate():.3g} a second, {_clock(left_s)} left")

        yield say
        return
    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[rate]}"), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=rows, completed=there, rate="")

        def draw(count: int) -> None:
            nonlocal written
            written += count
            bar.update(task, completed=there + written, rate=f"{rate():.3g} {unit}/s")

        yield draw


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}"
