"""Estimate: a sender's clock told from ours under delay, jitter, drift, reboot and lies; and reports off the wire."""

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.estimation import Observer, add_report
from guidance.estimation.measurement import ClockOffset, TrackSettings, hear, synchronise
from guidance.estimation.track import ReportOutcome
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.messages import EvaderReport, Timesync
from tests.estimation.scenes import predict

SETTINGS = TrackSettings(declared_speed_m_s=3.0)
FRAME = LocalFrame(47.0, 8.0, Amsl(400.0))


def heard(pairs, clock=None):
    for sent_s, received_s in pairs:
        clock = hear(clock, sent_s, received_s)
    return clock


def late(
    rng, count, *, rate_hz=10.0, offset_s=1000.0, drift=0.0, least_s=0.05, jitter_s=0.2, start_s=0.0
):
    """(sent, received) with an exponential delay; the sender's clock gains by the drift."""
    for step in range(count):
        true_s = start_s + step / rate_hz
        delay_s = least_s + min(0.8, rng.expovariate(1.0 / jitter_s))
        yield (true_s - offset_s + drift * true_s, true_s + delay_s)


def test_the_least_delay_seen_is_the_offset():
    clock = heard(late(random.Random(1), 300))
    assert clock.offset_s == pytest.approx(1000.05, abs=0.01)
    assert clock.ours(5.0) == 5.0 + clock.offset_s
    assert not clock.measured


@settings(deadline=None)
@given(st.lists(st.floats(0.0, 0.9), min_size=1, max_size=40), st.floats(-1e6, 1e6))
def test_no_report_is_later_than_its_arrival_and_the_offset_is_a_bound(delays, offset):
    clock = None
    for step, delay_s in enumerate(delays):
        clock = hear(clock, 0.1 * step, 0.1 * step + offset + delay_s)
        assert clock.ours(0.1 * step) <= 0.1 * step + offset + delay_s + 1e-6
        assert clock.offset_s >= offset - 1e-6
    assert clock.offset_s <= offset + min(delays) + 2e-4 * 0.1 * len(delays) + 1e-3


@pytest.mark.parametrize("drift", [1e-4, -1e-4])
def test_drift_of_a_hundred_ppm_is_followed_for_ten_minutes(drift):
    rng = random.Random(2)
    pairs = list(late(rng, 6000, drift=drift))
    clock = heard(pairs)
    truth = 1000.0 - drift * 600.0
    assert clock.offset_s == pytest.approx(truth + 0.05, abs=0.02)


def test_a_round_trip_measures_the_offset_without_the_delay():
    clock = synchronise(None, remote_s=50.0, asked_s=1049.98, answered_s=1050.06)
    assert clock.offset_s == pytest.approx(1000.02)
    assert clock.measured
    assert hear(clock, 50.5, 1050.95).offset_s == pytest.approx(1000.02)
    # No report comes before it was sent
    assert hear(clock, 50.5, 1050.51).offset_s == pytest.approx(1000.01)


def test_the_shortest_round_trip_is_kept_until_it_is_old():
    short = synchronise(None, 50.0, 1050.0, 1050.01)
    assert synchronise(short, 51.0, 1051.0, 1051.4) == short
    assert synchronise(short, 51.0, 1051.0, 1051.008).round_trip_s == pytest.approx(0.008)
    assert synchronise(short, 90.0, 1090.0, 1090.4).round_trip_s == pytest.approx(0.4)
    # The sender started anew
    assert synchronise(short, 20.0, 1051.0, 1051.4).offset_s == pytest.approx(1031.2)


@pytest.mark.parametrize(
    ("remote_s", "asked_s", "answered_s"),
    [
        (50.0, 1050.0, 1049.0),
        (50.0, 1050.0, 1052.0),
        (math.nan, 1050.0, 1050.1),
        (50.0, -math.inf, 1050.1),
    ],
)
def test_a_round_trip_that_cannot_be_changes_nothing(remote_s, asked_s, answered_s):
    assert synchronise(None, remote_s, asked_s, answered_s) is None
    known = ClockOffset(3.0, 1.0)
    assert synchronise(known, remote_s, asked_s, answered_s) is known


def test_times_that_are_no_numbers_change_nothing():
    known = ClockOffset(3.0, 1.0)
    for sent_s, received_s in ((math.nan, 1.0), (1.0, math.nan), (math.inf, 1.0)):
        assert hear(known, sent_s, received_s) is known
        assert hear(None, sent_s, received_s) is None


@pytest.mark.parametrize("lie_s", [-500.0, -3.0, 3.0, 1e6])
def test_a_single_false_time_does_not_move_the_clock(lie_s):
    clock = heard(late(random.Random(3), 100))
    lied = hear(clock, 10.0 - 1000.0 + lie_s, 10.1)
    assert lied.offset_s == clock.offset_s
    after = heard(late(random.Random(4), 50, start_s=10.2), lied)
    assert after.offset_s == pytest.approx(clock.offset_s, abs=0.02)
    assert after.candidate_reports == 0


