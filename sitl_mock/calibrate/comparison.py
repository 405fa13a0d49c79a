"""The answers of the mock beside those of the real vehicle."""

import math
from dataclasses import dataclass

import numpy as np

from sitl_mock.calibrate.flight import Flavour
from sitl_mock.calibrate.measures import Response, Samples, Segment, response_of, segments_of
from sitl_mock.calibrate.step_log import StepLog

RMS_LIMIT_M_S = 0.15
"""A mock whose velocity differs by more than this from the real vehicle's, per axis and over the file, is not it."""


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

    flavour: Flavour
    guessed_by: str
    segments: tuple[SegmentComparison, ...]
    rms_ned_m_s: tuple[float, float, float]
    mock_velocity_ned_m_s: Samples

    @property
    def passed(self) -> bool:
        """Whether every axis is within `RMS_LIMIT_M_S`."""
        return max(self.rms_ned_m_s) <= RMS_LIMIT_M_S


def compare(log: StepLog, flavour: Flavour, mock_velocity_ned_m_s: Samples, guessed_by: str = "") -> Comparison:
    """Measure a log and the mock's answers to its commands (shape (rows, 3), m/s), segment by segment."""
    mock = mock_velocity_ned_m_s
    segments = tuple(_segment(log, mock, segment) for segment in segments_of(log.time_s, log.command_ned_m_s))
    rms = np.sqrt(np.mean((mock - log.velocity_ned_m_s) ** 2, axis=0)).tolist()
    return Comparison(flavour, guessed_by, segments, (rms[0], rms[1], rms[2]), mock)


def _segment(log: StepLog, mock: Samples, segment: Segment) -> SegmentComparison:
    rows = slice(segment.first, segment.last)
    n, e, d = (_axis(log, mock, segment, axis) for axis in range(3))
    time_s = log.time_s[rows]
    return SegmentComparison(float(time_s[0]), float(time_s[-1]), segment.varying, (n, e, d))


def _axis(log: StepLog, mock: Samples, segment: Segment, axis: int) -> AxisComparison:
    rows = slice(segment.first, segment.last)
    time_s, real, ours = log.time_s[rows], log.velocity_ned_m_s[rows, axis], mock[rows, axis]
    command = float(log.command_ned_m_s[segment.first, axis])
    rms = float(np.sqrt(np.mean((ours - real) ** 2)))
    name = "NED"[axis]
    if segment.varying:
        nothing = Response(math.nan, math.nan, math.nan)
        return AxisComparison(name, math.nan, nothing, nothing, rms)
    before = max(segment.first - 1, 0)
    stepped = command != (log.command_ned_m_s[before, axis] if segment.first else 0.0)
    if not stepped:
        # Not asked to change: what is left is how well it stays.
        return AxisComparison(
            name, command, response_of(time_s, real, command, command), response_of(time_s, ours, command, command), rms
        )
    return AxisComparison(
        name,
        command,
        response_of(time_s, real, float(log.velocity_ned_m_s[before, axis]), command),
        response_of(time_s, ours, float(mock[before, axis]), command),
        rms,
    )
