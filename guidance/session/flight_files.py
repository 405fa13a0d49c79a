"""The files of a flight: folders, record metadata, and the settings that replay reads from the metadata."""

import contextlib
import itertools
import json
import logging
import os
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from guidance.clock import Clock
from guidance.config import parse
from guidance.errors import ConfigError
from guidance.files import private_folder, writing
from guidance.flight import FlightSettings
from guidance.log.provenance import versions
from guidance.log.reader import CONFIG, SCENARIO
from guidance.log.writer import BackgroundRecorder, NullRecorder, Recorder, started_utc
from guidance.session.log import Logger
from guidance.session.plan import plan_of
from guidance.session.vehicle_file import Config

if TYPE_CHECKING:
    from guidance.sim.scenario import Scenario

RECORD: Final = "record.mcap"
PICTURE: Final = "flight.png"
OUTCOME: Final = "outcome.json"

_SHORT: Final = {SCENARIO: {"policy": "pursuer.policy"}, CONFIG: {"policy": "game.policy"}}
"""Short forms of keys."""


def flight_metadata(scenario: "Scenario | None", config: Config | None, clock: Clock | None) -> dict[str, str]:
    """Return a record's metadata: files, seed, versions and, in real time, the start."""
    said = {} if scenario is None else {"scenario": scenario.model_dump_json(exclude_unset=config is not None)}
    said |= {} if config is None else {"config": config.model_dump_json()}
    said |= {} if scenario is None else {"seed": str(scenario.seed)}
    return {**said, **versions(), **({} if clock is None else {"started_utc": started_utc(clock.now_s())})}


@contextlib.contextmanager
def flight_folder(out: Path | None, stem: str, parent: Path = Path("flights")) -> Iterator[Path]:
    """Yield the folder of a flight: `out`, or a new one, `flights/stem-001` and so on, removed if it stays empty.

    Raises:
        OutputError: If it cannot be created.
    """
    if out is not None:
        yield out
        return
    with writing(parent):
        folder = _new_folder(private_folder(parent), stem)
    try:
        yield folder
    finally:
        with contextlib.suppress(OSError):
            folder.rmdir()


def _new_folder(parent: Path, stem: str) -> Path:
    """Create the first free folder: of two flights that begin together, each gets its own."""
    for number in itertools.count(1):
        folder = parent / f"{stem}-{number:03d}"
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
            return folder
    raise AssertionError


@contextlib.contextmanager
def recording(path: Path, metadata: Mapping[str, str], *, real_time: bool) -> Iterator[Recorder | BackgroundRecorder]:
    """Open the record. In real time a thread writes it, so a slow disk delays no cycle.

    Raises:
        ConfigError: If the folder contains another flight.
        OutputError: If it cannot be written.
    """
    for name in (RECORD, OUTCOME, PICTURE, "report.html"):
        if (path.parent / name).exists():
            raise ConfigError(f"--out {path.parent}: contains another flight ({name}); give a new folder")
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
    """Open the daemon's record. Preflight reports an unwritable one; a flight continues without it."""
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
    from guidance.sim.scenario import Scenario  # noqa: PLC0415 - a vehicle without a scenario needs no simulator

    return plan_of(config, parse(Scenario, document, source=source)).flight


def changes_of(words: Sequence[str]) -> dict[str, Any]:
    """Parse KEY=VALUE words. A value that is not TOML is text.

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
            raise ConfigError(f"--with {key}={value}: {section} is not a section; its value is {document!r}")
    document[name] = value
