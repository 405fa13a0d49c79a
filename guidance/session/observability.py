"""What shows people and other programs how a daemon does: the log, metrics, and signs of life to systemd.

The log has one line per event, as JSON or text, written by its own thread so that the loop never waits for it. The loop
sets the metrics' values, and one thread serves them to Prometheus on loopback. Signs of life follow sd_notify(3):
datagrams to $NOTIFY_SOCKET.
"""

import asyncio
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

from prometheus_client import (
    CONTENT_TYPE_LATEST,
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    generate_latest,
)

from guidance.errors import LinkError
from guidance.flight import Event, Flight, Outputs, State
from guidance.log.codec import plain
from guidance.log.entries import EVADER_NEWS, LINK_NEWS, RELOADED, STOPPED
from guidance.log.sink import FlightIdentity, Report, Sink
from guidance.messages import Heartbeat, LocalPosition
from guidance.screen import PrintableConsole, aged, live
from guidance.session.answers import flight_line, shown_state
from guidance.texts import printable

ENDING: Final = "ending"
"""What a daemon says when it begins to end."""

LOGGER: Final = "guidance"
MOST_WAITING: Final = 1000
STOP_LIMIT_S: Final = 2.0
_STALLED_S: Final = 2.5
"""Age of the live line from which it is shown as old; it is updated once a second."""

_SEVERE: Final = frozenset({
    Event.PILOT, Event.FOREIGN, Event.TELEMETRY_LOST, Event.LATE, Event.SECOND_SENDER,
    Event.EVADER_LOST, Event.ESTIMATOR_RESET, Event.LOOP_LATE,
    Event.OPERATOR_LOST, Event.OPERATOR_GONE, Event.RIVAL,
    Event.BATTERY_LOW, Event.FENCE, Event.FLOOR, Event.CEILING, Event.STAND_OFF,
    Event.NO_GAME, Event.REBOOTED, Event.TIMED_OUT, Event.CHASE_TIMED_OUT, Event.ABORT, Event.FAULT,
})  # fmt: skip
"""Events that end, interrupt or forbid a game: warnings if they change the state."""


class Log(logging.Handler, Sink):
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
        self._console = PrintableConsole(
            file=stream or sys.stderr, markup=False, emoji=False, highlight=False, soft_wrap=True
        )
        self._live = form == "console"
        self._line_of = _console_line if self._live else _json_line
        self._shown = ""
        self._shown_s = 0.0
        self.dropped = 0
        self._waiting: queue.SimpleQueue[logging.LogRecord | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._serve, name="log", daemon=True)
        self._thread.start()
        self._logger = logging.getLogger(LOGGER)
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
    """Log the results of a cycle: alarm, internal error and happenings."""
    alarm = outputs.alarm
    if alarm is not None:
        by = alarm.by if alarm.by else "-"
        log.say(logging.WARNING, str(alarm.violation), {"by": by})
    if outputs.fault is not None:
        log.say(logging.ERROR, "an error of guidance itself", {"error": outputs.fault})
    for happening in outputs.happenings:
        changes = happening.after is not happening.before
        level = logging.WARNING if happening.event in _SEVERE and changes else logging.INFO
        fields = {
            "before": happening.before,
            "state": happening.after,
            "now_s": round(happening.now_s, 3),
        }
        log.say(level, str(happening.event), fields)


_WATCHDOG_SHARE: Final = 3.0
"""Signs of life per watchdog time."""


