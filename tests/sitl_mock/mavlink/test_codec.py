"""The codec against pymavlink's own packer and parser, over every message of the dialect."""

import math
import os
import random
import struct
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as dialect

from sitl_mock.mavlink import (
    MAX_FRAME,
    SPEC_BY_ID,
    SPEC_BY_NAME,
    Decoder,
    EncodeError,
    Encoder,
    spec_of,
)
from tests.harness.examples import drawn

INTEGERS = {
    "uint8_t": (0, 2**8 - 1),
    "int8_t": (-(2**7), 2**7 - 1),
    "uint16_t": (0, 2**16 - 1),
    "int16_t": (-(2**15), 2**15 - 1),
    "uint32_t": (0, 2**32 - 1),
    "int32_t": (-(2**31), 2**31 - 1),
    "uint64_t": (0, 2**64 - 1),
    "int64_t": (-(2**63), 2**63 - 1),
}

COMMON = [
    message_id
    for message_id, message_class in sorted(dialect.mavlink_map.items())
    if message_id in SPEC_BY_ID
    and tuple(message_class.fieldnames) == SPEC_BY_ID[message_id].field_names
]
"""Messages that are the same there: a newer pymavlink may have more, or more extension fields."""


def element(kind):
    if kind in INTEGERS:
        low, high = INTEGERS[kind]
        return st.one_of(st.just(0), st.integers(low, high))
    return st.floats(width=64 if kind == "double" else 32, allow_nan=False)


def field(kind, length):
    if kind == "char":
        text = st.text(
            alphabet=st.characters(min_codepoint=32, max_codepoint=126), max_size=max(length, 1)
        )
        return (
            text.map(str.encode) if length else st.integers(1, 127).map(lambda code: bytes((code,)))
        )
    return st.lists(element(kind), min_size=length, max_size=length) if length else element(kind)


def zero(kind, length):
    if kind == "char":
        return b"" if length else b"\0"
    return [0] * length if length else 0


@st.composite
def any_message(draw):
    cls = dialect.mavlink_map[draw(st.sampled_from(COMMON))]
    lengths = dict(zip(cls.ordered_fieldnames, cls.array_lengths, strict=True))
    kinds = dict(zip(cls.fieldnames, cls.fieldtypes, strict=True))
    return cls, tuple(draw(field(kinds[name], lengths[name])) for name in cls.fieldnames)


def witness(system=7, component=9, sequence=0):
    mav = dialect.MAVLink(SimpleNamespace(write=lambda _: None), system, component)
    mav.seq = sequence
    return mav


@settings(max_examples=drawn(600), deadline=None)
@given(any_message(), st.integers(0, 255), st.integers(0, 255), st.integers(0, 255))
def test_every_message_packs_to_the_bytes_of_pymavlink(message, sequence, system, component):
    """Catches a byte that our encoder writes otherwise than pymavlink."""
    cls, values = message
    encoder = Encoder(system, component)
    encoder.sequence = sequence
    assert encoder.pack(cls.msgname, *values) == cls(*values).pack(
        witness(system, component, sequence)
    )


@settings(max_examples=drawn(600), deadline=None)
@given(any_message(), st.integers(0, 255))
def test_every_message_of_pymavlink_decodes_to_the_same_object(message, sequence):
    """Catches a field that our decoder reads otherwise than pymavlink."""
    cls, values = message
    frame = cls(*values).pack(witness(sequence=sequence))
    theirs = witness().decode(bytearray(frame))
    decoder = Decoder()
    (ours,) = decoder.feed(frame)
    assert ours.to_dict() == theirs.to_dict()
    assert ours.get_fieldnames() == theirs.get_fieldnames()
    assert [getattr(ours, name) for name in ours.get_fieldnames()] == [
        getattr(theirs, name) for name in theirs.get_fieldnames()
    ]
    header = theirs.get_header()
    assert ours.get_msgId() == header.msgId
    assert ours.get_seq() == header.seq
    assert (ours.get_srcSystem(), ours.get_srcComponent()) == (
        header.srcSystem,
        header.srcComponent,
    )
    assert bytes(ours.get_msgbuf()) == frame
    assert (decoder.counts.frames, decoder.pending) == (1, 0)


def test_zero_values_of_every_message_make_one_byte_of_payload_both_here_and_there():
    assert len(COMMON) > 340
    for message_id in COMMON:
        cls = dialect.mavlink_map[message_id]
        lengths = dict(zip(cls.ordered_fieldnames, cls.array_lengths, strict=True))
        kinds = dict(zip(cls.fieldnames, cls.fieldtypes, strict=True))
        values = [zero(kinds[name], lengths[name]) for name in cls.fieldnames]
        frame = Encoder(7, 9).pack(message_id, *values)
        assert frame == cls(*values).pack(witness())
        assert len(frame) == 13
        (message,) = Decoder().feed(frame)
        assert message.get_msgId() == message_id


