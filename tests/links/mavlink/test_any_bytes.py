"""Bytes from a wire never raise and never become implausible values, with a right or wrong checksum."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from guidance.frames import Amsl, LocalFrame
from guidance.links import MemoryWire
from guidance.links.evaders.carriers import carrier_of
from guidance.links.evaders.mavlink import MavlinkEvader
from guidance.links.mavlink.frames import FrameReader
from guidance.links.mavlink.pymavlink_link import USED, PymavlinkLink
from guidance.messages import Attitude, GlobalPosition, Home, LocalPosition, Origin
from tests.harness.examples import drawn
from tests.links.mavlink.any_frame import MESSAGES, framed
from tests.links.peer import Peer

FRAME = LocalFrame(47.0, 8.0, Amsl(488.0), undulation_m=47.0)


def places(message) -> list[float]:
    if isinstance(message, LocalPosition):
        return [*message.position_ned_m, *message.velocity_ned_m_s]
    if isinstance(message, GlobalPosition | Home | Origin):
        return [message.latitude_deg, message.longitude_deg, message.altitude_amsl_m]
    return [message.yaw_rad] if isinstance(message, Attitude) else []


@settings(max_examples=drawn(300))
@given(
    st.lists(
        st.tuples(st.sampled_from(sorted(USED)), st.binary(min_size=1, max_size=255)), max_size=8
    )
)
def test_any_payload_in_a_valid_frame_is_a_message_or_counted(said):
    ours, theirs = MemoryWire.pair(lambda: 3.0)
    link = PymavlinkLink(ours, lambda: 3.0, system_id=1)
    for name, payload in said:
        theirs.send(framed(name, payload))
    for message in link.receive():
        assert message.received_s == 3.0
        assert all(map(math.isfinite, places(message)))
    counters = link.counters()
    assert counters["received"] + counters["refused"] == len(said)
    assert counters["garbage_bytes"] == 0


@settings(max_examples=drawn(300))
@given(st.sampled_from(sorted(MESSAGES)), st.binary(min_size=1, max_size=255))
def test_any_payload_of_any_message_is_decoded_as_by_pymavlink(name, payload):
    reader = FrameReader()
    (frame,) = reader.read(framed(name, payload))
    assert frame.name == frame.fields.msgname == name
    theirs = dialect.MAVLink(None).decode(bytearray(frame.data))
    decoded = {field: getattr(theirs, field) for field in theirs.fieldnames}
    assert repr(frame.fields._asdict()) == repr(
        {field: decoded[field] for field in theirs.ordered_fieldnames}
    )
    assert (reader.garbage_bytes, reader.unknown) == (0, 0)


@settings(max_examples=drawn(200))
@given(st.lists(st.binary(max_size=80), max_size=10))
def test_any_bytes_leave_the_link_working(pieces):
    ours, theirs = MemoryWire.pair(lambda: 3.0)
    link = PymavlinkLink(ours, lambda: 3.0, system_id=1)
    for piece in pieces:
        theirs.send(piece)
    assert link.receive() == []
    Peer(theirs.send).local_position(7)
    assert len(link.receive()) == 1


@pytest.mark.parametrize(
    "carrier", ["follow_target", "global_position", "odometry", "open_drone_id", "adsb"]
)
def test_any_payload_of_an_evader_is_a_plausible_report_or_refused(carrier):
    @settings(max_examples=drawn(200))
    @given(st.lists(st.binary(min_size=1, max_size=255), min_size=1, max_size=4))
    def whatever(payloads):
        ours, theirs = MemoryWire.pair(lambda: 3.0)
        made = carrier_of(carrier, FRAME, icao_address=0)
        source = MavlinkEvader(ours, made, system_id=9)
        for payload in payloads:
            theirs.send(framed(made.message, payload, system_id=9))
        reports = source.receive()
        for report in reports:
            assert abs(report.latitude_deg) <= 90.0
            assert abs(report.longitude_deg) <= 180.0
            assert abs(report.altitude_amsl_m) < 1.1e5
            known = [math.isfinite(part) for part in report.velocity_ned_m_s]
            assert all(known) or not any(known)
            assert not report.position_sd_m <= 0.0
        assert source.counters()["reports"] == len(reports) <= len(payloads)

    whatever()
