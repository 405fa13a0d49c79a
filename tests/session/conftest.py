"""A daemon around the stepped mock: two vehicles in this process, time moved by hand, everything said kept."""

import io
import json
import logging

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.clock import VirtualClock
from guidance.config import parse
from guidance.flight import State
from guidance.links import MemoryWire, SigningKey
from guidance.links.evaders.mavlink import GlobalPositionInt, MavlinkEvader
from guidance.links.pymavlink_link import PymavlinkLink
from guidance.links.signing import ticks
from guidance.links.wires.shared import TappedWire
from guidance.session.daemon import Daemon
from guidance.session.metrics import Metrics
from guidance.session.orders import Mailbox
from guidance.session.process import Notifier
from guidance.session.spec import plan_of
from guidance.session.vehicle_file import Config
from sitl_mock import Home, MockVehicle
from sitl_mock.mavlink import Signing
from tests.harness.copies import Flown
from tests.harness.vehicle import FENCED, document

CYCLE_S = 0.02
HERE = Home(47.397742, 8.545594, 488.0)
UNIX_S = 1_800_000_000.0


@pytest.fixture(scope="session")
def vehicle_document():
    """How to make a configuration."""
    return document


class KeptLog:
    """A log that keeps what is said, for tests to read."""

    dropped = 0

    def __init__(self):
        self.lines = []

    def say(self, level, message, **fields):
        self.lines.append((level, message, fields))

    def messages(self, at_least=logging.DEBUG):
        return [message for level, message, _ in self.lines if level >= at_least]


class KeptNotifier(Notifier):
    def __init__(self):
        super().__init__(None, 2.0)
        self.said = []

    def _send(self, text):
        self.said.append(text)


class Base:
    """One daemon, its vehicle and its evader; `source` makes another evader, which needs no vehicle."""

    def __init__(
        self,
        *,
        parameters=FENCED,
        record=None,
        broadcast=None,
        record_required=False,
        source=None,
        key=None,
        **sections,
    ):
        config = self.config = parse(Config, document(**sections), source="test")
        self.clock = VirtualClock()
        flavour = config.vehicle.autopilot
        options = {"home": HERE, "noise": False, "ready_after_s": 0.5}
        signed = Signing(key, timestamp=ticks(UNIX_S))
        self.vehicle = MockVehicle(flavour, system_id=1, parameters=parameters, signing=signed, **options)
        self.prey = MockVehicle("px4", system_id=2, start_ned=(30.0, 0.0, 0.0), **options)
        ours, self._end = MemoryWire.pair(self.clock.now_s)
        theirs, self._prey_end = MemoryWire.pair(self.clock.now_s)
        self.wire = TappedWire(ours, self.clock.now_s, "uav1")
        signing = {"signing_key": None if key is None else SigningKey(key), "unix_s": UNIX_S}
        self.link = PymavlinkLink(self.wire, self.clock.now_s, system_id=1, **signing)
        heard = MavlinkEvader(theirs, GlobalPositionInt(), system_id=2, **signing)
        self.evader = heard if source is None else source(self.clock)
        self.mailbox, self.log, self.notifier = Mailbox(), KeptLog(), KeptNotifier()
        self.metrics = Metrics(config.name)
        self.deaf = False
        self.prey_silent = False
        self.evader_here = source is None
        self.injected = []
        self.sent = []
        self.daemon = Daemon(
            config.name,
            plan_of(config),
            self.link,
            self.evader,
            mailbox=self.mailbox,
            log=self.log,
            metrics=self.metrics,
            notifier=self.notifier,
            record=record,
            broadcast=broadcast,
            record_required=record_required,
        )

    @property
    def state(self):
        return self.daemon.flight.state

    @property
    def now_s(self):
        return self.clock.now_s()

    def report(self, frame):
        """Somebody says a frame where the evader is heard."""
        self._prey_end.send(frame)

    def world(self):
        """Move on by one cycle without the daemon."""
        self.clock.sleep_until(self.now_s + CYCLE_S)
        for frame in self.vehicle.step(self.now_s, [*(f for _, f in self._end.receive()), *self.injected]):
            self._end.send(frame)
        self.injected = []
        if self.evader_here:
            for frame in self.prey.step(self.now_s, []):
                if not self.prey_silent:
                    self.report(frame)

    def cycle(self):
        self.world()
        outputs = self.daemon.step(self.now_s)
        for passed in self.wire.drain():
            if passed.topic.endswith("/in"):
                self.sent.append((passed.now_s, mavlink.MAVLink(None).decode(bytearray(passed.frame))))
        return outputs

    def run(self, seconds):
        for _ in range(round(seconds / CYCLE_S)):
            self.cycle()
        return self

    def until(self, *states, limit_s=60.0):
        deadline_s = self.now_s + limit_s
        while self.state not in states:
            if self.now_s > deadline_s:
                pytest.fail(f"{self.state}, not {states}, after {limit_s} s: {self.log.lines[-4:]}")
            self.cycle()
        return self

    def order(self, word):
        """Give an order, run the cycles until it is answered, return the answer."""
        question = self.mailbox.ask(word)
        deadline_s = self.now_s + 2.0
        while (answer := question.wait(0.0)) is None:
            assert self.now_s < deadline_s, f"{word} was not answered"
            self.cycle()
        return answer

    def standing_by(self):
        self.until(State.READY)
        assert self.order("start")["accepted"]
        return self.until(State.STANDING_BY)

    def engaged(self):
        self.standing_by()
        assert self.order("engage")["accepted"]
        return self.until(State.ENGAGED)

    def history(self):
        """What has been said, which nobody changes."""
        return [*self.sent, *self.log.lines]

    def setpoints_since(self, since_s):
        return [
            message
            for sent_s, message in self.sent
            if sent_s >= since_s and message.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
        ]

    def commands_since(self, since_s):
        return [m.command for sent_s, m in self.sent if sent_s >= since_s and m.get_type() == "COMMAND_LONG"]

    def inject_setpoint(self, velocity):
        """Another program on the vehicle's link sends a setpoint of its own."""
        other = mavlink.MAVLink(None, 1, 191)
        message = mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, 0b0000_1101_1100_0111, 0, 0, 0, *velocity, 0, 0, 0, 0, 0
        )
        self.injected.append(message.pack(other))


class Bases:
    """Makes daemons. What many begin with is flown once: they go on from copies of it."""

    def __init__(self):
        self.flown = Flown()
        self.made = []

    def __call__(self, **options):
        return self._kept(Base(**options))

    def ready(self, **options):
        return self._after("ready", lambda one: one.until(State.READY), options)

    def standing_by(self, **options):
        return self._after("standing by", Base.standing_by, options)

    def engaged(self, **options):
        return self._after("engaged", Base.engaged, options)

    def _after(self, where, fly, options):
        key = (where, repr(sorted(options.items())))
        return self._kept(self.flown(key, lambda: fly(Base(**options)), Base.history))

    def _kept(self, one):
        self.made.append(one)
        return one

    def close(self):
        while self.made:
            one = self.made.pop()
            one.link.close()
            one.evader.close()


@pytest.fixture(scope="session")
def bases():
    return Bases()


@pytest.fixture
def base(bases):
    """Make daemons; everything is closed at the end."""
    yield bases
    bases.close()


@pytest.fixture
def text_log():
    """A stream to log to, and how to read it back as JSON rows."""
    stream = io.StringIO()
    return stream, lambda: [json.loads(line) for line in stream.getvalue().splitlines()]
