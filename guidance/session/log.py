"""The log: one line per event, as JSON or text, written by its own thread so that the loop never waits for it."""

import contextlib
import json
import logging
import os
import queue
import shutil
import sys
import time
from logging.handlers import QueueHandler, QueueListener
from typing import Any, Final, Protocol, TextIO, cast

from guidance.flight import Event, Outputs
from guidance.log.codec import plain

LOGGER: Final = "guidance"
MOST_WAITING: Final = 1000
STOP_LIMIT_S: Final = 2.0
_STALLED_S: Final = 2.5
"""Age of the live line from which it is shown as old; it is updated once a second."""

_ANEW: Final = "\r\x1b[K"
"""To the beginning of the line, and nothing in it."""

_SEVERE: Final = frozenset({
    Event.PILOT, Event.FOREIGN, Event.TELEMETRY_LOST, Event.EVADER_LOST, Event.ESTIMATOR_RESET, Event.LOOP_LATE,
    Event.OPERATOR_LOST, Event.OPERATOR_GONE, Event.RIVAL,
    Event.BATTERY_LOW, Event.FENCE, Event.FLOOR, Event.CEILING, Event.STAND_OFF,
    Event.NO_GAME, Event.REBOOTED, Event.TIMED_OUT, Event.CHASE_TIMED_OUT, Event.ABORT, Event.FAULT,
})  # fmt: skip
"""Events that end, interrupt or forbid a game: warnings if they change the state."""


class _BoundedQueue(QueueHandler):
    """Queue handler that drops a line if the terminal or journal is blocked."""

    dropped = 0

    def enqueue(self, record: logging.LogRecord) -> None:
        """Keep it for the writing thread, if there is room."""
        try:
            self.queue.put_nowait(record)
        except queue.Full:
            self.dropped += 1


class _Terminal(logging.StreamHandler[TextIO]):
    """Lines on a terminal, and below them one that is drawn again, with its age once it is old."""

    live = ""

    def __init__(self, stream: TextIO) -> None:
        super().__init__(stream)
        self._told_s = 0.0

    def emit(self, record: logging.LogRecord) -> None:
        """Write a line above the live one, or take in another live one."""
        live = getattr(record, "live", None)
        with contextlib.suppress(OSError, ValueError):  # a terminal that was closed
            if live is not None:
                self.live, self._told_s = live, time.monotonic()
            else:
                self.stream.write(f"{_ANEW}{self.format(record)}\n")
            self.draw()

    def draw(self) -> None:
        """Draw the live line."""
        if not self.live:
            return
        silence_s = time.monotonic() - self._told_s
        words = f"NO NEWS for {silence_s:.0f} s; last {self.live}" if silence_s > _STALLED_S else self.live
        width = shutil.get_terminal_size().columns
        with contextlib.suppress(OSError, ValueError):
            self.stream.write(f"{_ANEW}{words[: width - 1]}")
            self.stream.flush()

    def end(self) -> None:
        """Leave no live line behind."""
        if self.live:
            self.live = ""
            with contextlib.suppress(OSError, ValueError):
                self.stream.write(_ANEW)
                self.stream.flush()


class _Patient(QueueListener):
    """Listener that ends even if the stream is blocked: a log must not keep a process alive."""

    def __init__(self, room: "queue.Queue[logging.LogRecord | None]", writing: logging.Handler) -> None:
        super().__init__(room, writing)
        self._room = room

    def dequeue(self, block: bool) -> logging.LogRecord:
        """Return the next line; while there is none, the live one grows old where people see it."""
        while True:
            terminals = [handler for handler in self.handlers if isinstance(handler, _Terminal)]
            try:
                record = self._room.get(block, _STALLED_S)
            except queue.Empty:
                if not block:
                    raise
                for terminal in terminals:
                    terminal.draw()
                continue
            if record is None:  # the end: on this thread, which alone may wait for a terminal
                for terminal in terminals:
                    terminal.end()
            return cast("logging.LogRecord", record)

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
    """Interface of the log."""

    def say(self, level: int, message: str, **fields: Any) -> None:  # noqa: ANN401 - any value may be logged
        """Log a message with fields."""


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
        stream: Output stream.
    """

    def __init__(self, form: str, level: str, stream: TextIO | None = None) -> None:
        there = stream if stream is not None else sys.stderr
        self._terminal = _Terminal(there) if form == "console" and _redraws(there) else None
        writing = self._terminal if self._terminal is not None else logging.StreamHandler(there)
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
        """Number of dropped lines."""
        return self._handler.dropped

    def say(self, level: int, message: str, **fields: Any) -> None:  # noqa: ANN401 - any value may be logged
        """Log a message with fields."""
        self._logger.log(level, message, extra={"fields": fields})

    def show(self, words: str) -> None:
        """Show the live line below the log, on a terminal only."""
        if self._terminal is not None:
            self._handler.handle(logging.makeLogRecord({"live": words, "levelno": logging.CRITICAL}))

    def close(self) -> None:
        """Write what waits, and stop."""
        self._logger.removeHandler(self._handler)
        self._listener.stop()


def _redraws(stream: TextIO) -> bool:
    return stream.isatty() and os.environ.get("TERM", "") not in {"", "dumb", "unknown"}


def _fields(record: logging.LogRecord) -> dict[str, Any]:
    fields = getattr(record, "fields", {})
    return dict(fields) if isinstance(fields, dict) else {}


def say_outputs(log: Logger, outputs: Outputs) -> None:
    """Log the results of a cycle: alarm, internal error and happenings."""
    if outputs.alarm is not None:
        log.say(logging.WARNING, str(outputs.alarm.violation), by=outputs.alarm.by or "-")
    if outputs.fault is not None:
        log.say(logging.ERROR, "an error of guidance itself", error=outputs.fault)
    for happening in outputs.happenings:
        severe = happening.event in _SEVERE and happening.after is not happening.before
        log.say(
            logging.WARNING if severe else logging.INFO,
            str(happening.event),
            before=happening.before,
            state=happening.after,
            now_s=round(happening.now_s, 3),
        )
