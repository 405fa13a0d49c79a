"""Recorded tracks for a player to follow: a CSV of times and places, or what a flight's record says of that player."""

import csv
import json
import math
from pathlib import Path
from typing import Final

from mcap.exceptions import McapError
from mcap.reader import make_reader

from guidance.errors import ConfigError
from guidance.log.entries import CYCLE_TOPIC

_COLUMNS: Final = ("t_s", "x_m", "y_m", "z_m")
_LEAST_STEP_S: Final = 0.2
"""Rows of a flight's record closer than this are left out: 50 rows a second say no more than 5."""

Rows = list[tuple[float, float, float, float]]


def read_track(path: Path, player: str, *, key: str) -> Rows:
    """Read rows of (time s, x, y, z m) in the game frame.

    Args:
        path: A .csv with the columns t_s, x_m, y_m and, where there is height, z_m; or a flight's record, .mcap.
        player: "pursuer" or "evader": whose track of a record.
        key: What the error names.

    Raises:
        ConfigError: If the file cannot be read, is neither, or has no such rows.
    """
    try:
        if path.suffix == ".csv":
            rows = _from_csv(path)
        elif path.suffix == ".mcap":
            rows = _from_record(path, f"{player}_game_m")
        else:
            raise ConfigError(
                f"{key} = {path.name!r}: allowed are a .csv with the columns {_named()} or a record, .mcap"
            )
    except OSError as error:
        raise ConfigError(f"{key}: {path} cannot be read ({error.strerror})") from error
    except (ValueError, KeyError, McapError, UnicodeDecodeError) as error:
        raise ConfigError(f"{key}: {path.name} is no track: {error}; needed are the columns {_named()}") from error
    if len(rows) < 2:
        raise ConfigError(f"{key}: {path.name} has {len(rows)} rows of the {player}; a track needs 2 at least")
    return rows


def _from_csv(path: Path) -> Rows:
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        missing = [name for name in _COLUMNS[:3] if name not in (reader.fieldnames or [])]
        if missing:
            raise ValueError(f"column {missing[0]} is missing")
        rows = [
            (float(row["t_s"]), float(row["x_m"]), float(row["y_m"]), float(row.get("z_m") or 0.0)) for row in reader
        ]
    if not all(math.isfinite(number) for row in rows for number in row):
        raise ValueError("a number is not finite")
    return rows


def _from_record(path: Path, part: str) -> Rows:
    rows: Rows = []
    with path.open("rb") as file:
        for _, _, message in make_reader(file).iter_messages(topics=[CYCLE_TOPIC]):
            row = json.loads(message.data)
            certificate = row.get("certificate")
            if certificate is None or (rows and row["now_s"] - rows[-1][0] < _LEAST_STEP_S - 1e-6):
                continue
            x, y, z = certificate[part]
            rows.append((float(row["now_s"]), float(x), float(y), float(z)))
    return rows


def _named() -> str:
    return ", ".join(_COLUMNS)
