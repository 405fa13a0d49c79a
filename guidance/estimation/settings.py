"""What the estimator believes of the evader and of its reports before it has heard any."""

from dataclasses import dataclass, fields

from guidance.errors import ConfigError

_LARGEST = 1e4


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackSettings:
    """Noise, patience and bounds of the evader's track.

    Attributes:
        declared_speed_m_s: What the evader is said never to exceed.
        sigmas: k of the speed bound max(declared, estimate + kσ).
        steady_noise_m2_s3: Spectral density of the acceleration while the evader holds its course.
        turning_noise_m2_s3: The same while it turns.
        turn_rate_sd_rad_s: Spread of turn rates while it turns.
        turn_time_s: How long a turn rate lasts (correlation time).
        steady_time_s: Mean time between turns.
        turning_time_s: Mean time in a turn.
        position_sd_m: Of a report that does not say.
        velocity_sd_m_s: Of a report that does not say.
        height_noise_m2_s3: Spectral density of the vertical acceleration.
        prior_speed_sd_m_s: Spread of the velocity before anything is known of it.
        known_velocity_sd_m_s: The velocity counts as known from this spread on.
        largest_speed_m_s: Reports that claim more are refused.
        latency_s: Least time from measurement to arrival, for clocks that no TIMESYNC compares.
        stale_s: Age on arrival from which a report is dropped.
        future_s: How far after its own arrival a report may claim to be.
        silence_s: After this long without a report the next one starts the track anew.
        history_s: How far back reports can be put in order.
        jump_reports: Outliers in a row that agree with each other and start the track anew,
        jump_s: or fewer that do so for this long.
        jump_m_s: A jump is believed only so far as this speed goes in the time since the evader was last known,
        way_m_s: and no report that is further from where it was some seconds ago than this speed goes,
        reach_m: each give or take this. The largest numbers allowed are no bound.
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
            value = getattr(self, field.name)
            least = 0.0 if field.name in {"latency_s", "future_s", "sigmas", "history_s"} else 1e-6
            least = 0.01 if field.name in {"position_sd_m", "velocity_sd_m_s"} else least
            if not least <= value <= _LARGEST:
                raise ConfigError(f"{field.name} = {value}: allowed is {least} to {_LARGEST}")
