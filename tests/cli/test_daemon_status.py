"""A daemon's status for people: a table that fits, again and again, and the live line below the log."""

import io
import logging

import pytest
from rich.console import Console

from guidance.cli import print_answer
from guidance.cli.daemon import status_table
from guidance.errors import FlightError
from guidance.screen import aged
from guidance.session.observe.log import Log

STATUS = {
    "accepted": True, "order": "status", "name": "px4", "state": "engaged", "mode": "guided",
    "autopilot_mode": "OFFBOARD", "armed": True, "streaming": True, "heartbeat_age_s": 0.4, "position_age_s": 0.02,
    "evader_silence_s": 0.12, "position_ned_m": [12.5, -3.25, -19.5], "velocity_ned_m_s": [3.0, 4.0, -1.5],
    "height_m": 20.0, "battery": 0.87, "range_m": 31.4, "value_unit": "s", "recording": "on",
    "certificate": {
        "winner": "pursuer", "value": 9.25, "gap_m": 28.0, "time_needed_s": 9.8, "active_limits": ["descent", "fence"]
    },
    "to_do": [{"name": "battery", "found": "12% left", "wanted": "", "verdict": "refuse", "advice": "charge it"}],
}  # fmt: skip


def shown(status, width):
    written = io.StringIO()
    Console(file=written, width=width).print(status_table(status))
    return written.getvalue()


@pytest.mark.parametrize("width", [60, 80, 200])
def test_a_status_says_mode_height_position_battery_range_and_the_game_in_words(width):
    words = shown(STATUS, width)
    assert max(map(len, words.splitlines())) <= width
    said = " ".join(words.split())
    for part in (
        "OFFBOARD, armed", "20.0 m above home", "12.5 m north, -3.2 m east", "5.0 m/s level, 1.5 m/s up", "87%",
        "31.4 m to the evader", "winner pursuer", "9.2 s", "descent, fence", "charge it",
    ):  # fmt: skip
        assert part in said, part


def test_what_is_not_known_is_said_to_be_so():
    bare = {
        "accepted": True,
        "name": "px4",
        "state": "connecting",
        "mode": "unknown",
        "heartbeat_age_s": None,
    }
    words = shown(bare, 80)
    assert "HEARTBEAT never" in words
    assert "height" not in words
    waiting = {
        "name": "px4",
        "state": "waiting",
        "waiting_for": "a HEARTBEAT",
        "waited_s": 3.2,
        "connect_timeout_s": 60,
    }
    assert "for a HEARTBEAT, 3 s so far, 60 s at most" in shown(waiting, 80)


def test_an_order_is_answered_in_a_line(capsys):
    assert print_answer({"accepted": True, "order": "engage", "name": "px4"}) == 0
    assert "engage accepted" in capsys.readouterr().out
    refused = {
        "accepted": False,
        "order": "engage",
        "name": "px4",
        "state": "ready",
        "reason": "on the ground",
    }
    assert print_answer(refused) == FlightError.exit_code
    assert capsys.readouterr().out == "px4: engage refused, ready: on the ground\n"


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize(
    ("form", "term", "seen"),
    [("console", "xterm", 1), ("json", "xterm", 0), ("console", "dumb", 0)],
)
def test_a_live_line_is_drawn_where_it_can_be_redrawn_and_none_stays(form, term, seen, monkeypatch):
    monkeypatch.setenv("TERM", term)
    terminal = Terminal()
    log = Log(form, "info", terminal)
    log.show("engaged")
    log.say(logging.INFO, "order", {})
    log.close()
    written = terminal.getvalue()
    assert "order" in written
    assert ("engaged" in written) == seen
    assert written.endswith("\x1b[2K" if seen else "\n")


def test_a_line_that_is_old_says_how_old():
    assert aged("engaged  20.0 m up", 2.0, 2.5) == "engaged  20.0 m up"
    assert aged("engaged  20.0 m up", 9.0, 2.5) == "NO NEWS for 9 s; last engaged  20.0 m up"
    assert aged("", 9.0, 2.5) == ""
