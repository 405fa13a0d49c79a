"""UDP: either we call (`udpout`) or we listen and learn who calls (`udpin`).

Anybody may send to a port that listens: one address for each MAVLink system is pinned while it is alive. No checksum
proves who sent a frame; signing does (`guidance.links.signing`). What is kept away here is everybody who does not even
speak as the system that is wanted, whoever takes its number while it lives, and bytes without end.
"""

import math
import select
import socket
import threading
import time
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Final

from guidance.errors import LinkError
from guidance.links.arrivals import Arrivals, Clock, Reader
from guidance.links.framing import CRC_EXTRA, claimed_system, first_frame

_WAIT_MS: Final = 100
_MOST_BYTES: Final = 65535
_MOST_AT_ONCE: Final = 16
"""Datagrams of a flood that are read before somebody else has a turn."""

Address = tuple[str, int]

SILENT_S: Final = 3.0
"""A system may speak from another address once it has been silent at its old one for this long."""

MOST_SYSTEMS: Final = 8
"""How many systems are pinned where any may speak."""

ASIDE_S: Final = 0.01
"""How long the reader's thread looks away from a socket that a loop waits at."""

OTHERS_PER_S: Final = 50
"""Frames a second of other systems that get in, so that an error can name who is there instead."""


class Peers:
    """Judges every datagram by its address and its first frame. One cheap look each, whatever its length.

    Args:
        systems: MAVLink system ids that may become peers; None lets any, `MOST_SYSTEMS` at once.
    """

    def __init__(self, systems: Collection[int] | None = None) -> None:
        self._systems = None if systems is None else frozenset(systems)
        self._pinned: dict[int, Address] = {}
        self._heard_s: dict[Address, float] = {}
        self._second, self._others = -1, 0
        self.refused = Counter(garbage=0, impostor=0, stranger=0)

    def __iter__(self) -> Iterator[Address]:
        """Where to send: every peer once."""
        return iter(tuple(self._heard_s))

    def admit(self, now_s: float, address: Address, data: bytes) -> bytes:
        """Return what gets in of a datagram: all of a peer's, one frame of a stranger's now and then, else nothing."""
        if address in self._heard_s:
            self._heard_s[address] = now_s
            return data
        claimed = claimed_system(data)
        holder = None if claimed is None else self._pinned.get(claimed)
        if holder is not None and now_s - self._heard_s[holder] < SILENT_S:
            self.refused["impostor"] += 1  # whatever its checksum: a flood of these costs next to nothing
            return b""
        frame = first_frame(data, CRC_EXTRA)
        if frame is None:
            self.refused["garbage"] += 1
            return b""
        if not self._may_be_peer(frame.system_id, now_s):
            return self._other(now_s, frame.data)
        self._pin(frame.system_id, address, now_s)
        return data

    def _may_be_peer(self, system_id: int, now_s: float) -> bool:
        if self._systems is not None:
            return system_id in self._systems
        if system_id in self._pinned or len(self._pinned) < MOST_SYSTEMS:
            return True
        longest_silent = min(self._pinned, key=lambda one: self._heard_s[self._pinned[one]])
        if now_s - self._heard_s[self._pinned[longest_silent]] < SILENT_S:
            return False
        self._unpin(longest_silent)
        return True

    def _pin(self, system_id: int, address: Address, now_s: float) -> None:
        if system_id in self._pinned:
            self._unpin(system_id)
        # Another thread may be sending to the peers: they are replaced, never changed in place.
        self._pinned = {**self._pinned, system_id: address}
        self._heard_s = {**self._heard_s, address: now_s}

    def _unpin(self, system_id: int) -> None:
        address = self._pinned[system_id]
        self._pinned = {one: place for one, place in self._pinned.items() if one != system_id}
        self._heard_s = {place: at for place, at in self._heard_s.items() if place != address}

    def _other(self, now_s: float, frame: bytes) -> bytes:
        if int(now_s) != self._second:
            self._second, self._others = int(now_s), 0
        self._others += 1
        if self._others > OTHERS_PER_S:
            self.refused["stranger"] += 1
            return b""
        return frame


class UdpWire:
    """One socket. A listening wire hears and answers one address for each system; see `Peers`."""

    stream = False

    def __init__(
        self,
        clock: Clock,
        *,
        host: str,
        port: int,
        listen: bool,
        systems: Collection[int] | None = None,
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
            advice = "choose another port or end what uses it" if listen else "is the host's name right?"
            raise LinkError(f"udp {host}:{port}: {error}; {advice}") from error
        self._socket.setblocking(False)
        self._watched, self._readable = select.poll(), select.poll()  # the reader's, and whose the lock is
        for poll in (self._watched, self._readable):
            poll.register(self._socket, select.POLLIN)
        self._reading = threading.Lock()  # read and kept in one: two threads must not change the order
        self._awaited = False
        self._arrivals = Arrivals[bytes](clock)
        self._reader = Reader(self._watch, name=f"udp {host}:{port}")

    @property
    def port(self) -> int:
        """Our own port, for listening on port 0."""
        return int(self._socket.getsockname()[1])

    def _watch(self) -> None:
        """On the reader's thread."""
        if self._awaited:
            time.sleep(ASIDE_S)
        elif self._watched.poll(_WAIT_MS) and self._reading.acquire(blocking=False):
            try:
                for received_s, data in self._read():
                    self._arrivals.put(data, received_s)
            finally:
                self._reading.release()

    def _read(self) -> list[tuple[float, bytes]]:
        """What the kernel has, bounded, as far as it gets in."""
        pieces: list[tuple[float, bytes]] = []
        for _ in range(_MOST_AT_ONCE):
            if not self._readable.poll(0):  # an exception that says so costs a cold processor 20 µs
                break
            try:
                data, address = self._socket.recvfrom(_MOST_BYTES)
            except OSError as error:
                if pieces or isinstance(error, BlockingIOError):
                    break
                raise
            now_s = self._clock()
            if self._peers is not None:
                data = self._peers.admit(now_s, address, data)
            if data:
                pieces.append((now_s, data))
        return pieces

    def receive(self) -> Sequence[tuple[float, bytes]]:
        """Datagrams since the last call.

        What the kernel still has is read here, at once: the reader's thread may be waiting for this one to let it run.
        It is not waited for where it is reading.
        """
        if self._closed or not self._reading.acquire(blocking=False):
            return self._arrivals.take()
        pieces = self._arrivals.take()
        try:
            pieces += self._read()
        except OSError:
            pass  # nobody is at the port that we call; the next datagram may come
        finally:
            self._reading.release()
        return pieces

    def wait(self, timeout_s: float) -> None:
        """Until something has arrived, at most this long. It is left to `receive`, and the reader's thread to stand by.

        So no thread is woken only to wake another. The reader comes back up to `ASIDE_S` later: what this thread lets
        lie meanwhile is stamped as it is read.
        """
        if self._closed:
            return
        self._awaited = True
        try:
            with self._reading:
                if not self._arrivals:
                    self._readable.poll(math.ceil(timeout_s * 1e3))
        finally:
            self._awaited = False

    def send(self, frame: bytes) -> None:
        """Send one datagram to each peer; what the kernel does not take at once is dropped and counted."""
        if self._closed:
            return
        for address in (None,) if self._peers is None else self._peers:
            try:
                if address is None:
                    self._socket.send(frame)
                else:
                    self._socket.sendto(frame, address)
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
            self._socket.close()