@settings(max_examples=drawn(100), deadline=None)
@given(st.lists(any_message(), min_size=1, max_size=8), st.randoms(use_true_random=False))
def test_a_stream_cut_anywhere_gives_every_message_once_and_in_order(messages, rng):
    """Catches a message that a cut of the stream loses or doubles."""
    encoder = Encoder(1, 1)
    stream = b"".join(encoder.pack(cls.msgname, *values) for cls, values in messages)
    decoder = Decoder()
    seen = []
    at = 0
    while at < len(stream):
        step = rng.randint(1, 40)
        seen += decoder.feed(stream[at : at + step])
        at += step
        assert decoder.pending < MAX_FRAME
    assert [m.get_type() for m in seen] == [cls.msgname for cls, _ in messages]
    assert [m.get_seq() for m in seen] == list(range(len(messages)))
    assert sum(decoder.counts.as_dict().values()) == len(messages)


def test_the_sequence_wraps_at_256_and_each_encoder_has_its_own():
    first = Encoder(1, 1)
    second = Encoder(1, 1)
    frames = [first.pack("PING", 0, 0, 0, 0) for _ in range(257)]
    assert [frame[4] for frame in frames] == [*range(256), 0]
    assert second.pack("PING", 0, 0, 0, 0)[4] == 0


def test_not_a_number_passes_both_ways():
    frame = Encoder(1, 1).pack("COMMAND_LONG", 1, 1, 22, 0, *[math.nan] * 7)
    (message,) = Decoder().feed(frame)
    assert all(math.isnan(getattr(message, f"param{i}")) for i in range(1, 8))
    assert frame == dialect.MAVLink_command_long_message(1, 1, 22, 0, *[math.nan] * 7).pack(
        witness(1, 1)
    )


def test_text_may_be_str_or_bytes_and_arrays_any_sequence():
    as_text = Encoder(1, 1).pack("PARAM_REQUEST_READ", 1, 1, "MPC_XY_VEL_MAX", -1)
    as_bytes = Encoder(1, 1).pack("PARAM_REQUEST_READ", 1, 1, b"MPC_XY_VEL_MAX", -1)
    assert as_text == as_bytes
    as_list = Encoder(1, 1).pack("FILE_TRANSFER_PROTOCOL", 0, 1, 1, [7] * 251)
    assert as_list == Encoder(1, 1).pack("FILE_TRANSFER_PROTOCOL", 0, 1, 1, bytes([7]) * 251)


@pytest.mark.parametrize(
    ("message", "values", "said"),
    [
        ("HEARTBEAT", (2, 12, 256, 0, 4, 3), "HEARTBEAT"),
        ("HEARTBEAT", (2, 12), "HEARTBEAT"),
        ("PARAM_VALUE", (b"A", 1.0, 9, 1), "5 values expected, 4 given"),
        ("SET_POSITION_TARGET_LOCAL_NED", (1,) * 15, "16 values expected, 15 given"),
        ("FILE_TRANSFER_PROTOCOL", (0, 1, 1, [1, 2]), "FILE_TRANSFER_PROTOCOL"),
        ("PARAM_VALUE", (3, 1.0, 9, 1, 1), "PARAM_VALUE"),
        ("NO_SUCH", (), "NO_SUCH"),
        (0xFFFFFF, (), "16777215"),
    ],
)
def test_values_that_do_not_fit_are_refused_with_the_name_of_the_message(message, values, said):
    encoder = Encoder(1, 1)
    with pytest.raises(EncodeError, match=said):
        encoder.pack(message, *values)
    assert encoder.sequence == 0


def test_names_and_ids_reach_the_same_message():
    assert spec_of("HEARTBEAT") is spec_of(0) is SPEC_BY_NAME["HEARTBEAT"]
    values = (2, 12, 81, 0, 4, 3)
    assert Encoder(1, 1).pack("HEARTBEAT", *values) == Encoder(1, 1).pack(0, *values)


# -- MAVLink 1 ---------------------------------------------------------------------------------------------------------


def test_a_mavlink_1_frame_of_pymavlink_is_accepted():
    message = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    theirs = message.pack(witness(255, 190), force_mavlink1=True)
    (decoded,) = Decoder().feed(theirs)
    assert (decoded.get_type(), decoded.get_srcSystem(), decoded.get_srcComponent()) == (
        "HEARTBEAT",
        255,
        190,
    )


def test_a_mavlink_1_frame_longer_than_its_message_is_counted_as_length():
    crc = dialect.x25crc(bytes((10, 0, 1, 1, 0)) + bytes(10) + bytes((50,))).crc
    decoder = Decoder()
    assert (
        decoder.feed(b"\xfe" + bytes((10, 0, 1, 1, 0)) + bytes(10) + struct.pack("<H", crc)) == []
    )
    assert decoder.counts.length == 1


# -- invalid input is counted and dropped -----------------------------------------------------------------------------


