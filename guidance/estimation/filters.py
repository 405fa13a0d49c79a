"""The filters of the evader's motion: interacting multiple models in the plane, and a Kalman filter of the height.

In the plane two models run side by side, steady (constant velocity) and turning (coordinated turn): mix, move, correct.
They use plain floats: NumPy takes longer to call than five numbers take to compute.

State: north, east (m), their rates (m/s); with the turning model also the turn rate (rad/s, north to east).
Source: Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), 6.2.2 (white
noise acceleration) and 11.7 (coordinated turn with unknown rate). The turn rate decays with a correlation time, so it
stays bounded without reports.

Source of the filter: Blom & Bar-Shalom (1988); Bar-Shalom, Li & Kirubarajan (2001), 11.6.6. The switching is a Markov
chain in continuous time, so the report rate does not matter. Before mixing, the steady model takes the turn rate of the
turning model, since it has none of its own (unbiased mixing: Yuan, Lian & Zhou, 2012).

The height has a filter of its own with two states, down and its rate.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from guidance.estimation.measurement import TrackSettings
from guidance.frames import Vector

Numbers = Sequence[float]

_SMALL_TURN_RAD = 1e-3

_CELLS = tuple((row, column) for row in range(5) for column in range(row + 1))
"""Row and column of each number of a covariance; the steady model has the first ten."""

_ROWS = tuple(
    tuple(_CELLS.index((max(row, column), min(row, column))) for column in range(5))
    for row in range(5)
)
"""Places of the numbers of each whole row of a covariance."""


class Normal(NamedTuple):
    """A normal distribution of the state: its mean (n,) and, by rows, the lower triangle of its covariance."""

    mean: Numbers
    covariance: Numbers


class Modes(NamedTuple):
    """The state as each model has it, and the probability that the evader is turning."""

    steady: Normal
    turning: Normal
    turning_share: float


def begin(measured: Numbers, variances: Numbers, settings: TrackSettings) -> Modes:
    """Begin both models with a report of position (2,), or position and velocity (4,), and its variances."""
    unknown = 4 - len(measured)
    spreads = (
        *variances,
        *[settings.prior_speed_sd_m_s**2] * unknown,
        settings.turn_rate_sd_rad_s**2,
    )
    covariance = [spreads[row] if row == column else 0.0 for row, column in _CELLS]
    mean = [*measured, *[0.0] * (unknown + 1)]
    turning = settings.turning_time_s / (settings.turning_time_s + settings.steady_time_s)
    return Modes(Normal(mean[:4], covariance[:10]), Normal(mean, covariance), turning)


def steady_after(state: Normal, dt_s: float, settings: TrackSettings) -> Normal:
    """Advance the steady model by dt."""
    north, east, north_rate, east_rate = state.mean
    # Covariances of n, e (north, east) and x, y (their rates).
    nn, en, ee, xn, xe, xx, yn, ye, yx, yy = state.covariance
    noise = settings.steady_noise_m2_s3
    place = noise * dt_s**3 / 3.0
    shared = noise * dt_s**2 / 2.0
    rate = noise * dt_s
    return Normal(
        (north + dt_s * north_rate, east + dt_s * east_rate, north_rate, east_rate),
        (
            nn + dt_s * (2.0 * xn + dt_s * xx) + place,
            en + dt_s * (xe + yn + dt_s * yx),
            ee + dt_s * (2.0 * ye + dt_s * yy) + place,
            xn + dt_s * xx + shared,
            xe + dt_s * yx,
            xx + rate,
            yn + dt_s * yx,
            ye + dt_s * yy + shared,
            yx,
            yy + rate,
        ),
    )


def turning_after(state: Normal, dt_s: float, settings: TrackSettings) -> Normal:
    """Advance the turning model by dt."""
    north, east, was_north_rate, was_east_rate, turn_rate = state.mean
    angle = turn_rate * dt_s
    sine = math.sin(angle)
    cosine = math.cos(angle)
    # sin(ωt)/ω, (1 − cos ωt)/ω and their derivatives by ω, with their limits where the turn is small.
    if abs(angle) < _SMALL_TURN_RAD:
        along = dt_s * (1.0 - angle**2 / 6.0)
        across = dt_s * angle * (0.5 - angle**2 / 24.0)
        along_slope = -(dt_s**2) * angle / 3.0
        across_slope = dt_s**2 * (0.5 - angle**2 / 8.0)
    else:
        along = sine / turn_rate
        across = (1.0 - cosine) / turn_rate
        along_slope = (dt_s * cosine - along) / turn_rate
        across_slope = (dt_s * sine - across) / turn_rate
    fade = math.exp(-dt_s / settings.turn_time_s)
    north_rate = cosine * was_north_rate - sine * was_east_rate
    east_rate = sine * was_north_rate + cosine * was_east_rate
    # The Jacobian J of (n, e, x, y, w) adds the turned velocity and the slopes of all by w. Letters as in
    # `steady_after`; w is the turn rate.
    north_slope = along_slope * was_north_rate - across_slope * was_east_rate
    east_slope = across_slope * was_north_rate + along_slope * was_east_rate
    north_rate_slope = -dt_s * east_rate
    east_rate_slope = dt_s * north_rate
    rows: Iterable[Numbers] = [[state.covariance[place] for place in row] for row in _ROWS]
    for _ in range(2):  # the columns of R Jᵀ: first J P, as P is symmetric, then J P Jᵀ
        carried = [
            (
                n + along * x - across * y + north_slope * w,
                e + across * x + along * y + east_slope * w,
                cosine * x - sine * y + north_rate_slope * w,
                sine * x + cosine * y + east_rate_slope * w,
                fade * w,
            )
            for n, e, x, y, w in rows
        ]
        rows = zip(*carried, strict=True)
    (nn, en, xn, yn, wn), (_, ee, xe, ye, we), (_, _, xx, yx, wx), (*_, yy, wy), (*_, ww) = rows
    noise = settings.turning_noise_m2_s3
    place = noise * dt_s**3 / 3.0
    shared = noise * dt_s**2 / 2.0
    rate = noise * dt_s
    return Normal(
        (
            north + along * was_north_rate - across * was_east_rate,
            east + across * was_north_rate + along * was_east_rate,
            *(north_rate, east_rate, fade * turn_rate),
        ),
        (
            *(
                nn + place,
                en,
                ee + place,
                xn + shared,
                xe,
                xx + rate,
                yn,
                ye + shared,
                yx,
                yy + rate,
            ),
            *(wn, we, wx, wy, ww + settings.turn_rate_sd_rad_s**2 * (1.0 - fade**2)),
        ),
    )


def distance(modes: Modes, measured: Numbers, variances: Numbers) -> float:
    """Return νᵀS⁻¹ν of a report and the mixture: χ² distributed with as many degrees as there are numbers."""
    return _corrected(blended(*modes), measured, variances)[1]


def correct(modes: Modes, measured: Numbers, variances: Numbers) -> Modes:
    """Correct both models with a report of position (2,), or position and velocity (4,), and its variances."""
    steady, steady_distance, steady_spread = _corrected(modes.steady, measured, variances)
    turning, turning_distance, turning_spread = _corrected(modes.turning, measured, variances)
    log_ratio = 0.5 * (
        steady_distance - turning_distance + math.log(steady_spread / turning_spread)
    )
    # Bayes' rule for two hypotheses, kept off 0 and 1, so that both models remain possible.
    odds = math.log(modes.turning_share / (1.0 - modes.turning_share)) + log_ratio
    probability = 1.0 / (1.0 + math.exp(-odds)) if odds > -700.0 else 0.0
    return Modes(steady, turning, min(1.0 - 1e-9, max(1e-9, probability)))


def _corrected(state: Normal, measured: Numbers, variances: Numbers) -> tuple[Normal, float, float]:
    """Correct by one number after the other, as their errors are independent; also return νᵀS⁻¹ν and det S."""
    (mean, covariance) = state
    distance = 0.0
    spread = 1.0
    for index, (value, variance) in enumerate(zip(measured, variances, strict=True)):
        shared = [covariance[place] for place in _ROWS[index][: len(mean)]]
        expected = shared[index] + variance
        off = value - mean[index]
        share = 1.0 / expected
        gain = off * share
        distance += off * off * share
        spread *= expected
        mean = [number + gain * by for number, by in zip(mean, shared, strict=True)]
        cells = zip(covariance, _CELLS, strict=False)
        covariance = [
            number - share * (shared[row] * shared[column]) for number, (row, column) in cells
        ]
    return Normal(mean, covariance), distance, spread


def blended(one: Normal, other: Normal, share: float) -> Normal:
    """Return the mixture with this share of the other: mean and covariance of the numbers that both have."""
    rest = 1.0 - share
    spread = rest * share
    means = list(zip(one.mean, other.mean, strict=False))
    apart = [second - first for first, second in means]
    cells = zip(one.covariance, other.covariance, _CELLS, strict=False)
    return Normal(
        [rest * first + share * second for first, second in means],
        [
            rest * a + share * b + spread * (apart[row] * apart[column])
            for a, b, (row, column) in cells
        ],
    )


class Height(NamedTuple):
    """The evader's height: down (m), its rate (m/s), and the three numbers of their covariance."""

    down_m: float
    rate_m_s: float
    down_variance: float
    shared: float
    rate_variance: float


