"""Settings of the track, and reports of the evader as measurements: local metres, our clock, a spread for every value.

The sender's clock is converted to ours by the reports' own times and by TIMESYNC. received - sent = offset + delay, and
no delay is negative. So the smallest difference bounds the offset; it may rise as fast as two clocks drift apart. A
TIMESYNC round trip measures the offset itself, to half its duration. A restarted sender jumps by seconds. The jump is
accepted only after a while, because one corrupt time, or a burst from a queue, looks the same at first.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from guidance.frames import Amsl, LocalFrame, Ned
from guidance.messages import EvaderReport

_NO_BOUND: Final = 1e4


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackSettings:
    """Noise, time limits and bounds of the evader's track.

    Attributes:
        declared_speed_m_s: Largest speed of the evader, as declared.
        sigmas: k of the speed bound max(declared, estimate + kσ).
        steady_noise_m2_s3: Spectral density of the acceleration while the evader holds its course.
        turning_noise_m2_s3: The same while it turns.
        turn_rate_sd_rad_s: Spread of turn rates while it turns.
        turn_time_s: Correlation time of the turn rate.
        steady_time_s: Mean time between turns.
        turning_time_s: Mean time in a turn.
        position_sd_m: Spread of a report that gives none.
        velocity_sd_m_s: Spread of a report that gives none.
        height_noise_m2_s3: Spectral density of the vertical acceleration.
        prior_speed_sd_m_s: Spread of the velocity before the first report of it.
        known_velocity_sd_m_s: Largest spread of a velocity that counts as known.
        largest_speed_m_s: Reports of a higher speed are refused.
        stale_s: Reports older than this on arrival are dropped.
        future_s: A report may be this far ahead of its own arrival.
        silence_s: After this long without a report, the next one restarts the track.
        history_s: Time span within which reports can be reordered.
        jump_reports: So many outliers in a row that agree with each other restart the track,
        jump_s: or fewer that agree for this long.
        jump_m_s: A restart must be within the distance covered at this speed since the last estimate,
        way_m_s: and every report within the distance covered at this speed since some seconds ago,
        reach_m: each with this tolerance. The defaults mean no bound.
    """

    declared_speed_m_s: float
    sigmas: float = 2.0
    steady_noise_m2_s3: float = 0.05
    turning_noise_m2_s3: float = 1.0
    turn_rate_sd_rad_s: float = 0.4
    turn_time_s: float = 5.0
    steady_time_s: float = 8.0
    turning_time_s: float = 4.0
    position_sd_m: float = 0.7
    velocity_sd_m_s: float = 0.3
    height_noise_m2_s3: float = 0.05
    prior_speed_sd_m_s: float = 10.0
    known_velocity_sd_m_s: float = 1.5
    largest_speed_m_s: float = 60.0
    stale_s: float = 2.0
    future_s: float = 0.2
    silence_s: float = 5.0
    history_s: float = 3.0
    jump_reports: int = 3
    jump_s: float = 0.9
    jump_m_s: float = _NO_BOUND
    way_m_s: float = _NO_BOUND
    reach_m: float = 6.0


_LARGEST = 1e8
_LEAST_SD = 0.01
_LARGEST_SD = 1e4

_DRIFT = 2e-4  # two quartz clocks, 100 ppm each
_STEP_S = 1.0
_ALIKE_S = 0.3
_LASTING_S = 1.0
_LASTING_REPORTS = 3
_BELIEVED_S = 30.0


class Measurement(NamedTuple):
    """Position (NED, m), velocity (NED, m/s) or None where it is not known, and when it was true on our clock."""

    time_s: float
    received_s: float
    position_ned_m: Ned
    velocity_ned_m_s: Ned | None
    position_sd_m: float
    velocity_sd_m_s: float

    def is_usable(self) -> bool:
        """Return whether all numbers, including the spreads, are finite and of a possible size."""
        numbers = [self.time_s, self.received_s, *self.position_ned_m]
        if self.velocity_ned_m_s is not None:
            numbers += self.velocity_ned_m_s
        if not math.hypot(*numbers) < _LARGEST:  # NaN fails this too
            return False
        spreads = (self.position_sd_m, self.velocity_sd_m_s)
        return all(_LEAST_SD <= spread <= _LARGEST_SD for spread in spreads)

    def plane(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the measured values in the plane, (2,) or with velocity (4,), and their variances."""
        values = [*self.position_ned_m[:2]]
        variances = [self.position_sd_m**2] * 2
        if self.velocity_ned_m_s is not None:
            values += self.velocity_ned_m_s[:2]
            variances += [self.velocity_sd_m_s**2] * 2
        return values, variances


