"""A recorder on a thread of its own: a slow or full disk is the record's trouble, never the loop's."""

import threading
from collections import deque
from collections.abc import Callable
from typing import Final

from guidance.log.entries import CycleEntry
from guidance.log.writer import Recorder
from guidance.messages import EvaderReport

MOST_WAITING: Final = 4096
_LOOK_EVERY_S: Final = 0.03
"""With a chunk's age it is what a kill -9 loses: less than 0.2 s."""


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
