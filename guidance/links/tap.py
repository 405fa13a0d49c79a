"""A wire that is listened in on: everything that passes is kept, bounded, until the loop writes it to the record."""

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from guidance.links.arrivals import Clock, Handler
from guidance.links.port import Wire

MOST_KEPT: Final = 16384


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
        self._kept: deque[Passed] = deque(maxlen=MOST_KEPT)
        self.stream = wire.stream

    def drain(self) -> Sequence[Passed]:
        """All that passed since the last call, oldest first."""
        return [self._kept.popleft() for _ in range(len(self._kept))]

    def receive(self) -> Sequence[tuple[float, bytes]]:
        """As the wire's."""
        arrived = self._wire.receive()
        self._kept.extend(Passed(received_s, self._from, frame) for received_s, frame in arrived)
        return arrived

    def hand_to(self, handler: Handler) -> None:
        """As the wire's."""

        def listening(received_s: float, frame: bytes) -> None:
            self._kept.append(Passed(received_s, self._from, frame))
            handler(received_s, frame)

        self._wire.hand_to(listening)

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