def measure(
    report: EvaderReport,
    frame: LocalFrame,
    shift_ned_m: Ned,
    clock: "ClockOffset | None",
    settings: TrackSettings,
) -> Measurement:
    """Convert a plausible report to the frame of the track.

    It was true by its sender's clock if it has one, else when it arrived. A velocity is unknown if any part is NaN. A
    spread that is missing or not positive is taken from the settings; very small ones are raised to 1 cm.

    Args:
        report: From the source.
        frame: The vehicle's local frame.
        shift_ned_m: Position of the track's frame in it.
        clock: The sender's; None before the first report with a time.
        settings: For missing spreads.
    """
    altitude = Amsl(report.altitude_amsl_m)
    position_ned_m = frame.ned_from_wgs84(report.latitude_deg, report.longitude_deg, altitude)
    time_s = report.received_s
    if clock is not None and not math.isnan(report.sent_s):
        time_s = clock.ours(report.sent_s)
    velocity_ned_m_s = None
    if not any(map(math.isnan, report.velocity_ned_m_s)):
        velocity_ned_m_s = report.velocity_ned_m_s
    return Measurement(
        time_s,
        report.received_s,
        position_ned_m - shift_ned_m,
        velocity_ned_m_s,
        _usable_spread(report.position_sd_m, settings.position_sd_m),
        _usable_spread(report.velocity_sd_m_s, settings.velocity_sd_m_s),
    )


def _usable_spread(reported: float, default: float) -> float:
    """Return a reported standard deviation, not below a centimetre; the default if there is none."""
    return max(_LEAST_SD, reported) if reported > 0.0 else default


class ClockOffset(NamedTuple):
    """Our clock minus the sender's, seconds.

    Attributes:
        offset_s: The estimate, valid at `at_s`.
        at_s: Our time of the last report that contributed.
        round_trip_s: Duration of the TIMESYNC exchange that measured it; NaN if only reports did.
        synced_s: Our time of that exchange.
        candidate_s: Another offset, common to the latest reports; NaN if there is none.
        candidate_since_s: Our time when it was first seen.
        candidate_reports: How many reports agree on it.
    """

    offset_s: float
    at_s: float
    round_trip_s: float = math.nan
    synced_s: float = -math.inf
    candidate_s: float = math.nan
    candidate_since_s: float = math.nan
    candidate_reports: int = 0

    def ours(self, sent_s: float) -> float:
        """Convert a time of the sender's clock to ours."""
        return sent_s + self.offset_s

    @property
    def measured(self) -> bool:
        """True if a round trip measured it; otherwise it includes the least transport delay."""
        return not math.isnan(self.round_trip_s)


def hear(clock: ClockOffset | None, sent_s: float, received_s: float) -> ClockOffset | None:
    """Add the two times of a report; ignore times that are not finite."""
    sample_s = received_s - sent_s
    if not math.isfinite(sample_s):
        return clock
    if clock is None:
        return ClockOffset(sample_s, received_s)
    grown_s = clock.offset_s
    if not clock.measured or received_s - clock.synced_s > _BELIEVED_S:
        grown_s += _DRIFT * max(0.0, received_s - clock.at_s)
    if abs(sample_s - grown_s) > _STEP_S:
        # Another offset is suspected, and believed once enough reports have agreed with it for long enough.
        if not abs(sample_s - clock.candidate_s) <= _ALIKE_S:
            return clock._replace(
                candidate_s=sample_s, candidate_since_s=received_s, candidate_reports=1
            )
        candidate_s = min(sample_s, clock.candidate_s)
        reports = clock.candidate_reports + 1
        lasted_s = received_s - clock.candidate_since_s
        if lasted_s >= _LASTING_S and reports >= _LASTING_REPORTS:
            return ClockOffset(candidate_s, received_s)
        return clock._replace(candidate_s=candidate_s, candidate_reports=reports)
    offset_s = min(grown_s, sample_s)
    at_s = max(clock.at_s, received_s)
    return ClockOffset(offset_s, at_s, clock.round_trip_s, clock.synced_s)


def synchronise(
    clock: ClockOffset | None, remote_s: float, asked_s: float, answered_s: float
) -> ClockOffset | None:
    """Add a TIMESYNC exchange: we asked, the sender read its clock, the answer arrived.

    The shortest round trip is the best; a longer one replaces it only when it has become old.

    Args:
        clock: The offset so far.
        remote_s: The sender's clock in the answer.
        asked_s: When we asked, on our clock.
        answered_s: When the answer arrived, on our clock.
    """
    round_trip_s = answered_s - asked_s
    offset_s = 0.5 * (asked_s + answered_s) - remote_s
    if not (0.0 <= round_trip_s <= _STEP_S and math.isfinite(offset_s)):
        return clock
    fresh = ClockOffset(offset_s, answered_s, round_trip_s, answered_s)
    if clock is None or not clock.measured or answered_s - clock.synced_s > _BELIEVED_S:
        return fresh
    if abs(offset_s - clock.offset_s) > _STEP_S or round_trip_s <= clock.round_trip_s:
        return fresh
    return clock
