"""Gusts and estimator errors: seeded, with the spread they claim."""

from random import Random

import numpy as np
import pytest

from sitl_mock.dynamics import PX4_WANDER, ZERO, Errors, gust_after


def run_wander(seed: int, steps: int, dt_s: float) -> tuple[np.ndarray, np.ndarray]:
    random = Random(seed)
    errors = Errors()
    places = []
    speeds = []
    for _ in range(steps):
        errors = PX4_WANDER.after(errors, random, dt_s)
        places.append(errors.position_ned_m)
        speeds.append(errors.velocity_ned_m_s)
    return np.array(places), np.array(speeds)


@pytest.mark.parametrize("dt_s", [0.2, 1.0])
def test_the_estimators_error_has_the_measured_spread_at_any_step(dt_s):
    """Catches errors that grow with the size of the step."""
    places, speeds = run_wander(1, round(8000 / dt_s), dt_s)
    assert places.std(axis=0) == pytest.approx([0.13, 0.21, 0.31], rel=0.12)
    assert speeds.std(axis=0) == pytest.approx([0.17, 0.30, 0.16], rel=0.12)


def test_position_error_and_integrated_velocity_error_part():
    places, speeds = run_wander(2, 750, 0.1)
    parted = np.abs(places[-1] - places[0] - speeds.sum(axis=0) * 0.1)
    assert parted.max() > 1.0


def test_a_seed_repeats_its_errors_and_another_does_not():
    assert np.array_equal(run_wander(3, 50, 0.1)[0], run_wander(3, 50, 0.1)[0])
    assert not np.array_equal(run_wander(3, 50, 0.1)[0], run_wander(4, 50, 0.1)[0])


@pytest.mark.parametrize("dt_s", [0.1, 0.5])
def test_gusts_have_the_claimed_spread_at_any_step(dt_s):
    random = Random(5)
    gust = ZERO
    seen = []
    for _ in range(round(4000 / dt_s)):
        gust = gust_after(gust, 1.5, random, dt_s, time_s=2.0)
        seen.append(gust)
    blown = np.array(seen)
    assert blown.mean(axis=0) == pytest.approx([0.0, 0.0, 0.0], abs=0.2)
    assert blown.std(axis=0) == pytest.approx([1.5, 1.5, 0.5], rel=0.1)
