"""The few statistics that a report needs: intervals for a probability, a mean, and differences of either."""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]

CONFIDENCE: Final = 0.95


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
    found = stats.binomtest(successes, of).proportion_ci(CONFIDENCE, method="wilson")
    return Interval(successes / of, float(found.low), float(found.high))


def mean(moments: Moments) -> Interval:
    """Return a mean with Student's t interval."""
    if moments.count == 0:
        return UNKNOWN
    if moments.count == 1:
        return Interval(moments.mean, math.nan, math.nan)
    half = _student(moments.count - 1) * math.sqrt(moments.variance / moments.count)
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
    half = _student(freedom) * error
    return Interval(apart, apart - half, apart + half)


def difference_of_shares(a: Interval, b: Interval) -> Interval:
    """Return share b − share a of independent samples, with Newcombe's interval (1998, method 10)."""
    apart = b.estimate - a.estimate
    low = math.hypot(b.estimate - b.low, a.high - a.estimate)
    high = math.hypot(b.high - b.estimate, a.estimate - a.low)
    return Interval(apart, apart - low, apart + high)


def _student(freedom: float) -> float:
    """Half the width of the interval, in standard errors (Student, 1908)."""
    return float(stats.t.ppf(0.5 + CONFIDENCE / 2.0, freedom))
