"""The loop of every flight: 50 cycles a second, with signals, the record's frames and garbage collection between them.

It runs in three worlds: a mock stepped in this process with a virtual clock (`guidance.sim.stepped`), a mock as a child
process in real time (`guidance.sim.live`), and a vehicle that runs elsewhere (`guidance.session.service`).

In real time the cycles are shifted slowly (`nudge_s`) until each begins just after a position of the vehicle arrives.
A setpoint then uses a position that is 2 ms old; without the shift it would be half a period old on average.

A flight in real time raises the priority of every thread (`claim`). Any thread may hold the interpreter's lock, and if
a busy machine takes the processor from it, the loop waits.
"""

import contextlib
import gc
import math
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Final, NoReturn, Self

from guidance.clock import Clock, Timing
from guidance.errors import ConfigError
from guidance.flight import Event
from guidance.links.world import World
from guidance.messages import LocalPosition
from guidance.session.fly.daemon import Daemon
from guidance.session.plan import FlightPlan

PERIOD_S: Final = 0.02
AGE_S: Final = 0.002
"""Target age of the position at cycle start; slightly more than its transport delay."""

MOST_NUDGE_S: Final = 0.0002
_NUDGE_SHARE: Final = 0.05
_CLOSE_S: Final = 0.0005

PRIORITY: Final = 10
LOOP_NICE: Final = -10
SWITCH_S: Final = 0.0005
"""Longest that a thread keeps the interpreter from another one that is ready, ten times less than Python's own."""

YOUNG_EVERY_S: Final = 0.5
OLD_EVERY_S: Final = 30.0
OVERDUE_S: Final = 10.0
"""A loop that never has the time collects nevertheless: a late cycle is less than no memory left."""

_YOUNG_NEEDS_S: Final = 0.004
_OLD_NEEDS_S: Final = 0.012


def _kept() -> NoReturn:
    raise ConfigError("a scenario is flown: end it and begin again to fly another configuration")


class Signals:
    """Signals of the operating system: the handlers note them, the loop acts on them.

    Args:
        hand_over: The order that SIGTERM and SIGINT give.
        load: Reads the configuration again, for SIGHUP; by default it is refused.

    Attributes:
        looping: Whether a loop acts on signals. Before that, SIGTERM and SIGINT end the process at once.
        interrupted: Whether SIGINT (Ctrl-C) came.
    """

    def __init__(self, hand_over: Event, load: Callable[[], FlightPlan] = _kept) -> None:
        self._hand_over = hand_over
        self._load = load
        self._ends = 0
        self._again = False
        self.looping = False
        self.interrupted = False

    @contextlib.contextmanager
    def installed(self) -> Iterator[Self]:
        """Handle SIGTERM, SIGINT and SIGHUP, and restore the previous handlers in the end; yields itself."""
        with contextlib.ExitStack() as restored:
            for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
                restored.callback(signal.signal, number, signal.signal(number, self._note))
            yield self

    def _note(self, number: int, _: FrameType | None) -> None:
        self.interrupted |= number == signal.SIGINT
        if number == signal.SIGHUP:
            self._again = True
        elif self.looping:
            self._ends += 1
        else:
            sys.exit(128 + number if number == signal.SIGINT else 0)

    def act(self, daemons: Sequence[Daemon], now_s: float) -> None:
        """Pass the signals since the last call to the daemons."""
        ends = self._ends
        reload = self._again
        self._ends = 0
        self._again = False
        for daemon in daemons:
            for _ in range(ends):
                daemon.leave(self._hand_over, now_s)
            if reload:
                daemon.exchange(self._load, now_s)


def claim() -> str:
    """Raise the priority as far as permitted, and name it: `realtime 10`, `nice -10` or `as others`."""
    sys.setswitchinterval(SWITCH_S)
    if not hasattr(os, "sched_setscheduler"):  # not Linux
        return "as others"
    if os.sched_getscheduler(0) in {os.SCHED_FIFO, os.SCHED_RR}:  # set by systemd
        return f"realtime {os.sched_getparam(0).sched_priority}"
    threads = [int(path.name) for path in Path("/proc/self/task").iterdir()]
    claims: Sequence[tuple[str, Callable[[int], None]]] = (
        (
            f"realtime {PRIORITY}",
            lambda thread: os.sched_setscheduler(thread, os.SCHED_RR, os.sched_param(PRIORITY)),
        ),
        (f"nice {LOOP_NICE}", lambda thread: os.setpriority(os.PRIO_PROCESS, thread, LOOP_NICE)),
    )
    for words, raise_one in claims:
        with contextlib.suppress(PermissionError):
            raise_one(0)
            for thread in threads:
                # A thread may have just ended
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    raise_one(thread)
            return words
    return "as others"


@contextlib.contextmanager
def claimed() -> Iterator[str]:
    """Raise the priority of this process while the block runs (`claim`); yields its name.

    Children that start within keep it: a mock that has no processor fails a flight as surely as a late loop.
    """
    switch_s = sys.getswitchinterval()
    linux = hasattr(os, "sched_setscheduler")
    had = linux and (os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0))
    words = claim()
    try:
        yield words
    finally:
        sys.setswitchinterval(switch_s)
        if had and words != "as others" and had[0] == os.SCHED_OTHER:
            for path in Path("/proc/self/task").iterdir():
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.sched_setscheduler(int(path.name), os.SCHED_OTHER, os.sched_param(0))
                    os.setpriority(os.PRIO_PROCESS, int(path.name), had[1])


