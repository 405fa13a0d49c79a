"""Estimate: what a track does with reports that are late, repeated, wild, absent or from elsewhere."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import chdtrc

from guidance.estimation.measurement import Measurement
from guidance.estimation.track import ReportOutcome, Track, update
from guidance.frames import Ned
from tests.estimation.scenes import (
    SETTINGS,
    measured,
    nis_of,
    outcomes_of,
    predict,
    straight,
    tracked,
)
from tests.harness.examples import drawn


@pytest.mark.parametrize(
    ("report", "outcome"),
    [
        (measured(5.0, (math.nan, 0.0, 0.0)), ReportOutcome.UNUSABLE),
        (measured(5.0, (0.0, 0.0, 0.0), (0.0, math.inf, 0.0)), ReportOutcome.UNUSABLE),
        (measured(math.nan, (0.0, 0.0, 0.0)), ReportOutcome.UNUSABLE),
        (measured(5.0, (0.0, 0.0, 0.0), received_s=math.nan), ReportOutcome.UNUSABLE),
        (measured(5.0, (0.0, 0.0, 0.0), position_sd_m=math.inf), ReportOutcome.UNUSABLE),
        (measured(5.0, (0.0, 0.0, 0.0), position_sd_m=0.0), ReportOutcome.UNUSABLE),
        (measured(5.0, (0.0, 0.0, 0.0), velocity_sd_m_s=-1.0), ReportOutcome.UNUSABLE),
        (measured(5.0, (0.0, 0.0, 0.0), position_sd_m=1e-3), ReportOutcome.UNUSABLE),
        (measured(5.0, (0.0, 0.0, 0.0), velocity_sd_m_s=1e5), ReportOutcome.UNUSABLE),
        (measured(5.0, (25.0, 1e9, 0.0)), ReportOutcome.UNUSABLE),
        (measured(5.0, (25.0, 15.0, 0.0), (60.0, 10.0, 0.0)), ReportOutcome.IMPLAUSIBLE),
        (measured(5.0, (25.0, 15.0, 0.0), received_s=7.1), ReportOutcome.STALE),
        (measured(5.0, (25.0, 15.0, 0.0), received_s=4.7), ReportOutcome.FUTURE),
        (measured(4.9, (24.7, 15.1, 0.0), received_s=5.0), ReportOutcome.DUPLICATE),
        (measured(4.85, (24.7, 15.1, 0.0), received_s=5.0), ReportOutcome.REORDERED),
        (measured(3.5, (20.5, 16.5, 0.0), received_s=5.0), ReportOutcome.DUPLICATE),
        (measured(1.0, (13.0, 19.0, 0.0), received_s=2.5), ReportOutcome.TOO_OLD),
        (measured(5.0, (80.0, 15.0, 0.0)), ReportOutcome.OUTLIER),
        (measured(4.75, (90.0, 0.0, 0.0), received_s=5.0), ReportOutcome.OUTLIER),
        (measured(5.0, (25.0, 15.0, 0.0), (-30.0, 0.0, 0.0)), ReportOutcome.OUTLIER),
        (measured(5.0, (25.0, 15.0, 0.0), (3.0, -1.0, 0.0)), ReportOutcome.ACCEPTED),
    ],
)
def test_every_report_has_its_outcome(report, outcome):
    before = tracked(straight(50))
    after = update(before, report, SETTINGS)
    assert after.outcome is outcome
    if outcome not in list(ReportOutcome)[:5]:  # the others changed nothing
        assert after.estimate is before.estimate
    else:
        assert after.estimate is not before.estimate


@pytest.mark.parametrize(
    ("report", "outcome"),
    [
        (measured(0.0, (math.nan, 0.0, 0.0)), ReportOutcome.UNUSABLE),
        (measured(0.0, (0.0, 0.0, 0.0), received_s=9.0), ReportOutcome.STALE),
    ],
)
def test_a_first_report_that_is_no_good_starts_nothing(report, outcome):
    track = update(Track(), report, SETTINGS)
    assert (track.outcome, track.estimate) == (outcome, None)


@settings(max_examples=drawn(25), deadline=None)
@given(st.integers(0, 1000), st.permutations(range(6)))
def test_reports_out_of_order_end_in_the_estimate_of_reports_in_order(seed, order):
    reports = straight(30, seed=seed)
    shuffled = (
        reports[:20]
        + [reports[20 + index]._replace(received_s=2.6) for index in order]
        + reports[26:]
    )
    in_order = (
        reports[:20] + [report._replace(received_s=2.6) for report in reports[20:26]] + reports[26:]
    )
    one = predict(tracked(shuffled), 3.0, SETTINGS)
    other = predict(tracked(in_order), 3.0, SETTINGS)
    assert one.position_ned_m == pytest.approx(other.position_ned_m)
    assert one.velocity_ned_m_s == pytest.approx(other.velocity_ned_m_s)
    assert one.covariance == pytest.approx(other.covariance)
    assert one.age_s == pytest.approx(other.age_s)


@settings(max_examples=drawn(25), deadline=None)
@given(st.integers(0, 1000), st.integers(1, 29))
def test_a_duplicated_report_counts_once(seed, index):
    reports = straight(30, seed=seed)
    twice = [
        *reports[: index + 1],
        reports[index]._replace(received_s=reports[index].time_s + 0.05),
        *reports[index + 1 :],
    ]
    once = tracked(reports)
    again = tracked(twice)
    assert outcomes_of(twice) == {**outcomes_of(reports), ReportOutcome.DUPLICATE: 1}
    assert predict(again, 3.5, SETTINGS).covariance == pytest.approx(
        predict(once, 3.5, SETTINGS).covariance
    )


@settings(max_examples=drawn(25), deadline=None)
@given(
    st.integers(0, 1000), st.floats(-math.pi, math.pi), st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)
)
def test_the_estimate_turns_and_moves_with_the_world(seed, angle, north, east):
    cosine = math.cos(angle)
    sine = math.sin(angle)

    def turned(vector, by=(0.0, 0.0)):
        return (
            cosine * vector[0] - sine * vector[1] + by[0],
            sine * vector[0] + cosine * vector[1] + by[1],
            vector[2],
        )

    reports = straight(25, seed=seed, rate_hz=4.0)
    moved = [
        report._replace(
            position_ned_m=turned(report.position_ned_m, (north, east)),
            velocity_ned_m_s=turned(report.velocity_ned_m_s),
        )
        for report in reports
    ]
    here = predict(tracked(reports), 6.5, SETTINGS)
    there = predict(tracked(moved), 6.5, SETTINGS)
    assert there.position_ned_m == pytest.approx(
        turned(here.position_ned_m, (north, east)), abs=1e-6
    )
    assert there.velocity_ned_m_s == pytest.approx(turned(here.velocity_ned_m_s), abs=1e-6)
    for name in (
        "speed_bound_m_s",
        "position_sd_m",
        "velocity_sd_m_s",
        "turning",
        "turn_rate_rad_s",
    ):
        assert getattr(there, name) == pytest.approx(getattr(here, name), abs=1e-6)


@settings(max_examples=drawn(30), deadline=None)
@given(st.floats(0.0, 1e6))
def test_the_estimate_knows_no_beginning_of_time(start_s):
    reports = straight(20, seed=9)
    later = [
        report._replace(time_s=report.time_s + start_s, received_s=report.received_s + start_s)
        for report in reports
    ]
    here = predict(tracked(reports), 2.5, SETTINGS)
    there = predict(tracked(later), 2.5 + start_s, SETTINGS)
    assert there.position_ned_m == pytest.approx(here.position_ned_m, abs=1e-6)
    assert there.covariance == pytest.approx(here.covariance, abs=1e-6)


numbers = st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.floats(-100.0, 100.0))
vectors = st.tuples(numbers, numbers, numbers).map(Ned)
spreads = numbers | st.sampled_from([0.01, 0.5, 1e4])
wild = st.builds(Measurement, numbers, numbers, vectors, st.none() | vectors, spreads, spreads)
near = st.builds(
    lambda time_s, position, velocity, *sds: Measurement(
        time_s, time_s + 0.1, position, velocity, *sds
    ),
    st.floats(0.0, 4.0),
    st.tuples(*[st.floats(-1e4, 1e4)] * 3).map(Ned),
    st.none() | st.tuples(*[st.floats(-30.0, 30.0)] * 3).map(Ned),
    st.sampled_from([0.01, 0.5, 1e4]),
    st.sampled_from([0.01, 0.5, 1e4]),
)


@settings(max_examples=drawn(150), deadline=None)
@given(st.lists(wild | near | st.sampled_from(straight(40, seed=3)), max_size=25))
def test_no_reports_at_all_break_a_track(reports):
    track = tracked(reports)
    assert (track.outcome is None) is (not reports)
    evader = predict(track, 5.0, SETTINGS)
    if evader is not None:
        assert all(
            map(
                math.isfinite,
                (*evader.position_ned_m, *evader.velocity_ned_m_s, evader.speed_bound_m_s),
            )
        )
        assert (
            np.linalg.eigvalsh(evader.covariance).min()
            >= -1e-6 * np.linalg.eigvalsh(evader.covariance).max()
        )


def test_a_single_outlier_moves_nothing():
    track = tracked(straight(50))
    far = measured(5.0, (500.0, 0.0, 0.0), (3.0, -1.0, 0.2))
    wild_one = update(track, far, SETTINGS)
    assert wild_one.outcome is ReportOutcome.OUTLIER
    assert nis_of(track, far, SETTINGS) > 33.38
    back = update(wild_one, measured(5.1, (25.3, 14.9, 0.02), (3.0, -1.0, 0.2)), SETTINGS)
    assert back.outcome is ReportOutcome.ACCEPTED
    assert back.rival is None


@pytest.mark.parametrize("known", [True, False])
def test_a_jump_is_believed_once_three_reports_agree_on_it(known):
    track = tracked(straight(50, known=known))
    outcomes = []
    for step in range(5):
        time_s = 5.0 + 0.1 * step
        velocity = (0.0, 2.0, 0.0) if known else None
        track = update(track, measured(time_s, (300.0, 2.0 * time_s, 0.0), velocity), SETTINGS)
        outcomes.append(track.outcome)
    assert outcomes == [
        ReportOutcome.OUTLIER,
        ReportOutcome.OUTLIER,
        ReportOutcome.JUMPED,
        ReportOutcome.ACCEPTED,
        ReportOutcome.ACCEPTED,
    ]
    assert predict(track, 5.4, SETTINGS).position_ned_m[:2] == pytest.approx((300.0, 10.8), abs=0.3)


def test_at_one_report_a_second_two_that_agree_are_enough():
    track = tracked(straight(20, rate_hz=1.0))
    outcomes = []
    for time_s in (20.0, 21.0, 22.0):
        track = update(
            track, measured(time_s, (300.0, 2.0 * time_s, 0.0), (0.0, 2.0, 0.0)), SETTINGS
        )
        outcomes.append(track.outcome)
    assert outcomes == [ReportOutcome.OUTLIER, ReportOutcome.JUMPED, ReportOutcome.ACCEPTED]


@pytest.mark.parametrize(("known", "gate"), [(False, 27.63), (True, 33.38)])
def test_the_gate_is_chi_square_at_one_in_a_million(known, gate):
    assert chdtrc(4 if known else 2, gate) == pytest.approx(1e-6, rel=0.01)
    track = tracked(straight(50, known=known))
    judged = {}
    for offset_m in np.linspace(0.0, 6.0, 121):
        place = (25.0 + offset_m, 15.0, 0.0)
        one = measured(5.0, place, (3.0, -1.0, 0.2) if known else None)
        judged[nis_of(track, one, SETTINGS)] = update(track, one, SETTINGS).outcome
    assert all(
        (outcome is ReportOutcome.OUTLIER) == (nis > gate) for nis, outcome in judged.items()
    )
    assert set(judged.values()) == {ReportOutcome.ACCEPTED, ReportOutcome.OUTLIER}


@settings(max_examples=drawn(50), deadline=None)
@given(
    st.sampled_from([1.0, 4.0, 10.0]),
    st.floats(0.0, 1.0),
    st.floats(-math.pi, math.pi),
    st.floats(0.0, 3.0),
)
def test_an_evader_may_turn_or_stop_at_once_between_two_reports(rate_hz, kept, course, speed_m_s):
    exact = {"position_sd_m": 0.05, "velocity_sd_m_s": 0.03}
    reports = straight(12, rate_hz=rate_hz, velocity=(3.0, 0.0, 0.0))
    track = tracked([report._replace(**exact) for report in reports])
    velocity = (speed_m_s * math.cos(course), speed_m_s * math.sin(course), 0.0)
    time_s = 12.0 / rate_hz
    before_s = (11.0 + kept) / rate_hz
    after_s = time_s - before_s
    turned = (10.0 + 3.0 * before_s + velocity[0] * after_s, 20.0 + velocity[1] * after_s, -1.0)
    after = update(track, measured(time_s, turned, velocity, **exact), SETTINGS)
    assert after.outcome is ReportOutcome.ACCEPTED
    evader = predict(after, time_s, SETTINGS)
    assert evader.velocity_ned_m_s[:2] == pytest.approx(velocity[:2], abs=0.2)
    # Nothing brings it 2 m back
    behind = (10.0 + 3.0 * 11.0 / rate_hz - 2.0, 20.0, -1.0)
    refused = update(track, measured(time_s, behind, (0.0, 0.0, 0.0), **exact), SETTINGS)
    assert refused.outcome is ReportOutcome.OUTLIER


def test_outliers_that_do_not_agree_never_take_over():
    track = tracked(straight(50))
    for step in range(12):
        place = (1000.0 * (-1.0) ** step, 500.0 * step, 0.0)
        track = update(track, measured(5.0 + 0.1 * step, place, (0.0, 0.0, 0.0)), SETTINGS)
        assert track.outcome is ReportOutcome.OUTLIER
    assert predict(track, 6.1, SETTINGS).position_ned_m == pytest.approx(
        (28.3, 13.9, 0.22), abs=0.05
    )


def test_a_good_report_between_outliers_ends_the_rival():
    track = tracked(straight(50))
    for step in range(10):
        good = step % 2 == 1
        time_s = 5.0 + 0.1 * step
        place = (
            (10.0 + 3.0 * time_s, 20.0 - time_s, -1.0 + 0.2 * time_s) if good else (300.0, 0.0, 0.0)
        )
        track = update(
            track, measured(time_s, place, (3.0, -1.0, 0.2) if good else (0.0, 0.0, 0.0)), SETTINGS
        )
        assert track.outcome is not ReportOutcome.JUMPED


def test_after_a_long_silence_the_track_starts_anew():
    track = tracked(straight(50))
    found = update(track, measured(20.0, (400.0, 0.0, 0.0)), SETTINGS)
    assert found.outcome is ReportOutcome.REACQUIRED
    assert not predict(found, 20.0, SETTINGS).velocity_known
    assert len(found.history) == 1


def test_a_report_that_no_longer_fits_once_an_earlier_one_is_known_is_left_out():
    # Without velocities the second report could be anything; a late first witness shows that it was wild.
    options = replace(SETTINGS, history_s=10.0)
    reports = [measured(0.0, (0.0, 0.0, 0.0)), measured(3.0, (60.0, 0.0, 0.0))]
    begun = tracked(reports, options)
    assert outcomes_of(reports, options) == {ReportOutcome.STARTED: 1, ReportOutcome.ACCEPTED: 1}
    late = update(
        begun,
        measured(2.9, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), received_s=3.1, velocity_sd_m_s=0.05),
        options,
    )
    assert late.outcome is ReportOutcome.REORDERED
    assert [one.measurement.time_s for one in late.history] == [0.0, 2.9]


def test_the_memory_reaches_back_as_far_as_it_says():
    track = tracked(straight(200))
    times = [one.measurement.time_s for one in track.history]
    assert times == sorted(times)
    assert times[0] == pytest.approx(19.9 - SETTINGS.history_s)
    assert len(tracked(straight(200), replace(SETTINGS, history_s=0.0)).history) == 1
