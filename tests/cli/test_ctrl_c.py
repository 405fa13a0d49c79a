"""Ctrl-C while a mocked flight lasts."""

import contextlib
import io
import os
import signal

import pytest
from rich.console import Console

from guidance.cli import fly
from guidance.cli.fly import LiveLine
from guidance.errors import FlightError
from guidance.flight import State
from guidance.session.fly.mission import Progress
from guidance.session.open.mock import MockOptions
from guidance.session.open.opened import NOBODY
from tests.harness.flights import NEAR


def test_a_ctrl_c_that_a_library_swallows_is_raised_again_at_the_next_cycle():
    written = io.StringIO()
    line = LiveLine(Console(file=written))
    climbing = Progress(5.0, State.CLIMBING, "TAKEOFF", None, "s")
    before = signal.signal(signal.SIGINT, line.interrupt)
    try:
        line.show(climbing)
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
            signal.sigtimedwait([], 1.0)
        with pytest.raises(KeyboardInterrupt):
            line.show(climbing._replace(state=State.ENGAGED))
    finally:
        signal.signal(signal.SIGINT, before)
    assert written.getvalue().split() == ["5.0", "s", "climbing"]


def test_after_a_flight_ctrl_c_does_what_it_did_before(monkeypatch, tmp_path):
    handlers = []

    def refuse(*_):
        handlers.append(signal.getsignal(signal.SIGINT))
        raise FlightError("not today")

    monkeypatch.setattr(fly, "fly_recorded", refuse)
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(FlightError, match="not today"):
        fly.fly_rows(
            Console(file=io.StringIO()),
            NEAR,
            "near",
            MockOptions(fast=True),
            tmp_path / "out",
            NOBODY,
        )
    assert handlers != [before]
    assert signal.getsignal(signal.SIGINT) is before
