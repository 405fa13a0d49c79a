"""Orders' mailbox, systemd's datagrams, the log, the recorder's thread, the metrics' page, the loop's grid."""

import errno
import gc
import logging
import math
import os
import signal
import socket
import sys
import threading
import urllib.request
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from guidance.config import parse
from guidance.errors import LinkError
from guidance.flight import Event, State
from guidance.service import log as log_module
from guidance.service.background import MOST_WAITING as MOST_ROWS
from guidance.service.background import BackgroundRecorder
from guidance.service.clock import VirtualClock
from guidance.service.log import Log
from guidance.service.loop import AGE_S, MOST_NUDGE_S, PERIOD_S, Signals, next_due, nudge_s, run
from guidance.service.mailbox import MOST_WAITING, Mailbox
from guidance.service.metrics import Metrics, MetricsServer
from guidance.service.model import Config
from guidance.service.notify import Notifier
from guidance.service.priority import SWITCH_S, claim
from guidance.service.record import Recorder
from guidance.service.tidying import Tidying
from guidance.service.waiting import Waiting


def test_an_order_is_taken_once_and_its_answer_reaches_who_asked():
    mailbox = Mailbox()
    question = mailbox.ask("hold")
    (taken,) = mailbox.take()
    assert mailbox.take() == []
    assert question.wait(0.0) is None
    taken.answer({"accepted": True})
    assert question.wait(0.0) == {"accepted": True}


def test_before_the_loop_runs_an_order_is_answered_with_what_is_waited_for(vehicle_document):
    clock, mailbox = VirtualClock(), Mailbox()
    mailbox.meanwhile(Waiting(parse(Config, vehicle_document(), source="test"), clock).answer)
    clock.sleep_until(2.5)
    status = mailbox.ask("status").wait(0.0)
    assert (status["accepted"], status["name"], status["state"], status["waited_s"]) == (True, "uav1", "waiting", 2.5)
    assert status["waiting_for"] == "a HEARTBEAT of system 1, component 1 at udpin://127.0.0.1:14540"
    engage = mailbox.ask("engage").wait(0.0)
    assert not engage["accepted"]
    assert engage["reason"].endswith("at udpin://127.0.0.1:14540, 2.5 s so far")
    assert mailbox.ask("jump").wait(0.0)["reason"].startswith("order = 'jump': allowed are abort, ")
    assert mailbox.take() == []
    mailbox.meanwhile(None)
    mailbox.ask("status")
    assert [question.order for question in mailbox.take()] == ["status"]


def test_a_loop_that_hangs_is_not_buried_in_orders():
    mailbox = Mailbox()
    kept = [mailbox.ask("hold") for _ in range(MOST_WAITING)]
    answer = mailbox.ask("hold").wait(0.0)
    assert not answer["accepted"]
    assert "is the loop running?" in answer["reason"]
    assert list(mailbox.take()) == kept


@pytest.fixture
def systemd(tmp_path):
    """What systemd would read."""
    path = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(path)
        listener.setblocking(False)

        def read():
            said = []
            while True:
                try:
                    said.append(listener.recv(4096).decode())
                except BlockingIOError:
                    return said

        yield path, read


def test_systemd_hears_readiness_life_status_and_the_end(systemd):
    path, read = systemd
    environment = {"NOTIFY_SOCKET": path, "WATCHDOG_USEC": "3000000", "WATCHDOG_PID": "77"}
    notifier = Notifier.from_environment(environment, 77)
    notifier.ready()
    for tick in range(100):
        notifier.alive(0.02 * tick)
        notifier.status("ready, mode hold")
    notifier.stopping()
    notifier.close()
    notifier.close()
    assert read() == ["READY=1", "WATCHDOG=1", "STATUS=ready, mode hold", "WATCHDOG=1", "STOPPING=1"]


@pytest.mark.parametrize(
    "environment",
    [
        {},
        {"WATCHDOG_USEC": "3000000"},
        {"NOTIFY_SOCKET": "/nowhere/at/all", "WATCHDOG_USEC": "3000000"},
        {"NOTIFY_SOCKET": "@nobody-listens-here", "WATCHDOG_USEC": "soon"},
    ],
)
def test_without_systemd_nothing_is_said_and_nothing_fails(environment):
    notifier = Notifier.from_environment(environment, 1)
    notifier.ready()
    notifier.alive(1.0)
    notifier.close()


