"""Wires alone: bounds, peers that leave and return, full ports. The contract itself is tested in test_port.py."""

import contextlib
import os
import pty
import socket
import threading
import time

import pytest
import zenoh
from pymavlink.dialects.v20 import common as dialect

from guidance.errors import LinkError
from guidance.links import MemoryWire
from guidance.links.opening import open_wire
from guidance.links.wires import udp
from guidance.links.wires.base import PACKET_QUEUE_LENGTH, Arrivals
from guidance.links.wires.streams import SerialWire, StreamWire, TcpWire
from guidance.links.wires.tcp_in import TcpInWire
from guidance.links.wires.udp import AddressPins, UdpWire
from guidance.links.zenoh.session import open_session
from guidance.links.zenoh.wire import ZenohWire
from tests.links.peer import Peer, until
from tests.links.rigs import clock, free_port, router_config

FRAME = Peer(lambda data: None).packed(dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3))


def numbered(number):
    """Return a HEARTBEAT that carries this number."""
    return Peer(lambda data: None).packed(dialect.MAVLink_heartbeat_message(2, 12, 0, number, 4, 3))


@contextlib.contextmanager
def closing(wire):
    try:
        yield wire
    finally:
        wire.close()


def received(wire, data: bytes) -> bool:
    got = []
    return until(lambda: got.extend(piece for _, piece in wire.receive()) or data in b"".join(got))


def received_again(send, wire, data: bytes) -> bool:
    """Send repeatedly until the wire receives the data (the first may be lost)."""
    got = bytearray()

    def arrived() -> bool:
        send()
        got.extend(b"".join(piece for _, piece in wire.receive()))
        return data in got

    return until(arrived, timeout_s=10.0)


def test_arrivals_keep_the_newest_and_count_the_rest():
    arrivals = Arrivals[int]()
    for n in range(PACKET_QUEUE_LENGTH + 5):
        arrivals.put(n)
    assert arrivals.take() == list(range(5, PACKET_QUEUE_LENGTH + 5))
    assert arrivals.dropped == 5
    assert arrivals.take() == []