def correct_down(height: Height, measured_m: float, variance_m2: float) -> Height:
    """Correct with a measured height."""
    down, rate, variance, shared, rate_variance = height
    total = variance + variance_m2
    difference = measured_m - down
    return Height(
        down + variance / total * difference,
        rate + shared / total * difference,
        variance * variance_m2 / total,
        shared * variance_m2 / total,
        rate_variance - shared * shared / total,
    )


def correct_rate(height: Height, measured_m_s: float, variance_m2_s2: float) -> Height:
    """Correct with a measured vertical speed."""
    turned = Height(
        height.rate_m_s, height.down_m, height.rate_variance, height.shared, height.down_variance
    )
    rate, down, rate_variance, shared, variance = correct_down(turned, measured_m_s, variance_m2_s2)
    return Height(down, rate, variance, shared, rate_variance)


class Estimate(NamedTuple):
    """The evader at a time of our clock, in the plane and in height, and the arrival of its last report."""

    time_s: float
    received_s: float
    modes: Modes
    height: Height


def advance(estimate: Estimate, time_s: float, settings: TrackSettings) -> Estimate:
    """Mix both models and advance them to a later time, and the height at a constant rate with white acceleration.

    For an earlier time return the estimate unchanged.
    """
    dt_s = time_s - estimate.time_s
    if dt_s <= 0.0:
        return estimate
    begins = 1.0 / settings.steady_time_s
    ends = 1.0 / settings.turning_time_s
    gone = -math.expm1(-(begins + ends) * dt_s) / (begins + ends)
    steady, turning, was_turning = estimate.modes
    share = (1.0 - was_turning) * begins * gone + was_turning * (1.0 - ends * gone)
    into_steady = blended(steady, turning, was_turning * ends * gone / (1.0 - share))
    kept = was_turning * (1.0 - ends * gone) / share
    turn_rate = turning.mean[-1]
    its_variance = turning.covariance[-1]
    as_turning = Normal((*steady.mean, turn_rate), (*steady.covariance, *[0.0] * 4, its_variance))
    into_turning = blended(as_turning, turning, kept)
    down, rate, variance, shared, rate_variance = estimate.height
    noise = settings.height_noise_m2_s3
    return Estimate(
        time_s,
        estimate.received_s,
        Modes(
            steady_after(into_steady, dt_s, settings),
            turning_after(into_turning, dt_s, settings),
            share,
        ),
        Height(
            down + rate * dt_s,
            rate,
            variance + 2.0 * dt_s * shared + dt_s**2 * rate_variance + noise * dt_s**3 / 3.0,
            shared + dt_s * rate_variance + noise * dt_s**2 / 2.0,
            rate_variance + noise * dt_s,
        ),
    )


