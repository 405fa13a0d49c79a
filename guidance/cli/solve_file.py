"""The states of a CSV or Parquet file, solved and written chunk by chunk: memory holds one chunk, not the file.

A cell that should be a number and is not costs its own row, whose reason says not_a_number, and is named at the end.
How far it is, a bar shows on a terminal, and a plain line now and then elsewhere.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pyarrow import csv, parquet
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from guidance.cli.solve_teams import TEAM_COLUMNS, has_teams, team_answers
from guidance.errors import ConfigError
from guidance.files import writing
from guidance.game import Ball, Game, Reason, Solution, Winner, solve
from guidance.screen import console, redraws

PURSUER = ("pursuer_x_m", "pursuer_y_m", "pursuer_z_m")
EVADER = ("evader_x_m", "evader_y_m")
TARGET = ("target_x_m", "target_y_m")
RATIO = "speed_ratio"
NUMBERS = (*PURSUER, *EVADER, *TARGET, RATIO, *TEAM_COLUMNS)
"""Columns that must hold numbers."""

KINDS = (".csv", ".parquet")
NOT_A_NUMBER = "not_a_number"
SHOWN = 5
"""Cells without a number that are named."""

LINE_S: Final = 5.0
"""Where nothing can be redrawn, so often at most."""

Told = Callable[[int], None]
"""Takes how many rows have been solved."""


class Cell(NamedTuple):
    """A cell that should hold a number: its row, counted from 1, its column and what it holds."""

    row: int
    column: str
    text: str


def solve_file(game: Game, states: Path, out: Path | None, *, rows: int, ratio_given: bool) -> None:
    """Solve every row of a file and write the rows with their answers to another.

    Args:
        game: what is played; a column speed_ratio replaces its pursuer's speed, row by row.
        states: CSV or Parquet file of states.
        out: CSV or Parquet file to write.
        rows: rows solved and written at a time.
        ratio_given: whether the game's own speed ratio was asked for, rather than left to the column.

    Raises:
        ConfigError: a file is missing or neither CSV nor Parquet, a column is missing, can hold no numbers or has the
            name of an answer, or the speed ratio is given twice or not at all.
        OutputError: the answers cannot be written.
    """
    if out is None:
        raise ConfigError(f"--out: missing; it names the file for the answers, which ends in {' or '.join(KINDS)}")
    if out.suffix not in KINDS:
        raise ConfigError(f"--out {out}: must end in {' or '.join(KINDS)}")
    if states.suffix not in KINDS or not states.is_file():
        raise ConfigError(f"--states {states}: must be an existing file that ends in {' or '.join(KINDS)}")
    if states.resolve() == out.resolve():
        raise ConfigError(f"--out {out}: must not be the file of the states")
    writer: Any = None
    strange: list[Cell] = []
    done, there = 0, console(stderr=True)
    try:
        with states.open("rb") as source, solving(there, _rows_of(states)) as tell:
            for chunk in _chunks(source, states, rows):
                numbers, cells = _with_numbers(chunk, first_row=done + 1)
                strange += cells
                answered = _answered(game, numbers, {cell.row - done - 1 for cell in cells}, ratio_given=ratio_given)
                done += chunk.num_rows
                writer = writer or _writer(out, answered.schema)
                with writing(out):
                    writer.write_table(answered)
                tell(done)
    except pa.ArrowInvalid as error:
        raise ConfigError(f"--states {states}: cannot be read: {error}") from None
    finally:
        _close(writer, out)
    there.print(f"{out}: {done} rows", soft_wrap=True)
    if strange:
        shown = "; ".join(f"row {cell.row}, {cell.column} = {cell.text!r}" for cell in strange[:SHOWN])
        more = f"; and {len(strange) - SHOWN} more" if len(strange) > SHOWN else ""
        rows_lost = len({cell.row for cell in strange})
        lost = f"{rows_lost} of {done} rows have no answer, for want of a number: {shown}{more}"
        there.print(f"{states}: {lost}", soft_wrap=True, markup=False)


def _rows_of(path: Path) -> int:
    """Count the rows of a file; of CSV its lines, which is as many unless a cell has several."""
    if path.suffix == ".parquet":
        return int(parquet.ParquetFile(path).metadata.num_rows)
    with path.open("rb") as file:
        return max(0, sum(block.count(b"\n") for block in iter(lambda: file.read(1 << 20), b"")) - 1)


def _chunks(source: Any, path: Path, rows: int) -> Iterator[pa.Table]:  # noqa: ANN401 - a binary file
    """Read a file piece by piece, no piece longer than `rows`; one without rows gives one empty piece."""
    if path.suffix == ".csv":
        words = dict.fromkeys(NUMBERS, pa.string())
        options = csv.ConvertOptions(column_types=words, strings_can_be_null=True)
        reader: Any = csv.open_csv(source, convert_options=options)
        schema = reader.schema
    else:
        file = parquet.ParquetFile(source)
        schema, reader = file.schema_arrow, file.iter_batches(batch_size=rows)
    empty = True
    for batch in reader:
        for start in range(0, batch.num_rows, rows):
            empty = False
            yield pa.Table.from_batches([batch.slice(start, rows)])
    if empty:
        yield schema.empty_table()


def _writer(out: Path, schema: pa.Schema) -> csv.CSVWriter | parquet.ParquetWriter:
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        return csv.CSVWriter(out, schema) if out.suffix == ".csv" else parquet.ParquetWriter(out, schema)


def _close(writer: csv.CSVWriter | parquet.ParquetWriter | None, out: Path) -> None:
    if writer is not None:
        with writing(out):
            writer.close()


def _with_numbers(chunk: pa.Table, *, first_row: int) -> tuple[pa.Table, list[Cell]]:
    """Make numbers of the words in the columns of a state; where that cannot be, the cell is empty and is returned."""
    strange = []
    for name in NUMBERS:
        place = chunk.schema.get_field_index(name)
        if place < 0 or not (
            pa.types.is_string(chunk.column(place).type) or pa.types.is_null(chunk.column(place).type)
        ):
            continue
        words = pc.utf8_trim_whitespace(chunk.column(place).cast(pa.string()))
        try:
            numbers = words.cast(pa.float64())
        except pa.ArrowInvalid:
            cells = [_number(word) for word in words.to_pylist()]
            strange += [
                Cell(first_row + index, name, word)
                for index, (word, number) in enumerate(zip(words.to_pylist(), cells, strict=True))
                if word is not None and number is None
            ]
            numbers = pa.array(cells, pa.float64())
        chunk = chunk.set_column(place, name, numbers)
    return chunk, sorted(strange)


def _number(word: str | None) -> float | None:
    try:
        return None if word is None else float(word)
    except ValueError:
        return None


def _answered(game: Game, chunk: pa.Table, lost: set[int], *, ratio_given: bool) -> pa.Table:
    """Append the answers to a chunk of states; the rows of `lost` have a cell without a number."""
    names = set(chunk.column_names)
    game = _with_ratios(game, chunk, ratio_given=ratio_given)
    target = _places(chunk, TARGET) if names & set(TARGET) else None
    if has_teams(names):
        columns = team_answers(game, names, lambda name: _column(chunk, name), target, lost)
    else:
        columns = _columns(solve(game, _places(chunk, PURSUER), _places(chunk, EVADER), target))
    taken = names & set(columns)
    if taken and taken != set(columns):
        raise ConfigError(
            f"--states: the column {min(taken)} has the name of an answer, and would be lost: rename it (only a whole "
            "earlier answer is replaced)"
        )
    for name in [name for name in columns if name.endswith("reason")]:
        columns[name] = [NOT_A_NUMBER if row in lost else str(said) for row, said in enumerate(columns[name])]
    for name, column in columns.items():
        if name in names:
            chunk = chunk.drop_columns([name])
        chunk = chunk.append_column(name, pa.array(column))
    return chunk


def _with_ratios(game: Game, chunk: pa.Table, *, ratio_given: bool) -> Game:
    """Return the game with the speed ratios of a file that has them."""
    there = RATIO in chunk.column_names
    if there and (ratio_given or not isinstance(game.pursuer, Ball)):
        raise ConfigError(f"--speed-ratio, --cylinder: must not be given, since the file has the column {RATIO}")
    if not there and isinstance(game.pursuer, Ball) and not ratio_given:
        raise ConfigError(f"--speed-ratio, --cylinder: one must be given, since the file has no column {RATIO}")
    return replace(game, pursuer=Ball(_column(chunk, RATIO) * game.evader_speed_m_s)) if there else game


def _places(chunk: pa.Table, names: tuple[str, ...]) -> NDArray[np.float64]:
    """Return positions (n, 3) from columns; z is 0 where there is no column for it."""
    places = np.zeros((chunk.num_rows, 3))
    for axis, name in enumerate(names):
        places[:, axis] = _column(chunk, name)
    return places


def _column(chunk: pa.Table, name: str) -> NDArray[np.float64]:
    """Return a column of numbers, NaN where a cell is empty."""
    if name not in chunk.column_names:
        raise ConfigError(f"--states: the column {name} is missing; it has {', '.join(chunk.column_names)}")
    column = chunk.column(name)
    if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
        raise ConfigError(f"--states: the column {name} holds {column.type}; it must hold numbers")
    numbers: NDArray[np.float64] = column.cast(pa.float64()).to_numpy()
    return numbers


def _columns(answer: Solution) -> dict[str, Any]:
    """Name the columns of an answer as the single answer names its fields, with x, y and z apart."""
    columns: dict[str, Any] = {}
    for name, field in answer._asdict().items():
        if field.ndim == 1:
            columns[name] = field
        else:
            stem, unit = name.removesuffix("_m_s").removesuffix("_m"), "_m_s" if name.endswith("_m_s") else "_m"
            columns |= {f"{stem}_{axis}{unit}": field[:, place] for place, axis in enumerate("xyz")}
    columns["winner"] = [Winner(code).word for code in answer.winner.tolist()]
    columns["reason"] = [Reason(code).word for code in answer.reason.tolist()]
    return columns


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
