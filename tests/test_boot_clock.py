"""The delay of telemetry, estimated from the vehicle's stamps and TIMESYNC, against links with a known delay."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.boot_clock import (
    LATE_TELEMETRY_S,
    LONGEST_DELAY_S,
    OFFSET_DRIFT,
    UNKNOWN_S,
    BootClock,
    with_answer,
    with_position,
)
from guidance.messages import Timesync

AHEAD_S = 1234.5
"""Our clock minus the vehicle's."""


def exchange(asked_s, up_s, down_s, ahead_s=AHEAD_S):
    """Return the answer to a question that took so long to the vehicle and back."""
    remote_ns = round((asked_s + up_s - ahead_s) * 1e9)
    return Timesync(asked_s + up_s + down_s, remote_ns, round(asked_s * 1e9))


def heard(clock, sent_s, down_s, ahead_s=AHEAD_S):
    """Add a position that the vehicle stamped when our clock said `sent_s`."""
    return with_position(clock, sent_s + down_s, sent_s - ahead_s)


delays = st.floats(0.0, 3.0)


@given(delays, delays, st.lists(delays, min_size=1))
def test_no_message_is_older_than_the_estimate_says_and_the_round_trip_bounds_it(
    up_s, least_s, ways
):
    clock = with_answer(BootClock(), exchange(100.0, up_s, least_s))
    for number, more_s in enumerate(ways):
        down_s = least_s + more_s
        clock = heard(clock, 101.0 + number, down_s)
        drift_s = OFFSET_DRIFT * (1.0 + number + down_s)  # since the only answer
        assert down_s - 1e-3 <= clock.delay_s <= down_s + up_s + drift_s + 1e-3


def test_an_offset_grows_old_and_the_delay_with_it():
    clock = with_answer(BootClock(), exchange(100.0, 0.0, 0.0))
    for silence_s in (10.0, 100.0, 1000.0):
        assert heard(clock, 100.0 + silence_s, 0.1).delay_s == pytest.approx(
            0.1 + OFFSET_DRIFT * (silence_s + 0.1), abs=1e-6
        )
    assert (
        heard(clock, 100.0 + 1.1 * LATE_TELEMETRY_S / OFFSET_DRIFT, 0.0).delay_s > LATE_TELEMETRY_S
    )


def test_a_constant_delay_shows_although_every_message_is_as_late_as_the_others():
    clock = BootClock()
    for second in range(10):
        clock = with_answer(clock, exchange(100.0 + second, 0.01, 1.5))
        clock = heard(clock, 100.5 + second, 1.5)
    assert 1.5 <= clock.delay_s < 1.52
    assert clock.is_late(112.0)


def test_a_growing_delay_shows_before_a_position_is_a_second_old():
    clock = with_answer(BootClock(), exchange(100.0, 0.02, 0.02))
    for cycle in range(1000):
        sent_s = 100.0 + 0.02 * cycle
        down_s = 0.3 * (sent_s - 100.0)
        clock = heard(clock, sent_s, down_s)
        if clock.is_late(sent_s + down_s):
            break
    assert LATE_TELEMETRY_S < down_s < 0.7


def test_without_an_answer_nothing_is_known():
    assert math.isnan(heard(BootClock(), 100.0, 0.0).delay_s)


def test_two_clocks_that_drift_apart_are_not_a_delay():
    clock = BootClock()
    for second in range(0, 36_000, 10):
        ahead_s = AHEAD_S + 1e-4 * second
        clock = with_answer(clock, exchange(100.0 + second, 0.02, 0.02, ahead_s))
        clock = heard(clock, 100.2 + second, 0.02, ahead_s)
        assert clock.delay_s < 0.05


def test_time_boot_ms_may_wrap():
    wrap_s = 2.0**32 / 1e3
    clock = with_answer(BootClock(), exchange(100.0, 0.02, 0.02, 100.0 - wrap_s))
    clock = with_position(clock, 100.5, 0.3)
    assert 0.19 < clock.delay_s < 0.23


def test_a_clock_that_was_set_is_unknown_until_the_next_answer():
    clock = heard(with_answer(BootClock(), exchange(100.0, 0.0, 0.0)), 100.1, 0.02)
    clock = heard(clock, 100.2, 0.02, AHEAD_S - 50.0)
    assert math.isnan(clock.delay_s)
    assert clock.is_late(100.22 + UNKNOWN_S)
    clock = with_answer(clock, exchange(100.3, 0.02, 0.02, AHEAD_S - 50.0))
    clock = heard(clock, 100.4, 0.02, AHEAD_S - 50.0)
    assert clock.delay_s < 0.05
    assert not clock.is_late(200.0)


@pytest.mark.parametrize("pace", [2.0, 5.0, 20.0])
def test_a_simulator_faster_than_real_time_is_named(pace):
    clock = BootClock()
    for cycle in range(400):
        now_s = 100.0 + 0.02 * cycle
        ahead_s = AHEAD_S - (pace - 1.0) * 0.02 * cycle
        if cycle % 12 == 0:
            clock = with_answer(clock, exchange(now_s, 0.002, 0.002, ahead_s))
        clock = heard(clock, now_s, 0.01, ahead_s)
    for _ in range(12):  # until a stamp contradicts the last answer
        now_s += 0.02
        ahead_s -= (pace - 1.0) * 0.02
        clock = heard(clock, now_s, 0.01, ahead_s)
    assert math.isnan(clock.delay_s)
    assert (
        clock.unknown_words == f"unknown: the vehicle's clock runs {pace:.1f} times as fast as ours"
    )
    assert BootClock().unknown_words == "unknown: TIMESYNC is not answered"


def test_a_simulator_that_paused_is_not_late():
    clock = heard(with_answer(BootClock(), exchange(100.0, 0.0, 0.0)), 100.1, 0.02)
    clock = heard(clock, 101.0, 0.02, AHEAD_S + 0.8)  # its clock stood still
    assert clock.delay_s > LATE_TELEMETRY_S
    assert not clock.is_late(101.1)
    clock = with_answer(clock, exchange(101.1, 0.0, 0.0, AHEAD_S + 0.8))
    assert heard(clock, 101.2, 0.02, AHEAD_S + 0.8).late_since_s == math.inf


@given(
    st.integers(-(2**63), 2**63 - 1), st.floats(0.0, 2.0**32 / 1e3), st.floats(0.0, 2.0**32 / 1e3)
)
def test_no_stamp_makes_a_delay_longer_than_a_link_can_be(remote_ns, first_s, last_s):
    clock = with_answer(BootClock(), Timesync(100.0, remote_ns, 100_000_000_000))
    for time_boot_s in (first_s, last_s):
        clock = with_position(clock, 100.1, time_boot_s)
        assert math.isnan(clock.delay_s) or 0.0 <= clock.delay_s <= LONGEST_DELAY_S
        assert math.isnan(clock.delay_s) or (clock.late_since_s == 100.1) == (
            clock.delay_s > LATE_TELEMETRY_S
        )
