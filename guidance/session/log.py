"""The log, and signs of life to systemd.

The log has one line per event, as JSON or text, written by its own thread so that the loop never waits for it. Signs of
life follow sd_notify(3): datagrams to $NOTIFY_SOCKET.
"""

import contextlib
import json
import logging
import math
import queue
import socket
import sys
import threading
import time
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final, TextIO

from rich.console import Console

from guidance.flight import Event, Outputs
from guidance.log.codec import plain
from guidance.screen import aged, live

LOGGER: Final = "guidance"
MOST_WAITING: Final = 1000
STOP_LIMIT_S: Final = 2.0
_STALLED_S: Final = 2.5
"""Age of the live line from which it is shown as old; it is updated once a second."""

_SEVERE: Final = frozenset({
    Event.PILOT, Event.FOREIGN, Event.TELEMETRY_LOST, Event.EVADER_LOST, Event.ESTIMATOR_RESET, Event.LOOP_LATE,
    Event.OPERATOR_LOST, Event.OPERATOR_GONE, Event.RIVAL,
    Event.BATTERY_LOW, Event.FENCE, Event.FLOOR, Event.CEILING, Event.STAND_OFF,
    Event.NO_GAME, Event.REBOOTED, Event.TIMED_OUT, Event.CHASE_TIMED_OUT, Event.ABORT, Event.FAULT,
})  # fmt: skip
"""Events that end, interrupt or forbid a game: warnings if they change the state."""


class Logger:
    """The interface of the log, and one that logs nothing: who flies a mock sees it."""

    def say(self, level: int, message: str, **fields: Any) -> None:  # noqa: ANN401 - any value may be logged
        """Log a message with fields."""

    def show(self, words: str) -> None:
        """Show a live line below the log."""


SILENT: Final = Logger()


class Log(Logger, logging.Handler):
    """Structured logging for one process, as the handler of `LOGGER`.

    Args:
        form: "json" or "console".
        level: Lowest level that is written.
        stream: Output stream.

    Attributes:
        dropped: Number of lines that were dropped because the terminal or journal is blocked.
    """

    def __init__(self, form: str, level: str, stream: TextIO | None = None) -> None:
        super().__init__()
        self._console = Console(file=stream or sys.stderr, markup=False, emoji=False, highlight=False, soft_wrap=True)
        self._live = form == "console"
        self._line_of = _console_line if self._live else _json_line
        self._shown, self._shown_s, self.dropped = "", 0.0, 0
        self._waiting: queue.SimpleQueue[logging.LogRecord | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._serve, name="log", daemon=True)
        self._thread.start()
        self._logger = logging.getLogger(LOGGER)
        self._logger.setLevel(level.upper())
        self._logger.propagate = False
        self._logger.addHandler(self)

    def say(self, level: int, message: str, **fields: Any) -> None:  # noqa: ANN401 - any value may be logged
        """Log a message with fields."""
        self._logger.log(level, message, extra={"fields": fields})

    def show(self, words: str) -> None:
        """Show the live line below the log, on a terminal only."""
        self._shown, self._shown_s = words, time.monotonic()

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a record for the writing thread."""
        if self._waiting.qsize() < MOST_WAITING:
            self._waiting.put(record)
        else:
            self.dropped += 1

    def close(self) -> None:
        """Write what waits, within `STOP_LIMIT_S`, and stop. May be called twice."""
        self._logger.removeHandler(self)
        self._waiting.put(None)
        self._thread.join(STOP_LIMIT_S)
        super().close()

    def _serve(self) -> None:
        """Write on a thread of its own, which alone may wait for a terminal."""
        with live(self._console, self._live_line, every_s=1.0) if self._live else contextlib.nullcontext():
            while (record := self._waiting.get()) is not None:
                with contextlib.suppress(OSError, ValueError):  # a terminal that was closed
                    self._console.print(self._line_of(record, getattr(record, "fields", {})))

    def _live_line(self) -> str:
        return aged(self._shown, time.monotonic() - self._shown_s, _STALLED_S)


def _json_line(record: logging.LogRecord, fields: dict[str, Any]) -> str:
    """Return one object: time (Unix seconds), level, message, and the fields that came with it."""
    row = {"time": round(record.created, 3), "level": record.levelname.lower(), "message": record.getMessage()}
    return json.dumps({**row, **plain(fields)}, default=str)


def _console_line(record: logging.LogRecord, fields: dict[str, Any]) -> str:
    """Return a line for people: time of day, message, and the fields behind it."""
    clock = time.strftime("%H:%M:%S", time.localtime(record.created))
    mark = "" if record.levelno < logging.WARNING else f"{record.levelname} "
    return f"{clock} {mark}{record.getMessage()}" + "".join(f"  {name}={value}" for name, value in fields.items())


def say_outputs(log: Logger, outputs: Outputs) -> None:
    """Log the results of a cycle: alarm, internal error and happenings."""
    if outputs.alarm is not None:
        log.say(logging.WARNING, str(outputs.alarm.violation), by=outputs.alarm.by or "-")
    if outputs.fault is not None:
        log.say(logging.ERROR, "an error of guidance itself", error=outputs.fault)
    for one in outputs.happenings:
        level = logging.WARNING if one.event in _SEVERE and one.after is not one.before else logging.INFO
        log.say(level, str(one.event), before=one.before, state=one.after, now_s=round(one.now_s, 3))


_WATCHDOG_SHARE: Final = 3.0
"""Signs of life per watchdog time."""


class Notifier:
    """Sends sd_notify messages; does nothing without NOTIFY_SOCKET. Never waits.

    Args:
        environment: Of the process: NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID.
        process_id: Its number.
    """

    def __init__(self, environment: Mapping[str, str] = MappingProxyType({}), process_id: int = 0) -> None:
        address, microseconds = environment.get("NOTIFY_SOCKET", ""), environment.get("WATCHDOG_USEC", "")
        meant = environment.get("WATCHDOG_PID", str(process_id)) == str(process_id)
        watched = meant and microseconds.isdecimal() and int(microseconds) > 0
        self._address = "\0" + address[1:] if address.startswith("@") else address  # an abstract one
        self._every_s = int(microseconds) * 1e-6 / _WATCHDOG_SHARE if watched else None
        self._alive_s, self._status = -math.inf, ""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) if address else None
        if self._socket is not None:
            self._socket.setblocking(False)

    def ready(self) -> None:
        """The daemon hears its vehicle and takes orders."""
        self._send("READY=1")

    def alive(self, now_s: float) -> None:
        """Say so, as often as the watchdog wants it; called by the loop, so that a loop that hangs says nothing."""
        if self._every_s is not None and now_s - self._alive_s >= self._every_s:
            self._alive_s = now_s
            self._send("WATCHDOG=1")

    def status(self, text: str) -> None:
        """Show a line in `systemctl status`, when it changes."""
        if text != self._status:
            self._status = text
            self._send(f"STATUS={text}")

    def stopping(self) -> None:
        """The daemon is about to end."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """Close the socket; may be called twice."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, text: str) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(text.encode(), self._address)
