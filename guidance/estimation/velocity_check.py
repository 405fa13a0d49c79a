"""Compares the velocities that an evader reports with its positions, and says whether the velocities are believed.

A sender may report velocities in another frame than it says (a ROS twist in the world's axes), or always zero. The
velocities are integrated over about two seconds, by the trapezoidal rule. The rest of the positions is then
constant if the velocities are right. The slope of a straight line through the rest is the error of the velocities; the
spread of the positions bounds its own error.

The velocities are dropped when they have been wrong for a while, since a sharp turn between two reports, or a jump of
the position, looks the same at first. They are believed again once they have been right for longer while the evader
moved: at rest a velocity that is always zero is right.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from guidance.estimation.measurement import Measurement

_WINDOW_S: Final = 2.0
"""Time over which positions and velocities are compared; longer if reports are rarer than two a second."""

_LEAST_SAMPLES: Final = 4
_APART_S: Final = 0.09
_LONGEST_GAP_S: Final = 2.5
_TOLERANCE_M_S: Final = 0.8
_SIGMAS: Final = 3.5
_WRONG_AFTER_S: Final = 2.0
_WRONG_SAMPLES: Final = 3
_RIGHT_AFTER_S: Final = 20.0
_MOVING_M_S: Final = 1.0


class PlaneReport(NamedTuple):
    """A report on the plane, north and east.

    Attributes:
        time_s: When it was true, on our clock.
        position_m: The reported position, metres.
        velocity_m_s: The reported velocity, m/s.
        integrated_m: Integral of the velocities since the first sample, metres.
        remainder_m: The position less that integral, metres.
        position_sd_m: Standard deviation of the position.
    """

    time_s: float
    position_m: tuple[float, float]
    velocity_m_s: tuple[float, float]
    integrated_m: tuple[float, float]
    remainder_m: tuple[float, float]
    position_sd_m: float


class VelocityCheck(NamedTuple):
    """The memory of the comparison.

    Attributes:
        believed: Whether the reported velocities are used.
        error_m_s: Size of the last measured error of the velocities; NaN before the first one.
        samples: Reports of the window, oldest first.
        wrong_since_s: Time of the first sample of a row of wrong ones; NaN after one that is not wrong.
        wrong_samples: Number of samples in that row.
        right_s: How long the velocities have been right while the evader moved.
    """

    believed: bool = True
    error_m_s: float = math.nan
    samples: tuple[PlaneReport, ...] = ()
    wrong_since_s: float = math.nan
    wrong_samples: int = 0
    right_s: float = 0.0


def check_velocity(check: VelocityCheck, measurement: Measurement) -> VelocityCheck:
    """Add a report that the track has accepted. Reports without a velocity change nothing.

    Args:
        check: The memory so far.
        measurement: The report with the velocity that it gives.
    """
    velocity = measurement.velocity_ned_m_s
    if velocity is None:
        return check
    time_s = measurement.time_s
    step_s = math.inf
    if check.samples:
        step_s = time_s - check.samples[-1].time_s
        if step_s < _APART_S:  # also an older report, which came late
            return check
    north_m, east_m, _ = measurement.position_ned_m
    north_m_s, east_m_s, _ = velocity
    integrated_m = (0.0, 0.0)
    if step_s <= _LONGEST_GAP_S:
        last = check.samples[-1]
        integrated_m = (
            last.integrated_m[0] + 0.5 * step_s * (last.velocity_m_s[0] + north_m_s),
            last.integrated_m[1] + 0.5 * step_s * (last.velocity_m_s[1] + east_m_s),
        )
    sample = PlaneReport(
        time_s,
        (north_m, east_m),
        (north_m_s, east_m_s),
        integrated_m,
        (north_m - integrated_m[0], east_m - integrated_m[1]),
        measurement.position_sd_m,
    )
    if step_s > _LONGEST_GAP_S:
        return check._replace(samples=(sample,), wrong_since_s=math.nan, wrong_samples=0)
    # The newest samples that span the window, and at least the least number of them.
    samples = (*check.samples, sample)
    begin_s = samples[-1].time_s - _WINDOW_S - _APART_S
    enough = max(0, len(samples) - _LEAST_SAMPLES)
    first = 0
    while first < enough and samples[first].time_s < begin_s:
        first += 1
    samples = samples[first:]
    if len(samples) < _LEAST_SAMPLES or time_s - samples[0].time_s < _WINDOW_S - _APART_S:
        return check._replace(samples=samples)
    return _judged(check, samples, step_s)


def _judged(check: VelocityCheck, samples: tuple[PlaneReport, ...], step_s: float) -> VelocityCheck:
    """Compare the velocities of a whole window; the last sample came `step_s` after the one before it."""
    # Straight lines through the samples, over time from their mean.
    newest_s = samples[-1].time_s
    times_s = [sample.time_s - newest_s for sample in samples]
    mean_s = sum(times_s) / len(times_s)
    from_mean_s = [time_s - mean_s for time_s in times_s]
    spread_s2 = sum(offset_s**2 for offset_s in from_mean_s)
    error_m_s = _slope(from_mean_s, spread_s2, [sample.remainder_m for sample in samples])
    speed_m_s = _slope(from_mean_s, spread_s2, [sample.position_m for sample in samples])
    position_sd_m = max(sample.position_sd_m for sample in samples)
    allowed_m_s = max(_TOLERANCE_M_S, _SIGMAS * position_sd_m / math.sqrt(spread_s2))
    if error_m_s <= allowed_m_s:
        right_s = check.right_s
        if error_m_s > 0.5 * allowed_m_s:
            right_s = 0.0
        elif speed_m_s > _MOVING_M_S:
            right_s += step_s
        believed = check.believed or right_s > _RIGHT_AFTER_S
        return VelocityCheck(believed, error_m_s, samples, right_s=right_s)
    time_s = samples[-1].time_s
    since_s = check.wrong_since_s
    if math.isnan(since_s):
        since_s = time_s
    wrong_samples = check.wrong_samples + 1
    lasting = time_s - since_s >= _WRONG_AFTER_S and wrong_samples >= _WRONG_SAMPLES
    believed = check.believed and not lasting
    return VelocityCheck(believed, error_m_s, samples, since_s, wrong_samples)


def _slope(
    from_mean_s: Sequence[float], spread_s2: float, points_m: Sequence[tuple[float, float]]
) -> float:
    """Return the length of the slopes of north and east."""
    north_m_s = 0.0
    east_m_s = 0.0
    for offset_s, (north_m, east_m) in zip(from_mean_s, points_m, strict=True):
        north_m_s += offset_s * north_m
        east_m_s += offset_s * east_m
    return math.hypot(north_m_s / spread_s2, east_m_s / spread_s2)
