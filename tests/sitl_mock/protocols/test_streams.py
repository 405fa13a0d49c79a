"""Streams: the rates of the real links, and the requests that change them."""

import math
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl_mock.mavlink import SPEC_BY_NAME
from sitl_mock.protocols import (
    ARDUPILOT_HZ,
    ARDUPILOT_STREAM_RULES,
    PX4_GCS_HZ,
    PX4_ONBOARD_HZ,
    PX4_STREAM_RULES,
    Result,
    StreamRules,
    Streams,
)

OFFERED = frozenset(
    {*PX4_ONBOARD_HZ, "RC_CHANNELS", "AHRS2", "EKF_STATUS_REPORT", "VIBRATION", "POWER_STATUS"}
)


def message_id(name):
    return SPEC_BY_NAME[name].message_id


def rate_hz(streams, name):
    interval_us = streams.interval_us(message_id(name))
    return 1e6 / interval_us if interval_us > 0 else 0.0


def px4(hz=PX4_ONBOARD_HZ):
    return Streams(OFFERED, hz, PX4_STREAM_RULES)


def copter():
    return Streams(OFFERED, ARDUPILOT_HZ, ARDUPILOT_STREAM_RULES)


def count(streams, seconds, step_s=0.001, start_s=0.0):
    sent = Counter()
    for tick in range(1, round(seconds / step_s) + 1):
        sent.update(streams.due(start_s + tick * step_s))
    return sent


@pytest.mark.parametrize("hz", [PX4_ONBOARD_HZ, PX4_GCS_HZ])
def test_px4_sends_every_stream_at_the_measured_rate_without_being_asked(hz):
    sent = count(px4(hz), 20.0)
    assert set(sent) == set(hz)
    for name, rate in hz.items():
        assert sent[name] == pytest.approx(20.0 * rate, abs=1), name


def test_ardupilot_is_silent_but_for_the_heartbeat_until_it_is_asked():
    streams = copter()
    assert set(count(streams, 5.0)) <= {"HEARTBEAT", "TIMESYNC"}
    assert streams.set_interval(5.0, message_id("LOCAL_POSITION_NED"), 20_000) == Result.ACCEPTED
    sent = count(streams, 10.0, start_s=5.0)
    assert sent["LOCAL_POSITION_NED"] == pytest.approx(500, abs=1)
    assert sent["HEARTBEAT"] == 10


def test_a_heartbeat_leaves_at_the_first_cycle():
    assert "HEARTBEAT" in px4().due(0.0)


def test_the_first_sendings_are_spread_over_their_intervals():
    sent = [
        len(streams_due)
        for streams in [px4()]
        for streams_due in (streams.due(t * 0.001) for t in range(1000))
    ]
    assert max(sent) <= 6


@given(st.floats(0.5, 200.0), st.integers(0, 2**32))
def test_irregular_cycles_keep_the_mean_rate(hz, seed):
    import random

    rng = random.Random(seed)
    streams = Streams(OFFERED, {"ATTITUDE": hz}, PX4_STREAM_RULES)
    now_s = 0.0
    sent = 0
    while now_s < 20.0:
        now_s += rng.uniform(0.0005, 0.004)
        sent += len(streams.due(now_s))
    assert sent == pytest.approx(20.0 * hz, rel=0.02, abs=2)


def test_a_stall_is_not_made_up_for_by_a_burst_and_the_grid_stays():
    streams = Streams(OFFERED, {"HEARTBEAT": 10.0}, PX4_STREAM_RULES)
    assert streams.due(0.0) == ["HEARTBEAT"]
    assert streams.due(5.03) == ["HEARTBEAT"]
    assert streams.due(5.05) == []
    assert streams.due(5.1) == ["HEARTBEAT"]


def test_each_message_comes_at_most_once_in_a_cycle():
    streams = px4()
    for tick in range(100):
        due = streams.due(tick * 0.1)
        assert len(due) == len(set(due))


def test_the_heartbeat_of_px4_cannot_be_changed():
    streams = px4()
    assert streams.set_interval(0.0, 0, 100_000) == Result.FAILED
    assert streams.set_interval(0.0, 0, -1) == Result.FAILED
    assert rate_hz(streams, "HEARTBEAT") == 1.0
    assert copter().set_interval(0.0, 0, 500_000) == Result.ACCEPTED


def test_zero_is_the_default_and_minus_one_is_silence():
    streams = px4()
    attitude = message_id("ATTITUDE")
    assert streams.set_interval(0.0, attitude, -1) == Result.ACCEPTED
    assert (rate_hz(streams, "ATTITUDE"), streams.interval_us(attitude)) == (0.0, -1)
    assert count(streams, 2.0)["ATTITUDE"] == 0
    assert streams.set_interval(2.0, attitude, 0) == Result.ACCEPTED
    assert (rate_hz(streams, "ATTITUDE"), streams.interval_us(attitude)) == (100.0, 10_000)
    quiet = copter()
    quiet.set_interval(0.0, attitude, 10_000)
    quiet.set_interval(0.0, attitude, 0)
    assert quiet.interval_us(attitude) == -1


