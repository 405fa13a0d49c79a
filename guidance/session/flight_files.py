"""The files of a flight: its folder, record and broadcast, and the settings that replay reads from the metadata."""

import contextlib
import itertools
import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from guidance.clock import Clock
from guidance.config import parse_document
from guidance.errors import ConfigError
from guidance.files import private_folder, writing
from guidance.flight import FlightSettings
from guidance.log.entries import CONFIG, SCENARIO
from guidance.log.writer import started_utc, versions
from guidance.session.plan import TeamPlan, settings_of
from guidance.session.vehicle_file import Config

if TYPE_CHECKING:
    from guidance.sim.scenario import Scenario

RECORD: Final = "record.mcap"
PICTURE: Final = "flight.png"

TEAM_FOLDER: Final = "team"
"""Metadata of a record: the separation and the evaders of a vehicle in a team, as JSON."""

_SHORT: Final = {SCENARIO: {"policy": "pursuer.policy"}, CONFIG: {"policy": "game.policy"}}
"""Short forms of keys."""


def flight_metadata(
    scenario: "Scenario | None", config: Config | None, clock: Clock | None
) -> dict[str, str]:
    """Return a record's metadata: files, seed, versions and, in real time, the start."""
    metadata = {}
    if scenario is not None:
        metadata = {
            "scenario": scenario.model_dump_json(exclude_unset=config is not None),
            "seed": str(scenario.seed),
        }
    if config is not None:
        metadata["config"] = config.model_dump_json()
    metadata |= versions()
    if clock is not None:
        metadata["started_utc"] = started_utc(clock.now_s())
    return metadata


@contextlib.contextmanager
def flight_folder(out: Path | None, stem: str, parent: Path = Path("flights")) -> Iterator[Path]:
    """Yield the folder of a flight: `out`, or a new one such as `flights/stem-001`. An empty new one is removed.

    Raises:
        OutputError: If it cannot be created.
    """
    if out is not None:
        yield out
        return
    with writing(parent):
        private_folder(parent)
        for number in itertools.count(1):
            folder = parent / f"{stem}-{number:03d}"
            # Of two flights that begin together, each gets its own
            with contextlib.suppress(FileExistsError):
                folder.mkdir(mode=0o700)
                break
    try:
        yield folder
    finally:
        with contextlib.suppress(OSError):
            folder.rmdir()


def recorded_settings(
    metadata: Mapping[str, str], changes: Mapping[str, Any] | None = None
) -> FlightSettings:
    """Return the settings of a recorded flight, with changes.

    Args:
        metadata: Of the record, with the JSON of a mocked flight's `scenario`, a daemon's `config`, or both for a
            vehicle that flew a scenario.
        changes: Dotted key -> value.

    Raises:
        ConfigError: If the record has neither, or a changed key is unknown or out of range.
    """
    kind = next((kind for kind in (SCENARIO, CONFIG) if kind in metadata), None)
    if kind is None:
        keys = ", ".join(sorted(metadata))
        if not keys:
            keys = "nothing"
        raise ConfigError(
            f"the record's metadata has no scenario and no config, only {keys}: it cannot be replayed"
        )
    document = json.loads(metadata[kind])
    if changes is None:
        changes = {}
    for short, value in changes.items():
        # A dotted key, with the sections on its way.
        key = _SHORT[kind].get(short, short)
        section = document
        *names, last = key.split(".")
        for name in names:
            if section.get(name) is None:
                section[name] = {}
            section = section[name]
            if not isinstance(section, dict):
                raise ConfigError(
                    f"--with {key}={value}: {name} is not a section; its value is {section!r}"
                )
        section[last] = value
    source = f"the record's {kind}" + (f" with {', '.join(changes)} changed" if changes else "")
    if kind == CONFIG:
        return settings_of(parse_document(Config, document, source=source), None, None)
    config = (
        parse_document(Config, json.loads(metadata[CONFIG]), source="the record's config")
        if CONFIG in metadata
        else None
    )
    from guidance.sim.scenario import Scenario  # noqa: PLC0415 - a vehicle without a scenario needs no simulator

    team = None
    if TEAM_FOLDER in metadata:
        team = parse_document(
            TeamPlan, json.loads(metadata[TEAM_FOLDER]), source="the record's team"
        )
    return settings_of(config, parse_document(Scenario, document, source=source), team)


def changes_of(words: Sequence[str]) -> dict[str, Any]:
    """Parse KEY=VALUE words. A value that is not TOML is text.

    Raises:
        ConfigError: If a word has no equals sign.
    """
    changes = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or not key:
            raise ConfigError(
                f"--with {word}: must be KEY=VALUE, as policy=pure_pursuit or pursuer.speed_m_s=4.0"
            )
        try:
            changes[key.strip()] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            changes[key.strip()] = value
    return changes
