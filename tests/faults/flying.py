"""Flies one flight of the fault suite in virtual time, with the session's own loop and a watch that checks it.

The flight to the start of a game is flown once; all flights of that game continue from copies.
"""

import tempfile
import time
from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, Self

from guidance.clock import VirtualClock
from guidance.control.polygon import Polygon
from guidance.errors import FlightError
from guidance.flight import BEFORE_FLIGHT, FINAL, Event, State
from guidance.flight.table import HANDING_OVER
from guidance.links.evaders.carriers import GLOBAL_POSITION
from guidance.links.evaders.mavlink import MavlinkEvader
from guidance.log.replay import compare
from guidance.log.writer import Record, Recorder
from guidance.session.flight_files import flight_metadata
from guidance.session.fly.daemon import Equipment
from guidance.session.fly.loop import PERIOD_S, run
from guidance.session.fly.mission import Mission, MissionPolicy
from guidance.session.plan import FlightPlan, plan_of
from guidance.sim.mock_files import faults_after
from guidance.sim.scenario import EVADER_ID, PURSUER
from guidance.sim.stepped import SteppedWorld
from tests.faults.disturbances import Disturbed, set_up, wants_of
from tests.faults.drawing import AUTOPILOTS, Case
from tests.faults.invariants import Violation, Watch
from tests.harness.copies import copied
from tests.harness.pinned_wire import PinnedWire, evader_wire

LEFT_S = 3.5
"""Time that a flight is watched after it was handed over or has ended."""

LONGEST_S = 120.0
_TO_THE_VEHICLE = f"{PURSUER}/mavlink_raw/in"
PREFLIGHT = frozenset({"parameter_changed"})
"""Disturbances of a flight that preflight judges."""

HOLD_AT_THE_END = MissionPolicy(engage=True, end_with=Event.HOLD)


class Row(NamedTuple):
    """Result of one flight: its end, the largest breach of each wall, and the violations."""

    case: Case
    end: str
    duration_s: float
    processor_s: float
    breaches_m: dict[str, float]
    violations: tuple[Violation, ...]


class Sortie:
    """A mission with a watch and the stalls of the loop; it ends without a landing.

    Args:
        case: The case to fly.
        record: Recorder of the flight; None for no record.
    """

    def __init__(self, case: Case, record: Recorder | None = None) -> None:
        self.clock = VirtualClock()
        self._world = SteppedWorld(case.game, self.clock)
        wire = PinnedWire(evader_wire(self._world), (EVADER_ID,))
        self._world.evaders["pursuer"]["evader"] = MavlinkEvader(
            wire, GLOBAL_POSITION, system_id=EVADER_ID
        )
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
        self.disturbed = Disturbed(
            case.disturbances,
            self.mission.vehicles[0].pursuit,
            self._world,
            self.clock,
            self._daemon,
            self.watch.wrong,
            alone=len(case.kinds) == 1,
        )
        if PREFLIGHT & set(case.kinds):
            set_up(self._world.vehicles[PURSUER], case.scenario)
        self._case = case
        self._stalls = list(case.stalls)
        self._engaged_s: float | None = None
        self._over_s: float | None = None
        self._standing_by = False
        self._under_way = False
        self._given_up = False

    @property
    def state(self) -> State:
        """State of the flight."""
        return self._daemon.flight.state

    @property
    def finished(self) -> bool:
        """Whether to stop: the flight is over, or it is in STANDING_BY and can be copied."""
        over = self._over_s is not None and self.clock.now_s() - self._over_s >= LEFT_S
        waiting = self._standing_by and not self._under_way
        now_s = self.clock.now_s()
        late = now_s > LONGEST_S or self._given_up or self.disturbed.barred(now_s)
        return waiting or over or late or self.mission.finished

    def stand_by(self) -> Self:
        """Fly until STANDING_BY at the start of the game, or until the end of a flight that fails earlier."""
        self._run()
        return self

    def fly(self, case: Case) -> None:
        """Continue to the end with the faults of this case."""
        self._case = self.watch.case = case
        self._stalls = list(case.stalls)
        self._under_way = True
        self.clock.sleep_until(self.clock.now_s() + PERIOD_S)
        self._run()
        if not (self._given_up or self.disturbed.barred(self.clock.now_s())):
            self.watch.ended(self.clock.now_s(), self.state)

    def _run(self) -> None:
        try:
            # No replay needs the raw frames
            run(self.mission.daemons, self._world, self.clock, mission=self)
        except FlightError as error:
            # A mission that preflight judges ends so before the start order.
            if not self._daemon.survey.judges or self.state not in BEFORE_FLIGHT:
                self.watch.wrong("nothing ends the loop", self.clock.now_s(), 1.0, str(error))
            self._given_up = True
        except Exception as error:  # the loop must not raise
            self.watch.wrong(
                "nothing ends the loop", self.clock.now_s(), 1.0, f"{type(error).__name__}: {error}"
            )

    def before(self, now_s: float) -> None:
        """Let the mission give its orders."""
        self.disturbed.before(now_s)
        if not self.disturbed.holds_back_start(now_s):
            self.mission.before(now_s)

    def after(self, now_s: float, late_s: float = 0.0) -> None:
        """Check a cycle."""
        self.mission.after(now_s, late_s)
        outputs = self._daemon.outputs
        flight = self._daemon.flight
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
        self.disturbed.after(now_s, outputs)
        if self._engaged_s is not None:
            self.watch.see(now_s, flight)
        self._stall(now_s)
        over = outputs.state in FINAL or (
            (self._engaged_s is not None or self.disturbed.ended_by_order)
            and outputs.state in HANDING_OVER
        )
        self._over_s = None if not over else now_s if self._over_s is None else self._over_s

    def _stall(self, now_s: float) -> None:
        due = [
            one
            for one in self._stalls
            if self._engaged_s is not None and now_s - self._engaged_s >= one.at_s
        ]
        for one in due:
            self._stalls.remove(one)
            self.clock.sleep_until(self.clock.now_s() + one.for_s)

    def close(self) -> None:
        """Close the wires."""
        self._world.close()


