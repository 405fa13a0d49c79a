"""The clocks. No other module reads the time."""

import time
from typing import Final, NamedTuple, Protocol


class Clock(Protocol):
    """A monotonic clock in seconds."""

    def now_s(self) -> float:
        """Return the time in seconds."""

    def sleep_until(self, moment_s: float) -> None:
        """Wait until `moment_s`; return immediately if it has passed."""


class MonotonicClock:
    """Real time, starting at zero when the clock is created."""

    def __init__(self) -> None:
        self._start_s = time.monotonic()

    def now_s(self) -> float:
        """Seconds since this clock was created."""
        return time.monotonic() - self._start_s

    def sleep_until(self, moment_s: float) -> None:
        """Sleep in the operating system."""
        remaining_s = moment_s - self.now_s()
        if remaining_s > 0.0:
            time.sleep(remaining_s)


class VirtualClock:
    """A clock that advances only when something waits for it."""

    def __init__(self, now_s: float = 0.0) -> None:
        self._now_s = now_s

    def now_s(self) -> float:
        """Return the virtual time."""
        return self._now_s

    def sleep_until(self, moment_s: float) -> None:
        """Advance to `moment_s`, never backwards."""
        self._now_s = max(self._now_s, moment_s)


class Timing(NamedTuple):
    """Timing of a cycle: its delay, and the working time of the previous cycle."""

    late_s: float
    worked_s: float


IN_TIME: Final = Timing(0.0, 0.0)
