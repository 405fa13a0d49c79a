"""A pipe in the place of a file is refused at once: nobody may ever write to it, and a daemon must not wait."""

import os
import threading
from datetime import UTC, datetime

import pytest

from guidance.errors import ConfigError
from guidance.links.zenoh import keys
from guidance.log.reader import survey_of
from guidance.session.drawn_plan import corners_deg
from guidance.session.orders import control_socket, control_token
from guidance.sim.scenario_file import load_any
from guidance.toml_files import read

SCENARIO = """
title = "piped"
game = "pe"
[pursuer]
position_m = [0.0, 0.0, 10.0]
speed_m_s = 6.0
[evader]
position_m = [30.0, 0.0]
speed_m_s = 2.0
policy = "track"
track = "{}"
"""


@pytest.fixture
def pipe(tmp_path):
    path = tmp_path / "pipe.csv"
    os.mkfifo(path)
    return path


@pytest.mark.parametrize(
    "reading",
    [
        read,
        survey_of,
        lambda path: corners_deg(path, "limits.fence_file"),
        control_token.read_token,
    ],
)
def test_a_pipe_is_no_file_and_hangs_nobody(pipe, reading):
    with pytest.raises(ConfigError, match="regular file"):
        reading(pipe)


def test_a_pipe_is_no_key_of_the_authority(tmp_path):
    (tmp_path / "ca.pem").touch()
    os.mkfifo(tmp_path / "ca.key")
    began = datetime.now(UTC)
    with pytest.raises(ConfigError, match="regular file"):
        keys.make_keys(tmp_path, [], [], (began, began))


@pytest.mark.parametrize("name", ["track.csv", "track.mcap"])
def test_a_pipe_is_no_track(tmp_path, name):
    os.mkfifo(tmp_path / name)
    scenario = tmp_path / "piped.toml"
    scenario.write_text(SCENARIO.format(name))
    with pytest.raises(ConfigError, match="regular file"):
        load_any(scenario)


def test_a_moment_without_a_thread_ends_no_order_socket(monkeypatch):
    free = threading.BoundedSemaphore(1)

    def refuse(_thread):
        raise RuntimeError("can't start new thread")

    done = threading.Event()
    with monkeypatch.context() as patched:
        patched.setattr(threading.Thread, "start", refuse)
        assert not control_socket.begin_exchange(free, done.set)
    assert control_socket.begin_exchange(free, done.set)
    assert done.wait(3.0)
