"""A scenario flown in the terminal: a live line, then a table, the record and a picture."""

import contextlib
import json
import math
import re
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NoReturn

from rich.console import Console
from rich.table import Table

from guidance.cli import INTERRUPTED
from guidance.cli.fly_team import report_team
from guidance.errors import ConfigError, FlightError, OutputError
from guidance.extras import how_to_add
from guidance.files import private_file
from guidance.flight import State
from guidance.screen import aged, live, pairs, redraws
from guidance.screen import console as screen
from guidance.session.control_socket import ENDPOINT
from guidance.session.flight_files import OUTCOME, PICTURE, RECORD, TEAM, Stopped, flight_folder
from guidance.session.fly import NOBODY, Asked, ByFile, MockOptions, Onlooker, Played, Way, fly_recorded, left_out
from guidance.session.mission import Progress, Show
from guidance.session.result import FlightResult, MissionResult, ending_words, outcome_of_flight
from guidance.sim.outcome import Outcome, outcome_json
from guidance.sim.scenario_file import load_any
from guidance.sim.teams import TeamScenario

STALLED_S: Final = 1.0
"""Age of the live line from which it is shown as old; it is updated 50 times a second."""

_PLAIN_S: Final = 3.0
"""Shortest interval of plain lines about waiting."""

_WITH_CAUSE: Final = frozenset(
    {State.PAUSED, State.HOLDING, State.RETURNING, State.OUT_OF_CONTACT, State.YIELDED, State.FAILED}
)
"""States that are shown with what led to them."""


def fly_scenario(
    name: str, how: MockOptions | Asked, out: Path | None, seed: int | None, onlooker: Onlooker, *, as_json: bool
) -> int:
    """Fly a scenario; return the exit code: 0 when the game ended as it should have, or a team kept its guarantee.

    Args:
        name: Of one that comes along, or a path.
        how: The mock, or the vehicles that fly it: one, or in a game of teams one for each pursuer.
        out: Folder for the record and the picture.
        seed: In place of the scenario's.
        onlooker: Hears of the record (of a team, its folder) and, in real time, of the control endpoint.
        as_json: Print the outcome row as JSON, and text for people on standard error.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    path, scenario = load_any(name, seed)
    urls = "" if isinstance(how, MockOptions) else " ".join(how.urls)
    console = screen(stderr=as_json)
    words = "virtual time" if how.way == "fast" else ", ".join(filter(None, (how.link, urls)))
    console.print(f"[bold]{scenario.title}[/bold]  ({path.name}, {words})", highlight=False)
    row: Any
    with flight_folder(out, path.stem) as folder, _advised(name, urls):
        flight = flown(console, scenario, folder, how, onlooker)
        if isinstance(scenario, TeamScenario):
            rows = report_team(console, scenario, how.way, flight, folder)
            kept, row = bool(rows) and rows[0].captured >= rows[0].guaranteed, [outcome_json(one) for one in rows]
        else:
            (result,) = flight.vehicles.values()
            outcome = outcome_of_flight(result, how.way)
            report(console, result, outcome, folder)
            kept, row = result.captured, outcome_json(outcome)
    if as_json:
        sys.stdout.write(json.dumps(row, indent=2) + "\n")
    if urls and any(one.interrupted for one in flight.vehicles.values()):
        ended = ", ".join(dict.fromkeys(str(one.ended) for one in flight.vehicles.values()))
        console.print(f"interrupted: the vehicle was told to land, and is {ended}")
        return INTERRUPTED
    return 0 if kept else FlightError.exit_code


def flown(console: Console, scenario: Played, folder: Path, how: Way, onlooker: Onlooker = NOBODY) -> MissionResult:
    """Fly a scenario with the live line; say what is left out, how it is ordered, and what was not recorded.

    A vehicle of a file has a log instead of the live line. Arguments as of `fly_scenario`.
    """
    whom, on_control = f" --team {TEAM}" if isinstance(scenario, TeamScenario) else "", onlooker.on_control

    def tell_endpoint(endpoint: str) -> None:
        where = "" if endpoint == ENDPOINT else f" --endpoint {endpoint}"
        if whom or where:
            console.print(f"orders   guidance ctl ORDER{whom}{where}", soft_wrap=True, highlight=False)
        on_control(endpoint)

    for what in left_out(scenario, how):
        console.print(f"{what}: only a mock can have that; the vehicle flies without")
    with contextlib.ExitStack() as stack:
        if not isinstance(how, ByFile):
            line = LiveLine(console)
            stack.enter_context(live(console, line.line, every_s=0.1))
            show = stack.enter_context(noted_ctrl_c(line.show)) if isinstance(how, MockOptions) else line.show
            control = None if how.way == "fast" else ENDPOINT
            onlooker = onlooker._replace(show=show, control=control, on_control=tell_endpoint)
        result = fly_recorded(scenario, folder, how, onlooker)
    dropped = sum(one.record_dropped for one in result.vehicles.values())
    if dropped:
        console.print(f"[yellow]the disk was too slow: {dropped} messages are not in the record[/yellow]")
    return result


@contextlib.contextmanager
def noted_ctrl_c(show: Show) -> Iterator[Show]:
    """Raise KeyboardInterrupt on Ctrl-C, and again from the yielded `show`: a library may swallow the first one."""
    noted = False

    def note(*_: object) -> NoReturn:
        nonlocal noted
        noted = True
        raise KeyboardInterrupt

    def look(progress: Progress) -> None:
        if noted:
            raise KeyboardInterrupt
        show(progress)

    before = signal.signal(signal.SIGINT, note)
    try:
        yield look
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def _advised(name: str, urls: str) -> Iterator[None]:
    """Add the URLs, if there are any, to a refusal, and the commands that set the vehicles up."""
    try:
        yield
    except FlightError as error:
        vehicles = urls.split()
        scenario = f"{name} " if len(vehicles) == 1 else ""  # `check` plays no teams
        mend = "".join(f"\nto have it set up: guidance check {scenario}--vehicle {url} --apply" for url in vehicles)
        advice = mend if str(error).startswith("preflight refuses") else ""
        raise FlightError(f"{urls}: {error}{advice}" if urls else str(error)) from error


class LiveLine:
    """The live line: the flight's state, or the age of the last update. Without redrawing, a plain line per change.

    A team has a line for each vehicle.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._last: dict[str, Progress] = {}
        self._told_s = 0.0
        self._printed: dict[str, tuple[str, float]] = {}
        self._record_told = False

    def show(self, progress: Progress) -> None:
        """Update from one cycle of a vehicle."""
        name = progress.vehicle
        self._last[name], self._told_s = progress, time.perf_counter()
        if progress.record_stopped is not None and not self._record_told:
            self._record_told = True
            self._console.print(f"[yellow]{progress.now_s:7.1f} s  {record_words(progress.record_stopped)}[/yellow]")
        if redraws(self._console):
            return
        news, (printed, printed_s) = plain(progress), self._printed.get(name, ("", 0.0))
        waits = progress.waiting and self._told_s - printed_s < _PLAIN_S
        if not (waits or news == printed):
            self._printed[name] = news, self._told_s
            self._console.print(f"{progress.now_s:7.1f} s  {_named(progress, news)}", soft_wrap=True, highlight=False)

    def line(self) -> str:
        """Return the line, or the lines. A stalled loop shows as old."""
        lasting = list(self._last.values())
        stalled_s = math.inf if any(one.waiting for one in lasting) else STALLED_S
        return aged("\n".join(map(words, lasting)), time.perf_counter() - self._told_s, stalled_s)


