"""Comparison of velocity responses: segments of a log, and the response of the real vehicle and the mock in each."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sitl_mock.calibrate.step_log import FlavourName, StepLog

_STEP_LEAST_S = 1.0
_STEADY_S = 2.0
_CHANGE_LEAST_M_S = 0.05

Samples = NDArray[np.float64]


class Segment(NamedTuple):
    """Rows `[first, last)` with one command, or with a continuously varying one."""

    first: int
    last: int
    varying: bool


class Response(NamedTuple):
    """Step response of one axis; NaN if not measurable (no step, or level never reached).

    Attributes:
        rise_s: From 10 to 90 % of the commanded change.
        overshoot_m_s: Greatest excess over the command.
        steady_error_m_s: Mean of the last 2 s minus the command.
    """

    rise_s: float
    overshoot_m_s: float
    steady_error_m_s: float


def segments_of(time_s: Samples, command_ned_m_s: Samples) -> list[Segment]:
    """Divide a log where the command changes; changes faster than once a second form one varying segment."""
    edges = np.flatnonzero(np.any(np.diff(command_ned_m_s, axis=0) != 0.0, axis=1)) + 1
    firsts = [0, *edges.tolist()]
    lasts = [*edges.tolist(), len(time_s)]
    segments: list[Segment] = []
    for first, last in zip(firsts, lasts, strict=True):
        until_s = time_s[last] if last < len(time_s) else time_s[-1]
        varying = bool(until_s - time_s[first] < _STEP_LEAST_S)
        if varying and segments and segments[-1].varying:
            segments[-1] = segments[-1]._replace(last=last)
        else:
            segments.append(Segment(first, last, varying))
    return segments


def response_of(
    time_s: Samples, velocity_m_s: Samples, start_m_s: float, command_m_s: float
) -> Response:
    """Measure the step response of one axis.

    Args:
        time_s: Times of the segment, shape (rows,).
        velocity_m_s: Velocity of the axis, shape (rows,).
        start_m_s: Velocity before the step.
        command_m_s: Commanded velocity.
    """
    last = time_s >= time_s[-1] - _STEADY_S
    steady_error = float(velocity_m_s[last].mean()) - command_m_s
    change = command_m_s - start_m_s
    if abs(change) < _CHANGE_LEAST_M_S:
        return Response(math.nan, math.nan, steady_error)
    progress = (velocity_m_s - start_m_s) / change
    beyond = max(0.0, float(progress.max()) - 1.0) * abs(change)
    return Response(
        _crossing(time_s, progress, 0.9) - _crossing(time_s, progress, 0.1), beyond, steady_error
    )


def _crossing(time_s: Samples, progress: Samples, level: float) -> float:
    """Return the first time at which a level is reached, interpolated; NaN if never."""
    reached = np.flatnonzero(progress >= level)
    if not reached.size:
        return math.nan
    row = int(reached[0])
    if row == 0:
        return float(time_s[0])
    part = (level - progress[row - 1]) / (progress[row] - progress[row - 1])
    return float(time_s[row - 1] + part * (time_s[row] - time_s[row - 1]))


RMS_LIMIT_M_S = 0.15
"""Limit of the RMS velocity difference between mock and real vehicle, per axis over the whole file.

It has room for the estimator noise of a log: PX4 with and without the noise of its simulator differ by up to 0.14 m/s.
"""


@dataclass(frozen=True)
class AxisComparison:
    """One axis of one segment: the real vehicle against the mock."""

    axis: str
    command_m_s: float
    real: Response
    mock: Response
    rms_m_s: float


@dataclass(frozen=True)
class SegmentComparison:
    """One segment; `axes` are north, east, down."""

    start_s: float
    end_s: float
    varying: bool
    axes: tuple[AxisComparison, AxisComparison, AxisComparison]


@dataclass(frozen=True)
class Comparison:
    """A whole file."""

    flavour: FlavourName
    guessed_by: str
    segments: tuple[SegmentComparison, ...]
    rms_ned_m_s: tuple[float, float, float]
    mock_velocity_ned_m_s: Samples

    @property
    def passed(self) -> bool:
        """True if all axes are within `RMS_LIMIT_M_S`."""
        return max(self.rms_ned_m_s) <= RMS_LIMIT_M_S


def compare_log(
    log: StepLog, flavour: FlavourName, mock_velocity_ned_m_s: Samples, guessed_by: str = ""
) -> Comparison:
    """Measure a log and the mock's answers to its commands, segment by segment.

    Args:
        log: Commands and velocities of the real vehicle.
        flavour: Whose mock answered.
        mock_velocity_ned_m_s: The mock's answers to the same commands, (rows, 3).
        guessed_by: Evidence for the flavour; empty if it was given.
    """
    mock = mock_velocity_ned_m_s
    segments = []
    for segment in segments_of(log.time_s, log.command_ned_m_s):
        n, e, d = (_axis(log, mock, segment, axis) for axis in range(3))
        begin_s = float(log.time_s[segment.first])
        end_s = float(log.time_s[segment.last - 1])
        segments.append(SegmentComparison(begin_s, end_s, segment.varying, (n, e, d)))
    rms = np.sqrt(np.mean((mock - log.velocity_ned_m_s) ** 2, axis=0)).tolist()
    return Comparison(flavour, guessed_by, tuple(segments), (rms[0], rms[1], rms[2]), mock)


def _axis(log: StepLog, mock: Samples, segment: Segment, axis: int) -> AxisComparison:
    rows = slice(segment.first, segment.last)
    time_s = log.time_s[rows]
    real = log.velocity_ned_m_s[rows, axis]
    ours = mock[rows, axis]
    command = float(log.command_ned_m_s[segment.first, axis])
    rms = float(np.sqrt(np.mean((ours - real) ** 2)))
    name = "NED"[axis]
    if segment.varying:
        nothing = Response(math.nan, math.nan, math.nan)
        return AxisComparison(name, math.nan, nothing, nothing, rms)
    before = max(segment.first - 1, 0)
    stepped = command != (log.command_ned_m_s[before, axis] if segment.first else 0.0)
    if not stepped:
        # Without a commanded change, only the steady error is meaningful.
        return AxisComparison(
            name,
            command,
            response_of(time_s, real, command, command),
            response_of(time_s, ours, command, command),
            rms,
        )
    return AxisComparison(
        name,
        command,
        response_of(time_s, real, float(log.velocity_ned_m_s[before, axis]), command),
        response_of(time_s, ours, float(mock[before, axis]), command),
        rms,
    )
