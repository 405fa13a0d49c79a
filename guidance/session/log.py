"""The log: one line an event, as JSON or for people, written by a thread of its own so that nothing waits for it."""

import contextlib
import json
import logging
import queue
import sys
from logging.handlers import QueueHandler, QueueListener
from typing import Any, Final, Protocol, TextIO

from guidance.log.codec import plain

LOGGER: Final = "guidance"
MOST_WAITING: Final = 1000
STOP_LIMIT_S: Final = 2.0


class _BoundedQueue(QueueHandler):
    """Drops a line rather than wait for a terminal or a journal that stands still."""

    dropped = 0

    def enqueue(self, record: logging.LogRecord) -> None:
        """Keep it for the writing thread, if there is room."""
        try:
            self.queue.put_nowait(record)
        except queue.Full:
            self.dropped += 1


class _Patient(QueueListener):
    """Ends even where the stream stands still for good: a log must not keep a process from ending."""

    def __init__(self, room: "queue.Queue[logging.LogRecord | None]", writing: logging.Handler) -> None:
        super().__init__(room, writing)
        self._room = room

    def enqueue_sentinel(self) -> None:
        """Make room for it, if there is none."""
        while True:
            try:
                self._room.put_nowait(None)
            except queue.Full:
                with contextlib.suppress(queue.Empty):
                    self._room.get_nowait()
            else:
                return

    def stop(self) -> None:
        """Write what waits, within reason."""
        thread, self._thread = self._thread, None
        if thread is not None:
            self.enqueue_sentinel()
            thread.join(STOP_LIMIT_S)


class JsonLines(logging.Formatter):
    """One object a line: time (Unix seconds), level, message, and the fields that came with it."""

    def format(self, record: logging.LogRecord) -> str:
        """Lay out one record."""
        row = {"time": round(record.created, 3), "level": record.levelname.lower(), "message": record.getMessage()}
        return json.dumps({**row, **plain(_fields(record))}, default=str)


class ConsoleLines(logging.Formatter):
    """For people: time of day, message, and the fields behind it."""

    def format(self, record: logging.LogRecord) -> str:
        """Lay out one record."""
        clock = self.formatTime(record, "%H:%M:%S")
        mark = "" if record.levelno < logging.WARNING else f"{record.levelname} "
        fields = "".join(f"  {name}={value}" for name, value in _fields(record).items())
        return f"{clock} {mark}{record.getMessage()}{fields}"


class Logger(Protocol):
    """Where what happens is logged."""

    def say(self, level: int, message: str, **fields: Any) -> None:  # noqa: ANN401 - any value may be logged
        """Log a message with fields."""
        ...


class NullLogger:
    """Logs nothing: who flies a mock sees it."""

    def say(self, level: int, message: str, **fields: Any) -> None:  # noqa: ANN401
        """Nothing."""


SILENT: Final[Logger] = NullLogger()


class Log:
    """Structured logging for one process.

    Args:
        form: "json" or "console".
        level: Lowest level that is written.
        stream: Where to.
    """

    def __init__(self, form: str, level: str, stream: TextIO | None = None) -> None:
        writing = logging.StreamHandler(stream if stream is not None else sys.stderr)
        writing.setFormatter(JsonLines() if form == "json" else ConsoleLines())
        room: queue.Queue[logging.LogRecord | None] = queue.Queue(MOST_WAITING)
        self._handler = _BoundedQueue(room)
        self._listener = _Patient(room, writing)
        self._logger = logging.getLogger(LOGGER)
        self._logger.setLevel(level.upper())
        self._logger.propagate = False
        self._logger.addHandler(self._handler)
        self._listener.start()

    @property
    def dropped(self) -> int:
        """Lines for which there was no room."""
        return self._handler.dropped

    def say(self, level: int, message: str, **fields: Any) -> None:  # noqa: ANN401 - any value may be logged
        """Log a message with fields."""
        self._logger.log(level, message, extra={"fields": fields})

    def close(self) -> None:
        """Write what waits, and stop."""
        self._logger.removeHandler(self._handler)
        self._listener.stop()


def _fields(record: logging.LogRecord) -> dict[str, Any]:
    fields = getattr(record, "fields", {})
    return dict(fields) if isinstance(fields, dict) else {}
