"""Metrics: the loop sets their values, and one thread serves them to Prometheus on loopback."""

import asyncio
import contextlib
import math
import socket
import threading
from collections.abc import Mapping
from typing import Any, Final

from prometheus_client import (
    CONTENT_TYPE_LATEST,
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    generate_latest,
)

from guidance.errors import LinkError
from guidance.flight import Flight, Outputs, State
from guidance.log.entries import EVADER_NEWS, LINK_NEWS, RELOADED, STOPPED
from guidance.log.sink import Report, Sink
from guidance.messages import Heartbeat, LocalPosition

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
        for transition in outputs.transitions:
            self.happened(str(transition.event))
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
                    request = await reader.readuntil(b"\r\n\r\n")
                    status = "405 Method Not Allowed"
                    headers = "Connection: close\r\nContent-Length: 0"
                    body = b""
                    if request.startswith(b"GET "):
                        status = "200 OK"
                        body = generate_latest(self._registry)
                        headers = (
                            f"Content-Type: {CONTENT_TYPE_LATEST}\r\n"
                            f"Content-Length: {len(body)}\r\nConnection: close"
                        )
                    writer.write(f"HTTP/1.1 {status}\r\n{headers}\r\n\r\n".encode() + body)
                    writer.close()
                    await writer.wait_closed()
        finally:
            writer.transport.abort()
            if writer in self._open:
                self._open.remove(writer)
