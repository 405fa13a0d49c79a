"""Waits: for what, since when, until when; and a flight's live line that says when the loop stands still."""

import io

from rich.console import Console

from guidance.cli.flight_display import LiveLine
from guidance.flight import State
from guidance.screen import Sheet, Wait, waiting
from guidance.session.mission import Progress


def test_a_wait_says_for_what_since_when_and_until_when(monkeypatch):
    now_s = [10.0]
    monkeypatch.setattr("time.monotonic", lambda: now_s[0])
    wait = Wait("a HEARTBEAT", 60.0)
    now_s[0] = 22.0
    assert wait.__rich__().plain == "waiting for a HEARTBEAT: 12 s of 60 s at most"
    wait.what = ""
    assert wait.__rich__().plain == ""


def test_where_nothing_can_be_redrawn_a_wait_is_said_once():
    written = io.StringIO()
    with waiting(Console(file=written, width=80), "a HEARTBEAT", 60.0) as wait:
        wait.what = "parameters"
    assert written.getvalue() == "waiting for a HEARTBEAT, 60 s at most\n"


def test_a_live_line_of_a_loop_that_stands_still_says_so(monkeypatch):
    now_s = [0.0]
    monkeypatch.setattr("time.perf_counter", lambda: now_s[0])
    line = LiveLine()
    assert line.__rich__().plain == ""
    line.tell(Progress(5.0, State.CLIMBING, "TAKEOFF", None, "s"))
    now_s[0] = 0.5
    assert line.__rich__().plain.startswith("   5.0 s  climbing")
    now_s[0] = 4.0
    assert line.__rich__().plain.startswith("NO NEWS for 4 s; last    5.0 s  climbing")


def lines(sheet, width):
    written = io.StringIO()
    Console(file=written, width=width).print(sheet)
    return [line.rstrip() for line in written.getvalue().splitlines()]


def test_a_sheet_is_a_table_where_it_fits_and_a_paragraph_a_row_where_not():
    sheet = Sheet(("name", "how to set it", "value"), [("MPC_XY_VEL_MAX", "param set …", "12.5")], left=(0, 1))
    assert lines(sheet, 60) == ["name            how to set it  value", "MPC_XY_VEL_MAX  param set …     12.5"]
    assert lines(sheet, 30) == ["name           MPC_XY_VEL_MAX", "how to set it  param set …", "value          12.5"]


def test_only_the_last_column_of_a_list_is_cut():
    sheet = Sheet(("name", "title"), [("a_rather_long_name", "What it is about, at length")], left=(0, 1), cut=True)
    assert lines(sheet, 32) == ["name                title", "a_rather_long_name  What it is …"]
