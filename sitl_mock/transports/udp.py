"""MAVLink over UDP as in PX4's simulation: a vehicle sends to a fixed port and to everyone who has sent to it."""

import contextlib
import os
import selectors
import socket
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from sitl_mock.errors import TransportError
from sitl_mock.transports.loop import Arrival

Address = tuple[str, int]

DATAGRAM_FULL: Final = 1400
"""Datagrams up to this size (bytes) are not fragmented."""
MAX_PEERS: Final = 8
PEER_FORGOTTEN_S: Final = 60.0
_DATAGRAM_MAX: Final = 2048
_READS_MAX: Final = 256
_HOST: Final = "127.0.0.1"


class UdpEndpoint:
    """One socket per vehicle.

    Args:
        link: Name of the vehicles' link on these sockets.
        ports: Vehicle name to (own port, target port); own port 0 takes a free one, target port 0 has no target.
        clock: Seconds; peers are forgotten by it.
        any_if_taken: Use a free port instead of an own port that is taken.

    Raises:
        TransportError: A port is taken.
    """

    def __init__(
        self,
        link: str,
        ports: dict[str, tuple[int, int]],
        clock: Callable[[], float],
        *,
        any_if_taken: bool = False,
    ) -> None:
        self.dropped = 0
        self._link = link
        self._clock = clock
        self._sockets: dict[str, socket.socket] = {}
        self._readable = selectors.DefaultSelector()
        self._fixed: dict[str, Address | None] = {}
        self._peers: dict[str, dict[Address, float]] = {}
        try:
            for name, (own, target) in ports.items():
                self._sockets[name] = _bound(own, any_if_taken=any_if_taken)
                self._readable.register(self._sockets[name], selectors.EVENT_READ, name)
                if target:
                    self._fixed[name] = (_HOST, target)
                else:
                    self._fixed[name] = None
                self._peers[name] = {}
        except TransportError:
            self.close()
            raise

    def filenos(self) -> Sequence[int]:
        """Return one descriptor (of epoll or kqueue) that is readable when any socket is."""
        return [self._readable.fileno()]

    def receive(self) -> Sequence[Arrival]:
        """Return all received data; every sender becomes a peer."""
        arrivals = []
        for key, _ in self._readable.select(0.0) if self._sockets else ():
            name = key.data
            endpoint = self._sockets[key.data]
            for _ in range(_READS_MAX):
                try:
                    data, address = endpoint.recvfrom(_DATAGRAM_MAX)
                except BlockingIOError:
                    break
                except OSError:
                    self.dropped += 1
                    continue
                # The peer heard longest ago makes room.
                peers = self._peers[name]
                if address != self._fixed[name]:
                    if address not in peers and len(peers) >= MAX_PEERS:
                        del peers[min(peers, key=peers.__getitem__)]
                    peers[address] = self._clock()
                arrivals.append(Arrival(name, self._link, data))
        return arrivals

    def send(self, vehicle: str, link: str, frames: Sequence[bytes]) -> None:
        """Send to the fixed port and to every peer.

        Frames of one step share datagrams, as from a MAVLink router. PX4 v1.17 sends one datagram per frame (measured),
        which costs 25 % more CPU at both ends; clients read either.
        """
        if link != self._link:
            return
        endpoint = self._sockets[vehicle]
        peers = self._peers[vehicle]
        fixed = self._fixed[vehicle]
        if peers:
            oldest_s = self._clock() - PEER_FORGOTTEN_S
            for address in [address for address, heard_s in peers.items() if heard_s < oldest_s]:
                del peers[address]
        targets = [*([fixed] if fixed else []), *peers]
        for datagram in _datagrams(frames):
            for target in targets:
                try:
                    endpoint.sendto(datagram, target)
                except OSError:
                    self.dropped += 1

    def describe(self) -> dict[str, str]:
        """Return each vehicle's own address."""
        return {
            name: f"udp://{_HOST}:{endpoint.getsockname()[1]}"
            for name, endpoint in self._sockets.items()
        }

    def change_port(self, vehicle: str) -> None:
        """Change to another free port, as after a restart behind a router; peers are kept."""
        mine = self._sockets[vehicle]
        self._readable.unregister(mine)
        with contextlib.closing(_bound(0)) as other:
            os.dup2(other.fileno(), mine.fileno(), inheritable=False)
        self._readable.register(mine, selectors.EVENT_READ, vehicle)

    def close(self) -> None:
        """Close every socket."""
        self._readable.close()
        for endpoint in self._sockets.values():
            with contextlib.suppress(OSError):
                endpoint.close()
        self._sockets = {}


def _datagrams(frames: Sequence[bytes]) -> Iterator[bytes]:
    """Yield datagrams of whole frames, as many as fit in each."""
    start = size = 0
    for index, frame in enumerate(frames):
        size += len(frame)
        if size > DATAGRAM_FULL and index > start:
            yield b"".join(frames[start:index])
            start = index
            size = len(frame)
    if size:
        yield b"".join(frames[start:])


def _bound(port: int, *, any_if_taken: bool = False) -> socket.socket:
    each = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    each.setblocking(False)
    try:
        each.bind((_HOST, port))
    except OSError as error:
        each.close()
        if any_if_taken:
            return _bound(0)
        raise TransportError(
            f"UDP port {port} on {_HOST} cannot be opened: {error.strerror}; "
            "end the program that has it, or choose another with --udp or --gcs"
        ) from None
    return each
