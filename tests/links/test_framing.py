import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from guidance.links.framing import CRC_EXTRA, Framer
from tests.links.peer import Peer


def frames(count: int, *, v1: bool = False) -> list[bytes]:
    peer = Peer(lambda data: None)
    return [peer.packed(dialect.MAVLink_local_position_ned_message(n, n, 0, 0, 0, 0, n), v1=v1) for n in range(count)]


@given(cuts=st.lists(st.integers(0, 400), max_size=20), v1=st.booleans())
def test_a_stream_may_be_cut_anywhere(cuts, v1):
    sent = frames(8, v1=v1)
    stream = b"".join(sent)
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    framer = Framer(CRC_EXTRA)
    heard = [frame for a, b in itertools.pairwise(edges) for frame in framer.feed(stream[a:b])]
    assert [frame.data for frame in heard] == sent
    assert {(frame.message_id, frame.system_id, frame.component_id) for frame in heard} == {(32, 1, 1)}
    assert framer.garbage_bytes == 0


@given(garbage=st.lists(st.binary(max_size=40), min_size=5, max_size=5))
def test_garbage_between_frames_costs_no_frame(garbage):
    sent = frames(4)
    tail = frames(8)[4:]  # enough to fill up any length that garbage may have promised
    stream = b"".join(noise + frame for noise, frame in zip(garbage, [*sent, b""], strict=True)) + b"".join(tail) * 8
    framer = Framer(CRC_EXTRA)
    heard = [frame.data for frame in framer.feed(stream)]
    assert [data for data in heard if data in sent] == sent


@given(position=st.integers(0, 37), bit=st.integers(0, 7))
def test_no_frame_with_a_wrong_bit_is_taken_for_a_frame(position, bit):
    (frame,) = frames(1)
    spoilt = bytearray(frame)
    spoilt[position % len(frame)] ^= 1 << bit
    heard = Framer(CRC_EXTRA).feed(bytes(spoilt), stream=False)
    assert heard == []


def test_a_datagram_cut_short_spoils_nothing_of_the_next_one():
    framer = Framer(CRC_EXTRA)
    first, second = frames(2)
    assert framer.feed(first[:-5], stream=False) == []
    assert [frame.data for frame in framer.feed(second, stream=False)] == [second]


def test_unknown_messages_are_skipped_and_counted():
    framer = Framer(CRC_EXTRA)
    (known,) = frames(1)
    unknown = bytes([0xFD, 3, 0, 0, 0, 1, 1]) + (70000).to_bytes(3, "little") + b"abc" + b"\x12\x34"
    assert [frame.data for frame in framer.feed(unknown + known + unknown)] == [known]
    assert framer.unknown == 2
    assert framer.garbage_bytes == 0


def test_a_length_that_cannot_be_checked_swallows_nothing():
    framer = Framer(CRC_EXTRA)
    sent = frames(4)
    inside = b"".join(sent)
    lie = bytes([0xFD, len(inside) - 2, 0, 0, 0, 1, 1]) + (70000).to_bytes(3, "little") + inside
    assert [frame.data for frame in framer.feed(lie + sent[0])] == [*sent, sent[0]]


def test_what_waits_for_a_rest_that_never_comes_is_bounded():
    framer = Framer(CRC_EXTRA)
    for _ in range(1000):
        framer.feed(b"\xfd\xff\x00" + bytes(97))
    assert framer.garbage_bytes > 90_000


def test_frames_of_flags_we_do_not_know_are_not_believed():
    framer = Framer(CRC_EXTRA)
    (frame,) = frames(1)
    flagged = frame[:2] + b"\x02" + frame[3:]
    assert framer.feed(flagged, stream=False) == []


def test_a_signed_frame_is_one_frame():
    peer = Peer(lambda data: None)
    peer.mavlink.signing.secret_key = bytes(32)
    peer.mavlink.signing.sign_outgoing = True
    signed = peer.packed(dialect.MAVLink_local_position_ned_message(1, 2, 3, 4, 5, 6, 7))
    (frame,) = Framer(CRC_EXTRA).feed(signed + frames(1)[0])[:1]
    assert frame.signed
    assert frame.data == signed


@pytest.mark.parametrize("byte", [0xFD, 0xFE])
def test_a_piece_that_promises_frame_after_frame_is_given_up(byte):
    lookups, checked = CountedLookups(CRC_EXTRA), 65_000
    framer = Framer(lookups)
    assert framer.feed(bytes([byte]) * checked, stream=False) == []
    assert framer.garbage_bytes + framer.unknown >= checked - 300
    assert lookups.count <= 130
    (frame,) = frames(1)
    assert [one.data for one in framer.feed(frame, stream=False)] == [frame]


def test_a_stream_of_broken_promises_is_passed_over_and_what_follows_is_heard():
    framer = Framer(CRC_EXTRA)
    for _ in range(40):
        framer.feed(b"\xfe" * 4096)
    sent = frames(30)
    heard = [frame.data for piece in sent * 20 for frame in framer.feed(piece)]
    assert heard[-len(sent) * 10 :] == sent * 10


class CountedLookups(dict):
    """Counts the candidates that were looked at: the framer's work."""

    count = 0

    def get(self, key, default=None):
        self.count += 1
        return super().get(key, default)
