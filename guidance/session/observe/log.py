"""The log: one line per event, as JSON or text, written by its own thread so that the loop never waits for it."""

import contextlib
import json
import logging
import queue
import sys
import threading
import time
from collections.abc import Mapping
from typing import Any, Final, TextIO

from guidance.flight import Event, Outputs
from guidance.log.codec import plain
from guidance.log.sink import Report, Sink
from guidance.screen import PrintableConsole, aged, live
from guidance.session.observe.severe import SEVERE
from guidance.session.orders.answers import flight_line
from guidance.texts import printable

LOGGER_NAME: Final = "guidance"
MOST_LINES_WAITING: Final = 1000
_STOP_LIMIT_S: Final = 2.0
_STALLED_S: Final = 2.5
"""A live line older than this is shown as old; it is updated once a second."""


class Log(logging.Handler, Sink):
    """Structured logging for one process, as the handler of `LOGGER_NAME`.

    Args:
        form: "json" or "console".
        level: Lowest level that is written.
        stream: Output stream.

    Attributes:
        dropped: Number of lines that were dropped because the terminal or journal is blocked.
    """

    def __init__(self, form: str, level: str, stream: TextIO | None = None) -> None:
        super().__init__()
        self._console = PrintableConsole(
            file=sys.stderr if stream is None else stream,
            markup=False,
            emoji=False,
            highlight=False,
            soft_wrap=True,
        )
        self._live = form == "console"
        self._line_of = _console_line if self._live else _json_line
        self._shown = ""
        self._shown_s = 0.0
        self.dropped = 0
        self._waiting: queue.SimpleQueue[logging.LogRecord | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._serve, name="log", daemon=True)
        self._thread.start()
        self._logger = logging.getLogger(LOGGER_NAME)
        self._logger.setLevel(level.upper())
        self._logger.propagate = False
        self._logger.addHandler(self)

    def say(self, level: int, message: str, fields: Mapping[str, Any]) -> None:
        """Log a message with fields."""
        self._logger.log(level, message, extra={"fields": fields})

    def report(self, report: Report) -> None:
        """Log the results of a cycle; once a second show the live line."""
        say_outputs(self, report.outputs)
        if report.counters is not None:
            self.show(flight_line(report.flight, report.outputs, report.now_s))

    def show(self, words: str) -> None:
        """Show the live line below the log, on a terminal only."""
        self._shown = words
        self._shown_s = time.monotonic()

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a record for the writing thread."""
        if self._waiting.qsize() < MOST_LINES_WAITING:
            self._waiting.put(record)
        else:
            self.dropped += 1

    def close(self) -> None:
        """Write the waiting lines, within `_STOP_LIMIT_S`, and stop. May be called twice."""
        self._logger.removeHandler(self)
        self._waiting.put(None)
        self._thread.join(_STOP_LIMIT_S)
        super().close()

    def _serve(self) -> None:
        """Write on a thread of its own, which alone may wait for a terminal."""
        with (
            live(self._console, self._live_line, every_s=1.0)
            if self._live
            else contextlib.nullcontext()
        ):
            while True:
                record = self._waiting.get()
                if record is None:
                    return
                with contextlib.suppress(OSError, ValueError):  # a terminal that was closed
                    self._console.print(self._line_of(record, getattr(record, "fields", {})))

    def _live_line(self) -> str:
        return aged(self._shown, time.monotonic() - self._shown_s, _STALLED_S)


def _json_line(record: logging.LogRecord, fields: Mapping[str, Any]) -> str:
    """Return one object: time (Unix seconds), level, message, and the fields that came with it."""
    row = {
        "time": round(record.created, 3),
        "level": record.levelname.lower(),
        "message": record.getMessage(),
    }
    return json.dumps({**row, **plain(fields)}, default=str)


def _console_line(record: logging.LogRecord, fields: Mapping[str, Any]) -> str:
    """Return a line for people: time of day, message, and the fields behind it."""
    clock = time.strftime("%H:%M:%S", time.localtime(record.created))
    mark = "" if record.levelno < logging.WARNING else f"{record.levelname} "
    details = "".join(f"  {name}={value}" for name, value in fields.items())
    return f"{clock} {mark}{printable(record.getMessage() + details)}"


def say_outputs(log: Sink, outputs: Outputs) -> None:
    """Log the results of a cycle: alarm, internal error and transitions."""
    alarm = outputs.alarm
    if alarm is not None:
        by = alarm.by if alarm.by else "-"
        log.say(logging.WARNING, str(alarm.violation), {"by": by})
    if outputs.fault is not None:
        log.say(logging.ERROR, "an error of guidance itself", {"error": outputs.fault})
    for transition in outputs.transitions:
        changes = transition.after is not transition.before
        level = logging.WARNING if transition.event in SEVERE and changes else logging.INFO
        fields = {
            "before": transition.before,
            "state": transition.after,
            "now_s": round(transition.now_s, 3),
        }
        if transition.event is Event.HOME_MOVED:
            level = logging.WARNING
            fields["detail"] = transition.detail
        log.say(level, str(transition.event), fields)
