"""Does the autopilot fly what we sent? POSITION_TARGET_LOCAL_NED shows a second source of setpoints on the vehicle.

It repeats the setpoint in force, a moment late and perhaps cut to the autopilot's own limits. A velocity that is none
of those sent lately, several times in a row, was sent by somebody else.
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
IN_A_ROW: Final = 3

_LEAST_SHARE: Final = 0.5
"""An autopilot may cut a setpoint to its own speed limits: down to this share of it still counts as ours."""


class Echo:
    """The memory of what was sent lately and of how many reports in a row did not fit it."""

    def __init__(self) -> None:
        self._sent: deque[_Sent] = deque(maxlen=256)
        self._strange = 0
        self._begun_s = math.inf

    @property
    def foreign(self) -> bool:
        """True while the autopilot reports setpoints that are not ours."""
        return self._strange >= IN_A_ROW

    def silent(self) -> None:
        """We send nothing: whatever the autopilot reports now is its own affair."""
        self._sent.clear()
        self._strange, self._begun_s = 0, math.inf

    def sent(self, now_s: float, setpoint: Setpoint) -> None:
        """Take note of what goes out."""
        self._begun_s = min(self._begun_s, now_s)
        self._sent.append(_Sent(now_s, setpoint.velocity_ned_m_s))

    def hear(self, messages: Iterable[Message], *, guided: bool) -> None:
        """Compare what the autopilot reports; only in the guided mode is it meant to be ours."""
        for message in messages:
            if not isinstance(message, PositionTarget):
                continue
            settled = guided and message.received_s - self._begun_s > REMEMBERED_S
            strange = settled and not self._is_ours(message)
            self._strange = self._strange + 1 if strange else 0

    def _is_ours(self, message: PositionTarget) -> bool:
        reported = message.velocity_ned_m_s
        if not all(map(math.isfinite, reported)):
            return True  # nothing is said of the velocity
        recent = (sent for sent in self._sent if message.received_s - sent.now_s <= REMEMBERED_S)
        return any(_distance(reported, sent.velocity_ned_m_s) <= TOLERANCE_M_S for sent in recent)


class _Sent(NamedTuple):
    now_s: float
    velocity_ned_m_s: Vector


def _distance(reported: Vector, sent: Vector) -> float:
    """Distance from what is reported to what was sent, or to the nearest shorter one of the same direction."""
    square = sum(part * part for part in sent)
    along = sum(a * b for a, b in zip(reported, sent, strict=True)) / square if square > 0.0 else 1.0
    share = min(1.0, max(_LEAST_SHARE, along))
    return math.dist(reported, [share * part for part in sent])
