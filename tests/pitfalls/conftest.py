"""A sortie: the real flight core against the stepped mock, with every switch that a complaint needs."""

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.clock import VirtualClock
from guidance.config import load
from guidance.flight import Event, Flight, State
from guidance.messages import LocalPosition
from guidance.session.linked_flight import LinkedFlight
from guidance.session.loop import PERIOD_S
from guidance.session.spec import plan_of
from guidance.sim.scenario import Scenario
from guidance.sim.stepped import SteppedWorld

SHORT = load(Scenario, Path(__file__).parents[1] / "data" / "short_chase.toml")


class Sent:
    """One frame that we put on the pursuer's wire."""

    def __init__(self, now_s, frame):
        self.now_s = now_s
        self.message = mavlink.MAVLink(None).decode(bytearray(frame))

    @property
    def name(self):
        return self.message.get_type()

    @property
    def velocity(self):
        return self.message.vx, self.message.vy, self.message.vz


class Sortie:
    def __init__(self, autopilot="px4", *, scenario=SHORT, settings=None, change=lambda settings: settings):
        pursuer = scenario.pursuer.model_copy(update={"autopilot": autopilot})
        self.scenario = scenario.model_copy(update={"pursuer": pursuer})
        self.clock = VirtualClock()
        self.world = SteppedWorld(self.scenario, self.clock)
        self.mock = self.world.vehicles["pursuer"]
        self.rover = self.world.vehicles["evader"]
        self.flight = Flight(change(settings or plan_of(scenario=self.scenario).flight))
        self.linked = LinkedFlight(self.flight, self.world.link, self.world.evader_source, None)
        self.evader = self.world.player
        self.sent = []
        self.outputs = []
        self.happenings = []
        self.frozen = False
        self.evader_plays = False

    @property
    def state(self):
        return self.flight.state

    @property
    def now_s(self):
        return self.clock.now_s()

    @property
    def setpoints(self):
        return [sent for sent in self.sent if sent.name == "SET_POSITION_TARGET_LOCAL_NED"]

    @property
    def events(self):
        return [happening.event for happening in self.happenings]

    def cycle(self, *orders):
        """One cycle of 20 ms; while frozen, the world goes on without us."""
        self.clock.sleep_until(self.now_s + PERIOD_S)
        self.world.advance()
        local, frame = self.flight.vehicle.last(LocalPosition), self.flight.tracking.game_frame
        pursuer = None if local is None or frame is None else frame.position_from_ned(local.position_ned_m)
        self.evader.step(self.now_s, pursuer, playing=self.evader_plays)
        if not self.frozen:
            output = self.linked.run(self.now_s, orders)
            self.outputs.append(output)
            self.happenings.extend(output.happenings)
        for passed in self.world.drain():
            if passed.topic == "pursuer/mavlink_raw/in":
                self.sent.append(Sent(passed.now_s, passed.frame))

    def run(self, seconds):
        for _ in range(round(seconds / PERIOD_S)):
            self.cycle()
        return self

    def until(self, state, limit_s=120.0):
        """Go on until the flight is in a state; fail when that takes too long."""
        deadline_s = self.now_s + limit_s
        while self.state is not state:
            if self.now_s > deadline_s:
                pytest.fail(f"not {state} within {limit_s} s but {self.state}; {self.happenings[-5:]}")
            self.cycle()
        return self

    def until_mock(self, mode, limit_s=20.0):
        deadline_s = self.now_s + limit_s
        while self.mock.mode != mode:
            if self.now_s > deadline_s:
                pytest.fail(f"the mock is in {self.mock.mode}, not in {mode}, after {limit_s} s")
            self.cycle()
        return self

    def standing_by(self):
        self.until(State.READY)
        while not self.evader.ready:
            self.cycle()
        self.cycle(Event.START)
        return self.until(State.STANDING_BY)

    def engaged(self):
        self.standing_by()
        self.cycle(Event.ENGAGE)
        self.until(State.ENGAGED)
        self.evader_plays = True
        return self

    def close(self):
        self.world.close()


@pytest.fixture
def sortie():
    """Make sorties; all are closed at the end."""
    made = []

    def make(*arguments, **options):
        made.append(Sortie(*arguments, **options))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.fixture(params=["px4", "arducopter"])
def autopilot(request):
    return request.param
