"""From a file to a scenario: TOML, a recorded track beside it where it names one, and the published JSON Schema."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from guidance.config import find, parse
from guidance.errors import ConfigError
from guidance.sim.scenario import Scenario
from guidance.sim.teams import TeamScenario
from guidance.sim.tracks import read_track

FOLDER = "scenarios"
PLAYERS = ("pursuer", "evader")


def load_scenario(name: str) -> tuple[Path, Scenario]:
    """Read a scenario by path or by the name of one that comes with the package.

    Raises:
        ConfigError: If there is none, a key is wrong, or it is one of teams.
    """
    path, scenario = load_any(name)
    if isinstance(scenario, TeamScenario):
        raise ConfigError(
            f"{path}: has teams, which only mathematics plays yet: guidance scenario run {path} --as maths"
        )
    return path, scenario


def load_any(name: str) -> tuple[Path, Scenario | TeamScenario]:
    """Read a scenario of two players, or one of teams, which has tables [[pursuer]] or [[evader]].

    Raises:
        ConfigError: If there is none, or a key is wrong.
    """
    path = find(name, FOLDER)
    document = load_document(path)
    if has_teams(document):
        return path, parse(TeamScenario, document, source=str(path))
    return path, parse(Scenario, document, source=str(path))


def has_teams(document: Mapping[str, Any]) -> bool:
    """Say whether a scenario's document is one of teams."""
    return any(isinstance(document.get(player), (list, tuple)) for player in PLAYERS)


def load_document(path: Path) -> dict[str, Any]:
    """Read a scenario's keys without checking them; a track's file is read in its place.

    Raises:
        ConfigError: If a file cannot be read or is none of its kind.
    """
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error
    for player in PLAYERS:
        section = document.get(player)
        if isinstance(section, dict) and isinstance(section.get("track"), str):
            section["track"] = read_track(path.parent / section["track"], player, key=f"{path}: {player}.track")
    return document


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a scenario file, for editors that complete and check TOML by it."""
    schema = TypeAdapter(Scenario | TeamScenario).json_schema(mode="validation")
    for section in ("Pursuer", "Evader"):
        track = schema["$defs"][section]["properties"]["track"]
        rows = {key: track.pop(key) for key in ("items", "type")}
        track["anyOf"] = [{"type": "string", "pattern": r"\.(csv|mcap)$"}, rows]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "Scenario", **schema}
