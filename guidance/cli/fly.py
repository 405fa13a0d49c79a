"""`guidance fly`: a pursuit, flown: a live line, then a table, the record and a picture."""

import contextlib
import math
import re
import signal
import sys
import time
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any, Final, NoReturn

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from guidance.cli import INTERRUPTED, arguments
from guidance.cli.players import rows_json, tell_players
from guidance.cli.viewers import CommandBeside, panel_beside
from guidance.config import parse_document
from guidance.control.limits import Limiter
from guidance.errors import ConfigError, FlightError, OutputError
from guidance.extras import how_to_add, require_extras
from guidance.files import private_folder, whole_file, writing
from guidance.flight import State
from guidance.links.port import is_px4
from guidance.log.entries import OUTCOME
from guidance.screen import aged, console, headed, live, pairs, redraws
from guidance.session.flight_files import PICTURE, RECORD, TEAM_FOLDER, flight_folder
from guidance.session.fly.mission import Progress
from guidance.session.fly.result import (
    FlightResult,
    MissionResult,
    ending_words,
    outcome_of_flight,
    team_rows,
)
from guidance.session.open.file import ByFile
from guidance.session.open.mock import MockOptions
from guidance.session.open.opened import FlyableScenario, Onlooker, Way
from guidance.session.open.url import Asked
from guidance.session.orders.words import ENDPOINT
from guidance.session.output_sections import RosSection
from guidance.session.recorded_flight import fly_recorded
from guidance.sim.outcome import Outcome
from guidance.sim.scenario_file import load_any, with_policies
from guidance.sim.teams import TeamScenario

STALLED_S: Final = 1.0
"""Age of the live line from which it is shown as old; it is updated 50 times a second."""

_PLAIN_S: Final = 3.0
"""Shortest interval of plain lines about waiting."""

_WITH_CAUSE: Final = {
    State.PAUSED,
    State.HOLDING,
    State.RETURNING,
    State.OUT_OF_CONTACT,
    State.YIELDED,
    State.FAILED,
}
"""States that are shown with what led to them."""


