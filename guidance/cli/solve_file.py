"""A CSV or Parquet file of states or teams, solved and written chunk by chunk, so that memory holds one chunk.

A cell with text where a number is needed makes its row invalid (reason "not_a_number"); such cells are listed at the
end. A terminal shows a progress bar.

In a file of teams every row is a game of many pursuers and many evaders. Players are numbered from 0. A player whose
cells are empty is absent in that row, so teams can have different sizes.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pyarrow import csv, parquet
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from guidance.errors import ConfigError
from guidance.files import writing
from guidance.game import Ball, Game, Reason, Solution, Winner, solve
from guidance.game.team import Matching, match_teams
from guidance.screen import console, redraws

ROWS = 65536
"""Rows that are solved and written at a time."""

MAX_PLAYERS: Final = 50
"""Largest number of players on a side."""

_PLAYER = re.compile(r"(pursuer|evader)_(\d+)_[xyz]_m")
_AXES: Final = {"pursuer": "xyz", "evader": "xy"}

TEAM_COLUMNS: Final = tuple(
    f"{player}_{number}_{axis}_m" for player, axes in _AXES.items() for number in range(MAX_PLAYERS) for axis in axes
)
"""Every column of a file of teams."""

PURSUER = ("pursuer_x_m", "pursuer_y_m", "pursuer_z_m")
EVADER = ("evader_x_m", "evader_y_m")
TARGET = ("target_x_m", "target_y_m")
RATIO = "speed_ratio"
NUMBERS = (*PURSUER, *EVADER, *TARGET, RATIO, *TEAM_COLUMNS)
"""Columns that must hold numbers."""

KINDS = (".csv", ".parquet")
NOT_A_NUMBER = "not_a_number"
SHOWN = 5
"""How many cells without a number are listed."""

Column = Callable[[str], NDArray[np.float64]]
"""Reads a column of numbers, NaN where a cell is empty."""


class Cell(NamedTuple):
    """A cell that should hold a number: its row, counted from 1, its column and its text."""

    row: int
    column: str
    text: str


def solve_file(game: Game, states: Path, out: Path | None, *, ratio_given: bool) -> None:
    """Solve every row of a file and write the rows with their answers to another.

    Args:
        game: the game; a column speed_ratio replaces its pursuer's speed, row by row.
        states: CSV or Parquet file of states.
        out: CSV or Parquet file to write.
        ratio_given: whether the user gave a speed ratio; if not, the file must have the column.

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
        columns = (BarColumn(20), MofNCompleteColumn(), TextColumn("rows"), TimeRemainingColumn())
        bar = Progress(*columns, console=there, transient=True, disable=not redraws(there))
        with states.open("rb") as source, bar:
            task = bar.add_task("", total=_rows_of(states))
            for chunk in _chunks(source, states):
                numbers, cells = _with_numbers(chunk, first_row=done + 1)
                strange += cells
                answered = _answered(game, numbers, {cell.row - done - 1 for cell in cells}, ratio_given=ratio_given)
                done += chunk.num_rows
                writer = writer or _writer(out, answered.schema)
                with writing(out):
                    writer.write_table(answered)
                bar.update(task, completed=done)
    except pa.ArrowInvalid as error:
        raise ConfigError(f"--states {states}: cannot be read: {error}") from None
    finally:
        _close(writer, out)
    there.print(f"{out}: {done} rows", soft_wrap=True)
    if strange:
        shown = "; ".join(f"row {cell.row}, {cell.column} = {cell.text!r}" for cell in strange[:SHOWN])
        more = f"; and {len(strange) - SHOWN} more" if len(strange) > SHOWN else ""
        rows_lost = len({cell.row for cell in strange})
        lost = f"{rows_lost} of {done} rows have no answer, because a cell is not a number: {shown}{more}"
        there.print(f"{states}: {lost}", soft_wrap=True, markup=False)


def _rows_of(path: Path) -> int:
    """Return the number of rows; of a CSV file the number of its lines, for the progress bar."""
    if path.suffix == ".parquet":
        return int(parquet.ParquetFile(path).metadata.num_rows)
    with path.open("rb") as file:
        return max(0, sum(block.count(b"\n") for block in iter(lambda: file.read(1 << 20), b"")) - 1)


