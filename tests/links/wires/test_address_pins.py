"""A listening UDP port: accepted and refused datagrams, and attacks on the pinned address."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from guidance.links.mavlink.frames import (
    CheckedBytes,
    FrameReader,
    SignatureCheck,
    SigningKey,
    ticks,
)
from guidance.links.wires.udp import (
    ADDRESS_SILENT_S,
    IMPOSTORS_PER_S,
    MAX_SYSTEMS,
    STRANGERS_PER_S,
    AddressPins,
)
from tests.links.peer import Peer

VEHICLE = ("127.0.0.1", 14580)
FORGER = ("127.0.0.1", 666)
ELSEWHERE = ("127.0.0.1", 14590)
KEY = bytes(range(32))
UNIX_S = 1_800_000_000.0


def heartbeat(system_id: int = 1) -> bytes:
    return Peer(lambda data: None, system_id=system_id).packed(
        dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3)
    )


class Signed(Peer):
    """A vehicle that signs its HEARTBEATs; every one is new."""

    def __init__(self, key: bytes = KEY) -> None:
        super().__init__(lambda data: None)
        signing = self.mavlink.signing
        signing.secret_key = key
        signing.sign_outgoing = True
        signing.timestamp = ticks(UNIX_S)

    def beat(self) -> bytes:
        return self.packed(dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3))


def keyed() -> AddressPins:
    return AddressPins({1}, {1: SignatureCheck(SigningKey(KEY, UNIX_S))})


def test_the_first_sender_with_the_vehicles_id_is_pinned():
    pins = AddressPins({1})
    assert pins.addresses == ()
    assert pins.admit(0.0, VEHICLE, heartbeat()) == heartbeat()
    assert list(pins.addresses) == [VEHICLE]


def test_of_a_pinned_address_only_whole_frames_are_accepted():
    pins = AddressPins({1})
    pins.admit(0.0, VEHICLE, heartbeat())
    assert pins.admit(0.1, VEHICLE, b"half a frame") == b""
    assert pins.admit(0.2, VEHICLE, b"\0" + heartbeat() + b"\xfd half a frame") == heartbeat()


def test_a_reader_does_not_search_again_what_the_pins_have_checked():
    pins = AddressPins({1})
    pins.admit(0.0, VEHICLE, heartbeat(1))
    datagram = b"\0" + heartbeat(1) + heartbeat(7) + b"\xfd half a frame"
    admitted = pins.admit(0.1, VEHICLE, datagram)
    assert isinstance(admitted, CheckedBytes)
    reader = FrameReader({"HEARTBEAT"})
    frames = reader.read(admitted)
    assert [frame.data for frame in frames] == [heartbeat(1), heartbeat(7)]
    assert all(frame is checked for frame, checked in zip(frames, admitted.frames, strict=True))
    assert (reader.garbage_bytes, reader.unused) == (0, 0)
    assert FrameReader({"ATTITUDE"}).read(admitted) == []


ODD_BYTES = [b"", b"\xfd", b"\xfd\x40\0", heartbeat(2), heartbeat(2) + b"\xfe", heartbeat(9)]


@given(before=st.sampled_from(ODD_BYTES) | st.binary(max_size=9), again=st.integers(1, 3))
def test_whoever_has_the_evaders_place_does_not_speak_as_the_vehicle(before, again):
    pins = AddressPins({1, 2})
    pins.admit(0.0, VEHICLE, heartbeat(1))
    pins.admit(0.0, FORGER, heartbeat(2))
    admitted = pins.admit(1.0, FORGER, before + again * heartbeat(1) + bytes(300))
    assert 1 not in {frame.system_id for frame in FrameReader().read(admitted)}
    assert pins.refused["impostor"] == again
    assert list(pins.impostors) == again * [heartbeat(1)]


@given(size=st.integers(24, 300), others=st.integers(0, 40))
def test_frames_that_a_bridge_cuts_at_datagram_borders_are_joined(size, others):
    sent = [
        Peer(lambda data: None).packed(
            dialect.MAVLink_local_position_ned_message(n, n, 0, 0, 0, 0, n)
        )
        for n in range(40)
    ]
    data = heartbeat() + b"".join(sent)
    pins = AddressPins({1})
    heard = b""
    for number, start in enumerate(range(0, len(data), size)):
        heard += pins.admit(0.01 * number, VEHICLE, data[start : start + size])
        for port in range(others):  # nobody else's pieces come between
            assert pins.admit(0.01 * number, ("127.0.0.1", 2000 + port), sent[0][9:]) == b""
    assert heard == data


@pytest.mark.parametrize("size", [24, 64, 100])
def test_a_bridge_that_is_heard_in_the_middle_of_a_frame_is_pinned_and_then_loses_nothing(size):
    sent = [heartbeat()] * 40
    data = b"".join(sent)[7:]
    pins = AddressPins({1})
    heard = b"".join(
        pins.admit(0.1 * number, VEHICLE, data[start : start + size])
        for number, start in enumerate(range(0, len(data), size))
    )
    assert heard == b"".join(sent[: len(heard) // len(sent[0])])
    assert len(heard) >= 30 * len(sent[0])
    assert pins.addresses == (VEHICLE,)


@pytest.mark.parametrize("size", [32, 64])
def test_signed_frames_are_judged_one_by_one_also_where_they_are_cut(size):
    vehicle = Signed()
    data = b"".join(vehicle.beat() for _ in range(20))
    pins = keyed()
    pins.admit(0.0, VEHICLE, vehicle.beat())
    forger = Signed(bytes(32))
    forged = b"".join(forger.beat() for _ in range(20))
    for start in range(0, len(data), size):
        assert pins.admit(0.1, FORGER, forged[start : start + size]) == b""
        pins.admit(0.1, VEHICLE, data[start : start + size])
    assert pins.addresses == (VEHICLE,)


@given(data=st.binary(max_size=300))
def test_bytes_that_are_no_frame_pin_no_address(data):
    pins = AddressPins({1})
    assert pins.admit(0.0, FORGER, data) == b""
    assert pins.addresses == ()
    assert pins.refused["garbage"] == 1


def test_the_id_of_a_live_vehicle_is_accepted_from_its_address_only():
    pins = AddressPins({1})
    for tenth in range(100):
        now_s = 0.1 * tenth
        assert pins.admit(now_s, VEHICLE, heartbeat())
        for port in range(12):
            assert pins.admit(now_s, ("127.0.0.1", 700 + port), heartbeat()) == b""
    assert list(pins.addresses) == [VEHICLE]
    assert pins.refused["impostor"] == 1200


def test_a_vehicle_that_was_silent_may_return_from_another_address():
    pins = AddressPins({1})
    pins.admit(0.0, VEHICLE, heartbeat())
    assert pins.admit(ADDRESS_SILENT_S - 0.01, ELSEWHERE, heartbeat()) == b""
    assert pins.admit(ADDRESS_SILENT_S, ELSEWHERE, heartbeat()) == heartbeat()
    assert list(pins.addresses) == [ELSEWHERE]


def test_the_first_address_gets_its_pin_back_when_it_returns():
    pins = AddressPins({1})
    pins.admit(0.0, VEHICLE, heartbeat())
    assert pins.admit(3.7, FORGER, heartbeat())
    assert pins.admit(3.8, VEHICLE, heartbeat())
    assert list(pins.addresses) == [VEHICLE]
    assert pins.admit(3.9, FORGER, heartbeat()) == b""
    assert pins.refused["impostor"] == 1


def test_impostors_are_kept_at_a_bounded_rate_per_message():
    pins = AddressPins({1})
    pins.admit(0.0, VEHICLE, heartbeat())
    position = Peer(lambda data: None).packed(
        dialect.MAVLink_local_position_ned_message(1, 2, 3, 4, 5, 6, 7)
    )
    for n in range(1000):
        pins.admit(1.0 + n * 1e-4, FORGER, heartbeat())
        pins.admit(1.0 + n * 1e-4, FORGER, position)
    assert list(pins.impostors) == [heartbeat(), position] * IMPOSTORS_PER_S
    assert pins.refused["impostor"] == 2000
    for number in range(2**16):  # unknown messages, so that the budget cannot be multiplied
        pins.admit(
            1.5, FORGER, b"\xfd\x00\x00\x00\x00\x01\x01" + number.to_bytes(3, "little") + b"\0\0"
        )
    assert len(pins.impostors) < 256


def test_with_a_key_only_a_validly_signed_frame_pins_an_address():
    pins = keyed()
    vehicle = Signed()
    for second in range(10):
        assert pins.admit(float(second), FORGER, heartbeat()) == b""
    assert pins.admit(9.5, FORGER, Signed(bytes(32)).beat()) == b""
    assert pins.addresses == ()
    assert pins.refused["unsigned"] == 11
    assert pins.admit(10.0, VEHICLE, vehicle.beat())
    assert list(pins.addresses) == [VEHICLE]
    for second in range(14, 30):  # the vehicle is silent
        assert pins.admit(float(second), FORGER, heartbeat()) == b""
    assert pins.admit(30.0, VEHICLE, vehicle.beat())
    assert list(pins.addresses) == [VEHICLE]


def test_with_a_key_a_replayed_frame_pins_no_address():
    pins = keyed()
    vehicle = Signed()
    beats = [vehicle.beat() for _ in range(3)]
    for second, beat in enumerate(beats):
        assert pins.admit(float(second), VEHICLE, beat)
    for second, beat in enumerate(beats):
        assert pins.admit(10.0 + second, FORGER, beat) == b""
    assert list(pins.addresses) == [VEHICLE]


def test_with_a_key_unsigned_data_does_not_keep_a_pin_alive():
    pins = keyed()
    vehicle = Signed()
    pins.admit(0.0, VEHICLE, vehicle.beat())
    assert pins.admit(2.0, VEHICLE, heartbeat()) == heartbeat()  # the link refuses and counts it
    assert pins.admit(ADDRESS_SILENT_S, FORGER, heartbeat()) == b""
    assert pins.admit(ADDRESS_SILENT_S, ELSEWHERE, vehicle.beat())
    assert list(pins.addresses) == [ELSEWHERE]


def test_with_a_key_a_fresher_frame_takes_the_place_at_once():
    pins = keyed()
    vehicle = Signed()
    recorded = [vehicle.beat() for _ in range(3)]
    assert pins.admit(0.0, FORGER, recorded[0])  # replayed at the start, while the vehicle is quiet
    assert pins.admit(0.1, VEHICLE, vehicle.beat())
    assert list(pins.addresses) == [VEHICLE]
    assert pins.admit(0.2, FORGER, recorded[1]) == b""
    assert pins.admit(0.3, VEHICLE, vehicle.beat())
    assert list(pins.addresses) == [VEHICLE]


def test_a_few_frames_of_other_systems_are_accepted_so_that_errors_can_name_them():
    pins = AddressPins({1})
    sent = heartbeat(7) + heartbeat(1)
    admitted = [pins.admit(5.0 + n * 1e-3, FORGER, sent) for n in range(900)]
    assert admitted == [heartbeat(7)] * STRANGERS_PER_S + [b""] * (900 - STRANGERS_PER_S)
    assert pins.refused["stranger"] == 900 - STRANGERS_PER_S
    assert pins.admit(6.0, FORGER, sent) == heartbeat(7)
    assert pins.addresses == ()


def test_two_systems_may_share_an_address():
    pins = AddressPins({1, 2})
    pins.admit(0.0, VEHICLE, heartbeat(2))
    assert pins.admit(0.1, VEHICLE, heartbeat(1)) == heartbeat(1)
    assert list(pins.addresses) == [VEHICLE]


def test_two_systems_at_two_addresses_are_both_pinned():
    pins = AddressPins({1, 2})
    pins.admit(0.0, VEHICLE, heartbeat(1))
    pins.admit(0.0, ELSEWHERE, heartbeat(2))
    assert list(pins.addresses) == [VEHICLE, ELSEWHERE]


def test_if_any_system_is_accepted_their_number_is_bounded_and_live_ones_stay():
    pins = AddressPins()
    for system_id in range(1, MAX_SYSTEMS + 1):
        assert pins.admit(0.0, ("127.0.0.1", system_id), heartbeat(system_id))
    pins.admit(2.0, FORGER, heartbeat(200))
    assert FORGER not in pins.addresses
    for system_id in range(2, MAX_SYSTEMS + 1):
        pins.admit(2.5, ("127.0.0.1", system_id), heartbeat(system_id))
    pins.admit(ADDRESS_SILENT_S, FORGER, heartbeat(200))
    assert sorted(pins.addresses) == sorted(
        [FORGER, *(("127.0.0.1", one) for one in range(2, MAX_SYSTEMS + 1))]
    )