def fly(
    ctx: typer.Context,
    scenario: arguments.ScenarioName = "pe",
    vehicle: Annotated[
        list[str] | None, typer.Option(help="URL of an autopilot. IT IS ARMED.", metavar="URL")
    ] = None,
    parameters: arguments.Parameters = None,
    autopilot: arguments.Expected = None,
    yes: arguments.Yes = False,
    end: Annotated[
        str, typer.Option(help="End of a flight with --vehicle: return home, or land.")
    ] = "return",
    fast: Annotated[
        bool, typer.Option("--fast", help="Fly in virtual time, as fast as the processor goes.")
    ] = False,
    link: arguments.Link = "mavsdk",
    port: arguments.Port = 0,
    out: arguments.FlightFolder = None,
    seed: arguments.Seed = None,
    pursuer: Annotated[
        str | None,
        typer.Option(
            help="Policy of the pursuer, in place of the scenario's; also your own: policy.py:choose.",
            metavar="POLICY",
        ),
    ] = None,
    view: Annotated[
        bool, typer.Option("--view", help="Show the flight in Rerun (needs the extra viz).")
    ] = False,
    panel: arguments.Panel = False,
    ros: Annotated[
        str | None,
        typer.Option(
            help="Publish ROS 2 topics on this Zenoh router (extra ros): tcp/127.0.0.1:7447.",
            metavar="ENDPOINT",
        ),
    ] = None,
    as_json: arguments.AsJson = False,
) -> None:
    """Fly a pursuit, of the mock or of an autopilot that runs already, and show how it compares with the game's value.

    Starts the mock (a PX4-flavoured copter and a ground rover) as a child process on a loopback Zenoh session, connects
    as to a real vehicle, arms, takes off, flies to the scenario's start, plays the game at 50 Hz over MAVLink until the
    stand-off disc around the evader is reached, holds, lands and disarms. Writes the record (MCAP), a picture (PNG) and
    the outcome row (JSON). With `--json` that row is also printed, and text for people goes to standard error.

    With `--vehicle URL` nothing is started: the autopilot there, PX4 or ArduCopter, is **armed**, climbs, flies to the
    start, plays, returns and lands. The scenario is laid about its home, and its evader is simulated here and reports
    in MAVLink as a real one would. Preflight has to pass (`guidance check --vehicle URL --apply`). Ctrl-C lands it; the
    pilot's mode switch takes it at any moment. The command asks before it
    flies a vehicle that is not on loopback.

    - `guidance fly`: the paper's PE game, in real time
    - `guidance fly config/scenarios/tad.toml`: the paper's TAD game
    - `guidance fly --fast`: the same flight in virtual time
    - `guidance fly --pursuer policy.py:choose --fast`: your own policy, **run as your own code**
    - `guidance fly --link pymavlink`: with pymavlink instead of MAVSDK
    - `guidance fly --view`: with a view of it in the browser, from a process of its own
    - `guidance fly --panel`: with the operator's page, its picture and its orders
    - `guidance fly --port 7447 --ros tcp/127.0.0.1:7447`: with ROS 2 topics, on the mock's own router
    - `guidance fly hover_chase --vehicle udpin://127.0.0.1:14540`: PX4's SITL
    - `guidance fly hover_chase --vehicle tcpout://127.0.0.1:5760`: ArduPilot's SITL
    - `guidance fly hover_chase --vehicle zenoh+tcp://127.0.0.1:7447 --parameters udpin://127.0.0.1:14540`: as a flight
      mode of PX4
    - `guidance fly teams_guard`: a team, with one page for all of it, which ends with the flight
    - `guidance fly teams_guard --vehicle URL1 --vehicle URL2 --vehicle URL3`: a team
    """
    if not vehicle:
        arguments.refuse(
            ctx, "the mock", "with --vehicle", "--yes", "--autopilot", "--end", "--parameters"
        )
    else:
        arguments.refuse(
            ctx, f"--vehicle {' '.join(vehicle)}", "without it, with the mock", "--fast", "--port"
        )
        arguments.may_fly(vehicle, yes=yes)
    if fast:
        arguments.refuse(ctx, "--fast", "in real time", "--link", "--port", "--panel", "--ros")
    topics = None if ros is None else ros_at(ros)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    team = isinstance(load_any(scenario)[1], TeamScenario)
    page = panel
    if team and not fast and not as_json and how_to_add("panel") is None:
        page = True
    with _Beside(
        view=view, panel=page, folder=Path("flights") if out is None else out.parent
    ) as beside:
        try:
            mock = MockOptions(fast=fast, link=link, port=port)
            how: MockOptions | Asked = mock
            if vehicle:
                how = Asked(tuple(vehicle), autopilot, link, end, tuple(parameters or ()))
            onlooker = Onlooker(on_record=beside.record, on_control=beside.control, ros=topics)
            code = fly_scenario(
                scenario, how, out, seed, onlooker, pursuer=pursuer, as_json=as_json
            )
        except KeyboardInterrupt:
            nothing = "nothing was armed" if vehicle else "nothing was recorded"
            record_words = (
                nothing if beside.recorded is None else f"the record so far is {beside.recorded}"
            )
            typer.echo(
                f"interrupted: {'' if vehicle else 'the mock was ended; '}{record_words}", err=True
            )
            raise typer.Exit(INTERRUPTED) from None
        if beside.running and (view or panel):
            with contextlib.suppress(KeyboardInterrupt):
                typer.echo("the view stays: Ctrl-C ends it")
                for command in beside.running:
                    command.child.wait()
    raise typer.Exit(code)