def record_words(stopped: Stopped | None) -> str:
    """Say whether everything was recorded."""
    return "whole" if stopped is None else f"recording stopped at {stopped.now_s:.1f} s: {stopped.reason}"


def words(progress: Progress) -> str:
    """Return the live line of a flight."""
    begin = f"{progress.now_s:6.1f} s  {_named(progress, '')}"
    if progress.waiting:
        return f"{begin}waiting: {progress.waiting}"
    words = f"{begin}{progress.state:<11} in {progress.mode:<8}"
    if reason := _reason(progress):
        return f"{words} {reason}"
    certificate, unit = progress.certificate, progress.unit
    if progress.evader:
        to_go = (
            "" if certificate is None else f", {certificate.gap_m:5.1f} m to go, value {certificate.value:5.1f} {unit}"
        )
        return f"{words} {progress.evader}{to_go}{progress.promise and f'; {progress.promise}'}"
    if certificate is None:
        return words
    return (
        f"{words} range {certificate.gap_m:5.1f} m, {certificate.height_gap_m:5.1f} m up"
        f"  value to go {certificate.value:5.1f} {unit}, time needed {certificate.time_needed_s:5.1f} s"
    )


def _named(progress: Progress, words: str) -> str:
    """Put the vehicle's name before the words about it, in a team."""
    return f"{progress.vehicle}  {words}" if progress.evader else words


def plain(progress: Progress) -> str:
    """Return a line for output that cannot be redrawn. It changes only when the state, its cause or the evader does."""
    if not progress.waiting:
        against = f"{progress.state} against {progress.evader}" if progress.evader else str(progress.state)
        return ": ".join(filter(None, (against, _reason(progress))))
    return f"waiting: {re.sub(r'-?[0-9.]+ s old', 'old', progress.waiting)}"


def _reason(progress: Progress) -> str:
    """Say what led to a state, if that is worth it, and what a person can do now."""
    why = progress.why if progress.state in _WITH_CAUSE and "by operator" not in progress.next else ""
    return "; ".join(filter(None, (why, progress.next)))


def report(console: Console, result: FlightResult, outcome: Outcome, folder: Path) -> None:
    """Print the outcome of a flight and draw its picture."""
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
    from guidance.viz.report import draw_flight  # noqa: PLC0415 - matplotlib takes a second

    title = f"{outcome.scenario}: {ending_words(outcome)}, {score(outcome)}"
    try:
        draw_flight(folder / RECORD, folder / PICTURE, title)
    except (ConfigError, OutputError) as error:
        console.print(f"[yellow]picture  {error}[/yellow]", soft_wrap=True, highlight=False)
    else:
        console.print(f"picture  {folder / PICTURE}", soft_wrap=True, highlight=False)


def score(outcome: Outcome) -> str:
    """Say what was flown and predicted."""
    unit = "s" if outcome.game == "pe" else "m from T"
    if math.isnan(outcome.achieved):
        return "no game was played" if math.isnan(outcome.predicted) else f"{outcome.predicted:.2f} {unit} predicted"
    return f"{outcome.achieved:.2f} {unit} flown, {outcome.predicted:.2f} {unit} predicted"


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
