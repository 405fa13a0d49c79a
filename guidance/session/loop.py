"""The real-time loop: fifty times a second, signals heard in between, frames and garbage kept for the gaps.

The cycles keep a grid of their own, which is moved along by a little (`nudge_s`) so that they begin just after the
vehicle's position arrives: a setpoint then rests on what is 2 ms old, and not on what is half a period old on average.
"""

import math
import signal
import sys
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Final

from guidance.clock import Clock
from guidance.flight import Event
from guidance.links.wires.shared import Passed
from guidance.log.writer import Record
from guidance.session.daemon import Daemon
from guidance.session.gc_scheduler import GcScheduler
from guidance.session.metrics import Metrics
from guidance.session.spec import FlightPlan

PERIOD_S: Final = 0.02
AGE_S: Final = 0.002
"""How old the vehicle's position is to be when a cycle begins: later than it may come, and no more."""

MOST_NUDGE_S: Final = 0.0002
_NUDGE_SHARE: Final = 0.05
_CLOSE_S: Final = 0.0005


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
    load: Callable[[], FlightPlan],
    drain: Callable[[], Sequence[Passed]],
    record: Record | None,
    tidying: GcScheduler,
    watch: Callable[[float], None] = lambda _: None,
) -> None:
    """Run the daemon until it has finished. After every cycle `watch` is told the time of it."""
    signals.begin()
    due_s = clock.now_s()
    tidying.begin(due_s)
    worked_s = 0.0
    while not daemon.finished:
        clock.sleep_until(due_s)
        now_s = clock.now_s()
        ends, again = signals.take()
        for _ in range(ends):
            daemon.leave(on_terminate, now_s)
        if again:
            daemon.exchange(load, now_s)
        try:
            daemon.step(now_s, late_s=now_s - due_s, worked_s=worked_s)
        except Exception as error:  # the last catch: nobody else flies this vehicle
            daemon.survive(error, now_s)
        watch(now_s)
        if record is not None:
            for passed in drain():
                record.frame(*passed)
        done_s = clock.now_s()
        worked_s = done_s - now_s
        metrics.work.observe(worked_s)
        due_s, missed = next_due(due_s, done_s)
        due_s += nudge_s(daemon.position_age_s)
        metrics.late.inc(missed)
        tidying.between(done_s, due_s - done_s)
    tidying.end()


def nudge_s(age_s: float) -> float:
    """Return how much later the next cycle is due than the grid has it, for the age of the position at this one.

    Where positions come at the loop's own rate, this settles with each at `AGE_S`; at another rate the ages go round
    and so do the nudges, which come to nothing. Without positions there is nothing to go by.
    """
    if not age_s < 2.0 * PERIOD_S:
        return 0.0
    # Late by less than half a period is mended by being earlier, by more by being later.
    late_s = math.remainder(age_s - AGE_S, PERIOD_S)
    if abs(late_s) < _CLOSE_S:
        return 0.0
    return max(-MOST_NUDGE_S, min(MOST_NUDGE_S, -_NUDGE_SHARE * late_s))


def next_due(due_s: float, done_s: float) -> tuple[float, int]:
    """Return the next moment of the grid that is still to come, and how many were missed: none is made up for."""
    missed = max(0, int((done_s - due_s) // PERIOD_S))
    return due_s + (missed + 1) * PERIOD_S, missed
