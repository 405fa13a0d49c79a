"""Flights against evaders whose reports have a wrong zero, clock, velocity or frame: what is done, and what is said."""

import math
import time

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.autopilots import Verdict
from guidance.flight import State
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.links import MemoryWire
from guidance.links.evaders.carriers import GLOBAL_POSITION, RefusedReport, carrier_of
from guidance.links.evaders.mavlink import MavlinkEvader
from guidance.links.evaders.zenoh import open_source_patiently, read_ros
from guidance.log.entries import EVADER_NEWS
from guidance.messages import Datum
from tests.links.evaders.test_zenoh import Cdr
from tests.links.rigs import free_port
from tests.session.conftest import HERE

pytestmark = pytest.mark.flight

UNDULATION_M = 47.0
FRAME = LocalFrame(HERE[0], HERE[1], Amsl(HERE[2]), undulation_m=UNDULATION_M)
SPEED_M_S = 1.5
NORTH_M = 30.0


class Reporting:
    """An evader that sends the MAVLink messages of `make(now_s)` ten times a second."""

    def __init__(self, clock, carrier, make):
        self.clock = clock
        self.make = make
        self.next_s = 0.0
        ours, self.radio = MemoryWire.pair(clock.now_s)
        self.source = MavlinkEvader(ours, carrier, system_id=2)
        self.packer = mavlink.MAVLink(None, 2, 1)

    def receive(self):
        if self.clock.now_s() >= self.next_s:
            self.next_s += 0.1
            self.radio.send(self.make(self.clock.now_s()).pack(self.packer))
        return self.source.receive()

    def counters(self):
        return self.source.counters()

    def close(self):
        self.source.close()


def global_position(now_s, *, stamp_ms=None, velocity_m_s=SPEED_M_S, altitude_m=HERE[2]):
    latitude, longitude, _ = FRAME.wgs84_from_ned(Ned((NORTH_M, SPEED_M_S * (now_s - 20.0), 0.0)))
    return mavlink.MAVLink_global_position_int_message(
        round(1e3 * now_s if stamp_ms is None else stamp_ms) % 2**32,
        round(latitude * 1e7),
        round(longitude * 1e7),
        round(1e3 * altitude_m),
        0,
        0,
        round(100 * velocity_m_s),
        0,
        65535,
    )


