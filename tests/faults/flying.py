"""One flight of the suite: flown in virtual time by the session's own loop, watched, recorded and replayed."""

import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from guidance.clock import VirtualClock
from guidance.control import Polygon
from guidance.flight import FINAL, Event, State
from guidance.flight.table import HANDING_OVER
from guidance.log.replay import compare
from guidance.log.writer import Recorder
from guidance.session.daemon import Daemon
from guidance.session.loop import run
from guidance.session.mission import Conduct, Mission
from guidance.session.recorded import metadata_of
from guidance.session.spec import FlightPlan, plan_of
from guidance.sim.scenario import PURSUER
from guidance.sim.sensor import SensedEvader
from guidance.sim.stepped import SteppedWorld
from tests.faults.drawing import Case
from tests.faults.invariants import Violation, Watch

LEFT_S = 3.5
"""So long a flight is watched after it has been handed over or has ended."""

LONGEST_S = 120.0
_TO_THE_VEHICLE = f"{PURSUER}/mavlink_raw/in"
HOLD_AT_THE_END = Conduct(engage=True, end_with=Event.HOLD)


class Row(NamedTuple):
    """One flight: what came of it, how far beyond each wall it was, and what did not hold."""

    case: Case
    end: str
    duration_s: float
    processor_s: float
    breaches_m: dict[str, float]
    violations: tuple[Violation, ...]


class _Around:
    """The mission, with the watch looking on, the loop's stalls, and an end that needs no landing."""

    def __init__(self, case: Case, mission: Mission, daemon: Daemon, world: SteppedWorld, clock: VirtualClock) -> None:
        self._case, self._mission, self._daemon, self._world, self._clock = case, mission, daemon, world, clock
        self._engaged_s: float | None = None
        self._over_s: float | None = None
        self._stalls = list(case.stalls)
        self.watch = Watch(case, world)
        self.finished = False

    def before(self, now_s: float) -> None:
        self._mission.before(now_s)

    def after(self, now_s: float, late_s: float = 0.0) -> None:
        self._mission.after(now_s, late_s)
        outputs, flight = self._daemon.outputs, self._daemon.flight
        ours = [one.frame for one in self._world.drain() if one.topic == _TO_THE_VEHICLE]
        if outputs is None:
            return
        self.watch.sent(now_s, ours, outputs, flight)
        if self._engaged_s is None and outputs.state is State.ENGAGED:
            self._engaged_s = now_s
        self.watch.followed(now_s, outputs, flight)
        if self._engaged_s is not None:
            self.watch.see(now_s, flight)
        self._stall(now_s)
        over = outputs.state in FINAL or (self._engaged_s is not None and outputs.state in HANDING_OVER)
        self._over_s = None if not over else now_s if self._over_s is None else self._over_s
        left = self._over_s is not None and now_s - self._over_s >= LEFT_S
        self.finished = left or now_s > LONGEST_S or self._mission.finished

    def _stall(self, now_s: float) -> None:
        due = [one for one in self._stalls if self._engaged_s is not None and now_s - self._engaged_s >= one.at_s]
        for one in due:
            self._stalls.remove(one)
            self._clock.sleep_until(self._clock.now_s() + one.for_s)


def plan(case: Case) -> FlightPlan:
    """The scenario's own plan, with the polygon that a scenario file cannot say."""
    planned = plan_of(scenario=case.scenario)
    if case.corners_m is None:
        return planned
    cycle = planned.flight.cycle
    envelope = replace(cycle.envelope, fence_polygon=Polygon(case.corners_m))
    return replace(planned, flight=replace(planned.flight, cycle=replace(cycle, envelope=envelope)))


def fly(case: Case, folder: Path | None = None) -> Row:
    """Fly one, and replay it; the record stays where a folder is given."""
    begun_s = time.process_time()
    with tempfile.TemporaryDirectory() as scratch:
        path = (Path(scratch) if folder is None else folder) / f"{case.seed}-{case.number}.mcap"
        planned = plan(case)
        clock = VirtualClock()
        world = SteppedWorld(case.scenario, clock)
        heard = SensedEvader(world.evader_source, case.scenario.sensor, case.scenario.seed, clock.now_s)
        record = Recorder(path, metadata_of(case.scenario, None, None))
        daemon = Daemon(PURSUER, planned, world.link, heard, record=record)
        mission = Mission(case.scenario, daemon, world, heard, HOLD_AT_THE_END)
        around = _Around(case, mission, daemon, world, clock)
        try:
            run(daemon, world, clock, mission=around)  # raw frames are not recorded: no replay needs them
        except Exception as error:  # nothing may come out of the loop
            around.watch.wrong("nothing ends the loop", clock.now_s(), 1.0, f"{type(error).__name__}: {error}")
        finally:
            world.close()
            record.close()
        ended = daemon.flight.state
        around.watch.ended(clock.now_s(), ended)
        compared, _ = compare(path, lambda _: planned.flight)
        if compared.differing:
            first = compared.first
            said = "" if first is None else f"first at {first.row.now_s:.2f} s: {', '.join(first.differing)}"
            around.watch.wrong("replay bit for bit", clock.now_s(), compared.differing, said)
    happenings = [one for one in mission.result.happenings if one.after is not one.before]
    end = f"{ended} ({happenings[-1].event})" if happenings else str(ended)
    return Row(
        case, end, clock.now_s(), time.process_time() - begun_s, around.watch.breaches_m,
        tuple(around.watch.worst.values()),
    )  # fmt: skip
