"""Waits: for what, since when, until when; and a flight's live line that says when the loop stands still."""

import io

import pytest
from rich.console import Console

from guidance.cli.fly import LiveLine
from guidance.flight import State
from guidance.screen import counted, print_text_table, text_table, waiting
from guidance.session.fly.mission import Progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_wait_says_for_what_since_when_and_until_when(monkeypatch):
    now_s = [10.0]
    monkeypatch.setenv("TERM", "xterm")
    written = Terminal()
    with waiting(
        Console(file=written, width=80, get_time=lambda: now_s[0]), "a HEARTBEAT", 60.0
    ) as tell:
        now_s[0] = 22.0
        tell("parameters")
    assert "waiting for a HEARTBEAT: 0 s of 60 s" in written.getvalue()
    assert "waiting for parameters: 12 s of 60 s" in written.getvalue()


def test_where_nothing_can_be_redrawn_a_wait_is_said_once():
    written = io.StringIO()
    with waiting(Console(file=written, width=80), "a HEARTBEAT", 60.0) as tell:
        tell("parameters")
    assert written.getvalue() == "waiting for a HEARTBEAT, at most 60 s\n"


def test_a_live_line_of_a_loop_that_stands_still_says_so(monkeypatch):
    now_s = [0.0]
    monkeypatch.setattr("time.perf_counter", lambda: now_s[0])
    line = LiveLine(Console(file=io.StringIO()))
    assert line.line() == ""
    line.show(Progress(5.0, State.CLIMBING, "TAKEOFF", None, "s"))
    now_s[0] = 0.5
    assert line.line().startswith("   5.0 s  climbing")
    now_s[0] = 4.0
    assert line.line().startswith("NO NEWS for 4 s; last    5.0 s  climbing")


def lines(table, width):
    written = io.StringIO()
    Console(file=written, width=width).print(table)
    return [line.rstrip() for line in written.getvalue().splitlines()]


def test_long_cells_wrap_within_their_column():
    table = text_table(
        ("name", "how to fix it", "value"),
        [("MPC_XY_VEL_MAX", "param set to 12", "12.5")],
        left=(0, 1),
    )
    assert lines(table, 60) == [
        "name            how to fix it    value",
        "MPC_XY_VEL_MAX  param set to 12   12.5",
    ]
    assert lines(table, 34)[2:] == ["MPC_XY_VEL_MAX  param set     12.5", "                to 12"]


HEADINGS = ("evader", "end", "captor", "game_time_s", "predicted", "achieved")
EVADERS = [["rover1", "captured", "uav1", "12.340", "55.402", "55.401"]]


@pytest.mark.parametrize("width", [60, 100])
def test_a_table_that_does_not_fit_is_printed_as_names_and_values(width):
    out = io.StringIO()
    names = (*HEADINGS, "predicted_capture_time_s")
    rows = [[*EVADERS[0], "10.250"]]
    print_text_table(Console(file=out, width=width), names, rows, left=(0, 1, 2))
    text = out.getvalue()
    assert max(map(len, text.splitlines())) <= width
    assert all(name in text for name in names)
    assert all(cell in text for cell in rows[0])


def test_long_work_says_how_much_there_is_where_nothing_can_be_redrawn(capsys):
    assert list(counted(range(3), "drawing", 3)) == [0, 1, 2]
    assert capsys.readouterr().err == "drawing: 3 steps\n"
