from pymavlink.dialects.v20 import common as dialect

from guidance.frames import Ned
from guidance.links import MemoryWire
from guidance.links.evaders.carriers import FOLLOW_TARGET
from guidance.links.evaders.mavlink import MavlinkEvader
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.links.wires.base import PACKET_QUEUE_LENGTH, share
from guidance.messages import Heartbeat, Setpoint
from tests.links.peer import Peer


def test_a_vehicle_and_its_evader_share_a_wire():
    ours, theirs = MemoryWire.pair(lambda: 1.0)
    for_link, for_evader = share(ours, 2)
    link = PymavlinkLink(for_link, lambda: 1.0, system_id=1)
    source = MavlinkEvader(for_evader, FOLLOW_TARGET, system_id=9)
    peer = Peer(theirs.send)
    peer.heartbeat()
    zeros = [0.0] * 3
    report = dialect.MAVLink_follow_target_message(
        5, 3, 470000000, 80000000, 500, [1, 0, 0], zeros, [1, 0, 0, 0], zeros, zeros, 0
    )
    peer.say(report, system_id=9)
    assert [type(message) for message in link.receive()] == [Heartbeat]
    assert [found.latitude_deg for found in source.receive()] == [47.0]
    assert link.receive() == []
    theirs.receive()
    link.send_setpoint(Setpoint(Ned((1.0, 0.0, 0.0))))
    assert len(theirs.receive()) == 1


def test_the_wire_closes_with_its_last_reader():
    ours, theirs = MemoryWire.pair(lambda: 1.0)
    one, other = share(ours, 2)
    one.close()
    one.close()
    one.send(b"x")
    theirs.send(b"still open")
    assert [data for _, data in other.receive()] == [b"still open"]
    assert theirs.receive() == []
    other.close()
    theirs.send(b"closed")
    assert theirs.counters()["wire_unsent"] == 1


def test_a_slow_reader_loses_the_oldest_packets_and_counts_them():
    ours, theirs = MemoryWire.pair(lambda: 1.0)
    awake, asleep = share(ours, 2)
    for n in range(PACKET_QUEUE_LENGTH + 10):
        theirs.send(str(n).encode())
        awake.receive()
    kept = asleep.receive()
    assert len(kept) == PACKET_QUEUE_LENGTH
    assert kept[-1][1] == str(PACKET_QUEUE_LENGTH + 9).encode()
    assert asleep.counters()["share_dropped"] == 10