def ros_at(endpoint: str) -> RosSection:
    """Return where ROS 2 topics are published.

    Raises:
        ConfigError: If the endpoint is not a Zenoh router by TCP. TLS needs the certificates of a vehicle file.
    """
    option = f"--ros {endpoint}"
    if not endpoint.startswith("tcp/"):
        raise ConfigError(f"{option}: allowed is tcp/HOST:PORT; by TLS a vehicle file has [ros]")
    return parse_document(RosSection, {"endpoint": endpoint}, source=option)


class _Beside(contextlib.ExitStack):
    """The viewer and the page beside a flight, each if asked for; they end with this context."""

    def __init__(self, *, view: bool, panel: bool, folder: Path) -> None:
        super().__init__()
        for needed, option, extra in ((view, "the view", "viz"), (panel, "--panel", "panel")):
            if needed:
                require_extras(option, extra)
        self._view = view
        self._panel = panel
        self._folder = folder
        self.running = list[CommandBeside]()
        self.recorded: Path | None = None

    def record(self, path: Path) -> None:
        """Show a record that is being written."""
        if self.recorded is None:
            self.recorded = path
        if self._view:
            self._add(
                CommandBeside("view", str(path), "--follow", "--port", "0", "--web-port", "0")
            )

    def control(self, endpoint: str) -> None:
        """Serve the page of a flight that takes orders here."""
        if self._panel:
            self._add(panel_beside(endpoint, self._folder))

    def _add(self, command: CommandBeside) -> None:
        self.running.append(self.enter_context(contextlib.closing(command)))


def fly_scenario(
    name: str,
    how: MockOptions | Asked,
    out: Path | None,
    seed: int | None,
    onlooker: Onlooker,
    *,
    pursuer: str | None = None,
    as_json: bool,
) -> int:
    """Fly a scenario; return the exit code: 0 when the game ended as it should have, or a team kept its guarantee.

    Args:
        name: Of one that comes along, or a path.
        how: The mock, or the vehicles that fly it: one, or in a game of teams one for each pursuer.
        out: Folder for the record and the picture.
        seed: In place of the scenario's.
        onlooker: Hears of the record (of a team, its folder) and, in real time, of the control endpoint.
        pursuer: Policy in place of the scenario's.
        as_json: Print the outcome row as JSON, and text for people on standard error.

    Raises:
        GuidanceError: For everything that the user can fix.
    """
    path, scenario = load_any(name, seed)
    if pursuer is not None:
        if isinstance(scenario, TeamScenario):
            raise ConfigError(f"--pursuer {pursuer}: only for a scenario of two players")
        scenario = with_policies(scenario, pursuer=pursuer)
    urls: tuple[str, ...] = ()
    if not isinstance(how, MockOptions):
        urls = how.urls
    target = console(stderr=as_json)
    client = "a flight mode of PX4" if urls and all(map(is_px4, urls)) else how.link
    words = "virtual time" if how.way == "fast" else ", ".join((client, *urls))
    target.print(headed(scenario.title, f"  ({path.name}, {words})"))
    try:
        result, rows, folder = fly_rows(target, scenario, path.stem, how, out, onlooker)
    except FlightError as error:
        beside = () if isinstance(how, MockOptions) else how.parameters
        # With the URLs, if there are any, and the commands that set the vehicles up.
        refusal = str(error)
        scenario_word = f"{name} " if len(urls) == 1 else ""  # `check` plays no teams
        remedy = ""
        for url, mavlink_url in zip_longest(urls, beside):
            options = f"--vehicle {url}"
            if is_px4(url):
                options += f" --parameters {mavlink_url or 'udpin://127.0.0.1:14540'}"
            remedy += f"\nto have it set up: guidance check {scenario_word}{options} --apply"
        advice = remedy if refusal.startswith("preflight refuses") else ""
        advised = f"{' '.join(urls)}: {refusal}{advice}" if urls else refusal
        raise FlightError(advised) from error
    flights = [*result.vehicles.values()]
    unwritten = [flight.record_stopped for flight in flights if flight.record_stopped]
    if isinstance(scenario, TeamScenario):
        succeeded = len(rows) > 0 and rows[0].captured >= rows[0].guaranteed
    else:
        unwritten += print_outcome(target, flights[0], rows[0], folder)
        succeeded = flights[0].captured
    if as_json:
        typer.echo(rows_json(scenario, rows), nl=False)
    if urls and any(flight.interrupted for flight in flights):
        ends = ", ".join(dict.fromkeys(str(flight.ended) for flight in flights))
        target.print(f"interrupted: the vehicle was told to land, and is {ends}")
        return INTERRUPTED
    if not succeeded:
        return FlightError.exit_code
    if unwritten:
        raise OutputError(f"the flight is not recorded whole: {'; '.join(unwritten)}")
    return 0


