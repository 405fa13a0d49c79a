import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from guidance.sweeps.statistics import (
    NONE,
    difference_of_means,
    difference_of_shares,
    mean,
    share,
)


@given(st.integers(1, 10**6).flatmap(lambda of: st.tuples(st.integers(0, of), st.just(of))))
def test_the_interval_of_a_share_is_wilsons(counts):
    successes, of = counts
    expected = stats.binomtest(successes, of).proportion_ci(method="wilson")
    found = share(successes, of)
    assert found.estimate == successes / of
    assert found.low == pytest.approx(max(0.0, expected.low), abs=1e-12)
    assert found.high == pytest.approx(min(1.0, expected.high), abs=1e-12)
    assert 0.0 <= found.low <= found.estimate <= found.high <= 1.0


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=40), st.integers(1, 39))
def test_moments_of_parts_are_those_of_the_whole(numbers, cut):
    whole = np.array(numbers)
    moments = NONE.joined(whole[:cut]).joined(whole[cut:])
    assert moments.count == whole.size
    assert moments.mean == pytest.approx(whole.mean(), abs=1e-9)
    assert moments.variance == pytest.approx(whole.var(ddof=1), rel=1e-9, abs=1e-9)


def test_what_is_not_known_is_left_out_of_moments():
    assert NONE.joined(np.array([1.0, math.nan, 3.0])).mean == 2.0
    assert math.isnan(mean(NONE).estimate)
    assert math.isnan(share(0, 0).low)
    assert math.isnan(mean(NONE.joined(np.array([4.0]))).low)


def test_the_interval_of_a_mean_is_students():
    numbers = np.random.default_rng(0).exponential(size=50)
    low, high = stats.t.interval(0.95, 49, numbers.mean(), stats.sem(numbers))
    found = mean(NONE.joined(numbers))
    assert (found.low, found.high) == pytest.approx((low, high))


def test_the_interval_of_a_difference_of_means_is_welchs():
    rng = np.random.default_rng(1)
    a, b = rng.normal(0.0, 1.0, 30), rng.normal(0.5, 3.0, 12)
    expected = stats.ttest_ind(b, a, equal_var=False).confidence_interval()
    found = difference_of_means(NONE.joined(a), NONE.joined(b))
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))


def test_the_interval_of_a_difference_of_shares_is_newcombes_published_example():
    """Newcombe, "Interval estimation for the difference between independent proportions", 1998, table II (a)."""
    found = difference_of_shares(share(48, 80), share(56, 70))
    assert (found.estimate, found.low, found.high) == pytest.approx((0.2, 0.0524, 0.3339), abs=5e-5)
