"""From a file to a scenario: TOML, a recorded track beside it where it names one, and the published JSON Schema."""

import csv
import io
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter

from guidance.config import find, parse_document
from guidance.errors import ConfigError
from guidance.files import read_text
from guidance.log.entries import CYCLE
from guidance.log.reader import record_errors, scan
from guidance.sim.scenario import EVADER, PURSUER, Scenario, TrackRow
from guidance.sim.teams import TeamScenario
from guidance.toml_files import read

SCENARIO_FOLDER = "scenarios"

_COURSE_KEYS: Final = ("waypoints_m", "track")
"""Keys of a player that only its own policy may have."""


def load_scenario(name: str) -> tuple[Path, Scenario]:
    """Read a scenario by path or by the name of one that comes with the package.

    Raises:
        ConfigError: If there is none, a key is wrong, or it is one of teams.
    """
    path, scenario = load_any(name)
    if isinstance(scenario, TeamScenario):
        command = f"guidance scenario run {path} --as maths"
        raise ConfigError(f"{path}: has teams, which this command does not play: {command}")
    return path, scenario


def load_any(name: str, seed: int | None = None) -> tuple[Path, Scenario | TeamScenario]:
    """Read a scenario of two players, or one of teams, which has tables [[pursuer]] or [[evader]].

    Args:
        name: A path, or the name of one that comes with the package.
        seed: In place of the file's.

    Raises:
        ConfigError: If there is none, or a key is wrong.
    """
    path = find(name, SCENARIO_FOLDER)
    text, document = load_document(path)
    if seed is None:
        document |= {}
    else:
        document |= {"seed": seed}
    model: type[Scenario] | type[TeamScenario] = TeamScenario if has_teams(document) else Scenario
    return path, parse_document(model, document, source=str(path), text=text)


def with_policies(scenario: Scenario, **policies: str) -> Scenario:
    """Return a scenario whose players (`pursuer`, `evader`) have other policies, checked as a file's.

    A course of the policy before is left out, and so are expectations, which belong to the policies before.

    Raises:
        ConfigError: If a policy is unknown, or needs a key that the scenario does not have.
    """
    document = scenario.model_dump(mode="json", exclude_unset=True)
    document.pop("expect", None)
    for player, policy in policies.items():
        section = document[player]
        previous_policy = getattr(scenario, player).policy
        if policy != previous_policy:
            section = {key: value for key, value in section.items() if key not in _COURSE_KEYS}
        document[player] = section | {"policy": policy}
    return parse_document(Scenario, document, source=scenario.title)


def has_teams(document: Mapping[str, Any]) -> bool:
    """Say whether a scenario's document is one of teams."""
    sections = (document.get(player) for player in (PURSUER, EVADER))
    return any(isinstance(section, (list, tuple)) for section in sections)


def load_document(path: Path) -> tuple[str, dict[str, Any]]:
    """Read a scenario's text, and its keys without checking them; a track's file is read in its place.

    Raises:
        ConfigError: If a file cannot be read or is none of its kind.
    """
    text, document = read(path)
    for player in (PURSUER, EVADER):
        section = document.get(player)
        if not isinstance(section, dict):
            continue
        track_name = section.get("track")
        if isinstance(track_name, str):
            track_path = path.parent / track_name
            section["track"] = read_track(track_path, player, key=f"{path}: {player}.track")
    return text, document


def scenario_schema() -> dict[str, Any]:
    """Return the JSON Schema of a scenario file, for editors that complete and check TOML by it."""
    schema = TypeAdapter(Scenario | TeamScenario).json_schema(mode="validation")
    for section in ("Pursuer", "Evader"):
        track = schema["$defs"][section]["properties"]["track"]
        rows = {key: track.pop(key) for key in ("items", "type")}
        file_name = {"type": "string", "pattern": r"\.(csv|mcap)$"}
        track["anyOf"] = [file_name, rows]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Scenario",
        **schema,
    }


