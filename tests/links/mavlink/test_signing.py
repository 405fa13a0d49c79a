"""MAVLink 2 signing over pymavlink: signed both ways, nothing unsigned is believed, nothing old is believed twice."""

import pytest
from pymavlink.dialects.v20 import common as dialect

from guidance.errors import ConfigError
from guidance.frames import Ned
from guidance.links import MemoryWire, SigningKey
from guidance.links.mavlink.frames import ticks
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.messages import LocalPosition, Setpoint
from tests.links.peer import Peer

KEY = bytes(range(32))
OTHER_KEY = bytes(range(1, 33))
UNIX_S = 1_800_000_000.0


class World:
    def __init__(self, key: bytes | None = KEY, *, unix_s: float = UNIX_S) -> None:
        self.now_s = 0.0
        ours, self.theirs = MemoryWire.pair(lambda: self.now_s)
        self.peer = Peer(self.theirs.send)
        self.sign(KEY)
        signing_key = SigningKey(key, unix_s) if key is not None else None
        self.link = PymavlinkLink(ours, lambda: self.now_s, system_id=1, signing_key=signing_key)

    def sign(self, key: bytes | None, *, unix_s: float = UNIX_S) -> None:
        self.peer.mavlink.signing.secret_key = key
        self.peer.mavlink.signing.sign_outgoing = key is not None
        self.peer.mavlink.signing.timestamp = ticks(unix_s)

    def heard(self) -> int:
        return sum(isinstance(message, LocalPosition) for message in self.link.receive())


def test_frames_signed_with_our_key_are_accepted():
    world = World()
    world.peer.local_position(1)
    world.peer.local_position(2)
    assert world.heard() == 2


@pytest.mark.parametrize(("key", "reason"), [(None, "unsigned"), (OTHER_KEY, "refused")])
def test_frames_without_a_signature_or_with_another_key_are_not(key, reason):
    world = World()
    world.sign(key)
    world.peer.local_position(1)
    assert world.heard() == 0
    assert world.link.counters()[reason] == 1


def test_mavlink_1_cannot_slip_past_the_signature():
    world = World()
    world.sign(None)
    world.peer.local_position(1, v1=True)
    assert world.heard() == 0
    assert world.link.counters()["unsigned"] == 1


def test_a_frame_is_not_believed_a_second_time():
    world = World()
    frame = world.peer.packed(dialect.MAVLink_local_position_ned_message(1, 1, 2, 3, 4, 5, 6))
    world.theirs.send(frame)
    assert world.heard() == 1
    world.theirs.send(frame)
    assert world.heard() == 0
    assert world.link.counters()["refused"] == 1


def test_yesterdays_frames_are_not_believed():
    world = World()
    world.sign(KEY, unix_s=UNIX_S - 86_400.0)
    world.peer.local_position(1)
    assert world.heard() == 0


def test_a_forged_frame_from_the_future_does_not_make_the_genuine_ones_old():
    world = World()
    world.sign(OTHER_KEY, unix_s=UNIX_S + 1e6)
    world.peer.local_position(1)
    assert world.heard() == 0
    world.sign(KEY)
    world.peer.local_position(2)
    assert world.heard() == 1
    world.sign(OTHER_KEY, unix_s=UNIX_S + 1e6)
    world.peer.local_position(3)
    world.sign(KEY, unix_s=UNIX_S + 1.0)
    world.peer.local_position(4)
    assert world.heard() == 1


def test_everything_we_send_is_signed_with_a_time_that_rises():
    world = World()
    times = []
    reader = dialect.MAVLink(None)
    reader.signing.secret_key = KEY
    for n in range(3):
        world.now_s = n * 10.0
        world.link.send_setpoint(Setpoint(Ned((1.0, 0.0, 0.0))))
        world.link.send_heartbeat()
        for _, frame in world.theirs.receive():
            message = reader.decode(bytearray(frame))  # raises unless signed with the key
            assert message.get_signed()
            assert message.get_link_id() == 0
            times.append(int.from_bytes(frame[-12:-6], "little"))
    assert times == sorted(set(times))
    assert times[-1] - times[0] >= 20 * 100_000
    assert times[0] >= ticks(UNIX_S)


def test_without_a_key_signed_frames_are_accepted_too():
    world = World(None)
    world.peer.local_position(1)
    assert world.heard() == 1


def test_a_key_is_64_hexadecimal_digits_and_never_shown():
    key = SigningKey.from_hex(KEY.hex() + "\n")
    assert key.secret == KEY
    assert KEY.hex() not in repr(key)
    assert repr(KEY) not in repr(key)
    for text in ("", KEY.hex()[:-1], "z" * 64, KEY.hex() + "00"):
        with pytest.raises(ConfigError) as caught:
            SigningKey.from_hex(text)
        assert not text or text not in str(caught.value)
    with pytest.raises(ConfigError, match="must have 32"):
        SigningKey(b"short")


def test_signing_counts_from_2015():
    assert ticks(1_420_070_400.0) == 0
    assert ticks(1_420_070_401.0) == 100_000
