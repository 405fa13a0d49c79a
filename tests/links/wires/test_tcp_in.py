"""A listening TCP port: nobody who is silent, or whose frames prove nothing, keeps the vehicle out."""

import contextlib
import math
import os
import socket
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as dialect

from guidance.links.mavlink.frames import SignatureCheck, SigningKey, ticks
from guidance.links.wires.tcp_in import MOST_CALLERS, MOST_UNPROVEN_BYTES, TcpInWire
from tests.links.peer import Peer, until
from tests.links.rigs import clock

KEY = bytes(range(32))
UNIX_S = 1_800_000_000.0


class Vehicle(Peer):
    """A vehicle that counts its HEARTBEATs in `custom_mode`, and signs them with a key."""

    def __init__(self, key=None, system_id=1):
        super().__init__(lambda data: None, system_id=system_id)
        self.number = 0
        signing = self.mavlink.signing
        signing.secret_key = key
        signing.sign_outgoing = key is not None
        signing.timestamp = ticks(UNIX_S)

    def beat(self):
        self.number += 1
        return self.packed(dialect.MAVLink_heartbeat_message(2, 12, 0, self.number, 4, 3))


@contextlib.contextmanager
def listening(key=None):
    checks = {} if key is None else {1: SignatureCheck(SigningKey(key, UNIX_S))}
    wire = TcpInWire(clock, host="127.0.0.1", port=0, systems={1}, checks=checks)
    with contextlib.closing(wire):
        yield wire


def call(stack, wire):
    return stack.enter_context(socket.create_connection(("127.0.0.1", wire.port)))


def keepalive_s(port, peer_port):
    """Return how long the kernel waits before it asks the peer of a connection again; infinite if it does not ask."""
    for line in Path("/proc/net/tcp").read_text().splitlines()[1:]:
        _, local, remote, _, _, timer, *_ = line.split()
        if (local[-5:], remote[-5:]) == (f":{port:04X}", f":{peer_port:04X}"):
            kind, ticks_left = (int(part, 16) for part in timer.split(":"))
            return ticks_left / os.sysconf("SC_CLK_TCK") if kind == 2 else math.inf
    return math.inf


def arrives(wire, data):
    heard = bytearray()

    def arrived():
        heard.extend(b"".join(piece for _, piece in wire.receive()))
        return data in heard

    return until(arrived)


@pytest.mark.parametrize("key", [None, KEY])
@pytest.mark.parametrize("said", [b"", b"GET / HTTP/1.1\r\n\r\n", Vehicle(system_id=9).beat()])
def test_idle_callers_and_strangers_keep_no_vehicle_out(key, said):
    vehicle = Vehicle(key)
    with contextlib.ExitStack() as stack:
        wire = stack.enter_context(listening(key))
        for _ in range(MOST_CALLERS):
            call(stack, wire).sendall(said)
        caller = call(stack, wire)
        beat = vehicle.beat()
        caller.sendall(beat)
        assert arrives(wire, beat)
        wire.send(b"answer")
        assert caller.recv(100) == b"answer"


def test_a_vehicle_that_calls_again_takes_the_place_of_its_old_connection():
    vehicle = Vehicle()
    with contextlib.ExitStack() as stack:
        wire = stack.enter_context(listening())
        for _ in range(3):  # the old connections stay open: their other end has lost power
            caller = call(stack, wire)
            beat = vehicle.beat()
            caller.sendall(beat)
            assert arrives(wire, beat)
            wire.send(b"answer")
            assert caller.recv(100) == b"answer"


def test_with_a_key_recorded_or_forged_frames_take_no_place():
    vehicle = Vehicle(KEY)
    with contextlib.ExitStack() as stack:
        wire = stack.enter_context(listening(KEY))
        caller = call(stack, wire)
        recorded = [vehicle.beat() for _ in range(3)]
        caller.sendall(b"".join(recorded))
        assert arrives(wire, recorded[-1])
        call(stack, wire).sendall(b"".join(recorded))
        call(stack, wire).sendall(Vehicle(bytes(32)).beat())
        call(stack, wire).sendall(Vehicle().beat())
        for _ in range(3):
            beat = vehicle.beat()
            caller.sendall(beat)
            assert arrives(wire, beat)
        wire.send(b"answer")
        assert caller.recv(100) == b"answer"


def test_a_vehicle_that_waits_for_our_heartbeat_gets_it():
    with contextlib.ExitStack() as stack:
        wire = stack.enter_context(listening())
        caller = call(stack, wire)
        caller.settimeout(3.0)
        assert until(lambda: wire.send(b"beat") or wire.counters()["wire_sent"] > 0)
        assert caller.recv(100).startswith(b"beat")


def test_a_caller_that_sends_without_end_and_proves_nothing_is_closed():
    with contextlib.ExitStack() as stack:
        wire = stack.enter_context(listening())
        caller = call(stack, wire)
        caller.settimeout(3.0)
        with contextlib.suppress(ConnectionError):
            caller.sendall(bytes(2 * MOST_UNPROVEN_BYTES))
            assert caller.recv(1) == b""


def test_connections_are_kept_alive():
    with contextlib.ExitStack() as stack:
        wire = stack.enter_context(listening())
        caller = call(stack, wire)
        assert until(lambda: keepalive_s(wire.port, caller.getsockname()[1]) <= 5.0)