def _chunks(source: Any, path: Path) -> Iterator[pa.Table]:  # noqa: ANN401 - a binary file
    """Read a file in pieces of at most `ROWS` rows; a file without rows gives one empty piece."""
    if path.suffix == ".csv":
        words = dict.fromkeys(NUMBERS, pa.string())
        options = csv.ConvertOptions(column_types=words, strings_can_be_null=True)
        reader: Any = csv.open_csv(source, convert_options=options)
        schema = reader.schema
    else:
        file = parquet.ParquetFile(source)
        schema, reader = file.schema_arrow, file.iter_batches(batch_size=ROWS)
    empty = True
    for batch in reader:
        for start in range(0, batch.num_rows, ROWS):
            empty = False
            yield pa.Table.from_batches([batch.slice(start, ROWS)])
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
    """Convert the text in columns of numbers; a cell that holds no number becomes empty and is returned."""
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
    """Append the answers to a chunk of states; the rows in `lost` have a cell without a number."""
    names = set(chunk.column_names)
    game = _with_ratios(game, chunk, ratio_given=ratio_given)
    target = _places(chunk, TARGET) if names & set(TARGET) else None
    if _has_teams(names):
        columns = _team_answers(game, names, lambda name: _column(chunk, name), target, lost)
    else:
        columns = _columns(solve(game, _places(chunk, PURSUER), _places(chunk, EVADER), target))
    taken = names & set(columns)
    if taken and taken != set(columns):
        raise ConfigError(
            f"--states: the column {min(taken)} has the name of an answer and would be overwritten: rename it (only a "
            "complete earlier answer is replaced)"
        )
    for name in [name for name in columns if name.endswith("reason")]:
        columns[name] = [NOT_A_NUMBER if row in lost else str(said) for row, said in enumerate(columns[name])]
    for name, column in columns.items():
        if name in names:
            chunk = chunk.drop_columns([name])
        chunk = chunk.append_column(name, pa.array(column))
    return chunk


def _with_ratios(game: Game, chunk: pa.Table, *, ratio_given: bool) -> Game:
    """Return the game with the speed ratios of the file, if there is such a column."""
    there = RATIO in chunk.column_names
    if there and (ratio_given or not isinstance(game.pursuer, Ball)):
        raise ConfigError(f"--speed-ratio, --cylinder: must not be given, since the file has the column {RATIO}")
    if not there and isinstance(game.pursuer, Ball) and not ratio_given:
        raise ConfigError(f"--speed-ratio, --cylinder: one must be given, since the file has no column {RATIO}")
    return replace(game, pursuer=Ball(_column(chunk, RATIO) * game.evader_speed_m_s)) if there else game


def _places(chunk: pa.Table, names: tuple[str, ...]) -> NDArray[np.float64]:
    """Return positions (n, 3) from columns; z is 0 without a column for it."""
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
    """Return the columns of an answer: the fields of `Solution`, vectors as x, y and z."""
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


def _has_teams(names: set[str]) -> bool:
    """Return whether these are the columns of a file of teams."""
    return any(_PLAYER.fullmatch(name) for name in names)


def _team_answers(
    game: Game, names: set[str], column: Column, target: NDArray[np.float64] | None, lost: set[int]
) -> dict[str, Any]:
    """Return the columns of answers to the rows of a file of teams.

    Args:
        game: the game.
        names: of the file's columns.
        column: reads one column.
        target: (n, 3), m, or None for PE.
        lost: rows with a cell that holds no number; they have no answer.

    Raises:
        ConfigError: Players are not numbered from 0 on, there are too many, or a side has none; or as `match_teams`.
    """
    P, E = (_players(player, names, column) for player in _AXES)
    there = [np.isfinite(places).any(axis=-1) for places in (P, E)]
    answers = {name: np.full(*spec) for name, spec in _blank(len(P), P.shape[1], E.shape[1]).items()}
    patterns, rows = np.unique(np.concatenate(there, axis=1), axis=0, return_inverse=True)
    for number, pattern in enumerate(patterns):
        row = np.array([one for one in np.flatnonzero(rows.reshape(-1) == number) if one not in lost], dtype=np.intp)
        pursuers, evaders = np.flatnonzero(pattern[: P.shape[1]]), np.flatnonzero(pattern[P.shape[1] :])
        if len(row) and len(pursuers) and len(evaders):
            goal = None if target is None else target[row][:, None]
            found = match_teams(_of_rows(game, row), P[np.ix_(row, pursuers)], E[np.ix_(row, evaders)], goal)
            for name, part in _team_columns(found, pursuers, evaders):
                answers[name][row] = part
    return answers


