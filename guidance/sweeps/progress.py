"""How far a sweep is: a bar on a terminal, a plain line now and then elsewhere."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from guidance.screen import redraws

LINE_S = 10.0
"""Where nothing can be redrawn, so often at most."""


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
