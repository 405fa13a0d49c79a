"""Byte streams, which may accept only a part of a frame: TCP, and a serial port through pyserial.

TCP calls (`tcpout`), or listens and talks to the last caller (`tcpin`). The unsent rest of a frame is sent before the
next one; only whole frames are dropped.
"""

import contextlib
import os
import socket
import termios
from abc import abstractmethod
from collections.abc import Callable
from typing import Final

import serial

from guidance.errors import LinkError
from guidance.links.port import Clock
from guidance.links.wires.shared import QueuedWire, Reader

_WAIT_S: Final = 0.1
_TCP_BYTES: Final = 16384
_SERIAL_BYTES: Final = 4096


class Tail:
    """Keeps the unsent rest of the last frame, so that the stream never holds half a frame followed by another."""

    def __init__(self, write: Callable[[bytes], int]) -> None:
        self._write = write
        self._rest = b""

    def send(self, frame: bytes) -> bool:
        """Write without waiting; return whether the frame was accepted, even in part.

        `write` returns how many bytes it accepted, and raises OSError if it accepts none.
        """
        try:
            if self._rest:
                self._rest = self._rest[self._write(self._rest) :]
            if self._rest:
                return False
            self._rest = frame[self._write(frame) :]
        except BlockingIOError:
            return False
        except OSError:
            self._rest = b""
            return False
        return True

    def forget(self) -> None:
        """Start with a whole frame: there is a new peer."""
        self._rest = b""


class _StreamWire(QueuedWire):
    """A stream with a reader thread; sending never waits."""

    stream = True

    def __init__(self, clock: Clock) -> None:
        super().__init__(clock)
        self._tail = Tail(self._write_some)

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
        """Write without waiting; return how many bytes were accepted."""

    @abstractmethod
    def _hang_up(self) -> None:
        """Close the connection or port."""

    def _write(self, frame: bytes) -> bool:
        return self._tail.send(frame)

    def _release(self) -> None:
        self._arrivals.close()
        self._reader.close()
        self._hang_up()


class TcpWire(_StreamWire):
    """One connection at a time. When it breaks, we call again or accept the next caller."""

    def __init__(
        self,
        clock: Clock,
        *,
        host: str,
        port: int,
        listen: bool,
        timeout_s: float = 5.0,
    ) -> None:
        """Connect, or begin to listen.

        Raises:
            LinkError: If the connection fails within `timeout_s`, or the port cannot be bound.
        """
        super().__init__(clock)
        self._address = (host, port)
        self._writer: socket.socket | None = None
        self._server: socket.socket | None = None
        self._peer: socket.socket | None = None
        try:
            if listen:
                self._server = socket.create_server((host, port), backlog=1)
                self._server.settimeout(_WAIT_S)
            else:
                self._peer = self._tuned(socket.create_connection((host, port), timeout=timeout_s))
        except OSError as error:
            busy, absent = "choose another port or end the program that uses it", "is the vehicle running there?"
            advice = busy if listen else absent
            raise LinkError(f"tcp {host}:{port}: {error}; {advice}") from error
        self._pick_up()
        self._begin(name=f"tcp {host}:{port}")

    @staticmethod
    def _tuned(peer: socket.socket) -> socket.socket:
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        peer.settimeout(_WAIT_S)
        return peer

    @property
    def port(self) -> int:
        """Our own port, for listening on port 0."""
        bound = self._server or self._peer
        return int(bound.getsockname()[1]) if bound is not None else 0

    def _read(self) -> bytes:
        try:
            if self._peer is None:
                self._peer = self._tuned(self._next_peer())
                self._pick_up()
            data = self._peer.recv(_TCP_BYTES)
        except TimeoutError:
            return b""
        except OSError:
            self._drop_peer()
            raise
        if not data:
            self._drop_peer()
            raise ConnectionResetError("the other side closed")
        return data

    def _next_peer(self) -> socket.socket:
        if self._server is None:
            return socket.create_connection(self._address, timeout=_WAIT_S)
        return self._server.accept()[0]

    def _pick_up(self) -> None:
        """Open a second, non-blocking handle for writing: a send through the reader's handle would wait."""
        if self._peer is None:
            return
        with self._lock:
            self._writer = self._peer.dup()
            self._writer.setblocking(False)
            self._tail.forget()

    def _drop_peer(self) -> None:
        with self._lock:
            ended = self._peer, self._writer
            self._peer = self._writer = None
        for one in ended:
            if one is not None:
                one.close()

    def _write_some(self, data: bytes) -> int:
        if self._writer is None:
            raise ConnectionError("no connection")
        return self._writer.send(data)

    def _hang_up(self) -> None:
        self._drop_peer()
        if self._server is not None:
            self._server.close()


class SerialWire(_StreamWire):
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
            self._tail.forget()

    def _write_some(self, data: bytes) -> int:
        return os.write(self._port.fileno(), data)  # pyserial's write spins while the port is full

    def _hang_up(self) -> None:
        self._port.close()