def fly_rows(
    target: Console,
    scenario: FlyableScenario,
    stem: str,
    how: Way,
    out: Path | None,
    onlooker: Onlooker,
) -> tuple[MissionResult, Sequence[Any], Path]:
    """Fly a scenario with the live line; say what is left out, how it is ordered, and what was not recorded.

    A vehicle of a file has a log instead of the live line. Arguments as of `fly_scenario`; without `out`, the folder
    is a new one called like `stem`.

    Returns:
        The result, its rows and the folder.
    """
    team_option = f" --team {TEAM_FOLDER}" if isinstance(scenario, TeamScenario) else ""
    on_control = onlooker.on_control

    def tell_endpoint(endpoint: str) -> None:
        endpoint_option = "" if endpoint == ENDPOINT else f" --endpoint {endpoint}"
        if team_option or endpoint_option:
            target.print(
                f"orders   guidance ctl ORDER{team_option}{endpoint_option}", soft_wrap=True
            )
        on_control(endpoint)

    with flight_folder(out, stem) as folder:
        for part in how.left_out(scenario):
            target.print(f"{part}: only a mock can have that; the vehicle flies without")
        with contextlib.ExitStack() as stack:
            if not isinstance(how, ByFile):
                line = LiveLine(target)
                control = None if how.way == "fast" else ENDPOINT
                stack.enter_context(live(target, line.line, every_s=0.1))
                if isinstance(how, MockOptions):
                    stack.callback(
                        signal.signal, signal.SIGINT, signal.signal(signal.SIGINT, line.interrupt)
                    )
                onlooker = onlooker._replace(
                    show=line.show, control=control, on_control=tell_endpoint
                )
            result = fly_recorded(scenario, folder, how, onlooker)
        if dropped := sum(flight.record_dropped for flight in result.vehicles.values()):
            target.print(
                f"the disk was too slow: {dropped} messages are not in the record", style="yellow"
            )
        if isinstance(scenario, TeamScenario):
            # The outcome of a flight and where its records are.
            rows = team_rows(scenario, how.way, result)
            separation = scenario.flight
            tell_players(rows, target, result)
            least_m = result.least_distance_m(separation.separation_height_m)
            least_words = "never at one height" if math.isinf(least_m) else f"{least_m:.2f} m"
            level = f"less than {separation.separation_height_m:g} m apart in height"
            distance = f"least distance of two vehicles {level}: {least_words}"
            target.print(f"{distance} ({separation.separation_m:g} m wanted)")
            flights = result.vehicles.values()
            if any(Limiter.SEPARATION in flight.limits for flight in flights):
                target.print(
                    f"Vehicles made way for each other (limit {Limiter.SEPARATION}); promises do not count that."
                )
            duration_s = max(flight.duration_s for flight in flights)
            wall_s = max(flight.wall_s for flight in flights)
            target.print(f"{duration_s:.1f} s of flight in {wall_s:.2f} s")
            target.print(f"records  {folder}/VEHICLE/{RECORD}", soft_wrap=True)
            write_outcome(folder, rows_json(scenario, rows))
            return result, rows, folder
        return (
            result,
            [outcome_of_flight(flight, how.way) for flight in result.vehicles.values()],
            folder,
        )


