"""The files of a flight: its folder, record and broadcast, and the settings that replay reads from the metadata."""

import contextlib
import itertools
import json
import logging
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from guidance.autopilots import Finding, Verdict
from guidance.clock import Clock, Timing
from guidance.config import parse
from guidance.errors import ConfigError
from guidance.files import private_folder, writing
from guidance.flight import Authority, Flight, FlightSettings, Inputs, Outputs
from guidance.links.wires import CapturedFrame
from guidance.log.entries import BEGUN, CONFIG, OUTCOME, SCENARIO, STOPPED, cycle_entry
from guidance.log.sink import AnsweredOrder, FlightIdentity, Report, Sink
from guidance.log.writer import Record, Recorder, started_utc, versions
from guidance.session.plan import TeamPlan, settings_of
from guidance.session.vehicle_file import Config

if TYPE_CHECKING:
    from guidance.sim.scenario import Scenario

RECORD: Final = "record.mcap"
PICTURE: Final = "flight.png"

TEAM: Final = "team"
"""Metadata of a record: the separation and the evaders of a vehicle in a team, as JSON."""

OUTPUT_FAILED: Final = "an output has failed and is told nothing more; the flight goes on"

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
    """Everything that is told of a vehicle's flight: its record, and any number of other outputs.

    Args:
        vehicle: Its name.
        record: On disk; None keeps none.
        sinks: The other outputs.
        required: Whether nothing flies without the record.

    Attributes:
        stopped: Time and reason of the record's end, in words; empty before it.
    """

    def __init__(
        self,
        vehicle: str,
        record: Record | None = None,
        sinks: Sequence[Sink] = (),
        *,
        required: bool = False,
    ) -> None:
        self._vehicle = vehicle
        self._record = record
        self._required = required
        self._begun = False
        self._orders = list[AnsweredOrder]()
        self._sinks = [*sinks] if record is None else [record, *sinks]
        self.stopped = ""

    def begin(self, identity: FlightIdentity) -> None:
        """Begin another flight with the next cycle."""
        self._begun = False
        self._tell(lambda sink: sink.begin(identity))

    def cycle(self, now_s: float, inputs: Inputs, outputs: Outputs, timing: Timing | None) -> None:
        """Tell of a cycle with its events, and once why the record has stopped."""
        if not self._sinks:
            return
        if not self._begun:
            self._begun = True
            self.event(now_s, BEGUN)
        entry = cycle_entry(now_s, inputs, outputs, timing, self._vehicle)
        self._tell(lambda sink: sink.cycle(entry))
        for happening in outputs.happenings:
            cause = happening.detail
            if happening.by is not Authority.FLIGHT:
                cause = f"by {happening.by}"
            details = (f"{happening.before} -> {happening.after}", cause)
            self.event(happening.now_s, str(happening.event), ": ".join(filter(None, details)))
        if outputs.alarm is not None:
            self.event(now_s, str(outputs.alarm.violation), outputs.alarm.by)
        failed = None if self._record is None else self._record.failed
        if failed is not None and not self.stopped:
            self.stopped = stopped_words(now_s, failed)
            self.event(now_s, STOPPED, failed)
            self.say(logging.WARNING, STOPPED, reason=failed)

    def event(self, now_s: float, event: str, detail: str = "") -> None:
        """Tell of an event."""
        self._tell(lambda sink: sink.event(now_s, event, detail))

    def frames(self, passed: Sequence[CapturedFrame]) -> None:
        """Tell of raw frames."""
        self._tell(lambda sink: sink.frames(passed))

    def ordered(self, order: AnsweredOrder) -> None:
        """Keep an answered order for the next report."""
        if self._sinks:
            self._orders.append(order)

    def report(
        self,
        now_s: float,
        flight: Flight,
        outputs: Outputs,
        timing: Timing | None,
        counters: Mapping[str, Mapping[str, int]] | None,
    ) -> None:
        """Tell of the end of a cycle; the arguments are those of `Report`."""
        if not self._sinks:
            return
        report = Report(now_s, flight, outputs, timing, tuple(self._orders), counters)
        self._orders.clear()
        self._tell(lambda sink: sink.report(report))

    def say(self, level: int, message: str, **fields: Any) -> None:  # noqa: ANN401 - any value may be logged
        """Say something to people; `level` is as in `logging`."""
        self._tell(lambda sink: sink.say(level, message, fields))

    def worked(self, work_s: float, missed: int) -> None:
        """Tell of the working time of a cycle, s, and of how many cycles it made late."""
        self._tell(lambda sink: sink.worked(work_s, missed))

    def over(self, now_s: float, detail: str) -> None:
        """Tell how the flight ended."""
        self._tell(lambda sink: sink.over(now_s, detail))

    def _tell(self, tell: Callable[[Sink], None]) -> None:
        for sink in tuple(self._sinks):
            try:
                tell(sink)
            except Exception as error:  # an output of any kind must not end the flight
                self._give_up(sink, error)

    def _give_up(self, sink: Sink, error: Exception) -> None:
        """Tell an output that raised nothing more, and say so to the others."""
        self._sinks.remove(sink)
        reason = f"{type(error).__name__}: {error}"
        if sink is self._record:
            self._record.failed = reason
        self.say(logging.WARNING, OUTPUT_FAILED, output=type(sink).__name__, error=reason)

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
