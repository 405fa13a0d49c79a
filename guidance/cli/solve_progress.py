"""How far `guidance solve --states` is: a bar on a terminal, a plain line now and then elsewhere."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from guidance.screen import redraws

LINE_S: Final = 5.0
"""Where nothing can be redrawn, so often at most."""

Told = Callable[[int], None]
"""Takes how many rows have been solved."""


@contextmanager
def solving(there: Console, rows: int, clock: Callable[[], float] = time.monotonic) -> Iterator[Told]:
    """Show how many rows of a file have been solved, and yield what it is told by.

    Args:
        there: Where to show it.
        rows: Of the file.
        clock: Tells s.
    """
    if not redraws(there):
        yield _lines(there, rows, clock)
        return
    columns = (BarColumn(20), MofNCompleteColumn(), TextColumn("rows"), TimeRemainingColumn())
    with Progress(*columns, console=there, transient=True) as bar:
        task = bar.add_task("", total=rows)
        yield lambda done: bar.update(task, completed=done)


def _lines(there: Console, rows: int, clock: Callable[[], float]) -> Told:
    begun_s = said_s = clock()

    def tell(done: int) -> None:
        nonlocal said_s
        now_s = clock()
        if now_s - said_s < LINE_S or done == 0:
            return
        said_s = now_s
        left_s = (now_s - begun_s) * max(0, rows - done) / done
        there.print(f"{done} of {rows} rows, about {left_s:.0f} s left", soft_wrap=True)

    return tell
