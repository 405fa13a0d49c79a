"""What `guidance fly` refuses before anything flies: options that mean nothing there, and folders of other flights."""

import os
import re
import time

import psutil
import pytest
from typer.testing import CliRunner

from guidance.cli import fly
from guidance.cli.program import app
from guidance.errors import ConfigError, FlightError
from guidance.log.entries import OUTCOME
from guidance.session.flight_files import PICTURE, RECORD
from guidance.session.fly.loop import claimed
from guidance.session.observe.outputs import OUTPUTS
from guidance.session.open.mock import MockOptions
from guidance.session.open.opened import NOBODY
from guidance.session.open.url import Asked
from guidance.session.recorded_flight import fly_recorded
from guidance.sim.scenario_file import load_scenario

PAPER = ("--pursuer", "8,1.42,9.41", "--evader", "7.92,9.6", "--speed-ratio", "2")


def refused(*arguments):
    done = CliRunner().invoke(app, ["fly", *map(str, arguments)])
    assert isinstance(done.exception, ConfigError), done.output
    assert done.output == "" or "--out" in arguments  # an option is refused before the title
    return str(done.exception)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--fast", "--link", "mavsdk"), "--link: only in real time, not with --fast"),
        (("--fast", "--port", "0"), "--port: only in real time, not with --fast"),
        (("--fast", "--ros", "tcp/127.0.0.1:7447"), "--ros: only in real time, not with --fast"),
        (("--ros", "tls/127.0.0.1:7447"), "--ros tls/127.0.0.1:7447: allowed is tcp/HOST:PORT"),
        (("--ros", "tcp/127.0.0.1"), "--ros tcp/127.0.0.1:\n"),
        (("--yes",), "--yes: only with --vehicle, not with the mock"),
        (("--end", "land"), "--end: only with --vehicle, not with the mock"),
        (("--autopilot", "px4"), "--autopilot: only with --vehicle, not with the mock"),
        (("--link", "foo"), "--link foo: allowed are mavsdk, pymavlink"),
        (
            ("--vehicle", "udpin://127.0.0.1:14540", "--link", "foo"),
            "--link foo: allowed are mavsdk, pymavlink",
        ),
        (
            ("--vehicle", "udpin://127.0.0.1:14540", "--end", "up"),
            "--end up: allowed are return, land",
        ),
    ],
)
def test_an_option_that_would_mean_nothing_is_refused(arguments, words):
    assert words in refused(*arguments)


@pytest.mark.parametrize("left", [RECORD, OUTCOME, PICTURE, "report.html"])
def test_nothing_of_another_flight_is_overwritten_nor_left_beside_a_new_one(left, tmp_path):
    (tmp_path / left).write_text("of another flight")
    assert f"contains another flight ({left})" in refused("--fast", "--out", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [left]
    assert (tmp_path / left).read_text() == "of another flight"


def test_a_seed_below_zero_is_refused():
    assert CliRunner().invoke(app, ["fly", "--fast", "--seed", "-1"]).exit_code == 2
    assert CliRunner().invoke(app, ["scenario", "run", "pe", "--seed", "-1"]).exit_code == 2


def test_what_arms_a_vehicle_says_so_in_its_help():
    for command in (["fly"], ["scenario", "run"]):
        words = CliRunner().invoke(app, [*command, "--help"], env={"COLUMNS": "200"}).output
        assert "IS ARMED" in words
        assert "--yes" in words


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("check", "px4", "--link", "mavsdk"), "--link: only with --vehicle"),
        (("check", "px4", "--autopilot", "px4"), "--autopilot: only with --vehicle"),
        (("solve", *PAPER, "--out", "a.csv"), "--out: only with --states, not with one state"),
        (
            ("solve", "--states", "s.csv", "--speed-ratio", "2", "--json"),
            "--json: only for one state",
        ),
        (
            ("solve", "--states", "s.csv", *PAPER),
            "--pursuer: only for one state, not with --states",
        ),
    ],
)
def test_so_it_is_with_other_commands(arguments, words):
    done = CliRunner().invoke(app, arguments)
    assert isinstance(done.exception, ConfigError), done.output
    assert words in str(done.exception)


