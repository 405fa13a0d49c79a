"""Where a link keeps what arrived until the loop asks: bounded, oldest dropped and counted, stamped on arrival."""

import threading
from collections import deque
from collections.abc import Callable
from typing import Final, Generic, TypeVar

Clock = Callable[[], float]
Handler = Callable[[float, bytes], None]
Wake = Callable[[], None]
T = TypeVar("T")

MOST_WAITING: Final = 1024


class Arrivals(Generic[T]):
    """Filled by a library's thread, emptied by the loop's; or handed on at once to a `handler`, on that thread."""

    def __init__(self, clock: Clock, *, most: int = MOST_WAITING, on_arrival: Wake | None = None) -> None:
        """Start empty. `on_arrival` is called after each arrival on the library's thread; it may only wake the loop."""
        self._clock = clock
        self._most = most
        self._on_arrival = on_arrival
        self._waiting: deque[tuple[float, T]] = deque()
        self._lock = threading.Lock()
        self._handler: Callable[[float, T], None] | None = None
        self.closed = False
        self.dropped = 0

    def put(self, item: T) -> None:
        """Stamp and keep; never waits for room, and does nothing once closed."""
        now_s = self._clock()
        with self._lock:
            if self.closed:
                return
            handler = self._handler
            if handler is None:
                if len(self._waiting) >= self._most:
                    self._waiting.popleft()
                    self.dropped += 1
                self._waiting.append((now_s, item))
        if handler is not None:
            handler(now_s, item)
        elif self._on_arrival is not None:
            self._on_arrival()

    def take(self) -> list[tuple[float, T]]:
        """Everything since the last call, oldest first."""
        with self._lock:
            taken = list(self._waiting)
            self._waiting.clear()
        return taken

    def hand_to(self, handler: Callable[[float, T], None]) -> None:
        """From now on give everything to `handler` instead, beginning with what waits; nothing overtakes that."""
        with self._lock:
            self._handler = handler
            while self._waiting:
                handler(*self._waiting.popleft())

    def close(self) -> None:
        """Take nothing more."""
        with self._lock:
            self.closed = True
            self._waiting.clear()
