"""Signed frames of an earlier run are refused by the next one: bounds on their timestamps are on disk."""

import json
import stat
import tempfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from guidance.errors import ConfigError
from guidance.links.mavlink.frames import FrameReader, SignatureCheck, SigningKey, ticks
from guidance.links.mavlink.ground_link import COMPONENT_ID, GroundLink
from guidance.links.mavlink.signed_streams import (
    LEAD_S,
    MOST_FRAMES_WAITING,
    SignedStreams,
    state_folder,
)
from guidance.links.wires.base import MemoryWire
from guidance.links.wires.udp import AddressPins
from tests.links.peer import Peer

KEY = bytes(range(32))
UNIX_S = 1_800_000_000.0
VEHICLE = ("127.0.0.1", 14580)
FORGER = ("127.0.0.1", 666)
LEAD = round(LEAD_S * 100_000)


class Signing(Peer):
    """A vehicle that signs; every frame is newer than the last one."""

    def __init__(self, link_id: int = 0) -> None:
        super().__init__(lambda data: None)
        signing = self.mavlink.signing
        signing.secret_key = KEY
        signing.sign_outgoing = True
        signing.link_id = link_id
        signing.timestamp = ticks(UNIX_S)

    def beat(self) -> bytes:
        return self.packed(dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3))


def key_in(folder):
    """Return the key as a program that has just started reads it; its own clock stands, as after a crash."""
    key = SigningKey.from_hex(KEY.hex(), streams=folder)
    return SigningKey(key.secret, UNIX_S, key.streams)


def problem(check, frame):
    return check.problem(FrameReader().first(frame))


def written(key, check, frame):
    """Offer the first frame of a stream until the file has a bound for it; the thread writes it."""
    for _ in range(MOST_FRAMES_WAITING // 2):
        reason = problem(check, frame)
        if reason is None:
            return
        assert reason == "unsaved"
        key.streams.write()
    raise AssertionError


@pytest.mark.parametrize("ending", ["in order", "crash"])
def test_recorded_frames_take_no_place_after_a_restart(tmp_path, ending):
    vehicle = Signing()
    key = key_in(tmp_path)
    written(key, SignatureCheck(key), vehicle.beat())
    pins = AddressPins({1}, {1: SignatureCheck(key)})
    recorded = [vehicle.beat() for _ in range(5)]
    assert all(pins.admit(0.1 * number, VEHICLE, frame) for number, frame in enumerate(recorded))
    if ending == "in order":
        key.streams.close()
    key = key_in(tmp_path)
    check = SignatureCheck(key)
    restarted = AddressPins({1}, {1: check})
    for number, frame in enumerate(recorded):
        assert restarted.admit(float(number), FORGER, frame) == b""
    assert restarted.addresses == ()
    if ending == "crash":
        assert problem(check, vehicle.beat()) == "refused"
        vehicle.mavlink.signing.timestamp += LEAD
    written(key, check, vehicle.beat())
    assert restarted.admit(9.0, VEHICLE, vehicle.beat())


@given(st.lists(st.tuples(st.integers(0, 3 * LEAD), st.booleans()), min_size=1, max_size=30))
def test_whenever_a_program_dies_every_frame_that_it_used_is_refused_and_no_fresh_one_waits_longer(
    steps,
):
    vehicle = Signing()
    with tempfile.TemporaryDirectory() as folder:
        key = key_in(Path(folder))
        check = SignatureCheck(key)
        used = []
        for ticks_later, is_slow in steps:
            vehicle.mavlink.signing.timestamp += ticks_later
            frame = vehicle.beat()
            if problem(check, frame) is None:
                used.append(frame)
            elif not is_slow:
                key.streams.write()
        restarted = SignatureCheck(key_in(Path(folder)))
        key.streams.close()
    assert {problem(restarted, frame) for frame in used} <= {"refused"}
    vehicle.mavlink.signing.timestamp += LEAD
    assert problem(restarted, vehicle.beat()) in {None, "unsaved"}


def test_the_bound_is_renewed_long_before_it_is_reached(tmp_path):
    vehicle = Signing()
    key = key_in(tmp_path)
    check = SignatureCheck(key)
    written(key, check, vehicle.beat())
    for _ in range(20):
        vehicle.mavlink.signing.timestamp += LEAD // 2
        assert problem(check, vehicle.beat()) is None
        key.streams.write()  # as the thread does


def test_every_stream_has_a_timestamp_of_its_own(tmp_path):
    radio = Signing(1)
    cable = Signing(2)
    key = key_in(tmp_path)
    check = SignatureCheck(key)
    written(key, check, radio.beat())
    old = cable.beat()
    written(key, check, cable.beat())
    key.streams.close()
    key = key_in(tmp_path)
    check = SignatureCheck(key)
    assert problem(check, old) == "refused"
    written(key, check, radio.beat())


def test_the_file_is_private_and_two_programs_with_one_key_keep_both_their_streams(tmp_path):
    one = SignedStreams(tmp_path / "new" / "signed.json")
    other = SignedStreams(one.path)
    one.may_use((0, 1, 1), 7)
    other.may_use((0, 2, 1), 8)
    one.close()
    other.close()
    assert json.loads(one.path.read_text()) == {"0/1/1": 7, "0/2/1": 8}
    assert stat.S_IMODE(one.path.stat().st_mode) == 0o600
    assert SignedStreams(one.path).at_start == {(0, 1, 1): 7, (0, 2, 1): 8}


@pytest.mark.parametrize(
    "text", ["", "[]", "5", '{"a": 1}', '{"0/1/1": -1}', '{"0/1/1": true}', "[" * 9999]
)
def test_a_damaged_file_is_named_and_never_taken_for_none(tmp_path, text):
    path = tmp_path / "signed.json"
    path.write_text(text)
    path.chmod(0o600)
    with pytest.raises(ConfigError, match="damaged"):
        SignedStreams(path)


def test_a_disk_that_refuses_stops_no_flight(tmp_path):
    (tmp_path / "file").write_text("")
    streams = SignedStreams(tmp_path / "file" / "signed.json")
    uses = [streams.may_use((0, 1, 1), number) for number in range(MOST_FRAMES_WAITING + 50)]
    assert uses == [False] * MOST_FRAMES_WAITING + [True] * 50
    assert streams.unsaved == 50
    streams.close()


def test_the_folder_is_systemds_or_the_users(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert state_folder() == tmp_path / "guidance"
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/guidance")
    assert str(state_folder()) == "/var/lib/guidance"


@pytest.mark.parametrize("beats", [True, False])
def test_an_order_that_is_sent_once_is_read_if_its_sender_was_heard_in_the_last_seconds(
    tmp_path, beats
):
    """QGroundControl and MAVProxy send a HEARTBEAT each second, and an order now and then."""
    key = key_in(tmp_path)
    ours, theirs = MemoryWire.pair(lambda: 0.0)
    link = GroundLink(ours, lambda: 0.0, system_id=1, stations=[255], signing_key=key)
    station = Signing()
    station.mavlink.srcSystem = 255
    hold = dialect.MAVLink_command_long_message(1, COMPONENT_ID, 31010, *[0] * 8)
    heard = []
    for second in range(60):
        station.mavlink.signing.timestamp += 100_000
        if beats:
            theirs.send(station.beat())
        if second % 20 == 10:
            theirs.send(station.packed(hold))
        heard += link.receive()
        key.streams.write()  # as the thread does
    assert len(heard) == (3 if beats else 0)
    assert all(command.signed for command in heard)
    link.close()
    key.streams.close()