class LiveLine:
    """The live line: the flight's state, or the age of the last update. Without redrawing, a plain line per change.

    A team has a line for each vehicle.
    """

    def __init__(self, target: Console) -> None:
        self._there = target
        self._last: dict[str, Progress] = {}
        self._updated_s = 0.0
        self._printed: dict[str, tuple[str, float]] = {}
        self._record_reported = self._interrupted = False

    def interrupt(self, *_: object) -> NoReturn:
        """Handle Ctrl-C: KeyboardInterrupt is raised here, and again by `show`, as a library may swallow this one."""
        self._interrupted = True
        raise KeyboardInterrupt

    def show(self, progress: Progress) -> None:
        """Update from one cycle of a vehicle."""
        if self._interrupted:
            raise KeyboardInterrupt
        self._last[progress.vehicle] = progress
        self._updated_s = time.perf_counter()
        if progress.record_stopped and not self._record_reported:
            self._record_reported = True
            self._there.print(f"{progress.now_s:7.1f} s  {progress.record_stopped}", style="yellow")
        if redraws(self._there):
            return
        news = plain_line(progress)
        (printed, printed_s) = self._printed.get(progress.vehicle, ("", 0.0))
        is_repetition = bool(progress.waiting) and self._updated_s - printed_s < _PLAIN_S
        if news != printed and not is_repetition:
            self._printed[progress.vehicle] = news, self._updated_s
            line = f"{progress.now_s:7.1f} s  {_with_vehicle_name(progress, news)}"
            self._there.print(line, soft_wrap=True)

    def line(self) -> str:
        """Return the line, or the lines. A stalled loop shows as old."""
        vehicles = list(self._last.values())
        lines = "\n".join(map(words, vehicles))
        age_s = time.perf_counter() - self._updated_s
        is_waiting = any(progress.waiting for progress in vehicles)
        stalled_s = math.inf if is_waiting else STALLED_S
        return aged(lines, age_s, stalled_s)


def words(progress: Progress) -> str:
    """Return the live line of a flight."""
    begin = f"{progress.now_s:6.1f} s  {_with_vehicle_name(progress, '')}"
    if progress.waiting:
        return f"{begin}waiting: {progress.waiting}"
    words = f"{begin}{progress.state:<11} in {progress.mode:<8}"
    if reason := _cause_and_next_step(progress):
        return f"{words} {reason}"
    game = progress.certificate
    unit = progress.unit
    if progress.evader:
        against = f"{words} {progress.evader}"
        if game is not None:
            against += f", {game.gap_m:5.1f} m to go, value {game.value:5.1f} {unit}"
        if progress.promise:
            against += f"; {progress.promise}"
        return against
    if game is None:
        return words
    distances = f"range {game.gap_m:5.1f} m, {game.height_gap_m:5.1f} m up"
    times = f"value to go {game.value:5.1f} {unit}, time needed {game.time_needed_s:5.1f} s"
    return f"{words} {distances}  {times}"


def _with_vehicle_name(progress: Progress, words: str) -> str:
    """Put the vehicle's name before the words about it, in a team."""
    return f"{progress.vehicle}  {words}" if progress.evader else words


def plain_line(progress: Progress) -> str:
    """Return a line for output that cannot be redrawn. It changes only when the state, its cause or the evader does."""
    if progress.waiting:
        lasting_words = re.sub(r"-?[0-9.]+ s old", "old", progress.waiting)
        return f"waiting: {lasting_words}"
    state = str(progress.state)
    if progress.evader:
        state += f" against {progress.evader}"
    return ": ".join(filter(None, (state, _cause_and_next_step(progress))))


def _cause_and_next_step(progress: Progress) -> str:
    """Say what led to a state, if that is worth it, and what a person can do now."""
    cause = ""
    if progress.state in _WITH_CAUSE and "by operator" not in progress.next:
        cause = progress.why
    return "; ".join(filter(None, (cause, progress.next)))


