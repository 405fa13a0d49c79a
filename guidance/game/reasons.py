"""Who wins, and why an answer is what it is: small integers, so that a batch can carry them."""

from enum import IntEnum


class Winner(IntEnum):
    """Who wins; UNDECIDED is the barrier itself, or no answer."""

    EVADER = -1
    UNDECIDED = 0
    PURSUER = 1


class Reason(IntEnum):
    """What an answer is: solved, one of the degenerate states with its finite answer, or NaN and why."""

    SOLVED = 0
    CAPTURED = 1
    OVERHEAD = 2
    ARRIVED = 3
    ON_BARRIER = 4
    NOT_FINITE = 10
    PURSUER_TOO_SLOW = 11
    OUT_OF_RANGE = 12
