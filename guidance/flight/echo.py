"""Does the autopilot fly what we sent? POSITION_TARGET_LOCAL_NED shows a second source of setpoints on the vehicle.

It repeats the setpoint in force, a moment late and perhaps cut to the autopilot's own limits. A velocity that is none
of those sent lately was sent by somebody else. Between ours such a setpoint is in force for one cycle only, so the
reports are asked for as often as we send, and strange ones are counted whether or not ours lie between them.
"""

import math
from collections import deque
from collections.abc import Iterable
from typing import Final, NamedTuple

from guidance.frames import Vector
from guidance.messages import Message, PositionTarget, Setpoint

REMEMBERED_S: Final = 1.5
"""Longest time from our sending a setpoint to the autopilot's report of it."""

TOLERANCE_M_S: Final = 0.75
STRANGE_REPORTS: Final = 3
"""So many strange reports within `WINDOW_S` are a second source; one or two are not."""

WINDOW_S: Final = 2.0
APART_S: Final = 0.2
"""Strange reports closer together than this count once: a transient of the autopilot's own shows in several."""

_ROUNDING_S: Final = 1e-6

_LEAST_SHARE: Final = 0.5
"""An autopilot may cut a setpoint to its own speed limits: down to this share of it still counts as ours."""


class Echo:
    """The memory of what was sent lately and of when reports did not fit it."""

    def __init__(self) -> None:
        self._sent: deque[_Sent] = deque(maxlen=256)
        self._strange_s: deque[float] = deque(maxlen=STRANGE_REPORTS)
        self._begun_s = math.inf

    @property
    def foreign(self) -> bool:
        """True while the autopilot reports setpoints that are not ours."""
        return len(self._strange_s) == STRANGE_REPORTS

    @property
    def suspicious(self) -> bool:
        """True from the first strange report on, until it is too long ago to count."""
        return bool(self._strange_s)

    def silent(self) -> None:
        """We send nothing: whatever the autopilot reports now is its own affair."""
        self._sent.clear()
        self._strange_s.clear()
        self._begun_s = math.inf

    def sent(self, now_s: float, setpoint: Setpoint) -> None:
        """Take note of what goes out."""
        self._begun_s = min(self._begun_s, now_s)
        self._sent.append(_Sent(now_s, setpoint.velocity_ned_m_s))

    def hear(self, messages: Iterable[Message], *, guided: bool) -> None:
        """Compare what the autopilot reports; only in the guided mode is it meant to be ours."""
        for message in messages:
            if not isinstance(message, PositionTarget):
                continue
            if not guided:
                self._strange_s.clear()
                continue
            now_s = message.received_s
            while self._strange_s and now_s - self._strange_s[0] > WINDOW_S + _ROUNDING_S:
                self._strange_s.popleft()
            counted = self._strange_s and now_s - self._strange_s[-1] < APART_S - _ROUNDING_S
            if not counted and now_s - self._begun_s > REMEMBERED_S and not self._is_ours(message):
                self._strange_s.append(now_s)

    def _is_ours(self, message: PositionTarget) -> bool:
        reported = message.velocity_ned_m_s
        if not all(map(math.isfinite, reported)):
            return True  # nothing is said of the velocity
        for sent in reversed(self._sent):  # the latest is nearly always the one
            if message.received_s - sent.now_s > REMEMBERED_S:
                return False
            if _distance(reported, sent.velocity_ned_m_s) <= TOLERANCE_M_S:
                return True
        return False


class _Sent(NamedTuple):
    now_s: float
    velocity_ned_m_s: Vector


def _distance(reported: Vector, sent: Vector) -> float:
    """Distance from what is reported to what was sent, or to the nearest shorter one of the same direction."""
    square = sum(part * part for part in sent)
    along = sum(a * b for a, b in zip(reported, sent, strict=True)) / square if square > 0.0 else 1.0
    share = min(1.0, max(_LEAST_SHARE, along))
    return math.dist(reported, [share * part for part in sent])