def print_outcome(
    target: Console, result: FlightResult, outcome: Outcome, folder: Path
) -> Sequence[str]:
    """Print the outcome of a flight and draw its picture; return what could not be written, and why."""
    target.print(result_table(result, outcome))
    if outcome.run == "fast":
        flown_s = result.duration_s
        wall_s = result.wall_s
        speedup = flown_s / wall_s
        pace = f"{speedup:.0f} times faster than real time"
        if speedup < 1.0:
            pace = "slower than real time, because the machine is slow or busy"
        target.print(f"{flown_s:.1f} s of flight in {wall_s:.2f} s: {pace}")
    target.print(f"record   {folder / RECORD}", soft_wrap=True)
    unwritten = []
    try:
        write_outcome(folder, rows_json(result.scenario, [outcome]))
    except OutputError as error:
        unwritten.append(str(error))
    title = f"{outcome.scenario}: {ending_words(outcome)}, {score(outcome)}"
    advice = how_to_add("plot")
    if advice is None:
        from guidance.viz.report import draw_flight  # noqa: PLC0415 - matplotlib takes a second

        try:
            draw_flight(folder / RECORD, folder / PICTURE, title)
        except (ConfigError, OutputError) as error:
            unwritten.append(str(error))
            advice = str(error)
    picture = Text(f"picture  {folder / PICTURE}")
    if advice:
        picture = Text(f"picture  {advice}", "yellow")
    target.print(picture, soft_wrap=True)
    return unwritten


def write_outcome(folder: Path, text: str) -> None:
    """Write the outcome rows into a flight's folder.

    Raises:
        OutputError: If they cannot be written.
    """
    with writing(folder / OUTCOME):
        private_folder(folder)
        with whole_file(folder / OUTCOME) as unfinished:
            unfinished.write_text(text, encoding="utf-8")


def score(outcome: Outcome) -> str:
    """Say what was flown and predicted."""
    unit = "s" if outcome.game == "pe" else "m from T"
    predicted = f"{outcome.predicted:.2f} {unit} predicted"
    if not math.isnan(outcome.achieved):
        return f"{outcome.achieved:.2f} {unit} flown, {predicted}"
    return "no game was played" if math.isnan(outcome.predicted) else predicted


def _number(value: float, digits: int, unit: str = "") -> str:
    if math.isnan(value):
        return "-"
    text = f"{value:.{digits}f} {unit}"
    return text.rstrip()


def result_table(result: FlightResult, outcome: Outcome) -> Table:
    """Return the table of a flight's result."""
    unit = "m"
    quantity = "evader's distance from its target"
    if outcome.game == "pe":
        unit = "s"
        quantity = "time to capture"
    reached = "-"
    if result.latest is not None and not math.isnan(result.latest.reachable_speed_m_s):
        asked_m_s = result.scenario.pursuer.speed_m_s
        reached = f"{result.latest.reachable_speed_m_s:.1f} of {asked_m_s:g} m/s"
    rows = {
        "value predicted at engagement": _number(outcome.predicted, 2, unit),
        "time this vehicle needs, at engagement": _number(outcome.time_needed_s, 2, "s"),
        "flown": _number(outcome.achieved, 2, unit),
        "flown / predicted": _number(outcome.ratio, 3),
        "game lasted": _number(outcome.game_time_s, 2, "s"),
        "speed this vehicle reached at the end": reached,
        "setpoints sent": f"{result.setpoints_sent}",
        "late cycles": f"{result.late_cycles} of {result.cycles}",
        "guarantee alarms": f"{outcome.alarms}",
        "flight ended": f"{result.ended}, after {outcome.duration_s:.1f} s",
        "record": result.record_stopped if result.record_stopped else "whole",
    }
    title = f"{ending_words(outcome)}; value is the {quantity}"
    return pairs(rows.items(), title=title, right=True)
