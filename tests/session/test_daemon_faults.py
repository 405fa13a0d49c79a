"""The daemon outlives nonsense from the wire and errors of its own, and leaves the vehicle in good hands."""

import math
import random
import struct
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.clock import VirtualClock
from guidance.flight import State
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.session.fly.loop import run
from guidance.session.observe.recording import Recording

BAD_FLOATS = (math.nan, math.inf, -math.inf, 1e38, -1e38)
BAD_INTEGERS = (0, -1, 2**31 - 1, -(2**31), 255, 65535)


def corrupted(frame, chance):
    """Return a frame with one field that has another value, another field's value, or another unit's."""
    fields = frame.fields._asdict()
    name = chance.choice(list(fields))
    value = fields[name]
    if not isinstance(value, (int, float)) or name.startswith("target_"):
        return frame
    how = chance.random()
    if how < 0.6:
        bad = chance.choice(BAD_FLOATS if isinstance(value, float) else BAD_INTEGERS)
    elif how < 0.8:
        bad = value * 1000
    else:
        bad = next(
            (other for other in fields.values() if type(other) is type(value) and other != value),
            value,
        )
    message = mavlink.MAVLink(None, frame.system_id, frame.component_id)
    try:
        return frame._replace(data=bytes(frame.kind(**fields | {name: bad}).pack(message)))
    except struct.error:  # no such number fits
        return frame


@pytest.mark.flight
@pytest.mark.parametrize(
    ("autopilot", "seed"), [("px4", 0), pytest.param("arducopter", 1, marks=pytest.mark.long)]
)
def test_a_whole_flight_on_a_wire_that_spoils_one_number_in_thirty_messages(
    base, monkeypatch, autopilot, seed
):
    fenced = {"GUID_TIMEOUT": 1.0, "FENCE_ENABLE": 1.0, "FENCE_RADIUS": 150.0}
    given = {"parameters": fenced} if autopilot == "arducopter" else {}
    chance = random.Random(seed)
    hear = PymavlinkLink.hear
    one = base(vehicle={"autopilot": autopilot}, **given)

    def heard(link, frame, received_s):
        # HEARTBEAT is spared: another mode in it means that a pilot took over, which ends the flight.
        spoilt = frame.name != "HEARTBEAT" and chance.random() < 1.0 / 30.0
        hear(link, corrupted(frame, chance) if spoilt else frame, received_s)

    one.standing_by()
    monkeypatch.setattr(PymavlinkLink, "hear", heard)
    one.order("engage")
    begun_s = one.now_s
    one.run(15.0)
    assert one.daemon.flight.fault is None
    limits = one.daemon.flight.observed.cycle.envelope
    setpoints = one.setpoints_since(begun_s)
    assert setpoints
    for setpoint in setpoints:
        assert math.hypot(setpoint.vx, setpoint.vy) <= limits.speed_m_s + 1e-3
        assert -limits.climb_m_s - 1e-3 <= setpoint.vz <= limits.descent_m_s + 1e-3
    assert one.link.counters()["invalid"] > 5
    assert one.order("status")["accepted"]


def test_an_error_outside_the_flight_releases_the_vehicle_and_the_daemon_answers(base):
    """Catches an error outside the flight that goes on commanding."""
    one = base.engaged()
    since_s = one.now_s
    one.daemon.survive(KeyError("a part of ours"), one.now_s)
    one.run(3.0)
    assert one.state is State.YIELDED
    assert one.commands_since(since_s)[:1] == [176]
    assert one.setpoints_since(since_s + 1e-6) == []
    assert one.daemon.flight.mode_name == "hold"
    assert ("an error of guidance itself", {"error": "KeyError: 'a part of ours'"}) in [
        (message, fields) for _, message, fields in one.log.lines
    ]
    refused = one.order("engage")
    assert refused["reason"] == (
        "guidance failed (KeyError: 'a part of ours'), and is silent since: order reset to begin another"
    )
    one.order("reset")
    assert one.state is State.CONNECTING
    assert one.daemon.flight.fault is None


def test_the_loop_goes_on_after_a_cycle_that_failed():
    class World:
        real_time = True

        def advance(self):
            pass

        def drain(self):
            return ()

    class Failing:
        name = "uav1"
        finished = False
        flight = SimpleNamespace(vehicle=SimpleNamespace(silence_s=lambda *_: math.inf))
        recording = Recording(name)

        def __init__(self):
            self.cycles = 0
            self.survived = []

        def step(self, now_s, _):
            self.cycles += 1
            self.finished = self.cycles == 5
            if self.cycles in {2, 3}:
                raise RuntimeError(f"cycle {self.cycles}")

        def survive(self, error, now_s):
            self.survived.append((str(error), round(now_s, 3)))

    daemon = Failing()
    clock = VirtualClock()
    run([daemon], World(), clock)
    assert daemon.survived == [("cycle 2", 0.02), ("cycle 3", 0.04)]
    assert daemon.cycles == 5