def _of_rows(game: Game, row: NDArray[np.intp]) -> Game:
    """Return the game of some rows, whose speed ratio holds for all pursuers of a row."""
    if not isinstance(game.pursuer, Ball) or not np.ndim(game.pursuer.speed_m_s):
        return game
    return replace(game, pursuer=Ball(np.asarray(game.pursuer.speed_m_s)[row][:, None, None]))


def _players(player: str, names: set[str], column: Column) -> NDArray[np.float64]:
    """Return the positions of a side, (n, players, 3); evaders are at z = 0."""
    numbers = {int(found[2]) for found in map(_PLAYER.fullmatch, names) if found and found[1] == player}
    if not numbers or numbers != set(range(len(numbers))) or len(numbers) > MAX_PLAYERS:
        raise ConfigError(
            f"--states: the columns number the {player}s {sorted(numbers)}; they must be 0, 1, 2 and so on, "
            f"at most {MAX_PLAYERS}: {', '.join(f'{player}_0_{axis}_m' for axis in _AXES[player])}, {player}_1_x_m …"
        )
    places = [[column(f"{player}_{number}_{axis}_m") for axis in _AXES[player]] for number in sorted(numbers)]
    level = np.moveaxis(np.array(places), -1, 0)
    ground = np.where(np.isfinite(level[..., :1]), 0.0, np.nan)
    return level if player == "pursuer" else np.concatenate([level, ground], axis=-1)


def _blank(rows: int, pursuers: int, evaders: int) -> dict[str, tuple[int, Any, Any]]:
    """Return the columns of answers by name: the length, the value of a row without an answer, and the type."""
    nobody, number = (rows, -1, np.int64), (rows, np.nan, np.float64)
    columns: dict[str, tuple[int, Any, Any]] = {"guaranteed": (rows, 0, np.int64), "total": number}
    for i in range(pursuers):
        columns[f"pursuer_{i}_evader"] = nobody
        columns |= {f"pursuer_{i}_velocity_{axis}_m_s": number for axis in "xyz"}
    for j in range(evaders):
        columns |= {f"evader_{j}_winner": (rows, Winner.UNDECIDED.word, "<U32"), f"evader_{j}_first": nobody}
        columns |= {f"evader_{j}_second": nobody, f"evader_{j}_value": number, f"evader_{j}_lower_bound": number}
        columns |= {f"evader_{j}_meeting_point_{axis}_m": number for axis in "xy"}
        columns |= {f"evader_{j}_velocity_{axis}_m_s": number for axis in "xy"}
        columns[f"evader_{j}_reason"] = (rows, Reason.NOT_FINITE.word, "<U32")
    return columns


def _team_columns(found: Matching, pursuers: NDArray[np.intp], evaders: NDArray[np.intp]) -> Iterator[tuple[str, Any]]:
    """Yield the columns of a matching, with the player numbers of the file."""
    of_pursuers, of_evaders = np.append(pursuers, -1), np.append(evaders, -1)
    yield "guaranteed", found.guaranteed
    yield "total", found.total
    for place, i in enumerate(pursuers):
        yield f"pursuer_{i}_evader", of_evaders[found.evader_of[:, place]]
        for axis, name in enumerate("xyz"):
            yield f"pursuer_{i}_velocity_{name}_m_s", found.pursuer_velocity_m_s[:, place, axis]
    for place, j in enumerate(evaders):
        yield f"evader_{j}_winner", [Winner(code).word for code in found.winner[:, place].tolist()]
        yield f"evader_{j}_first", of_pursuers[found.first[:, place]]
        yield f"evader_{j}_second", of_pursuers[found.second[:, place]]
        yield f"evader_{j}_value", found.value[:, place]
        yield f"evader_{j}_lower_bound", found.lower_bound[:, place]
        for axis, name in enumerate("xy"):
            yield f"evader_{j}_meeting_point_{name}_m", found.meeting_point_m[:, place, axis]
            yield f"evader_{j}_velocity_{name}_m_s", found.evader_velocity_m_s[:, place, axis]
        yield f"evader_{j}_reason", [Reason(code).word for code in found.reason[:, place].tolist()]
