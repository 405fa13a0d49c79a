"""The filters of the evader's motion: interacting multiple models in the plane, and a Kalman filter of the height.

In the plane two models run side by side, steady (constant velocity) and turning (coordinated turn): mix, move, correct.
They are plain floats: for five numbers a NumPy call costs more than the arithmetic.

State: north, east (m), their rates (m/s), turn rate (rad/s, north to east).
Source: Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), 6.2.2 (white
noise acceleration) and 11.7 (coordinated turn with unknown rate). The turn rate decays with a correlation time, so it
stays bounded without reports; the steady model does not use it.

Source of the filter: Blom & Bar-Shalom (1988); Bar-Shalom, Li & Kirubarajan (2001), 11.6.6. The switching is a Markov
chain in continuous time, so the report rate does not matter. Before mixing, the steady model takes the turn rate of the
turning model, since it has none of its own (unbiased mixing: Yuan, Lian & Zhou, 2012).

The height has a filter of its own with two states, down and its rate.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from guidance.estimation.measurement import TrackSettings

Numbers = Sequence[float]

_ROWS = ((0, 1, 2, 3, 4), (1, 5, 6, 7, 8), (2, 6, 9, 10, 11), (3, 7, 10, 12, 13), (4, 8, 11, 13, 14))
"""Where the rows of a symmetric matrix stand in its upper triangle."""

_SMALL_TURN_RAD = 1e-3
_NO_SLOPES = (0.0, 0.0, 0.0, 0.0)


class Normal(NamedTuple):
    """A normal distribution of the state: its mean (5,), and the upper triangle of its covariance by rows (15,)."""

    mean: Numbers
    covariance: Numbers

    def row(self, index: int) -> Numbers:
        """Return a row of the covariance."""
        return [self.covariance[place] for place in _ROWS[index]]


class Modes(NamedTuple):
    """The state as each model has it, and the probability that the evader is turning."""

    steady: Normal
    turning: Normal
    turning_share: float


def begin(measured: Numbers, variances: Numbers, settings: TrackSettings) -> Modes:
    """Begin both models with a report of position (2,), or position and velocity (4,), and its variances."""
    known, unknown = len(measured), 4 - len(measured)
    spreads = (*variances, *[settings.prior_speed_sd_m_s**2] * unknown, settings.turn_rate_sd_rad_s**2)
    covariance = [0.0] * 15
    for index, spread in enumerate(spreads):
        covariance[_ROWS[index][index]] = spread
    first = Normal([*measured, *[0.0] * (5 - known)], covariance)
    return Modes(first, first, settings.turning_time_s / (settings.turning_time_s + settings.steady_time_s))


def advance_modes(modes: Modes, dt_s: float, settings: TrackSettings) -> Modes:
    """Mix both models and advance them by dt; for dt = 0 return the same modes."""
    if dt_s <= 0.0:
        return modes
    steady, turning, share = _mix(modes, dt_s, settings)
    return Modes(steady_after(steady, dt_s, settings), turning_after(turning, dt_s, settings), share)


def steady_after(state: Normal, dt_s: float, settings: TrackSettings) -> Normal:
    """Advance the steady model by dt > 0."""
    motion = (dt_s, 0.0, 0.0, 1.0, math.exp(-dt_s / settings.turn_time_s))
    return _after(state, motion, _NO_SLOPES, dt_s, settings.steady_noise_m2_s3, settings.turn_rate_sd_rad_s)


def turning_after(state: Normal, dt_s: float, settings: TrackSettings) -> Normal:
    """Advance the turning model by dt > 0."""
    _, _, north_rate, east_rate, turn_rate = state.mean
    along, across, along_slope, across_slope = _arc(turn_rate, dt_s)
    sine, cosine = math.sin(turn_rate * dt_s), math.cos(turn_rate * dt_s)
    motion = (along, across, sine, cosine, math.exp(-dt_s / settings.turn_time_s))
    slopes = (
        along_slope * north_rate - across_slope * east_rate,
        across_slope * north_rate + along_slope * east_rate,
        -dt_s * (sine * north_rate + cosine * east_rate),
        dt_s * (cosine * north_rate - sine * east_rate),
    )
    return _after(state, motion, slopes, dt_s, settings.turning_noise_m2_s3, settings.turn_rate_sd_rad_s)


def _arc(turn_rate: float, dt_s: float) -> tuple[float, float, float, float]:
    """sin(ωt)/ω, (1 − cos ωt)/ω and their derivatives by ω, with their limits where the turn is small."""
    angle = turn_rate * dt_s
    if abs(angle) < _SMALL_TURN_RAD:
        return (
            dt_s * (1.0 - angle**2 / 6.0),
            dt_s * angle * (0.5 - angle**2 / 24.0),
            -(dt_s**2) * angle / 3.0,
            dt_s**2 * (0.5 - angle**2 / 8.0),
        )
    along, across = math.sin(angle) / turn_rate, (1.0 - math.cos(angle)) / turn_rate
    return (
        along,
        across,
        (dt_s * math.cos(angle) - along) / turn_rate,
        (dt_s * math.sin(angle) - across) / turn_rate,
    )


def _after(
    state: Normal, motion: Numbers, slopes: Numbers, dt_s: float, noise_m2_s3: float, turn_rate_sd: float
) -> Normal:
    """Move a state, with white acceleration over dt: q · [dt³/3, dt²/2; dt²/2, dt], the same for any report rate."""
    (mean,) = _moved((state.mean,), motion, _NO_SLOPES)
    halfway = _moved(map(state.row, range(5)), motion, slopes)  # P Jᵀ, since P is symmetric
    rows = _moved(zip(*halfway, strict=True), motion, slopes)  # J P Jᵀ
    covariance = [number for index, row in enumerate(rows) for number in row[index:]]
    place, shared, rate = noise_m2_s3 * dt_s**3 / 3.0, noise_m2_s3 * dt_s**2 / 2.0, noise_m2_s3 * dt_s
    turning = turn_rate_sd**2 * (1.0 - motion[4] ** 2)
    more = (place, 0.0, shared, 0.0, 0.0, place, 0.0, shared, 0.0, rate, 0.0, 0.0, rate, 0.0, turning)
    return Normal(mean, [number + noise for number, noise in zip(covariance, more, strict=True)])


def _moved(states: Iterable[Numbers], motion: Numbers, slopes: Numbers) -> list[Numbers]:
    """Multiply each state by the matrix of a motion; `slopes` are its derivatives by the turn rate."""
    along, across, sine, cosine, fade = motion
    north_slope, east_slope, north_rate_slope, east_rate_slope = slopes
    return [
        (
            north + along * north_rate - across * east_rate + north_slope * turn_rate,
            east + across * north_rate + along * east_rate + east_slope * turn_rate,
            cosine * north_rate - sine * east_rate + north_rate_slope * turn_rate,
            sine * north_rate + cosine * east_rate + east_rate_slope * turn_rate,
            fade * turn_rate,
        )
        for north, east, north_rate, east_rate, turn_rate in states
    ]


def distance(modes: Modes, measured: Numbers, variances: Numbers) -> float:
    """Return νᵀS⁻¹ν of a report and the mixture: χ² distributed with as many degrees as there are numbers."""
    mean, covariance = combine(modes)
    return _corrected(Normal(mean, covariance), measured, variances)[1]


def correct(modes: Modes, measured: Numbers, variances: Numbers) -> Modes:
    """Correct both models with a report of position (2,), or position and velocity (4,), and its variances."""
    steady, steady_distance, steady_spread = _corrected(modes.steady, measured, variances)
    turning, turning_distance, turning_spread = _corrected(modes.turning, measured, variances)
    log_ratio = 0.5 * (steady_distance - turning_distance + math.log(steady_spread / turning_spread))
    return Modes(steady, turning, _posterior(modes.turning_share, log_ratio))


def _corrected(state: Normal, measured: Numbers, variances: Numbers) -> tuple[Normal, float, float]:
    """Correct by one number after the other, as their errors are independent; also return νᵀS⁻¹ν and det S."""
    mean, covariance = state
    distance, spread = 0.0, 1.0
    for index, (value, variance) in enumerate(zip(measured, variances, strict=True)):
        shared = [covariance[place] for place in _ROWS[index]]
        expected = shared[index] + variance
        share, off = 1.0 / expected, value - mean[index]
        distance += off * off * share
        spread *= expected
        mean = [number + off * share * one for number, one in zip(mean, shared, strict=True)]
        covariance = [number - share * known for number, known in zip(covariance, _square(shared), strict=True)]
    return Normal(mean, covariance), distance, spread


def combine(modes: Modes) -> Normal:
    """Return the mixture of both models."""
    return _blended(modes.steady, modes.turning, modes.turning_share)


def _blended(one: Normal, other: Normal, share: float) -> Normal:
    """Return mean and covariance of a mixture with this share of the other."""
    rest = 1.0 - share
    apart = [there - here for here, there in zip(one.mean, other.mean, strict=True)]
    spread = rest * share
    rows = zip(one.covariance, other.covariance, _square(apart), strict=True)
    return Normal(
        [rest * here + share * there for here, there in zip(one.mean, other.mean, strict=True)],
        [rest * here + share * there + spread * square for here, there, square in rows],
    )


def _square(numbers: Numbers) -> Numbers:
    """Return the upper triangle of x xᵀ."""
    a, b, c, d, e = numbers
    return (a * a, a * b, a * c, a * d, a * e, b * b, b * c, b * d, b * e, c * c, c * d, c * e, d * d, d * e, e * e)


def _mix(modes: Modes, dt_s: float, settings: TrackSettings) -> Modes:
    begins, ends = 1.0 / settings.steady_time_s, 1.0 / settings.turning_time_s
    gone = -math.expm1(-(begins + ends) * dt_s) / (begins + ends)
    steady, turning, was_turning = modes
    was_steady = 1.0 - was_turning
    share = was_steady * begins * gone + was_turning * (1.0 - ends * gone)
    covariance = list(steady.covariance)
    for place in _ROWS[4]:
        covariance[place] = 0.0
    covariance[-1] = turning.covariance[-1]
    with_turn_rate = Normal([*steady.mean[:4], turning.mean[4]], covariance)
    return Modes(
        _blended(with_turn_rate, turning, was_turning * ends * gone / (1.0 - share)),
        _blended(with_turn_rate, turning, was_turning * (1.0 - ends * gone) / share),
        share,
    )


def _posterior(turning: float, log_ratio: float) -> float:
    """Bayes' rule for two hypotheses, kept off 0 and 1, so that both models remain possible."""
    odds = math.log(turning / (1.0 - turning)) + log_ratio
    probability = 1.0 / (1.0 + math.exp(-odds)) if odds > -700.0 else 0.0
    return min(1.0 - 1e-9, max(1e-9, probability))


