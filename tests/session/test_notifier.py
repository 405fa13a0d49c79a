"""Notifications to systemd, and operation without systemd."""

import socket

import pytest

from guidance.session.observe.signs_of_life import Notifier


@pytest.fixture
def systemd(tmp_path):
    """Return a socket that receives the notifications to systemd."""
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
    notifier = Notifier(environment, 77)
    notifier.send("READY=1")
    for cycle in range(100):
        notifier.alive(0.02 * cycle)
        notifier.status("ready, mode hold")
    notifier.send("STOPPING=1")
    assert read() == [
        "READY=1",
        "WATCHDOG=1",
        "STATUS=ready, mode hold",
        "WATCHDOG=1",
        "STOPPING=1",
    ]


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
    notifier = Notifier(environment, 1)
    notifier.send("READY=1")
    notifier.alive(1.0)


def test_a_watchdog_of_another_process_is_not_ours(systemd):
    path, read = systemd
    environment = {"NOTIFY_SOCKET": path, "WATCHDOG_USEC": "3000000", "WATCHDOG_PID": "78"}
    notifier = Notifier(environment, 77)
    notifier.alive(100.0)
    assert read() == []


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
