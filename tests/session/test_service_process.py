"""The daemon as a process of its own, in real time, against the mock as another one, over Zenoh on loopback."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from mcap.reader import make_reader

from guidance.errors import LinkError
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.links.opening import open_wire, wait_until_heard
from guidance.messages import Parameter, ParameterRequest, ParameterSet
from guidance.session.orders.words import STATUS
from sitl_mock.child import running
from tests.harness.bus import ask
from tests.harness.command import guidance
from tests.harness.vehicle import FENCED, mocked, write_file

LOOSENED = {"px4": ("GF_ACTION", 0.0, 2.0), "arducopter": ("FENCE_ENABLE", 0.0, 1.0)}
"""A parameter of the autopilot's fence, off and as it was."""

GUIDANCE = Path(sys.executable).parent / "guidance"
VEHICLES = [
    mocked("uav1", parameters=FENCED),
    mocked("copter", "arducopter", parameters={"GUID_TIMEOUT": 1.0, "FENCE_ENABLE": 1.0}),
    mocked("unfenced"),
    mocked("evader", "rover", start_ned_m=[30.0, 0.0, 0.0]),
]


@pytest.fixture(scope="module")
def fleet():
    """The vehicles, in a process of their own."""
    with running(VEHICLES, over=["zenoh"]) as fleet:
        yield fleet


@pytest.fixture
def vehicle_file(tmp_path, fleet):
    """Write a vehicle file; every one gets a control port of its own."""

    def write(name="uav1", *, autopilot="px4", link="pymavlink", timeout_s=10.0):
        vehicle = {"autopilot": autopilot, "link": link, "connect_timeout_s": timeout_s}
        return write_file(tmp_path, fleet, name, vehicle=vehicle, log={"format": "json"})

    return write


def ctl(control, *words):
    return guidance("ctl", *words, "--json", "--endpoint", control).returncode


def set_by_another(fleet, name, parameter, value):
    """A ground station sets a parameter, and has it confirmed."""
    url = f"zenoh://{fleet[name].zenoh.removeprefix('tcp/')}/{name}"
    wire = open_wire(url, clock=time.monotonic)
    link = PymavlinkLink(wire, time.monotonic, system_id=1, own_system_id=255)
    try:
        wait_until_heard(link, clock=time.monotonic, timeout_s=10.0, sleep=time.sleep, who=url)
        link.request(ParameterRequest(parameter))
        there = answer(link, parameter)
        link.request(ParameterSet(parameter, value, there.param_type))
        assert answer(link, parameter).value == value
    finally:
        link.close()


def answer(link, parameter, limit_s=10.0):
    deadline_s = time.monotonic() + limit_s
    while time.monotonic() < deadline_s:
        for message in link.receive():
            if isinstance(message, Parameter) and message.name == parameter:
                return message
        time.sleep(0.01)
    pytest.fail(f"{parameter} was not answered within {limit_s} s")


def until(control, *states, limit_s=30.0):
    """Ask where the flight stands until it stands there: not by a process for each question, which flies slower."""
    deadline_s = time.monotonic() + limit_s
    answer = {}
    while time.monotonic() < deadline_s:
        with contextlib.suppress(LinkError):  # not there yet
            answer = ask(STATUS, endpoint=control, name=None)
        if answer.get("state") in states:
            return answer
        time.sleep(0.1)
    pytest.fail(f"not {states} within {limit_s} s, but {answer}")


class Systemd:
    """What systemd would read of one service, as it comes: the socket holds no more than a few."""

    def __init__(self, path):
        self.path = str(path)
        self.said = []
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._listener.bind(self.path)
        self._listener.settimeout(0.1)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self):
        while not self._stop.is_set():
            with contextlib.suppress(TimeoutError):
                self.said.append(self._listener.recv(4096).decode())

    def wait_for(self, words, limit_s=20.0):
        deadline_s = time.monotonic() + limit_s
        while words not in self.said:
            if time.monotonic() > deadline_s:
                pytest.fail(f"{words} was not said within {limit_s} s: {self.said}")
            time.sleep(0.02)

    def close(self):
        self._stop.set()
        self._thread.join()
        self._listener.close()


