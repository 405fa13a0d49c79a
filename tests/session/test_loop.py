"""The loop: its time grid and the arrival of positions, signals, work left for idle time, and processor time."""

import errno
import gc
import math
import os
import signal
import sys
import threading
from itertools import pairwise
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from guidance.clock import VirtualClock
from guidance.flight import Event
from guidance.links.wires.base import CapturedFrame
from guidance.log.writer import Recorder
from guidance.session.fly.loop import (
    AGE_S,
    MOST_NUDGE_S,
    PERIOD_S,
    SWITCH_S,
    Signals,
    claim,
    next_due,
    nudge_s,
    run,
)
from guidance.session.observe.metrics import Metrics
from guidance.session.observe.recording import Recording


@given(st.floats(0.0, 1e5), st.floats(0.0, 3.0))
def test_the_next_cycle_is_on_the_grid_still_to_come_and_no_more_than_a_period_away(due_s, took_s):
    done_s = due_s + took_s
    next_s, missed = next_due(due_s, done_s)
    assert missed == pytest.approx((next_s - due_s) / PERIOD_S - 1.0, abs=1e-6)
    assert done_s - 1e-9 <= next_s <= done_s + PERIOD_S + 1e-9
    assert (missed > 0) == (took_s >= PERIOD_S) or abs(took_s - PERIOD_S) < 1e-9


class ScriptedDaemon:
    """Runs a number of cycles of given durations, and records its orders."""

    name = "uav1"

    def __init__(self, clock, works_s, ages_s=None, record=None):
        self.metrics = Metrics("uav1")
        self.recording = Recording(self.name, record, [self.metrics])
        self.clock = clock
        self.ages_s = ages_s or (lambda now_s: math.inf)
        self.works_s = list(works_s)
        self.begun_s = []
        self.asked = []
        self.finished = False

    def step(self, now_s, _):
        self.begun_s.append(round(now_s, 6))
        self.clock.sleep_until(now_s + self.works_s.pop(0))
        self.finished = not self.works_s

    @property
    def flight(self):
        return SimpleNamespace(
            vehicle=SimpleNamespace(silence_s=lambda _, now_s: self.ages_s(now_s))
        )

    def leave(self, order, now_s):
        self.asked.append(order)

    def exchange(self, load, now_s):
        self.asked.append(load())


class ScriptedWorld:
    """A world with one vehicle that only provides frames."""

    real_time = True

    def __init__(self, drain):
        self.drain = drain

    def advance(self):
        pass


def signals_of():
    return Signals(Event.LAND, lambda: "again")


def looped(clock, works_s, signals=None, drain=list, record=None, ages_s=None):
    daemon = ScriptedDaemon(clock, works_s, ages_s, record)
    run([daemon], ScriptedWorld(drain), clock, signals=signals or signals_of())
    return daemon, daemon.metrics


@pytest.fixture
def clock():
    return VirtualClock()


@pytest.fixture(autouse=True)
def little_garbage(monkeypatch):
    """Collecting the garbage of all tests at the start of each loop would take most of their time."""
    monkeypatch.setattr(gc, "collect", lambda _generation=2: 0)


def test_the_loop_keeps_its_grid_and_makes_up_for_nothing(clock):
    daemon, metrics = looped(clock, [0.001, 0.05, 0.001, 0.001])
    assert daemon.begun_s == [0.0, 0.02, 0.08, 0.1]
    assert (
        metrics.registry.get_sample_value("guidance_late_cycles_total", {"vehicle": "uav1"}) == 2.0
    )


@pytest.mark.parametrize("phase_s", [0.0, 0.0019, 0.0119, 0.0121])
def test_cycles_come_to_begin_just_after_the_positions_arrive(clock, phase_s):
    daemon, _ = looped(clock, [0.001] * 400, ages_s=lambda now_s: (now_s - phase_s) % PERIOD_S)
    ages_s = [daemon.ages_s(begun_s) for begun_s in daemon.begun_s]
    assert max(abs(age_s - AGE_S) for age_s in ages_s[-50:]) < 0.001
    periods_s = [later - earlier for earlier, later in pairwise(daemon.begun_s)]
    assert max(abs(period_s - PERIOD_S) for period_s in periods_s) <= MOST_NUDGE_S + 2e-6


def test_positions_at_another_rate_leave_the_period_as_it_is(clock):
    daemon, _ = looped(clock, [0.001] * 1500, ages_s=lambda now_s: now_s % (1.0 / 30.0))
    assert daemon.begun_s[-1] == pytest.approx(1499 * PERIOD_S, abs=0.02)
    assert nudge_s(math.inf) == nudge_s(math.nan) == nudge_s(1.0) == 0.0


