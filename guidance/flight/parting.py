"""After an error of our own: the vehicle is handed to the autopilot's hold, and nothing else is said any more."""

import traceback
from collections.abc import Sequence
from typing import Final

from guidance.autopilots import AutopilotProfile, Mode
from guidance.messages import Heartbeat, Message, Request

REPEAT_S: Final = 1.5
"""A request whose effect is not seen is made again after this time, and only in a cycle in which a HEARTBEAT came.

HEARTBEAT is up to a second old: repeated blindly, a request would take the vehicle back from a pilot who just took it.
"""


class Parting:
    """What is still asked after the error `fault`: the hold, until a HEARTBEAT shows any mode but the guided one."""

    def __init__(self, profile: AutopilotProfile, error: Exception, *, flown: bool) -> None:
        self._profile = profile
        self._asking = flown
        self._asked_s = float("-inf")
        self.fault = _described(error)

    def requests(self, now_s: float, messages: Sequence[Message]) -> tuple[Request, ...]:
        """Return what to ask in one cycle."""
        begun = self._asked_s == float("-inf")
        modes = [self._profile.mode_of(one.custom_mode) for one in messages if isinstance(one, Heartbeat)]
        if not begun and any(mode is not Mode.GUIDED for mode in modes):
            self._asking = False
        due = begun or (modes and now_s - self._asked_s >= REPEAT_S)
        if not (self._asking and due):
            return ()
        self._asked_s = now_s
        return (self._profile.set_mode(Mode.HOLD),)


def _described(error: Exception) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    where = f" ({frames[-1].name}, line {frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {error}{where}"
