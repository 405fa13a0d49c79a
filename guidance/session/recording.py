"""A daemon's record on disk and its broadcast to onlookers."""

import logging

from guidance.log.entries import STOPPED
from guidance.log.writer import Record, Records
from guidance.preflight import Finding, Verdict
from guidance.session.log import Logger
from guidance.session.metrics import Metrics


class Recording:
    """The record and the broadcast of one daemon; either may be left out.

    Args:
        record: On disk.
        broadcast: To views and panels.
        required: Whether nothing flies without the record.
    """

    def __init__(self, record: Record | None, broadcast: Record | None, *, required: bool) -> None:
        self._record = record
        self._broadcast = broadcast
        self._required = required
        self._lost = False

    @property
    def kept(self) -> Records | None:
        """Destination of cycles; None if there is neither record nor broadcast."""
        kept = self._each()
        return Records(kept) if kept else None

    @property
    def words(self) -> str:
        """State of the record, for people."""
        if self._record is None:
            return "off"
        return "on" if self._record.failed is None else f"stopped: {self._record.failed}"

    def note(self, now_s: float, event: str, detail: str) -> None:
        """Record an event that is not the flight's."""
        for one in self._each():
            one.event(now_s, event, detail)

    def look(self, now_s: float, metrics: Metrics, log: Logger) -> None:
        """Report once that the record stopped."""
        if self._record is None or self._record.failed is None or self._lost:
            return
        self._lost = True
        metrics.happened(STOPPED)
        if self._broadcast is not None:
            self._broadcast.event(now_s, STOPPED, self._record.failed)
        log.say(logging.WARNING, STOPPED, reason=self._record.failed)

    def rows(self) -> tuple[Finding, ...]:
        """A refusal if a required record has failed. In flight a failed record is only reported."""
        if self._record is None or self._record.failed is None or not self._required:
            return ()
        mend = "free the disk, or have record.folder written by this user, or set record.required = false"
        return (Finding("record", self._record.failed, "written", Verdict.REFUSE, mend),)

    def _each(self) -> list[Record]:
        return [one for one in (self._record, self._broadcast) if one is not None]
