"""A link beyond decoding: joined texts, TIMESYNC, filtering, bounds."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from guidance.links import MemoryWire
from guidance.links.mavlink.pymavlink_link import MESSAGE_QUEUE_LENGTH, PymavlinkLink
from guidance.messages import CommandAck, LocalPosition, StatusText, Timesync
from tests.links.peer import Peer


class World:
    """A link, its peer, and the clock they share, which moves only when told."""

    def __init__(self, **options) -> None:
        self.now_s = 100.0
        ours, self.theirs = MemoryWire.pair(lambda: self.now_s)
        self.peer = Peer(self.theirs.send, system_id=1)
        self.link = PymavlinkLink(ours, lambda: self.now_s, system_id=1, **options)

    def exchange(self) -> list:
        messages = list(self.link.receive())
        for _, data in self.theirs.receive():
            self.peer.hear(data)
        return messages

    def text(self, text: bytes, message_id: int = 0, sequence: int = 0) -> None:
        self.peer.say(dialect.MAVLink_statustext_message(4, text, message_id, sequence))


def texts(messages: list) -> list[str]:
    return [message.text for message in messages if isinstance(message, StatusText)]


def test_a_short_text_is_complete_at_once():
    world = World()
    world.text(b"Preflight Fail: ekf2 missing data")
    assert world.exchange() == [StatusText(100.0, 4, "Preflight Fail: ekf2 missing data")]


@given(st.text(alphabet="abcdefghij", min_size=1, max_size=400).filter(lambda text: len(text) % 50))
def test_chunks_are_joined_into_the_text_that_was_sent(text):
    world = World()
    for sequence in range(0, len(text), 50):
        world.text(text[sequence : sequence + 50].encode(), 9, sequence // 50)
    assert texts(world.exchange()) == [text]


def test_a_lost_chunk_shows_and_a_lost_end_times_out_after_a_second():
    world = World()
    world.text(b"a" * 50, 3, 0)
    world.text(b"c" * 50, 3, 2)
    assert texts(world.exchange()) == []
    world.now_s += 1.1
    assert texts(world.exchange()) == ["a" * 50 + "…" + "c" * 50]


def test_a_new_text_ends_an_unfinished_one():
    world = World()
    world.text(b"a" * 50, 3, 0)
    world.text(b"whole", 0)
    assert texts(world.exchange()) == ["a" * 50, "whole"]


def test_a_text_without_an_end_is_bounded():
    world = World()
    for sequence in range(256):
        world.text(b"x" * 50, 5, sequence % 256)
    assert all(len(text) <= 50 * 17 for text in texts(world.exchange()))


def test_text_that_is_not_utf8_is_shown_as_far_as_possible():
    world = World()
    world.text(b"\xff\xfe bad \x80")
    assert "bad" in texts(world.exchange())[0]


def test_timesync_questions_are_answered_with_our_time():
    world = World()
    world.peer.say(dialect.MAVLink_timesync_message(0, 777))
    world.exchange()
    (answer,) = world.peer.of("TIMESYNC")
    assert (answer.tc1, answer.ts1) == (100_000_000_000, 777)


def test_timesync_is_asked_four_times_a_second_and_only_answers_to_us_count():
    world = World()
    world.exchange()
    assert world.peer.of("TIMESYNC") == []
    world.peer.heartbeat()
    for _ in range(80):  # five seconds
        world.now_s += 0.0625
        world.exchange()
    asked = [message.ts1 for message in world.peer.of("TIMESYNC") if message.tc1 == 0]
    assert len(asked) == 20
    world.peer.say(dialect.MAVLink_timesync_message(5_000_000_000, asked[-1]))
    world.peer.say(dialect.MAVLink_timesync_message(5_000_000_000, asked[-1]))  # a duplicate
    world.peer.say(dialect.MAVLink_timesync_message(6_000_000_000, 12345))  # another companion's
    answers = [message for message in world.exchange() if isinstance(message, Timesync)]
    assert answers == [Timesync(world.now_s, remote_ns=5_000_000_000, local_ns=asked[-1])]


def test_answers_to_other_stations_are_dropped():
    world = World()
    for target in ((1, 195), (255, 190), (1, 191), (0, 0)):
        world.peer.say(dialect.MAVLink_command_ack_message(400, 0, 0, 0, *target))
    assert [type(message) for message in world.exchange()] == [CommandAck, CommandAck]
    assert world.link.counters()["for_others"] == 2


def test_implausible_values_are_counted_and_dropped():
    world = World()
    world.peer.say(dialect.MAVLink_local_position_ned_message(1, float("nan"), 0, 0, 0, 0, 0))
    world.peer.say(dialect.MAVLink_global_position_int_message(1, 0, 0, 0, 0, 0, 0, 0, 0))
    assert world.exchange() == []
    assert world.link.counters()["invalid"] == 2


def test_unread_messages_are_bounded_and_the_newest_kept():
    world = World()
    total = MESSAGE_QUEUE_LENGTH + 500
    for n in range(total):
        world.peer.local_position(n)
        if n % 500 == 0:
            world.link.poll()
    kept = [
        message.time_boot_s for message in world.exchange() if isinstance(message, LocalPosition)
    ]
    assert len(kept) == MESSAGE_QUEUE_LENGTH
    assert kept[-1] == pytest.approx((total - 1) / 1e3)
    assert world.link.counters()["overflowed"] == 500
