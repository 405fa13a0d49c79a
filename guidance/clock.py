"""Where time comes from. Nothing else in the package reads a clock."""

import time
from typing import Final, NamedTuple, Protocol


class Clock(Protocol):
    """A monotonic time in seconds, and a way to wait for a moment of it."""

    def now_s(self) -> float:
        """Return the present, seconds."""
        ...

    def sleep_until(self, moment_s: float) -> None:
        """Wait until `moment_s`; return at once if it has passed."""
        ...


class MonotonicClock:
    """Real time, from zero at the start of the process's use of it."""

    def __init__(self) -> None:
        self._start_s = time.monotonic()

    def now_s(self) -> float:
        """Seconds since this clock was made."""
        return time.monotonic() - self._start_s

    def sleep_until(self, moment_s: float) -> None:
        """Sleep in the operating system."""
        remaining_s = moment_s - self.now_s()
        if remaining_s > 0.0:
            time.sleep(remaining_s)


class VirtualClock:
    """Time that moves only when it is told to. Waiting moves it."""

    def __init__(self, now_s: float = 0.0) -> None:
        self._now_s = now_s

    def now_s(self) -> float:
        """Return the time it was last moved to."""
        return self._now_s

    def sleep_until(self, moment_s: float) -> None:
        """Move to `moment_s`, never backwards."""
        self._now_s = max(self._now_s, moment_s)


class Timing(NamedTuple):
    """How the loop kept time: how much later than due a cycle began, and how long the one before worked."""

    late_s: float
    worked_s: float


IN_TIME: Final = Timing(0.0, 0.0)