def heartbeat(sequence=0):
    encoder = Encoder(255, 190)
    encoder.sequence = sequence
    return encoder.pack("HEARTBEAT", 6, 8, 0, 0, 4, 3)


def test_garbage_before_a_frame_is_counted_byte_by_byte():
    decoder = Decoder()
    assert len(decoder.feed(b"no magic here" + heartbeat())) == 1
    assert decoder.counts.garbage_bytes == 13


def test_a_flipped_bit_anywhere_never_gives_a_message_from_that_frame():
    frame = heartbeat()
    for bit in range(len(frame) * 8):
        broken = bytearray(frame)
        broken[bit // 8] ^= 1 << bit % 8
        decoder = Decoder()
        assert decoder.feed(bytes(broken), whole=True) == []
        counts = decoder.counts
        assert (
            counts.garbage_bytes
            + counts.crc
            + counts.incompatible
            + counts.unknown_id
            + counts.truncated
            > 0
        )


def test_one_corrupted_frame_counts_once_whatever_its_payload_looks_like():
    frame = bytearray(Encoder(1, 1).pack("FILE_TRANSFER_PROTOCOL", 0, 1, 1, [0xFD] * 251))
    frame[-1] ^= 0xFF
    decoder = Decoder()
    assert decoder.feed(bytes(frame) + heartbeat(), whole=True)[0].get_type() == "HEARTBEAT"
    counts = decoder.counts.as_dict()
    assert counts.pop("crc") == 1
    assert counts.pop("frames") == 1
    assert not any(counts.values())


def test_a_good_frame_swallowed_by_a_false_start_is_still_found():
    decoder = Decoder()
    false_start = b"\xfd\x30\x00\x00\x00\x01\x01\x00\x00\x00"  # claims 48 bytes of payload
    messages = decoder.feed(false_start + heartbeat(1) + heartbeat(2) + heartbeat(3))
    assert [m.get_seq() for m in messages] == [1, 2, 3]
    assert decoder.counts.crc == 1


def test_a_truncated_datagram_is_counted_and_does_not_hold_up_the_next():
    decoder = Decoder()
    for cut in range(1, len(heartbeat())):
        assert decoder.feed(heartbeat()[:cut], whole=True) == []
    assert decoder.counts.truncated == len(heartbeat()) - 1
    assert decoder.pending == 0
    assert len(decoder.feed(heartbeat(), whole=True)) == 1


def test_an_unknown_id_and_an_unknown_flag_are_counted_apart():
    decoder = Decoder()
    body = bytes((1, 0, 0, 0, 1, 1, 0xEE, 0xEE, 0xEE, 5))
    assert decoder.feed(b"\xfd" + body + b"\x11\x22", whole=True) == []
    body = bytes((1, 2, 0, 0, 1, 1, 0, 0, 0, 5))
    assert decoder.feed(b"\xfd" + body + b"\x11\x22", whole=True) == []
    assert (decoder.counts.unknown_id, decoder.counts.incompatible) == (1, 1)


def test_a_longer_payload_than_known_is_read_up_to_the_known_fields():
    # A later dialect's extension
    payload = struct.pack("<IBBBBB", 3, 2, 12, 81, 4, 3) + b"\x99\x98"
    body = bytes((len(payload), 0, 0, 0, 1, 1, 0, 0, 0)) + payload
    crc = dialect.x25crc(body + bytes((50,))).crc
    (message,) = Decoder().feed(b"\xfd" + body + struct.pack("<H", crc))
    assert (message.custom_mode, message.type, message.mavlink_version) == (3, 2, 3)


def test_the_buffer_never_holds_more_than_one_frame():
    rng = random.Random(5)
    decoder = Decoder()
    for _ in range(300):
        decoder.feed(b"\xfd" + rng.randbytes(rng.randint(0, 900)))
        assert decoder.pending < MAX_FRAME


def test_the_dialect_is_mavlink_2_whatever_the_environment_says():
    assert "MAVLINK09" not in os.environ
    assert Encoder(1, 1).pack("PING", 1, 1, 0, 0)[0] == 0xFD


def test_messages_missing_in_pymavlink_have_the_seeds_and_sizes_of_mavlinks_headers():
    published = {
        8: (117, 36),
        300: (217, 22),
        380: (232, 20),
        397: (182, 108),
        410: (160, 53),
        411: (106, 3),
        412: (33, 6),
        413: (77, 7),
    }
    assert {n: (SPEC_BY_ID[n].crc_extra[0], SPEC_BY_ID[n].size) for n in published} == published


def test_an_event_comes_back_as_it_went():
    frame = Encoder(1, 1).pack("EVENT", 0, 0, 0x01ABCDEF, 4321, 7, 0x66, [*range(40)])
    (event,) = Decoder().feed(frame, whole=True)
    assert (event.id, event.event_time_boot_ms, event.sequence, event.log_levels) == (
        0x01ABCDEF,
        4321,
        7,
        0x66,
    )
    assert list(event.arguments) == [*range(40)]
