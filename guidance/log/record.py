"""Where a flight is kept, and how it keeps the loop free: several records as one, one on a thread of its own, none.

A slow or full disk is not waited for: what finds no room is dropped and counted, and the flight goes on.
"""

import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, Protocol

from guidance.log.entries import CycleEntry
from guidance.log.writer import Recorder
from guidance.messages import EvaderReport

MOST_WAITING: Final = 4096
_LOOK_EVERY_S: Final = 0.03
"""With a chunk's age it is what a kill -9 loses: less than 0.2 s."""


class Record(Protocol):
    """Where a cycle is kept. Nothing is raised and nothing is waited for that could disturb a flight."""

    @property
    def failed(self) -> str | None:
        """Why nothing is written any more; None while all is well."""

    def frame(self, now_s: float, topic: str, frame: bytes) -> None:
        """Keep one raw MAVLink frame."""

    def cycle(self, entry: CycleEntry) -> None:
        """Keep one guidance cycle."""

    def event(self, now_s: float, event: str, detail: str = "") -> None:
        """Keep one event."""

    def report(self, report: EvaderReport) -> None:
        """Keep one report of the evader."""


class Records:
    """Several records as one. It has failed once any of them has."""

    def __init__(self, records: Sequence[Record]) -> None:
        self._records = records

    @property
    def failed(self) -> str | None:
        """Why one of them writes nothing any more; None while all is well."""
        return next((record.failed for record in self._records if record.failed is not None), None)

    def frame(self, now_s: float, topic: str, frame: bytes) -> None:
        """Keep one raw MAVLink frame."""
        for record in self._records:
            record.frame(now_s, topic, frame)

    def cycle(self, entry: CycleEntry) -> None:
        """Keep one guidance cycle."""
        for record in self._records:
            record.cycle(entry)

    def event(self, now_s: float, event: str, detail: str = "") -> None:
        """Keep one event."""
        for record in self._records:
            record.event(now_s, event, detail)

    def report(self, report: EvaderReport) -> None:
        """Keep one report of the evader."""
        for record in self._records:
            record.report(report)


class BackgroundRecorder:
    """`Record` in front of a `Recorder`. What finds no room is dropped and counted."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._waiting: deque[Callable[[], None]] = deque()
        self._stop = threading.Event()
        self.dropped = 0
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def failed(self) -> str | None:
        """Why nothing is written any more; None while all is well."""
        return self._recorder.failed

    def frame(self, now_s: float, topic: str, frame: bytes) -> None:
        """Keep one raw MAVLink frame."""
        self._put(lambda: self._recorder.frame(now_s, topic, frame))

    def cycle(self, entry: CycleEntry) -> None:
        """Keep one guidance cycle."""
        self._put(lambda: self._recorder.cycle(entry))

    def event(self, now_s: float, event: str, detail: str = "") -> None:
        """Keep one event."""
        self._put(lambda: self._recorder.event(now_s, event, detail))

    def report(self, report: EvaderReport) -> None:
        """Keep one report of the evader."""
        self._put(lambda: self._recorder.report(report))

    def close(self) -> None:
        """Write what waits and finish the file; may be called twice."""
        self._stop.set()
        self._thread.join()
        self._recorder.close()

    def _put(self, write: Callable[[], None]) -> None:
        if len(self._waiting) >= MOST_WAITING:
            self.dropped += 1
        else:
            self._waiting.append(write)

    def _run(self) -> None:
        while not self._stop.wait(_LOOK_EVERY_S):
            self._write()
        self._write()

    def _write(self) -> None:
        while self._waiting:
            write = self._waiting.popleft()
            try:
                write()
            except (OSError, ValueError, TypeError) as error:  # a row that cannot be laid out ends the record only
                self._recorder.failed = self._recorder.failed or str(error)


class NullRecorder:
    """`Record` that has failed from the start."""

    dropped = 0

    def __init__(self, reason: str) -> None:
        self.failed: str | None = reason

    def frame(self, _now_s: float, _topic: str, _frame: bytes) -> None:
        """Nothing."""

    def cycle(self, _entry: CycleEntry) -> None:
        """Nothing."""

    def event(self, _now_s: float, _event: str, _detail: str = "") -> None:
        """Nothing."""

    def report(self, _report: EvaderReport) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""
