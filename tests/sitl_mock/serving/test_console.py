"""Console output of a fleet: working addresses for clients, a table on a terminal, lines elsewhere."""

import contextlib
import fcntl
import io
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time

import pytest
from pymavlink import mavutil

from sitl_mock import ConfigError, MockVehicle
from sitl_mock.faults import Faulted, parse_script
from sitl_mock.mavlink import Encoder
from sitl_mock.serving.console import (
    ChangeLines,
    Status,
    client_lines,
    fleet_table,
    line_of,
    shown,
    status_of,
)
from sitl_mock.serving.fleet import checked_fleet, with_parameters, with_settings
from tests.harness.ports import mock_ports

RUN = [sys.executable, "-m", "sitl_mock", "run"]
FAULT = {"fault": [{"kind": "gps_loss", "at_s": 1.0}]}


@pytest.fixture
def vehicle():
    vehicle = Faulted(MockVehicle("px4", ready_after_s=0.1), "uav1", parse_script(FAULT))
    vehicle.step(0.0)
    return vehicle


class Pipe(io.StringIO):
    """Collects output on a descriptor that is always ready."""

    def fileno(self):
        return sys.__stdout__.fileno()


def test_the_status_names_mode_height_clients_and_faults_that_act(vehicle):
    assert status_of(vehicle) == Status("uav1", "px4", 1, "HOLD", False, 0.0, "", "")
    vehicle.step(1.5, [Encoder(255, 190).pack("HEARTBEAT", 6, 8, 0, 0, 0, 3)])
    vehicle.step(1.52)
    assert status_of(vehicle)[6:] == ("255/190", "gps_loss")
    vehicle.step(6.0)
    assert status_of(vehicle).clients == ""


def test_however_many_speak_only_the_last_are_remembered(vehicle):
    for system in range(2, 250):
        vehicle.step(0.5, [Encoder(system, 1).pack("HEARTBEAT", 6, 8, 0, 0, 0, 3)])
    assert status_of(vehicle).clients.split() == [f"{system}/1" for system in range(234, 250)]


def test_lines_come_when_something_changes_and_not_for_a_height(vehicle):
    out = Pipe()
    lines = ChangeLines([vehicle], out)
    for tick in range(1, 200):
        vehicle.step(tick * 0.02)
        lines.update(tick * 0.02)
    assert [line.split()[2:4] for line in out.getvalue().splitlines()] == [
        ["uav1", "HOLD"],
        ["uav1", "HOLD"],
    ]
    assert out.getvalue().count("gps_loss") == 1


def test_a_reader_that_does_not_read_stops_no_vehicle(vehicle):
    reader, writer = os.pipe()
    with os.fdopen(reader, "rb"), os.fdopen(writer, "w", encoding="utf-8") as out:
        room = fcntl.fcntl(writer, fcntl.F_GETPIPE_SZ)
        os.write(writer, b"x" * (room - 100))
        lines = ChangeLines([vehicle], out)
        lines.update(1.0)
        assert os.read(reader, room).strip(b"x") == b""
        lines.update(2.0)
        assert b"uav1  HOLD" in os.read(reader, room)


def test_without_a_reader_it_goes_on_in_silence():
    """Catches a mock that dies with the reader of its output."""
    child = subprocess.Popen([*RUN, "--vehicles", "1", "--zenoh", "tcp/127.0.0.1:0", "--parent-pipe"],
                             stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)  # fmt: skip
    child.stdout.readline()
    child.stdout.close()
    with pytest.raises(subprocess.TimeoutExpired):
        child.wait(1.0)
    child.stdin.close()
    assert child.wait(5.0) == 0
    with child.stderr as errors:
        assert errors.read() == b""


def test_a_line_and_a_row_say_the_same():
    status = Status("uav1", "px4", 1, "OFFBOARD", True, 12.34, "255/190", "loss")
    assert (
        line_of(status, 3.0)
        == "     3.0 s  uav1  OFFBOARD  armed  12.3 m  clients 255/190  faults loss"
    )
    assert fleet_table([status]).row_count == 1
    assert [column.header for column in fleet_table([status]).columns] == [
        "vehicle", "flavour", "mode", "armed", "height", "clients", "faults",
    ]  # fmt: skip


def test_where_the_cursor_cannot_move_there_are_lines(vehicle, monkeypatch):
    class Terminal(Pipe):
        def isatty(self):
            return True

    monkeypatch.setenv("TERM", "dumb")
    assert isinstance(shown([vehicle], Terminal()), ChangeLines)
    monkeypatch.setenv("TERM", "xterm")
    assert isinstance(shown([vehicle], Pipe()), ChangeLines)


