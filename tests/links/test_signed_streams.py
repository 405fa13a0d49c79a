"""Signed frames of an earlier run are refused by the next one: the last timestamps are on disk."""

import json
import stat

import pytest
from pymavlink.dialects.v20 import common as dialect

from guidance.errors import ConfigError
from guidance.links.frames import FrameReader, SignatureCheck, SigningKey, ticks
from guidance.links.signed_streams import SignedStreams, state_folder
from guidance.links.udp import AddressPins
from tests.links.peer import Peer

KEY = bytes(range(32))
UNIX_S = 1_800_000_000.0
VEHICLE = ("127.0.0.1", 14580)
FORGER = ("127.0.0.1", 666)


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


def test_recorded_frames_take_no_place_after_a_restart(tmp_path):
    vehicle = Signing()
    key = key_in(tmp_path)
    pins = AddressPins({1}, {1: SignatureCheck(key)})
    recorded = [vehicle.beat() for _ in range(5)]
    assert all(pins.admit(0.1 * number, VEHICLE, frame) for number, frame in enumerate(recorded))
    key.streams.close()
    restarted = AddressPins({1}, {1: SignatureCheck(key_in(tmp_path))})
    for number, frame in enumerate(recorded):
        assert restarted.admit(float(number), FORGER, frame) == b""
    assert restarted.addresses == ()
    assert restarted.admit(9.0, VEHICLE, vehicle.beat())


def test_every_stream_has_a_timestamp_of_its_own(tmp_path):
    radio = Signing(1)
    cable = Signing(2)
    key = key_in(tmp_path)
    check = SignatureCheck(key)
    assert problem(check, radio.beat()) is None
    old = cable.beat()
    new = cable.beat()
    assert problem(check, new) is None
    key.streams.close()
    check = SignatureCheck(key_in(tmp_path))
    assert problem(check, old) == "refused"
    assert problem(check, radio.beat()) is None


def test_the_file_is_private_and_two_programs_with_one_key_keep_both_their_streams(tmp_path):
    one = SignedStreams(tmp_path / "new" / "signed.json")
    other = SignedStreams(one.path)
    one.note((0, 1, 1), 7)
    other.note((0, 2, 1), 8)
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
    streams.note((0, 1, 1), 7)
    streams.close()


def test_the_folder_is_systemds_or_the_users(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert state_folder() == tmp_path / "guidance"
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/guidance")
    assert str(state_folder()) == "/var/lib/guidance"
