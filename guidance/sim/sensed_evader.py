"""An evader source heard through a scenario's sensor: too seldom, too late, inexact, with gaps, in all worlds alike.

It begins with the game, as in mathematics: until then the evader is heard as it is. What the flight is given is what
the record keeps, so that a replay hears the same. The random numbers are those of `guidance.sim.sensor`.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence

from guidance.estimation import TrackSettings
from guidance.frames import Amsl, LocalFrame
from guidance.links.port import EvaderSource
from guidance.messages import EvaderReport, Timesync
from guidance.sim.scenario import Sensor
from guidance.sim.sensor import DROPOUT_STREAM, PERFECT, POSITION_STREAM, VELOCITY_STREAM
from guidance.strategies import normal, uniform

_SLACK_S = 1e-9
_UNSAID = TrackSettings(declared_speed_m_s=1.0)
"""Spreads that reports are taken to have which do not say theirs."""


class SensedEvader:
    """`EvaderSource` around another.

    Args:
        source: Where the reports come from.
        sensor: What becomes of them.
        seed: Of its noise and its dropouts.
        clock: Gives the present, s.
    """

    def __init__(self, source: EvaderSource, sensor: Sensor, seed: int, clock: Callable[[], float]) -> None:
        self._source = source
        self._sensor = sensor
        self._seed = seed
        self._clock = clock
        self._engaged_s = math.inf
        self._last = -1
        self._on_the_way: deque[EvaderReport] = deque()
        self._withheld = self._lost = 0

    def engage(self, now_s: float) -> None:
        """The game begins; asked again, nothing changes."""
        self._engaged_s = min(self._engaged_s, now_s)

    def receive(self) -> Sequence[EvaderReport]:
        """Return the reports that have arrived by now, in order of arrival."""
        reports = self._source.receive()
        if self._sensor == PERFECT or self._engaged_s == math.inf:
            return reports
        for report in reports:
            self._measure(report)
        arrived = []
        while self._on_the_way and self._on_the_way[0].received_s <= self._clock() + _SLACK_S:
            arrived.append(self._on_the_way.popleft())
        return arrived

    def counters(self) -> Mapping[str, int]:
        """As the source's, and how many reports the sensor withheld and lost."""
        return {**self._source.counters(), "withheld": self._withheld, "lost": self._lost}

    def close(self) -> None:
        """Close the source; may be called twice."""
        self._source.close()

    def _measure(self, report: EvaderReport) -> None:
        number = self._number(report)
        if number == self._last:
            self._withheld += 1
            return
        self._last = number
        arrival_s = report.received_s + self._sensor.latency_s
        since_s = arrival_s - self._engaged_s
        silent = any(begin <= since_s < end for begin, end in self._sensor.outages_s)
        if silent or float(uniform(self._seed, DROPOUT_STREAM, number)) < self._sensor.dropout:
            self._lost += 1
            return
        self._on_the_way.append(self._late(self._inexact(report, number), arrival_s))

    def _number(self, report: EvaderReport) -> int:
        """Count reports by their place in the sensor's rhythm; without one, as they come."""
        if self._sensor.rate_hz is None:
            return self._last + 1
        return math.floor((report.received_s - self._engaged_s) * self._sensor.rate_hz + _SLACK_S)

    def _late(self, report: EvaderReport, arrival_s: float) -> EvaderReport:
        """Stamp the arrival; how old it is then is known, as from an evader that answers TIMESYNC."""
        if self._sensor.latency_s == 0.0:
            return report
        answer = report.timesync
        if answer is None and math.isfinite(report.sent_s):
            answer = Timesync(report.received_s, round(report.sent_s * 1e9), round(report.received_s * 1e9))
        return report._replace(received_s=arrival_s, timesync=answer)

    def _inexact(self, report: EvaderReport, number: int) -> EvaderReport:
        sensor = self._sensor
        if sensor.position_noise_m == sensor.velocity_noise_m_s == 0.0:
            return report

        def draw(stream: int) -> float:
            return float(normal(self._seed, stream, number))

        east_m, north_m = (sensor.position_noise_m * draw(POSITION_STREAM + axis) for axis in (0, 1))
        east_m_s, north_m_s = (sensor.velocity_noise_m_s * draw(VELOCITY_STREAM + axis) for axis in (0, 1))
        about = LocalFrame(report.latitude_deg, report.longitude_deg, Amsl(report.altitude_amsl_m))
        latitude_deg, longitude_deg, _ = about.wgs84_from_ned((north_m, east_m, 0.0))
        north, east, down = report.velocity_ned_m_s
        return report._replace(
            latitude_deg=latitude_deg,
            longitude_deg=longitude_deg,
            velocity_ned_m_s=(north + north_m_s, east + east_m_s, down),
            position_sd_m=_grown(report.position_sd_m, _UNSAID.position_sd_m, sensor.position_noise_m),
            velocity_sd_m_s=_grown(report.velocity_sd_m_s, _UNSAID.velocity_sd_m_s, sensor.velocity_noise_m_s),
        )


def _grown(said: float, unsaid: float, noise: float) -> float:
    """The spread with the sensor's, which says how inexact it is."""
    return math.hypot(said if math.isfinite(said) else unsaid, noise)
