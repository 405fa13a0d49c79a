"""A daemon's record on disk and its broadcast to onlookers."""

from collections.abc import Iterable
from typing import NamedTuple

from guidance.clock import Timing
from guidance.flight import Authority, Inputs, Outputs
from guidance.links.wires.shared import CapturedFrame
from guidance.log.entries import BEGUN, STOPPED, cycle_entry
from guidance.log.writer import Record
from guidance.preflight import Finding, Verdict


class Stopped(NamedTuple):
    """When and why the record stopped. The flight goes on."""

    now_s: float
    reason: str


class Recording:
    """The record and the broadcast of one vehicle; either may be left out.

    Args:
        vehicle: Its name.
        record: On disk.
        broadcast: To views and panels.
        required: Whether nothing flies without the record.

    Attributes:
        stopped: When and why the record stopped; None while it goes on.
    """

    def __init__(
        self, vehicle: str, record: Record | None, broadcast: Record | None = None, *, required: bool = False
    ) -> None:
        self._vehicle = vehicle
        self._record = record
        self._each = [one for one in (record, broadcast) if one is not None]
        self._required = required
        self._begun = False
        self.stopped: Stopped | None = None

    def begin(self) -> None:
        """The next cycle is the first of another flight."""
        self._begun = False

    def cycle(self, inputs: Inputs, outputs: Outputs, timing: Timing | None) -> Stopped | None:
        """Keep a cycle with its events; at the one at which the record stops, return why."""
        if not self._each:
            return None
        now_s = inputs.now_s
        if not self._begun:
            self._begun = True
            self.event(now_s, BEGUN)
        entry = cycle_entry(inputs, outputs, timing, self._vehicle)
        for one in self._each:
            one.cycle(entry)
        for happening in outputs.happenings:
            by = "" if happening.by is Authority.FLIGHT else f"by {happening.by}"
            details = (f"{happening.before} -> {happening.after}", by or happening.detail)
            self.event(happening.now_s, str(happening.event), ": ".join(filter(None, details)))
        if outputs.alarm is not None:
            self.event(now_s, str(outputs.alarm.violation), outputs.alarm.by)
        return self._stops(now_s)

    def _stops(self, now_s: float) -> Stopped | None:
        if self._record is None or self._record.failed is None or self.stopped is not None:
            return None
        self.stopped = Stopped(now_s, self._record.failed)
        self.event(now_s, STOPPED, self._record.failed)
        return self.stopped

    def event(self, now_s: float, event: str, detail: str = "") -> None:
        """Keep an event."""
        for one in self._each:
            one.event(now_s, event, detail)

    def frames(self, passed: Iterable[CapturedFrame]) -> None:
        """Keep raw frames; a broadcast has none."""
        if self._record is not None:
            for frame in passed:
                self._record.frame(*frame)

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
