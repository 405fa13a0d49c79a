"""Frames and reports that a vehicle's link and the evaders' sources refused, in words for the operator.

A link counts and drops frames in the vehicle's name that are not the vehicle's, so they change nothing. They are
reported, because another program has the vehicle's system id, or an attacker tries to speak as the vehicle.

A source counts the reports that it refuses by reason. A reason whose count grows explains why an evader that sends is
not heard: a ROS pose in another frame, say.
"""

import math
from collections import deque
from collections.abc import Mapping
from typing import Final

LOG_EVERY_S: Final = 10.0
"""Least time between two notes."""

_REASONS: Final[Mapping[str, str]] = {
    "impostors": "from another address",
    "unsigned": "without a signature",
    "refused": "with a wrong signature or an old one",
}
"""The link's counters of such frames, and the fault of the frames."""

REFUSED: Final = "refused_"
"""The counters of refused reports begin with this; their reason follows."""

_LATELY_S: Final = 3.0
_MOST_REASONS: Final = 3


class RefusedFrames:
    """Compares the link's counters with those of the last note."""

    def __init__(self) -> None:
        self._logged: Mapping[str, int] = {}
        self._logged_s = -math.inf

    def note(self, now_s: float, counters: Mapping[str, int]) -> str:
        """Return the refusals since the last note; empty without any, or if that note is recent."""
        counted = {name: counters.get(name, 0) for name in _REASONS}
        grown = {name: count - self._logged.get(name, 0) for name, count in counted.items()}
        kinds = [f"{grown[name]} {words}" for name, words in _REASONS.items() if grown[name] > 0]
        if not kinds or now_s - self._logged_s < LOG_EVERY_S:
            return ""
        self._logged = counted
        self._logged_s = now_s
        return "frames in the vehicle's name were refused: " + ", ".join(kinds)


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
