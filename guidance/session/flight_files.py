"""The files of a flight: where they go, what its record says of it, and the settings that are read back from there.

The settings are those that it was flown with, as the metadata has them, or the same with some of them changed.
"""

import contextlib
import itertools
import json
import logging
import os
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from guidance.clock import Clock
from guidance.config import parse
from guidance.errors import ConfigError
from guidance.files import writing
from guidance.flight import FlightSettings
from guidance.log.provenance import versions
from guidance.log.reader import CONFIG, SCENARIO
from guidance.log.writer import BackgroundRecorder, NullRecorder, Recorder, started_utc
from guidance.session.log import Logger
from guidance.session.plan import plan_of
from guidance.session.vehicle_file import Config
from guidance.sim.scenario import Scenario

RECORD: Final = "record.mcap"
PICTURE: Final = "flight.png"
OUTCOME: Final = "outcome.json"

_SHORT: Final = {SCENARIO: {"policy": "pursuer.policy"}, CONFIG: {"policy": "game.policy"}}
"""What people say for the longer key."""


def flight_metadata(scenario: Scenario | None, config: Config | None, clock: Clock | None) -> dict[str, str]:
    """Return what a record says of its flight: files, seed, versions and, where time is real, when it began."""
    said = {} if scenario is None else {"scenario": scenario.model_dump_json(exclude_unset=config is not None)}
    said |= {} if config is None else {"config": config.model_dump_json()}
    said |= {} if scenario is None else {"seed": str(scenario.seed)}
    return {**said, **versions(), **({} if clock is None else {"started_utc": started_utc(clock.now_s())})}


def next_folder(parent: Path, stem: str) -> Path:
    """Return the first of `parent/stem-001`, `-002`, … that is not there yet."""
    return next(folder for number in itertools.count(1) if not (folder := parent / f"{stem}-{number:03d}").exists())


def refuse_another_flight(folder: Path) -> None:
    """Refuse a folder in which another flight lies, whole or in part: nothing of it is overwritten or mixed with ours.

    Raises:
        ConfigError: With what is there.
    """
    for name in (RECORD, OUTCOME, PICTURE, "report.html"):
        if (folder / name).exists():
            raise ConfigError(f"--out {folder}: another flight lies there ({name}), which stays; give a new folder")


@contextlib.contextmanager
def recording(path: Path, metadata: Mapping[str, str], *, real_time: bool) -> Iterator[Recorder | BackgroundRecorder]:
    """Open the record. In real time it is written from a thread of its own: a slow disk holds up no cycle.

    Raises:
        ConfigError: If another flight lies there.
        OutputError: If it cannot be written.
    """
    refuse_another_flight(path.parent)
    with writing(path.parent):
        written = Recorder(path, metadata)
    recorder = BackgroundRecorder(written) if real_time else written
    try:
        yield recorder
    finally:
        recorder.close()


@contextlib.contextmanager
def daemon_recording(
    config: Config, metadata: Mapping[str, str], log: Logger
) -> Iterator[BackgroundRecorder | NullRecorder | None]:
    """Open the record of a daemon. Of one that cannot be written preflight says so; in flight it is done without."""
    if config.record.folder is None:
        yield None
        return
    stamp = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())
    path = config.record.folder / f"{config.name}-{stamp}-{os.getpid()}.mcap"
    recorder: BackgroundRecorder | NullRecorder
    try:
        rotate_bytes = round(config.record.rotate_mb * 1e6)
        written = Recorder(path, metadata, rotate_s=config.record.rotate_s, rotate_bytes=rotate_bytes)
        recorder = BackgroundRecorder(written)
    except OSError as error:
        where = f"record.folder = {str(config.record.folder)!r}"
        recorder = NullRecorder(f"{where}: cannot be written ({error.strerror})")
    try:
        yield recorder
    finally:
        recorder.close()
        if recorder.failed is not None or recorder.dropped:
            log.say(logging.WARNING, "the record is incomplete", failed=recorder.failed, dropped=recorder.dropped)


def recorded_settings(metadata: Mapping[str, str], changes: Mapping[str, Any] | None = None) -> FlightSettings:
    """Return the settings of the recorded flight, changed.

    Args:
        metadata: Of the record; holds a mocked flight's `scenario`, a daemon's `config`, or both where a vehicle flew
            a scenario, as JSON.
        changes: Dotted key -> value.

    Raises:
        ConfigError: If the record has neither, or a changed key does not exist or is out of range.
    """
    kind = next((kind for kind in (SCENARIO, CONFIG) if kind in metadata), None)
    if kind is None:
        known = ", ".join(sorted(metadata)) or "nothing"
        raise ConfigError(f"the record's metadata has no scenario and no config, only {known}: it cannot be replayed")
    document = json.loads(metadata[kind])
    changes = changes or {}
    for key, value in changes.items():
        _set(document, _SHORT[kind].get(key, key), value)
    source = f"the record's {kind}" + (f" with {', '.join(changes)} changed" if changes else "")
    if kind == CONFIG:
        return plan_of(parse(Config, document, source=source)).flight
    config = None
    if CONFIG in metadata:
        config = parse(Config, json.loads(metadata[CONFIG]), source="the record's config")
    return plan_of(config, parse(Scenario, document, source=source)).flight


def changes_of(words: Sequence[str]) -> dict[str, Any]:
    """Read KEY=VALUE words; a value is TOML where it can be, else text.

    Raises:
        ConfigError: If a word has no equals sign.
    """
    changes = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or not key:
            raise ConfigError(f"--with {word}: must be KEY=VALUE, as policy=pure_pursuit or pursuer.speed_m_s=4.0")
        try:
            changes[key.strip()] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            changes[key.strip()] = value
    return changes


def _set(document: dict[str, Any], key: str, value: Any) -> None:  # noqa: ANN401 - whatever TOML holds
    *sections, name = key.split(".")
    for section in sections:
        if document.get(section) is None:
            document[section] = {}
        document = document[section]
        if not isinstance(document, dict):
            raise ConfigError(f"--with {key}={value}: {section} is no section; its value is {document!r}")
    document[name] = value
