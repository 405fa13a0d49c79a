"""What arrives waits here until the loop asks: bounded, oldest dropped and counted, stamped on arrival.

A `Reader` is the thread that reads a socket or a port, so that a piece is stamped when it arrives and not when the loop
looks. A `MemoryWire` needs none: two of them are the ends of a wire in one process, for virtual time and for tests.
"""

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Final, Generic, TypeVar

Clock = Callable[[], float]
T = TypeVar("T")

MOST_WAITING: Final = 1024


class Arrivals(Generic[T]):
    """Filled by a library's or a reader's thread, emptied by the loop's."""

    def __init__(self, clock: Clock, *, most: int = MOST_WAITING) -> None:
        self._clock = clock
        self._most = most
        self._waiting: deque[tuple[float, T]] = deque()
        self._lock = threading.Lock()
        self._arrived = threading.Condition(self._lock)
        self.closed = False
        self.dropped = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, item: T, received_s: float | None = None) -> None:
        """Keep, stamped now unless it was before; never waits for room, and does nothing once closed."""
        received_s = self._clock() if received_s is None else received_s
        with self._lock:
            if self.closed:
                return
            if len(self._waiting) >= self._most:
                self._waiting.popleft()
                self.dropped += 1
            self._waiting.append((received_s, item))
            self._arrived.notify()

    def take(self) -> list[tuple[float, T]]:
        """Everything since the last call, oldest first."""
        with self._lock:
            taken = list(self._waiting)
            self._waiting.clear()
        return taken

    def wait(self, timeout_s: float) -> None:
        """Wait until something is here, at most this long."""
        with self._lock:
            self._arrived.wait_for(lambda: self._waiting or self.closed, timeout_s)

    def close(self) -> None:
        """Take nothing more."""
        with self._lock:
            self.closed = True
            self._waiting.clear()
            self._arrived.notify_all()


class Reader:
    """Calls `read` until closed. `read` waits a short while at most and keeps what came; it may raise OSError."""

    def __init__(self, read: Callable[[], None], *, name: str) -> None:
        self._read = read
        self._stop = threading.Event()
        self.errors = 0
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self._read()
            except OSError:
                self.errors += 1
                self._stop.wait(0.05)  # a refused or vanished peer may come back: neither spin nor give up

    def close(self) -> None:
        """End the thread and wait for it, so that nothing reads the socket when it is closed."""
        self._stop.set()
        if self._thread is not threading.current_thread():
            with contextlib.suppress(RuntimeError):
                self._thread.join()


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

    def wait(self, timeout_s: float) -> None:
        """As a socket's: until the other end sends, at most this long in real time."""
        self._inbox.wait(timeout_s)

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
