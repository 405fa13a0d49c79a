"""TCP: either we call (`tcpout`) or we listen and talk to whoever called last (`tcpin`)."""

import socket
import threading
from collections.abc import Mapping, Sequence
from typing import Final

from guidance.errors import LinkError
from guidance.links.arrivals import Arrivals, Clock, Reader, Wake
from guidance.links.wires.stream import Tail

_WAIT_S: Final = 0.1
_MOST_BYTES: Final = 16384


class TcpWire:
    """One connection at a time, made anew when it breaks: we call again, or take the next caller."""

    stream = True

    def __init__(
        self,
        clock: Clock,
        *,
        host: str,
        port: int,
        listen: bool,
        timeout_s: float = 5.0,
        on_arrival: Wake | None = None,
    ) -> None:
        """Connect, or begin to listen.

        Raises:
            LinkError: If nobody answers within `timeout_s`, or the port cannot be had.
        """
        self._address = (host, port)
        self._lock = threading.Lock()
        self._writer: socket.socket | None = None
        self._server: socket.socket | None = None
        self._peer: socket.socket | None = None
        self._closed = False
        try:
            if listen:
                self._server = socket.create_server((host, port), backlog=1)
                self._server.settimeout(_WAIT_S)
            else:
                self._peer = self._tuned(socket.create_connection((host, port), timeout=timeout_s))
        except OSError as error:
            advice = "choose another port or end what uses it" if listen else "is the vehicle there and the port right?"
            raise LinkError(f"tcp {host}:{port}: {error}; {advice}") from error
        self._tail = Tail(self._write)
        self._pick_up()
        self._arrivals = Arrivals[bytes](clock, on_arrival=on_arrival)
        self._reader = Reader(self._read, self._arrivals, name=f"tcp {host}:{port}")

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
            data = self._peer.recv(_MOST_BYTES)
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

    def receive(self) -> Sequence[tuple[float, bytes]]:
        """Pieces of the stream since the last call."""
        return self._arrivals.take()

    def send(self, frame: bytes) -> None:
        """Write one frame, or nothing of it if the kernel is full or nobody is there."""
        with self._lock:
            if not self._closed:
                self._tail.send(frame)

    def counters(self) -> Mapping[str, int]:
        """Frames sent and not sent, and pieces dropped for want of room."""
        dropped = self._arrivals.dropped
        return {"wire_sent": self._tail.sent, "wire_unsent": self._tail.unsent, "wire_dropped": dropped}

    def close(self) -> None:
        """End the reader, then the sockets."""
        if self._closed:
            return
        self._closed = True
        self._reader.close()
        self._hang_up()
        if self._server is not None:
            self._server.close()
