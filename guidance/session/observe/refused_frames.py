"""Which frames in the vehicle's name its link refused, in words for the operator.

The link counts and drops them, so they change nothing. That somebody sends them is news: another program has the
vehicle's system id, or an attacker tries to speak as the vehicle.
"""

import math
from collections.abc import Mapping
from typing import Final

TOLD_EVERY_S: Final = 10.0
"""Least time between two notes."""

_REASONS: Final[Mapping[str, str]] = {
    "impostors": "from another address",
    "unsigned": "without a signature",
    "refused": "with a wrong signature or an old one",
}
"""The link's counters of such frames, and what is wrong with them."""


class RefusedFrames:
    """Compares the link's counters with those of the last note."""

    def __init__(self) -> None:
        self._told: Mapping[str, int] = {}
        self._told_s = -math.inf

    def note(self, now_s: float, counters: Mapping[str, int]) -> str:
        """Return what was refused since the last note; empty if nothing was, or if that note is recent."""
        counted = {name: counters.get(name, 0) for name in _REASONS}
        grown = {name: count - self._told.get(name, 0) for name, count in counted.items()}
        kinds = [f"{grown[name]} {words}" for name, words in _REASONS.items() if grown[name] > 0]
        if not kinds or now_s - self._told_s < TOLD_EVERY_S:
            return ""
        self._told = counted
        self._told_s = now_s
        return "frames in the vehicle's name were refused: " + ", ".join(kinds)