def plan(case: Case) -> FlightPlan:
    """Return the scenario's plan with the polygon fence, which scenario files do not support."""
    planned = plan_of(scenario=case.scenario)
    if PREFLIGHT & set(case.kinds):
        planned = replace(planned, wants=wants_of(case.scenario, planned))
    if case.corners_m is None:
        return planned
    cycle = planned.flight.cycle
    envelope = replace(cycle.envelope, fence_polygon=Polygon(case.corners_m))
    return replace(
        planned,
        flight=planned.flight.model_copy(update={"cycle": replace(cycle, envelope=envelope)}),
    )


class Tape(Recorder):
    """Recorder of a flight; copies of the flight are not recorded."""

    def __deepcopy__(self, _memo: object) -> Record:
        return Record()


class Starts:
    """Sorties in STANDING_BY at the start of the latest games; flights continue from copies."""

    def __init__(self) -> None:
        self._kept: deque[tuple[object, Sortie]] = deque(maxlen=len(AUTOPILOTS))

    def keep(self, case: Case, sortie: Sortie) -> None:
        """Keep a copy."""
        self._kept.append((_start_of(case), copied(sortie)))

    def copy(self, case: Case) -> Sortie | None:
        """Return a copy of the sortie with this case's game and fence; None if there is none."""
        wanted = _start_of(case)
        return next((copied(sortie) for start, sortie in self._kept if start == wanted), None)


def _start_of(case: Case) -> object:
    return case.game, case.corners_m


def fly(case: Case, folder: Path | None = None, starts: Starts | None = None) -> Row:
    """Fly one case.

    Args:
        case: The case to fly.
        folder: Folder that keeps the record.
        starts: Sorties at the start of their games. If one matches, the flight continues from a copy. Otherwise it
            starts on the ground; flights from the ground are recorded and replayed.
    """
    begun_s = time.process_time()
    whole = starts is None or folder is not None or bool(case.disturbances)
    sortie = None if whole or starts is None else starts.copy(case)
    if sortie is None:
        sortie = _from_the_ground(case, folder, starts)
    else:
        sortie.fly(case)
        sortie.close()
    transitions = [
        transition
        for transition in sortie.mission.result.vehicles[PURSUER].transitions
        if transition.after is not transition.before
    ]
    end = f"{sortie.state} ({transitions[-1].event})" if transitions else str(sortie.state)
    return Row(
        case, end, sortie.clock.now_s(), time.process_time() - begun_s, sortie.watch.breaches_m,
        tuple(sortie.watch.worst.values()),
    )  # fmt: skip


def _from_the_ground(case: Case, folder: Path | None, starts: Starts | None) -> Sortie:
    """Fly one case from the ground, record it and replay the record."""
    with tempfile.TemporaryDirectory() as scratch:
        path = (Path(scratch) if folder is None else folder) / f"{case.seed}-{case.number}.mcap"
        record = Tape(path, flight_metadata(case.scenario, None, None))
        sortie = Sortie(case, record).stand_by()
        if starts is not None and not case.game.fault and not case.disturbances:
            starts.keep(case, sortie)
        sortie.fly(case)
        sortie.close()
        record.close()
        settings = plan(case).flight
        compared, _ = compare(path, lambda _: settings)
        if compared.differing:
            first = compared.first
            said = (
                ""
                if first is None
                else f"first at {first.row.now_s:.2f} s: {', '.join(first.differing)}"
            )
            sortie.watch.wrong("replay bit for bit", sortie.clock.now_s(), compared.differing, said)
    return sortie