def test_a_watchdog_of_another_process_is_not_ours(systemd):
    path, read = systemd
    environment = {"NOTIFY_SOCKET": path, "WATCHDOG_USEC": "3000000", "WATCHDOG_PID": "78"}
    notifier = Notifier.from_environment(environment, 77)
    notifier.alive(100.0)
    notifier.close()
    assert read() == []


def test_json_lines_carry_the_fields_as_they_are(text_log):
    stream, rows = text_log
    log = Log("json", "info", stream)
    log.say(logging.WARNING, "battery low", state=State.RETURNING, left=0.19, unknown=float("nan"))
    log.say(logging.DEBUG, "not written")
    log.close()
    (row,) = rows()
    assert row.pop("time") > 1.7e9
    assert row == {"level": "warning", "message": "battery low", "state": "returning", "left": 0.19, "unknown": None}


def test_console_lines_are_for_people(text_log):
    stream, _ = text_log
    log = Log("console", "debug", stream)
    log.say(logging.INFO, "armed", state=State.CLIMBING)
    log.say(logging.ERROR, "gone")
    log.close()
    first, second = stream.getvalue().splitlines()
    assert first[8:] == " armed  state=climbing"
    assert second[8:] == " ERROR gone"


class StandingStill:
    """A terminal that takes nothing until it is told to."""

    def __init__(self):
        self.go = threading.Event()

    def write(self, _):
        self.go.wait(10.0)

    def flush(self):
        pass


def test_a_terminal_that_stands_still_costs_lines_and_never_the_loop():
    stream = StandingStill()
    log = Log("console", "info", stream)
    for _ in range(log_module.MOST_WAITING + 50):
        log.say(logging.INFO, "on and on")
    assert log.dropped >= 49
    stream.go.set()
    log.close()


def test_a_record_is_written_behind_the_loops_back_and_whole(tmp_path):
    path = tmp_path / "record.mcap"
    recorder = BackgroundRecorder(Recorder(path, {}))
    for number in range(200):
        recorder.tick(0.02 * number, {"now_s": 0.02 * number, "state": "ready"})
    recorder.frame(1.0, "uav1/mavlink_raw/in", b"\xfd")
    recorder.event(2.0, "armed")
    recorder.close()
    recorder.close()
    assert recorder.failed is None
    with path.open("rb") as stream:
        assert make_reader(stream).get_summary().statistics.message_count == 202


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), ValueError("no such row")])
def test_a_record_that_fails_is_reported_and_disturbs_nobody(tmp_path, monkeypatch, error):
    inner = Recorder(tmp_path / "record.mcap", {})

    def fail(*_):
        raise error

    monkeypatch.setattr(inner, "tick", fail)
    recorder = BackgroundRecorder(inner)
    for _ in range(10):
        recorder.tick(0.0, {})
    recorder.close()
    assert str(error) in recorder.failed


def test_a_disk_that_stands_still_costs_rows_and_never_the_loop(tmp_path, monkeypatch):
    inner = Recorder(tmp_path / "record.mcap", {})
    go = threading.Event()
    monkeypatch.setattr(inner, "tick", lambda *_: go.wait(10.0))
    recorder = BackgroundRecorder(inner)
    for _ in range(MOST_ROWS + 100):
        recorder.tick(0.0, {})
    assert recorder.dropped >= 99
    go.set()
    recorder.close()


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_metrics_are_served_on_loopback_and_nowhere_else():
    metrics = Metrics("uav1")
    metrics.order("hold", accepted=True)
    server = MetricsServer(metrics, free_port())
    with urllib.request.urlopen(f"http://127.0.0.1:{server.port}/metrics", timeout=5.0) as page:
        text = page.read().decode()
    assert 'guidance_orders_total{accepted="true",order="hold",vehicle="uav1"} 1.0' in text
    with pytest.raises(LinkError, match=f"metrics.port = {server.port}"):
        MetricsServer(metrics, server.port)
    server.close()


@given(st.floats(0.0, 1e5), st.floats(0.0, 3.0))
def test_the_next_cycle_is_on_the_grid_still_to_come_and_no_more_than_a_period_away(due_s, took_s):
    done_s = due_s + took_s
    next_s, missed = next_due(due_s, done_s)
    assert missed == pytest.approx((next_s - due_s) / PERIOD_S - 1.0, abs=1e-6)
    assert done_s - 1e-9 <= next_s <= done_s + PERIOD_S + 1e-9
    assert (missed > 0) == (took_s >= PERIOD_S) or abs(took_s - PERIOD_S) < 1e-9