def test_arrivals_from_many_threads_are_all_there():
    arrivals = Arrivals[int]()
    threads = [
        threading.Thread(target=lambda: [arrivals.put(n) for n in range(250)]) for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(arrivals.take()) == 1000


@pytest.mark.parametrize("kind", ["tcp", "udp", "serial", "zenoh", "memory"])
def test_an_arrival_is_stamped_when_it_comes(kind, router):
    with contextlib.ExitStack() as stack:
        wire, send = stack.enter_context(opened(kind, router))
        assert wire.receive() == []
        for _ in range(3):
            begun_s = clock()
            got = []
            send(FRAME)
            # a port may deliver a frame in two pieces
            assert until(
                lambda got=got: (
                    b"".join(data for _, data in got.extend(wire.receive()) or got) == FRAME
                )
            )
            assert begun_s <= got[0][0] <= clock()


@contextlib.contextmanager
def opened(kind, router):
    """A wire, and a function that sends to it."""
    with contextlib.ExitStack() as stack:
        if kind == "memory":
            wire, far = MemoryWire.pair(clock)
            yield wire, far.send
        elif kind == "serial":
            near, far = pty.openpty()
            stack.callback(os.close, near)
            stack.callback(os.close, far)
            wire = stack.enter_context(
                closing(SerialWire(clock, device=os.ttyname(far), baud=57600))
            )
            yield wire, lambda data: os.write(near, data)
        elif kind == "zenoh":
            endpoint = f"tcp/127.0.0.1:{router.port}"
            wire = stack.enter_context(closing(ZenohWire(clock, open_session(endpoint), "waited")))
            publisher = router.session.declare_publisher("waited/mavlink_raw/out")
            stack.callback(publisher.undeclare)
            assert until(lambda: publisher.matching_status.matching)
            yield wire, publisher.put
        elif kind == "udp":
            wire = stack.enter_context(closing(UdpWire(clock, "127.0.0.1", 0, AddressPins())))
            caller = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            yield wire, lambda data: caller.sendto(data, ("127.0.0.1", wire.port))
        else:
            wire = stack.enter_context(closing(TcpInWire(clock, host="127.0.0.1", port=0)))
            caller = stack.enter_context(socket.create_connection(("127.0.0.1", wire.port)))
            yield wire, caller.sendall


def test_a_closed_memory_wire_accepts_nothing():
    ours, theirs = MemoryWire.pair(clock)
    ours.send(b"a")
    ours.close()
    ours.close()
    theirs.send(b"b")
    assert theirs.receive() == []
    assert theirs.counters()["wire_unsent"] == 1


class Port:
    """A port with limited room that sends nothing."""

    def __init__(self) -> None:
        self.near, self.far = socket.socketpair()
        self.near.setblocking(False)
        self.room = 0
        self.taken = b""
        self.broken = False

    def fileno(self) -> int:
        return self.near.fileno()

    def close(self) -> None:
        self.near.close()
        self.far.close()

    def write(self, _descriptor: int, data: bytes) -> int:
        if self.broken:
            raise ConnectionResetError
        if self.room == 0:
            raise BlockingIOError
        part = data[: self.room]
        self.room -= len(part)
        self.taken += part
        return len(part)


@pytest.fixture
def port(monkeypatch):
    port = Port()
    monkeypatch.setattr(os, "write", port.write)
    return port


@pytest.fixture
def wire(port):
    with closing(StreamWire(clock, "port", lambda: port, port)) as wire:
        yield wire


def sent(wire: StreamWire, frame: bytes) -> bool:
    before = wire.counters()["wire_sent"]
    wire.send(frame)
    return wire.counters()["wire_sent"] > before


def test_a_full_port_never_sees_half_a_frame_followed_by_another(port, wire):
    taken = [sent(wire, b"AAAA")]
    port.room = 2
    taken += [sent(wire, b"BBBB"), sent(wire, b"CCCC")]
    port.room = 100
    taken.append(sent(wire, b"DDDD"))
    assert port.taken == b"BBBBDDDD"
    assert taken == [False, True, False, True]


def test_a_broken_port_drops_the_rest_of_its_frame(port, wire):
    port.room = 2
    assert sent(wire, b"BBBB")
    port.broken = True
    assert not sent(wire, b"CCCC")
    port.broken = False
    port.room = 100
    sent(wire, b"DDDD")
    assert port.taken == b"BBDDDD"


def test_a_new_peer_gets_whole_frames_only(port, wire):
    port.room = 2
    sent(wire, b"BBBB")
    wire.take_up(Port())
    port.room = 100
    sent(wire, b"CCCC")
    assert port.taken == b"BBCCCC"


def test_udp_answers_the_vehicles_address_only():
    wire = UdpWire(clock, "127.0.0.1", 0, AddressPins({1}))
    with closing(wire), contextlib.ExitStack() as stack:
        stranger, vehicle, impostor = (
            stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(3)
        )
        for one in (stranger, vehicle, impostor):
            one.bind(("127.0.0.1", 0))
            one.setblocking(False)
        wire.send(FRAME)
        assert wire.counters()["wire_sent"] == 0
        stranger.sendto(b"hello", ("127.0.0.1", wire.port))
        vehicle.sendto(FRAME, ("127.0.0.1", wire.port))
        impostor.sendto(FRAME, ("127.0.0.1", wire.port))
        vehicle.sendto(numbered(1), ("127.0.0.1", wire.port))
        assert received(wire, numbered(1))
        counters = wire.counters()
        assert (counters["wire_garbage"], counters["wire_impostor"]) == (1, 1)
        wire.send(FRAME)
        assert until(lambda: vehicle.recv(100) == FRAME)
        for one in (stranger, impostor):
            with pytest.raises(BlockingIOError):
                one.recv(100)


def test_udp_out_receives_only_from_the_address_it_calls():
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as theirs,
        socket.socket(type=socket.SOCK_DGRAM) as stranger,
    ):
        theirs.bind(("127.0.0.1", 0))
        with closing(UdpWire(clock, "127.0.0.1", theirs.getsockname()[1])) as wire:
            wire.send(FRAME)
            data, address = theirs.recvfrom(100)
            assert data == FRAME
            stranger.sendto(b"\xfdstranger", address)
            theirs.sendto(b"\xfdfriend", address)
            assert received(wire, b"friend")
            assert wire.receive() == []


class Asleep:
    """A reader thread that never runs."""

    def __init__(self, read, *, name):
        pass

    def close(self):
        pass