@pytest.mark.parametrize(("columns", "plain"), [(80, False), (120, True)])
def test_on_a_terminal_a_table_fits_and_has_no_colour_where_none_is_wanted(columns, plain):
    """Catches colours in spite of NO_COLOR, and lines too long for the terminal."""
    controller, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 30, columns, 0, 0))
    environment = {**os.environ, "TERM": "xterm", **({"NO_COLOR": "1"} if plain else {})}
    environment.pop("COLUMNS", None)
    if not plain:
        environment.pop("NO_COLOR", None)
    arguments = [
        "--vehicles",
        "px4:uav1",
        "--vehicles",
        "rover:evader@30,0,0",
        "--zenoh",
        "tcp/127.0.0.1:0",
    ]
    child = subprocess.Popen(
        [*RUN, *arguments], stdin=terminal, stdout=terminal, stderr=terminal, env=environment
    )
    os.close(terminal)
    said = b""
    until_s = time.monotonic() + 40.0
    try:
        while b"Ctrl-C ends" not in said and time.monotonic() < until_s:
            if select.select([controller], [], [], 0.1)[0]:
                said += os.read(controller, 65536)
        child.send_signal(signal.SIGINT)
        assert child.wait(20.0) == 0
    finally:
        child.kill()
        child.wait()
        os.close(controller)
    text = said.decode()
    assert "HOLD" in text
    assert "MANUAL" in text
    assert ("\x1b[31m" in text or "\x1b[1m" in text or "\x1b[2m" in text) or plain
    assert "\x1b[3" not in text or not plain
    printed = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text).replace("\r", "\n")
    assert max(len(line) for line in printed.splitlines()) <= columns


@pytest.mark.parametrize(("flavour", "step"), [("px4", 1), ("arducopter", 10), ("rover", 10)])
def test_the_printed_lines_connect(flavour, step):
    """Catches a printed address that no client reaches."""
    port = mock_ports()
    arguments = [
        "--vehicles",
        f"{flavour}:a",
        "--vehicles",
        f"{flavour}:b",
        "--udp",
        str(port),
        "--parent-pipe",
    ]
    child = subprocess.Popen(
        [*RUN, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        lines = [line.rstrip() for line in iter(child.stdout.readline, "ready\n")]
        assert "system id 2" in lines[4]
        assert [line.split()[0] for line in lines[5:]] == ["MAVSDK", "pymavlink", "MAVProxy"]
        assert f"udpin://127.0.0.1:{port + step}" in lines[5]
        assert f"--master=udpin:127.0.0.1:{port + step}" in lines[7]
        # The line as a user types it
        client = eval(lines[6].split(maxsplit=1)[1], {"mavutil": mavutil})
        with contextlib.closing(client):
            assert client.wait_heartbeat(timeout=5.0).get_srcSystem() == 2
    finally:
        child.stdin.close()
        child.wait(5.0)
        child.stdout.close()


def test_the_lines_of_a_port():
    assert client_lines(14540)["MAVSDK"] == "udpin://127.0.0.1:14540"


def test_parameters_of_the_command_line_are_for_all_or_for_one():
    fleet = checked_fleet(
        {"vehicle": [{"name": "a"}, {"name": "b", "parameters": {"MPC_XY_VEL_MAX": 5.0}}]}, "here"
    )
    changed = with_parameters(fleet, ["b:MPC_XY_VEL_MAX=8", "COM_OF_LOSS_T=0.5"])
    assert [each.parameters for each in changed.vehicle] == [
        {"COM_OF_LOSS_T": 0.5},
        {"MPC_XY_VEL_MAX": 8.0, "COM_OF_LOSS_T": 0.5},
    ]


@pytest.mark.parametrize("text", ["MPC_XY_VEL_MAX", "=3", "A=", "A=fast", "A=nan", "c:A=1"])
def test_what_is_no_parameter_names_itself_and_what_is_allowed(text):
    with pytest.raises(ConfigError, match=f"--param {text}: .*allowed"):
        with_parameters(checked_fleet({"vehicle": [{"name": "a"}]}, "here"), [text])


def test_a_misspelt_parameter_is_told_the_next():
    with pytest.raises(ConfigError, match="did you mean MPC_XY_VEL_MAX"):
        MockVehicle("px4", parameters={"MPC_XY_VEL_MX": 8.0})


def test_options_hold_for_a_fleet_of_a_file_as_well():
    fleet = checked_fleet(
        {"seed": 4, "vehicle": [{"name": "a", "start_ned_m": [1, 2, 0]}, {"name": "b"}]}, "here"
    )
    assert with_settings(fleet, {}) == fleet
    changed = with_settings(fleet, {"noise": False}, seed=7)
    assert (changed.seed, [each.noise for each in changed.vehicle]) == (7, [False, False])
    assert changed.vehicle[0].start_ned_m == (1.0, 2.0, 0.0)
