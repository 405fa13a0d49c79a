"""Segments of a log, and how a velocity answered in each: rise, overshoot, steady error."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_STEP_LEAST_S = 1.0
_STEADY_S = 2.0
_CHANGE_LEAST_M_S = 0.05

Samples = NDArray[np.float64]


class Segment(NamedTuple):
    """Rows `[first, last)` under one command, or under one that keeps varying."""

    first: int
    last: int
    varying: bool


class Response(NamedTuple):
    """How one axis answered one step; NaN where there is nothing to say (no step, or never reached).

    Attributes:
        rise_s: From 10 to 90 % of the change asked for.
        overshoot_m_s: Furthest beyond the command.
        steady_error_m_s: Mean of the last 2 s less the command.
    """

    rise_s: float
    overshoot_m_s: float
    steady_error_m_s: float


def segments_of(time_s: Samples, command_ned_m_s: Samples) -> list[Segment]:
    """Cut a log where the command changes; changes faster than once a second are one varying segment."""
    edges = np.flatnonzero(np.any(np.diff(command_ned_m_s, axis=0) != 0.0, axis=1)) + 1
    firsts = [0, *edges.tolist()]
    lasts = [*edges.tolist(), len(time_s)]
    found: list[Segment] = []
    for first, last in zip(firsts, lasts, strict=True):
        until_s = time_s[last] if last < len(time_s) else time_s[-1]
        varying = bool(until_s - time_s[first] < _STEP_LEAST_S)
        if varying and found and found[-1].varying:
            found[-1] = found[-1]._replace(last=last)
        else:
            found.append(Segment(first, last, varying))
    return found


def response_of(time_s: Samples, velocity_m_s: Samples, start_m_s: float, command_m_s: float) -> Response:
    """Measure the answer of one axis to one step.

    Args:
        time_s: Times of the segment, shape (rows,).
        velocity_m_s: Velocity of the axis, shape (rows,).
        start_m_s: Velocity before the step.
        command_m_s: Velocity asked for.
    """
    last = time_s >= time_s[-1] - _STEADY_S
    steady_error = float(velocity_m_s[last].mean()) - command_m_s
    change = command_m_s - start_m_s
    if abs(change) < _CHANGE_LEAST_M_S:
        return Response(math.nan, math.nan, steady_error)
    progress = (velocity_m_s - start_m_s) / change
    beyond = max(0.0, float(progress.max()) - 1.0) * abs(change)
    return Response(_crossing(time_s, progress, 0.9) - _crossing(time_s, progress, 0.1), beyond, steady_error)


def _crossing(time_s: Samples, progress: Samples, level: float) -> float:
    """First time a level is reached, between samples; NaN if never."""
    reached = np.flatnonzero(progress >= level)
    if not reached.size:
        return math.nan
    row = int(reached[0])
    if row == 0:
        return float(time_s[0])
    part = (level - progress[row - 1]) / (progress[row] - progress[row - 1])
    return float(time_s[row - 1] + part * (time_s[row] - time_s[row - 1]))
