"""Frames out of bytes: cut anywhere, mixed with garbage, damaged."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from guidance.links.mavlink.frames import MAGIC_V2, SIGNED, FrameReader, frame_length
from tests.links.peer import Peer


def frames(count: int, *, v1: bool = False) -> list[bytes]:
    peer = Peer(lambda data: None)
    return [
        peer.packed(dialect.MAVLink_local_position_ned_message(n, n, 0, 0, 0, 0, n), v1=v1)
        for n in range(count)
    ]


@given(cuts=st.lists(st.integers(0, 400), max_size=20), v1=st.booleans())
def test_a_stream_may_be_cut_anywhere(cuts, v1):
    sent = frames(8, v1=v1)
    stream = b"".join(sent)
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    reader = FrameReader()
    heard = [frame for a, b in itertools.pairwise(edges) for frame in reader.read(stream[a:b])]
    assert [frame.data for frame in heard] == sent
    assert {(one.name, one.system_id, one.component_id) for one in heard} == {
        ("LOCAL_POSITION_NED", 1, 1)
    }
    assert reader.garbage_bytes == 0


@given(garbage=st.lists(st.binary(max_size=40), min_size=5, max_size=5))
def test_garbage_between_frames_loses_no_frame(garbage):
    sent = frames(4)
    tail = frames(8)[4:]  # enough to complete any length that the garbage announces
    stream = (
        b"".join(noise + frame for noise, frame in zip(garbage, [*sent, b""], strict=True))
        + b"".join(tail) * 8
    )
    reader = FrameReader()
    heard = [frame.data for frame in reader.read(stream)]
    assert [data for data in heard if data in sent] == sent


@given(position=st.integers(0, 37), bit=st.integers(0, 7))
def test_a_frame_with_one_wrong_bit_is_refused(position, bit):
    (frame,) = frames(1)
    damaged = bytearray(frame)
    damaged[position % len(frame)] ^= 1 << bit
    heard = FrameReader().read(bytes(damaged))
    assert heard == []


@given(noise=st.binary(max_size=30))
def test_garbage_that_looks_like_a_beginning_delays_no_whole_frame_behind_it(noise):
    reader = FrameReader()
    (frame,) = frames(1)
    lie = b"\x00\xfd\xf0\x00" + noise
    heard = [one.data for one in reader.read(lie + frame)]
    assert heard == [frame]


def test_a_datagram_cut_short_does_not_affect_the_next():
    reader = FrameReader()
    first, second = frames(2)
    assert reader.read(first[:-5]) == []
    assert [frame.data for frame in reader.read(second)] == [second]


def test_unknown_messages_are_skipped_and_counted():
    reader = FrameReader()
    (known,) = frames(1)
    unknown = bytes([0xFD, 3, 0, 0, 0, 1, 1]) + (70000).to_bytes(3, "little") + b"abc" + b"\x12\x34"
    assert [frame.data for frame in reader.read(unknown + known + unknown)] == [known]
    assert reader.unknown == 2
    assert reader.garbage_bytes == 0


def test_the_length_of_an_unknown_message_hides_no_known_frame():
    reader = FrameReader()
    sent = frames(4)
    inside = b"".join(sent)
    lie = bytes([0xFD, len(inside) - 2, 0, 0, 0, 1, 1]) + (70000).to_bytes(3, "little") + inside
    assert [frame.data for frame in reader.read(lie + sent[0])] == [*sent, sent[0]]


def test_an_incomplete_frame_waits_in_bounded_memory():
    reader = FrameReader()
    for _ in range(1000):
        reader.read(b"\xfd\xff\x00" + bytes(97))
    assert reader.garbage_bytes > 90_000


def test_frames_with_unknown_flags_are_refused():
    reader = FrameReader()
    (frame,) = frames(1)
    flagged = frame[:2] + b"\x02" + frame[3:]
    assert reader.read(flagged) == []


def test_a_signed_frame_is_one_frame():
    peer = Peer(lambda data: None)
    peer.mavlink.signing.secret_key = bytes(32)
    peer.mavlink.signing.sign_outgoing = True
    signed = peer.packed(dialect.MAVLink_local_position_ned_message(1, 2, 3, 4, 5, 6, 7))
    (frame,) = FrameReader().read(signed + frames(1)[0])[:1]
    assert frame.data[0] == MAGIC_V2
    assert frame.data[2] & SIGNED
    assert frame.data == signed


@pytest.mark.parametrize("byte", [0xFD, 0xFE])
def test_a_piece_full_of_start_marks_costs_bounded_work(byte, monkeypatch):
    reader = FrameReader()
    checked = 65_000
    tried = []

    def noted(*where):
        tried.append(frame_length(*where))
        return tried[-1]

    monkeypatch.setattr("guidance.links.mavlink.frames.frame_length", noted)
    assert reader.read(bytes([byte]) * checked) == []
    assert reader.garbage_bytes + reader.unknown >= checked - 300
    assert len(tried) - tried.count(0) <= 130  # a length is all that a frame begins with
    (frame,) = frames(1)
    assert [one.data for one in reader.read(frame)] == [frame]


def test_frames_after_a_stream_of_start_marks_are_read():
    reader = FrameReader()
    for _ in range(40):
        reader.read(b"\xfe" * 4096)
    sent = frames(30)
    heard = [frame.data for piece in sent * 20 for frame in reader.read(piece)]
    assert heard[-len(sent) * 10 :] == sent * 10
