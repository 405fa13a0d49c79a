"""Byte streams, which may accept only a part of a frame: TCP, and a serial port through pyserial.

TCP calls (`tcpout`), or listens and talks to the last caller (`tcpin`). The unsent rest of a frame is sent before the
next one; only whole frames are dropped.
"""

import contextlib
import os
import select
import socket
import termios
from abc import abstractmethod
from typing import Final

import serial

from guidance.errors import LinkError
from guidance.links.port import Clock
from guidance.links.wires import QueuedWire, Reader

_WAIT_S: Final = 0.1
_TCP_BYTES: Final = 16384
_SERIAL_BYTES: Final = 4096


class StreamWire(QueuedWire):
    """A stream with a reader thread; sending never waits.

    The unsent rest of the last frame is kept, so that the stream never holds half a frame followed by another.
    """

    stream = True

    def __init__(self, clock: Clock) -> None:
        super().__init__(clock)
        self._rest = b""

    def _begin(self, *, name: str) -> None:
        self._reader = Reader(self._read_once, name=name)

    def _read_once(self) -> None:
        if data := self._read():
            self._arrivals.put((self._clock(), data))

    @abstractmethod
    def _read(self) -> bytes:
        """Return what has arrived, after a short wait at most."""

    @abstractmethod
    def _write_some(self, data: bytes) -> int:
        """Write without waiting; return how many bytes were accepted. Raises OSError if none is."""

    @abstractmethod
    def _hang_up(self) -> None:
        """Close the connection or port."""

    def _write(self, frame: bytes) -> bool:
        """Return whether the frame was accepted, even in part."""
        try:
            if self._rest:
                self._rest = self._rest[self._write_some(self._rest) :]
            if self._rest:
                return False
            self._rest = frame[self._write_some(frame) :]
        except BlockingIOError:
            return False
        except OSError:
            self._rest = b""
            return False
        return True

    def start_again(self) -> None:
        """Begin with a whole frame: there is a new peer."""
        self._rest = b""

    def _release(self) -> None:
        self._arrivals.close()
        self._reader.close()
        self._hang_up()


class TcpWire(StreamWire):
    """One connection at a time. When it breaks, we call again or accept the next caller."""

    def __init__(self, clock: Clock, *, host: str, port: int, listen: bool, timeout_s: float = 5.0) -> None:
        """Connect, or begin to listen.

        Raises:
            LinkError: If the connection fails within `timeout_s`, or the port cannot be bound.
        """
        super().__init__(clock)
        self._address = (host, port)
        self._server: socket.socket | None = None
        self._peer: socket.socket | None = None
        self._readable = select.poll()
        try:
            if listen:
                self._server = socket.create_server((host, port), backlog=1)
                self._server.settimeout(_WAIT_S)
            else:
                self._take_up(socket.create_connection((host, port), timeout=timeout_s))
        except OSError as error:
            busy, absent = "choose another port or end the program that uses it", "is the vehicle running there?"
            advice = busy if listen else absent
            raise LinkError(f"tcp {host}:{port}: {error}; {advice}") from error
        self._begin(name=f"tcp {host}:{port}")

    @property
    def port(self) -> int:
        """Our own port, for listening on port 0."""
        bound = self._server or self._peer
        return int(bound.getsockname()[1]) if bound is not None else 0

    def _read(self) -> bytes:
        try:
            if self._peer is None:
                self._take_up(self._next_peer())
            if self._peer is None or not self._readable.poll(_WAIT_S * 1e3):
                return b""
            data = self._peer.recv(_TCP_BYTES)
        except TimeoutError:
            return b""
        except OSError:
            self._hang_up_on_peer()
            raise
        if not data:
            self._hang_up_on_peer()
            raise ConnectionResetError("the other side closed")
        return data

    def _next_peer(self) -> socket.socket:
        if self._server is None:
            return socket.create_connection(self._address, timeout=_WAIT_S)
        return self._server.accept()[0]

    def _take_up(self, peer: socket.socket) -> None:
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        peer.setblocking(False)
        self._readable = select.poll()
        self._readable.register(peer, select.POLLIN)
        with self._lock:
            self._peer = peer
            self.start_again()

    def _hang_up_on_peer(self) -> None:
        with self._lock:
            ended, self._peer = self._peer, None
        if ended is not None:
            ended.close()

    def _write_some(self, data: bytes) -> int:
        if self._peer is None:
            raise ConnectionError("no connection")
        return self._peer.send(data)

    def _hang_up(self) -> None:
        self._hang_up_on_peer()
        if self._server is not None:
            self._server.close()


class SerialWire(StreamWire):
    """One serial port, opened exclusively, and reopened after it was unplugged."""

    def __init__(self, clock: Clock, *, device: str, baud: int) -> None:
        """Open the port.

        Raises:
            LinkError: If it does not exist, is in use, or does not support this baud rate.
        """
        super().__init__(clock)
        try:
            self._port = serial.Serial(device, baud, timeout=_WAIT_S, write_timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as error:
            raise LinkError(
                f"serial {device}:{baud}: {error}; is it plugged in, unused and able to do this baud rate, and "
                "do you have the permission (usually the group dialout)?"
            ) from error
        self._begin(name=f"serial {device}")

    def _read(self) -> bytes:
        try:
            if not self._port.is_open:
                self._reopen()
            return bytes(self._port.read(min(self._port.in_waiting, _SERIAL_BYTES) or 1))
        except (OSError, termios.error) as error:
            with self._lock, contextlib.suppress(OSError):
                self._port.close()
            raise ConnectionError("the port is gone") from error

    def _reopen(self) -> None:
        with self._lock:
            self._port.open()
            self.start_again()

    def _write_some(self, data: bytes) -> int:
        return os.write(self._port.fileno(), data)  # pyserial's write spins while the port is full

    def _hang_up(self) -> None:
        self._port.close()
