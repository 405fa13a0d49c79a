"""Whole flights by what an evader says: signed, where the vehicle's link is; by ROS 2; by remote identification."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.flight import State
from guidance.frames import Amsl, LocalFrame
from guidance.links import MemoryWire
from guidance.links.evaders.carriers import carrier_of
from guidance.links.evaders.mavlink import MavlinkEvader
from guidance.links.evaders.zenoh import read_ros
from tests.links.evaders.test_mavlink import drone_id
from tests.links.evaders.test_zenoh import Cdr
from tests.session.conftest import HERE

KEY = bytes(range(32))
UNDULATION_M = 47.0
FRAME = LocalFrame(HERE[0], HERE[1], Amsl(HERE[2]), undulation_m=UNDULATION_M)
EAST_M_S = 1.5
RADIUS_M = 6.0
TOLERANCE_M = 0.5


def place(now_s):
    """Who walks, 30 m north of home: metres north, east, down."""
    return 30.0, EAST_M_S * (now_s - 15.0), 0.0


class BySource:
    """An evader whose reports come at a rate, read from its own bytes by `say`."""

    def __init__(self, clock, rate_hz, say):
        self.clock = clock
        self.period_s = 1.0 / rate_hz
        self.next_s = 0.0
        self.say = say

    def receive(self):
        now_s = self.clock.now_s()
        if now_s < self.next_s:
            return ()
        self.next_s += self.period_s
        return self.say(now_s, place(now_s))

    def counters(self):
        return {}

    def close(self):
        """Nothing is open."""


def ros(clock):
    """nav_msgs/Odometry at 10 Hz: east, north, up in `map`, the velocity in the axes of a body that heads east."""

    def say(now_s, ned_m):
        north, east, down = ned_m
        seconds = math.floor(now_s)
        cdr = (
            Cdr("<")
            .put("i", seconds)
            .put("I", round((now_s - seconds) * 1e9))
            .text("map")
            .text("base_link")
        )
        cdr.put("d", east, north, -down, 0.0, 0.0, 0.0, 1.0)
        body = cdr.put("d", *[0.01] * 36, EAST_M_S, 0.0, 0.0, 0.0, 0.0, 0.0, *[0.01] * 36).done()
        return [read_ros(body, now_s, frame=FRAME, moves=True)]

    return BySource(clock, 10.0, say)


def remote_id(clock):
    """OPEN_DRONE_ID_LOCATION once a second: the height above the ellipsoid, the seconds of the hour."""
    ours, radio = MemoryWire.pair(clock.now_s)
    source = MavlinkEvader(ours, carrier_of("open_drone_id", FRAME), system_id=9)
    sender = mavlink.MAVLink(None, 9, 1)

    def say(now_s, ned_m):
        latitude, longitude, altitude = FRAME.wgs84_from_ned(ned_m)
        message = drone_id(
            latitude=round(latitude * 1e7),
            longitude=round(longitude * 1e7),
            timestamp=(3590.0 + now_s) % 3600.0,
            altitude_geodetic=altitude.metres + UNDULATION_M,
            direction=9000,
            speed_horizontal=round(100 * EAST_M_S),
            speed_vertical=0,
        )
        radio.send(message.pack(sender))
        return source.receive()

    return BySource(clock, 1.0, say)


@pytest.mark.parametrize("source", [ros, remote_id])
def test_who_walks_is_come_to_and_kept_off_by_what_it_says_in_its_own_words(base, source):
    """Catches an evader source that shifts, delays or drops its reports on the way to the flight."""
    one = base(source=source).engaged()
    nearest_m = math.inf
    while one.state is not State.ON_STATION:
        one.cycle()
        away_m = math.dist(one.vehicle.truth.position_ned_m[:2], place(one.now_s)[:2])
        nearest_m = min(nearest_m, away_m)
        assert one.state in {State.ENGAGED, State.ON_STATION}
        assert one.now_s < 40.0
    assert nearest_m > RADIUS_M - 1.0
    assert away_m < RADIUS_M + TOLERANCE_M + 0.5


def test_on_a_signed_link_nobody_is_pursued_whose_reports_are_not_signed(base):
    """Catches a forged evader on a signed link."""
    one = base(key=KEY)
    one.prey.autopilot.signing.set_key(None)
    one.standing_by()
    assert one.order("engage")["reason"].startswith("the evader was never heard")
    assert one.evader.counters()["unsigned"] > 100
    one.prey.autopilot.signing.set_key(KEY)
    one.prey.autopilot.signing.timestamp = one.vehicle.autopilot.signing.timestamp
    one.run(0.5)
    assert one.order("engage")["accepted"]
    one.until(State.ENGAGED)
    forger = mavlink.MAVLink(None, 2, 1)
    heard = one.evader.counters()["unsigned"]
    cycles = 100
    each = 4
    for _ in range(cycles):
        for _ in range(each):
            elsewhere = mavlink.MAVLink_global_position_int_message(
                round(1e3 * one.now_s), 473980000, 85470000, 488000, 0, 0, 0, 0, 0
            )
            one.report(elsewhere.pack(forger))
        one.cycle()
        assert one.state is State.ENGAGED
        north, east, _ = one.daemon.flight.tracking.evader(one.now_s).position_ned_m
        assert math.hypot(north - 30.0, east) < 0.5
    assert one.evader.counters()["unsigned"] == heard + cycles * each
