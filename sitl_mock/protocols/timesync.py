"""TIMESYNC and PING: answers to the peers' questions, and what the answers to the vehicle's own tell.

Sources: https://mavlink.io/en/services/timesync.html, https://mavlink.io/en/services/ping.html
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sitl_mock.protocols.reply import Reply, source_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from sitl_mock.mavlink import Message

NS: int = 1_000_000_000


class TimeProtocol:
    """Time on one link.

    Args:
        clock: Turns the caller's time into the vehicle's clock, seconds since its boot, which its telemetry counts by.

    Attributes:
        offset_s: Peer's clock minus own, from its last answer; None before.
        round_trip_s: Round trip of that answer.
    """

    def __init__(self, clock: Callable[[float], float] = lambda now_s: now_s) -> None:
        self._clock = clock
        self._asked_ns: int | None = None
        self.offset_s: float | None = None
        self.round_trip_s: float | None = None

    def ask(self, now_s: float) -> Reply:
        """Return the vehicle's own TIMESYNC question."""
        self._asked_ns = int(self._clock(now_s) * NS)
        return ("TIMESYNC", 0, self._asked_ns)

    def handle(self, now_s: float, message: Message) -> list[Reply]:
        """Take TIMESYNC or PING."""
        kind = message.get_type()
        if kind == "TIMESYNC":
            return self._timesync(now_s, message)
        if kind == "PING" and message.target_system == 0 and message.target_component == 0:
            return [("PING", message.time_usec, message.seq, *source_of(message))]
        return []

    def _timesync(self, now_s: float, message: Message) -> list[Reply]:
        if message.tc1 == 0:
            return [("TIMESYNC", int(self._clock(now_s) * NS), message.ts1)]
        if message.ts1 == self._asked_ns:  # the answer to our last question, not to another vehicle's
            self._asked_ns = None
            now_s = self._clock(now_s)
            self.round_trip_s = now_s - message.ts1 / NS
            self.offset_s = message.tc1 / NS - (now_s + message.ts1 / NS) / 2.0
        return []
