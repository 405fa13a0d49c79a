"""Noise and limits of the evader's track, fixed before the first report."""

from dataclasses import dataclass, fields
from typing import Final

from guidance.errors import ConfigError

_LARGEST: Final = 1e4
_MAY_BE_ZERO: Final = frozenset({"latency_s", "future_s", "sigmas", "history_s"})
_LEAST: Final = {**dict.fromkeys(_MAY_BE_ZERO, 0.0), "position_sd_m": 0.01, "velocity_sd_m_s": 0.01}


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
        latency_s: Least time from measurement to arrival, for clocks without TIMESYNC.
        stale_s: Reports older than this on arrival are dropped.
        future_s: A report may be this far ahead of its own arrival.
        silence_s: After this long without a report, the next one restarts the track.
        history_s: Time span within which reports can be reordered.
        jump_reports: So many outliers in a row that agree with each other restart the track,
        jump_s: or fewer that agree for this long.
        jump_m_s: A restart must be within the distance covered at this speed since the last estimate,
        way_m_s: and every report within the distance covered at this speed since some seconds ago,
        reach_m: each with this tolerance. The largest numbers allowed mean no bound.
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
    latency_s: float = 0.0
    stale_s: float = 2.0
    future_s: float = 0.2
    silence_s: float = 5.0
    history_s: float = 3.0
    jump_reports: int = 3
    jump_s: float = 0.9
    jump_m_s: float = _LARGEST
    way_m_s: float = _LARGEST
    reach_m: float = 6.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value, least = getattr(self, field.name), _LEAST.get(field.name, 1e-6)
            if not least <= value <= _LARGEST:
                raise ConfigError(f"{field.name} = {value}: allowed is {least} to {_LARGEST}")
