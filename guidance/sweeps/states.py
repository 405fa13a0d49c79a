"""A CSV or Parquet file of states or teams, solved and written chunk by chunk, so that memory holds one chunk.

A cell with text where a number is needed makes its row invalid (reason "not_a_number"); such cells are listed at the
end. A terminal shows a progress bar.

In a file of teams every row is a game of many pursuers and many evaders. Players are numbered from 0. A player whose
cells are empty is absent in that row, so teams can have different sizes.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv, parquet
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from guidance.errors import ConfigError
from guidance.files import private_file, writing
from guidance.game import Ball, Game, Reason, Winner, solve
from guidance.game.arrays import Array
from guidance.game.records import rows_of
from guidance.game.team import Matching, match_teams
from guidance.screen import console, redraws

ROWS_AT_ONCE = 65536
"""Rows that are solved and written at a time."""

MAX_PLAYERS: Final = 50
"""Largest number of players on a side."""

_AXES: Final = {"pursuer": "xyz", "evader": "xy", "target": "xy"}
_PLAYER: Final = re.compile(r"(pursuer|evader)_(\d+)_[xyz]_m")
_RATIO: Final = "speed_ratio"
_NUMBERS: Final = re.compile(rf"{_RATIO}|target_[xy]_m|pursuer_(\d+_)?[xyz]_m|evader_(\d+_)?[xy]_m")
"""Names of the columns that must hold numbers."""

_NUMBER_FORM: Final = r"^([+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?|[+-]?inf(inity)?|nan)$"
_KINDS: Final = (".csv", ".parquet")
_SHOWN: Final = 5
"""Most cells without a number that are listed."""

_WORDS: Final[dict[str, type[Winner | Reason]]] = {"winner": Winner, "reason": Reason}
_TEAM_COLUMNS: Final = {
    "guaranteed": ("guaranteed", 0),
    "total": ("total", np.nan),
    "evader_of": ("pursuer_{}_evader", -1),
    "pursuer_velocity_m_s": ("pursuer_{}_velocity_{}_m_s", np.nan),
    "winner": ("evader_{}_winner", Winner.UNDECIDED),
    "first": ("evader_{}_first", -1),
    "second": ("evader_{}_second", -1),
    "value": ("evader_{}_value", np.nan),
    "lower_bound": ("evader_{}_lower_bound", np.nan),
    "meeting_point_m": ("evader_{}_meeting_point_{}_m", np.nan),
    "evader_velocity_m_s": ("evader_{}_velocity_{}_m_s", np.nan),
    "reason": ("evader_{}_reason", Reason.NOT_FINITE),
}
"""Fields of `Matching`: their columns, by player and axis, and the value of a row or player without an answer."""

_Cell = tuple[int, str, str]
"""A cell that should hold a number: its row, counted from 1, its column and its text."""


class _Teams(NamedTuple):
    """Rows of a file with the same players, by their numbers."""

    rows: Array
    pursuers: Array
    evaders: Array


def solve_file(game: Game, states: Path, out: Path | None, *, speeds_given: bool) -> None:
    """Solve every row of a file and write the rows with their answers to another.

    Args:
        game: the game; a column speed_ratio replaces its pursuer's speed, row by row.
        states: CSV or Parquet file of states.
        out: CSV or Parquet file to write.
        speeds_given: whether the user gave the pursuer's speeds; if not, the file must have the column.

    Raises:
        ConfigError: a file is missing or neither CSV nor Parquet, a column is missing, can hold no numbers or has the
            name of an answer, or the speed ratio is given twice or not at all.
        OutputError: the answers cannot be written.
    """
    out = _checked_out(states, out)
    writer: Any = None
    strange: list[_Cell] = []
    rows_done = 0
    target = console(stderr=True)
    try:
        columns = (BarColumn(20), MofNCompleteColumn(), TextColumn("rows"), TimeRemainingColumn())
        with Progress(*columns, console=target, transient=True, disable=not redraws(target)) as bar:
            # Rows for the progress bar: a CSV file's lines, less its header.
            if states.suffix == ".parquet":
                row_count = int(parquet.read_metadata(states).num_rows)
            else:
                lines = 0
                with states.open("rb") as file:
                    while block := file.read(1 << 20):
                        lines += block.count(b"\n")
                row_count = max(0, lines - 1)
            task = bar.add_task("", total=row_count)
            for chunk in _chunks(states):
                first_row = rows_done + 1
                numbers, cells = _with_numbers(chunk, first_row=first_row)
                strange += cells
                lost = {row - first_row for row, *_ in cells}
                answered = _answered(game, numbers, lost, speeds_given=speeds_given)
                rows_done += chunk.num_rows
                with writing(out):
                    if writer is None:
                        out.parent.mkdir(parents=True, exist_ok=True)
                        private_file(out)
                        if out.suffix == ".csv":
                            writer = csv.CSVWriter(out, answered.schema)
                        else:
                            writer = parquet.ParquetWriter(out, answered.schema)
                    writer.write_table(answered)
                bar.update(task, completed=rows_done)
    except pa.ArrowInvalid as error:
        raise ConfigError(f"--states {states}: cannot be read: {error}") from None
    finally:
        if writer is not None:
            with writing(out):
                writer.close()
    target.print(f"{out}: {rows_done} rows", soft_wrap=True)
    if strange:
        count = len({row for row, *_ in strange})
        fault = f"{count} of {rows_done} rows have no answer, because a cell is not a number"
        words = [f"row {row}, {column} = {text!r}" for row, column, text in strange[:_SHOWN]]
        hidden = len(strange) - _SHOWN
        if hidden > 0:
            words.append(f"and {hidden} more")
        target.print(f"{states}: {fault}: {'; '.join(words)}", soft_wrap=True, markup=False)


def _checked_out(states: Path, out: Path | None) -> Path:
    """Return the file for the answers, if both files can be used."""
    kinds = " or ".join(_KINDS)
    if out is None:
        raise ConfigError(
            f"--out: missing; it names the file for the answers, which ends in {kinds}"
        )
    if out.suffix not in _KINDS:
        raise ConfigError(f"--out {out}: must end in {kinds}")
    if states.suffix not in _KINDS or not states.is_file():
        raise ConfigError(f"--states {states}: must be an existing file that ends in {kinds}")
    with states.open("rb") as file:
        if file.read(2) == b"\x1f\x8b":
            raise ConfigError(f"--states {states}: is compressed with gzip: unpack it")
    if states.resolve() == out.resolve():
        raise ConfigError(f"--out {out}: must not be the file of the states")
    return out


def _chunks(path: Path) -> Iterator[pa.Table]:
    """Read a file in pieces of at most `ROWS_AT_ONCE` rows; a file without rows gives one empty piece.

    Raises:
        ConfigError: Its columns have no names, or two have the same.
    """
    if path.suffix == ".csv":
        with csv.open_csv(path) as columns:
            names = _checked_names(path, columns.schema)
            types = dict.fromkeys(filter(_NUMBERS.fullmatch, names), pa.string())
        as_text = csv.ConvertOptions(column_types=types, strings_can_be_null=True)
        batches: Any = csv.open_csv(path, convert_options=as_text)
        schema = batches.schema
    else:
        file = parquet.ParquetFile(path)
        schema = file.schema_arrow
        _checked_names(path, schema)
        batches = file.iter_batches(ROWS_AT_ONCE)
    rows_read = 0
    for batch in batches:
        for start in range(0, batch.num_rows, ROWS_AT_ONCE):
            piece = batch.slice(start, ROWS_AT_ONCE)
            yield pa.table(piece)
        rows_read += batch.num_rows
    if not rows_read:
        yield schema.empty_table()


def _checked_names(path: Path, schema: pa.Schema) -> list[str]:
    try:
        names: list[str] = schema.names
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"--states {path}: its first line is not UTF-8: save it as UTF-8"
        ) from error
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ConfigError(f"--states {path}: the column {twice[0]} is there twice; rename one")
    return names


def _with_numbers(chunk: pa.Table, *, first_row: int) -> tuple[pa.Table, list[_Cell]]:
    """Convert the text in columns of numbers; a cell that holds no number becomes empty and is returned."""
    strange = []
    for column, name in enumerate(chunk.column_names):
        kind = chunk.schema.field(name).type
        is_text = pa.types.is_string(kind) or pa.types.is_null(kind)
        if not is_text or not _NUMBERS.fullmatch(name):
            continue
        texts = chunk.column(column).cast(pa.string())
        words = pc.utf8_trim_whitespace(texts)
        is_number = pc.match_substring_regex(words, _NUMBER_FORM, ignore_case=True)
        wrong_rows = pc.indices_nonzero(pc.invert(is_number)).to_pylist()
        strange += [(first_row + row, name, words[row].as_py()) for row in wrong_rows]
        number_words = pc.if_else(is_number, words, None)
        chunk = chunk.set_column(column, name, number_words.cast(pa.float64()))
    return chunk, sorted(strange)


def _answered(game: Game, chunk: pa.Table, lost: set[int], *, speeds_given: bool) -> pa.Table:
    """Append the answers to a chunk of states; the rows in `lost` have a cell without a number."""
    names = set(chunk.column_names)
    # The speed ratios of the file, if it has them.
    has_ratio = _RATIO in chunk.column_names
    if has_ratio and speeds_given:
        raise ConfigError(
            f"--speed-ratio, --cylinder: must not be given, since the file has the column {_RATIO}"
        )
    if not has_ratio and not speeds_given:
        raise ConfigError(
            f"--speed-ratio, --cylinder: one must be given, since the file has no column {_RATIO}"
        )
    if has_ratio:
        pursuer_speed_m_s = _column(chunk, _RATIO) * game.evader_speed_m_s
        game = replace(game, pursuer=Ball(pursuer_speed_m_s))
    has_target = "target_x_m" in names or "target_y_m" in names
    target = _place(chunk, "target") if has_target else None
    if any(map(_PLAYER.fullmatch, names)):
        fields = _team_columns(game, chunk, target, lost)
    else:
        pursuer_m = _place(chunk, "pursuer")
        evader_m = _place(chunk, "evader")
        solution = solve(game, pursuer_m, evader_m, target)
        fields = {}
        for name, values in solution._asdict().items():
            column = name
            if values.ndim > 1:
                # A vector has a column for each axis, before its unit
                column = re.sub(r"(_m_s|_m)$", r"_{}\1", name)
            fields[column] = values
    columns: dict[str, Any] = {}
    for column, field in fields.items():
        columns.update(_flat(column, field))
    taken = names & set(columns)
    if taken and taken != set(columns):
        fault = f"the column {min(taken)} has the name of an answer and would be overwritten"
        raise ConfigError(
            f"--states: {fault}: rename it (only a complete earlier answer is replaced)"
        )
    for name, values in columns.items():
        if name.endswith("reason"):
            values = ["not_a_number" if row in lost else word for row, word in enumerate(values)]  # noqa: PLW2901
        if name in names:
            chunk = chunk.drop_columns([name])
        chunk = chunk.append_column(name, pa.array(values))
    return chunk


def _place(chunk: pa.Table, player: str) -> Array:
    """Return the positions of a player or of the target, (n, 3); those without a height are at z = 0."""
    kind, _, _ = player.partition("_")
    columns = [_column(chunk, f"{player}_{axis}_m") for axis in _AXES[kind]]
    level = 0.0 * np.abs(columns[0])  # NaN where the position is unknown
    return np.stack([*columns, level][:3], axis=-1)


def _column(chunk: pa.Table, name: str) -> Array:
    """Return a column of numbers, NaN where a cell is empty."""
    if name not in chunk.column_names:
        names = ", ".join(chunk.column_names)
        raise ConfigError(f"--states: the column {name} is missing; it has {names}")
    column = chunk.column(name)
    kind = column.type
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
        raise ConfigError(f"--states: the column {name} holds {kind}; it must hold numbers")
    return np.asarray(column.cast(pa.float64()).to_numpy())


def _flat(column: str, field: Array) -> Iterator[tuple[str, Any]]:
    """Yield the columns of an answer's field (rows, ...): one for each player and axis; codes as words."""
    words = _WORDS.get(column.rpartition("_")[2])
    for index in np.ndindex(field.shape[1:]):
        values = field[:, *index]
        labels: list[int | str] = list(index)
        if column.endswith(("_m", "_m_s")):
            labels[-1] = "xyz"[index[-1]]
        name = column.format(*labels)
        if words is None:
            yield name, values
        else:
            yield name, [words(code).word for code in values.tolist()]


