"""The evader at a time: position, velocity, unknown values, and refused settings."""

import math
import random
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from guidance.estimation.track import ReportOutcome, Track, update
from tests.estimation.scenes import SETTINGS, measured, outcomes_of, predict, straight, tracked


def test_a_straight_course_is_followed_and_predicted_through_the_delay():
    reports = straight(50, delay_s=0.5)
    evader = predict(tracked(reports), 4.9 + 0.5, SETTINGS)
    assert evader.position_ned_m == pytest.approx(
        (10.0 + 5.4 * 3.0, 20.0 - 5.4, -1.0 + 5.4 * 0.2), abs=0.02
    )
    assert evader.velocity_ned_m_s == pytest.approx((3.0, -1.0, 0.2), abs=0.01)
    assert evader.age_s == pytest.approx(0.5)
    assert outcomes_of(reports) == {ReportOutcome.STARTED: 1, ReportOutcome.ACCEPTED: 49}


def test_age_is_since_the_report_was_true_and_not_since_it_arrived():
    evader = predict(tracked([measured(10.0, (0.0, 0.0, 0.0), received_s=10.7)]), 12.0, SETTINGS)
    assert evader.age_s == pytest.approx(2.0)
    assert predict(tracked([measured(10.0, (1.0, 2.0, 3.0))]), 9.0, SETTINGS).age_s == 0.0


def test_the_spread_grows_with_the_age():
    track = tracked(straight(50))
    spreads = [predict(track, 4.9 + age, SETTINGS) for age in (0.0, 0.5, 1.0, 3.0)]
    for before, after in pairwise(spreads):
        assert after.position_sd_m > before.position_sd_m
        assert after.velocity_sd_m_s > before.velocity_sd_m_s
        assert after.speed_bound_m_s >= before.speed_bound_m_s - 0.02


def test_an_unknown_velocity_is_not_a_velocity_of_zero():
    first = predict(tracked(straight(1, known=False)), 0.0, SETTINGS)
    assert not first.velocity_known
    assert first.speed_bound_m_s >= SETTINGS.sigmas * SETTINGS.prior_speed_sd_m_s
    observed = predict(tracked(straight(50, known=False)), 4.9, SETTINGS)
    assert observed.velocity_known
    assert observed.velocity_ned_m_s == pytest.approx((3.0, -1.0, 0.2), abs=0.05)
    told_zero = predict(tracked([measured(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))]), 0.0, SETTINGS)
    assert told_zero.velocity_known
    assert told_zero.speed_bound_m_s == 3.0


def test_the_speed_bound_is_the_larger_of_declared_and_estimate_plus_k_sigma():
    track = tracked(straight(50, seed=1))
    evader = predict(track, 5.0, SETTINGS)
    north, east, _ = evader.velocity_ned_m_s
    along = np.array([north, east]) / math.hypot(north, east)
    sigma = math.sqrt(along @ evader.covariance[2:, 2:] @ along)
    assert evader.speed_bound_m_s == pytest.approx(math.hypot(north, east) + 2.0 * sigma)
    assert predict(track, 5.0, replace(SETTINGS, declared_speed_m_s=9.0)).speed_bound_m_s == 9.0
    assert predict(track, 5.0, replace(SETTINGS, sigmas=5.0)).speed_bound_m_s == pytest.approx(
        math.hypot(north, east) + 5.0 * sigma
    )


@pytest.mark.parametrize(
    ("rate_hz", "known", "least_gain"), [(1.0, True, 2.0), (50.0, True, 4.0), (5.0, False, 2.0)]
)
def test_a_circling_evader_is_predicted_better_than_its_last_report(rate_hz, known, least_gain):
    """Catches an estimator that follows straight runs and is worse than the last report in a turn."""
    rng = random.Random(4)
    track = Track()
    ours = []
    last = []
    for step in range(round(60 * rate_hz)):
        time_s = step / rate_hz
        angle = 0.3 * time_s
        velocity = (-3.0 * math.sin(angle), 3.0 * math.cos(angle), 0.0)
        position = tuple(
            10.0 * part + rng.gauss(0.0, 0.3) for part in (math.cos(angle), math.sin(angle), 0.0)
        )
        said = tuple(v + rng.gauss(0.0, 0.1) for v in velocity) if known else None
        report = measured(
            time_s, position, said, received_s=time_s + 0.5, position_sd_m=0.3, velocity_sd_m_s=0.1
        )
        track = update(track, report, SETTINGS)
        if time_s > 20.0:
            now = 0.3 * (time_s + 0.5)
            truth = (10.0 * math.cos(now), 10.0 * math.sin(now))
            evader = predict(track, time_s + 0.5, SETTINGS)
            ours.append(math.dist(evader.position_ned_m[:2], truth))
            last.append(math.dist(position[:2], truth))
    assert math.sqrt(np.mean(np.square(last))) > least_gain * math.sqrt(np.mean(np.square(ours)))


def test_turns_are_distinguished_from_straight_courses_with_their_rate():
    rng = random.Random(5)
    tracks = {}
    for turn_rate in (0.5, 0.0):
        tracks[turn_rate] = Track()
        for step in range(80):
            time_s = 0.25 * step
            angle = turn_rate * 0.25 * step
            velocity = (4.0 * math.cos(angle), 4.0 * math.sin(angle), 0.0)
            radius = 4.0 / turn_rate if turn_rate else 0.0
            place = (
                (radius * math.sin(angle), -radius * math.cos(angle), 0.0)
                if turn_rate
                else (4.0 * time_s, 0.0, 0.0)
            )
            noisy = [
                tuple(part + rng.gauss(0.0, 0.05) for part in vector)
                for vector in (place, velocity)
            ]
            tracks[turn_rate] = update(
                tracks[turn_rate],
                measured(time_s, *noisy, position_sd_m=0.05, velocity_sd_m_s=0.05),
                SETTINGS,
            )
    turning, steady = (predict(tracks[rate], 19.75, SETTINGS) for rate in (0.5, 0.0))
    assert turning.turning > 0.9
    assert turning.turn_rate_rad_s == pytest.approx(0.5, abs=0.15)
    assert steady.turning < 0.3
