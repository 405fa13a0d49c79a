"""Two ends of a wire in one process: for virtual time and for tests. No thread; time is the reader's clock."""

from collections.abc import Mapping, Sequence

from guidance.links.arrivals import Arrivals, Clock


class MemoryWire:
    """One end. What the other end sends waits here, stamped with the clock at the moment of sending."""

    stream = False

    def __init__(self, inbox: Arrivals[bytes], outbox: Arrivals[bytes]) -> None:
        self._inbox = inbox
        self._outbox = outbox
        self._sent = self._unsent = 0

    @classmethod
    def pair(cls, clock: Clock) -> tuple["MemoryWire", "MemoryWire"]:
        """Two connected ends."""
        one, other = Arrivals[bytes](clock), Arrivals[bytes](clock)
        return cls(one, other), cls(other, one)

    def receive(self) -> Sequence[tuple[float, bytes]]:
        """What the other end sent since the last call."""
        return self._inbox.take()

    def send(self, frame: bytes) -> None:
        """Put one frame into the other end; into nothing once that is closed."""
        if self._outbox.closed:
            self._unsent += 1
        else:
            self._outbox.put(frame)
            self._sent += 1

    def counters(self) -> Mapping[str, int]:
        """Frames sent and not sent, and pieces dropped for want of room."""
        return {"wire_sent": self._sent, "wire_unsent": self._unsent, "wire_dropped": self._inbox.dropped}

    def close(self) -> None:
        """Close both directions, for both ends."""
        self._inbox.close()
        self._outbox.close()
