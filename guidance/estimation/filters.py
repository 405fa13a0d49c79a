"""The filters of the evader's motion: interacting multiple models in the plane, and a Kalman filter of the height.

In the plane two models run side by side, constant velocity (0) and coordinated turn (1): mix, move, correct.

State, last axis: north, east (m), their rates (m/s), turn rate (rad/s, north to east). Leading axis: the model.
Source: Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), 6.2.2 (white
noise acceleration) and 11.7 (coordinated turn with unknown rate). The turn rate decays with a correlation time, so it
stays bounded without reports; the steady model does not use it.

Source of the filter: Blom & Bar-Shalom (1988); Bar-Shalom, Li & Kirubarajan (2001), 11.6.6. The switching is a Markov
chain in continuous time, so the report rate does not matter. Before mixing, the steady model takes the turn rate of the
turning model, since it has none of its own (unbiased mixing: Yuan, Lian & Zhou, 2012).

The height has a filter of its own with two states, down and its rate.
"""

import math
from typing import NamedTuple, cast

import numpy as np

from guidance.estimation.measurement import Array, TrackSettings

STATES = 5

_IDENTITY = np.broadcast_to(np.eye(STATES), (2, STATES, STATES))
_SMALL_TURN_RAD = 1e-3


class Step(NamedTuple):
    """Both models after a time step: states (2, 5), transition Jacobians (2, 5, 5) and process noise (2, 5, 5)."""

    mean: Array
    jacobian: Array
    noise: Array


def step(mean: Array, dt_s: float, settings: TrackSettings) -> Step:
    """Advance both models' states (2, 5) by dt ≥ 0."""
    fade = math.exp(-dt_s / settings.turn_time_s)
    north, east, north_rate, east_rate, turn_rate = mean[1].tolist()
    along, across, along_slope, across_slope = _arc(turn_rate, dt_s)
    sine, cosine = math.sin(turn_rate * dt_s), math.cos(turn_rate * dt_s)
    new_north_rate = cosine * north_rate - sine * east_rate
    new_east_rate = sine * north_rate + cosine * east_rate

    jacobian = _IDENTITY.copy()
    jacobian[:, 4, 4] = fade
    jacobian[0, 0, 2] = jacobian[0, 1, 3] = dt_s
    jacobian[1, :4, 2:] = (
        (along, -across, along_slope * north_rate - across_slope * east_rate),
        (across, along, across_slope * north_rate + along_slope * east_rate),
        (cosine, -sine, -dt_s * new_east_rate),
        (sine, cosine, dt_s * new_north_rate),
    )
    moved = np.empty_like(mean)
    moved[0] = jacobian[0] @ mean[0]
    moved[1] = (
        north + along * north_rate - across * east_rate,
        east + across * north_rate + along * east_rate,
        new_north_rate,
        new_east_rate,
        fade * turn_rate,
    )
    return Step(moved, jacobian, _noise(dt_s, fade, settings))


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


def _noise(dt_s: float, fade: float, settings: TrackSettings) -> Array:
    """White acceleration over dt: q · [dt³/3, dt²/2; dt²/2, dt], so that any report rate gives the same spread."""
    white = np.array([settings.steady_noise_m2_s3, settings.turning_noise_m2_s3])[:, None, None] * np.eye(2)
    noise = np.zeros((2, STATES, STATES))
    noise[:, :2, :2] = white * (dt_s**3 / 3.0)
    noise[:, :2, 2:4] = noise[:, 2:4, :2] = white * (dt_s**2 / 2.0)
    noise[:, 2:4, 2:4] = white * dt_s
    noise[:, 4, 4] = settings.turn_rate_sd_rad_s**2 * (1.0 - fade**2)
    return noise


class Modes(NamedTuple):
    """Both models' states (2, 5) and covariances (2, 5, 5), and the probability that the evader is turning."""

    mean: Array
    covariance: Array
    turning: float


class Innovation(NamedTuple):
    """The difference between a report and its prediction.

    Differences from both models (2, k); the expected covariances of both and of the mixture, and their inverses
    (3, k, k); the normalised innovation squared of the mixture, νᵀS⁻¹ν, which is χ² distributed with k degrees.
    """

    differences: Array
    expected: Array
    inverses: Array
    nis: float


