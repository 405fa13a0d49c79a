"""Wires alone: bounds, peers that go and come back, ports that are full. No claim of the contract is repeated here."""

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
from guidance.links.arrivals import MOST_WAITING, Arrivals
from guidance.links.wires import udp
from guidance.links.wires.shared import TappedWire, share
from guidance.links.wires.streams import SerialWire, Tail, TcpWire
from guidance.links.wires.udp import UdpWire
from guidance.links.wires.zenoh import ZenohWire
from tests.links.peer import Peer, until
from tests.links.rigs import clock, free_port, router_config

FRAME = Peer(lambda data: None).packed(dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3))


@contextlib.contextmanager
def closing(wire):
    try:
        yield wire
    finally:
        wire.close()


def received(wire, data: bytes) -> bool:
    got = []
    return until(lambda: got.extend(piece for _, piece in wire.receive()) or data in b"".join(got))


def heard_again(say, wire, data: bytes) -> bool:
    """Whether the wire hears it when it is said again and again (the first may fall on deaf ears)."""
    got = bytearray()

    def heard() -> bool:
        say()
        got.extend(b"".join(piece for _, piece in wire.receive()))
        return data in got

    return until(heard, timeout_s=10.0)


def test_arrivals_keep_the_newest_and_count_the_rest():
    arrivals = Arrivals[int](lambda: 1.0)
    for n in range(MOST_WAITING + 5):
        arrivals.put(n)
    assert [item for _, item in arrivals.take()] == list(range(5, MOST_WAITING + 5))
    assert arrivals.dropped == 5
    assert arrivals.take() == []


