"""Orders' mailbox, systemd's datagrams, the log, the recorder's thread, the metrics' page, the loop's grid."""

import errno
import logging
import socket
import threading
import urllib.request

import pytest
from mcap.reader import make_reader

from guidance.clock import VirtualClock
from guidance.config import parse
from guidance.errors import LinkError
from guidance.flight import State
from guidance.log.entries import CycleEntry, InputsEntry
from guidance.log.record import MOST_WAITING as MOST_ROWS
from guidance.log.record import BackgroundRecorder
from guidance.log.writer import Recorder
from guidance.session import log as log_module
from guidance.session.answers import StartupResponder
from guidance.session.log import Log
from guidance.session.metrics import Metrics, MetricsServer
from guidance.session.orders import MOST_WAITING, Mailbox
from guidance.session.process import Notifier
from guidance.session.vehicle_file import Config


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
    mailbox.meanwhile(StartupResponder(parse(Config, vehicle_document(), source="test"), clock).answer)
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
    for cycle in range(100):
        notifier.alive(0.02 * cycle)
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

    def isatty(self):
        return True


def test_a_terminal_that_stands_still_costs_lines_and_never_the_loop(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    stream = StandingStill()
    log = Log("console", "info", stream)
    for _ in range(log_module.MOST_WAITING + 50):
        log.say(logging.INFO, "on and on")
        log.show("on and on")
    assert log.dropped >= 49
    stream.go.set()
    log.close()


READY = CycleEntry(0.0, State.READY, InputsEntry((), (), ()), ())


def test_a_record_is_written_behind_the_loops_back_and_whole(tmp_path):
    path = tmp_path / "record.mcap"
    recorder = BackgroundRecorder(Recorder(path, {}))
    for number in range(200):
        recorder.cycle(READY._replace(now_s=0.02 * number))
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

    monkeypatch.setattr(inner, "cycle", fail)
    recorder = BackgroundRecorder(inner)
    for _ in range(10):
        recorder.cycle(READY)
    recorder.close()
    assert str(error) in recorder.failed


def test_a_disk_that_stands_still_costs_rows_and_never_the_loop(tmp_path, monkeypatch):
    inner = Recorder(tmp_path / "record.mcap", {})
    go = threading.Event()
    monkeypatch.setattr(inner, "cycle", lambda *_: go.wait(10.0))
    recorder = BackgroundRecorder(inner)
    for _ in range(MOST_ROWS + 100):
        recorder.cycle(READY)
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