def begin(measured: Array, noise: Array, settings: TrackSettings) -> Modes:
    """Both models from a first report of position (2,) or position and velocity (4,) with its covariance."""
    known = len(measured)
    mean = np.zeros(STATES)
    covariance = np.eye(STATES) * settings.prior_speed_sd_m_s**2
    mean[:known], covariance[:known, :known] = measured, noise
    covariance[4, 4] = settings.turn_rate_sd_rad_s**2
    turning = settings.turning_time_s / (settings.turning_time_s + settings.steady_time_s)
    return Modes(np.array([mean, mean]), np.array([covariance, covariance]), turning)


def advance_modes(modes: Modes, dt_s: float, settings: TrackSettings) -> Modes:
    """Mix both models and advance them by dt; for dt = 0 return the same modes."""
    if dt_s <= 0.0:
        return modes
    mixed = _mix(modes, dt_s, settings)
    moved = step(mixed.mean, dt_s, settings)
    covariance = moved.jacobian @ mixed.covariance @ moved.jacobian.transpose(0, 2, 1) + moved.noise
    return Modes(moved.mean, covariance, mixed.turning)


def compare(modes: Modes, measured: Array, noise: Array) -> Innovation:
    """Compare a report of position (2,) or position and velocity (4,) with both models and with their mixture."""
    known = len(measured)
    steady, turning = 1.0 - modes.turning, modes.turning
    differences = measured - modes.mean[:, :known]
    apart = differences[1] - differences[0]
    expected = np.empty((3, known, known))
    expected[:2] = modes.covariance[:, :known, :known] + noise
    expected[2] = steady * expected[0] + turning * expected[1] + (steady * turning * apart)[:, None] * apart
    inverses = cast("Array", np.linalg.inv(expected))
    mixed = steady * differences[0] + turning * differences[1]
    return Innovation(differences, expected, inverses, float(mixed @ inverses[2] @ mixed))


def correct(modes: Modes, innovation: Innovation) -> Modes:
    """Correct with a report that was compared with these modes."""
    differences, inverses = innovation.differences[:, :, None], innovation.inverses[:2]
    known = differences.shape[1]
    gain = modes.covariance[:, :, :known] @ inverses
    covariance = modes.covariance - gain @ modes.covariance[:, :known, :]
    covariance = 0.5 * (covariance + covariance.transpose(0, 2, 1))
    distance = (differences.transpose(0, 2, 1) @ (inverses @ differences))[:, 0, 0]
    steady, turning = (distance + np.log(np.linalg.det(innovation.expected[:2]))).tolist()
    mean = modes.mean + (gain @ differences)[:, :, 0]
    return Modes(mean, covariance, _posterior(modes.turning, 0.5 * (steady - turning)))


def combine(modes: Modes) -> tuple[Array, Array]:
    """Mean (5,) and covariance (5, 5) of the mixture."""
    steady, turning = 1.0 - modes.turning, modes.turning
    weights = np.array([steady, turning])
    apart = modes.mean[1] - modes.mean[0]
    spread = (steady * turning * apart)[:, None] * apart
    return weights @ modes.mean, (weights @ modes.covariance.reshape(2, -1)).reshape(STATES, STATES) + spread


def _mix(modes: Modes, dt_s: float, settings: TrackSettings) -> Modes:
    begins, ends = 1.0 / settings.steady_time_s, 1.0 / settings.turning_time_s
    gone = -math.expm1(-(begins + ends) * dt_s) / (begins + ends)
    was_steady, was_turning = 1.0 - modes.turning, modes.turning
    turning = was_steady * begins * gone + was_turning * (1.0 - ends * gone)
    to_steady = was_turning * ends * gone / (1.0 - turning)
    to_turning = was_turning * (1.0 - ends * gone) / turning
    weights = np.array([[1.0 - to_steady, to_steady], [1.0 - to_turning, to_turning]])

    mean, covariance = modes.mean.copy(), modes.covariance.copy()
    mean[0, 4] = mean[1, 4]
    covariance[0, 4, :] = covariance[0, :, 4] = 0.0
    covariance[0, 4, 4] = covariance[1, 4, 4]
    apart = mean[1] - mean[0]
    spread = np.array([[[(1.0 - to_steady) * to_steady]], [[(1.0 - to_turning) * to_turning]]]) * (
        apart[:, None] * apart
    )
    flat = weights @ covariance.reshape(2, -1)
    return Modes(weights @ mean, flat.reshape(covariance.shape) + spread, turning)


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
