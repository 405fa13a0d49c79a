"""`sitl-mock` as a process: it starts, answers clients and ends; wrong uses are refused."""

import json
import re
import signal
import socket
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

import pytest
from typer.testing import CliRunner

from sitl_mock import ConfigError
from sitl_mock.cli import app, main
from sitl_mock.flavours import NAMES
from sitl_mock.mavlink import Decoder
from sitl_mock.serving.serve import udp_ports
from sitl_mock.vehicle.conditions import CONDITIONS
from tests.harness.ports import mock_ports


@pytest.fixture
def start():
    children = []

    def start(*arguments):
        child = subprocess.Popen(
            [sys.executable, "-m", "sitl_mock", "run", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        children.append(child)
        return child

    yield start
    for child in children:
        child.kill()
        child.wait()
        for pipe in (child.stdin, child.stdout, child.stderr):
            pipe.close()


def ready(child):
    line = child.stdout.readline()
    assert line, child.stderr.read()
    return json.loads(line)


def test_it_says_ready_as_json_and_sends_heartbeats_to_port_and_port_plus_one(start):
    """Catches a fleet whose second vehicle nobody hears."""
    port = mock_ports()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(("127.0.0.1", port + 1))
        client.settimeout(5.0)
        child = start("--vehicles", "2", "--udp", str(port), "--json", "--parent-pipe")
        message = ready(child)
        assert [each["system_id"] for each in message["vehicles"]] == [1, 2]
        decoder = Decoder()
        senders = set()
        while "HEARTBEAT" not in senders:
            senders |= {
                m.get_type()
                for m in decoder.feed(client.recv(2048), whole=True)
                if m.get_srcSystem() == 2
            }
        child.stdin.close()
        assert child.wait(5.0) == 0


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_end_it_cleanly(start, number):
    """Catches a signal that leaves a traceback or another exit code."""
    child = start("--zenoh", "tcp/127.0.0.1:0", "--json")
    ready(child)
    child.send_signal(number)
    assert child.wait(5.0) == 0
    assert child.stderr.read() == ""


def test_it_ends_when_its_parent_is_gone(start):
    """Catches a mock that outlives the program which started it."""
    child = start("--zenoh", "tcp/127.0.0.1:0", "--json", "--parent-pipe")
    ready(child)
    begun_s = time.monotonic()
    child.stdin.close()
    assert child.wait(5.0) == 0
    assert time.monotonic() - begun_s < 1.0


def test_a_port_in_use_is_one_clear_message(start):
    """Catches a traceback for a port of Zenoh in use."""
    first = start("--zenoh", "tcp/127.0.0.1:0", "--json")
    address = ready(first)["vehicles"][0]["endpoints"][0].split()[0]
    second = start("--zenoh", address)
    assert second.wait(10.0) == 3
    said = second.stderr.read()
    assert said.count("\n") == 1
    assert f"{address} is in use" in said


def test_alone_it_shows_its_help_and_ends_well():
    done = CliRunner().invoke(app, [])
    assert (done.exit_code, "calibrate" in done.output) == (0, True)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--vehicles", "px9:a", "--udp", "14540"], "px9"),
        (["--fleet", "no_such_file.toml", "--udp", "14540"], "no_such_file.toml"),
        (["--vehicles", "0", "--udp", "14540"], "vehicle"),
        (["--vehicles", "2"], "--zenoh"),
    ],
)
def test_a_wrong_use_is_one_line_and_exit_code_2(monkeypatch, capsys, arguments, named):
    monkeypatch.setattr(sys, "argv", ["sitl-mock", "run", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr().err
    assert (ended.value.code, said.count("\n")) == (2, 1)
    assert named in said


def test_the_page_of_modes_is_what_the_command_draws():
    page = (Path(__file__).parents[2] / "sitl_mock" / "MODES.md").read_text(encoding="utf-8")
    assert page.endswith(CliRunner().invoke(app, ["modes"]).output)


def test_ports_are_those_of_the_simulations():
    flavours = {"a": "px4", "b": "px4", "c": "arducopter", "d": "rover"}
    assert udp_ports(14540, flavours) == {
        "a": (14580, 14540),
        "b": (14581, 14541),
        "c": (0, 14560),
        "d": (0, 14570),
    }
    many = udp_ports(14540, {f"uav{number}": "px4" for number in range(41)})
    assert {own for own, _ in many.values()} == {0}
    assert sorted(target for _, target in many.values()) == [*range(14540, 14581)]
    with pytest.raises(ConfigError, match="65535"):
        udp_ports(65500, {f"uav{number}": "px4" for number in range(20)})


def test_help_teaches():
    runner = CliRunner()
    for arguments in ([], ["run"], ["list"], ["modes"]):
        result = runner.invoke(app, [*arguments, "--help"])
        assert result.exit_code == 0
    assert "--parent-pipe" in runner.invoke(app, ["run", "--help"], env={"COLUMNS": "200"}).output


def test_list_names_every_flavour_and_condition():
    assert all(name in CliRunner().invoke(app, ["list", "flavours"]).output for name in NAMES)
    assert all(
        name in CliRunner().invoke(app, ["list", "conditions"]).output for name in CONDITIONS
    )
    assert "COM_OF_LOSS_T" in CliRunner().invoke(app, ["list", "parameters"]).output
    assert (
        "LOCAL_POSITION_NED"
        in CliRunner().invoke(app, ["list", "streams", "--flavour", "arducopter"]).output
    )


@pytest.mark.parametrize("flavour", NAMES)
def test_modes_draws_the_table(flavour):
    drawn = CliRunner().invoke(app, ["modes", "--flavour", flavour]).output
    assert "| mode | custom_mode |" in drawn


def test_version_names_the_package_and_its_version():
    told = CliRunner().invoke(app, ["--version"])
    assert told.exit_code == 0
    (said,) = re.findall(r"^sitl-mock of (.+)$", told.output)
    for name, number in (one.split() for one in said.split(", ")):
        assert number == version(name)


def test_the_mock_and_its_plugin_import_neither_guidance_nor_matplotlib_nor_dask():
    """Catches a mock that needs the service it is a witness of."""
    modules = (
        "sitl_mock, sitl_mock.cli, sitl_mock.cli.run, sitl_mock.serving.serve, "
        "sitl_mock.pytest_plugin, sitl_mock.px4"
    )
    banned = '{"guidance", "matplotlib", "dask", "distributed", "scipy", "pandas", "pyarrow", "pydantic"}'
    program = f"import sys, {modules}; print(sorted({banned} & {{name.split('.')[0] for name in sys.modules}}))"
    told = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60.0, check=True
    )
    assert told.stdout.strip() == "[]"
