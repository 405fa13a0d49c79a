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
from tests.harness.copies import Flown

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

    def on_station(self):
        return self.engaged().until(State.ON_STATION, 40.0)

    def history(self):
        """What has been said and done, which nobody changes."""
        return [*self.sent, *self.outputs, *self.happenings]

    def close(self):
        self.world.close()


class Sorties:
    """Makes sorties. What many begin with is flown once: they take off from copies of it."""

    def __init__(self):
        self.flown = Flown()
        self.made = []

    def __call__(self, *arguments, **options):
        return self._kept(Sortie(*arguments, **options))

    def after(self, fly, autopilot="px4", scenario=SHORT):
        """A sortie that has flown so far as `fly` flies it."""
        key = (fly, autopilot, scenario.model_dump_json())
        return self._kept(self.flown(key, lambda: fly(Sortie(autopilot, scenario=scenario)), Sortie.history))

    def standing_by(self, *which, **more):
        return self.after(Sortie.standing_by, *which, **more)

    def engaged(self, *which, **more):
        return self.after(Sortie.engaged, *which, **more)

    def on_station(self, *which, **more):
        return self.after(Sortie.on_station, *which, **more)

    def _kept(self, sortie):
        self.made.append(sortie)
        return sortie

    def close(self):
        while self.made:
            self.made.pop().close()
