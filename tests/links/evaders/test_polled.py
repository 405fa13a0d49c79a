from guidance.clock import VirtualClock
from guidance.links import MemoryWire
from guidance.links.carriers import GLOBAL_POSITION
from guidance.links.mavlink_evader import ASK_AGAIN_S, MavlinkEvader
from sitl_mock import Home, MockVehicle


class Rover:
    """A rover that sends only HEARTBEAT until reports are requested, and the source that requests them."""

    def __init__(self):
        self.clock = VirtualClock()
        home = Home(47.397742, 8.545594, 488.0)
        self.vehicle = MockVehicle("rover", system_id=2, home=home, noise=False, ready_after_s=0.5)
        ours, self._end = MemoryWire.pair(self.clock.now_s)
        clock = self.clock.now_s
        self.evader = MavlinkEvader(ours, GLOBAL_POSITION, system_id=2, clock=clock, request_rate_hz=20.0)
        self.silent = False

    def run(self, seconds):
        reports = []
        for _ in range(round(seconds / 0.02)):
            self.clock.sleep_until(self.clock.now_s() + 0.02)
            for frame in self.vehicle.step(self.clock.now_s(), [frame for _, frame in self._end.receive()]):
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
    assert rover.evader.counters()["requests_sent"] == asked  # while it reports, nothing is asked again


def test_an_evader_that_fell_silent_is_asked_again_until_it_is_back():
    rover = Rover()
    rover.run(3.0)
    asked = rover.evader.counters()["requests_sent"]
    rover.silent = True
    assert rover.run(2.0 * ASK_AGAIN_S) == []
    assert rover.evader.counters()["requests_sent"] > asked
    rover.silent = False
    assert rover.run(2.0)
    rover.evader.close()
    rover.evader.close()
    assert rover.evader.receive() == []