class EvaderEstimate(NamedTuple):
    """The evader at a time of our clock, extrapolated from its last report.

    Attributes:
        position_ned_m: Position in the local frame.
        velocity_ned_m_s: Velocity; zero while neither reports nor motion have determined it.
        speed_bound_m_s: max(declared, estimate + kσ) over the ground.
        age_s: Time since the last report was true: τ of the game's l − uτ.
    """

    position_ned_m: Vector
    velocity_ned_m_s: Vector
    speed_bound_m_s: float
    age_s: float


def predict(
    last: Estimate, shift_ned_m: Vector, now_s: float, settings: TrackSettings
) -> EvaderEstimate:
    """Return the evader at a time of our clock, not before its last report.

    Args:
        last: The estimate after its last report.
        shift_ned_m: Position of the track's frame in the local frame.
        now_s: The time.
        settings: Noise and bounds of the track.
    """
    moved = advance(last, now_s, settings)
    both = blended(*moved.modes)
    (north, east, north_rate, east_rate) = both.mean
    (by_north, by_east, by_down) = shift_ned_m
    *_, one, _, _, shared, other = both.covariance
    # σ of the speed in the worst direction (the root of the larger eigenvalue), and along the velocity if that is
    # larger.
    worst_sd = math.sqrt(max(0.0, 0.5 * (one + other) + math.hypot(0.5 * (one - other), shared)))
    sd = worst_sd
    speed_m_s = math.hypot(north_rate, east_rate)
    if speed_m_s > worst_sd:
        n = north_rate / speed_m_s
        e = east_rate / speed_m_s
        sd = math.sqrt(max(0.0, n * n * one + 2.0 * n * e * shared + e * e * other))
    known = worst_sd <= settings.known_velocity_sd_m_s
    return EvaderEstimate(
        (north + by_north, east + by_east, moved.height.down_m + by_down),
        (north_rate, east_rate, moved.height.rate_m_s) if known else (0.0, 0.0, 0.0),
        max(settings.declared_speed_m_s, speed_m_s + settings.sigmas * sd),
        max(0.0, now_s - last.time_s),
    )