class GcScheduler:
    """Collects garbage between cycles, when there is time for it, and not at the interpreter's own moments."""

    def __init__(self, now_s: float, *, collect: bool = True) -> None:
        """Collect now if `collect`. Until `end`, automatic collection is off and existing objects are not scanned."""
        if collect:
            gc.collect()
        gc.freeze()
        gc.disable()
        self._young_s = self._old_s = now_s

    def between(self, now_s: float, free_s: float) -> None:
        """Collect, if it is time to and `free_s` until the next cycle are enough for it, or it is long overdue."""
        if now_s - self._young_s >= OVERDUE_S:
            free_s = math.inf
        if now_s - self._old_s >= OLD_EVERY_S and free_s >= _OLD_NEEDS_S:
            self._old_s = self._young_s = now_s
            gc.collect()
        elif now_s - self._young_s >= YOUNG_EVERY_S and free_s >= _YOUNG_NEEDS_S:
            self._young_s = now_s
            gc.collect(0)

    def end(self) -> None:
        """Leave it to the interpreter again."""
        gc.enable()
        gc.unfreeze()


class CycleHooks:
    """Called before and after the daemons' steps in every cycle; these do nothing."""

    @property
    def finished(self) -> bool:
        """True if the loop is to end."""
        return False

    def before(self, now_s: float) -> None:
        """Prepare a cycle."""

    def after(self, now_s: float, late_s: float) -> None:
        """Follow a cycle that began `late_s` later than due."""


IDLE: Final = CycleHooks()
"""No mission: only people give orders."""


def run(
    daemons: Sequence[Daemon],
    world: World,
    clock: Clock,
    *,
    mission: CycleHooks = IDLE,
    signals: Signals | None = None,
) -> None:
    """Run daemons in a world, in real or in virtual time, until they or their mission have finished.

    Each cycle steps every daemon that has not finished, in the order of their names. In real time the first one's
    positions set when cycles begin.

    Args:
        daemons: What flies.
        world: Where.
        clock: Its time.
        mission: Called around every cycle.
        signals: Acts on the signals of the operating system; None leaves these to the process.

    Raises:
        LinkError: If the world ends before the flight does.
    """
    daemons = sorted(daemons, key=lambda daemon: daemon.name)
    worked_s = 0.0
    if signals is None:
        signals = Signals(Event.HOLD)
    signals.looping = True
    due_s = clock.now_s()
    garbage = GcScheduler(due_s, collect=world.real_time)
    try:
        while (
            flying := [daemon for daemon in daemons if not daemon.finished]
        ) and not mission.finished:
            clock.sleep_until(due_s)
            world.advance()
            now_s = clock.now_s()
            signals.act(flying, now_s)
            mission.before(now_s)
            for daemon in flying:
                try:
                    daemon.step(now_s, Timing(now_s - due_s, worked_s))
                except Exception as error:  # of any kind: no other program flies this vehicle
                    daemon.survive(error, now_s)
            mission.after(now_s, now_s - due_s)
            # Every record has the frames of its own vehicle and of the evaders; topics begin with the name.
            passed = world.drain()
            if len(daemons) == 1:
                daemons[0].recording.frames(passed)
            else:
                for daemon in daemons:
                    others = tuple(
                        f"{other_daemon.name}/"
                        for other_daemon in daemons
                        if other_daemon is not daemon
                    )
                    daemon.recording.frames(
                        [frame for frame in passed if not frame.topic.startswith(others)]
                    )
            done_s = clock.now_s()
            worked_s = done_s - now_s
            due_s, missed = next_due(due_s, done_s)
            due_s += (
                nudge_s(flying[0].flight.vehicle.silence_s(LocalPosition, now_s))
                if world.real_time
                else 0.0
            )
            for daemon in flying:
                daemon.recording.worked(worked_s, missed)
            garbage.between(done_s, due_s - done_s if world.real_time else 0.0)
    finally:
        garbage.end()


def nudge_s(age_s: float) -> float:
    """Return the shift of the next cycle, s, for the age of the position at this one.

    If positions come at the loop's rate, their age settles at `AGE_S`. At another rate the shifts average to zero.
    Without positions there is no shift.
    """
    if not age_s < 2.0 * PERIOD_S:
        return 0.0
    # The nearer of two ways: up to half a period late is corrected by an earlier cycle, more by a later one.
    if abs(late_s := math.remainder(age_s - AGE_S, PERIOD_S)) < _CLOSE_S:
        return 0.0
    return max(-MOST_NUDGE_S, min(MOST_NUDGE_S, -_NUDGE_SHARE * late_s))


def next_due(due_s: float, done_s: float) -> tuple[float, int]:
    """Return the start of the next cycle, and how many were missed. Missed cycles are skipped."""
    missed = max(0, int((done_s - due_s) // PERIOD_S))
    return due_s + (missed + 1) * PERIOD_S, missed
