"""Byte streams that may take only a part of a frame: TCP, and a serial port through pyserial.

TCP either calls (`tcpout`) or listens and talks to whoever called last (`tcpin`). What a stream did not take of a frame
goes first next time, and only whole frames are dropped.
"""

import contextlib
import os
import socket
import termios
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Final

import serial

from guidance.errors import LinkError
from guidance.links.arrivals import Arrivals, Clock, Reader

_WAIT_S: Final = 0.1
_MOST_TCP_BYTES: Final = 16384
_MOST_SERIAL_BYTES: Final = 4096


class Tail:
    """Remembers the unsent end of the last frame, so that the stream never holds half a frame followed by another."""

    def __init__(self, write: Callable[[bytes], int]) -> None:
        self._write = write
        self._rest = b""
        self.sent = 0
        self.unsent = 0

    def send(self, frame: bytes) -> None:
        """Write without waiting. `write` returns how many bytes it took, and raises OSError when it can take none."""
        try:
            if self._rest:
                self._rest = self._rest[self._write(self._rest) :]
            if self._rest:
                self.unsent += 1
                return
            self._rest = frame[self._write(frame) :]
            self.sent += 1
        except BlockingIOError:
            self.unsent += 1
        except OSError:
            self.unsent += 1
            self._rest = b""

    def forget(self) -> None:
        """A new peer begins with a whole frame."""
        self._rest = b""


class _StreamWire(ABC):
    """What is read by a thread of its own, and written without waiting; the lock lies between the two."""

    stream = True

    def __init__(self) -> None:
        self._closed = False
        self._lock = threading.Lock()
        self._tail = Tail(self._write)

    def _begin(self, clock: Clock, *, name: str) -> None:
        self._arrivals = Arrivals[bytes](clock)
        self._reader = Reader(self._keep, name=name)

    def _keep(self) -> None:
        if data := self._read():
            self._arrivals.put(data)

    @abstractmethod
    def _read(self) -> bytes: ...

    @abstractmethod
    def _write(self, data: bytes) -> int: ...

    @abstractmethod
    def _release(self) -> None: ...

    def receive(self) -> Sequence[tuple[float, bytes]]:
        """Pieces of the stream since the last call."""
        return self._arrivals.take()

    def wait(self, timeout_s: float) -> None:
        """Until something has arrived, at most this long."""
        self._arrivals.wait(timeout_s)

    def send(self, frame: bytes) -> None:
        """Write one frame; what is not taken of it at once goes before the next, which is dropped if it must."""
        with self._lock:
            if not self._closed:
                self._tail.send(frame)

    def counters(self) -> Mapping[str, int]:
        """Frames sent and not sent, and pieces dropped for want of room."""
        dropped = self._arrivals.dropped
        return {"wire_sent": self._tail.sent, "wire_unsent": self._tail.unsent, "wire_dropped": dropped}

    def close(self) -> None:
        """End the reader, then what it read."""
        if not self._closed:
            self._closed = True
            self._reader.close()
            self._release()


class TcpWire(_StreamWire):
    """One connection at a time, made anew when it breaks: we call again, or take the next caller."""

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
            LinkError: If nobody answers within `timeout_s`, or the port cannot be had.
        """
        super().__init__()
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
            advice = "choose another port or end what uses it" if listen else "is the vehicle there and the port right?"
            raise LinkError(f"tcp {host}:{port}: {error}; {advice}") from error
        self._pick_up()
        self._begin(clock, name=f"tcp {host}:{port}")

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
            data = self._peer.recv(_MOST_TCP_BYTES)
        except TimeoutError:
            return b""
        except OSError:
            self._hang_up()
            raise
        if not data:
            self._hang_up()
            raise ConnectionResetError("the other side closed")
        return data

    def _next_peer(self) -> socket.socket:
        if self._server is None:
            return socket.create_connection(self._address, timeout=_WAIT_S)
        return self._server.accept()[0]

    def _pick_up(self) -> None:
        """Write through a second handle that never waits: the reader's has a timeout, which a send would wait out."""
        if self._peer is None:
            return
        with self._lock:
            self._writer = self._peer.dup()
            self._writer.setblocking(False)
            self._tail.forget()

    def _hang_up(self) -> None:
        with self._lock:
            ended = self._peer, self._writer
            self._peer = self._writer = None
        for one in ended:
            if one is not None:
                one.close()

    def _write(self, data: bytes) -> int:
        if self._writer is None:
            raise ConnectionError("nobody there")
        return self._writer.send(data)

    def _release(self) -> None:
        self._hang_up()
        if self._server is not None:
            self._server.close()


class SerialWire(_StreamWire):
    """One port, opened for ourselves alone, and opened again when it comes back after being unplugged."""

    def __init__(self, clock: Clock, *, device: str, baud: int) -> None:
        """Open the port.

        Raises:
            LinkError: If it is not there, is in use, or cannot do this speed.
        """
        super().__init__()
        try:
            self._port = serial.Serial(device, baud, timeout=_WAIT_S, write_timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as error:
            raise LinkError(
                f"serial {device}:{baud}: {error}; is it plugged in, free, able to do this speed, and may you open it "
                "(the group dialout, as a rule)?"
            ) from error
        self._begin(clock, name=f"serial {device}")

    def _read(self) -> bytes:
        try:
            if not self._port.is_open:
                self._reopen()
            return bytes(self._port.read(min(self._port.in_waiting, _MOST_SERIAL_BYTES) or 1))
        except (OSError, termios.error) as error:
            with self._lock, contextlib.suppress(OSError):
                self._port.close()
            raise ConnectionError("the port went away") from error

    def _reopen(self) -> None:
        with self._lock:
            self._port.open()
            self._tail.forget()

    def _write(self, data: bytes) -> int:
        return os.write(self._port.fileno(), data)  # pyserial's own write spins while the port is full

    def _release(self) -> None:
        self._port.close()
