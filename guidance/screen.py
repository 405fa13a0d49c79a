"""Terminal output: tables that fit the terminal, and waiting lines. NO_COLOR, TERM=dumb and pipes have no colours.

Titles of files, messages of autopilots and answers of daemons come from strangers: text printed here has no
markup, and its control characters are escaped.
"""

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Final, TypeVar

from rich.console import Console, ConsoleOptions, JustifyMethod, RenderableType
from rich.live import Live
from rich.measure import Measurement
from rich.progress import Progress, TextColumn, track
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from guidance.texts import printable

PIPED_COLUMNS: Final = 400
"""Width of a pipe, so that a row stays one line for `grep` and `cut`."""

Cell = str | Text
_Step = TypeVar("_Step")


class PrintableConsole(Console):
    """A console that escapes control characters in everything that it prints."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Yield the segments of a renderable; those that move the cursor are rich's own."""
        for segment in super().render(renderable, options):
            if segment.control or segment.text.isprintable():
                yield segment
            else:
                lines = map(printable, segment.text.split("\n"))
                yield segment._replace(text="\n".join(lines))


def console(*, stderr: bool = False) -> Console:
    """Return a console as wide as the terminal or COLUMNS; a pipe is `PIPED_COLUMNS` wide."""
    default = PrintableConsole(stderr=stderr, highlight=False, markup=False, emoji=False)
    if default.is_terminal or os.environ.get("COLUMNS", "").isdigit():
        return default
    return PrintableConsole(
        stderr=stderr, highlight=False, markup=False, emoji=False, width=PIPED_COLUMNS
    )


def headed(title: str, words: str) -> Text:
    """Return a line that begins with a bold title."""
    return Text.assemble((title, "bold"), words)


def redraws(target: Console) -> bool:
    """Return true if the console can redraw a line."""
    return target.is_terminal and not target.is_dumb_terminal


def text_table(
    headings: Sequence[str],
    rows: Iterable[Sequence[Cell]],
    *,
    left: Collection[int] = (0,),
    title: str | None = None,
) -> Table:
    """Return a table. In a narrow terminal, text columns with several words wrap; if there are none, names do.

    Args:
        headings: Column headings.
        rows: One cell per heading.
        left: Indices of the text columns; the others are right-aligned numbers, which do not wrap.
        title: Title above the table.
    """
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    lines = list(rows)
    wrapping = {column for column in left if any(" " in str(row[column]) for row in lines)} or set(
        left
    )
    for column, heading in enumerate(headings):
        justify: JustifyMethod = "left" if column in left else "right"
        table.add_column(heading, justify=justify, no_wrap=column not in wrapping, overflow="fold")
    for row in lines:
        table.add_row(*row)
    return table


def print_text_table(
    target: Console,
    headings: Sequence[str],
    rows: Sequence[Sequence[Cell]],
    *,
    left: Collection[int],
) -> None:
    """Print a table, or if it does not fit, each of its rows as a list of names and values.

    Args:
        target: The console.
        headings: Column headings.
        rows: One cell per heading.
        left: Indices of the text columns, as for `text_table`.
    """
    table = text_table(headings, rows, left=left)
    least = Measurement.get(target, target.options.update(width=PIPED_COLUMNS), table).minimum
    if least <= target.width:
        target.print(table)
        return
    for row in rows:
        target.print(pairs(zip(headings, row, strict=True)))
        target.print()


def counted(steps: Iterable[_Step], what: str, total: int) -> Iterator[_Step]:
    """Yield the steps of long work and show how many are done; a console that cannot redraw prints a line at the start.

    Args:
        steps: The work.
        what: The work in words.
        total: Number of steps.
    """
    target = console(stderr=True)
    if not redraws(target):
        target.print(f"{what}: {total} steps", soft_wrap=True)
    yield from track(
        steps, what, total=total, console=target, transient=True, disable=not redraws(target)
    )


def pairs(
    rows: Iterable[tuple[str, Cell]], *, title: str | None = None, right: bool = False
) -> Table:
    """Return a table of names and values. Long values wrap beside their name."""
    table = Table(title=title, title_justify="left", show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold", overflow="fold")
    table.add_column(justify="right" if right else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


def aged(words: str, age_s: float, stalled_s: float) -> str:
    """Return a live line; if it is older than `stalled_s`, its age first."""
    return f"NO NEWS for {age_s:.0f} s; last {words}" if words and age_s > stalled_s else words


def live(
    target: Console, draw: Callable[[], str], *, every_s: float = 0.25
) -> AbstractContextManager[object]:
    """Redraw a line repeatedly, below the printed lines; show none if the console cannot redraw it.

    Args:
        target: The console.
        draw: Returns the line. It runs on another thread, so that a blocked terminal stops only that thread.
        every_s: Period.
    """

    def line() -> Text:
        return Text(draw(), no_wrap=True, overflow="ellipsis")

    display = Live(
        get_renderable=line, console=target, refresh_per_second=1.0 / every_s, transient=True
    )
    return display if redraws(target) else nullcontext()


@contextmanager
def waiting(target: Console, what: str, limit_s: float) -> Iterator[Callable[[str], None]]:
    """Show a waiting line and keep it current; a console that cannot redraw prints it once.

    Args:
        target: The console; standard error, so that the output stays clean.
        what: The awaited event, in words.
        limit_s: Longest wait.

    Yields:
        A function that changes the words.
    """
    if not redraws(target):
        target.print(f"waiting for {what}, at most {limit_s:.0f} s", soft_wrap=True)
    column = Column(no_wrap=True, overflow="ellipsis")
    line = "waiting for {task.description}: {task.elapsed:.0f} s of {task.total:.0f} s"
    elapsed = TextColumn(line, markup=False, table_column=column, style="none")
    with Progress(elapsed, console=target, transient=True, disable=not redraws(target)) as progress:
        task = progress.add_task(what, total=limit_s)
        yield lambda words: progress.update(task, description=words)
