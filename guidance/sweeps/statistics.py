"""The few statistics that a report needs: intervals for a probability, a mean, and differences of either."""

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CONFIDENCE: Final = 0.95
_Z: Final = NormalDist().inv_cdf(0.5 + CONFIDENCE / 2.0)
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(200)


class Interval(NamedTuple):
    """An estimate with its 95 % confidence interval. NaN is "not known"."""

    estimate: float
    low: float
    high: float


UNKNOWN: Final = Interval(math.nan, math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class Moments:
    """Count, mean and sum of squared deviations of numbers that came in parts.

    Parts are joined as Chan, Golub & LeVeque do ("Algorithms for computing the sample variance", 1983).
    """

    count: int = 0
    mean: float = 0.0
    squares: float = 0.0

    def joined(self, numbers: Array) -> Self:
        """Return these moments with more numbers; NaN is left out."""
        known = numbers[np.isfinite(numbers)]
        if not known.size:
            return self
        mean = float(known.mean())
        squares = float(np.sum((known - mean) ** 2))
        count = self.count + known.size
        apart = mean - self.mean
        return type(self)(
            count,
            self.mean + apart * known.size / count,
            self.squares + squares + apart**2 * self.count * known.size / count,
        )

    @property
    def variance(self) -> float:
        """Unbiased."""
        return self.squares / (self.count - 1) if self.count > 1 else math.nan


NONE: Final = Moments()


def share(successes: int, of: int) -> Interval:
    """Return a probability with Wilson's score interval (Wilson, 1927)."""
    if of == 0:
        return UNKNOWN
    p = successes / of
    scale = 1.0 / (1.0 + _Z**2 / of)
    centre = scale * (p + _Z**2 / (2.0 * of))
    half = scale * _Z * math.sqrt(p * (1.0 - p) / of + _Z**2 / (4.0 * of**2))
    # At a share of 0 or 1 rounding must not put an end beside it.
    return Interval(p, max(0.0, min(p, centre - half)), min(1.0, max(p, centre + half)))


def mean(moments: Moments) -> Interval:
    """Return a mean with Student's t interval."""
    if moments.count == 0:
        return UNKNOWN
    if moments.count == 1:
        return Interval(moments.mean, math.nan, math.nan)
    half = t_quantile(moments.count - 1) * math.sqrt(moments.variance / moments.count)
    return Interval(moments.mean, moments.mean - half, moments.mean + half)


def difference_of_means(a: Moments, b: Moments) -> Interval:
    """Return mean b − mean a of independent samples with Welch's t interval."""
    if min(a.count, b.count) < 2:
        return Interval(b.mean - a.mean, math.nan, math.nan) if a.count and b.count else UNKNOWN
    parts = a.variance / a.count, b.variance / b.count
    apart, error = b.mean - a.mean, math.sqrt(sum(parts))
    if error == 0.0:
        return Interval(apart, apart, apart)
    freedom = sum(parts) ** 2 / (parts[0] ** 2 / (a.count - 1) + parts[1] ** 2 / (b.count - 1))
    half = t_quantile(freedom) * error
    return Interval(apart, apart - half, apart + half)


def difference_of_shares(a: Interval, b: Interval) -> Interval:
    """Return share b − share a of independent samples, with Newcombe's interval (1998, method 10)."""
    apart = b.estimate - a.estimate
    low = math.hypot(b.estimate - b.low, a.high - a.estimate)
    high = math.hypot(b.high - b.estimate, a.estimate - a.low)
    return Interval(apart, apart - low, apart + high)


def t_quantile(freedom: float, probability: float = 0.5 + CONFIDENCE / 2.0) -> float:
    """Return the quantile above the median of Student's t distribution, by quadrature of its density and bisection."""
    low, high = 0.0, 1.0
    while _t_below(high, freedom) < probability:
        low, high = high, 2.0 * high
    while high - low > 1e-12 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _t_below(middle, freedom) < probability else (low, middle)
    return 0.5 * (low + high)


def _t_below(t: float, freedom: float) -> float:
    """Return the probability below t; with t = √ν tan θ the density is ∝ cos^(ν−1) θ, smooth also in heavy tails."""
    scale = math.lgamma(0.5 * (freedom + 1.0)) - math.lgamma(0.5 * freedom) - 0.5 * math.log(math.pi)
    end = math.atan(t / math.sqrt(freedom))
    angle = 0.5 * end * (_NODES + 1.0)
    density = np.exp(scale + (freedom - 1.0) * np.log(np.cos(angle)))
    return 0.5 + 0.5 * end * float(np.sum(_WEIGHTS * density))
