"""Byte streams, which may accept only a part of a frame: TCP that calls (`tcpout`), and a serial port through pyserial.

The unsent rest of a frame is sent before the next one; only whole frames are dropped. `tcp_in` beside it listens.
"""

import os
import select
import socket
import termios
from collections.abc import Callable
from functools import partial
from typing import Final, Protocol

import serial

from guidance.errors import LinkError
from guidance.links.port import Clock
from guidance.links.wires.base import QueuedWire, Reader

_WAIT_S: Final = 0.1
_BYTES: Final = 16384


class Connection(Protocol):
    """A socket or serial port."""

    def fileno(self) -> int:
        """Return its file descriptor, which does not block."""

    def close(self) -> None:
        """Close it."""


class StreamWire(QueuedWire):
    """One connection at a time, with a reader thread that connects again when it breaks; sending never waits.

    The unsent rest of the last frame is kept, so that the stream never holds half a frame followed by another.
    """

    def __init__(
        self, clock: Clock, name: str, connect: Callable[[], Connection], first: Connection | None
    ) -> None:
        """Begin to read from the first connection. `connect` waits at most briefly: TimeoutError means try again."""
        super().__init__(clock)
        self._connect = connect
        self._peer: Connection | None = None
        self._rest = b""
        if first is not None:
            self.take_up(first)
        self._reader = Reader(self._read_once, name=name)

    def take_up(self, peer: Connection | None) -> None:
        """Close the connection and talk to a new peer, beginning with a whole frame; with None to no peer."""
        with self._lock:
            ended = self._peer
            self._peer = peer
            self._rest = b""
        if ended is not None:
            ended.close()
        if peer is not None:
            self._readable = select.poll()
            self._readable.register(peer, select.POLLIN)

    def _read_once(self) -> None:
        try:
            if self._peer is None:
                self.take_up(self._connect())
            elif self._readable.poll(_WAIT_S * 1e3):
                data = os.read(self._peer.fileno(), _BYTES)
                if not data:
                    raise ConnectionResetError("the other side closed")
                self._arrivals.put((self._clock(), data))
        except (TimeoutError, BlockingIOError):
            pass  # no peer has connected yet, or no data has arrived
        except (OSError, termios.error) as error:
            self.take_up(None)
            raise ConnectionError("the connection is gone") from error

    def _write(self, frame: bytes) -> bool:
        """Return whether the frame was accepted, even in part."""
        if self._peer is None:
            return False
        try:
            if self._rest:
                self._rest = self._rest[os.write(self._peer.fileno(), self._rest) :]
            if self._rest:
                return False
            self._rest = frame[os.write(self._peer.fileno(), frame) :]
        except BlockingIOError:
            return False
        except OSError:
            self._rest = b""
            return False
        return True

    def _release(self) -> None:
        self._reader.close()
        self.take_up(None)


class TcpWire(StreamWire):
    """One connection. When it breaks, we call again."""

    def __init__(self, clock: Clock, *, host: str, port: int, timeout_s: float = 5.0) -> None:
        """Connect.

        Raises:
            LinkError: If the connection fails within `timeout_s`.
        """
        name = f"tcp {host}:{port}"
        try:
            first = _called(host, port, timeout_s)
        except OSError as error:
            raise LinkError(f"{name}: {error}; is the vehicle running there?") from error
        super().__init__(clock, name, partial(_called, host, port, _WAIT_S), first)


def _called(host: str, port: int, timeout_s: float) -> socket.socket:
    """Call a listening port."""
    peer = socket.create_connection((host, port), timeout_s)
    peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    peer.setblocking(False)
    return peer


class SerialWire(StreamWire):
    """One serial port, opened exclusively, and reopened after it was unplugged."""

    def __init__(self, clock: Clock, *, device: str, baud: int) -> None:
        """Open the port.

        Raises:
            LinkError: If it does not exist, is in use, or does not support this baud rate.
        """
        connect = partial(serial.Serial, device, baud, timeout=0, exclusive=True)
        try:
            first = connect()
        except (OSError, ValueError, termios.error) as error:
            able = "is it plugged in, unused and able to do this baud rate"
            may = "do you have the permission (usually the group dialout)?"
            raise LinkError(f"serial {device}:{baud}: {error}; {able}, and {may}") from error
        super().__init__(clock, f"serial {device}", connect, first)
