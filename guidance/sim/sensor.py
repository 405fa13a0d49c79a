"""The sensor model: reports about the evader, for mathematics and for flights.

Report k is measured at k / rate and arrives after the latency, unless it is lost. Between reports the pursuer assumes a
constant velocity, as a flight's estimate does; the age of the last report is the game's information age. The sensor
starts with the game: earlier reports pass unchanged. Mathematics and flights use equal random numbers.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from guidance.estimation.measurement import TrackSettings
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.game.arrays import FloatArray, Real
from guidance.links.port import EvaderSource
from guidance.messages import EvaderReport, Timesync
from guidance.sim.scenario import Sensor
from guidance.strategies import normal, uniform

PERFECT: Final = Sensor()

FASTEST_HZ: Final = 50.0
"""Rate if none is given: one report per cycle."""

REPORT_TIMEOUT_S: Final = 1.5
"""A flight waits for the evader, as lost, if the last report is older."""

DROPOUT_STREAM: Final = 11
_STREAMS: Final = {0: 12, 1: 13, 3: 14, 4: 15}
"""Streams of the noise of x and y, of position and velocity, by their places in a report."""

_SURE: Final = 2.0
"""An evader counts as faster than declared if it seems so by this many standard deviations."""


class Noise(NamedTuple):
    """Values that can differ between rows: seed (n,); standard deviations and share of lost reports, (n,) or one."""

    seed: NDArray[np.int64]
    position_m: Real
    velocity_m_s: Real
    dropout: Real


class Received(NamedTuple):
    """The pursuer's knowledge, arrays (n, …): the last report that arrived, and those in transit.

    Attributes:
        position_m: (n, 3), of the last report.
        velocity_m_s: Of the last report, (n, 3).
        measured_s: Time of its measurement, (n,).
        measurements: Number of measurements, (n,).
        arrivals: Number of reports that arrived or were lost, (n,).
        on_the_way: Ring of reports by number, (n, d, 6): position and velocity.
    """

    position_m: FloatArray
    velocity_m_s: FloatArray
    measured_s: FloatArray
    measurements: NDArray[np.int64]
    arrivals: NDArray[np.int64]
    on_the_way: FloatArray


def _rate_hz(sensor: Sensor) -> float:
    return FASTEST_HZ if sensor.rate_hz is None else sensor.rate_hz


def first_knowledge(sensor: Sensor, evader_m: FloatArray) -> Received:
    """Return the knowledge at the begin: the evader stands at `evader_m`, (n, 3)."""
    count = len(evader_m)
    none = np.zeros(count, dtype=np.int64)
    in_transit = math.floor(sensor.latency_s * _rate_hz(sensor)) + 2
    ring = np.zeros((count, in_transit, 6))
    return Received(
        evader_m.copy(), np.zeros_like(evader_m), np.zeros(count), none, none.copy(), ring
    )


def next_event_s(sensor: Sensor, knowledge: Received) -> FloatArray:
    """Return the times, (n,), of the next measurement or arrival."""
    period_s = 1.0 / _rate_hz(sensor)
    return np.asarray(
        np.minimum(
            knowledge.measurements * period_s, knowledge.arrivals * period_s + sensor.latency_s
        )
    )


def receive_reports(
    sensor: Sensor,
    noise: Noise,
    knowledge: Received,
    now_s: FloatArray,
    evader_m: FloatArray,
    run_m_s: FloatArray,
) -> None:
    """Make the measurements and receive the reports that are due; call it once in a period at least.

    Args:
        sensor: Rate, latency and dropouts.
        noise: Standard deviations and seeds, (n,).
        knowledge: So far; its arrays are changed.
        now_s: Time of each row, (n,).
        evader_m: Position of the evader, (n, 3), m.
        run_m_s: Velocity of the evader, (n, 3).
    """
    period_s = 1.0 / _rate_hz(sensor)
    near_s = now_s + 1e-9
    ring = knowledge.on_the_way
    rows = np.flatnonzero(knowledge.measurements * period_s <= near_s)
    number = knowledge.measurements[rows]
    report = np.concatenate([evader_m[rows], run_m_s[rows]], axis=1)
    for column, stream in _STREAMS.items():
        spread = noise.position_m if column < 3 else noise.velocity_m_s
        spreads = np.broadcast_to(spread, now_s.shape)[rows]
        report[:, column] += spreads * normal(noise.seed[rows], stream, number)
    ring[rows, number % ring.shape[1]] = report
    knowledge.measurements[rows] += 1
    # Each of these has been measured
    rows = np.flatnonzero(knowledge.arrivals * period_s + sensor.latency_s <= near_s)
    number = knowledge.arrivals[rows]
    dropout = np.broadcast_to(noise.dropout, now_s.shape)[rows]
    arrives = uniform(noise.seed[rows], DROPOUT_STREAM, number) >= dropout
    for begin_s, end_s in sensor.outages_s:
        arrives &= ~((now_s[rows] >= begin_s) & (now_s[rows] < end_s))
    knowledge.arrivals[rows] += 1
    rows = rows[arrives]
    number = number[arrives]
    arrived = ring[rows, number % ring.shape[1]]
    knowledge.position_m[rows] = arrived[:, :3]
    knowledge.velocity_m_s[rows] = arrived[:, 3:]
    knowledge.measured_s[rows] = number * period_s


def extrapolated(
    noise: Noise, knowledge: Received, declared_m_s: Real, now_s: FloatArray
) -> tuple[FloatArray, Real, FloatArray]:
    """Extrapolate the last report to the present: return the evader's position, speed bound, and the report's age.

    Args:
        noise: Standard deviations, (n,).
        knowledge: So far.
        declared_m_s: Speed bound that the evader declares.
        now_s: Time of each row, (n,).
    """
    age_s = np.maximum(now_s - knowledge.measured_s, 0.0)
    position_m = knowledge.position_m + age_s[:, None] * knowledge.velocity_m_s
    seen_m_s = np.sqrt(knowledge.velocity_m_s[:, 0] ** 2 + knowledge.velocity_m_s[:, 1] ** 2)
    bound = np.maximum(declared_m_s, seen_m_s - _SURE * noise.velocity_m_s)
    return position_m, bound, age_s


_SLACK_S = 1e-9
_DEFAULT_SPREAD = TrackSettings(declared_speed_m_s=1.0)
"""Standard deviations of reports without their own."""


class SensedEvader:
    """`EvaderSource` that impairs the reports of another.

    Args:
        source: Of the reports.
        sensor: The impairments.
        seed: Of noise and dropouts.
        clock: Returns the time, s.
    """

    def __init__(
        self, source: EvaderSource, sensor: Sensor, seed: int, clock: Callable[[], float]
    ) -> None:
        self._source = source
        self._sensor = sensor
        self._seed = seed
        self._clock = clock
        self._engaged_s = math.inf
        self._on_the_way = list[EvaderReport]()
        self._last = -1
        self._withheld = 0
        self._lost = 0

    def engage(self, now_s: float) -> None:
        """Start the sensor; later calls have no effect. A perfect one never starts."""
        if self._sensor != PERFECT:
            self._engaged_s = min(self._engaged_s, now_s)

    def receive(self) -> Sequence[EvaderReport]:
        """Return the reports that have arrived by now, in order of arrival."""
        reports = self._source.receive()
        if self._engaged_s == math.inf:
            return reports
        for report in reports:
            self._measure(report)
        arrived = []
        while self._on_the_way and self._on_the_way[0].received_s <= self._clock() + _SLACK_S:
            arrived.append(self._on_the_way.pop(0))
        return arrived

    def counters(self) -> Mapping[str, int]:
        """Return the source's counters, and the numbers of withheld and lost reports."""
        return {**self._source.counters(), "withheld": self._withheld, "lost": self._lost}

    def close(self) -> None:
        """Close the source; may be called twice."""
        self._source.close()

    def _measure(self, report: EvaderReport) -> None:
        arrival_s = report.received_s + self._sensor.latency_s
        rate_hz = self._sensor.rate_hz
        since_s = arrival_s - self._engaged_s
        number = self._last + 1
        if rate_hz is not None:  # the number of the sensor's period
            number = math.floor((report.received_s - self._engaged_s) * rate_hz + _SLACK_S)
        silent = any(begin <= since_s < end for begin, end in self._sensor.outages_s)
        if number == self._last:
            self._withheld += 1
        elif silent or float(uniform(self._seed, DROPOUT_STREAM, number)) < self._sensor.dropout:
            self._lost += 1
        else:
            report = self._inexact(report, number)
            if self._sensor.latency_s != 0.0:
                # The age stays known, as from an evader that answers TIMESYNC.
                answer = report.timesync
                if answer is None and math.isfinite(report.sent_s):
                    answer = Timesync(
                        report.received_s,
                        round(report.sent_s * 1e9),
                        round(report.received_s * 1e9),
                    )
                report = report._replace(received_s=arrival_s, timesync=answer)
            self._on_the_way.append(report)
        self._last = number

    def _inexact(self, report: EvaderReport, number: int) -> EvaderReport:
        position_m = self._sensor.position_noise_m
        velocity_m_s = self._sensor.velocity_noise_m_s
        if position_m == velocity_m_s == 0.0:
            return report
        draws = [normal(self._seed, stream, number) for stream in _STREAMS.values()]
        east_m, north_m, east_m_s, north_m_s = (
            np.repeat([position_m, velocity_m_s], 2) * draws
        ).tolist()
        about = LocalFrame(report.latitude_deg, report.longitude_deg, Amsl(report.altitude_amsl_m))
        latitude_deg, longitude_deg, _ = about.wgs84_from_ned(Ned((north_m, east_m, 0.0)))
        north, east, down = report.velocity_ned_m_s
        return report._replace(
            latitude_deg=latitude_deg,
            longitude_deg=longitude_deg,
            velocity_ned_m_s=Ned((north + north_m_s, east + east_m_s, down)),
            position_sd_m=_grown(report.position_sd_m, _DEFAULT_SPREAD.position_sd_m, position_m),
            velocity_sd_m_s=_grown(
                report.velocity_sd_m_s, _DEFAULT_SPREAD.velocity_sd_m_s, velocity_m_s
            ),
        )


def _grown(stated: float, default: float, noise: float) -> float:
    """Return the standard deviation of a report with the sensor's noise."""
    return math.hypot(stated if math.isfinite(stated) else default, noise)
