"""The one loop of every flight: fifty times a second, signals heard in between, frames and garbage kept for the gaps.

It runs in three worlds: the mock stepped in this process by a moved clock (`guidance.sim.stepped`), the mock as a child
process in real time (`guidance.sim.live`), and a vehicle that is not ours (`guidance.session.vehicle_world`).

In real time the cycles keep a grid of their own, which is moved along by a little (`nudge_s`) so that they begin just
after the vehicle's position arrives: a setpoint then rests on what is 2 ms old, and not on what is half a period old on
average.
"""

import contextlib
import math
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from types import FrameType
from typing import Final, Protocol

from guidance.clock import Clock, Timing
from guidance.flight import Event
from guidance.links.port import EvaderSource, VehicleLink
from guidance.links.wires.shared import CapturedFrame
from guidance.log.writer import Record
from guidance.session.daemon import Daemon
from guidance.session.plan import FlightPlan
from guidance.session.process import GcScheduler
from guidance.sim.players import EvaderPlayer

PERIOD_S: Final = 0.02
AGE_S: Final = 0.002
"""How old the vehicle's position is to be when a cycle begins: later than it may come, and no more."""

MOST_NUDGE_S: Final = 0.0002
_NUDGE_SHARE: Final = 0.05
_CLOSE_S: Final = 0.0005


class World(Protocol):
    """The vehicle and whom it pursues, as the flight reaches them."""

    @property
    def real_time(self) -> bool:
        """Whether time passes by itself."""
        ...

    @property
    def link(self) -> VehicleLink:
        """The vehicle."""
        ...

    @property
    def evader_source(self) -> EvaderSource:
        """What is heard of the evader."""
        ...

    @property
    def player(self) -> EvaderPlayer | None:
        """The evader, where this process plays it; None where it is somebody else's."""
        ...

    def advance(self) -> None:
        """Bring the world up to the clock's present.

        Raises:
            LinkError: If the world has ended: the mock autopilot died, say.
        """
        ...

    def engage(self) -> None:
        """The game has begun: faults that count from engagement do from now on."""
        ...

    def drain(self) -> Sequence[CapturedFrame]:
        """Return the raw frames that passed since the last call, for the record."""
        ...

    def close(self) -> None:
        """End everything this world has started."""
        ...


class Signals:
    """What the operating system asks of a daemon, noted by handlers and acted on by the loop.

    Args:
        hand_over: What SIGTERM and SIGINT hand the vehicle to.
        load: Reads the configuration again, for SIGHUP.
    """

    def __init__(self, hand_over: Event, load: Callable[[], FlightPlan]) -> None:
        self._hand_over = hand_over
        self._load = load
        self._end = 0
        self._again = False
        self._looping = False

    @contextlib.contextmanager
    def installed(self) -> Iterator[None]:
        """Take SIGTERM, SIGINT and SIGHUP, and give them back in the end: what stays open then ends by them."""
        taken = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
        before = {number: signal.signal(number, self._note) for number in taken}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

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

    def act(self, daemon: Daemon, now_s: float) -> None:
        """Tell the daemon what was asked for since the last call."""
        ends, again = self._end, self._again
        self._end, self._again = 0, False
        for _ in range(ends):
            daemon.leave(self._hand_over, now_s)
        if again:
            daemon.exchange(self._load, now_s)


class Around(Protocol):
    """What happens around every cycle, before and after the daemon's step."""

    @property
    def finished(self) -> bool:
        """Whether no further cycle is wanted."""
        ...

    def before(self, now_s: float) -> None:
        """Prepare a cycle."""
        ...

    def after(self, now_s: float, late_s: float) -> None:
        """Follow a cycle that began `late_s` later than due."""
        ...


def run(
    daemon: Daemon,
    world: World,
    clock: Clock,
    *,
    mission: Around | None = None,
    signals: Signals | None = None,
    record: Record | None = None,
) -> None:
    """Run the daemon in a world, in real or in virtual time, until it or its mission has finished.

    Args:
        daemon: What flies.
        world: Where.
        clock: Its time.
        mission: What is done around every cycle; None where a person orders.
        signals: What acts on the operating system's; None leaves them to the process.
        record: Where the raw frames are kept.

    Raises:
        LinkError: If the world ends before the flight does.
    """
    garbage = GcScheduler(enabled=world.real_time)
    if signals is not None:
        signals.begin()
    due_s = clock.now_s()
    worked_s = 0.0
    garbage.begin(due_s)
    try:
        while not (daemon.finished or (mission is not None and mission.finished)):
            clock.sleep_until(due_s)
            world.advance()
            now_s = clock.now_s()
            if signals is not None:
                signals.act(daemon, now_s)
            _cycle(daemon, mission, now_s, Timing(now_s - due_s, worked_s))
            if record is not None:
                for passed in world.drain():
                    record.frame(*passed)
            done_s = clock.now_s()
            worked_s = done_s - now_s
            due_s, missed = next_due(due_s, done_s)
            due_s += nudge_s(daemon.position_age_s) if world.real_time else 0.0
            daemon.metrics.work.observe(worked_s)
            daemon.metrics.late.inc(missed)
            garbage.between(done_s, due_s - done_s)
    finally:
        garbage.end()


def _cycle(daemon: Daemon, mission: Around | None, now_s: float, timing: Timing) -> None:
    if mission is not None:
        mission.before(now_s)
    try:
        daemon.step(now_s, timing)
    except Exception as error:  # the last catch: nobody else flies this vehicle
        daemon.survive(error, now_s)
    if mission is not None:
        mission.after(now_s, timing.late_s)


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
