"""The evader's height: a Kalman filter of two numbers, down and its rate, apart from the plane."""

from typing import NamedTuple


class Height(NamedTuple):
    """Down (m), its rate (m/s), and the three numbers of their covariance."""

    down_m: float
    rate_m_s: float
    down_variance: float
    shared: float
    rate_variance: float


def advance(height: Height, dt_s: float, noise_m2_s3: float) -> Height:
    """Move on by dt at a constant rate, with white vertical acceleration."""
    down, rate, variance, shared, rate_variance = height
    return Height(
        down + rate * dt_s,
        rate,
        variance + 2.0 * dt_s * shared + dt_s**2 * rate_variance + noise_m2_s3 * dt_s**3 / 3.0,
        shared + dt_s * rate_variance + noise_m2_s3 * dt_s**2 / 2.0,
        rate_variance + noise_m2_s3 * dt_s,
    )


def correct_down(height: Height, measured_m: float, variance_m2: float) -> Height:
    """Take in a measured height."""
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
    """Take in a measured vertical speed."""
    turned = Height(height.rate_m_s, height.down_m, height.rate_variance, height.shared, height.down_variance)
    rate, down, rate_variance, shared, variance = correct_down(turned, measured_m_s, variance_m2_s2)
    return Height(down, rate, variance, shared, rate_variance)