def follow_target(now_s, altitude_m):
    latitude, longitude, _ = FRAME.wgs84_from_ned(Ned((NORTH_M, 0.0, 0.0)))
    return mavlink.MAVLink_follow_target_message(
        round(1e3 * now_s),
        1,
        round(latitude * 1e7),
        round(longitude * 1e7),
        altitude_m,
        *([0.0] * 3, [0.0] * 3, [1.0, 0.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3, 0),
    )


def sample(one, name, **labels):
    return one.metrics.registry.get_sample_value(name, {"vehicle": one.daemon.name, **labels})


def by(carrier, make):
    return lambda clock: Reporting(clock, carrier, make)


@pytest.mark.parametrize("offset_m", [-20.0, 20.0])
def test_an_evader_above_another_zero_is_not_engaged(base, offset_m):
    carrier = carrier_of("follow_target", FRAME)
    one = base(source=by(carrier, lambda now_s: follow_target(now_s, HERE[2] + offset_m)))
    one.run(12.0)
    assert one.state is not State.STANDING_BY
    rows = {row.name: row.verdict for row in one.daemon.survey.rows}
    assert rows["evader's altitude"] is Verdict.REFUSE


def test_a_wrong_zero_that_is_heard_after_take_off_bars_the_engagement(base):
    late = []

    def make(now_s):
        return global_position(now_s, altitude_m=HERE[2] - 20.0 if late else HERE[2])

    one = base(source=by(GLOBAL_POSITION, make)).standing_by()
    late.append(True)
    one.run(6.0)
    reason = one.order("engage")["reason"]
    assert "m below home's ground; at most 2.5 m is allowed" in reason
    assert "evader.altitude_datum" in reason
    assert one.state is State.STANDING_BY


def test_with_the_datum_declared_a_height_above_the_ellipsoid_is_right(base):
    carrier = carrier_of("follow_target", FRAME, datum=Datum.ELLIPSOID)
    make = by(carrier, lambda now_s: follow_target(now_s, HERE[2] + UNDULATION_M))
    one = base(source=make).engaged()
    evader = one.daemon.flight.tracking.evader(one.now_s)
    assert evader.position_ned_m[2] == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize(
    "stamp_ms", [lambda _: 12345, lambda now_s: 500 * now_s], ids=["constant", "half speed"]
)
def test_without_a_plausible_clock_the_arrival_times_are_used_and_that_is_said(base, stamp_ms):
    make = by(GLOBAL_POSITION, lambda now_s: global_position(now_s, stamp_ms=stamp_ms(now_s)))
    one = base(source=make).engaged()
    one.run(3.0)
    north, east, _ = one.daemon.flight.tracking.evader(one.now_s).position_ned_m
    assert math.hypot(north - NORTH_M, east - SPEED_M_S * (one.now_s - 20.0)) < 0.3
    (said,) = [words for words in one.log.messages() if "its clock runs at" in words]
    assert said.endswith("ages count from arrival")
    (doubt,) = one.order("status")["evader_doubts"]
    assert doubt.startswith("its clock runs at")
    assert sample(one, "guidance_events_total", event=EVADER_NEWS) == 1.0


def test_duplicate_stamps_are_counted_and_named_in_the_refusal(base):
    stamp_ms = []

    def make(now_s):
        return global_position(now_s, stamp_ms=stamp_ms[0] if stamp_ms else None)

    one = base(source=by(GLOBAL_POSITION, make)).standing_by()
    stamp_ms.append(round(1e3 * one.now_s))
    one.run(3.0)
    reason = one.order("engage")["reason"]
    assert 'its reports still arrive, and are dropped as "stale"' in reason
    dropped = one.order("status")["evader_reports_dropped"]
    assert dropped["duplicate"] > 10
    assert dropped["stale"] > 3
    counted = {"link": "evader", "what": "dropped_duplicate"}
    assert sample(one, "guidance_link_total", **counted) > 10.0


def test_a_velocity_that_contradicts_the_positions_is_dropped_and_that_is_said(base):
    make = by(GLOBAL_POSITION, lambda now_s: global_position(now_s, velocity_m_s=-SPEED_M_S))
    one = base(source=make).engaged()
    one.run(2.0)
    evader = one.daemon.flight.tracking.evader(one.now_s)
    assert evader.velocity_ned_m_s == pytest.approx((0.0, SPEED_M_S, 0.0), abs=0.1)
    (said,) = [words for words in one.log.messages() if "its velocities contradict" in words]
    assert "by 3.0 m/s" in said


class Posing:
    """An evader that sends ROS poses in the frame `odom`."""

    def __init__(self, clock):
        self.clock = clock
        self.refused = 0
        self.reason = ""

    def receive(self):
        pose = Cdr("<").put("i", 0).put("I", 0).text("odom").put("d", *[0.0] * 6, 1.0).done()
        with pytest.raises(RefusedReport) as caught:
            read_ros(pose, self.clock.now_s(), frame=FRAME, moves=False)
        self.refused += 1
        self.reason = str(caught.value)
        return []

    def counters(self):
        return {"reports": 0, f"refused_{self.reason}": self.refused}

    def close(self):
        """Nothing is open."""


def test_the_frame_that_was_heard_is_named_in_the_answer(base):
    one = base(source=Posing).standing_by()
    reason = one.order("engage")["reason"]
    assert 'frame_id "odom" instead of evader.frame_id = "map"' in reason


def test_a_router_that_is_down_is_a_warning_that_names_it(base):
    port = free_port()
    url = f"zenoh://127.0.0.1:{port}/evader"

    def make(clock):
        return open_source_patiently("json", url, clock=clock.now_s, frame=FRAME)

    begun_s = time.monotonic()
    one = base(source=make)
    assert time.monotonic() - begun_s < 3.0
    one.standing_by()
    assert (
        f"the Zenoh router of its reports, 127.0.0.1:{port}, does not answer"
        in (one.order("engage")["reason"])
    )
    (row,) = [row for row in one.daemon.survey.rows if row.name == "evader's source"]
    assert row.verdict is Verdict.WARN
    assert str(port) in row.value
