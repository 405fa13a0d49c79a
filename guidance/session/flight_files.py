"""The files of a flight: its folder, record and broadcast, and the settings that replay reads from the metadata."""

import contextlib
import itertools
import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from guidance.autopilots import Finding, Verdict
from guidance.clock import Clock, Timing
from guidance.config import parse
from guidance.errors import ConfigError
from guidance.files import private_folder, writing
from guidance.flight import Authority, FlightSettings, Inputs, Outputs
from guidance.links.wires import CapturedFrame
from guidance.log.entries import BEGUN, CONFIG, OUTCOME, SCENARIO, STOPPED, cycle_entry
from guidance.log.writer import Record, Recorder, started_utc, versions
from guidance.session.plan import TeamPlan, settings_of
from guidance.session.vehicle_file import Config

if TYPE_CHECKING:
    from guidance.sim.scenario import Scenario

RECORD: Final = "record.mcap"
PICTURE: Final = "flight.png"

TEAM: Final = "team"
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


@contextlib.contextmanager
def recording(path: Path, metadata: Mapping[str, str], *, real_time: bool) -> Iterator[Recorder]:
    """Open the record. In real time a thread writes it, so a slow disk delays no cycle.

    Raises:
        ConfigError: If the folder contains another flight.
        OutputError: If it cannot be written.
    """
    for name in (RECORD, OUTCOME, PICTURE, "report.html"):
        if (path.parent / name).exists():
            raise ConfigError(
                f"--out {path.parent}: contains another flight ({name}); give a new folder"
            )
    with writing(path.parent):
        recorder = Recorder(path, metadata, threaded=real_time)
    with contextlib.closing(recorder):
        yield recorder


def stopped_words(now_s: float, reason: str) -> str:
    """Say when and why a record ended. The flight continues."""
    return f"recording stopped at {now_s:.1f} s: {reason}"


class Recording:
    """The record and the broadcast of one vehicle; either may be left out.

    Args:
        vehicle: Its name.
        record: On disk.
        broadcast: To views and panels.
        required: Whether nothing flies without the record.

    Attributes:
        begun: Whether a cycle of the present flight was kept; False begins another flight.
        stopped: Time and reason of the record's end, in words; empty before it.
    """

    def __init__(
        self,
        vehicle: str,
        record: Record | None,
        broadcast: Record | None,
        *,
        required: bool = False,
    ) -> None:
        self._vehicle = vehicle
        self._record = record
        self._required = required
        self.begun = False
        self._each = [sink for sink in (record, broadcast) if sink is not None]
        self.stopped = ""

    def cycle(
        self, now_s: float, inputs: Inputs, outputs: Outputs, timing: Timing | None
    ) -> str | None:
        """Keep a cycle with its events; return the reason once, when the record stops."""
        if not self._each:
            return None
        if not self.begun:
            self.begun = True
            self.event(now_s, BEGUN)
        entry = cycle_entry(now_s, inputs, outputs, timing, self._vehicle)
        for sink in self._each:
            sink.cycle(entry)
        for happening in outputs.happenings:
            cause = happening.detail
            if happening.by is not Authority.FLIGHT:
                cause = f"by {happening.by}"
            details = (f"{happening.before} -> {happening.after}", cause)
            self.event(happening.now_s, str(happening.event), ": ".join(filter(None, details)))
        if outputs.alarm is not None:
            self.event(now_s, str(outputs.alarm.violation), outputs.alarm.by)
        failed = None if self._record is None else self._record.failed
        if failed is None or self.stopped:
            return None
        self.stopped = stopped_words(now_s, failed)
        self.event(now_s, STOPPED, failed)
        return failed

    def event(self, now_s: float, event: str, detail: str = "") -> None:
        """Keep an event."""
        for sink in self._each:
            sink.event(now_s, event, detail)

    def frames(self, passed: Sequence[CapturedFrame]) -> None:
        """Keep raw frames; a broadcast has none."""
        if self._record is not None:
            self._record.frames(passed)

    @property
    def words(self) -> str:
        """State of the record, for people."""
        if self._record is None:
            return "off"
        return "on" if self._record.failed is None else f"stopped: {self._record.failed}"

    def rows(self) -> tuple[Finding, ...]:
        """A refusal if a required record has failed. In flight a failed record is only reported."""
        if self._record is None or self._record.failed is None or not self._required:
            return ()
        mend = "free the disk, or have record.folder written by this user, or set record.required = false"
        return (Finding("record", self._record.failed, "written", Verdict.REFUSE, mend),)


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
        _change(document, _SHORT[kind].get(short, short), value)
    source = f"the record's {kind}" + (f" with {', '.join(changes)} changed" if changes else "")
    if kind == CONFIG:
        return settings_of(parse(Config, document, source=source), None, None)
    config = (
        parse(Config, json.loads(metadata[CONFIG]), source="the record's config")
        if CONFIG in metadata
        else None
    )
    from guidance.sim.scenario import Scenario  # noqa: PLC0415 - a vehicle without a scenario needs no simulator

    team = None
    if TEAM in metadata:
        team = parse(TeamPlan, json.loads(metadata[TEAM]), source="the record's team")
    return settings_of(config, parse(Scenario, document, source=source), team)


def _change(document: dict[str, Any], key: str, value: object) -> None:
    """Set a dotted key of a document, with the sections on its way."""
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