_COLUMNS: Final = ("t_s", "x_m", "y_m", "z_m")
_NAMED: Final = "t_s, x_m, y_m, and z_m where there is height"


def read_track(path: Path, player: str, *, key: str) -> list[TrackRow]:
    """Read rows of (time s, x, y, z m) in the game frame.

    Args:
        path: A .csv with the columns t_s, x_m, y_m and, where there is height, z_m; or a flight's record, .mcap.
        player: "pursuer" or "evader": whose track of a record.
        key: The key that the error names.

    Raises:
        ConfigError: If the file cannot be read, is neither, or has no such rows.
    """
    if path.suffix not in {".csv", ".mcap"}:
        allowed = f"a .csv with the columns {_NAMED} or a record, .mcap"
        raise ConfigError(f"{key} = {path.name!r}: allowed are {allowed}")
    try:
        if path.suffix == ".csv":
            rows = _from_csv(path)
        else:
            part = f"{player}_game_m"
            rows = []
            with record_errors(path):
                for item in scan(path):
                    if item.topic == CYCLE.topic:
                        row = json.loads(item.data)
                    else:
                        row = {}
                    certificate = row.get("certificate")
                    if certificate is None:
                        continue
                    now_s = row["now_s"]
                    # 50 rows a second say no more than 5
                    if rows and now_s - rows[-1][0] < 0.2 - 1e-6:
                        continue
                    x, y, z = certificate[part]
                    rows.append((float(now_s), float(x), float(y), float(z)))
    except OSError as error:
        raise ConfigError(f"{key}: {path} cannot be read ({error.strerror})") from error
    except (ValueError, KeyError, UnicodeDecodeError, ConfigError) as error:
        problem = f"{path.name} is no track: {error}"
        raise ConfigError(f"{key}: {problem}; needed are the columns {_NAMED}") from error
    if not all(all(map(math.isfinite, row)) for row in rows):
        raise ConfigError(f"{key}: {path.name} is no track: a number is not finite")
    if len(rows) < 2:
        length = f"{path.name} has {len(rows)} rows of the {player}"
        raise ConfigError(f"{key}: {length}; a track needs 2 at least")
    return rows


def _from_csv(path: Path) -> list[TrackRow]:
    """Read a track; a byte order mark, as spreadsheets write it, is skipped.

    Raises:
        ValueError: With the row (from 1, the header's) and the column that is wrong.
    """
    lines = csv.reader(io.StringIO(read_text(path), newline=""), strict=True)
    try:
        header = [name.strip() for name in next(lines, [])]
        for name in _COLUMNS[:3]:
            if name not in header:
                raise ValueError(
                    f"row 1: column {name} is missing; found {', '.join(header)[:80]!r}"
                )
        for name in _COLUMNS:
            if header.count(name) > 1:
                raise ValueError(f"row 1: column {name} is there {header.count(name)} times")
        rows = []
        for cells in filter(None, lines):
            number = lines.line_num
            if len(cells) != len(header):
                missing_value = ""
                if len(cells) < len(header):
                    missing_value = f", no value for {header[len(cells)]}"
                counts = f"{len(cells)} values for {len(header)} columns"
                raise ValueError(f"row {number}: {counts}{missing_value}")
            texts = dict(zip(header, cells, strict=True))
            t_s, x_m, y_m = (_number(texts[name], name, number) for name in _COLUMNS[:3])
            height = texts.get(_COLUMNS[3], "").strip()
            z_m = 0.0
            if height:
                z_m = _number(height, _COLUMNS[3], number)
            rows.append((t_s, x_m, y_m, z_m))
    except csv.Error as error:
        raise ValueError(f"row {lines.line_num}: {error}") from error
    return rows


def _number(text: str, column: str, row: int) -> float:
    cell = f"row {row}, column {column}: {text[:40]!r}"
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{cell} is not a number") from None
    if not math.isfinite(value):
        raise ValueError(f"{cell} is not finite")
    return value
