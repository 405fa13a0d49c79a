"""Progress of a sweep on the terminal: a bar, or a line now and then."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, NamedTuple

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from guidance.screen import console, redraws
from guidance.sweeps.folder import Folder

_LINE_S: Final = 10.0
"""Least time between two lines of progress where nothing can be redrawn."""


class Work(NamedTuple):
    """Work in a folder: the missing chunks, the number of rows already there, and the time of a chunk, s."""

    folder: Folder
    missing: list[int]
    rows_there: int
    chunk_s: float = math.nan


class Shown:
    """Progress on the terminal; call it with the number of rows that were just written.

    Args:
        work: The folder and its missing chunks.
        unit: "games" or "flights".
        expected_s: How long it should take; NaN if unknown.
        show: Prints rows kept and the text beside them.
        every_s: Least time between two prints.
    """

    def __init__(
        self, work: Work, unit: str, expected_s: float, show: Callable[[int, str], None], every_s: float
    ) -> None:
        self.kept = self._before = work.rows_there
        self._rows = work.folder.plan.rows
        self._unit, self._expected_s = unit, expected_s
        self._show, self._every_s = show, every_s
        self._begun_s = self._shown_s = time.monotonic()

    def __call__(self, rows: int) -> None:
        """Count rows, and show them if it is time."""
        self.kept += rows
        now_s = time.monotonic()
        if now_s - self._shown_s >= self._every_s:
            self._shown_s = now_s
            self._show(self.kept, self._text(now_s - self._begun_s))

    def _text(self, passed_s: float) -> str:
        done = self.kept - self._before
        if not done:
            left_s = self._expected_s - passed_s
            return f"about {clock(left_s)} left" if left_s > 0.0 else ""
        rate = done / max(1e-9, passed_s)
        return f"{rate:.3g} {self._unit}/s, {clock((self._rows - self.kept) / rate)} left"


@contextmanager
def shown(work: Work, unit: str, expected_s: float) -> Iterator[Shown]:
    """Show progress as a bar on a terminal, otherwise as a line now and then; arguments of `Shown`."""
    there, rows = console(stderr=True), work.folder.plan.rows
    if not redraws(there):

        def line(kept: int, text: str) -> None:
            there.print(f"{kept} of {rows} {unit}{', ' if text else ''}{text}")

        yield Shown(work, unit, expected_s, line, _LINE_S)
        return
    columns = (BarColumn(20), MofNCompleteColumn(), TextColumn("{task.fields[text]}"))
    with Progress(*columns, console=there, transient=True) as bar:
        task = bar.add_task("", total=rows, completed=work.rows_there, text="")
        yield Shown(work, unit, expected_s, lambda kept, text: bar.update(task, completed=kept, text=text), 0.0)


def clock(seconds: float) -> str:
    """Return a duration as hours, minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}"
