"""Exports a record as a table, CSV or Parquet: one row per cycle, with units in the column names."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any, Final, get_type_hints

import pyarrow as pa
from pyarrow import csv, parquet

from guidance.certificate import Certificate
from guidance.log.codec import inside
from guidance.log.reader import cycles_of
from guidance.messages import (
    AltitudeSaid,
    Attitude,
    EvaderReport,
    GlobalPosition,
    Heartbeat,
    LocalPosition,
    Setpoint,
    SystemStatus,
)

_AXES: Final = {"_ned": ("north", "east", "down"), "_game": ("east", "north", "up")}
_TYPES: Final = {float: pa.float64(), int: pa.int64(), str: pa.string(), bool: pa.bool_()}
_ROWS_AT_ONCE: Final = 4096

_EVADER: Final = "received_s sent_s source latitude_deg longitude_deg altitude_amsl_m velocity_ned_m_s"
_EXPORTED: Final[tuple[tuple[str, type, str], ...]] = (
    ("vehicle_", LocalPosition, "position_ned_m velocity_ned_m_s"),
    ("vehicle_", GlobalPosition, "latitude_deg longitude_deg altitude_amsl_m altitude_above_home_m"),
    ("vehicle_", Attitude, "yaw_rad"),
    ("vehicle_", Heartbeat, "custom_mode armed"),
    ("vehicle_", SystemStatus, "battery_remaining"),
    ("evader_", EvaderReport, _EVADER),
    ("evader_said_", AltitudeSaid, " ".join(AltitudeSaid._fields)),
    ("setpoint_", Setpoint, " ".join(Setpoint._fields)),
    ("game_", Certificate, " ".join(Certificate._fields)),
)
"""Column prefix, type of the message, and its exported fields."""


def _columns(prefix: str, kind: type, field: str) -> list[tuple[str, pa.DataType]]:
    """Return the columns of a field: three for a vector, named by its axes."""
    for frame, axes in _AXES.items():
        if f"{frame}_" in field:
            return [(f"{prefix}{field.replace(frame, f'_{axis}')}", pa.float64()) for axis in axes]
    return [(f"{prefix}{field}", _TYPES.get(inside(get_type_hints(kind)[field]), pa.string()))]


_FIELDS: Final = [
    (kind, field, _columns(prefix, kind, field)) for prefix, kind, names in _EXPORTED for field in names.split()
]
SCHEMA: Final = pa.schema(
    [
        ("now_s", pa.float64()),
        ("state", pa.string()),
        *(column for _, _, columns in _FIELDS for column in columns),
        ("alarm", pa.string()),
    ]
)
"""Null before the first message, and in cycles without setpoint or game."""


def write_table(path: Path, out: Path) -> int:
    """Write Parquet if `out` ends in .parquet, else CSV with empty cells for NaN and null; return the number of rows.

    Raises:
        ConfigError: If the record cannot be read.
        OSError: If `out` cannot be written.
    """
    rows, count = _rows(path), 0
    with (parquet.ParquetWriter if out.suffix == ".parquet" else csv.CSVWriter)(out, SCHEMA) as writer:
        while some := list(islice(rows, _ROWS_AT_ONCE)):
            writer.write_batch(pa.RecordBatch.from_pylist(some, schema=SCHEMA))
            count += len(some)
    return count


def _rows(path: Path) -> Iterator[dict[str, Any]]:
    """Yield column -> value for each cycle; a message keeps its value until the next of its type."""
    latest: dict[type, Any] = {}
    for row in cycles_of(path):
        latest |= {type(message): message for message in row.inputs.messages}
        for report in row.inputs.reports:
            latest |= {EvaderReport: report, AltitudeSaid: report.said}
        latest |= {Setpoint: row.setpoint, Certificate: row.certificate}
        cells = {"now_s": row.now_s, "state": row.state, "alarm": None if row.alarm is None else row.alarm.words}
        for kind, field, columns in _FIELDS:
            value = getattr(latest.get(kind), field, None)
            if len(columns) > 1:
                cells |= {name: place for (name, _), place in zip(columns, value or (None,) * 3, strict=True)}
            else:
                cells[columns[0][0]] = "; ".join(value) if isinstance(value, tuple) else value
        yield cells
