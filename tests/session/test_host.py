"""`guidance doctor`: what this computer lacks is found, and each thing is mended by its own advice."""

import json
import os
import socket

import pytest
from typer.testing import CliRunner

from guidance.autopilots import Verdict
from guidance.cli.program import app
from guidance.config import find
from guidance.session import checkup
from guidance.session.vehicle_file import load_vehicle


@pytest.fixture(autouse=True)
def a_short_watch(monkeypatch, tmp_path):
    monkeypatch.setattr(checkup, "CYCLES", 2)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.chdir(tmp_path)


def rows(config=None):
    return {row.name: row for row in checkup.examine(config)}


def vehicle(**sections):
    config = load_vehicle(find("px4", "vehicles"))
    changed = {
        name: getattr(config, name).model_copy(update=keys) for name, keys in sections.items()
    }
    return config.model_copy(update=changed)


def test_a_port_that_is_taken_keeps_the_daemon_from_starting():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken, socket.socket() as ours:
        taken.bind(("127.0.0.1", 0))
        ours.bind(("127.0.0.1", 0))
        ours.listen()
        url = f"udpin://127.0.0.1:{taken.getsockname()[1]}"
        endpoint = f"tcp/127.0.0.1:{ours.getsockname()[1]}"
        found = rows(vehicle(vehicle={"url": url}, control={"endpoint": endpoint}))
    assert found[f"vehicle.url {url}"].verdict is Verdict.REFUSE
    assert found[f"orders {endpoint}"].verdict is Verdict.REFUSE
    assert "guidance ctl status" in found[f"orders {endpoint}"].advice
    free = rows(vehicle(vehicle={"url": url}, control={"endpoint": endpoint}))
    assert {free[f"vehicle.url {url}"].verdict, free[f"orders {endpoint}"].verdict} == {
        Verdict.PASS
    }


def test_scheduling_that_is_not_permitted_and_a_late_clock_are_told(monkeypatch):
    def refused(*_):
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refused)
    monkeypatch.setattr(checkup, "LATE_CYCLE_S", -1.0)
    found = rows()
    assert (
        found["scheduling"].verdict,
        "CPUSchedulingPolicy=rr" in found["scheduling"].advice,
    ) == (Verdict.WARN, True)
    assert found["cadence"].verdict is Verdict.WARN


def test_the_scheduling_that_was_tried_is_given_back():
    before = os.sched_getscheduler(0)
    rows()
    assert os.sched_getscheduler(0) == before


def test_a_serial_port_that_is_not_there_and_a_full_disk(monkeypatch, tmp_path):
    monkeypatch.setattr(checkup, "FLIGHT_BYTES", 10**18)
    config = vehicle(
        vehicle={"url": "serial:///dev/no-such-port:921600"},
        record={"folder": tmp_path / "a" / "b"},
    )
    found = rows(config)
    assert found["/dev/no-such-port"].verdict is Verdict.REFUSE
    assert found["disk"].verdict is Verdict.WARN
    assert found["record folder"].value == f"{tmp_path / 'a' / 'b'}: writable"
    (tmp_path / "file").touch()
    assert (
        rows(vehicle(record={"folder": tmp_path / "file" / "b"}))["record folder"].verdict
        is Verdict.REFUSE
    )


def test_the_command_ends_with_4_where_something_is_refused(monkeypatch):
    done = CliRunner().invoke(app, ["doctor", "--json"])
    names = [row["name"] for row in json.loads(done.stdout)]
    assert {"software", "calendar", "cadence", "scheduling", "disk", "extras"} <= set(names)
    refused = any(row["verdict"] == "refuse" for row in json.loads(done.stdout))
    assert done.exit_code == (4 if refused else 0)
    assert CliRunner().invoke(app, ["--version"]).stdout.startswith("pursuit-guidance ")
