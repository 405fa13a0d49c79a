"""The record of a flight, and its other outputs beside it."""

import contextlib
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from guidance.autopilots import Finding, Verdict
from guidance.clock import Timing
from guidance.errors import ConfigError
from guidance.files import writing
from guidance.flight import Authority, Flight, Inputs, Outputs
from guidance.links.wires.base import CapturedFrame
from guidance.log.entries import BEGUN, OUTCOME, STOPPED, cycle_entry
from guidance.log.sink import AnsweredOrder, FlightIdentity, Report, Sink
from guidance.log.writer import Record, Recorder
from guidance.session.flight_files import PICTURE, RECORD

OUTPUT_FAILED: Final = "an output has failed and is told nothing more; the flight goes on"


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
    """The outputs of a vehicle's flight: its record, and any number of others.

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
        for transition in outputs.transitions:
            cause = transition.detail
            if transition.by is not Authority.FLIGHT:
                cause = f"by {transition.by}"
            details = (f"{transition.before} -> {transition.after}", cause)
            self.event(transition.now_s, str(transition.event), ": ".join(filter(None, details)))
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
                # Drop an output that raised, and report it to the others.
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
        remedy = "free the disk, or have record.folder written by this user, or set record.required = false"
        return (Finding("record", self._record.failed, "written", Verdict.REFUSE, remedy),)
