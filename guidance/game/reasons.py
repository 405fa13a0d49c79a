"""Who wins, and what an answer is: small integers, so that a batch can carry them."""

from enum import IntEnum


class Winner(IntEnum):
    """Who wins."""

    EVADER = -1
    UNDECIDED = 0
    """Neither: the state lies on the barrier, or has no answer."""
    PURSUER = 1


class Reason(IntEnum):
    """What an answer is: solved, a degenerate state with its finite answer, or (from 10 on) NaN, and why."""

    SOLVED = 0
    CAPTURED = 1
    """The evader is captured now."""
    OVERHEAD = 2
    """The pursuer will be right above the evader whatever the heading: every heading of the evader is as good."""
    ARRIVED = 3
    """The evader is at its target now."""
    ON_BARRIER = 4
    """Both could be at the target at the same instant."""
    NOT_FINITE = 10
    """A position or velocity is NaN or infinite."""
    PURSUER_TOO_SLOW = 11
    """δ ≤ 1: the pursuer is no faster than evader and wind together."""
    OUT_OF_RANGE = 12
    """A parameter of this row is negative, zero where it must not be, or not finite."""
