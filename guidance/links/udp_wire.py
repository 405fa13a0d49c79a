"""UDP: either we call (`udpout`) or we listen and learn who calls (`udpin`)."""

import socket
from collections.abc import Collection, Mapping, Sequence
from typing import Final

from guidance.errors import LinkError
from guidance.links.arrivals import Arrivals, Clock, Handler, Wake
from guidance.links.peers import Peers
from guidance.links.reader import Reader

_WAIT_S: Final = 0.1
_MOST_BYTES: Final = 65535


class UdpWire:
    """One socket. A listening wire hears and answers one address for each system; see `guidance.links.peers`."""

    stream = False

    def __init__(
        self,
        clock: Clock,
        *,
        host: str,
        port: int,
        listen: bool,
        systems: Collection[int] | None = None,
        on_arrival: Wake | None = None,
    ) -> None:
        """Open the socket. `systems` are the MAVLink system ids that a listening wire waits for; None takes any.

        Raises:
            LinkError: If the address cannot be bound or resolved.
        """
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._clock = clock
        self._peers = Peers(systems) if listen else None
        self._closed = False
        self._sent = self._unsent = 0
        try:
            if listen:
                self._socket.bind((host, port))
            else:
                self._socket.connect((host, port))  # the kernel keeps everybody else's datagrams away
        except OSError as error:
            self._socket.close()
            raise LinkError(f"udp {host}:{port}: {error}; choose another port or end what uses it") from error
        self._sender = self._socket.dup()  # never waits, which a send on the reader's handle would do
        self._sender.setblocking(False)
        self._socket.settimeout(_WAIT_S)
        self._arrivals = Arrivals[bytes](clock, on_arrival=on_arrival)
        self._reader = Reader(self._read, self._arrivals, name=f"udp {host}:{port}")

    @property
    def port(self) -> int:
        """Our own port, for listening on port 0."""
        return int(self._socket.getsockname()[1])

    def _read(self) -> bytes:
        try:
            data, address = self._socket.recvfrom(_MOST_BYTES)
        except TimeoutError:
            return b""
        return data if self._peers is None else self._peers.admit(self._clock(), address, data)

    def receive(self) -> Sequence[tuple[float, bytes]]:
        """Datagrams since the last call."""
        return self._arrivals.take()

    def hand_to(self, handler: Handler) -> None:
        """From now on call `handler(arrival time, datagram)` on the reader's thread instead of keeping datagrams."""
        self._arrivals.hand_to(handler)

    def send(self, frame: bytes) -> None:
        """Send one datagram to each peer; what the kernel does not take at once is dropped and counted."""
        if self._closed:
            return
        for address in (None,) if self._peers is None else self._peers:
            try:
                if address is None:
                    self._sender.send(frame)
                else:
                    self._sender.sendto(frame, address)
                self._sent += 1
            except OSError:
                self._unsent += 1

    def counters(self) -> Mapping[str, int]:
        """Datagrams sent and not sent, pieces dropped for want of room, and strangers' datagrams refused, by reason."""
        refused = {} if self._peers is None else self._peers.refused
        return {
            "wire_sent": self._sent,
            "wire_unsent": self._unsent,
            "wire_dropped": self._arrivals.dropped,
            **{f"wire_{reason}": count for reason, count in refused.items()},
        }

    def close(self) -> None:
        """End the reader, then the socket."""
        if not self._closed:
            self._closed = True
            self._reader.close()
            self._sender.close()
            self._socket.close()
