"""What the game is told of the evader: where it is at a time, how fast it may be, how old and how sure that is."""

import math
from typing import NamedTuple

from guidance.estimate.imm import combine
from guidance.estimate.motion import Array
from guidance.estimate.settings import TrackSettings
from guidance.estimate.track import Track, advance
from guidance.frames import Vector


class EvaderState(NamedTuple):
    """The evader at a time of our clock, extrapolated from its last report.

    Attributes:
        position_ned_m: Position in the local frame.
        velocity_ned_m_s: Velocity; without meaning (and near zero) while `velocity_known` is False.
        velocity_known: Whether reports or motion have shown the velocity yet. Unknown is not zero.
        speed_bound_m_s: max(declared, estimate + kσ) over the ground.
        turn_rate_rad_s: Positive from north to east.
        turning: Probability that it is turning, 0 to 1.
        age_s: From the moment the last report was true, to now: τ of the game's l − uτ.
        silence_s: From the moment the last report arrived.
        position_sd_m: Spread of the position over the ground, in its worst direction.
        velocity_sd_m_s: The same of the velocity.
        covariance: (4, 4), of north, east (m) and their rates (m/s).
    """

    position_ned_m: Vector
    velocity_ned_m_s: Vector
    velocity_known: bool
    speed_bound_m_s: float
    turn_rate_rad_s: float
    turning: float
    age_s: float
    silence_s: float
    position_sd_m: float
    velocity_sd_m_s: float
    covariance: Array


def predict(track: Track, now_s: float, settings: TrackSettings) -> EvaderState | None:
    """The evader at a time of our clock; None before the first report, the last report's for a time before it."""
    last = track.estimate
    if last is None:
        return None
    moved = advance(last, now_s, settings)
    mean, covariance = combine(moved.modes)
    north, east, north_rate, east_rate, turn_rate = mean.tolist()
    spread = covariance.tolist()
    velocity_sd_m_s = _worst_sd(spread[2][2], spread[2][3], spread[3][3])
    speed_m_s = math.hypot(north_rate, east_rate)
    bound_m_s = speed_m_s + settings.sigmas * _sd_along(north_rate, east_rate, spread, velocity_sd_m_s)
    return EvaderState(
        position_ned_m=(north, east, moved.height.down_m),
        velocity_ned_m_s=(north_rate, east_rate, moved.height.rate_m_s),
        velocity_known=velocity_sd_m_s <= settings.known_velocity_sd_m_s,
        speed_bound_m_s=max(settings.declared_speed_m_s, bound_m_s),
        turn_rate_rad_s=moved.modes.turning * turn_rate,
        turning=moved.modes.turning,
        age_s=max(0.0, now_s - last.time_s),
        silence_s=max(0.0, now_s - last.received_s),
        position_sd_m=_worst_sd(spread[0][0], spread[0][1], spread[1][1]),
        velocity_sd_m_s=velocity_sd_m_s,
        covariance=covariance[:4, :4],
    )


def _sd_along(north_rate: float, east_rate: float, spread: list[list[float]], worst_sd: float) -> float:
    """σ of the speed: of the velocity along itself, or in its worst direction while it is lost in its own spread."""
    speed = math.hypot(north_rate, east_rate)
    if speed <= worst_sd:
        return worst_sd
    north, east = north_rate / speed, east_rate / speed
    variance = north * north * spread[2][2] + 2.0 * north * east * spread[2][3] + east * east * spread[3][3]
    return math.sqrt(max(0.0, variance))


def _worst_sd(one: float, shared: float, other: float) -> float:
    """Square root of the larger eigenvalue of a symmetric 2 × 2 matrix."""
    return math.sqrt(max(0.0, 0.5 * (one + other) + math.hypot(0.5 * (one - other), shared)))
