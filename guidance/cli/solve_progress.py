"""How far `guidance solve --states` is: a bar on a terminal, a plain line now and then elsewhere."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

from guidance.screen import redraws

LINE_S: Final = 5.0
"""Where nothing can be redrawn, so often at most."""

Read = Callable[[int, int], None]
"""Takes rows solved and bytes read so far."""


@contextmanager
def solving(there: Console, size_bytes: int, clock: Callable[[], float] = time.monotonic) -> Iterator[Read]:
    """Show how much of a file has been solved, and yield what it is told by.

    Args:
        there: Where to show it.
        size_bytes: Of the file.
        clock: Tells s.
    """
    if not redraws(there):
        yield _lines(there, size_bytes, clock)
        return
    columns = (BarColumn(20), DownloadColumn(), TextColumn("{task.fields[rows]} rows"), TimeRemainingColumn())
    with Progress(*columns, console=there, transient=True) as bar:
        task = bar.add_task("", total=size_bytes, rows=0)
        yield lambda rows, read: bar.update(task, completed=read, rows=rows)


def _lines(there: Console, size_bytes: int, clock: Callable[[], float]) -> Read:
    begun_s = said_s = clock()

    def tell(rows: int, read: int) -> None:
        nonlocal said_s
        now_s = clock()
        if now_s - said_s < LINE_S:
            return
        said_s = now_s
        part = min(1.0, max(1, read) / max(1, size_bytes))
        left_s = (now_s - begun_s) * (1.0 - part) / part
        there.print(f"{rows} rows, {part:.0%} of the file, about {left_s:.0f} s left", soft_wrap=True)

    return tell
