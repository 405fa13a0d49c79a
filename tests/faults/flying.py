"""One flight of the suite: flown in virtual time by the session's own loop, and watched.

Those of one game have the way to its start in common: it is flown once, and they go on from copies of it.
"""

import tempfile
import time
from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, Self

from guidance.clock import VirtualClock
from guidance.control import Polygon
from guidance.flight import FINAL, Event, State
from guidance.flight.table import HANDING_OVER
from guidance.links.carriers import GlobalPositionInt
from guidance.links.mavlink_evader import MavlinkEvader
from guidance.log.replay import compare
from guidance.log.writer import NullRecorder, Recorder
from guidance.session.daemon import Equipment
from guidance.session.flight_files import flight_metadata
from guidance.session.loop import PERIOD_S, run
from guidance.session.mission import Mission
from guidance.session.plan import FlightPlan, plan_of
from guidance.session.sequencer import MissionPolicy
from guidance.sim.mock_files import faults_after
from guidance.sim.scenario import EVADER_ID, PURSUER
from guidance.sim.stepped import SteppedWorld
from tests.faults.drawing import AUTOPILOTS, Case
from tests.faults.invariants import Violation, Watch
from tests.harness.copies import copied
from tests.harness.pinned_wire import PinnedWire, evader_wire

LEFT_S = 3.5
"""So long a flight is watched after it has been handed over or has ended."""

LONGEST_S = 120.0
_TO_THE_VEHICLE = f"{PURSUER}/mavlink_raw/in"
HOLD_AT_THE_END = MissionPolicy(engage=True, end_with=Event.HOLD)


class Row(NamedTuple):
    """One flight: what came of it, how far beyond each wall it was, and what did not hold."""

    case: Case
    end: str
    duration_s: float
    processor_s: float
    breaches_m: dict[str, float]
    violations: tuple[Violation, ...]


class Sortie:
    """The mission, with the watch looking on, the loop's stalls, and an end that needs no landing.

    Args:
        case: What is flown.
        record: Where it is recorded; None keeps nothing.
    """

    def __init__(self, case: Case, record: Recorder | None = None) -> None:
        self.clock = VirtualClock()
        self._world = SteppedWorld(case.game, self.clock)
        wire = PinnedWire(evader_wire(self._world), (EVADER_ID,))
        self._world.evaders["pursuer"]["evader"] = MavlinkEvader(wire, GlobalPositionInt(), system_id=EVADER_ID)
        self.mission = Mission(
            case.game,
            self._world,
            self.clock,
            plans={PURSUER: plan(case)},
            equipment={PURSUER: Equipment(record=record)},
            policy=HOLD_AT_THE_END,
        )
        (self._daemon,) = self.mission.daemons
        self.watch = Watch(case, self._world)
        self._case = case
        self._stalls = list(case.stalls)
        self._engaged_s: float | None = None
        self._over_s: float | None = None
        self._standing_by = False
        self._under_way = False

    @property
    def state(self) -> State:
        """Where the flight stands."""
        return self._daemon.flight.state

    @property
    def finished(self) -> bool:
        """Whether no further cycle is wanted: it is over, or where others go on from a copy."""
        over = self._over_s is not None and self.clock.now_s() - self._over_s >= LEFT_S
        waiting = self._standing_by and not self._under_way
        return waiting or over or self.clock.now_s() > LONGEST_S or self.mission.finished

    def stand_by(self) -> Self:
        """Fly to where the game begins, or to the end of what does not come so far."""
        self._run()
        return self

    def fly(self, case: Case) -> None:
        """Go on from there to the end, with what goes wrong in this case."""
        self._case = self.watch.case = case
        self._stalls, self._under_way = list(case.stalls), True
        self.clock.sleep_until(self.clock.now_s() + PERIOD_S)
        self._run()
        self.watch.ended(self.clock.now_s(), self.state)

    def _run(self) -> None:
        try:
            run(self.mission.daemons, self._world, self.clock, mission=self)  # no replay needs the raw frames
        except Exception as error:  # nothing may come out of the loop
            self.watch.wrong("nothing ends the loop", self.clock.now_s(), 1.0, f"{type(error).__name__}: {error}")

    def before(self, now_s: float) -> None:
        """Let the mission give its orders."""
        self.mission.before(now_s)

    def after(self, now_s: float, late_s: float = 0.0) -> None:
        """Look at what a cycle did."""
        self.mission.after(now_s, late_s)
        outputs, flight = self._daemon.outputs, self._daemon.flight
        ours = [one.frame for one in self._world.drain() if one.topic == _TO_THE_VEHICLE]
        if outputs is None:
            return
        self.watch.sent(now_s, ours, outputs, flight)
        self._standing_by |= outputs.state is State.STANDING_BY
        if self._engaged_s is None and outputs.state is State.ENGAGED:
            self._engaged_s = now_s
            for name, keys in faults_after(self._case.scenario, "engaged"):
                self._world.faulted[name].inject(keys)
        self.watch.followed(now_s, outputs, flight)
        if self._engaged_s is not None:
            self.watch.see(now_s, flight)
        self._stall(now_s)
        over = outputs.state in FINAL or (self._engaged_s is not None and outputs.state in HANDING_OVER)
        self._over_s = None if not over else now_s if self._over_s is None else self._over_s

    def _stall(self, now_s: float) -> None:
        due = [one for one in self._stalls if self._engaged_s is not None and now_s - self._engaged_s >= one.at_s]
        for one in due:
            self._stalls.remove(one)
            self.clock.sleep_until(self.clock.now_s() + one.for_s)

    def close(self) -> None:
        """Let go of the wires."""
        self._world.close()


