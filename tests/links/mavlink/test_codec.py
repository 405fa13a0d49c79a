"""MAVLink messages to typed values: units, unknown values, implausible numbers."""

import math
import struct
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from guidance.frames import Ned
from guidance.links.mavlink.codec import DECODERS, decode
from guidance.links.mavlink.frames import Frame, FrameReader
from guidance.messages import (
    FenceCount,
    FenceItem,
    FenceRefused,
    GlobalPosition,
    GpsFix,
    Heartbeat,
    Home,
    LocalPosition,
    SystemStatus,
)
from tests.links.mavlink.any_frame import framed


def message_of(name, **fields):
    """Return a message of this name with these fields, zero if not given."""
    known = next(message for message in dialect.mavlink_map.values() if message.msgname == name)
    return SimpleNamespace(msgname=name, **dict.fromkeys(known.fieldnames, 0) | fields)


def decoded(message, received_s):
    """Decode a message of the dialect as it is received."""
    return decode(Frame(message.msgname, 1, 1, 0, type(message), b""), message, received_s)


def test_every_decoded_message_exists_with_these_fields_in_the_dialect():
    for name in DECODERS:
        assert (
            decoded(
                message_of(name, lat=1, latitude=1, x=1, mission_type=1, flags=1), 3.0
            ).received_s
            == 3.0
        )


def test_a_heartbeat_has_mode_and_armed():
    beat = dialect.MAVLink_heartbeat_message(2, 12, 128 | 29, 6 << 16, 4, 3)
    assert decoded(beat, 1.0) == Heartbeat(1.0, 6 << 16, True, 4, 12, 2)
    beat.base_mode = 29
    assert not decoded(beat, 1.0).armed


def test_units_become_metres_seconds_and_degrees():
    position = dialect.MAVLink_global_position_int_message(
        2500, 473977418, -85455939, 488125, 20250, 150, -25, 75, 0
    )
    assert decoded(position, 9.0) == GlobalPosition(
        9.0, 2.5, 47.3977418, -8.5455939, 488.125, 20.25, Ned((1.5, -0.25, 0.75))
    )
    local = dialect.MAVLink_local_position_ned_message(1500, 1.0, 2.0, -3.0, 0.5, -0.5, 0.25)
    assert decoded(local, 9.0) == LocalPosition(
        9.0, 1.5, Ned((1.0, 2.0, -3.0)), Ned((0.5, -0.5, 0.25))
    )


@pytest.mark.parametrize(("sent", "volts"), [(15_800, 15.8), (0, math.nan), (65_535, math.nan)])
def test_a_battery_without_a_voltage_has_none(sent, volts):
    status = decoded(message_of("SYS_STATUS", voltage_battery=sent, battery_remaining=63), 1.0)
    assert status.battery_remaining == 0.63
    assert status.voltage_v == pytest.approx(volts, nan_ok=True)


@pytest.mark.parametrize(("sent", "satellites"), [(14, 14), (255, None)])
def test_a_gps_fix_has_its_kind_and_its_satellites(sent, satellites):
    assert decoded(message_of("GPS_RAW_INT", fix_type=3, satellites_visible=sent), 1.0) == GpsFix(
        1.0, 3, satellites
    )


@pytest.mark.parametrize("field", ["x", "y", "z", "vx", "vy", "vz"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_local_position_that_is_not_finite_is_refused(field, bad):
    with pytest.raises(ValueError, match=f"{bad}.*implausible"):
        decoded(message_of("LOCAL_POSITION_NED", **{field: bad}), 0.0)


@pytest.mark.parametrize(
    ("lat", "lon"), [(0, 0), (2**31 - 1, 2**31 - 1), (900000001, 1), (1, 1800000001)]
)
@pytest.mark.parametrize("name", ["GLOBAL_POSITION_INT", "HOME_POSITION", "GPS_GLOBAL_ORIGIN"])
def test_positions_that_are_unknown_or_not_on_earth_are_refused(name, lat, lon):
    with pytest.raises(ValueError, match=r"fix|not on Earth"):
        decoded(message_of(name, lat=lat, latitude=lat, lon=lon, longitude=lon), 0.0)


def test_items_of_the_fence_are_read_and_those_of_other_plans_are_not():
    item = dialect.MAVLink_mission_item_int_message(
        1, 195, 3, 0, 5001, 0, 1, 4.0, 0, 0, 0, 473977418, -85455939, 0.0, 1
    )
    count = dialect.MAVLink_mission_count_message(1, 195, 7, 1)
    ack = dialect.MAVLink_mission_ack_message(1, 195, 3, 1)
    assert decoded(item, 2.0) == FenceItem(2.0, 3, 5001, 4.0, 47.3977418, -8.5455939)
    assert decoded(count, 2.0) == FenceCount(2.0, 7)
    assert decoded(ack, 2.0) == FenceRefused(2.0, 3)
    item.param1 = math.nan
    with pytest.raises(ValueError, match="param1 = nan"):
        decoded(item, 2.0)
    for message in (item, count, ack):
        message.mission_type = 0
        with pytest.raises(ValueError, match="mission_type 0: only the fence"):
            decoded(message, 2.0)


def test_a_home_without_a_local_position_is_accepted():
    message = dialect.MAVLink_home_position_message(
        470000000, 80000000, 488000, *[math.nan] * 3, [1, 0, 0, 0], 0, 0, 0
    )
    home = decoded(message, 0.0)
    assert isinstance(home, Home)
    assert home.altitude_amsl_m == 488.0
    assert all(map(math.isnan, home.position_ned_m))


@pytest.mark.parametrize(
    ("percent", "expected"), [(-1, math.nan), (0, 0.0), (55, 0.55), (100, 1.0), (101, math.nan)]
)
def test_an_unknown_battery_is_nan_and_never_full(percent, expected):
    status = decoded(message_of("SYS_STATUS", battery_remaining=percent), 0.0)
    assert isinstance(status, SystemStatus)
    assert status.battery_remaining == pytest.approx(expected, nan_ok=True)


@given(st.integers(-(2**31), 2**31 - 1))
def test_px4_sends_integers_as_bytes_of_a_float_and_ardupilot_as_numbers(value):
    def received(number, kind, autopilot):
        payload = number + struct.pack("<HH16sB", 1, 0, b"P", kind)
        frame = FrameReader().first(framed("PARAM_VALUE", payload.rstrip(b"\0") or b"\0"))
        return decode(frame, frame.fields, 0.0, autopilot).value

    assert received(struct.pack("<i", value), 6, autopilot=12) == value
    assert received(struct.pack("<f", 7.0), 6, autopilot=3) == 7.0
    assert received(struct.pack("<f", 7.5), 9, autopilot=12) == 7.5