@given(st.floats(0.0, 2.0 * PERIOD_S, exclude_max=True))
def test_a_nudge_is_towards_the_age_that_is_wanted_and_small(age_s):
    nudge = nudge_s(age_s)
    assert abs(nudge) <= MOST_NUDGE_S
    if nudge:
        away_s, after_s = (
            abs(math.remainder(age - AGE_S, PERIOD_S)) for age in (age_s, age_s + nudge)
        )
        assert after_s < away_s


def test_garbage_is_collected_between_cycles_where_there_is_time_and_nowhere_else(
    clock, monkeypatch
):
    collected = []
    monkeypatch.setattr(
        gc, "collect", lambda generation=2: collected.append((round(clock.now_s(), 3), generation))
    )
    looped(clock, [0.001] * 100 + [0.018] * 30 + [0.001] * 1600)
    assert gc.isenabled()
    assert collected[0] == (0.0, 2)  # before the first cycle
    times_s = [at_s for at_s, _ in collected[1:]]
    assert not [at_s for at_s in times_s if 2.0 <= at_s < 2.6]  # no time for it then
    assert {generation for _, generation in collected[1:]} == {0, 2}
    assert all(later - earlier < 1.2 for earlier, later in pairwise(times_s))
    assert 50 < len(times_s) < 75
    assert [generation for _, generation in collected[1:]].count(2) == 1


def test_a_loop_without_time_collects_when_it_is_long_overdue(clock, monkeypatch):
    collected = []
    monkeypatch.setattr(gc, "collect", lambda generation=2: collected.append(clock.now_s()))
    looped(clock, [0.019] * 1200)
    assert [round(at_s) for at_s in collected] == [0, 10, 20]


def test_while_the_loop_runs_nothing_is_collected_by_chance(clock):
    enabled = []
    looped(clock, [0.001] * 3, ages_s=lambda now_s: enabled.append(gc.isenabled()) or math.inf)
    assert enabled == [False, False, False]


def test_the_processor_is_claimed_as_far_as_it_is_permitted_and_what_was_had_is_said(monkeypatch):
    had = []
    before_s = sys.getswitchinterval()
    refused = PermissionError(errno.EPERM, "not permitted")

    def taking(name, allowed):
        def take(*arguments):
            if not allowed:
                raise refused
            had.append((name, arguments[0] if name == "realtime" else arguments[1]))

        return take

    ended = threading.Event()
    beside = threading.Thread(target=ended.wait, daemon=True)
    beside.start()
    try:
        for policy, realtime, nice, said in (
            (os.SCHED_OTHER, True, True, "realtime 10"),
            (os.SCHED_OTHER, False, True, "nice -10"),
            (os.SCHED_OTHER, False, False, "as others"),
            (os.SCHED_RR, False, False, "realtime 7"),
        ):
            had.clear()
            monkeypatch.setattr(os, "sched_getscheduler", lambda _, policy=policy: policy)
            monkeypatch.setattr(os, "sched_getparam", lambda _: os.sched_param(7))
            monkeypatch.setattr(os, "sched_setscheduler", taking("realtime", realtime))
            monkeypatch.setattr(os, "setpriority", taking("nice", nice))
            assert claim() == said
            assert {name for name, _ in had} <= {said.split()[0]}
            if had:  # every thread of the process, not the loop's alone; others may come and go
                assert {threading.get_native_id(), beside.native_id} <= {
                    thread for _, thread in had
                }
        assert sys.getswitchinterval() == pytest.approx(SWITCH_S)
    finally:
        ended.set()
        sys.setswitchinterval(before_s)


def test_signals_are_acted_on_by_the_loop(clock):
    signals = signals_of()
    before = {
        number: signal.getsignal(number)
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
    }
    with signals.installed():
        with pytest.raises(
            SystemExit
        ) as ended:  # before the vehicle is found, there is nothing to hand over
            os.kill(os.getpid(), signal.SIGTERM)
        assert ended.value.code == 0
        assert not signals.interrupted
        with pytest.raises(SystemExit) as ended:
            os.kill(os.getpid(), signal.SIGINT)
        assert ended.value.code == 130
        assert signals.interrupted
        signals.looping = True
        for number in before:
            os.kill(os.getpid(), number)
        daemon, _ = looped(clock, [0.001] * 3, signals)
    assert daemon.asked == [Event.LAND, Event.LAND, "again"]
    # A page or view that stays open after the flight ends by signals in the default way.
    assert {number: signal.getsignal(number) for number in before} == before


def test_frames_are_recorded_after_the_cycle(clock, tmp_path):
    recorder = Recorder(tmp_path / "record.mcap", {})
    waiting = [[CapturedFrame(0.0, "uav1/mavlink_raw/in", b"\xfd")], []]
    looped(clock, [0.001] * 2, drain=lambda: waiting.pop(0), record=recorder)
    recorder.close()
    with (tmp_path / "record.mcap").open("rb") as stream:
        ((_, channel, message),) = list(make_reader(stream).iter_messages())
    assert (channel.topic, message.data) == ("uav1/mavlink_raw/in", b"\xfd")
