"""A flight in the terminal: a live line, then a table and a picture."""

import contextlib
import json
import math
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from guidance.errors import OutputError
from guidance.extras import how_to_add
from guidance.files import private_file
from guidance.flight import State
from guidance.screen import pairs, redraws
from guidance.session.control_socket import ENDPOINT
from guidance.session.flight_files import OUTCOME, PICTURE, RECORD, Stopped
from guidance.session.mission import Progress, Show
from guidance.session.result import FlightResult, ending_words
from guidance.sim.outcome import Outcome, outcome_json

REDRAWS_HZ: Final = 10.0
STALLED_S: Final = 1.0
"""Age of the live line from which it is shown as old; it is updated 50 times a second."""

_PLAIN_S: Final = 3.0
"""Shortest interval of plain lines about waiting."""

_WITH_CAUSE: Final = frozenset(
    {State.PAUSED, State.HOLDING, State.RETURNING, State.OUT_OF_CONTACT, State.YIELDED, State.FAILED}
)
"""States that are shown with what led to them."""


class LiveLine:
    """The live line: the flight's state, or the age of the last update. Without redrawing, a plain line per change."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._last: Progress | None = None
        self._told_s = self._printed_s = 0.0
        self._printed = ""
        self._record_told = False
        self.redrawn = redraws(console)

    def show(self, progress: Progress) -> None:
        """Update from one cycle."""
        self._last, self._told_s = progress, time.perf_counter()
        if progress.record_stopped is not None and not self._record_told:
            self._record_told = True
            self._console.print(f"[yellow]{progress.now_s:7.1f} s  {record_words(progress.record_stopped)}[/yellow]")
        news = plain(progress)
        waits = progress.waiting and self._told_s - self._printed_s < _PLAIN_S
        if not (self.redrawn or waits or news == self._printed):
            self._printed, self._printed_s = news, self._told_s
            self._console.print(f"{progress.now_s:7.1f} s  {news}", soft_wrap=True, highlight=False)

    def __rich__(self) -> Text:
        """Draw it. A stalled loop shows as old."""
        if self._last is None:
            return Text("")
        silence_s = time.perf_counter() - self._told_s
        if silence_s > STALLED_S and not self._last.waiting:
            return Text(f"NO NEWS for {silence_s:.0f} s; last {words(self._last)}", "bold red", no_wrap=True)
        return Text(words(self._last), no_wrap=True, overflow="crop")


@contextlib.contextmanager
def live_line(console: Console) -> Iterator[Show]:
    """Show one live line, redrawn ten times a second; where nothing can be redrawn, a plain line at every change."""
    line = LiveLine(console)
    with Live(line, console=console, auto_refresh=line.redrawn, refresh_per_second=REDRAWS_HZ, transient=True):
        yield line.show


def record_words(stopped: Stopped | None) -> str:
    """Say whether everything was recorded."""
    return "whole" if stopped is None else f"recording stopped at {stopped.now_s:.1f} s: {stopped.reason}"


def words(progress: Progress) -> str:
    """Return the live line of a flight."""
    if progress.waiting:
        return f"{progress.now_s:6.1f} s  waiting: {progress.waiting}"
    words = f"{progress.now_s:6.1f} s  {progress.state:<11} in {progress.mode:<8}"
    if reason := _reason(progress):
        return f"{words} {reason}"
    certificate, unit = progress.certificate, progress.unit
    if certificate is None:
        return words
    return (
        f"{words} range {certificate.gap_m:5.1f} m, {certificate.height_gap_m:5.1f} m up"
        f"  value to go {certificate.value:5.1f} {unit}, time needed {certificate.time_needed_s:5.1f} s"
    )


def plain(progress: Progress) -> str:
    """Return a line for output that cannot be redrawn. It changes only when the state or its cause does."""
    if not progress.waiting:
        return ": ".join(filter(None, (str(progress.state), _reason(progress))))
    return f"waiting: {re.sub(r'-?[0-9.]+ s old', 'old', progress.waiting)}"


def _reason(progress: Progress) -> str:
    """Say what led to a state, if that is worth it, and what a person can do now."""
    why = progress.why if progress.state in _WITH_CAUSE and "by operator" not in progress.next else ""
    return "; ".join(filter(None, (why, progress.next)))


def report(console: Console, result: FlightResult, outcome: Outcome, folder: Path) -> None:
    """Print the outcome of a flight and draw its picture."""
    tell_dropped(console, result)
    console.print(_table(result, outcome))
    if outcome.run == "fast":
        speed = result.duration_s / result.wall_s
        console.print(
            f"{result.duration_s:.1f} s of flight in {result.wall_s:.2f} s: {speed:.0f} times faster than real time"
        )
    console.print(f"record   {folder / RECORD}", soft_wrap=True, highlight=False)
    with contextlib.suppress(OSError):  # the picture reports a full disk
        row = json.dumps(outcome_json(outcome), indent=2) + "\n"
        private_file(folder / OUTCOME).write_text(row, encoding="utf-8")
    advice = how_to_add("plot")
    if advice is not None:
        console.print(f"picture  {advice}", soft_wrap=True, highlight=False, markup=False)
        return
    from guidance.viz.pictures import draw  # noqa: PLC0415 - matplotlib takes a second

    try:
        draw(result, outcome, folder / PICTURE)
    except OutputError as error:
        console.print(f"[yellow]picture  {error}[/yellow]", soft_wrap=True, highlight=False)
    else:
        console.print(f"picture  {folder / PICTURE}", soft_wrap=True, highlight=False)


def tell_dropped(console: Console, result: FlightResult) -> None:
    """Say so where the disk was too slow for the record."""
    if result.record_dropped:
        console.print(f"[yellow]the disk was too slow: {result.record_dropped} messages are not in the record[/yellow]")


def tell_endpoint(console: Console, endpoint: str) -> None:
    """Say how this flight is ordered, where another flight or daemon has the usual control endpoint."""
    if endpoint != ENDPOINT:
        console.print(f"orders   guidance ctl ORDER --endpoint {endpoint}", soft_wrap=True, highlight=False)


def _number(value: float, digits: int, unit: str = "") -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f} {unit}".rstrip()


def _table(result: FlightResult, outcome: Outcome) -> Table:
    unit, what = ("s", "time to capture") if outcome.game == "pe" else ("m", "evader's distance from its target")
    title = f"{ending_words(outcome)}; value is the {what}"
    rows = {
        "value predicted at engagement": _number(outcome.predicted, 2, unit),
        "time this vehicle needs, at engagement": _number(outcome.time_needed_s, 2, "s"),
        "flown": _number(outcome.achieved, 2, unit),
        "flown / predicted": _number(outcome.ratio, 3),
        "game lasted": _number(outcome.game_time_s, 2, "s"),
        "setpoints sent": f"{result.setpoints_sent}",
        "late cycles": f"{result.late_cycles} of {result.cycles}",
        "guarantee alarms": f"{outcome.alarms}",
        "flight ended": f"{result.ended}, after {outcome.duration_s:.1f} s",
        "record": record_words(result.record_stopped),
    }
    return pairs(rows.items(), title=title, right=True)
