"""A sortie: one pursuer flown in virtual time. All flights of the tests use it, each with its own pilot and world."""

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.clock import VirtualClock
from guidance.config import load
from guidance.flight import Event, Flight, State
from guidance.messages import LocalPosition
from guidance.session.fly.loop import PERIOD_S
from guidance.session.plan import plan_of
from guidance.sim.scenario import Scenario
from guidance.sim.stepped import SteppedWorld
from tests.harness.copies import Flown
from tests.harness.linked import FlownByHand

SHORT = load(Scenario, Path(__file__).parents[1] / "data" / "short_chase.toml")


class Sent:
    """One frame sent to the pursuer."""

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
    """A clock, a world and a pilot. Each cycle advances the clock, then the world, then the pilot.

    Args:
        clock: Virtual clock; `sleep_until` advances it.
        pilot: Runs the cycles: a flight with its links, or a daemon.
        world: Simulated vehicles, stepped to the clock's time in each cycle.

    Attributes:
        sent: Frames sent to the pursuer.
        outputs: Outputs of each cycle.
        frozen: If true, the pilot runs no cycles while the world continues.
    """

    LIMIT_S = 60.0

    def __init__(self, clock, pilot, world=None):
        self.clock = clock
        self.pilot = pilot
        self.world = world
        self.sent = []
        self.outputs = []
        self.frozen = False

    @property
    def flight(self):
        return self.pilot.flight

    @property
    def state(self):
        return self.flight.state

    @property
    def now_s(self):
        return self.clock.now_s()

    @property
    def finished(self):
        """Whether the flight is over."""
        return False

    @property
    def transitions(self):
        return [transition for output in self.outputs for transition in output.transitions]

    @property
    def events(self):
        return [transition.event for transition in self.transitions]

    @property
    def setpoints(self):
        return [sent for sent in self.sent if sent.name == "SET_POSITION_TARGET_LOCAL_NED"]

    def advance(self):
        """Step the world to the clock's time."""
        self.world.advance()

    def act(self, orders):
        """Run one cycle of the pilot."""
        return self.pilot.run(self.now_s, orders)

    def passed(self):
        """Return the frames on the pursuer's wire since the last cycle."""
        return ()

    def cycle(self, *orders):
        self.clock.sleep_until(self.now_s + PERIOD_S)
        self.advance()
        if not self.frozen:
            self.outputs.append(self.act(orders))
        self.sent += [
            Sent(one.now_s, one.frame) for one in self.passed() if one.topic.endswith("/in")
        ]

    def run(self, seconds=300.0, until=lambda: False):
        """Run cycles for a time, or until the condition holds or the flight is over."""
        for _ in range(round(seconds / PERIOD_S)):
            if self.finished or until():
                break
            self.cycle()
        return self

    def until(self, *states, limit_s=None):
        """Run until the flight is in one of these states; fail after the time limit."""
        limit_s = limit_s or self.LIMIT_S
        self.run(limit_s, lambda: self.state in states)
        if self.state not in states:
            pytest.fail(
                f"not {states} within {limit_s} s but {self.state}; {self.transitions[-5:]}"
            )
        return self

    def history(self):
        """Return the frames and outputs so far; they are immutable, so copies of the sortie share them."""
        return [*self.sent, *self.outputs]

    def close(self):
        self.world.close()


STAGES = ("until_ready", "start", "engage", "arrive")
"""Methods that fly the beginning of a sortie, each from where the one before it ends."""


class Staged(Sortie):
    """A sortie whose kind has the last three methods of `STAGES`."""

    def until_ready(self):
        return self.until(State.READY)

    def standing_by(self):
        return self.until_ready().start()

    def engaged(self):
        return self.standing_by().engage()

    def on_station(self):
        return self.engaged().arrive()


class Stepped(Staged):
    """The flight core in the world of `scenario run`, with orders given by the test."""

    LIMIT_S = 120.0

    def __init__(
        self, autopilot="px4", *, scenario=SHORT, settings=None, change=lambda settings: settings
    ):
        pursuer = scenario.pursuer.model_copy(update={"autopilot": autopilot})
        self.scenario = scenario.model_copy(update={"pursuer": pursuer})
        clock = VirtualClock()
        world = SteppedWorld(self.scenario, clock)
        flight = Flight(change(settings or plan_of(scenario=self.scenario).flight))
        super().__init__(
            clock,
            FlownByHand(flight, world.links["pursuer"], world.evaders["pursuer"]["evader"], None),
            world,
        )
        self.mock = world.vehicles["pursuer"]
        self.rover = world.vehicles["evader"]
        self.evader = world.players["evader"]
        self.evader_plays = False

    def advance(self):
        super().advance()
        local = self.flight.vehicle.latest.get(LocalPosition)
        frame = self.flight.tracking.game_frame
        pursuer = (
            None
            if local is None or frame is None
            else frame.position_from_ned(local.position_ned_m)
        )
        self.evader.step(
            self.now_s, [] if pursuer is None else [pursuer], playing=self.evader_plays
        )

    def passed(self):
        return [one for one in self.world.drain() if one.topic.startswith("pursuer/")]

    def until_mock(self, mode, limit_s=20.0):
        self.run(limit_s, lambda: self.mock.mode == mode)
        if self.mock.mode != mode:
            pytest.fail(f"the mock is in {self.mock.mode}, not in {mode}, after {limit_s} s")
        return self

    def start(self):
        self.run(until=lambda: self.evader.ready)
        self.cycle(Event.START)
        return self.until(State.STANDING_BY)

    def engage(self):
        self.cycle(Event.ENGAGE)
        self.until(State.ENGAGED)
        self.evader_plays = True
        return self

    def arrive(self):
        return self.until(State.ON_STATION, limit_s=40.0)


class Sorties:
    """Makes sorties of one class. A common beginning is flown once; later sorties continue from copies."""

    def __init__(self, kind):
        self.kind = kind
        self.flown = Flown()
        self.made = []

    def __call__(self, *which, **more):
        return self._kept(self.kind(*which, **more))

    def after(self, fly, *which, **more):
        """Return a copy of a sortie that `fly` has flown."""
        key = (fly, repr((which, sorted(more.items()))))
        return self._kept(
            self.flown(key, lambda: fly(self.kind(*which, **more)), self.kind.history)
        )

    def ready(self, *which, **more):
        return self._kept(self._begun("until_ready", which, more))

    def standing_by(self, *which, **more):
        return self._kept(self._begun("start", which, more))

    def engaged(self, *which, **more):
        return self._kept(self._begun("engage", which, more))

    def on_station(self, *which, **more):
        return self._kept(self._begun("arrive", which, more))

    def _begun(self, stage, which, more):
        """Return a copy of a sortie at the end of a stage; the stages before it are flown once, too."""

        def fly():
            before = STAGES[: STAGES.index(stage)]
            sortie = self._begun(before[-1], which, more) if before else self.kind(*which, **more)
            return getattr(sortie, stage)()

        return self.flown((stage, repr((which, sorted(more.items())))), fly, self.kind.history)

    def _kept(self, sortie):
        self.made.append(sortie)
        return sortie

    def close(self):
        while self.made:
            self.made.pop().close()