def _team_columns(
    game: Game, chunk: pa.Table, target: Array | None, lost: set[int]
) -> dict[str, Any]:
    """Return the answers to the rows of a file of teams: name of the columns, and a field (rows, ...).

    Args:
        game: the game.
        chunk: the states.
        target: (n, 3), m, or None for PE.
        lost: rows with a cell that holds no number; they have no answer.

    Raises:
        ConfigError: Players are not numbered from 0 on, there are too many, or a side has none; or as `match_teams`.
    """
    pursuers_m = _positions_of(chunk, "pursuer")
    evaders_m = _positions_of(chunk, "evader")
    rows, pursuers, _ = pursuers_m.shape
    evaders = evaders_m.shape[1]
    # Rows without an answer.
    shapes: dict[str, tuple[int, ...]] = {
        "guaranteed": (),
        "total": (),
        "evader_of": (pursuers,),
        "pursuer_velocity_m_s": (pursuers, 3),
        "meeting_point_m": (evaders, 2),
        "evader_velocity_m_s": (evaders, 2),
    }
    answers = {}
    for name, (_, blank) in _TEAM_COLUMNS.items():
        shape = shapes.get(name, (evaders,))
        answers[name] = np.full((rows, *shape), blank)
    for teams in _teams_in(pursuers_m, evaders_m, lost):
        row_games = rows_of(game, itemgetter((teams.rows, None, None)))
        P = pursuers_m[np.ix_(teams.rows, teams.pursuers)]
        E = evaders_m[np.ix_(teams.rows, teams.evaders)]
        goal = None if target is None else target[teams.rows][:, None]
        matching = match_teams(row_games, P, E, goal)
        _fill_in(answers, teams, matching)
    columns = {}
    for name, field in answers.items():
        column, _ = _TEAM_COLUMNS[name]
        columns[column] = field
    return columns