class Notifier(Sink):
    """Sends sd_notify messages; does nothing without NOTIFY_SOCKET. Never waits.

    Args:
        environment: Of the process: NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID.
        process_id: Its number.
    """

    def __init__(
        self, environment: Mapping[str, str] = MappingProxyType({}), process_id: int = 0
    ) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        microseconds = environment.get("WATCHDOG_USEC", "")
        meant = environment.get("WATCHDOG_PID", str(process_id)) == str(process_id)
        watched = meant and microseconds.isdecimal() and int(microseconds) > 0
        # An abstract one
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._every_s = int(microseconds) * 1e-6 / _WATCHDOG_SHARE if watched else None
        self._alive_s = -math.inf
        self._status = ""
        self._ready = False

    def begin(self, _identity: FlightIdentity) -> None:
        """Send READY=1 with the first flight: the daemon hears its vehicle and takes orders."""
        if not self._ready:
            self._ready = True
            self.send("READY=1")

    def report(self, report: Report) -> None:
        """Send a sign of life, and a line for `systemctl status` when it changes."""
        self.alive(report.now_s)
        if report.counters is not None:
            self.status(f"{shown_state(report.flight)}, mode {report.flight.mode_name}")

    def say(self, _level: int, message: str, _fields: Mapping[str, Any]) -> None:
        """Send STOPPING=1 when the daemon begins to end."""
        if message == ENDING:
            self.send("STOPPING=1")

    def alive(self, now_s: float) -> None:
        """Say so, as often as the watchdog wants it; called by the loop, so that a loop that hangs says nothing."""
        if self._every_s is not None and now_s - self._alive_s >= self._every_s:
            self._alive_s = now_s
            self.send("WATCHDOG=1")

    def status(self, text: str) -> None:
        """Show a line in `systemctl status`, when it changes."""
        if text != self._status:
            self._status = text
            self.send(f"STATUS={text}")

    def send(self, text: str) -> None:
        """Send a message."""
        if self._address:
            with (
                contextlib.suppress(OSError),
                socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as client,
            ):
                client.sendto(text.encode(), socket.MSG_DONTWAIT, self._address)


MAX_CONNECTIONS: Final = 16
_DAEMON_EVENTS: Final = frozenset({EVADER_NEWS, LINK_NEWS, RELOADED, STOPPED})
_GAME_METRICS: Final = (
    "value", "time_needed_s", "assured_distance_m", "margin_s", "vehicle_margin_s", "reachable_speed_m_s",
    "meeting_time_s", "speed_ratio", "evader_age_s", "gap_m", "height_gap_m",
)  # fmt: skip


class Metrics(Sink):
    """All metrics of one vehicle, in a separate registry."""

    def __init__(self, name: str) -> None:
        self._name = name
        self.registry = CollectorRegistry()
        into: dict[str, Any] = {"namespace": "guidance", "registry": self.registry}
        self._state = Gauge(
            "state", "1 for the state the flight is in", ("vehicle", "state"), **into
        )
        self._ages = Gauge("age_seconds", "age of the last message", ("vehicle", "what"), **into)
        self._game = Gauge("game", "the certificate of the last cycle", ("vehicle", "what"), **into)
        self._links = Gauge(
            "link_total", "counters of links and evader source", ("vehicle", "link", "what"), **into
        )
        self._events = Counter("events", "events of the flight", ("vehicle", "event"), **into)
        self._alarms = Counter(
            "alarms", "alarms: violations of the guarantee", ("vehicle", "broken"), **into
        )
        self._orders = Counter(
            "orders", "orders, accepted or refused", ("vehicle", "order", "accepted"), **into
        )
        self._acted = Counter(
            "limits_acted", "cycles in which a limit acted", ("vehicle", "limit"), **into
        )
        into["labelnames"] = ("vehicle",)
        self._cycles = Counter("cycles", "guidance cycles", **into).labels(name)
        self._setpoints = Counter("setpoints", "setpoints sent", **into).labels(name)
        self._late = Counter(
            "late_cycles", "cycles that began more than one period late", **into
        ).labels(name)
        into["buckets"] = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.25)  # s
        self._lateness = Histogram(
            "lateness_seconds", "delay of the start of a cycle", **into
        ).labels(name)
        self._work = Histogram("work_seconds", "working time of a cycle", **into).labels(name)

    def worked(self, work_s: float, missed: int) -> None:
        """Count a cycle of the loop: its working time, and how many cycles it made late."""
        self._work.observe(work_s)
        self._late.inc(missed)

    def event(self, _now_s: float, event: str, _detail: str = "") -> None:
        """Count an event of the daemon; those of the flight are counted with the cycle's outputs."""
        if event in _DAEMON_EVENTS:
            self.happened(event)

    def report(self, report: Report) -> None:
        """Count a cycle and its answered orders; set the gauges once a second."""
        for order in report.orders:
            self.order(order.order, accepted=order.accepted)
        timing = report.timing
        self.follow(report.outputs, None if timing is None else timing.late_s)
        if report.counters is not None:
            self.show(report.now_s, report.flight, report.outputs, report.counters)

    def follow(self, outputs: Outputs, late_s: float | None = None) -> None:
        """Count the outputs of one cycle that began `late_s` late; None: of one that failed."""
        if late_s is not None:
            self._cycles.inc()
            self._lateness.observe(max(0.0, late_s))
        self._setpoints.inc(outputs.setpoint is not None)
        for happening in outputs.happenings:
            self.happened(str(happening.event))
        if outputs.alarm is not None:
            self._alarms.labels(self._name, str(outputs.alarm.violation)).inc()
        if outputs.certificate is not None:
            for limit in outputs.certificate.active_limits:
                self._acted.labels(self._name, limit).inc()

    def show(
        self,
        now_s: float,
        flight: Flight,
        outputs: Outputs,
        counters: Mapping[str, Mapping[str, int]],
    ) -> None:
        """Set the gauges. Called once a second.

        Args:
            now_s: Time now.
            flight: The flight.
            outputs: Outputs of the last cycle.
            counters: Counters of each link, by link and name.
        """
        for state in State:
            self._state.labels(self._name, str(state)).set(state is outputs.state)
        for counter, kind in (("heartbeat", Heartbeat), ("position", LocalPosition)):
            self._ages.labels(self._name, counter).set(flight.vehicle.age_s(kind, now_s))
        self._ages.labels(self._name, "evader").set(flight.tracking.silence_s(now_s))
        certificate = outputs.certificate
        for counter in _GAME_METRICS:
            self._game.labels(self._name, counter).set(
                math.nan if certificate is None else getattr(certificate, counter)
            )
        for link, counts in counters.items():
            for counter, count in counts.items():
                self._links.labels(self._name, link, counter).set(count)

    def happened(self, event: str) -> None:
        """Count an event of the daemon, such as a failed record."""
        self._events.labels(self._name, event).inc()

    def order(self, order: str, *, accepted: bool) -> None:
        """Count an order."""
        self._orders.labels(self._name, order, str(accepted).lower()).inc()


