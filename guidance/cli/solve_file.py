"""The states of a CSV or Parquet file, solved and written chunk by chunk: memory holds one chunk, not the file."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import csv, parquet
from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TimeRemainingColumn

from guidance.errors import ConfigError
from guidance.game import Ball, Game, Reason, Solution, Winner, solve

PURSUER = ("pursuer_x_m", "pursuer_y_m", "pursuer_z_m")
EVADER = ("evader_x_m", "evader_y_m")
TARGET = ("target_x_m", "target_y_m")
RATIO = "speed_ratio"
KINDS = (".csv", ".parquet")


def solve_file(game: Game, states: Path, out: Path | None, *, rows: int, ratio_given: bool) -> None:
    """Solve every row of a file and write the rows with their answers to another.

    Args:
        game: what is played; a column speed_ratio replaces its pursuer's speed, row by row.
        states: CSV or Parquet file of states.
        out: CSV or Parquet file to write.
        rows: rows solved and written at a time.
        ratio_given: whether the game's own speed ratio was asked for, rather than left to the column.

    Raises:
        ConfigError: a file is missing or neither CSV nor Parquet, a column is missing or holds something other than
            numbers, or the speed ratio is given twice or not at all.
    """
    if out is None or out.suffix not in KINDS:
        raise ConfigError(f"--out = {out}: must name a file that ends in {' or '.join(KINDS)}, for the answers")
    if states.suffix not in KINDS or not states.is_file():
        raise ConfigError(f"--states = {states}: must be an existing file that ends in {' or '.join(KINDS)}")
    if states.resolve() == out.resolve():
        raise ConfigError(f"--out = {out}: must not be the file of the states")
    writer: Any = None
    bar = Progress(BarColumn(), DownloadColumn(), TimeRemainingColumn(), console=Console(stderr=True), transient=True)
    try:
        with states.open("rb") as source, bar:
            task = bar.add_task("solving", total=states.stat().st_size)
            for chunk in _chunks(source, states, rows):
                answered = _answered(game, chunk, ratio_given=ratio_given)
                writer = writer or _writer(out, answered.schema)
                writer.write_table(answered)
                bar.update(task, completed=source.tell())
    except pa.ArrowInvalid as error:
        raise ConfigError(f"--states = {states}: cannot be read: {error}") from None
    finally:
        if writer is not None:
            writer.close()


def _chunks(source: Any, path: Path, rows: int) -> Iterator[pa.Table]:  # noqa: ANN401 - a binary file
    """Read a file piece by piece, no piece longer than `rows`; one without rows gives one empty piece."""
    if path.suffix == ".csv":
        numbers = dict.fromkeys((*PURSUER, *EVADER, *TARGET, RATIO), pa.float64())
        reader: Any = csv.open_csv(source, convert_options=csv.ConvertOptions(column_types=numbers))
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
    out.parent.mkdir(parents=True, exist_ok=True)
    return csv.CSVWriter(out, schema) if out.suffix == ".csv" else parquet.ParquetWriter(out, schema)


def _answered(game: Game, chunk: pa.Table, *, ratio_given: bool) -> pa.Table:
    """Append the answers to a chunk of states."""
    names = set(chunk.column_names)
    if RATIO in names and (ratio_given or not isinstance(game.pursuer, Ball)):
        raise ConfigError(f"--speed-ratio, --cylinder: must not be given, since the file has the column {RATIO}")
    if RATIO not in names and isinstance(game.pursuer, Ball) and not ratio_given:
        raise ConfigError(f"--speed-ratio, --cylinder: one must be given, since the file has no column {RATIO}")
    if RATIO in names:
        game = replace(game, pursuer=Ball(_column(chunk, RATIO) * game.evader_speed_m_s))
    with_target = bool(names & set(TARGET))
    answer = solve(
        game, _places(chunk, PURSUER), _places(chunk, EVADER), _places(chunk, TARGET) if with_target else None
    )
    for name, column in _columns(answer).items():
        if name in names:
            chunk = chunk.drop_columns([name])
        chunk = chunk.append_column(name, pa.array(column))
    return chunk


def _places(chunk: pa.Table, names: tuple[str, ...]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return positions (n, 3) from columns; z is 0 where there is no column for it."""
    places = np.zeros((chunk.num_rows, 3))
    for axis, name in enumerate(names):
        places[:, axis] = _column(chunk, name)
    return places


def _column(chunk: pa.Table, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return a column of numbers, NaN where a cell is empty."""
    if name not in chunk.column_names:
        raise ConfigError(f"--states: the column {name} is missing; it has {', '.join(chunk.column_names)}")
    column = chunk.column(name)
    if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
        raise ConfigError(f"--states: the column {name} holds {column.type}; it must hold numbers")
    numbers: np.ndarray[Any, np.dtype[np.float64]] = column.cast(pa.float64()).to_numpy()
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
    columns["winner"] = [Winner(code).name for code in answer.winner.tolist()]
    columns["reason"] = [Reason(code).name for code in answer.reason.tolist()]
    return columns
