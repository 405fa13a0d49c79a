"""docs/zenoh.md as it stands: its commands are run, its configuration is read, its evader reports."""

import re
import shlex
import socket
import tomllib
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.config import config_folder
from guidance.frames import Amsl, LocalFrame
from guidance.links.evaders.zenoh import report_of_json
from guidance.links.zenoh.access import ZenohSection, credentials_of, read_credentials
from guidance.links.zenoh.session import open_router, open_session
from guidance.session.vehicle_file import load_vehicle
from sitl_mock.cli import app as mock
from tests.links.peer import until
from tests.links.rigs import free_port

PAGE = (Path(__file__).parents[3] / "docs" / "zenoh.md").read_text(encoding="utf-8")
SITE = "192.168.1.10:7447"
REST = "\n[game]\nspeed_m_s = 6.0\nevader_speed_m_s = 3.0\n"


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


COMMANDS = [shlex.split(line) for block in blocks("console") for line in block.splitlines()]


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    """The folder that the page's first command creates."""
    folder = tmp_path_factory.mktemp("docs")
    made = CliRunner().invoke(
        app, [*COMMANDS[0][1:], "--out", str(folder / "keys")], catch_exceptions=False
    )
    assert made.exit_code == 0
    return folder / "keys"


def test_the_page_shows_these_commands():
    assert [command[:3] for command in COMMANDS] == [
        ["guidance", "zenoh", "keys"],
        ["guidance", "zenoh", "router"],
        ["guidance", "ctl", "status"],
        ["guidance", "view", "--live"],
        ["sitl-mock", "run", "--vehicles"],
    ]


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_option_on_the_page_exists(words):
    command = typer.main.get_command(app if words[0] == "guidance" else mock)
    rest = words[1:]
    while hasattr(command, "commands"):
        command = command.commands[rest[0]]
        rest = rest[1:]
    command.make_context(words[0], list(rest))  # raises for unknown options


def test_the_vehicle_file_of_the_page_is_read_and_its_certificates_are(keys):
    path = keys.parent / "uav1.toml"
    path.write_text('name = "uav1"\n' + blocks("toml")[0] + REST)
    config = load_vehicle(path)
    assert config.control.by_tls
    assert credentials_of(config.zenoh).tls["connect_certificate"] == str(
        keys / "uav1-guidance.pem"
    )


def test_so_is_its_file_with_a_password(keys):
    secret = keys / "uav1-guidance.password"
    secret.write_text("right\n")
    secret.chmod(0o600)
    section = ZenohSection(**tomllib.loads(blocks("toml")[1])["zenoh"]).beside(keys.parent)
    assert credentials_of(section).auth == {
        "usrpwd": {"user": "uav1-guidance", "password": "right"}
    }


def test_reports_of_the_pages_evader_arrive(keys, monkeypatch):
    monkeypatch.chdir(keys.parent)
    endpoint = f"127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    frame = LocalFrame(47.3977418, 8.5455939, Amsl(488.0))
    heard = []
    with (
        open_router(config_folder() / "zenoh" / "router.json5", keys, f"tls/{endpoint}"),
        open_session(
            f"tls/{endpoint}", credentials=read_credentials(keys / "uav1-guidance.toml")
        ) as session,
        session.declare_subscriber(
            "evader1/report", lambda sample: heard.append(sample.payload.to_bytes())
        ),
    ):

        def reported():
            exec(compile(blocks("python")[0].replace(SITE, endpoint), "docs/zenoh.md", "exec"), {})
            return heard

        assert until(reported)
    assert report_of_json(heard[0], 0.0, frame=frame, source="evader1/report").velocity_ned_m_s == (
        1.0,
        0.0,
        0.0,
    )