def test_arrivals_from_many_threads_are_all_there():
    arrivals = Arrivals[int](clock, most=10_000)
    threads = [threading.Thread(target=lambda: [arrivals.put(n) for n in range(1000)]) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(arrivals.take()) == 4000


@pytest.mark.parametrize("kind", ["tcp", "udp", "serial", "zenoh", "memory"])
def test_whoever_waits_at_a_wire_is_woken_when_something_arrives(kind, router):
    with contextlib.ExitStack() as stack:
        wire, say = stack.enter_context(told_by(kind, router))
        wire.wait(0.0)
        assert wire.receive() == []
        for _ in range(3):
            begun_s, got = clock(), []
            later = threading.Timer(0.02, say, [FRAME])
            later.start()
            while b"".join(data for _, data in got) != FRAME and clock() < begun_s + 20.0:
                wire.wait(60.0)  # a port may give a frame in two pieces
                got += wire.receive()
            later.join()
            assert begun_s + 0.015 < got[0][0] <= clock() < begun_s + 20.0


@contextlib.contextmanager
def told_by(kind, router):
    """A wire, and what says something to it."""
    with contextlib.ExitStack() as stack:
        if kind == "memory":
            wire, far = MemoryWire.pair(clock)
            yield wire, far.send
        elif kind == "serial":
            near, far = pty.openpty()
            stack.callback(os.close, near)
            stack.callback(os.close, far)
            wire = stack.enter_context(closing(SerialWire(clock, device=os.ttyname(far), baud=57600)))
            yield wire, lambda data: os.write(near, data)
        elif kind == "zenoh":
            endpoint = f"tcp/127.0.0.1:{router.port}"
            wire = stack.enter_context(closing(ZenohWire(clock, namespace="waited", endpoint=endpoint)))
            publisher = router.session.declare_publisher("waited/mavlink_raw/out")
            stack.callback(publisher.undeclare)
            assert until(lambda: publisher.matching_status.matching)
            yield wire, publisher.put
        elif kind == "udp":
            wire = stack.enter_context(closing(UdpWire(clock, host="127.0.0.1", port=0, listen=True)))
            caller = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            yield wire, lambda data: caller.sendto(data, ("127.0.0.1", wire.port))
        else:
            wire = stack.enter_context(closing(TcpWire(clock, host="127.0.0.1", port=0, listen=True)))
            caller = stack.enter_context(socket.create_connection(("127.0.0.1", wire.port)))
            yield wire, caller.sendall


def test_nobody_waits_where_something_lies_already_or_the_wire_is_closed():
    ours, theirs = MemoryWire.pair(clock)
    datagrams = UdpWire(clock, host="127.0.0.1", port=0, listen=True)
    tapped = TappedWire(ours, clock, "uav1")
    first, second = share(tapped, 2)
    theirs.send(FRAME)
    begun_s = clock()
    tapped.wait(60.0)
    assert len(first.receive()) == 1
    second.wait(60.0)  # what the other has taken lies here for this one
    assert len(second.receive()) == 1
    with closing(datagrams), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as caller:
        caller.sendto(FRAME, ("127.0.0.1", datagrams.port))
        assert until(lambda: len(datagrams._arrivals) == 1)  # the reader has it
        datagrams.wait(60.0)
    datagrams.wait(60.0)
    first.close()
    second.close()
    ours.wait(60.0)
    assert clock() < begun_s + 10.0


def test_the_reader_of_datagrams_comes_back_when_nobody_waits_any_more():
    with (
        closing(UdpWire(clock, host="127.0.0.1", port=0, listen=True)) as wire,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as caller,
    ):
        wire.wait(0.05)
        caller.sendto(FRAME, ("127.0.0.1", wire.port))
        said_s = clock()
        assert until(lambda: len(wire._arrivals) == 1)
        assert wire.receive()[0][0] < said_s + 5.0


def test_a_closed_end_of_memory_takes_nothing():
    ours, theirs = MemoryWire.pair(clock)
    ours.send(b"a")
    ours.close()
    ours.close()
    theirs.send(b"b")
    assert theirs.receive() == []
    assert theirs.counters()["wire_unsent"] == 1


class Port:
    """A port that takes as many bytes as it has room for."""

    def __init__(self) -> None:
        self.room = 0
        self.taken = b""
        self.broken = False

    def write(self, data: bytes) -> int:
        if self.broken:
            raise ConnectionResetError
        if self.room == 0:
            raise BlockingIOError
        part = data[: self.room]
        self.room -= len(part)
        self.taken += part
        return len(part)


def test_a_full_port_never_sees_half_a_frame_followed_by_another():
    port = Port()
    tail = Tail(port.write)
    tail.send(b"AAAA")
    port.room = 2
    tail.send(b"BBBB")
    tail.send(b"CCCC")
    port.room = 100
    tail.send(b"DDDD")
    assert port.taken == b"BBBBDDDD"
    assert (tail.sent, tail.unsent) == (2, 2)


def test_a_port_that_broke_forgets_the_rest_of_its_frame():
    port = Port()
    tail = Tail(port.write)
    port.room = 2
    tail.send(b"BBBB")
    port.broken = True
    tail.send(b"CCCC")
    assert (tail.sent, tail.unsent) == (1, 1)
    port.broken, port.room = False, 100
    tail.send(b"DDDD")
    assert port.taken == b"BBDDDD"


def test_a_new_peer_begins_with_a_whole_frame():
    port = Port()
    tail = Tail(port.write)
    port.room = 2
    tail.send(b"BBBB")
    tail.forget()
    port.room = 100
    tail.send(b"CCCC")
    assert port.taken == b"BBCCCC"


def test_udp_answers_who_speaks_as_the_vehicle_and_nobody_else():
    wire = UdpWire(clock, host="127.0.0.1", port=0, listen=True, systems=(1,))
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
        vehicle.sendto(b"whatever comes after", ("127.0.0.1", wire.port))
        assert received(wire, b"whatever comes after")
        counters = wire.counters()
        assert (counters["wire_garbage"], counters["wire_impostor"]) == (1, 1)
        wire.send(FRAME)
        assert until(lambda: vehicle.recv(100) == FRAME)
        for one in (stranger, impostor):
            with pytest.raises(BlockingIOError):
                one.recv(100)


def test_udp_out_hears_only_whom_it_called():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as theirs, socket.socket(type=socket.SOCK_DGRAM) as stranger:
        theirs.bind(("127.0.0.1", 0))
        with closing(UdpWire(clock, host="127.0.0.1", port=theirs.getsockname()[1], listen=False)) as wire:
            wire.send(FRAME)
            data, address = theirs.recvfrom(100)
            assert data == FRAME
            stranger.sendto(b"\xfdstranger", address)
            theirs.sendto(b"\xfdfriend", address)
            assert received(wire, b"friend")
            assert wire.receive() == []


class Asleep:
    """A reader's thread that never gets its turn."""

    def __init__(self, read, *, name):
        pass

    def close(self):
        pass


def test_udp_reads_what_came_this_moment_itself_a_bounded_number_and_waits_for_no_thread(monkeypatch):
    monkeypatch.setattr(udp, "Reader", Asleep)
    wire = UdpWire(clock, host="127.0.0.1", port=0, listen=True, systems=(1,))
    with closing(wire), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        said = [FRAME, *(b"%d" % n for n in range(40))]
        for data in said:
            vehicle.sendto(data, ("127.0.0.1", wire.port))
        pieces = [[data for _, data in wire.receive()] for _ in range(4)]
        assert [len(one) for one in pieces] == [16, 16, 9, 0]
        assert [data for one in pieces for data in one] == said
        vehicle.sendto(FRAME, ("127.0.0.1", wire.port))
        with wire._reading:  # the other thread's turn
            assert wire.receive() == []
        assert [data for _, data in wire.receive()] == [FRAME]


def test_udp_keeps_the_order_while_the_loop_and_the_reader_both_read():
    got = list[bytes]()
    wire = UdpWire(clock, host="127.0.0.1", port=0, listen=True, systems=(1,))
    with closing(wire), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        for burst in range(100):
            said = [FRAME, *(b"%d" % n for n in range(20 * burst, 20 * burst + 20))]
            for data in said:
                vehicle.sendto(data, ("127.0.0.1", wire.port))
            got.clear()
            deadline_s = clock() + 2.0
            while len(got) < len(said) and clock() < deadline_s:
                if burst % 2:
                    wire.wait(2.0)  # else the reader's thread reads beside us
                got += [data for _, data in wire.receive()]
            assert got == said


def test_udp_to_a_port_nobody_has_keeps_going():
    with closing(UdpWire(clock, host="127.0.0.1", port=free_port(), listen=False)) as wire:
        for _ in range(10):
            wire.send(FRAME)
            time.sleep(0.001)
        assert wire.receive() == []
        with wire._reading:
            wire._arrivals.put(b"kept by the reader")
            wire.send(FRAME)
            assert until(lambda: wire._readable.poll(0))  # "refused" is to be read
        assert [data for _, data in wire.receive()] == [b"kept by the reader"]


def test_tcp_takes_the_next_caller_when_the_last_has_gone():
    with closing(TcpWire(clock, host="127.0.0.1", port=0, listen=True)) as wire:
        wire.send(FRAME)
        assert wire.counters()["wire_unsent"] == 1
        for word in (b"first", b"second"):
            with socket.create_connection(("127.0.0.1", wire.port)) as caller:
                caller.sendall(word)
                assert received(wire, word)
                wire.send(FRAME)
                assert caller.recv(100) == FRAME


def test_tcp_calls_again_when_the_other_side_comes_back():
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        port = server.getsockname()[1]
        wire = stack.enter_context(closing(TcpWire(clock, host="127.0.0.1", port=port, listen=False)))
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
        wire = stack.enter_context(closing(TcpWire(clock, host="127.0.0.1", port=port, listen=False)))
        stack.enter_context(server.accept()[0])
        slowest_s = 0.0
        for _ in range(3000):
            before_s = time.perf_counter()
            wire.send(FRAME * 100)
            slowest_s = max(slowest_s, time.perf_counter() - before_s)
        assert wire.counters()["wire_unsent"] > 0
        assert slowest_s < 0.05


@pytest.mark.parametrize("make", [UdpWire, TcpWire])
def test_a_port_in_use_is_a_link_error(make):
    kind = socket.SOCK_DGRAM if make is UdpWire else socket.SOCK_STREAM
    with socket.socket(socket.AF_INET, kind) as other:
        other.bind(("127.0.0.1", 0))
        with pytest.raises(LinkError, match="in use"):
            make(clock, host="127.0.0.1", port=other.getsockname()[1], listen=True)


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


def test_a_serial_port_that_is_pulled_out_raises_nothing_in_the_loop():
    ours, theirs = pty.openpty()
    with closing(SerialWire(clock, device=os.ttyname(theirs), baud=57600)) as wire:
        os.write(ours, b"alive")
        assert received(wire, b"alive")
        os.close(ours)
        os.close(theirs)
        assert until(lambda: (wire.send(FRAME), wire.counters()["wire_unsent"])[1] > 0)
        assert wire.receive() == []


def test_a_serial_port_that_is_plugged_in_again_goes_on(tmp_path):
    device = tmp_path / "ttyUSB0"  # as udev would: the same name for whatever is plugged in
    ours, theirs = pty.openpty()
    device.symlink_to(os.ttyname(theirs))
    with closing(SerialWire(clock, device=str(device), baud=57600)) as wire:
        os.close(ours)
        os.close(theirs)
        again, its = pty.openpty()
        device.unlink()
        device.symlink_to(os.ttyname(its))
        assert heard_again(lambda: os.write(again, b"again"), wire, b"again")
        os.set_blocking(again, False)
        wire.send(FRAME)
        sent = bytearray()

        def came() -> bool:
            with contextlib.suppress(BlockingIOError):
                sent.extend(os.read(again, 1000))  # a terminal's echo of what we said may come before it
            return FRAME in sent

        assert until(came)
    os.close(again)
    os.close(its)


def test_a_zenoh_router_that_dies_and_comes_back_is_found_again():
    port = free_port(socket.SOCK_STREAM)
    with contextlib.ExitStack() as stack:
        with zenoh.open(router_config(port)) as first:
            wire = stack.enter_context(closing(ZenohWire(clock, namespace="v", endpoint=f"tcp/127.0.0.1:{port}")))
            assert heard_again(lambda: first.put("v/mavlink_raw/out", b"one"), wire, b"one")
        before_s = time.perf_counter()
        for _ in range(50):
            wire.send(FRAME)
        assert time.perf_counter() - before_s < 0.5
        with zenoh.open(router_config(port)) as second:
            assert heard_again(lambda: second.put("v/mavlink_raw/out", b"two"), wire, b"two")


def test_zenoh_carries_one_frame_a_sample_marked_as_mavlink(router):
    with closing(ZenohWire(clock, namespace="q", endpoint=f"tcp/127.0.0.1:{router.port}")) as wire:
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


def test_zenoh_namespaces_are_apart_and_our_own_frames_do_not_come_back(router):
    endpoint = f"tcp/127.0.0.1:{router.port}"
    one_wire = ZenohWire(clock, namespace="a", endpoint=endpoint)
    other_wire = ZenohWire(clock, namespace="b", endpoint=endpoint)
    with closing(one_wire) as one, closing(other_wire) as other:
        assert heard_again(lambda: router.session.put("b/mavlink_raw/out", b"for b"), other, b"for b")
        one.send(FRAME)
        time.sleep(0.05)
        assert one.receive() == []
        assert FRAME not in b"".join(data for _, data in other.receive())


def test_zenoh_wants_an_endpoint_or_a_session_and_not_both():
    with pytest.raises(ValueError, match="exactly one"):
        ZenohWire(clock, namespace="a")
