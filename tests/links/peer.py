"""The other end of a link in these tests: a small autopilot that answers and keeps everything it received."""

import math
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from pymavlink.dialects.v20 import common as dialect

PX4_OFFBOARD = 6 << 16
PX4 = 12
ARDUPILOT = 3


class Peer:
    """One autopilot, or with other ids another sender on its link. `send` writes to the wire."""

    def __init__(
        self, send: Callable[[bytes], None], *, system_id: int = 1, autopilot: int = PX4
    ) -> None:
        self.send = send
        self.autopilot = autopilot
        self.mavlink = dialect.MAVLink(None, system_id, 1)
        self.parser = dialect.MAVLink(None, 255, 1)
        self.parser.robust_parsing = True
        self.heard: list = []
        self.parameters: dict[str, int | float] = {}
        self.answers = True

    def say(
        self, message, *, system_id: int | None = None, component_id: int = 1, v1: bool = False
    ) -> None:
        self.send(self.packed(message, system_id=system_id, component_id=component_id, v1=v1))

    def packed(
        self, message, *, system_id: int | None = None, component_id: int = 1, v1: bool = False
    ) -> bytes:
        own = self.mavlink.srcSystem, self.mavlink.srcComponent
        self.mavlink.srcSystem = system_id or own[0]
        self.mavlink.srcComponent = component_id
        data = bytes(message.pack(self.mavlink, force_mavlink1=v1))
        self.mavlink.srcSystem, self.mavlink.srcComponent = own
        self.mavlink.seq = (self.mavlink.seq + 1) % 256
        return data

    def heartbeat(self, **say) -> None:
        self.say(
            dialect.MAVLink_heartbeat_message(2, self.autopilot, 128 | 29, PX4_OFFBOARD, 4, 3),
            **say,
        )

    def local_position(self, n: int, **say) -> None:
        self.say(
            dialect.MAVLink_local_position_ned_message(n, n + 0.5, 2.0, -3.0, 0.25, 0.5, -0.75),
            **say,
        )

    def hear(self, data: bytes) -> None:
        for message in self.parser.parse_buffer(data) or []:
            self.heard.append(message)
            if self.answers:
                self._answer(message)

    def _answer(self, message) -> None:
        if message.get_type() in ("COMMAND_LONG", "COMMAND_INT"):
            source = message.get_srcSystem(), message.get_srcComponent()
            self.say(dialect.MAVLink_command_ack_message(message.command, 0, 0, 0, *source))
        elif message.get_type() == "PARAM_REQUEST_READ" and message.param_id in self.parameters:
            self.say(self._parameter(message.param_id, self.parameters[message.param_id]))

    def _parameter(self, name: str, value: float):
        number = float(value)
        kind = dialect.MAV_PARAM_TYPE_REAL32
        if isinstance(value, int):
            kind = dialect.MAV_PARAM_TYPE_INT32
            if self.autopilot == PX4:
                (number,) = struct.unpack("<f", struct.pack("<i", value))
        return dialect.MAVLink_param_value_message(name.encode(), number, kind, 1, 0)

    def of(self, *names: str) -> list:
        return [message for message in self.heard if message.get_type() in names]


@contextmanager
def living(
    peer: Peer, receive: Callable[[], list[bytes]], *, heartbeat_every_s: float = 0.1
) -> Iterator[Peer]:
    """Let a peer answer and send its heartbeat in real time, on a thread, until the block is left."""
    stop = threading.Event()

    def live() -> None:
        next_heartbeat_s = -math.inf
        while not stop.is_set():
            for data in receive():
                peer.hear(data)
            if time.monotonic() >= next_heartbeat_s:
                peer.heartbeat()
                next_heartbeat_s = time.monotonic() + heartbeat_every_s
            stop.wait(0.002)

    thread = threading.Thread(target=live)
    thread.start()
    try:
        yield peer
    finally:
        stop.set()
        thread.join()


def until(condition: Callable[[], bool], *, timeout_s: float = 5.0) -> bool:
    """Wait for a condition; return whether it became true in time (real clients need real time)."""
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline_s:
            return False
        time.sleep(0.005)
    return True