class ScriptedDaemon:
    """Runs a number of cycles, each as long as it is told, and keeps what it was asked."""

    def __init__(self, clock, works_s, ages_s=None):
        self.clock = clock
        self.ages_s = ages_s or (lambda now_s: math.inf)
        self.works_s = list(works_s)
        self.begun_s = []
        self.asked = []
        self.finished = False

    def step(self, now_s, **_):
        self.begun_s.append(round(now_s, 6))
        self.clock.sleep_until(now_s + self.works_s.pop(0))
        self.finished = not self.works_s

    @property
    def position_age_s(self):
        return self.ages_s(self.begun_s[-1])

    def leave(self, order, now_s):
        self.asked.append(order)

    def exchange(self, load, now_s):
        self.asked.append(load())


def looped(clock, works_s, signals=None, drain=list, record=None, ages_s=None, tidying=None):
    daemon = ScriptedDaemon(clock, works_s, ages_s)
    metrics = Metrics("uav1")
    run(
        daemon,
        clock,
        signals=signals or Signals(),
        metrics=metrics,
        on_terminate=Event.LAND,
        load=lambda: "again",
        drain=drain,
        record=record,
        tidying=tidying or Tidying(),
    )
    return daemon, metrics


@pytest.fixture
def clock():
    from guidance.service.clock import VirtualClock

    return VirtualClock()


def test_the_loop_keeps_its_grid_and_makes_up_for_nothing(clock):
    daemon, metrics = looped(clock, [0.001, 0.05, 0.001, 0.001])
    assert daemon.begun_s == [0.0, 0.02, 0.08, 0.1]
    assert metrics.registry.get_sample_value("guidance_late_cycles_total", {"vehicle": "uav1"}) == 2.0


@pytest.mark.parametrize("phase_s", [0.0, 0.0019, 0.006, 0.0119, 0.0121, 0.019])
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
        away_s, after_s = (abs(math.remainder(age - AGE_S, PERIOD_S)) for age in (age_s, age_s + nudge))
        assert after_s < away_s


def test_garbage_is_collected_between_cycles_where_there_is_time_and_nowhere_else(clock, monkeypatch):
    collected = []
    monkeypatch.setattr(gc, "collect", lambda generation=2: collected.append((round(clock.now_s(), 3), generation)))
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
    had, before_s = [], sys.getswitchinterval()
    refused = PermissionError(errno.EPERM, "not permitted")

    def taking(name, allowed):
        def take(*arguments):
            if not allowed:
                raise refused
            had.append((name, arguments[0] if name == "realtime" else arguments[1]))

        return take

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
            if had:  # every thread of the process, not the loop's alone
                assert {thread.native_id for thread in threading.enumerate()} <= {thread for _, thread in had}
        assert sys.getswitchinterval() == pytest.approx(SWITCH_S)
    finally:
        sys.setswitchinterval(before_s)


def test_signals_are_acted_on_by_the_loop(clock):
    signals = Signals()
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)}
    signals.install()
    try:
        with pytest.raises(SystemExit) as ended:  # while the vehicle is waited for, there is nothing to hand over
            os.kill(os.getpid(), signal.SIGTERM)
        assert ended.value.code == 0
        signals.begin()
        for number in before:
            os.kill(os.getpid(), number)
        daemon, _ = looped(clock, [0.001] * 3, signals)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    assert daemon.asked == [Event.LAND, Event.LAND, "again"]


def test_frames_are_recorded_after_the_cycle(clock, tmp_path):
    recorder = Recorder(tmp_path / "record.mcap", {})
    waiting = [[(0.0, "uav1/mavlink_raw/in", b"\xfd")], []]
    looped(clock, [0.001] * 2, drain=lambda: waiting.pop(0), record=recorder)
    recorder.close()
    with (tmp_path / "record.mcap").open("rb") as stream:
        ((_, channel, message),) = list(make_reader(stream).iter_messages())
    assert (channel.topic, message.data) == ("uav1/mavlink_raw/in", b"\xfd")


def test_the_unit_file_names_what_the_daemon_does():
    from guidance.config import config_folder

    text = (config_folder() / "systemd" / "guidance.service").read_text()
    for line in (
        "Type=notify",
        "WatchdogSec=2",
        "ExecStart=/usr/local/bin/guidance run ",
        "RestartPreventExitStatus=2",
    ):
        assert line in text
    assert "KillSignal=SIGTERM" in text
