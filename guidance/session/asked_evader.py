"""An evader that has to be asked: autopilots of the ArduPilot family send nothing but HEARTBEAT until they are."""

from collections.abc import Mapping, Sequence
from typing import Final

from guidance.autopilots import MAV_CMD_SET_MESSAGE_INTERVAL
from guidance.links.arrivals import Clock
from guidance.links.port import EvaderSource, VehicleLink
from guidance.messages import Command, EvaderReport

ASK_AGAIN_S: Final = 3.0
"""Asked again after this long without a report: an evader may have been switched off and on."""

HEARTBEAT_S: Final = 1.0


class AskedEvader:
    """`EvaderSource` around another, which asks the evader for its reports by a link of its own to it."""

    def __init__(
        self, source: EvaderSource, link: VehicleLink, clock: Clock, *, message_id: int, rate_hz: float
    ) -> None:
        self._source = source
        self._link = link
        self._clock = clock
        interval_us = 1e6 / rate_hz
        self._request = Command(MAV_CMD_SET_MESSAGE_INTERVAL, (float(message_id), interval_us, 0.0, 0.0, 0.0, 0.0, 0.0))
        self._asked_s = self._beat_s = float("-inf")

    def receive(self) -> Sequence[EvaderReport]:
        """As the source's; asks meanwhile."""
        reports = self._source.receive()
        self._link.receive()
        now_s = self._clock()
        if now_s - self._beat_s >= HEARTBEAT_S:
            self._beat_s = now_s
            self._link.send_heartbeat()
        if reports:
            self._asked_s = now_s
        elif now_s - self._asked_s >= ASK_AGAIN_S:
            self._asked_s = now_s
            self._link.request(self._request)
        return reports

    def counters(self) -> Mapping[str, int]:
        """As the source's, and how often was asked."""
        return {**self._source.counters(), "requests_sent": self._link.counters().get("requests_sent", 0)}

    def close(self) -> None:
        """Close both; may be called twice."""
        self._source.close()
        self._link.close()
