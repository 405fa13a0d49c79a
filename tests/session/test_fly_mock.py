"""`guidance fly` as a person runs it: a process of its own, real time, the mock as its child, real clients."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader

from tests.harness.command import guidance
from tests.harness.silences import silences

NEAR = Path(__file__).parents[1] / "data" / "near_chase.toml"
GUIDANCE = Path(sys.executable).parent / "guidance"
PAUSE_TO_VALUE = 0.4
"""What one pause takes of a flight of 6.6 s: stop, stand for a second and be up to speed again."""


def start(folder, *arguments):
    return subprocess.Popen(
        [GUIDANCE, "fly", NEAR, "--out", folder, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "COLUMNS": "200"},
        cwd=folder.parent,
    )


def mock_of(parent):
    """Process id of the mock that is the child of `parent`."""
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            stat = (entry / "stat").read_text()
            if int(stat.rpartition(")")[2].split()[1]) == parent:
                return int(entry.name)
        except (OSError, ValueError):
            continue
    return None


def wait_for(process, words):
    """Read standard output until a line has the words."""
    for line in process.stdout:
        if words in line:
            return
    pytest.fail(f"never said {words!r}: {process.stderr.read()}")


def readable_messages(path):
    count = 0
    with path.open("rb") as stream:
        try:
            for _ in NonSeekingReader(stream).iter_messages(log_time_order=False):
                count += 1
        except EndOfFile:
            pass
    return count


@pytest.mark.slow
@pytest.mark.parametrize("link", ["mavsdk", pytest.param("pymavlink", marks=pytest.mark.long)])
def test_a_pursuit_is_flown_in_real_time_over_mavlink_and_zenoh(tmp_path, link):
    process = start(tmp_path / "out", "--link", link)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, out + err + silences(tmp_path / "out" / "record.mcap")
    assert "captured" in out
    # Of this machine's; none where it has time
    pauses = len(re.findall(r"paused: loop late$", out, re.MULTILINE))
    assert (
        0.85
        < float(re.search(r"flown / predicted +([\d.]+)", out)[1])
        < 1.15 + PAUSE_TO_VALUE * pauses
    ), out
    with (tmp_path / "out" / "record.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    sent = int(re.search(r"setpoints sent +(\d+)", out)[1])
    topics = {
        channel.topic: summary.statistics.channel_message_counts[key]
        for key, channel in summary.channels.items()
    }
    assert topics["pursuer/mavlink_raw/in"] >= sent > 300
    assert (tmp_path / "out" / "flight.png").stat().st_size > 20_000


@pytest.mark.slow
def test_a_mock_that_dies_in_flight_ends_the_run_in_3_s_with_a_readable_record(tmp_path):
    process = start(tmp_path / "out")
    wait_for(process, "climbing")
    mock = mock_of(process.pid)
    os.kill(mock, signal.SIGKILL)
    killed_s = time.monotonic()
    _, err = process.communicate(timeout=20)
    assert time.monotonic() - killed_s < 3.0
    assert process.returncode == 3
    assert "the mock autopilot ended in flight (exit code -9)" in err
    assert "Traceback" not in err
    assert readable_messages(tmp_path / "out" / "record.mcap") > 500


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_ctrl_c_and_sigterm_end_the_children_too(tmp_path, number, code):
    process = start(tmp_path / "out", "--link", "pymavlink")
    wait_for(process, "checking")
    mock = mock_of(process.pid)
    process.send_signal(number)
    _, err = process.communicate(timeout=20)
    assert process.returncode == code, err
    assert "Traceback" not in err
    assert not Path(f"/proc/{mock}").exists()
    assert readable_messages(tmp_path / "out" / "record.mcap") > 0


@pytest.mark.flight
def test_a_port_in_use_is_one_message_and_nothing_is_left_running(tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        process = start(tmp_path / "out", "--port", str(taken.getsockname()[1]))
        _, err = process.communicate(timeout=30)
    assert process.returncode == 3
    assert err.count("error:") == 1
    assert "in use" in err
    assert "--port" in err
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fly", "nonsense"], "no scenario 'nonsense'"),
        (["fly", "--link", "carrier-pigeon"], "allowed are mavsdk, pymavlink"),
        (["fly", "--port", "70000"], "65535"),
    ],
)
def test_bad_arguments_end_with_one_clear_message(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = guidance(*arguments)
    assert done.returncode == 2
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []
