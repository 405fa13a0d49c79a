"""Bounds the connections of a server: how many, and how long a peer may take to identify itself."""

from collections.abc import Callable, Hashable
from typing import NamedTuple

from guidance.clock import Clock


class _Pending(NamedTuple):
    deadline_s: float
    close: Callable[[], object]


class ConnectionLimit:
    """Closes connections that are idle or too many. Idle connections never keep a new one out.

    Args:
        clock: Time of the deadlines.
        max_connections: Open at the same time.
        deadline_s: Time from `add` to `admit`; then the connection is closed.
    """

    def __init__(self, clock: Clock, *, max_connections: int, deadline_s: float) -> None:
        self._clock = clock
        self._max_connections = max_connections
        self._deadline_s = deadline_s
        self._pending: dict[Hashable, _Pending] = {}  # oldest first
        self._admitted: set[Hashable] = set()

    def __contains__(self, connection: Hashable) -> bool:
        return connection in self._pending or connection in self._admitted

    def add(self, connection: Hashable, close: Callable[[], object]) -> bool:
        """Count a new connection; at the limit, close the oldest that is not admitted. False if all are admitted."""
        if len(self._pending) + len(self._admitted) >= self._max_connections:
            if not self._pending:
                return False
            self._close(next(iter(self._pending)))
        self._pending[connection] = _Pending(self._clock.now_s() + self._deadline_s, close)
        return True

    def admit(self, connection: Hashable) -> None:
        """Remove the deadline of a connection."""
        if self._pending.pop(connection, None) is not None:
            self._admitted.add(connection)

    def remove(self, connection: Hashable) -> None:
        """Forget a connection that has ended."""
        self._pending.pop(connection, None)
        self._admitted.discard(connection)

    def close_late(self) -> None:
        """Close the connections that missed their deadline."""
        now_s = self._clock.now_s()
        for connection in [one for one, pending in self._pending.items() if pending.deadline_s <= now_s]:
            self._close(connection)

    def _close(self, connection: Hashable) -> None:
        self._pending.pop(connection).close()