@pytest.mark.parametrize("begun", [False, True])
def test_a_ctrl_c_names_the_record_if_there_is_one(begun, tmp_path, monkeypatch):
    def interrupted(_scenario, _how, _out, _seed, onlooker, **_):
        if begun:
            onlooker.on_record(tmp_path / RECORD)
        raise KeyboardInterrupt

    monkeypatch.setattr(fly, "fly_scenario", interrupted)
    monkeypatch.setattr("signal.signal", lambda *_: None)
    done = CliRunner().invoke(app, ["fly", "pe"])
    assert done.exit_code == 130
    kept = f"the record so far is {tmp_path / RECORD}" if begun else "nothing was recorded"
    assert kept in done.output


def test_a_mocked_flight_publishes_ros_topics_where_it_is_asked_to(tmp_path, monkeypatch):
    asked = []

    def open_ros(order):
        asked.append((order.vehicle, order.config, order.ros.endpoint, order.ros.orders))
        raise ConfigError("far enough")

    monkeypatch.setitem(OUTPUTS, "ros", open_ros)

    def fly_fast(scenario, folder, _, onlooker):
        return fly_recorded(scenario, folder, MockOptions(fast=True), onlooker)

    monkeypatch.setattr(fly, "fly_recorded", fly_fast)
    monkeypatch.setattr("signal.signal", lambda *_: None)
    endpoint = "tcp/127.0.0.1:7447"
    assert refused("--ros", endpoint, "--out", tmp_path / "pe-001") == "far enough"
    assert asked == [("pursuer", None, endpoint, False)]


@pytest.mark.parametrize("vehicle", [(), ("--vehicle", "udpin://127.0.0.1:14540")])
def test_a_panel_beside_a_flight_is_at_its_orders_and_ends_with_it(vehicle, tmp_path, monkeypatch):
    seen = []

    def panels(within_s=0.0):
        deadline_s = time.monotonic() + within_s
        while not (
            found := [one for one in psutil.Process().children() if "panel" in one.cmdline()]
        ):
            if time.monotonic() >= deadline_s:
                break
        return found

    control = "tcp/127.0.0.1:7499"

    def flown(scenario, how, _out, _seed, onlooker, **_):
        onlooker.on_control(control)
        (panel,) = panels(within_s=10.0)  # until the child has become the program
        seen.append((scenario, not isinstance(how, MockOptions), panel.cmdline()[4:]))
        panel.terminate()  # as a person does who has seen enough
        return 0

    monkeypatch.setattr(fly, "fly_scenario", flown)
    monkeypatch.setattr("signal.signal", lambda *_: None)
    done = CliRunner().invoke(
        app, ["fly", "pe", "--panel", *vehicle, "--out", str(tmp_path / "pe-001")]
    )
    assert done.exit_code == 0
    ((scenario, on_vehicle, command),) = seen
    assert (scenario, on_vehicle) == ("pe", bool(vehicle))
    assert command == ["panel", "--endpoint", control, "--port", "0", "--records", str(tmp_path)]
    assert panels() == []


@pytest.mark.parametrize("fast", [False, True])
def test_a_flight_in_real_time_claims_the_processor_and_gives_it_back(fast, monkeypatch):
    def priority():
        return os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)

    flying = []

    def opened(*_):
        flying.append(priority())
        raise FlightError("far enough")

    monkeypatch.setattr(MockOptions, "open", opened)
    before = priority()
    with pytest.raises(FlightError, match="far enough"):
        fly_recorded(load_scenario("pe")[1], None, MockOptions(fast=fast))
    assert priority() == before
    if fast:
        assert flying == [before]
    else:
        with claimed():
            assert flying == [priority()]


@pytest.mark.parametrize(("name", "count"), [("hover_chase", 1), ("teams_guard", 3)])
def test_a_refused_vehicle_is_told_a_command_that_check_takes(name, count, monkeypatch, tmp_path):
    def refuse(*_):
        raise FlightError("preflight refuses: GF_ACTION")

    monkeypatch.setattr(fly, "fly_recorded", refuse)
    urls = tuple(f"udpin://127.0.0.1:{14540 + place}" for place in range(count))
    with pytest.raises(FlightError, match="GF_ACTION") as refusal:
        fly.fly_scenario(name, Asked(urls), tmp_path / "flight", None, NOBODY, as_json=False)
    commands = re.findall("guidance (check .*)", str(refusal.value))
    assert [command.split("--vehicle ")[1] for command in commands] == [
        f"{url} --apply" for url in urls
    ]
    for command, url in zip(commands, urls, strict=True):
        done = CliRunner().invoke(app, command.replace(url, "nonsense").split())
        assert "nonsense" in str(done.exception)  # everything but the URL is taken