def test_a_burst_that_waited_in_a_queue_does_not_move_the_clock():
    clock = heard(late(random.Random(5), 100))
    burst = [(10.0 + 0.02 * step - 1000.0, 13.0 + 1e-4 * step) for step in range(90)]
    assert heard(burst, clock).offset_s == pytest.approx(clock.offset_s, abs=0.01)


def test_a_sender_that_restarts_is_believed_after_a_second():
    clock = heard(late(random.Random(6), 100))
    restarted = list(late(random.Random(7), 30, offset_s=5000.0, start_s=10.0, jitter_s=0.02))
    assert heard(restarted[:9], clock).offset_s == clock.offset_s
    assert heard(restarted, clock).offset_s == pytest.approx(5000.05, abs=0.02)


def test_lies_that_differ_are_never_believed():
    clock = heard(late(random.Random(8), 100))
    lies = [(-3000.0 + 40.0 * step, 10.0 + 0.5 * step) for step in range(20)]
    assert heard(lies, clock).offset_s == clock.offset_s


def wire_report(
    *,
    received_s,
    sent_s=math.nan,
    north_m=0.0,
    amsl_m=405.0,
    velocity=(math.nan, math.nan, math.nan),
    position_sd_m=math.nan,
    velocity_sd_m_s=math.nan,
):
    latitude, longitude, _ = FRAME.wgs84_from_ned(Ned((north_m, 0.0, 0.0)))
    return EvaderReport(
        received_s,
        sent_s,
        "test",
        latitude,
        longitude,
        amsl_m,
        Ned(velocity),
        position_sd_m,
        velocity_sd_m_s,
    )


def test_a_report_off_the_wire_ends_in_local_metres_on_our_clock():
    observer = Observer()
    assert predict(observer.track, 0.0, SETTINGS) is None
    for step in range(40):
        delay_s = 0.1 if step % 4 else 0.02
        report = wire_report(
            received_s=100.0 + 0.1 * step + delay_s,
            sent_s=7.0 + 0.1 * step,
            north_m=0.3 * step,
            velocity=(3.0, 0.0, 0.0),
        )
        observer = add_report(observer, report, FRAME, SETTINGS)
    evader = predict(observer.track, 104.0, SETTINGS)
    # The sender's 7 s are our 100.02 s, as far as reports can tell.
    assert evader.position_ned_m == pytest.approx((3.0 * (104.0 - 100.02), 0.0, -5.0), abs=0.02)
    assert evader.age_s == pytest.approx(104.0 - (100.02 + 3.9), abs=1e-3)


def test_a_report_was_true_when_it_arrived_and_with_a_timesync_when_it_was_sent():
    for sent_s, measured_clock, true_s in (
        (math.nan, False, 100.0),
        (7.0, False, 100.0),
        (7.0, True, 99.41),
    ):
        answer = (
            Timesync(100.0, remote_ns=round(7.58e9), local_ns=round(99.98e9))
            if measured_clock
            else None
        )
        report = wire_report(received_s=100.0, sent_s=sent_s)._replace(timesync=answer)
        observer = add_report(Observer(), report, FRAME, SETTINGS)
        assert observer.track.estimate.time_s == pytest.approx(true_s)


def test_spreads_that_are_given_are_used_and_the_others_are_the_settings():
    told = add_report(Observer(), wire_report(received_s=0.0, position_sd_m=0.2), FRAME, SETTINGS)
    silent = add_report(
        Observer(), wire_report(received_s=0.0, position_sd_m=-1.0), FRAME, SETTINGS
    )
    assert predict(told.track, 0.0, SETTINGS).position_sd_m == pytest.approx(0.2)
    assert predict(silent.track, 0.0, SETTINGS).position_sd_m == pytest.approx(
        SETTINGS.position_sd_m
    )
    moving = wire_report(received_s=0.0, velocity=(1.0, 0.0, 0.0), velocity_sd_m_s=0.1)
    assert predict(
        add_report(Observer(), moving, FRAME, SETTINGS).track, 0.0, SETTINGS
    ).velocity_sd_m_s == pytest.approx(0.1)


def test_very_small_spreads_are_raised():
    boasting = wire_report(
        received_s=0.0, velocity=(1.0, 0.0, 0.0), position_sd_m=1e-9, velocity_sd_m_s=1e-9
    )
    evader = predict(add_report(Observer(), boasting, FRAME, SETTINGS).track, 0.0, SETTINGS)
    assert (evader.position_sd_m, evader.velocity_sd_m_s) == pytest.approx((0.01, 0.01))


def test_a_velocity_of_which_a_part_is_unknown_is_unknown():
    partly = wire_report(received_s=0.0, velocity=(3.0, 0.0, math.nan))
    assert not predict(
        add_report(Observer(), partly, FRAME, SETTINGS).track, 0.0, SETTINGS
    ).velocity_known


@pytest.mark.parametrize(
    "report", [wire_report(received_s=0.0, amsl_m=math.nan), wire_report(received_s=math.nan)]
)
def test_a_report_that_says_no_number_is_dropped(report):
    observer = add_report(Observer(), report, FRAME, SETTINGS)
    assert observer.track.outcome is ReportOutcome.UNUSABLE
    assert observer.track.estimate is None
