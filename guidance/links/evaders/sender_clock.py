"""Senders' clocks that wrap: milliseconds since boot at 2^32 (49.7 days), seconds of the hour at 3600."""

import math
from dataclasses import dataclass


@dataclass(slots=True)
class SenderClock:
    """Unwraps readings of a clock with a period, in its own unit.

    Each reading is taken as the nearest one to the last: a late report from before the wrap stays before it. So gaps
    must be shorter than half a period. A sender that restarts is seen as a step back, which the estimator judges.
    """

    period: float
    last: float = math.nan

    def unwrap(self, reading: float) -> float:
        """The reading plus as many periods as have gone by."""
        if math.isnan(self.last):
            self.last = reading
            return reading
        half = self.period / 2.0
        self.last += (reading - self.last + half) % self.period - half
        return self.last


def boot_ms_clock() -> SenderClock:
    """For `time_boot_ms`."""
    return SenderClock(period=2.0**32)