def test_udp_receive_reads_the_socket_itself_a_bounded_number_at_once(monkeypatch):
    monkeypatch.setattr(udp, "Reader", Asleep)
    wire = UdpWire(clock, "127.0.0.1", 0, AddressPins({1}))
    with closing(wire), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        said = [FRAME, *map(numbered, range(40))]
        for data in said:
            vehicle.sendto(data, ("127.0.0.1", wire.port))
        pieces = [[data for _, data in wire.receive()] for _ in range(4)]
        assert [len(piece) for piece in pieces] == [16, 16, 9, 0]
        assert [data for piece in pieces for data in piece] == said
        vehicle.sendto(FRAME, ("127.0.0.1", wire.port))
        with wire.reading:  # the reader thread reads
            assert wire.receive() == []
        assert [data for _, data in wire.receive()] == [FRAME]


def test_a_udp_reader_rests_only_after_it_has_read_everything(monkeypatch):
    reads = []
    rests = []

    def asleep(read, *, name):
        reads.append(read)
        return Asleep(read, name=name)

    monkeypatch.setattr(udp, "Reader", asleep)
    monkeypatch.setattr("guidance.links.wires.udp.time.sleep", rests.append)
    wire = UdpWire(clock, "127.0.0.1", 0, AddressPins({1}), rest_s=0.1)
    with closing(wire), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        for data in map(numbered, range(20)):
            vehicle.sendto(data, ("127.0.0.1", wire.port))
        reads[0]()
        assert rests == []
        reads[0]()
        assert rests == [0.1]
        assert len(wire.receive()) == 20


def test_udp_keeps_the_order_while_the_loop_and_the_reader_both_read():
    got = list[bytes]()
    wire = UdpWire(clock, "127.0.0.1", 0, AddressPins({1}))
    with closing(wire), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        for burst in range(100):
            said = [FRAME, *map(numbered, range(20 * burst, 20 * burst + 20))]
            for data in said:
                vehicle.sendto(data, ("127.0.0.1", wire.port))
            got.clear()
            deadline_s = clock() + 2.0
            while len(got) < len(said) and clock() < deadline_s:
                if burst % 2:
                    time.sleep(0.002)  # the reader thread reads too
                got += [data for _, data in wire.receive()]
            assert got == said


def test_udp_to_an_unused_port_keeps_working():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        port = vehicle.getsockname()[1]
        wire = UdpWire(clock, "127.0.0.1", port)
        vehicle.sendto(FRAME, ("127.0.0.1", wire.port))
    with closing(wire):
        for _ in range(10):
            wire.send(FRAME)  # the kernel reports "refused"
            time.sleep(0.001)
        assert received(wire, FRAME)
        wire.send(FRAME)
        assert wire.receive() == []


def test_tcp_accepts_the_next_caller_after_the_last_has_left():
    with closing(TcpInWire(clock, host="127.0.0.1", port=0)) as wire:
        wire.send(FRAME)
        assert wire.counters()["wire_unsent"] == 1
        for word in (FRAME + b"first", FRAME + b"second"):
            with socket.create_connection(("127.0.0.1", wire.port)) as caller:
                caller.sendall(word)
                assert received(wire, word)
                wire.send(FRAME)
                assert caller.recv(100) == FRAME


def test_tcp_calls_again_when_the_other_side_returns():
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        port = server.getsockname()[1]
        wire = stack.enter_context(closing(TcpWire(clock, host="127.0.0.1", port=port)))
        first, _ = server.accept()
        first.close()
        server.close()
        assert until(lambda: (wire.send(FRAME), wire.counters()["wire_unsent"])[1] > 0)
        again = stack.enter_context(socket.create_server(("127.0.0.1", port)))
        second = stack.enter_context(again.accept()[0])
        second.sendall(b"back")
        assert received(wire, b"back")


def test_tcp_to_a_peer_that_does_not_read_never_blocks():
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        port = server.getsockname()[1]
        wire = stack.enter_context(closing(TcpWire(clock, host="127.0.0.1", port=port)))
        stack.enter_context(server.accept()[0])
        slowest_s = 0.0
        for _ in range(3000):
            before_s = time.perf_counter()
            wire.send(FRAME * 100)
            slowest_s = max(slowest_s, time.perf_counter() - before_s)
        assert wire.counters()["wire_unsent"] > 0
        assert slowest_s < 0.05


