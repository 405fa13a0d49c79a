"""A daemon around the stepped mock: two vehicles in this process, time moved by hand, everything said kept."""

import io
import json
import logging

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.clock import VirtualClock
from guidance.config import parse_document
from guidance.flight import Authority, State
from guidance.links import MemoryWire, SigningKey
from guidance.links.evaders.carriers import GLOBAL_POSITION
from guidance.links.evaders.mavlink import MavlinkEvader
from guidance.links.mavlink.frames import ticks
from guidance.links.mavlink.ground_link import GroundLink
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.links.wires.base import TappedWire, share
from guidance.log.sink import Sink
from guidance.session.fly.daemon import Daemon, Equipment
from guidance.session.fly.own_policy import asked_in_flight
from guidance.session.observe.ground_station import GroundStationOutput
from guidance.session.observe.log import say_outputs
from guidance.session.observe.metrics import Metrics
from guidance.session.observe.signs_of_life import Notifier
from guidance.session.orders.mailbox import Mailbox
from guidance.session.plan import plan_of
from guidance.session.vehicle_file import Config
from sitl_mock import Home, MockVehicle
from sitl_mock.mavlink import Signing
from tests.harness.sortie import Sorties, Staged
from tests.harness.vehicle import FENCED, document

HERE = Home(47.397742, 8.545594, 488.0)
UNIX_S = 1_800_000_000.0


@pytest.fixture(scope="session")
def vehicle_document():
    """Return a function that makes a configuration."""
    return document


class KeptLog(Sink):
    """A log that stores its lines for tests."""

    def __init__(self):
        self.lines = []

    def say(self, level, message, fields):
        self.lines.append((level, message, fields))

    def report(self, report):
        say_outputs(self, report.outputs)

    def messages(self, at_least=logging.DEBUG):
        return [message for level, message, _ in self.lines if level >= at_least]


class KeptNotifier(Notifier):
    def __init__(self):
        super().__init__({"WATCHDOG_USEC": "2000000"})
        self.said = []

    def send(self, text):
        self.said.append(text)


class Ordered(Staged):
    """One daemon, its vehicle and its evader; `source` makes another evader, which needs no vehicle.

    `link` makes another link, which brings its vehicle. With `stations` ground stations see the flight, and those with
    these system ids may order. `port` may put another wire before the link.
    """

    def __init__(
        self,
        *,
        parameters=FENCED,
        record=None,
        broadcast=None,
        record_required=False,
        source=None,
        link=None,
        key=None,
        stations=None,
        port=None,
        **sections,
    ):
        config = self.config = parse_document(Config, document(**sections), source="test")
        clock = VirtualClock()
        flavour = config.vehicle.autopilot
        options = {"home": HERE, "noise": False, "ready_after_s": 0.5}
        signed, prey_signed = (Signing(key, timestamp=ticks(UNIX_S)) for _ in range(2))
        self.vehicle = MockVehicle(
            flavour, system_id=1, parameters=parameters, signing=signed, **options
        )
        self.prey = MockVehicle(
            "px4", system_id=2, start_ned=(30.0, 0.0, 0.0), signing=prey_signed, **options
        )
        ours, self._end = MemoryWire.pair(clock.now_s)
        theirs, self._prey_end = MemoryWire.pair(clock.now_s)
        self.wire = wire = TappedWire(ours, clock.now_s, "uav1")
        signing = {"signing_key": None if key is None else SigningKey(key, UNIX_S)}
        self.ground = []
        if stations is not None:
            wire, ground_wire = share(wire, 2)
            names = {"system_id": 1, "stations": stations, **signing}
            self.ground.append(GroundLink(ground_wire, clock.now_s, **names))
        if port is not None:
            wire = port(wire)
        own = PymavlinkLink(wire, clock.now_s, system_id=1, **signing)
        self.link = own if link is None else link(clock)
        heard = MavlinkEvader(theirs, GLOBAL_POSITION, system_id=2, **signing)
        self.evader = heard if source is None else source(clock)
        self.mailbox = Mailbox()
        self.log = KeptLog()
        self.notifier = KeptNotifier()
        self.metrics = Metrics(config.name)
        self.prey_silent = False
        self.evader_here = source is None
        self.injected = []
        seen = [GroundStationOutput(link, self.mailbox, announce=True) for link in self.ground]
        used = Equipment(
            mailbox=self.mailbox,
            ask=asked_in_flight(config.game.policy, clock, real_time=False),
            record=record,
            record_required=record_required,
            sinks=[
                self.log,
                self.metrics,
                self.notifier,
                *seen,
                *([broadcast] if broadcast else ()),
            ],
        )
        self.daemon = Daemon(config.name, plan_of(config), self.link, {"evader": self.evader}, used)
        super().__init__(clock, self.daemon)

    def overheard(self, frame):
        """Send a frame on the vehicle's wire, beside the vehicle's own."""
        self._end.send(frame)

    def report(self, frame):
        """Send a frame on the evader's wire."""
        self._prey_end.send(frame)

    def advance(self):
        for frame in self.vehicle.step(
            self.now_s, [*(f for _, f in self._end.receive()), *self.injected]
        ):
            self._end.send(frame)
        self.injected = []
        if self.evader_here:
            for frame in self.prey.step(self.now_s, []):
                if not self.prey_silent:
                    self.report(frame)

    def act(self, orders):
        return self.daemon.step(self.now_s)

    def passed(self):
        return self.wire.drain()

    def order(self, word, authority=Authority.OPERATOR):
        """Give an order, run the cycles until it is answered, return the answer."""
        question = self.mailbox.ask(word, authority=authority)
        deadline_s = self.now_s + 2.0
        while not question.done():
            assert self.now_s < deadline_s, f"{word} was not answered"
            self.cycle()
        return question.result()

    def start(self):
        assert self.order("start")["accepted"]
        return self.until(State.STANDING_BY)

    def engage(self):
        assert self.order("engage")["accepted"]
        return self.until(State.ENGAGED)

    def arrive(self):
        return self.until(State.ON_STATION)

    def history(self):
        return [*super().history(), *self.log.lines]

    def setpoints_since(self, since_s):
        return [sent.message for sent in self.setpoints if sent.now_s >= since_s]

    def commands_since(self, since_s):
        return [
            one.message.command
            for one in self.sent
            if one.now_s >= since_s and one.name == "COMMAND_LONG"
        ]

    def close(self):
        self.link.close()
        self.evader.close()

    def inject_setpoint(self, velocity):
        """Another program on the vehicle's link sends a setpoint of its own."""
        other = mavlink.MAVLink(None, 1, 191)
        message = mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, 0b0000_1101_1100_0111, 0, 0, 0, *velocity, 0, 0, 0, 0, 0
        )
        self.injected.append(message.pack(other))


@pytest.fixture(scope="session")
def bases():
    return Sorties(Ordered)


@pytest.fixture
def base(bases):
    """Make daemons; everything is closed at the end."""
    yield bases
    bases.close()


@pytest.fixture
def text_log():
    """Return a stream for the log, and a function that reads it as JSON rows."""
    stream = io.StringIO()
    return stream, lambda: [json.loads(line) for line in stream.getvalue().splitlines()]