@pytest.fixture
def systemd(tmp_path):
    systemd = Systemd(tmp_path / "notify")
    yield systemd
    systemd.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "autopilot", "link"),
    [("uav1", "px4", "mavsdk"), ("copter", "arducopter", "pymavlink")],
)
def test_a_daemon_flies_by_orders_refuses_a_second_one_and_lands_on_sigterm(
    fleet, vehicle_file, systemd, tmp_path, name, autopilot, link
):
    path, control = vehicle_file(name, autopilot=autopilot, link=link)
    environment = {**os.environ, "NOTIFY_SOCKET": systemd.path, "WATCHDOG_USEC": "3000000"}
    daemon = subprocess.Popen(
        [GUIDANCE, "run", path], stderr=subprocess.PIPE, text=True, env=environment
    )
    try:
        systemd.wait_for("READY=1")
        until(control, "ready")
        rival, _ = vehicle_file(name, autopilot=autopilot)
        second = subprocess.run(
            [GUIDANCE, "run", rival], capture_output=True, text=True, timeout=20, check=False
        )
        assert second.returncode == 3
        assert "another daemon owns this vehicle" in second.stderr
        assert ctl(control, "engage") == 4
        assert ctl(control, "start") == 0
        until(control, "standing by")
        loosened, loose, sound = LOOSENED[autopilot]
        set_by_another(fleet, name, loosened, loose)
        refused = ask("engage", endpoint=control, name=None)
        assert (refused["accepted"], f"{loosened} is " in refused["reason"]) == (False, True)
        set_by_another(fleet, name, loosened, sound)
        assert ctl(control, "engage") == 0
        until(control, "engaged", "on station")
        daemon.send_signal(signal.SIGHUP)
        status = until(control, "on station")
        assert status["mode"] == "guided"
        daemon.send_signal(signal.SIGTERM)
        _, err = daemon.communicate(timeout=20)
    finally:
        daemon.kill()
        daemon.wait()
    assert daemon.returncode == 0, err
    log = [json.loads(line) for line in err.splitlines() if line.startswith("{")]
    messages = [row["message"] for row in log]
    assert "configuration not read again: refused in flight" in messages
    assert log[-1]["message"] == "ended"
    assert log[-1]["mode"] == "land"
    systemd.wait_for("STOPPING=1")
    assert systemd.said.count("WATCHDOG=1") > 5
    assert "STATUS=on station, mode guided" in systemd.said
    (record,) = tmp_path.glob(f"{name}-*.mcap")
    with record.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    counts = {
        channel.topic: summary.statistics.channel_message_counts[key]
        for key, channel in summary.channels.items()
    }
    assert counts["guidance/cycle"] > 300
    assert counts[f"{name}/mavlink_raw/in"] > 100
    assert counts[f"{name}/mavlink_raw/out"] > 500


@pytest.mark.slow
def test_ctrl_c_is_130_and_the_last_line_says_that_the_vehicle_is_still_armed(fleet, vehicle_file):
    path, control = vehicle_file("uav1")
    text = path.read_text()
    assert 'on_terminate = "land"' in text
    path.write_text(text.replace('on_terminate = "land"', 'on_terminate = "hold"'))
    with subprocess.Popen([GUIDANCE, "run", path], stderr=subprocess.PIPE, text=True) as daemon:
        try:
            until(control, "ready")
            assert ctl(control, "start", "--wait") == 0
            daemon.send_signal(signal.SIGINT)
            _, err = daemon.communicate(timeout=30)
        finally:
            daemon.kill()
    assert daemon.returncode == 130
    last = json.loads(err.splitlines()[-1])
    assert (last["message"], last["level"], last["mode"]) == ("ended", "warning", "hold")
    assert last["vehicle"].startswith("STILL ARMED in ")
    assert "land it by radio" in last["vehicle"]


@pytest.mark.slow
def test_check_prints_every_row_and_its_verdict(vehicle_file):
    environment = {**os.environ, "COLUMNS": "240"}
    fenced, _ = vehicle_file("uav1")
    done = subprocess.run(
        [GUIDANCE, "check", fenced], capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "nothing is refused" in done.stdout
    unfenced, _ = vehicle_file("unfenced", link="mavsdk")
    done = subprocess.run(
        [GUIDANCE, "check", unfenced, "--json"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 4, done.stdout + done.stderr
    rows = {row["name"]: row for row in json.loads(done.stdout)}
    assert [name for name, row in rows.items() if row["verdict"] == "refuse"] == [
        "GF_MAX_HOR_DIST",
        "GF_MAX_VER_DIST",
    ]
    assert rows["GF_MAX_HOR_DIST"]["advice"].startswith("param set GF_MAX_HOR_DIST 105")
    assert rows["local = global"]["verdict"] == "pass"
    assert rows["LOCAL_POSITION_NED"]["verdict"] == "pass"


def test_a_daemon_waits_for_a_missing_vehicle_and_then_ends_with_one_message(vehicle_file):
    """Catches a daemon's process that hangs without a vehicle."""
    path, control = vehicle_file("nobody", timeout_s=4.0)
    with subprocess.Popen([GUIDANCE, "run", path], stderr=subprocess.PIPE, text=True) as daemon:
        waiting = until(control, "waiting")
        assert "HEARTBEAT of system 1, component 1 at zenoh://" in waiting["waiting_for"]
        said = daemon.stderr.read()
        assert daemon.wait(20.0) == 3
    assert "no HEARTBEAT within 4 s" in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["run", "nonsense"], 2, "no vehicle 'nonsense': give a path, or one of: arducopter, px4"),
        (["check", "nonsense"], 2, "no vehicle 'nonsense'"),
        (["ctl", "explode"], 2, "order = 'explode': allowed are abort, engage"),
        (["ctl", "hold", "--endpoint", "tcp/127.0.0.1:9"], 3, "no session within"),
    ],
)
def test_what_cannot_be_done_ends_with_one_clear_message(
    arguments, code, words, tmp_path, monkeypatch
):
    """Catches a traceback of the daemon's process at its start."""
    monkeypatch.chdir(tmp_path)
    done = guidance(*arguments)
    assert done.returncode == code
    assert words in done.stderr
    assert "Traceback" not in done.stderr
