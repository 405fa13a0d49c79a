"""The flight logs of one vehicle: kept in memory, bounded, and not lost in a reboot."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

LOG_BYTES: Final = 4 << 20
"""Most bytes of one vehicle's logs: a quarter of an hour of flight."""


@dataclass(slots=True)
class FlightLog:
    """One log.

    Attributes:
        path: Absolute path of its file.
        changed_s: Seconds since 1970 when it was last written.
        content: The file.
    """

    path: str
    changed_s: float
    content: bytearray = field(default_factory=bytearray)


class LogBook:
    """The logs of one vehicle in the order of their beginning; at most one is being written.

    A new byte takes the place of the oldest finished log. When there is none left to remove, the log ends.

    Args:
        most_bytes: Most bytes of all logs together; 0 for no logs.

    Attributes:
        logs: The logs, oldest first.
        running: The log that is being written.
        listener: Takes the messages of a log that is streamed to a client.
    """

    def __init__(self, most_bytes: int = LOG_BYTES) -> None:
        self.most_bytes = most_bytes
        self.logs: list[FlightLog] = []
        self.running: FlightLog | None = None
        self.listener: Callable[[Sequence[bytes]], None] | None = None
        self._bytes = 0

    @property
    def files(self) -> Mapping[str, bytearray]:
        """The logs by path."""
        return {log.path: log.content for log in self.logs}

    @property
    def is_open(self) -> bool:
        """True if something takes what is logged."""
        return self.running is not None or self.listener is not None

    def begin(self, path: str, now_s: float, head: bytes) -> None:
        """Begin a log at a time since 1970 with the head of its file, if logs are kept; a running one ends."""
        if not self.most_bytes:
            return
        self.running = FlightLog(path, now_s)
        self.logs.append(self.running)
        self.add(now_s, head)

    def add(self, now_s: float, data: bytes) -> None:
        """Write to the running log; without one, nothing happens."""
        log = self.running
        if log is None:
            return
        log.content += data
        log.changed_s = now_s
        self._bytes += len(data)
        if self._bytes > self.most_bytes:
            if self.logs[0] is log:
                self.running = None
            else:
                self._bytes -= len(self.logs.pop(0).content)

    def end(self) -> None:
        """End the running log."""
        self.running = None

    def remove(self, path: str) -> bool:
        """Remove a log; False if there is none of that path. A running one ends."""
        for log in self.logs:
            if log.path == path:
                self.logs.remove(log)
                self._bytes -= len(log.content)
                if log is self.running:
                    self.running = None
                return True
        return False

    def erase(self) -> None:
        """Remove all logs."""
        self.logs.clear()
        self.running = None
        self._bytes = 0