class MetricsServer:
    """Serves a registry at http://127.0.0.1:port/metrics, in one thread for all connections.

    Of too many connections the oldest is closed: idle ones never keep a reader out.

    Args:
        metrics: Metrics to serve.
        port: TCP port on loopback.
        deadline_s: Time for a whole exchange: request and answer. Then the connection is closed.

    Raises:
        LinkError: If the port is in use.
    """

    def __init__(self, metrics: Metrics, port: int, deadline_s: float = 5.0) -> None:
        try:
            listener = socket.create_server(("127.0.0.1", port))
        except OSError as error:
            raise LinkError(f"metrics.port = {port}: {error.strerror}; choose another") from error
        self.port = int(listener.getsockname()[1])
        self._registry = metrics.registry
        self._deadline_s = deadline_s
        self._open = list[asyncio.StreamWriter]()
        self._loop = asyncio.new_event_loop()
        self._ended = asyncio.Event()
        self._thread = threading.Thread(target=self._run, args=(listener,), name="metrics")
        self._thread.start()

    def close(self) -> None:
        """Stop serving."""
        self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join()

    def _run(self, listener: socket.socket) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._serve(listener))

    async def _serve(self, listener: socket.socket) -> None:
        # Bytes of a request
        server = await asyncio.start_server(self._answer, sock=listener, limit=8192)
        await self._ended.wait()
        server.close()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer one request and close the connection."""
        self._open.append(writer)
        if len(self._open) > MAX_CONNECTIONS:
            self._open.pop(0).transport.abort()
        try:
            with contextlib.suppress(
                asyncio.LimitOverrunError, asyncio.IncompleteReadError, OSError
            ):
                async with asyncio.timeout(self._deadline_s):
                    writer.write(self._response(await reader.readuntil(b"\r\n\r\n")))
                    writer.close()
                    await writer.wait_closed()
        finally:
            writer.transport.abort()
            if writer in self._open:
                self._open.remove(writer)

    def _response(self, request: bytes) -> bytes:
        if not request.startswith(b"GET "):
            return (
                b"HTTP/1.1 405 Method Not Allowed\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"
            )
        body = generate_latest(self._registry)
        headers = f"Content-Type: {CONTENT_TYPE_LATEST}\r\nContent-Length: {len(body)}\r\nConnection: close"
        return f"HTTP/1.1 200 OK\r\n{headers}\r\n\r\n".encode() + body
