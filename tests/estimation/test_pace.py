"""Whether the stamps of an evader's reports come from a clock, and what is used instead."""

import math

import pytest

from guidance.estimation import Observer, add_report
from guidance.estimation.measurement import TrackSettings
from guidance.estimation.pace import PaceMemory, judge_pace
from guidance.estimation.track import ReportOutcome
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.messages import EvaderReport

FRAME = LocalFrame(47.0, 8.0, Amsl(488.0))
SETTINGS = TrackSettings(declared_speed_m_s=3.0)
RATE_HZ = 10.0
SPEED_M_S = 2.0

STRANGE = {
    "constant": lambda t: 12.345,
    "microseconds": lambda t: 1e3 * t,
    "seconds": lambda t: t / 1e3,
    "a counter": lambda t: round(RATE_HZ * t) / 1e3,
    "half speed": lambda t: 0.5 * t,
    "a little too slow": lambda t: 0.75 * t,
    "a little too fast": lambda t: 1.35 * t,
    "backwards": lambda t: 100.0 - t,
}
PLAUSIBLE = {
    "ours": lambda t: t,
    "Unix time": lambda t: 1.76e9 + t,
    "slow": lambda t: 0.85 * t,
    "fast": lambda t: 1.2 * t,
}


def paced(stamp, times_s, pace=None):
    pace = pace or PaceMemory()
    for time_s in times_s:
        pace = judge_pace(pace, stamp(time_s), time_s)
    return pace


def seconds(begin_s, end_s, rate_hz=RATE_HZ):
    return [begin_s + step / rate_hz for step in range(round((end_s - begin_s) * rate_hz))]


@pytest.mark.parametrize("name", STRANGE)
def test_a_strange_clock_is_given_up_within_five_seconds(name):
    for rate_hz in (1.0, 4.0, 10.0, 50.0):
        assert not paced(STRANGE[name], seconds(0.0, 5.0, rate_hz)).usable


@pytest.mark.parametrize("name", PLAUSIBLE)
def test_a_plausible_clock_is_used(name):
    for rate_hz in (0.5, 1.0, 10.0, 50.0):
        assert paced(PLAUSIBLE[name], seconds(0.0, 30.0, rate_hz)).usable


def test_a_restarted_sender_a_corrupt_stamp_and_a_burst_change_nothing():
    def restarted(time_s):
        return time_s if time_s < 7.0 else time_s - 7.0

    def corrupt(time_s):
        return 1e9 if time_s in {3.0, 7.0} else time_s

    assert paced(restarted, seconds(0.0, 20.0)).usable
    assert paced(restarted, seconds(5.0, 20.0)).usable
    assert paced(corrupt, seconds(0.0, 20.0)).usable
    pace = paced(lambda time_s: time_s, seconds(0.0, 3.0))
    for sent_s in seconds(3.0, 6.0):  # a queue delivers three seconds at once
        pace = judge_pace(pace, sent_s, 6.0 + 1e-4 * sent_s)
    assert paced(lambda time_s: time_s, seconds(6.1, 12.0), pace).usable


def test_a_delay_that_grows_is_not_taken_for_a_slow_clock_before_the_game_has_ended():
    pace = paced(lambda time_s: time_s, seconds(0.0, 5.0))
    assert pace.proven
    late = paced(lambda time_s: 5.0 + 0.7 * (time_s - 5.0), seconds(5.0, 14.0), pace)
    assert late.usable
    assert not paced(lambda time_s: 5.0 + 0.7 * (time_s - 5.0), seconds(5.0, 18.0), pace).usable


def test_a_clock_that_runs_well_again_is_used_again_after_a_while():
    broken = paced(STRANGE["constant"], seconds(0.0, 5.0))
    assert not paced(lambda time_s: time_s, seconds(5.0, 8.5), broken).usable
    assert paced(lambda time_s: time_s, seconds(5.0, 10.0), broken).usable


def report(time_s, sent_s):
    latitude, longitude, _ = FRAME.wgs84_from_ned(Ned((SPEED_M_S * time_s, 0.0, 0.0)))
    velocity = (SPEED_M_S, 0.0, 0.0)
    return EvaderReport(time_s, sent_s, "t", latitude, longitude, 488.0, Ned(velocity))


@pytest.mark.parametrize("name", ["constant", "half speed"])
def test_an_evader_with_a_strange_clock_is_followed_by_its_arrival_times(name):
    observer = Observer()
    for time_s in seconds(0.0, 8.0):
        observer = add_report(observer, report(time_s, STRANGE[name](time_s)), FRAME, SETTINGS)
    last = observer.track.history[-1]
    assert observer.track.outcome is ReportOutcome.ACCEPTED
    assert last.measurement.time_s == last.measurement.received_s
    assert observer.clock is None
    assert not math.isnan(observer.pace.rate)


def test_reports_without_a_stamp_are_not_judged():
    pace = paced(lambda _: math.nan, seconds(0.0, 10.0))
    assert pace == PaceMemory()
