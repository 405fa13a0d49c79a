"""Which mode a client means: DO_SET_MODE and SET_MODE as PX4 v1.17 reads them."""

from enum import Enum
from typing import Final

from sitl_mock.px4.modes import BY_NUMBER

_CUSTOM, _AUTO, _GUIDED, _STABILIZE, _MANUAL = 1, 4, 8, 16, 64  # MAV_MODE_FLAG
_POSCTL_MAIN, _AUTO_MAIN, _TERMINATION_MAIN = 3, 4, 10
_SLOW_SUB, _MISSION_SUB = 2, 4
_LONE: Final = frozenset({1, 2, 5, 6, 7, 11})
"""Main modes without sub-modes."""


class Unmeant(Enum):
    """Requests that name no mode."""

    NOTHING = "changes nothing"
    """PX4 answers ACCEPTED and stays."""
    REFUSED = "no such sub-mode"


def meant(base_mode: int, main: int, sub: int) -> str | Unmeant:
    """Return the name of the mode that is asked for."""
    if base_mode & _CUSTOM:
        return _custom(main, sub)
    if base_mode & _AUTO:
        return "MISSION"
    if base_mode & _MANUAL:
        if base_mode & _GUIDED:
            return "POSCTL"
        return "STABILIZED" if base_mode & _STABILIZE else "MANUAL"
    return Unmeant.NOTHING


def _custom(main: int, sub: int) -> str | Unmeant:
    if main in _LONE:
        return BY_NUMBER[main << 16].name
    if main == _POSCTL_MAIN:
        return "POSITION_SLOW" if sub == _SLOW_SUB else "POSCTL"
    if main == _AUTO_MAIN:
        mode = BY_NUMBER.get(main << 16 | (sub or _MISSION_SUB) << 24)
        return Unmeant.REFUSED if mode is None else mode.name
    return Unmeant.NOTHING
