"""Transport of a team's messages: the port, and a network in virtual time with delay, loss and cuts."""

import random
from collections.abc import Callable, Collection, Sequence
from typing import Protocol

Arrived = tuple[float, str, bytes]
"""A message: its arrival on our clock, its key from the kind on (`state/alpha`), and its bytes."""


class Transport(Protocol):
    """One vehicle's connection to its team. No method blocks or raises."""

    def publish(self, key: str, payload: bytes) -> None:
        """Send to all mates; messages may be lost."""

    def receive(self) -> Sequence[Arrived]:
        """Return what arrived since the last call, oldest first; not what this vehicle sent. The queue is bounded."""

    def present(self) -> Collection[str] | None:
        """Return the names of the vehicles with a liveliness token; None if it has no tokens."""

    def close(self) -> None:
        """Leave the team. May be called twice."""


class MemoryNetwork:
    """Connects the vehicles of one process in virtual time.

    Args:
        clock: Returns the time, s.
        delay_s: From sending to arrival.
        jitter_s: Up to so much more, drawn for each message.
        loss: Share of lost messages.
        seed: Of the draws.

    Attributes:
        cut: Vehicles that neither send nor hear now.
    """

    def __init__(
        self,
        clock: Callable[[], float],
        *,
        delay_s: float = 0.0,
        jitter_s: float = 0.0,
        loss: float = 0.0,
        seed: int = 0,
    ) -> None:
        self._clock = clock
        self._delay_s, self._jitter_s, self.loss = delay_s, jitter_s, loss
        self._draw = random.Random(seed)
        self._ends: dict[str, MemoryTransport] = {}
        self.cut: set[str] = set()

    def join(self, name: str) -> "MemoryTransport":
        """Return the connection of a vehicle."""
        self._ends[name] = MemoryTransport(self, name, self._clock)
        return self._ends[name]

    def send(self, sender: str, key: str, payload: bytes) -> None:
        """Deliver a message to all others."""
        for name, end in self._ends.items():
            reached = name != sender and not {name, sender} & self.cut and self._draw.random() >= self.loss
            if reached:
                end.waiting.append((self._clock() + self._delay_s + self._jitter_s * self._draw.random(), key, payload))

    def leave(self, name: str) -> None:
        """Remove a vehicle."""
        self._ends.pop(name, None)


class MemoryTransport:
    """`Transport` of a `MemoryNetwork`."""

    def __init__(self, network: MemoryNetwork, name: str, clock: Callable[[], float]) -> None:
        self._network, self._name, self._clock = network, name, clock
        self.waiting: list[Arrived] = []

    def publish(self, key: str, payload: bytes) -> None:
        """Send to all mates."""
        self._network.send(self._name, key, payload)

    def receive(self) -> Sequence[Arrived]:
        """Return what has arrived by now."""
        now_s = self._clock()
        arrived = sorted(one for one in self.waiting if one[0] <= now_s)
        self.waiting = [one for one in self.waiting if one[0] > now_s]
        return arrived

    def present(self) -> None:
        """Return None: it has no tokens."""

    def close(self) -> None:
        """Leave the network."""
        self._network.leave(self._name)