@pytest.mark.parametrize("interval_us", [math.nan, math.inf, -math.inf, -2.0, -1e30])
def test_an_interval_that_is_none_fails_and_changes_nothing(interval_us):
    streams = px4()
    assert streams.set_interval(0.0, message_id("ATTITUDE"), interval_us) == Result.FAILED
    assert rate_hz(streams, "ATTITUDE") == 100.0


def test_intervals_are_kept_within_the_flavours_limits():
    streams = copter()
    streams.set_interval(0.0, message_id("ATTITUDE"), 1)
    assert streams.interval_us(message_id("ATTITUDE")) == 1000
    streams.set_interval(0.0, message_id("ATTITUDE"), 10**9)
    assert streams.interval_us(message_id("ATTITUDE")) == 60_000_000
    patient = px4()
    assert patient.set_interval(0.0, message_id("ATTITUDE"), 3e38) == Result.ACCEPTED
    assert patient.interval_us(message_id("ATTITUDE")) < 2**31


@pytest.mark.parametrize("streams", [px4(), copter()])
@pytest.mark.parametrize("unknown", [message_id("GPS2_RAW"), 0xFFFFFF, -4])
def test_a_message_that_is_not_offered_is_refused_and_reported_as_not_available(streams, unknown):
    assert streams.set_interval(0.0, unknown, 10_000) == streams.rules.unknown_interval
    assert streams.interval_us(unknown) == 0


def test_a_changed_stream_starts_at_once_and_the_same_rate_again_changes_nothing():
    streams = px4()
    count(streams, 1.0)
    streams.set_interval(1.0, message_id("VFR_HUD"), 500_000)
    assert "VFR_HUD" in streams.due(1.0)
    streams.set_interval(1.1, message_id("VFR_HUD"), 500_000)
    assert "VFR_HUD" not in streams.due(1.1)
    assert count(streams, 10.0, start_s=1.1)["VFR_HUD"] == 20


def test_a_data_stream_of_ardupilot_sets_its_whole_group(wire):
    streams = copter()
    client = wire(streams)
    assert client.send("REQUEST_DATA_STREAM", 1, 1, 6, 10, 1) == []
    assert (rate_hz(streams, "GLOBAL_POSITION_INT"), rate_hz(streams, "LOCAL_POSITION_NED")) == (
        10.0,
        10.0,
    )
    assert rate_hz(streams, "ATTITUDE") == 0.0
    client.send("REQUEST_DATA_STREAM", 1, 1, 0, 4, 1)
    assert (rate_hz(streams, "ATTITUDE"), rate_hz(streams, "LOCAL_POSITION_NED")) == (4.0, 4.0)
    client.send("REQUEST_DATA_STREAM", 1, 1, 6, 10, 0)
    assert rate_hz(streams, "GLOBAL_POSITION_INT") == 0.0
    client.send("REQUEST_DATA_STREAM", 1, 1, 11, 1, 1)
    assert rate_hz(streams, "VFR_HUD") == 1.0
    client.send("REQUEST_DATA_STREAM", 1, 1, 11, 0, 1)
    assert rate_hz(streams, "VFR_HUD") == 0.0
    client.send("REQUEST_DATA_STREAM", 1, 1, 77, 10, 1)
    assert rate_hz(streams, "ATTITUDE") == 4.0
    assert client.wait(1.0) == []


def test_px4_ignores_data_streams(wire):
    streams = px4()
    client = wire(streams)
    client.send("REQUEST_DATA_STREAM", 1, 1, 0, 50, 1)
    assert {name: rate_hz(streams, name) for name in PX4_ONBOARD_HZ} == pytest.approx(
        PX4_ONBOARD_HZ, rel=1e-4
    )
    assert client.send("PING", 1, 1, 0, 0) == []


def test_names_of_the_rate_tables_are_messages_of_the_dialect():
    groups = [name for group in ARDUPILOT_STREAM_RULES.groups.values() for name in group]
    assert {*PX4_ONBOARD_HZ, *PX4_GCS_HZ, *ARDUPILOT_HZ, *groups} <= set(SPEC_BY_NAME)


def test_rates_of_messages_that_are_not_offered_are_left_out():
    streams = Streams(frozenset({"HEARTBEAT"}), PX4_ONBOARD_HZ, StreamRules())
    assert set(count(streams, 2.0)) == {"HEARTBEAT"}
