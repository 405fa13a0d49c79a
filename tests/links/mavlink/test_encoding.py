"""Setpoints and requests on the wire, byte for byte against an encoder written from the MAVLink definition alone."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from guidance.frames import Ned
from guidance.links import MemoryWire
from guidance.links.mavlink import codec
from guidance.links.mavlink.frames import Station
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.messages import (
    Command,
    FenceReceived,
    FenceRequest,
    ParameterRequest,
    ParameterSet,
    Setpoint,
)

VELOCITY = (1.5, -2.25, 0.5)
ACCELERATION = (0.125, 0.25, -0.5)
X, Y, Z, VX, VY, VZ, AX, AY, AZ, FORCE, YAW, YAW_RATE = (1 << bit for bit in range(12))
# the fields that the autopilot should use; it ignores all others
USED = {
    "velocity": (Setpoint(Ned(VELOCITY)), VX | VY | VZ, 3527),
    "velocity, yaw": (Setpoint(Ned(VELOCITY), yaw_rad=0.75), VX | VY | VZ | YAW, 2503),
    "velocity, acceleration": (
        Setpoint(Ned(VELOCITY), Ned(ACCELERATION)),
        VX | VY | VZ | AX | AY | AZ,
        3079,
    ),
    "velocity, acceleration, yaw": (
        Setpoint(Ned(VELOCITY), Ned(ACCELERATION), 0.75),
        0x1F8 | YAW,
        2055,
    ),
}


def x25(data: bytes) -> int:
    """CRC-16/MCRF4XX byte by byte, as MAVLink's crc_accumulate defines it."""
    crc = 0xFFFF
    for byte in data:
        mixed = byte ^ (crc & 0xFF)
        mixed ^= (mixed << 4) & 0xFF
        crc = (crc >> 8) ^ (mixed << 8) ^ (mixed << 3) ^ (mixed >> 4)
        crc &= 0xFFFF
    return crc


def golden(mask: int, floats: list[float], *, time_ms: int, sequence: int) -> bytes:
    """SET_POSITION_TARGET_LOCAL_NED (84, crc extra 143): wire order is by size, largest first."""
    payload = struct.pack("<I11fHBBB", time_ms, *floats, mask, 7, 1, 1).rstrip(b"\0")
    header = struct.pack("<BBBBBBB", 0xFD, len(payload), 0, 0, sequence, 7, 195) + (84).to_bytes(
        3, "little"
    )
    body = header + payload
    return body + struct.pack("<H", x25(body[1:] + b"\x8f"))


@pytest.mark.parametrize("case", USED)
def test_a_setpoint_is_exactly_these_bytes(case):
    setpoint, used, mask = USED[case]
    assert mask == 0xFFF & ~used & ~FORCE
    ours, theirs = MemoryWire.pair(lambda: 12.345)
    link = PymavlinkLink(ours, lambda: 12.345, system_id=7)
    link.send_setpoint(setpoint)
    acceleration = ACCELERATION if used & AX else [0.0] * 3
    floats = [0.0, 0.0, 0.0, *VELOCITY, *acceleration, 0.75 if used & YAW else 0.0, 0.0]
    assert [frame for _, frame in theirs.receive()] == [
        golden(mask, floats, time_ms=12345, sequence=0)
    ]


@given(
    bad=st.sampled_from([math.nan, math.inf, -math.inf, 1e39, -1e39]),
    where=st.integers(0, 6),
)
def test_a_number_that_is_not_finite_in_32_bits_is_never_sent(bad, where):
    numbers = [1.0] * 7
    numbers[where] = bad
    setpoint = Setpoint(Ned(tuple(numbers[:3])), Ned(tuple(numbers[3:6])), numbers[6])
    ours, theirs = MemoryWire.pair(lambda: 0.0)
    link = PymavlinkLink(ours, lambda: 0.0, system_id=1)
    with pytest.raises(ValueError, match="must be finite"):
        link.send_setpoint(setpoint)
    assert theirs.receive() == []
    assert link.counters()["setpoints_sent"] == 0


def test_a_field_that_does_not_fit_is_no_frame_and_takes_no_number():
    ours, theirs = MemoryWire.pair(lambda: 0.0)
    station = Station(ours, 7, 195)
    with pytest.raises(struct.error):
        station.send(dialect.MAVLink_timesync_message(0, 2**63))
    station.send(dialect.MAVLink_timesync_message(0, 1))
    assert [frame[4] for _, frame in theirs.receive()] == [0]