class Height(NamedTuple):
    """The evader's height: down (m), its rate (m/s), and the three numbers of their covariance."""

    down_m: float
    rate_m_s: float
    down_variance: float
    shared: float
    rate_variance: float


def advance_height(height: Height, dt_s: float, noise_m2_s3: float) -> Height:
    """Advance by dt at a constant rate, with white vertical acceleration."""
    down, rate, variance, shared, rate_variance = height
    return Height(
        down + rate * dt_s,
        rate,
        variance + 2.0 * dt_s * shared + dt_s**2 * rate_variance + noise_m2_s3 * dt_s**3 / 3.0,
        shared + dt_s * rate_variance + noise_m2_s3 * dt_s**2 / 2.0,
        rate_variance + noise_m2_s3 * dt_s,
    )


def correct_down(height: Height, measured_m: float, variance_m2: float) -> Height:
    """Correct with a measured height."""
    down, rate, variance, shared, rate_variance = height
    total, difference = variance + variance_m2, measured_m - down
    return Height(
        down + variance / total * difference,
        rate + shared / total * difference,
        variance * variance_m2 / total,
        shared * variance_m2 / total,
        rate_variance - shared * shared / total,
    )


def correct_rate(height: Height, measured_m_s: float, variance_m2_s2: float) -> Height:
    """Correct with a measured vertical speed."""
    turned = Height(height.rate_m_s, height.down_m, height.rate_variance, height.shared, height.down_variance)
    rate, down, rate_variance, shared, variance = correct_down(turned, measured_m_s, variance_m2_s2)
    return Height(down, rate, variance, shared, rate_variance)


class Estimate(NamedTuple):
    """The evader at a time of our clock, in the plane and in height, and the arrival of its last report."""

    time_s: float
    received_s: float
    modes: Modes
    height: Height


def advance(estimate: Estimate, time_s: float, settings: TrackSettings) -> Estimate:
    """Advance an estimate to a later time; for an earlier time return it unchanged."""
    dt_s = time_s - estimate.time_s
    if dt_s <= 0.0:
        return estimate
    return Estimate(
        time_s,
        estimate.received_s,
        advance_modes(estimate.modes, dt_s, settings),
        advance_height(estimate.height, dt_s, settings.height_noise_m2_s3),
    )
