"""Metrics of a vehicle. The loop sets the values; one thread serves them to Prometheus on loopback."""

import asyncio
import contextlib
import math
import socket
import threading
from collections.abc import Mapping
from typing import Any, Final

from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, Counter, Gauge, Histogram, generate_latest

from guidance.errors import LinkError
from guidance.flight import Flight, Outputs, State
from guidance.messages import Heartbeat, LocalPosition

MAX_CONNECTIONS: Final = 16
REQUEST_DEADLINE_S: Final = 5.0
_MAX_REQUEST_BYTES: Final = 8192
_GAME_METRICS: Final = (
    "value", "time_needed_s", "assured_distance_m", "margin_s", "vehicle_margin_s", "reachable_speed_m_s",
    "meeting_time_s", "speed_ratio", "evader_age_s", "gap_m", "height_gap_m",
)  # fmt: skip
_BUCKETS_S: Final = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.25)


class Metrics:
    """All metrics of one vehicle, in a separate registry."""

    def __init__(self, name: str) -> None:
        self._name, self.registry = name, CollectorRegistry()
        into: dict[str, Any] = {"namespace": "guidance", "registry": self.registry}
        vehicle = ("vehicle",)
        self._state = Gauge("state", "1 for the state the flight is in", (*vehicle, "state"), **into)
        self._ages = Gauge("age_seconds", "age of the last message", (*vehicle, "what"), **into)
        self._game = Gauge("game", "the certificate of the last cycle", (*vehicle, "what"), **into)
        self._links = Gauge("link_total", "counters of links and evader source", (*vehicle, "link", "what"), **into)
        self._events = Counter("events", "events of the flight", (*vehicle, "event"), **into)
        self._alarms = Counter("alarms", "alarms: violations of the guarantee", (*vehicle, "broken"), **into)
        self._orders = Counter("orders", "orders, accepted or refused", (*vehicle, "order", "accepted"), **into)
        self._acted = Counter("limits_acted", "cycles in which a limit acted", (*vehicle, "limit"), **into)
        self._cycles = Counter("cycles", "guidance cycles", vehicle, **into).labels(name)
        self._setpoints = Counter("setpoints", "setpoints sent", vehicle, **into).labels(name)
        own = {**into, "labelnames": vehicle}
        self._late = Counter("late_cycles", "cycles that began more than one period late", **own).labels(name)
        own["buckets"] = _BUCKETS_S
        self._lateness = Histogram("lateness_seconds", "delay of the start of a cycle", **own).labels(name)
        self._work = Histogram("work_seconds", "working time of a cycle", **own).labels(name)

    def worked(self, work_s: float, missed: int) -> None:
        """Count a cycle of the loop: its working time, and how many cycles it made late."""
        self._work.observe(work_s)
        self._late.inc(missed)

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
        for limit in () if outputs.certificate is None else outputs.certificate.active_limits:
            self._acted.labels(self._name, limit).inc()

    def show(self, now_s: float, flight: Flight, outputs: Outputs, counters: Mapping[str, Mapping[str, int]]) -> None:
        """Set the gauges. Called once a second.

        Args:
            now_s: Time now.
            flight: The flight.
            outputs: Outputs of the last cycle.
            counters: Counters of each link, by link and name.
        """
        for state in State:
            self._state.labels(self._name, str(state)).set(state is outputs.state)
        heartbeat_s, position_s = (flight.vehicle.age_s(kind, now_s) for kind in (Heartbeat, LocalPosition))
        ages_s = {"heartbeat": heartbeat_s, "position": position_s, "evader": flight.tracking.silence_s(now_s)}
        for what, age_s in ages_s.items():
            self._ages.labels(self._name, what).set(age_s)
        certificate = outputs.certificate
        for what in _GAME_METRICS:
            self._game.labels(self._name, what).set(math.nan if certificate is None else getattr(certificate, what))
        for link, counts in counters.items():
            for what, count in counts.items():
                self._links.labels(self._name, link, what).set(count)

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

    def __init__(self, metrics: Metrics, port: int, deadline_s: float = REQUEST_DEADLINE_S) -> None:
        try:
            listener = socket.create_server(("127.0.0.1", port))
        except OSError as error:
            raise LinkError(f"metrics.port = {port}: {error.strerror}; choose another") from error
        self.port = int(listener.getsockname()[1])
        self._registry, self._deadline_s = metrics.registry, deadline_s
        self._answering: list[asyncio.Task[None] | None] = []
        self._loop, self._ended = asyncio.new_event_loop(), asyncio.Event()
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
        server = await asyncio.start_server(self._answer, sock=listener, limit=_MAX_REQUEST_BYTES)
        await self._ended.wait()
        server.close()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer one request and close the connection."""
        task = asyncio.current_task()
        self._answering.append(task)
        if len(self._answering) > MAX_CONNECTIONS and (oldest := self._answering.pop(0)) is not None:
            oldest.cancel()
        try:
            with contextlib.suppress(asyncio.LimitOverrunError, asyncio.IncompleteReadError, OSError):
                async with asyncio.timeout(self._deadline_s):
                    writer.write(self._response(await reader.readuntil(b"\r\n\r\n")))
                    writer.close()
                    await writer.wait_closed()
        finally:
            writer.transport.abort()
            if task in self._answering:
                self._answering.remove(task)

    def _response(self, request: bytes) -> bytes:
        if not request.startswith(b"GET "):
            return b"HTTP/1.1 405 Method Not Allowed\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"
        body = generate_latest(self._registry)
        headers = f"Content-Type: {CONTENT_TYPE_LATEST}\r\nContent-Length: {len(body)}\r\nConnection: close"
        return f"HTTP/1.1 200 OK\r\n{headers}\r\n\r\n".encode() + body
