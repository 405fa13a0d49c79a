"""Which evader reports the sources refused lately, in words for the operator.

A source counts the reports that it refuses by reason. A reason whose count grows explains why an evader that sends is
not heard: a ROS pose in another frame, say.
"""

from collections import deque
from collections.abc import Mapping
from typing import Final

REFUSED: Final = "refused_"
"""The counters of refused reports begin with this; their reason follows."""

_LATELY_S: Final = 3.0
_MOST_REASONS: Final = 3


class RefusedReports:
    """Compares the counters of an evader's source with those of some seconds ago."""

    def __init__(self) -> None:
        self._counters: deque[tuple[float, Mapping[str, int]]] = deque()

    def note(self, now_s: float, counters: Mapping[str, int]) -> str:
        """Take the present counters, and return the reasons of the latest refusals; empty if there are none."""
        refused = {
            name.removeprefix(REFUSED): count
            for name, count in counters.items()
            if name.startswith(REFUSED)
        }
        self._counters.append((now_s, refused))
        while len(self._counters) > 1 and now_s - self._counters[1][0] >= _LATELY_S:
            self._counters.popleft()
        _, before = self._counters[0]
        grown = {reason: count - before.get(reason, 0) for reason, count in refused.items()}
        reasons = sorted((reason for reason in grown if grown[reason] > 0), key=grown.__getitem__)
        latest = reasons[::-1][:_MOST_REASONS]
        if not latest:
            return ""
        return "its reports are refused: " + ", ".join(
            f"{reason} ({grown[reason]} times lately)" for reason in latest
        )
