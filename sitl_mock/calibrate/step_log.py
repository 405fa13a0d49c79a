"""Read a log of velocity commands and measured velocities: CSV, or an autopilot's flight log."""

import contextlib
import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sitl_mock.calibrate.flight_log import is_flight_log, rows_of
from sitl_mock.errors import ConfigError, require_file, require_span

_TIME = "t_s"
_COMMANDS = ("cmd_n_m_s", "cmd_e_m_s", "cmd_d_m_s")
_VELOCITIES = ("vel_n_m_s", "vel_e_m_s", "vel_d_m_s")
_POSITIONS = ("pos_n_m", "pos_e_m", "pos_d_m")
COLUMNS = (_TIME, *_COMMANDS, *_VELOCITIES, *_POSITIONS)
"""Required columns, in any order; others are ignored."""

_MOST = {
    _TIME: 1e10,  # seconds since 1970 are less
    **dict.fromkeys((*_COMMANDS, *_VELOCITIES), 100.0),
    **dict.fromkeys(_POSITIONS, 100_000.0),
}
"""Greatest size of a plausible value; squares of much larger ones have no finite sum."""
_DEEPEST_M = 800.0
"""Greatest descent below the first position: the mock climbs as high first."""
_ROWS_LEAST = 10
_BEGINNING = 16
"""Bytes that tell the kind of a file."""


class FlavourName(StrEnum):
    """Autopilots with a calibrated copter."""

    PX4 = "px4"
    ARDUCOPTER = "arducopter"


@dataclass(frozen=True)
class StepLog:
    """Commands and measured motion, one row per sample.

    Attributes:
        time_s: Increasing times, shape (rows,).
        command_ned_m_s: Velocity setpoint of each row, shape (rows, 3).
        velocity_ned_m_s: Velocity reported (LOCAL_POSITION_NED), shape (rows, 3).
        position_ned_m: Position reported, shape (rows, 3).
        command_from_s: Time from which that setpoint is in force, until that of the next row, shape (rows,). A CSV file
            has it at the row; the row of a flight log may be later than its setpoint.
    """

    time_s: NDArray[np.float64]
    command_ned_m_s: NDArray[np.float64]
    velocity_ned_m_s: NDArray[np.float64]
    position_ned_m: NDArray[np.float64]
    command_from_s: NDArray[np.float64]


def read_step_log(path: Path) -> StepLog:
    """Read a log.

    Raises:
        ConfigError: The file cannot be read, a column is missing, a cell is not a finite and plausible number, time
            goes back, or the flight is too long or too deep to be flown again; the message names the file, the column
            and the row (1 is the header of a CSV file, and the first sample of the flight in a flight log).
    """
    table = _table(path)
    if len(table) < _ROWS_LEAST:
        msg = f"{path} has {len(table)} rows of data; at least {_ROWS_LEAST} are needed"
        raise ConfigError(msg)
    rows = np.array(table)
    of_flight_log = rows.shape[1] > len(COLUMNS)

    def refused(row: int, column: str, reason: str) -> ConfigError:
        number = row + (1 if of_flight_log else 2)
        return ConfigError(f"{path}, row {number}, column {column}: {reason}")

    most = np.array([_MOST[name] for name in COLUMNS])
    wrong = np.argwhere(~(np.abs(rows[:, : len(COLUMNS)]) <= most))  # NaN is wrong, too
    if wrong.size:
        row, column = wrong[0].tolist()
        limit = f"allowed are -{most[column]:g} to {most[column]:g}"
        raise refused(row, COLUMNS[column], f"{rows[row, column]:g} is not plausible; {limit}")
    back = np.flatnonzero(np.diff(rows[:, 0]) <= 0.0)
    if back.size:
        row = int(back[0]) + 1
        before = rows[row - 1, 0]
        after = rows[row, 0]
        raise refused(row, _TIME, f"{after:g} does not come after {before:g}; times must increase")
    require_span(f"{path}, column {_TIME}", float(rows[-1, 0] - rows[0, 0]))
    descent_m = rows[:, 9] - rows[0, 9]
    row = int(descent_m.argmax())
    if descent_m[row] > _DEEPEST_M:
        reason = f"{descent_m[row]:g} m below the first row; allowed are {_DEEPEST_M:g} m"
        raise refused(row, _POSITIONS[2], reason)
    command_from_s = rows[:, 10] if of_flight_log else rows[:, 0]
    return StepLog(rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7:10], command_from_s)


def _table(path: Path) -> Sequence[Sequence[float]]:
    require_file(path)
    try:
        with path.open("rb") as file:
            if is_flight_log(file.read(_BEGINNING)):
                file.seek(0)
                return rows_of(file.read(), str(path))
        with path.open(encoding="utf-8", newline="") as lines:
            reader = csv.DictReader(lines)
            header = reader.fieldnames
            missing = [name for name in COLUMNS if header is None or name not in header]
            if missing:
                msg = (
                    f"{path} lacks the column {', '.join(missing)}; needed are {', '.join(COLUMNS)}"
                )
                raise ConfigError(msg)
            return [
                [_number(path, number, name, row[name]) for name in COLUMNS]
                for number, row in enumerate(reader, start=2)
            ]
    except OSError as error:
        msg = f"{path} cannot be read: {error.strerror}"
        raise ConfigError(msg) from error
    except (UnicodeDecodeError, csv.Error) as error:
        msg = f"{path} is not a CSV file of UTF-8 text: {error}"
        raise ConfigError(msg) from error


def _number(path: Path, row: int, name: str, cell: str | None) -> float:
    value = math.nan
    with contextlib.suppress(ValueError):
        value = math.nan if cell is None else float(cell)
    if not math.isfinite(value):
        msg = f"{path}, row {row}, column {name}: {cell!r} is not a finite number"
        raise ConfigError(msg)
    return value
