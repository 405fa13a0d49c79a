"""A record as a table: CSV for spreadsheets, Parquet for pandas.

One cycle is one flat row: what was known, what was decided, a unit in the name of every column.
"""

from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any, Final, NamedTuple, get_type_hints

import pyarrow as pa
from pyarrow import csv, parquet

from guidance.certificate import Certificate
from guidance.log.codec import inside
from guidance.log.entries import CycleEntry
from guidance.log.reader import cycles_of
from guidance.messages import (
    AltitudeSaid,
    Attitude,
    EvaderReport,
    GlobalPosition,
    Heartbeat,
    LocalPosition,
    Message,
    Setpoint,
    SystemStatus,
)

_AXES: Final = {"_ned": ("north", "east", "down"), "_game": ("east", "north", "up")}

_NUMBER, _WHOLE, _TEXT, _TRUTH = pa.float64(), pa.int64(), pa.string(), pa.bool_()
_KINDS: Final[Mapping[Any, pa.DataType]] = {float: _NUMBER, int: _WHOLE, str: _TEXT, bool: _TRUTH}

_HEARD: Final[tuple[tuple[type, tuple[str, ...]], ...]] = (
    (LocalPosition, ("position_ned_m", "velocity_ned_m_s")),
    (GlobalPosition, ("latitude_deg", "longitude_deg", "altitude_amsl_m", "altitude_above_home_m")),
    (Attitude, ("yaw_rad",)),
    (Heartbeat, ("custom_mode", "armed")),
    (SystemStatus, ("battery_remaining",)),
)
_REPORTED: Final = (
    "received_s",
    "sent_s",
    "source",
    "latitude_deg",
    "longitude_deg",
    "altitude_amsl_m",
    "velocity_ned_m_s",
)

_ROWS_AT_ONCE: Final = 4096


class Column(NamedTuple):
    """Where a column's value comes from: a part of a row, a field of it, and a place in that field's vector."""

    name: str
    part: str
    field: str
    place: int | None
    kind: pa.DataType


def _columns(prefix: str, part: str, kind: Any, names: tuple[str, ...]) -> Iterator[Column]:  # noqa: ANN401
    hints = get_type_hints(kind)
    for field in names:
        frame = next((frame for frame in _AXES if f"{frame}_" in field), None)
        if frame is not None:
            for place, axis in enumerate(_AXES[frame]):
                yield Column(f"{prefix}{field.replace(frame, f'_{axis}')}", part, field, place, _NUMBER)
        else:
            yield Column(f"{prefix}{field}", part, field, None, _KINDS.get(inside(hints[field]), _TEXT))


COLUMNS: Final = (
    *(column for kind, names in _HEARD for column in _columns("vehicle_", kind.__name__, kind, names)),
    *_columns("evader_", EvaderReport.__name__, EvaderReport, _REPORTED),
    *_columns("evader_said_", AltitudeSaid.__name__, AltitudeSaid, AltitudeSaid._fields),
    *_columns("setpoint_", "setpoint", Setpoint, Setpoint._fields),
    *_columns("game_", "certificate", Certificate, Certificate._fields),
)

SCHEMA: Final = pa.schema(
    [("now_s", _NUMBER), ("state", _TEXT), *((column.name, column.kind) for column in COLUMNS), ("alarm", _TEXT)]
)
"""Null where nothing was heard, sent or played."""


class LastHeard:
    """The last message of every kind and the last report, each kept until the next."""

    def __init__(self) -> None:
        self._parts: dict[str, Message | EvaderReport | AltitudeSaid | None] = {}

    def flat(self, row: CycleEntry) -> dict[str, Any]:
        """Take in one cycle and return it as column -> value.

        Raises:
            ConfigError: If the row is of another version.
        """
        inputs = row.inputs
        self._parts.update((type(message).__name__, message) for message in inputs.messages)
        for report in inputs.reports:
            self._parts |= {EvaderReport.__name__: report, AltitudeSaid.__name__: report.said}
        parts: dict[str, Any] = {**self._parts, "setpoint": row.setpoint, "certificate": row.certificate}
        values = {column.name: _value(parts.get(column.part), column) for column in COLUMNS}
        alarm = row.alarm
        return {
            "now_s": row.now_s,
            "state": row.state,
            **values,
            "alarm": None if alarm is None else alarm.words,
        }


def _value(part: Any, column: Column) -> Any:  # noqa: ANN401 - a cell
    value = None if part is None else getattr(part, column.field)
    if value is None:
        return None
    if column.place is not None:
        return value[column.place]
    return "; ".join(value) if isinstance(value, tuple) else value


def write_table(path: Path, out: Path) -> int:
    """Write a CSV, or a Parquet file where its name ends so; return how many rows. NaN and null are empty cells of CSV.

    Raises:
        ConfigError: If the record cannot be read.
        OSError: If `out` cannot be written.
    """
    count = 0
    with (parquet.ParquetWriter if out.suffix == ".parquet" else csv.CSVWriter)(out, SCHEMA) as writer:
        for batch in _batches(path):
            writer.write_batch(batch)
            count += batch.num_rows
    return count


def _batches(path: Path) -> Iterator[pa.RecordBatch]:
    heard = LastHeard()
    rows = (heard.flat(row) for row in cycles_of(path))
    while some := list(islice(rows, _ROWS_AT_ONCE)):
        yield pa.RecordBatch.from_pylist(some, schema=SCHEMA)
