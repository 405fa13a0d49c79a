"""Transport of a team's messages: the port, and one between the vehicles of a process in virtual time."""

from collections.abc import Callable, Collection, Sequence
from typing import Final, Protocol

Arrived = tuple[float, str, bytes]
"""A message: its arrival on our clock, its key from the kind on (`state/alpha`), and its bytes."""


DELAY_S: Final = 0.02
"""Delay of the messages between the vehicles of a team in virtual time."""


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


class MemoryTransport:
    """`Transport` between the vehicles of one process, in virtual time; each message takes `DELAY_S`.

    Args:
        name: The vehicle's.
        ends: The transports of all vehicles, by name; this one is added.
        clock: Returns the time, s.
    """

    def __init__(self, name: str, ends: dict[str, "MemoryTransport"], clock: Callable[[], float]) -> None:
        self.name, self._ends, self._clock = name, ends, clock
        self.waiting: list[Arrived] = []
        ends[name] = self

    def publish(self, key: str, payload: bytes) -> None:
        """Send to all mates."""
        for end in self._ends.values():
            if end is not self:
                end.waiting.append((self._clock() + DELAY_S, key, payload))

    def receive(self) -> Sequence[Arrived]:
        """Return what has arrived by now."""
        now_s = self._clock()
        arrived = sorted(one for one in self.waiting if one[0] <= now_s)
        self.waiting = [one for one in self.waiting if one[0] > now_s]
        return arrived

    def present(self) -> None:
        """Return None: it has no tokens."""

    def close(self) -> None:
        """Leave the team."""
        self._ends.pop(self.name, None)
