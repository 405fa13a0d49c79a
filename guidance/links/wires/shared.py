"""One wire for several: a vehicle's link and the source of its evader share it, and a record listens in on it."""

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from guidance.links.arrivals import Clock
from guidance.links.port import Wire

MOST_WAITING: Final = 1024
_MOST_PASSED: Final = 16384


class WireShare:
    """One reader's share: it sees everything that arrives, and sends on the same wire."""

    def __init__(self, wire: Wire, shares: list["WireShare"]) -> None:
        self._wire = wire
        self._shares = shares
        self._waiting: deque[tuple[float, bytes]] = deque()
        self._dropped = 0
        shares.append(self)

    @property
    def stream(self) -> bool:
        """As the wire's."""
        return self._wire.stream

    def receive(self) -> Sequence[tuple[float, bytes]]:
        """Everything that arrived since this reader's last call; what the others have not read waits for them."""
        for piece in self._wire.receive():
            for share in self._shares:
                share.keep(piece)
        taken = list(self._waiting)
        self._waiting.clear()
        return taken

    def wait(self, timeout_s: float) -> None:
        """As the wire's; at once where something waits for this reader."""
        if not self._waiting:
            self._wire.wait(timeout_s)

    def keep(self, piece: tuple[float, bytes]) -> None:
        """Put a piece by for this reader; the oldest goes when there is no room."""
        if len(self._waiting) >= MOST_WAITING:
            self._waiting.popleft()
            self._dropped += 1
        self._waiting.append(piece)

    def send(self, frame: bytes) -> None:
        """Send on the common wire."""
        if self in self._shares:
            self._wire.send(frame)

    def counters(self) -> Mapping[str, int]:
        """The wire's, and what this reader was too slow for."""
        return {**self._wire.counters(), "share_dropped": self._dropped}

    def close(self) -> None:
        """Leave; the last one out closes the wire."""
        if self in self._shares:
            self._shares.remove(self)
            if not self._shares:
                self._wire.close()


def share(wire: Wire, readers: int) -> list[WireShare]:
    """Split a wire among readers, all in the same thread."""
    shares: list[WireShare] = []
    return [WireShare(wire, shares) for _ in range(readers)]


class Passed(NamedTuple):
    """One frame (or piece of a stream) that passed: when, on which topic, and its bytes."""

    now_s: float
    topic: str
    frame: bytes


class TappedWire:
    """A `Wire` around another. Both directions are kept under the Zenoh keys of the vehicle's namespace."""

    def __init__(self, wire: Wire, clock: Clock, namespace: str) -> None:
        self._wire = wire
        self._clock = clock
        self._to, self._from = f"{namespace}/mavlink_raw/in", f"{namespace}/mavlink_raw/out"
        self._kept: deque[Passed] = deque(maxlen=_MOST_PASSED)
        self.stream = wire.stream

    def drain(self) -> Sequence[Passed]:
        """All that passed since the last call, oldest first."""
        return [self._kept.popleft() for _ in range(len(self._kept))]

    def receive(self) -> Sequence[tuple[float, bytes]]:
        """As the wire's."""
        arrived = self._wire.receive()
        self._kept.extend(Passed(received_s, self._from, frame) for received_s, frame in arrived)
        return arrived

    def wait(self, timeout_s: float) -> None:
        """As the wire's."""
        self._wire.wait(timeout_s)

    def send(self, frame: bytes) -> None:
        """As the wire's."""
        self._kept.append(Passed(self._clock(), self._to, frame))
        self._wire.send(frame)

    def counters(self) -> Mapping[str, int]:
        """As the wire's."""
        return self._wire.counters()

    def close(self) -> None:
        """As the wire's."""
        self._wire.close()
