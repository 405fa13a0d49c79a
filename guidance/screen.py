"""What people read in a terminal: tables that fit it, however narrow it is, and whole lines where there is none.

Colours are off for NO_COLOR, TERM=dumb and pipes; nothing is redrawn where there is no cursor to move.
"""

import contextlib
import os
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType
from rich.live import Live
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

PIPED_COLUMNS: Final = 400
"""As wide as this where nobody says how wide it is: a line is a line for `grep` and `cut`."""

_GAP: Final = 2
"""Between two columns, as Rich lays them out."""

Cell = str | Text


def console(*, stderr: bool = False) -> Console:
    """Return a console: as wide as the terminal or COLUMNS says, and wide in a pipe."""
    there = Console(stderr=stderr, highlight=False)
    if there.is_terminal or os.environ.get("COLUMNS", "").isdigit():
        return there
    return Console(stderr=stderr, highlight=False, width=PIPED_COLUMNS)


def printable(text: str) -> str:
    """Return text from a file or a radio with control characters escaped: they could command the terminal."""
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode() for one in text)


def redraws(there: Console) -> bool:
    """Whether a line on it can be drawn again."""
    return there.is_terminal and not there.is_dumb_terminal


@dataclass(frozen=True, slots=True)
class Sheet:
    """Rows under headings; where they are wider than the terminal, a paragraph for each row in their place.

    Attributes:
        headings: Of the columns; each says by itself what is under it.
        rows: As many cells each.
        left: Columns that are words, by number; the others are numbers and stand to the right.
        title: Above all of it.
        cut: The last column is cut where it does not fit, rather than every row made a paragraph.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    left: Iterable[int] = field(default=(0,))
    title: str | None = None
    cut: bool = False

    def __rich_console__(self, there: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        """Yield the table, or the paragraphs."""
        if self.title is not None:
            yield Text(self.title, style="italic")
        table = self._table(options.max_width)
        if self.cut or Measurement.get(there, options.update(width=10_000), table).maximum <= options.max_width:
            yield table
            return
        for place, row in enumerate(self.rows):
            if place:
                yield ""
            yield pairs(zip(self.headings, row, strict=True))

    def _table(self, width: int) -> Table:
        table = Table(box=None, pad_edge=False)
        left, free = set(self.left), width
        for place, heading in enumerate(self.headings):
            last = self.cut and place == len(self.headings) - 1
            table.add_column(
                heading,
                justify="left" if place in left else "right",
                no_wrap=self.cut,
                overflow="ellipsis" if last else "fold",
                max_width=max(1, free) if last else None,
            )
            free -= max(cell_len(str(cell)) for cell in (heading, *(row[place] for row in self.rows))) + _GAP
        for row in self.rows:
            table.add_row(*row)
        return table


def pairs(rows: Iterable[tuple[str, Cell]], *, title: str | None = None, right: bool = False) -> Table:
    """Lay out names and values, a pair a line; a long value goes on in the next line, beside its name."""
    table = Table(title=title, title_justify="left", show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold", overflow="fold")
    table.add_column(justify="right" if right else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


class Wait:
    """What is waited for; `what` may be said anew, and empty says nothing is.

    Args:
        what: At first.
        limit_s: For so long at most.
    """

    def __init__(self, what: str, limit_s: float) -> None:
        self.what = what
        self._limit_s = limit_s
        self._begun_s = time.monotonic()

    def anew(self, what: str, limit_s: float) -> None:
        """Wait for something else, from now on."""
        self.what, self._limit_s, self._begun_s = what, limit_s, time.monotonic()

    def __rich__(self) -> Text:
        """Say for what, since when and until when."""
        waited_s = time.monotonic() - self._begun_s
        words = f"waiting for {self.what}: {waited_s:.0f} s of {self._limit_s:.0f} s at most" if self.what else ""
        return Text(words, no_wrap=True, overflow="ellipsis")


@contextlib.contextmanager
def waiting(there: Console, what: str, limit_s: float) -> Iterator[Wait]:
    """Show what is waited for, in one line that goes on by itself; where nothing can be redrawn it is said once.

    Args:
        there: Where; standard error, so that what comes out stays clean.
        what: Is waited for.
        limit_s: For so long at most.
    """
    wait = Wait(what, limit_s)
    if not redraws(there):
        there.print(f"waiting for {what}, {limit_s:.0f} s at most", soft_wrap=True)
        yield wait
        return
    with Live(wait, console=there, refresh_per_second=4, transient=True):
        yield wait
