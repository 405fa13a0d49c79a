import pytest
from pymavlink.dialects.v20 import common as dialect

from guidance.clock import VirtualClock
from guidance.links import MemoryWire
from guidance.links.evaders.carriers import GLOBAL_POSITION
from guidance.links.evaders.mavlink import RATE_AGAIN_S, MavlinkEvader
from sitl_mock import Home, MockVehicle
from tests.links.peer import Peer


class Rover:
    """A rover that sends only HEARTBEAT until reports are requested, and the source that requests them."""

    def __init__(self, asked_system_id=2):
        self.clock = VirtualClock()
        home = Home(47.397742, 8.545594, 488.0)
        self.vehicle = MockVehicle("rover", system_id=2, home=home, noise=False, ready_after_s=0.5)
        ours, self._end = MemoryWire.pair(self.clock.now_s)
        clock = self.clock.now_s
        self.evader = MavlinkEvader(
            ours, GLOBAL_POSITION, system_id=asked_system_id, clock=clock, request_rate_hz=20.0
        )
        self.silent = False

    def run(self, seconds):
        reports = []
        for _ in range(round(seconds / 0.02)):
            self.clock.sleep_until(self.clock.now_s() + 0.02)
            for frame in self.vehicle.step(
                self.clock.now_s(), [frame for _, frame in self._end.receive()]
            ):
                if not self.silent:
                    self._end.send(frame)
            reports += self.evader.receive()
        return reports


def test_an_evader_that_is_asked_reports_at_the_rate_it_was_asked_for():
    rover = Rover()
    rover.run(2.0)
    assert 38 <= len(rover.run(2.0)) <= 42
    asked = rover.evader.counters()["requests_sent"]
    rover.run(10.0)
    # While it reports, nothing is asked again
    assert rover.evader.counters()["requests_sent"] == asked


def test_if_the_wrong_system_is_asked_the_one_that_is_there_is_named():
    """Catches a wrong evader.system_id of an evader that reports only when it is asked."""
    rover = Rover(asked_system_id=3)
    rover.run(6.0)
    assert "Heard: system 2, component 1; see evader.system_id" in rover.evader.problem()
    assert rover.evader.counters()["foreign"] == 0


def test_an_evader_that_is_there_and_does_not_report_is_no_wrong_one():
    evader = Slow(20.0, reports=False)
    other = Peer(evader.peer.send, system_id=7)
    for _ in range(6):
        evader.peer.say(heartbeat())
        other.say(heartbeat())
        evader.run(1.0)
    assert evader.evader.problem() == ""


def heartbeat():
    return dialect.MAVLink_heartbeat_message(10, 3, 0, 0, 4, 3)


def test_an_evader_that_fell_silent_is_asked_again_until_it_is_back():
    rover = Rover()
    rover.run(3.0)
    asked = rover.evader.counters()["requests_sent"]
    rover.silent = True
    assert rover.run(2.0 * RATE_AGAIN_S) == []
    assert rover.evader.counters()["requests_sent"] > asked
    rover.silent = False
    assert rover.run(2.0)
    rover.evader.close()
    rover.evader.close()
    assert rover.evader.receive() == []


class Slow:
    """An evader that begins its interval again with each request, as an autopilot may. It can be silent."""

    def __init__(self, rate_hz, *, acks_to=(255, 195), reports=True):
        self.clock = VirtualClock()
        self.period_s = 1.0 / rate_hz
        self.acks_to = acks_to
        self.reports = reports
        ours, self._end = MemoryWire.pair(self.clock.now_s)
        self.peer = Peer(self._end.send, system_id=2)
        self.peer.answers = False
        now_s = self.clock.now_s
        self.evader = MavlinkEvader(
            ours, GLOBAL_POSITION, system_id=2, clock=now_s, request_rate_hz=rate_hz
        )
        self.asked_s = []
        self._due_s = None

    def run(self, seconds):
        got = []
        for _ in range(round(seconds / 0.02)):
            self.clock.sleep_until(self.clock.now_s() + 0.02)
            now_s = self.clock.now_s()
            for _, frame in self._end.receive():
                self.peer.hear(frame)
            for request in self.peer.of("COMMAND_LONG"):
                assert (request.command, request.param1, request.get_srcSystem()) == (
                    511,
                    33.0,
                    255,
                )
                self.asked_s.append(now_s)
                self._due_s = now_s + self.period_s
                if self.acks_to is not None:
                    self.peer.say(dialect.MAVLink_command_ack_message(511, 0, 0, 0, *self.acks_to))
            self.heard = list(self.peer.heard)
            self.peer.heard.clear()
            if self.reports and self._due_s is not None and now_s >= self._due_s:
                self._due_s += self.period_s
                self.peer.say(
                    dialect.MAVLink_global_position_int_message(
                        round(now_s * 1e3), 473977418, 85455939, 1, 0, 1, 2, 3, 0
                    )
                )
            got += self.evader.receive()
        return got


@pytest.mark.parametrize("rate_hz", [0.5, 0.7, 1.0, 2.0])
def test_a_slow_evader_that_begins_its_interval_again_when_asked_does_report(rate_hz):
    evader = Slow(rate_hz)
    assert len(evader.run(12.0)) >= round(12.0 * rate_hz) - 1
    assert len(evader.asked_s) == 1


def test_a_request_that_was_acknowledged_is_not_repeated_before_the_next_silence():
    evader = Slow(20.0, reports=False)
    evader.run(12.0)
    assert evader.asked_s == pytest.approx([0.0, 3.0, 6.0, 9.0], abs=0.1)


@pytest.mark.parametrize("acks_to", [None, (255, 190), (7, 195)])
def test_a_request_is_repeated_four_times_until_it_is_acknowledged_to_us(acks_to):
    evader = Slow(20.0, acks_to=acks_to, reports=False)
    evader.run(5.5)
    expected = [begun_s + 0.5 * n for begun_s in (0.0, 3.0) for n in range(4)]
    assert evader.asked_s == pytest.approx(expected, abs=0.15)


def test_an_evader_that_is_asked_gets_answers_to_its_timesync():
    evader = Slow(20.0)
    evader.run(0.1)
    evader.peer.say(dialect.MAVLink_timesync_message(0, 12345))
    evader.run(0.04)
    assert [message.ts1 for message in evader.heard if message.get_type() == "TIMESYNC"][:1] == [
        12345
    ]


def test_acknowledgements_of_the_vehicle_on_a_shared_wire_are_not_counted_as_foreign():
    evader = Slow(20.0)
    evader.peer.say(dialect.MAVLink_command_ack_message(400, 0), system_id=1)
    evader.run(0.1)
    assert evader.evader.counters()["foreign"] == 0
