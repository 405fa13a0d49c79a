"""Who gets in on a port that anybody may send to."""

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from guidance.links.wires.udp import MOST_SYSTEMS, OTHERS_PER_S, SILENT_S, Peers
from tests.links.peer import Peer

VEHICLE, FORGER = ("127.0.0.1", 14580), ("127.0.0.1", 666)


def heartbeat(system_id: int = 1) -> bytes:
    return Peer(lambda data: None, system_id=system_id).packed(dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3))


def test_the_peer_is_who_first_speaks_as_the_vehicle():
    peers = Peers({1})
    assert list(peers) == []
    assert peers.admit(0.0, VEHICLE, heartbeat()) == heartbeat()
    assert list(peers) == [VEHICLE]


def test_what_a_peer_sends_gets_in_unread():
    peers = Peers({1})
    peers.admit(0.0, VEHICLE, heartbeat())
    assert peers.admit(0.1, VEHICLE, b"half a frame") == b"half a frame"


@given(data=st.binary(max_size=300))
def test_bytes_make_nobody_a_peer(data):
    peers = Peers({1})
    assert peers.admit(0.0, FORGER, data) == b""
    assert list(peers) == []
    assert peers.refused["garbage"] == 1


def test_nobody_takes_the_number_of_a_living_vehicle():
    peers = Peers({1})
    for tenth in range(100):
        now_s = 0.1 * tenth
        assert peers.admit(now_s, VEHICLE, heartbeat())
        for port in range(12):
            assert peers.admit(now_s, ("127.0.0.1", 700 + port), heartbeat()) == b""
    assert list(peers) == [VEHICLE]
    assert peers.refused["impostor"] == 1200


def test_a_vehicle_that_was_silent_may_come_back_from_another_address():
    peers = Peers({1})
    peers.admit(0.0, VEHICLE, heartbeat())
    elsewhere = ("127.0.0.1", 14590)
    assert peers.admit(SILENT_S - 0.01, elsewhere, heartbeat()) == b""
    assert peers.admit(SILENT_S, elsewhere, heartbeat()) == heartbeat()
    assert list(peers) == [elsewhere]


def test_of_other_systems_a_few_frames_get_in_so_that_an_error_can_name_them():
    peers = Peers({1})
    sent = heartbeat(7) + heartbeat(1)
    admitted = [peers.admit(5.0 + n * 1e-3, FORGER, sent) for n in range(900)]
    assert admitted == [heartbeat(7)] * OTHERS_PER_S + [b""] * (900 - OTHERS_PER_S)
    assert peers.refused["stranger"] == 900 - OTHERS_PER_S
    assert peers.admit(6.0, FORGER, sent) == heartbeat(7)
    assert list(peers) == []


def test_two_systems_at_one_address_are_one_peer():
    peers = Peers({1, 2})
    peers.admit(0.0, VEHICLE, heartbeat(2))
    assert peers.admit(0.1, VEHICLE, heartbeat(1)) == heartbeat(1)
    assert list(peers) == [VEHICLE]


def test_two_systems_at_two_addresses_are_two_peers():
    peers = Peers({1, 2})
    peers.admit(0.0, VEHICLE, heartbeat(1))
    peers.admit(0.0, ("127.0.0.1", 14555), heartbeat(2))
    assert list(peers) == [VEHICLE, ("127.0.0.1", 14555)]


def test_where_any_system_is_welcome_so_many_are_and_no_newcomer_drives_a_living_one_out():
    peers = Peers()
    for system_id in range(1, MOST_SYSTEMS + 1):
        assert peers.admit(0.0, ("127.0.0.1", system_id), heartbeat(system_id))
    peers.admit(2.0, FORGER, heartbeat(200))
    assert FORGER not in list(peers)
    for system_id in range(2, MOST_SYSTEMS + 1):
        peers.admit(2.5, ("127.0.0.1", system_id), heartbeat(system_id))
    peers.admit(SILENT_S, FORGER, heartbeat(200))
    assert sorted(peers) == sorted([FORGER, *(("127.0.0.1", one) for one in range(2, MOST_SYSTEMS + 1))])