def plan(case: Case) -> FlightPlan:
    """The scenario's own plan, with the polygon that a scenario file cannot say."""
    planned = plan_of(scenario=case.scenario)
    if case.corners_m is None:
        return planned
    cycle = planned.flight.cycle
    envelope = replace(cycle.envelope, fence_polygon=Polygon(case.corners_m))
    return replace(planned, flight=planned.flight.model_copy(update={"cycle": replace(cycle, envelope=envelope)}))


class Tape(Recorder):
    """A flight's record; a copy of the flight has none."""

    def __deepcopy__(self, _memo: object) -> "NoRecord":
        return NoRecord()


class NoRecord(NullRecorder):
    """A record that keeps nothing, and never fails."""

    def __init__(self) -> None:
        super().__init__("")
        self.failed = None


class Starts:
    """Where the last games begin: what stands by there, and flights go on from copies of."""

    def __init__(self) -> None:
        self._kept: deque[tuple[object, Sortie]] = deque(maxlen=len(AUTOPILOTS))

    def keep(self, case: Case, sortie: Sortie) -> None:
        """Keep a copy."""
        self._kept.append((_start_of(case), copied(sortie)))

    def copy(self, case: Case) -> Sortie | None:
        """Return one that has the same behind it as this case; None where there is none."""
        wanted = _start_of(case)
        return next((copied(sortie) for start, sortie in self._kept if start == wanted), None)


def _start_of(case: Case) -> object:
    return case.game, case.corners_m


def fly(case: Case, folder: Path | None = None, starts: Starts | None = None) -> Row:
    """Fly one.

    Args:
        case: What is flown.
        folder: Its record stays there.
        starts: Others of its game may have been flown to its start, and more will be. Without, it is flown from the
            ground, as is the first of each game: what is flown from the ground is recorded, and replayed.
    """
    begun_s = time.process_time()
    sortie = None if starts is None or folder is not None else starts.copy(case)
    if sortie is None:
        sortie = _from_the_ground(case, folder, starts)
    else:
        sortie.fly(case)
        sortie.close()
    happenings = [one for one in sortie.mission.result.vehicles[PURSUER].happenings if one.after is not one.before]
    end = f"{sortie.state} ({happenings[-1].event})" if happenings else str(sortie.state)
    return Row(
        case, end, sortie.clock.now_s(), time.process_time() - begun_s, sortie.watch.breaches_m,
        tuple(sortie.watch.worst.values()),
    )  # fmt: skip


def _from_the_ground(case: Case, folder: Path | None, starts: Starts | None) -> Sortie:
    """Fly one whole, record and replay it."""
    with tempfile.TemporaryDirectory() as scratch:
        path = (Path(scratch) if folder is None else folder) / f"{case.seed}-{case.number}.mcap"
        record = Tape(path, flight_metadata(case.scenario, None, None))
        sortie = Sortie(case, record).stand_by()
        if starts is not None and not case.game.fault:
            starts.keep(case, sortie)
        sortie.fly(case)
        sortie.close()
        record.close()
        settings = plan(case).flight
        compared, _ = compare(path, lambda _: settings)
        if compared.differing:
            first = compared.first
            said = "" if first is None else f"first at {first.row.now_s:.2f} s: {', '.join(first.differing)}"
            sortie.watch.wrong("replay bit for bit", sortie.clock.now_s(), compared.differing, said)
    return sortie