def test_our_clock_wraps_like_time_boot_ms():
    sent = codec.setpoint(Setpoint(Ned(VELOCITY)), now_s=2**32 / 1e3 + 5.0, to=(1, 1))
    assert sent.time_boot_ms == 5000


def test_a_command_long_keeps_its_parameters_and_counts_its_repeats():
    sent = codec.request(Command(176, (1, 6, 0, math.nan, 5, 6, 7)), attempt=2, to=(3, 1))
    assert (sent.msgname, sent.command, sent.confirmation, sent.target_system) == (
        "COMMAND_LONG",
        176,
        2,
        3,
    )
    assert [getattr(sent, f"param{n}") for n in (1, 2, 3, 5, 6, 7)] == [1, 6, 0, 5, 6, 7]
    assert math.isnan(sent.param4)


@pytest.mark.parametrize(
    ("request_", "name", "fields"),
    [
        (FenceRequest(), "MISSION_REQUEST_LIST", {}),
        (FenceRequest(0), "MISSION_REQUEST_INT", {"seq": 0}),
        (FenceReceived(), "MISSION_ACK", {"type": 0}),
    ],
)
def test_the_fence_is_requested_by_its_mission_type(request_, name, fields):
    sent = codec.request(request_, attempt=2, to=(1, 1))
    assert sent.msgname == name
    for field, value in {
        "target_system": 1,
        "target_component": 1,
        "mission_type": 1,
        **fields,
    }.items():
        assert getattr(sent, field) == value


def test_a_command_int_carries_degrees_as_integers_and_nan_as_not_used():
    command = Command(192, (-1.0, 1.0, 0.0, math.nan, 47.3977419, -8.5455938, 520.0), frame=0)
    sent = codec.request(command, attempt=0, to=(1, 1))
    assert (sent.msgname, sent.x, sent.y, sent.z) == ("COMMAND_INT", 473977419, -85455938, 520.0)
    assert (sent.frame, sent.command, sent.param1, sent.param2) == (0, 192, -1.0, 1.0)
    unused = command._replace(params=(-1.0, 1.0, 0.0, math.nan, math.nan, math.nan, 520.0))
    assert codec.request(unused, attempt=0, to=(1, 1)).x == 2**31 - 1


@pytest.mark.parametrize(
    "request_",
    [
        Command(22, (math.inf, 0, 0, 0, 0, 0, 0)),
        Command(192, (0, 0, 0, 0, 4739.0, 8.0, 0), frame=0),
        ParameterRequest(""),
        ParameterRequest("SEVENTEEN_LETTERS"),
        ParameterSet("SEVENTEEN_LETTERS", 1.0, 9),
        ParameterSet("MPC_XY_VEL_MAX", math.nan, 9),
        ParameterSet("COM_FLTMODE1", -1.0, 6),
        ParameterSet("COM_OBL_RC_ACT", 2.5, 6),
        ParameterSet("COM_OBL_RC_ACT", 2.0**31, 6),
    ],
)
def test_a_request_that_cannot_be_encoded_is_refused(request_):
    with pytest.raises(
        ValueError, match=r"infinite|latitude|1 to 16|only finite|must be an integer"
    ):
        codec.request(request_, attempt=0, to=(1, 1), autopilot=12)


@pytest.mark.parametrize(
    ("autopilot", "param_type", "value", "carried"),
    [
        (12, 6, 5.0, b"\x05\0\0\0"),
        (12, 9, 5.0, b"\0\0\xa0@"),
        (3, 6, 5.0, b"\0\0\xa0@"),
        (3, 2, 5.0, b"\0\0\xa0@"),
    ],
)
def test_an_integer_parameter_is_carried_as_its_autopilot_reads_it(
    autopilot, param_type, value, carried
):
    wanted = ParameterSet("COM_OBL_RC_ACT", value, param_type)
    sent = codec.request(wanted, attempt=0, to=(1, 1), autopilot=autopilot)
    assert (sent.msgname, sent.param_id, sent.param_type) == (
        "PARAM_SET",
        "COM_OBL_RC_ACT",
        param_type,
    )
    assert struct.pack("<f", sent.param_value) == carried
