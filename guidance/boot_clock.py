"""The delay of a vehicle's telemetry, from the times that the vehicle stamps.

A message that the vehicle stamped at t and that arrived at r is r - t - offset old, where the offset is our clock minus
the vehicle's. TIMESYNC bounds the offset: the vehicle read its own clock after we asked and before the answer arrived.
The larger delay is assumed, which counts the whole round trip as the way here. A constant delay is therefore seen as
well as a growing one. The round trip is also what a braking vehicle feels: late positions and late setpoints add up.
"""

import math
from typing import Final, NamedTuple

from guidance.messages import Timesync

LATE_TELEMETRY_S: Final = 0.5
"""Telemetry with a larger delay keeps the vehicle on the ground and ends a game."""

LONGEST_DELAY_S: Final = 60.0
"""A computed delay is bounded by this. No link stores telemetry that long: a larger one is a wrong or hostile clock."""

CONFIRMED_S: Final = 0.5
"""A delay counts as late after this time: two TIMESYNC exchanges. A simulator that paused is not late."""

UNKNOWN_S: Final = 1.0
"""Telemetry whose delay has become unknown counts as late after this time: four TIMESYNC exchanges."""

OFFSET_DRIFT: Final = 2e-4
"""Two quartz clocks drift apart by less than this share of the time."""

_ROUNDING_S: Final = 0.1
"""Stamps are whole milliseconds, and some are rounded up or taken late. More than this contradicts the offset."""

_PACED_S: Final = 1.0
"""Least time between two answers whose times are compared."""

_REAL_TIME: Final = 0.2
"""A clock whose pace differs from ours by a larger share is no real-time clock. Round trips change it by less."""

_WRAP_S: Final = 2.0**32 / 1e3
"""time_boot_ms has 32 bits; TIMESYNC has 64."""


class BootClock(NamedTuple):
    """Estimate of the vehicle's clock, and the delay of its telemetry.

    Attributes:
        offset_s: Least difference of our clock and the vehicle's; -inf before the first answer to TIMESYNC.
        answered_s: When that was computed.
        delay_s: Largest possible age of the last position when it arrived, at most `LONGEST_DELAY_S`; NaN while the
            offset is unknown.
        late_since_s: Since when the delay exceeds `LATE_TELEMETRY_S`; inf if it does not.
        former_offset_s: The offset that a message from the future discarded since the last answer; NaN if none did.
        unknown_since_s: Since when that offset has no successor; inf if there is one, or never was one.
        paced: An answer a while ago, as (our time, the vehicle's); None before the first one.
        pace: The vehicle's time that passes in a second of ours, by the last answers.
    """

    offset_s: float = -math.inf
    answered_s: float = 0.0
    delay_s: float = math.nan
    late_since_s: float = math.inf
    former_offset_s: float = math.nan
    unknown_since_s: float = math.inf
    paced: tuple[float, float] | None = None
    pace: float = 1.0

    def is_late(self, now_s: float) -> bool:
        """True if the delay has exceeded `LATE_TELEMETRY_S` for `CONFIRMED_S`, or has been unknown for `UNKNOWN_S`."""
        is_unknown = now_s - self.unknown_since_s >= UNKNOWN_S
        return is_unknown or now_s - self.late_since_s >= CONFIRMED_S

    @property
    def unknown_words(self) -> str:
        """Why the delay is unknown."""
        if abs(self.pace - 1.0) > _REAL_TIME:
            return f"unknown: the vehicle's clock runs {self.pace:.1f} times as fast as ours"
        return "unknown: TIMESYNC is not answered"


def _held_s(clock: BootClock, now_s: float) -> float:
    """Return the least offset that the last answers allow by now."""
    return clock.offset_s - OFFSET_DRIFT * max(0.0, now_s - clock.answered_s)


def with_answer(clock: BootClock, answer: Timesync) -> BootClock:
    """Add an answer to our TIMESYNC. An answer that contradicts the offset replaces it: the clock was set."""
    asked_s = answer.local_ns * 1e-9
    vehicle_s = answer.remote_ns * 1e-9
    least_s = asked_s - vehicle_s
    most_s = answer.received_s - vehicle_s
    held_s = _held_s(clock, answer.received_s)
    if held_s <= most_s:
        least_s = max(least_s, held_s)
    # The times of two answers show the pace.
    if clock.paced is None:
        clock = clock._replace(paced=(answer.received_s, vehicle_s))
    else:
        before_s, vehicle_before_s = clock.paced
        passed_s = answer.received_s - before_s
        if passed_s >= _PACED_S:
            pace = (vehicle_s - vehicle_before_s) / passed_s
            clock = clock._replace(paced=(answer.received_s, vehicle_s), pace=pace)
    return clock._replace(
        offset_s=least_s,
        answered_s=answer.received_s,
        former_offset_s=math.nan,
        unknown_since_s=math.inf,
    )


def fits_former(clock: BootClock, received_s: float, time_boot_s: float) -> bool:
    """True if a message is in time by the offset that one from the future discarded: its sender's clock was not set."""
    late_s = math.remainder(received_s - time_boot_s - clock.former_offset_s, _WRAP_S)
    return -_ROUNDING_S <= late_s <= LATE_TELEMETRY_S


def elapsed_s(earlier_s: float, later_s: float) -> float:
    """Return the time between two stamps of one vehicle. Their 32 bits of milliseconds wrap after 49.7 days."""
    return math.remainder(later_s - earlier_s, _WRAP_S)


def with_position(clock: BootClock, received_s: float, time_boot_s: float) -> BootClock:
    """Add a message of the vehicle, newer than the last one. One from the future shows that the clock was set."""
    if clock.offset_s == -math.inf:
        return clock
    late_s = math.remainder(received_s - time_boot_s - _held_s(clock, received_s), _WRAP_S)
    is_from_the_future = late_s < -_ROUNDING_S
    if is_from_the_future:
        return BootClock(
            former_offset_s=clock.offset_s,
            unknown_since_s=received_s,
            paced=clock.paced,
            pace=clock.pace,
        )
    since_s = math.inf
    if late_s > LATE_TELEMETRY_S:
        since_s = min(clock.late_since_s, received_s)
    delay_s = min(max(0.0, late_s), LONGEST_DELAY_S)
    return clock._replace(delay_s=delay_s, late_since_s=since_s)
