"""The base of all wires: a bounded queue of arrivals, a reader thread, and the counts of frames sent.

`MemoryWire` connects two ends in one process, for virtual time and tests. `WireShare` lets a vehicle's link and the
source of its evader read one wire. `TappedWire` captures all frames for the record.
"""

import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Final, Generic, NamedTuple, TypeVar

from guidance.links.port import Clock, Wire

_Piece = TypeVar("_Piece")

TO_VEHICLE: Final = "mavlink_raw/in"
FROM_VEHICLE: Final = "mavlink_raw/out"
"""Zenoh keys of raw frames, in the vehicle's namespace."""

PACKET_QUEUE_LENGTH: Final = 1024
_MAX_CAPTURED: Final = 16384


Packet = tuple[float, bytes]
"""Arrival time and bytes."""


class Arrivals(Generic[_Piece]):
    """A bounded queue: one thread fills it, the loop empties it. When it is full, the oldest item is dropped."""

    def __init__(self) -> None:
        self._waiting: deque[_Piece] = deque(maxlen=PACKET_QUEUE_LENGTH)
        self.closed = False
        self.dropped = 0

    def put(self, item: _Piece) -> bool:
        """Add an item; return False if closed, which adds nothing."""
        if not self.closed:
            self.dropped += len(self._waiting) == PACKET_QUEUE_LENGTH
            self._waiting.append(item)
        return not self.closed

    def take(self) -> list[_Piece]:
        """Return and remove all items, oldest first; none once closed."""
        waiting = self._waiting
        if self.closed:
            return []
        return [waiting.popleft() for _ in range(len(waiting))]

    def close(self) -> None:
        """Accept no more items."""
        self.closed = True


class Reader(threading.Thread):
    """A thread that calls `read` until it is closed. `read` blocks only briefly; it may raise OSError."""

    def __init__(self, read: Callable[[], None], *, name: str) -> None:
        super().__init__(name=name, daemon=True)
        self._read = read
        self._ended = threading.Event()
        self.start()

    def run(self) -> None:
        """Read again and again."""
        while not self._ended.is_set():
            try:
                self._read()
            except OSError:
                self._ended.wait(0.05)  # the peer may come back: do not spin, do not give up

    def close(self) -> None:
        """End the thread and join it, so that the socket is not closed while it is read."""
        self._ended.set()
        self.join()


class QueuedWire(ABC):
    """Base of all wires: received pieces wait in a queue; `_write` sends, `_release` closes."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._arrivals = Arrivals[Packet]()
        self._lock = threading.Lock()
        self._sent = self._unsent = 0

    @abstractmethod
    def _write(self, frame: bytes) -> bool:
        """Send one frame without blocking; return whether it was sent. Called with the lock held."""

    @abstractmethod
    def _release(self) -> None:
        """Close the wire's own resources. Called once."""

    def receive(self) -> Sequence[Packet]:
        """Return the pieces since the last call."""
        return self._arrivals.take()

    def impostors(self) -> Sequence[bytes]:
        """Return none: this wire has no addresses."""
        return ()

    def impostors_of(self, _system_id: int) -> int:
        """Return 0: this wire has no addresses."""
        return 0

    def send(self, frame: bytes) -> None:
        """Send one frame; if that fails, or the wire is closed, count it."""
        with self._lock:
            sent = not self._arrivals.closed and self._write(frame)
            self._sent += sent
            self._unsent += not sent

    def counters(self) -> Mapping[str, int]:
        """Return how many frames were sent, not sent, and dropped because the queue was full."""
        return {
            "wire_sent": self._sent,
            "wire_unsent": self._unsent,
            "wire_dropped": self._arrivals.dropped,
        }

    def close(self) -> None:
        """Close the wire; may be called twice."""
        with self._lock:
            if self._arrivals.closed:
                return
            self._arrivals.close()
        self._release()


class MemoryWire(QueuedWire):
    """One end of a wire in memory. Frames from the other end are stamped when they are sent."""

    def __init__(self, clock: Clock, inbox: Arrivals[Packet], outbox: Arrivals[Packet]) -> None:
        super().__init__(clock)
        self._arrivals = inbox
        self._outbox = outbox

    @classmethod
    def pair(cls, clock: Clock) -> tuple["MemoryWire", "MemoryWire"]:
        """Return two connected ends."""
        one = Arrivals[Packet]()
        other = Arrivals[Packet]()
        return cls(clock, one, other), cls(clock, other, one)

    def _write(self, frame: bytes) -> bool:
        return self._outbox.put((self._clock(), frame))

    def _release(self) -> None:
        self._outbox.close()


class WireShare:
    """One reader of a shared wire. It receives everything that arrives and sends on the same wire."""

    def __init__(self, wire: Wire, shares: list["WireShare"]) -> None:
        self._wire = wire
        self._shares = shares
        self.arrivals = Arrivals[Packet]()
        self.impostors = wire.impostors  # impostors: for the first reader that asks
        self.impostors_of = wire.impostors_of
        shares.append(self)

    def receive(self) -> Sequence[Packet]:
        """Return everything since this reader's last call, and keep it for the other readers."""
        for packet in self._wire.receive():
            for share in self._shares:
                share.arrivals.put(packet)
        return self.arrivals.take()

    def send(self, frame: bytes) -> None:
        """Send on the common wire."""
        if not self.arrivals.closed:
            self._wire.send(frame)

    def counters(self) -> Mapping[str, int]:
        """Return the wire's counts, and how many packets this slow reader has lost."""
        return {**self._wire.counters(), "share_dropped": self.arrivals.dropped}

    def close(self) -> None:
        """Leave; the last reader closes the wire."""
        if not self.arrivals.closed:
            self.arrivals.close()
            self._shares.remove(self)
            if not self._shares:
                self._wire.close()


def share(wire: Wire, readers: int) -> list[WireShare]:
    """Return shares of a wire for several readers, all in the same thread."""
    shares: list[WireShare] = []
    return [WireShare(wire, shares) for _ in range(readers)]


class CapturedFrame(NamedTuple):
    """One frame, or piece of a stream, in either direction: its time, its topic in the record, and its bytes."""

    now_s: float
    topic: str
    frame: bytes


class TappedWire:
    """A `Wire` around another that captures both directions, under the Zenoh keys of the vehicle's namespace."""

    def __init__(self, wire: Wire, clock: Clock, namespace: str) -> None:
        self._wire = wire
        self._clock = clock
        self._to = f"{namespace}/{TO_VEHICLE}"
        self._from = f"{namespace}/{FROM_VEHICLE}"
        self._captured: deque[CapturedFrame] = deque(maxlen=_MAX_CAPTURED)
        self.impostors = wire.impostors
        self.impostors_of = wire.impostors_of
        self.counters = wire.counters
        self.close = wire.close

    def drain(self) -> Sequence[CapturedFrame]:
        """Return everything captured since the last call, oldest first."""
        return [self._captured.popleft() for _ in range(len(self._captured))]

    def receive(self) -> Sequence[Packet]:
        """Return and capture the arrivals of the wire."""
        arrived = self._wire.receive()
        self._captured.extend(
            [CapturedFrame(received_s, self._from, frame) for received_s, frame in arrived]
        )
        return arrived

    def send(self, frame: bytes) -> None:
        """Capture and send a frame."""
        self._captured.append(CapturedFrame(self._clock(), self._to, frame))
        self._wire.send(frame)
