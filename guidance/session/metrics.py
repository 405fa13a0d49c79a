"""What Prometheus sees. The loop sets numbers; a thread of the library's serves them on loopback."""

import math
from collections.abc import Mapping
from typing import Final

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, start_http_server

from guidance.errors import LinkError
from guidance.flight import Flight, Outputs, State
from guidance.messages import Heartbeat, LocalPosition

_OF_THE_GAME: Final = (
    "value",
    "time_needed_s",
    "assured_distance_m",
    "margin_s",
    "meeting_time_s",
    "speed_ratio",
    "evader_age_s",
    "gap_m",
    "height_gap_m",
)
_BUCKETS_S: Final = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.25)


class Metrics:
    """All metrics of one vehicle, in a registry of their own."""

    def __init__(self, name: str) -> None:
        self.registry = CollectorRegistry()
        registry = self.registry

        def gauge(key: str, words: str, *labels: str) -> Gauge:
            return Gauge(f"guidance_{key}", words, ("vehicle", *labels), registry=registry)

        def counter(key: str, words: str, *labels: str) -> Counter:
            return Counter(f"guidance_{key}", words, ("vehicle", *labels), registry=registry)

        def histogram(key: str, words: str) -> Histogram:
            return Histogram(f"guidance_{key}", words, ("vehicle",), registry=registry, buckets=_BUCKETS_S)

        self._name = name
        self._state = gauge("state", "1 for the state the flight is in", "state")
        self._ages = gauge("age_seconds", "age of what was last heard", "what")
        self._game = gauge("game", "the certificate of the last cycle", "what")
        self._links = gauge("link_total", "counters of links and evader source", "link", "what")
        self._events = counter("events", "what happened", "event")
        self._alarms = counter("alarms", "what of the game's guarantee did not hold", "broken")
        self._acted = counter("limits_acted", "cycles in which a limit acted", "limit")
        self._orders = counter("orders", "orders and what became of them", "order", "accepted")
        self.cycles = counter("cycles", "guidance cycles").labels(name)
        self.late = counter("late_cycles", "cycles that began more than one period late").labels(name)
        self.setpoints = counter("setpoints", "setpoints sent").labels(name)
        self.lateness = histogram("lateness_seconds", "how late a cycle began").labels(name)
        self.work = histogram("work_seconds", "how long a cycle took").labels(name)

    def follow(self, outputs: Outputs) -> None:
        """Count what one cycle did."""
        self.cycles.inc()
        if outputs.setpoint is not None:
            self.setpoints.inc()
        for happening in outputs.happenings:
            self._events.labels(self._name, str(happening.event)).inc()
        if outputs.alarm is not None:
            self._alarms.labels(self._name, str(outputs.alarm.violation)).inc()
        if outputs.certificate is not None:
            for limit in outputs.certificate.active_limits:
                self._acted.labels(self._name, limit).inc()

    def show(self, now_s: float, flight: Flight, outputs: Outputs, counters: Mapping[str, Mapping[str, int]]) -> None:
        """Set what is only looked at, once a second.

        Args:
            now_s: The present.
            flight: As it stands.
            outputs: Of the last cycle.
            counters: What each link has counted, by link and by name.
        """
        for state in State:
            self._state.labels(self._name, str(state)).set(state is outputs.state)
        for what, age_s in (
            ("heartbeat", flight.vehicle.age_s(Heartbeat, now_s)),
            ("position", flight.vehicle.age_s(LocalPosition, now_s)),
            ("evader", flight.tracking.silence_s(now_s)),
        ):
            self._ages.labels(self._name, what).set(age_s)
        certificate = outputs.certificate
        for what in _OF_THE_GAME:
            self._game.labels(self._name, what).set(math.nan if certificate is None else getattr(certificate, what))
        for link, counts in counters.items():
            for what, count in counts.items():
                self._links.labels(self._name, link, what).set(count)

    def happened(self, event: str) -> None:
        """Count an event that is not the flight's."""
        self._events.labels(self._name, event).inc()

    def order(self, order: str, *, accepted: bool) -> None:
        """Count an order."""
        self._orders.labels(self._name, order, str(accepted).lower()).inc()


class MetricsServer:
    """Serves a registry at http://127.0.0.1:port/metrics.

    Raises:
        LinkError: If the port is in use.
    """

    def __init__(self, metrics: Metrics, port: int) -> None:
        try:
            self._server, self._thread = start_http_server(port, addr="127.0.0.1", registry=metrics.registry)
        except OSError as error:
            raise LinkError(f"metrics.port = {port}: {error.strerror}; choose another") from error
        self.port = int(self._server.server_port)

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