@pytest.mark.parametrize(
    ("scheme", "kind"), [("udpin", socket.SOCK_DGRAM), ("tcpin", socket.SOCK_STREAM)]
)
def test_a_port_in_use_is_a_link_error(scheme, kind):
    with socket.socket(socket.AF_INET, kind) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        with pytest.raises(LinkError, match=f"{port}.*in use"):
            open_wire(f"{scheme}://127.0.0.1:{port}", clock=clock)


def test_a_serial_port_that_is_full_never_blocks():
    ours, theirs = pty.openpty()
    with closing(SerialWire(clock, device=os.ttyname(theirs), baud=57600)) as wire:
        before_s = time.perf_counter()
        for _ in range(2000):
            wire.send(FRAME)
        assert time.perf_counter() - before_s < 2.0
        assert wire.counters()["wire_unsent"] > 0
    os.close(ours)
    os.close(theirs)


def test_unplugging_a_serial_port_raises_nothing_in_the_loop():
    ours, theirs = pty.openpty()
    with closing(SerialWire(clock, device=os.ttyname(theirs), baud=57600)) as wire:
        os.write(ours, b"alive")
        assert received(wire, b"alive")
        os.close(ours)
        os.close(theirs)
        assert until(lambda: (wire.send(FRAME), wire.counters()["wire_unsent"])[1] > 0)
        assert wire.receive() == []


def test_a_serial_port_that_is_plugged_in_again_works(tmp_path):
    device = tmp_path / "ttyUSB0"  # as udev does: the same name for each device
    ours, theirs = pty.openpty()
    device.symlink_to(os.ttyname(theirs))
    with closing(SerialWire(clock, device=str(device), baud=57600)) as wire:
        os.close(ours)
        os.close(theirs)
        again, its = pty.openpty()
        device.unlink()
        device.symlink_to(os.ttyname(its))
        assert received_again(lambda: os.write(again, b"again"), wire, b"again")
        os.set_blocking(again, False)
        wire.send(FRAME)
        sent = bytearray()

        def came() -> bool:
            with contextlib.suppress(BlockingIOError):
                sent.extend(os.read(again, 1000))  # the terminal may echo our data first
            return FRAME in sent

        assert until(came)
    os.close(again)
    os.close(its)


def test_zenoh_reconnects_to_a_restarted_router():
    port = free_port(socket.SOCK_STREAM)
    with contextlib.ExitStack() as stack:
        with zenoh.open(router_config(port)) as first:
            wire = stack.enter_context(
                closing(ZenohWire(clock, open_session(f"tcp/127.0.0.1:{port}"), "v"))
            )
            assert received_again(lambda: first.put("v/mavlink_raw/out", b"one"), wire, b"one")
        before_s = time.perf_counter()
        for _ in range(50):
            wire.send(FRAME)
        assert time.perf_counter() - before_s < 0.5
        with zenoh.open(router_config(port)) as second:
            assert received_again(lambda: second.put("v/mavlink_raw/out", b"two"), wire, b"two")


def test_zenoh_carries_one_frame_per_sample_marked_as_mavlink(router):
    with closing(ZenohWire(clock, open_session(f"tcp/127.0.0.1:{router.port}"), "q")) as wire:
        into = router.session.declare_subscriber("q/mavlink_raw/in", zenoh.handlers.FifoChannel(8))
        samples = []

        def came() -> bool:
            wire.send(FRAME)
            samples.extend(iter(into.try_recv, None))
            return bool(samples)

        assert until(came)
        sample = samples[0]
        assert sample.payload.to_bytes() == FRAME
        assert str(sample.encoding) == "application/octet-stream;mavlink"
        assert sample.congestion_control == zenoh.CongestionControl.DROP
        assert sample.priority == zenoh.Priority.REAL_TIME
        assert sample.express
        into.undeclare()


def test_zenoh_namespaces_are_separate_and_our_frames_do_not_return(router):
    endpoint = f"tcp/127.0.0.1:{router.port}"
    one_wire = ZenohWire(clock, open_session(endpoint), "a")
    other_wire = ZenohWire(clock, open_session(endpoint), "b")
    with closing(one_wire) as one, closing(other_wire) as other:
        assert received_again(
            lambda: router.session.put("b/mavlink_raw/out", b"for b"), other, b"for b"
        )
        one.send(FRAME)
        time.sleep(0.05)
        assert one.receive() == []
        assert FRAME not in b"".join(data for _, data in other.receive())
