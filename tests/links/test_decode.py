"""Frames to fields, beside pymavlink; fields to values."""

import math
import struct

import pytest
from fastcrc import crc16
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from guidance.links.decode import DECODERS, decode, parameter
from guidance.links.framing import CRC_EXTRA, fields_of, first_frame
from guidance.messages import (
    FenceCount,
    FenceItem,
    FenceRefused,
    GlobalPosition,
    Heartbeat,
    Home,
    LocalPosition,
    SystemStatus,
)


def test_every_message_that_is_decoded_exists_with_these_fields_in_the_dialect():
    names = {message.msgname: message for message in dialect.mavlink_map.values()}
    for name in DECODERS:
        zeros = dict.fromkeys(names[name].fieldnames, 0) | {"lat": 1, "latitude": 1, "x": 1, "mission_type": 1}
        assert decode(name, zeros, 3.0).received_s == 3.0


def test_a_heartbeat_says_mode_and_armed():
    fields = dialect.MAVLink_heartbeat_message(2, 12, 128 | 29, 6 << 16, 4, 3).to_dict()
    assert decode("HEARTBEAT", fields, 1.0) == Heartbeat(1.0, 6 << 16, True, 4, 12)
    assert not decode("HEARTBEAT", {**fields, "base_mode": 29}, 1.0).armed


def test_units_become_metres_seconds_and_degrees():
    position = dialect.MAVLink_global_position_int_message(2500, 473977418, -85455939, 488125, 20250, 150, -25, 75, 0)
    assert decode("GLOBAL_POSITION_INT", position.to_dict(), 9.0) == GlobalPosition(
        9.0, 2.5, 47.3977418, -8.5455939, 488.125, 20.25, (1.5, -0.25, 0.75)
    )
    local = dialect.MAVLink_local_position_ned_message(1500, 1.0, 2.0, -3.0, 0.5, -0.5, 0.25).to_dict()
    expected = LocalPosition(9.0, 1.5, (1.0, 2.0, -3.0), (0.5, -0.5, 0.25))
    assert decode("LOCAL_POSITION_NED", local, 9.0) == expected


@pytest.mark.parametrize("field", ["x", "y", "z", "vx", "vy", "vz"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_local_position_that_is_not_finite_is_none(field, bad):
    fields = dialect.MAVLink_local_position_ned_message(1, 1, 2, 3, 4, 5, 6).to_dict() | {field: bad}
    with pytest.raises(ValueError, match=f"{bad}.*cannot be meant"):
        decode("LOCAL_POSITION_NED", fields, 0.0)


@pytest.mark.parametrize(("lat", "lon"), [(0, 0), (2**31 - 1, 2**31 - 1), (900000001, 1), (1, 1800000001)])
@pytest.mark.parametrize("name", ["GLOBAL_POSITION_INT", "HOME_POSITION", "GPS_GLOBAL_ORIGIN"])
def test_places_that_are_none_are_refused(name, lat, lon):
    message = next(message for message in dialect.mavlink_map.values() if message.msgname == name)
    fields = dict.fromkeys(message.fieldnames, 0) | {"lat": lat, "latitude": lat, "lon": lon, "longitude": lon}
    with pytest.raises(ValueError, match=r"fix|globe"):
        decode(name, fields, 0.0)


def test_items_of_the_fence_are_read_and_those_of_other_plans_are_not():
    item = dialect.MAVLink_mission_item_int_message(
        1, 195, 3, 0, 5001, 0, 1, 4.0, 0, 0, 0, 473977418, -85455939, 0.0, 1
    ).to_dict()
    assert decode("MISSION_ITEM_INT", item, 2.0) == FenceItem(2.0, 3, 5001, 4.0, 47.3977418, -8.5455939)
    count = dialect.MAVLink_mission_count_message(1, 195, 7, 1).to_dict()
    assert decode("MISSION_COUNT", count, 2.0) == FenceCount(2.0, 7)
    ack = dialect.MAVLink_mission_ack_message(1, 195, 3, 1).to_dict()
    assert decode("MISSION_ACK", ack, 2.0) == FenceRefused(2.0, 3)
    for name, fields in (("MISSION_ITEM_INT", item), ("MISSION_COUNT", count), ("MISSION_ACK", ack)):
        with pytest.raises(ValueError, match="mission_type 0: only the fence is read"):
            decode(name, {**fields, "mission_type": 0}, 2.0)
    with pytest.raises(ValueError, match="neither a number of corners nor a radius"):
        decode("MISSION_ITEM_INT", {**item, "param1": math.nan}, 2.0)


def test_a_home_without_a_local_position_is_still_a_home():
    fields = dialect.MAVLink_home_position_message(470000000, 80000000, 488000, *[math.nan] * 3, [1, 0, 0, 0], 0, 0, 0)
    home = decode("HOME_POSITION", fields.to_dict(), 0.0)
    assert isinstance(home, Home)
    assert home.altitude_amsl_m == 488.0
    assert all(map(math.isnan, home.position_ned_m))


@pytest.mark.parametrize(("percent", "expected"), [(-1, math.nan), (0, 0.0), (55, 0.55), (100, 1.0), (101, math.nan)])
def test_an_unknown_battery_is_nan_and_never_full(percent, expected):
    fields = dict.fromkeys(dialect.MAVLink_sys_status_message.fieldnames, 0) | {"battery_remaining": percent}
    status = decode("SYS_STATUS", fields, 0.0)
    assert isinstance(status, SystemStatus)
    assert status.battery_remaining == pytest.approx(expected, nan_ok=True)


@given(st.integers(-(2**31), 2**31 - 1))
def test_px4_integers_are_bytes_in_a_float_and_ardupilots_are_numbers(value):
    (as_float,) = struct.unpack("<f", struct.pack("<i", value))
    fields = {"param_id": "P", "param_type": 6, "param_value": as_float, "param_integer": value}
    assert parameter(fields, 0.0, autopilot=12).value == value
    assert parameter({**fields, "param_value": 7.0}, 0.0, autopilot=3).value == 7.0
    assert parameter({**fields, "param_type": 9, "param_value": 7.5}, 0.0, autopilot=12).value == 7.5


@given(st.sampled_from(sorted(dialect.mavlink_map)), st.binary(min_size=1, max_size=255))
def test_any_payload_has_the_fields_that_pymavlink_reads(number, payload):
    body = struct.pack("<BBBBBB", len(payload), 0, 0, 0, 1, 1) + number.to_bytes(3, "little") + payload
    data = b"\xfd" + body + struct.pack("<H", crc16.mcrf4xx(body + bytes([CRC_EXTRA[number]])))
    theirs = dialect.MAVLink(None).decode(bytearray(data)).to_dict()
    ours = fields_of(first_frame(data, CRC_EXTRA))
    for name in theirs.keys() - {"mavpackettype"}:
        assert repr(ours[name]) == repr(theirs[name])
    assert ours.keys() - theirs.keys() <= {"param_integer"}


def test_mavlink_1_has_the_same_fields():
    message = dialect.MAVLink_local_position_ned_message(1500, 1.0, 2.0, -3.0, 0.5, -0.5, 0.0)
    mavlink = dialect.MAVLink(None, 1, 1)
    one, two = (first_frame(message.pack(mavlink, force_mavlink1=v1), CRC_EXTRA) for v1 in (True, False))
    assert fields_of(one) == fields_of(two)
    assert one.data[1] > two.data[1]  # MAVLink 2 leaves zeros out
