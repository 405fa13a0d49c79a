"""The real-time loop: fifty times a second on the clock's grid, signals heard in between, frames kept behind."""

import signal
import sys
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Final

from guidance.flight import Event
from guidance.links.tap import Passed
from guidance.service.clock import Clock
from guidance.service.daemon import Daemon, Plan
from guidance.service.metrics import Metrics
from guidance.service.record import Record

PERIOD_S: Final = 0.02


class Signals:
    """What the operating system asked for, noted by handlers and acted on by the loop."""

    def __init__(self) -> None:
        self._end = 0
        self._again = False
        self._looping = False

    def install(self) -> None:
        """Take SIGTERM, SIGINT and SIGHUP."""
        signal.signal(signal.SIGTERM, self._note)
        signal.signal(signal.SIGINT, self._note)
        signal.signal(signal.SIGHUP, self._note)

    def begin(self) -> None:
        """The loop begins, and is the one to act from now on. Before, nothing is to be handed over: an end is one."""
        self._looping = True

    def _note(self, number: int, _: FrameType | None) -> None:
        if number == signal.SIGHUP:
            self._again = True
        elif self._looping:
            self._end += 1
        else:
            sys.exit(0)

    def take(self) -> tuple[int, bool]:
        """How often an end was asked for, and whether the configuration is to be read again, since the last call."""
        taken = self._end, self._again
        self._end, self._again = 0, False
        return taken


def run(
    daemon: Daemon,
    clock: Clock,
    *,
    signals: Signals,
    metrics: Metrics,
    on_terminate: Event,
    load: Callable[[], Plan],
    drain: Callable[[], Sequence[Passed]],
    record: Record | None,
) -> None:
    """Run the daemon until it has finished."""
    signals.begin()
    due_s = clock.now_s()
    worked_s = 0.0
    while not daemon.finished:
        clock.sleep_until(due_s)
        now_s = clock.now_s()
        ends, again = signals.take()
        for _ in range(ends):
            daemon.leave(on_terminate, now_s)
        if again:
            daemon.exchange(load, now_s)
        daemon.step(now_s, late_s=now_s - due_s, worked_s=worked_s)
        if record is not None:
            for passed in drain():
                record.frame(*passed)
        done_s = clock.now_s()
        worked_s = done_s - now_s
        metrics.work.observe(worked_s)
        due_s, missed = next_due(due_s, done_s)
        metrics.late.inc(missed)


def next_due(due_s: float, done_s: float) -> tuple[float, int]:
    """Return the next moment of the grid that is still to come, and how many were missed: none is made up for."""
    missed = max(0, int((done_s - due_s) // PERIOD_S))
    return due_s + (missed + 1) * PERIOD_S, missed