def _teams_in(pursuers_m: Array, evaders_m: Array, lost: set[int]) -> Iterator[_Teams]:
    """Group the rows by the players that are present; skip lost rows and those that lack a side."""
    has_pursuer = np.isfinite(pursuers_m).any(axis=-1)
    has_evader = np.isfinite(evaders_m).any(axis=-1)
    pursuer_count = has_pursuer.shape[1]
    present = np.concatenate([has_pursuer, has_evader], axis=1)
    patterns, kinds = np.unique(present, axis=0, return_inverse=True)
    for number, pattern in enumerate(patterns):
        matching_rows = np.flatnonzero(kinds.reshape(-1) == number)
        rows = np.setdiff1d(matching_rows, list(lost))
        pursuers = np.flatnonzero(pattern[:pursuer_count])
        evaders = np.flatnonzero(pattern[pursuer_count:])
        if rows.size and pursuers.size and evaders.size:
            yield _Teams(rows, pursuers, evaders)


def _fill_in(answers: dict[str, Array], teams: _Teams, match: Matching) -> None:
    """Write the answers to some rows, with the players numbered as in the file."""
    numbers = {"first": teams.pursuers, "second": teams.pursuers, "evader_of": teams.evaders}
    for name, column in answers.items():
        part = getattr(match, name)
        if name in numbers:
            # -1 means none; it takes the last place
            part = np.append(numbers[name], -1)[part]
        if column.ndim == 1:
            column[teams.rows] = part
            continue
        column_name, _ = _TEAM_COLUMNS[name]
        players = teams.pursuers if "pursuer" in column_name else teams.evaders
        cells = np.ix_(teams.rows, players)
        column[cells] = part[..., : column.shape[-1]]


def _positions_of(chunk: pa.Table, player: str) -> Array:
    """Return the positions of a side, (n, players, 3)."""
    matches = filter(None, map(_PLAYER.fullmatch, chunk.column_names))
    numbers = {int(name[2]) for name in matches if name[1] == player}
    count = len(numbers)
    sorted_numbers = sorted(numbers)
    if count not in range(1, MAX_PLAYERS + 1) or sorted_numbers != list(range(count)):
        names = ", ".join(f"{player}_0_{axis}_m" for axis in _AXES[player])
        allowed = (
            f"they must be 0, 1, 2 and so on, at most {MAX_PLAYERS}: {names}, {player}_1_x_m …"
        )
        raise ConfigError(f"--states: the columns number the {player}s {sorted_numbers}; {allowed}")
    places_m = [_place(chunk, f"{player}_{number}") for number in sorted_numbers]
    return np.stack(places_m, axis=1)
