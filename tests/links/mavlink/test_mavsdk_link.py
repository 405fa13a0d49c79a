"""What MAVSDK itself does, beyond the contract that `tests/links/test_port.py` checks."""

import logging
import time
from contextlib import closing

import pytest
from mavsdk import Mavsdk

from guidance.links import MemoryWire
from guidance.links.mavlink.mavsdk_link import LOGGER, MavsdkLink
from tests.links.peer import until


@pytest.fixture
def logged():
    """Return all that MAVSDK logs: (level, message)."""
    lines = []
    handler = logging.Handler()
    handler.emit = lambda record: lines.append((record.levelno, record.getMessage()))
    level = LOGGER.level
    LOGGER.addHandler(handler)
    LOGGER.setLevel(logging.DEBUG)
    yield lines
    LOGGER.removeHandler(handler)
    LOGGER.setLevel(level)


def test_the_first_heartbeat_is_sent_and_nothing_is_logged_at_the_start(monkeypatch, logged):
    add = Mavsdk.add_any_connection

    def add_on_a_busy_computer(self, url):
        result = add(self, url)
        time.sleep(0.05)  # MAVSDK's thread sends its first HEARTBEAT meanwhile
        return result

    monkeypatch.setattr(Mavsdk, "add_any_connection", add_on_a_busy_computer)
    ours, theirs = MemoryWire.pair(time.monotonic)
    with closing(MavsdkLink(ours, time.monotonic, system_id=1)):
        assert until(lambda: bool(theirs.receive()), timeout_s=0.5)
    assert [message for level, message in logged if level >= logging.INFO] == []
    assert all(message.startswith("MAVSDK") for _, message in logged)
