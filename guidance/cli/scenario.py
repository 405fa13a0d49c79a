"""`guidance scenario`: runs, lists and explains scenario files."""

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from guidance.cli import arguments
from guidance.cli.players import as_text, rows_json, tell_players
from guidance.config import config_folder, find
from guidance.errors import ConfigError, FlightError
from guidance.extras import require_extras
from guidance.game.speed_sets import speed_set_named
from guidance.screen import console, headed, pairs, text_table
from guidance.sim.batch import stack
from guidance.sim.expect import CheckedExpectation, Ranges
from guidance.sim.maths import opening, play_scenarios
from guidance.sim.outcome import winner_name
from guidance.sim.scenario import (
    FLOWN_SPEED_SET,
    MATHS_SPEED_SET,
    WIND_WORDS,
    Scenario,
    Target,
)
from guidance.sim.scenario_file import SCENARIO_FOLDER, load_any
from guidance.sim.teams import TeamScenario, opening_of, play_teams, summary_of
from guidance.texts import printable

if TYPE_CHECKING:
    from guidance.session.open.opened import Way

scenario = typer.Typer(
    cls=arguments.CommandGroup,
    help="Run a scenario file: as mathematics, as a mocked flight, or on a real autopilot.",
)

_GAMES: Final = {"pe": "pursuit-evasion", "tad": "target-attacker-defender"}
_LISTED: Final = ("name", "game", "title", "expected")
_WAYS: Final = ("maths", "fast", "live", "vehicle")
_BELONGING: Final[Mapping[tuple[str, ...], tuple[str, ...]]] = {
    ("vehicle",): ("--config", "--vehicle", "--engage", "--yes"),
    ("live",): ("--link", "--over", "--port"),
}
"""Options of `guidance scenario run`, by the ways to which they belong."""


@scenario.command()
def run(
    ctx: typer.Context,
    name: arguments.ScenarioName,
    way: Annotated[
        str,
        typer.Option(
            "--as",
            help="maths, fast (virtual time), live or vehicle.",
            autocompletion=arguments.completed("maths", "fast", "live", "vehicle"),
        ),
    ] = "maths",
    config: Annotated[str | None, typer.Option(help="With --as vehicle: the vehicle file.")] = None,
    vehicle: Annotated[
        list[str] | None, typer.Option(help="URLs of a team. THEY ARE ARMED.", metavar="URL")
    ] = None,
    engage: Annotated[
        bool, typer.Option("--engage", help="THE VEHICLE IS ARMED, takes off, engages at once.")
    ] = False,
    yes: arguments.Yes = False,
    link: arguments.Link = "mavsdk",
    over: Annotated[str, typer.Option(help="With --as live: zenoh or udp.")] = "zenoh",
    port: arguments.Port = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            help="New folder for outcome.json and, of a flight, its record.",
            show_default="of a flight: flights/SCENARIO-NUMBER",
        ),
    ] = None,
    seed: arguments.Seed = None,
    as_json: arguments.AsJson = False,
) -> None:
    """Run one scenario and show the outcome beside the game's value.

    The columns are the same for mathematics, mock and vehicle, so `guidance compare` can compare them. A scenario is
    also a test: if an expectation of section `expect` fails, the exit code is 1. `--as vehicle` needs `--config`, or
    for a team `--vehicle` with the URL of each autopilot.

    - `guidance scenario run pe`: the paper's game between point masses
    - `guidance scenario run pe --as fast`: the same file, flown by the mock in virtual time
    - `guidance scenario run pe --out played`: also writes `played/outcome.json`, for `guidance compare`
    - `guidance scenario run pe --as live`: in real time over Zenoh, or with `--over udp` over UDP
    - `guidance scenario run evader_turns --as vehicle --config config/vehicles/px4.toml`: on a real autopilot, after
      the orders `guidance ctl start` and `guidance ctl engage`; `--engage` **arms** without them
    """
    is_known = bool(config or vehicle)
    is_armed = bool(engage or vehicle)
    _check_options(ctx, way, known=is_known, armed=is_armed)
    path, scenario_played = load_any(name, seed)
    screen = console(stderr=as_json)
    screen.print(headed(scenario_played.title, f"  ({path.name}, as {way})"))
    arguments.may_fly([] if vehicle is None else vehicle, yes=yes)
    rows: Sequence[Any]
    if way != "maths":
        from guidance.session.open.file import ByFile  # noqa: PLC0415 - slow imports
        from guidance.session.open.mock import MockOptions  # noqa: PLC0415 - slow imports
        from guidance.session.open.url import Asked  # noqa: PLC0415 - slow imports
        from guidance.session.vehicle_file import load_vehicle  # noqa: PLC0415

        mock = MockOptions(fast=way == "fast", link=link, port=port, over=over)
        how: Way = Asked(tuple(vehicle)) if vehicle else mock
        if config is not None:
            how = ByFile(load_vehicle(find(config, "vehicles")), engage)
            if engage and not yes:  # also on loopback: a real vehicle may be behind a router
                vehicle_at = f"{config}: {how.config.vehicle.url}"
                arguments.agree(
                    f"{vehicle_at} may be a real vehicle. Arm it, take off and engage? Propellers will turn"
                )
        rows, out = _fly_scenario(scenario_played, path.stem, how, out, screen)
    elif isinstance(scenario_played, TeamScenario):
        rows = play_teams([scenario_played])[0]
        tell_players(rows, screen)
    else:
        if scenario_played.fault:
            screen.print("the mathematics ignores faults")
        rows = play_scenarios([scenario_played])
    verdicts = _verdicts(scenario_played, rows, screen)
    text = rows_json(scenario_played, rows)
    if out is not None:
        from guidance.cli.fly import write_outcome  # noqa: PLC0415 - slow imports

        write_outcome(out, text)
    if as_json:
        sys.stdout.write(text)
    all_hold = all(verdict.held for verdict in verdicts)
    raise typer.Exit(0 if all_hold else 1)


def _check_options(ctx: typer.Context, way: str, *, known: bool, armed: bool) -> None:
    if way not in _WAYS:
        raise ConfigError(f"--as {way}: allowed are {', '.join(_WAYS)}")
    if way == "vehicle" and not known:
        raise ConfigError(
            "--config: missing; --as vehicle needs a vehicle file, and a team --vehicle URL for each"
        )
    for ways, options in _BELONGING.items():
        if way not in ways:
            other_ways = " or ".join(ways)
            arguments.refuse(ctx, f"--as {way}", f"with --as {other_ways}", *options)
    if not armed:
        arguments.refuse(ctx, "orders by hand", "with --engage, which arms", "--yes")


def _fly_scenario(
    scenario: Scenario | TeamScenario, stem: str, how: "Way", out: Path | None, screen: Console
) -> tuple[Sequence[Any], Path]:
    """Fly a scenario; return its rows and the flight's folder."""
    from guidance.cli.fly import fly_rows  # noqa: PLC0415 - slow imports
    from guidance.session.open.file import ByFile  # noqa: PLC0415
    from guidance.session.open.opened import Onlooker  # noqa: PLC0415

    def on_record(path: Path) -> None:
        screen.print(f"record   {path}", soft_wrap=True)
        if isinstance(how, ByFile) and not how.engage:
            screen.print(
                "waiting for a person: `guidance ctl start`, then `guidance ctl engage`",
                soft_wrap=True,
            )

    name = how.config.name if isinstance(how, ByFile) else stem
    onlooker = Onlooker(on_record=on_record)
    _, rows, folder = fly_rows(screen, scenario, name, how, out, onlooker)
    if not rows:
        raise FlightError("no game: not all vehicles engaged")
    if isinstance(how, ByFile):
        # The evader of a vehicle file is out there, and no policy of the scenario's is its.
        rows = [row._replace(evader_policy="reported") for row in rows]
    return rows, folder


def _verdicts(
    scenario: Scenario | TeamScenario, rows: Sequence[Any], screen: Console
) -> Sequence[CheckedExpectation]:
    """Show the row of one vehicle, and which expectations hold."""
    if isinstance(scenario, TeamScenario):
        values: Mapping[str, Any] = summary_of(rows)
    else:
        values = rows[0]._asdict()
        units = {"regret": "s" if scenario.game == "pe" else "m"}
        for name in values:
            for ending, unit in (("_m_s", "m/s"), ("_m", "m"), ("_s", "s")):
                if name.endswith(ending):
                    units.setdefault(name, unit)
        texts = [
            (name, as_text(value, units.get(name, "")))
            for name, value in values.items()
            if name != "scenario"
        ]
        screen.print(pairs(texts))
    verdicts = list(scenario.expect.verdicts(values))
    judgements = {True: Text("holds", "green"), False: Text("FAILS", "red")}
    cells = []
    for verdict in verdicts:
        value = as_text(verdict.value)
        cells.append((verdict.column, verdict.expected, value, judgements[verdict.held]))
    if cells:
        headings = ("column", "expected", "came out", "verdict")
        screen.print(text_table(headings, cells, left=range(4), title="expected"))
    return verdicts


@scenario.command(name="list")
def list_all(as_json: arguments.AsJson = False) -> None:
    """List the bundled scenarios; `guidance scenario show NAME` explains one."""
    if as_json:
        documents = [dict(zip(_LISTED, row, strict=True)) for row in listed()]
        typer.echo(json.dumps(documents, indent=2))
    else:
        console().print(listing(console().width))


@scenario.command()
def show(
    name: arguments.ScenarioName,
    out: Annotated[Path | None, typer.Option(help="Draw a picture into this file.")] = None,
    as_json: arguments.AsJson = False,
) -> None:
    """Explain a scenario: players, places and the game's value. `--out` draws how the mathematics plays it.

    - `guidance scenario show barrier_pursuer`
    - `guidance scenario show my_own.toml --out my_own.png`
    """
    if out is not None:
        require_extras(f"--out {out}", "plot")
        from guidance.viz import figures  # noqa: PLC0415 - matplotlib is optional

        figures.check_picture(out)
    path, scenario_shown = load_any(name)
    title = scenario_shown.title
    about = " ".join(scenario_shown.description.split())
    facts = list(facts_of(scenario_shown))
    screen = console(stderr=as_json)
    if as_json:
        facts_by_name: dict[str, list[str]] = {}
        for fact, words in facts:
            facts_by_name.setdefault(fact, []).append(words)
        document = {
            "file": path.name,
            "title": title,
            "description": about,
            "facts": facts_by_name,
        }
        typer.echo(json.dumps(document, indent=2))
    else:  # the file may be a stranger's
        screen.print(printable(title), style="bold", markup=False, end="")
        screen.print(f"  ({printable(path.name)})\n{printable(about)}\n", markup=False)
        fact_rows = [(fact, Text(printable(words))) for fact, words in facts]
        screen.print(pairs(fact_rows))
    if out is not None:
        if isinstance(scenario_shown, TeamScenario):
            figures.draw_teams(scenario_shown, out)
        else:
            figures.draw_scenario(scenario_shown, out)
        screen.print(f"picture  {out}", soft_wrap=True, markup=False)


def names() -> list[str]:
    """Return the names of the bundled scenarios."""
    files = (config_folder() / SCENARIO_FOLDER).glob("*.toml")
    return sorted(path.stem for path in files)


def listed() -> Iterator[tuple[str, str, str, str]]:
    """Yield the bundled scenarios: name, game, title and expectations."""
    for name in names():
        _, scenario = load_any(name)
        yield name, scenario.game, scenario.title, expected(scenario)


def listing(width: int) -> Table:
    """Return the table of `guidance scenario list`; expectations are shown from 120 columns on."""
    columns = len(_LISTED)
    if width < 120:
        columns -= 1
    rows = [row[:columns] for row in listed()]
    return text_table(_LISTED[:columns], rows, left=range(columns))


def facts_of(scenario: Scenario | TeamScenario) -> Iterator[tuple[str, str]]:
    """Yield the facts of a scenario by name."""
    game = _GAMES[scenario.game]
    if isinstance(scenario, TeamScenario):
        yield "game", f"{game}, of teams"
        for player, groups in (("pursuers", scenario.pursuer), ("evaders", scenario.evader)):
            for group in groups:
                position = f"{_position_words(group.position_m)} m"
                if group.scatter_m:
                    position += f", scattered over {group.scatter_m:g} m"
                speed = f"{group.speed_m_s:g} m/s"
                yield player, f"{group.count} at {position}, {speed}, plays {group.policy}"
    else:
        yield "game", game
        pursuer = scenario.pursuer
        evader = scenario.evader
        if pursuer.speed_set is None:
            maths_speeds = speed_set_named(MATHS_SPEED_SET).of(*pursuer.speeds)
            flight_speeds = speed_set_named(FLOWN_SPEED_SET).of(*pursuer.speeds)
            speeds = f"{maths_speeds.words()} in mathematics, and in flight {flight_speeds.words()}"
        else:
            speeds = speed_set_named(pursuer.speed_set).of(*pursuer.speeds).words()
        pursuer_place = _position_words(pursuer.position_m)
        yield "pursuer", f"at {pursuer_place} m, {speeds}, plays {pursuer.policy}"
        evader_place = _position_words(evader.position_m)
        speed = f"{evader.speed_m_s:g} m/s"
        if evader.declared_speed_m_s is not None:
            speed += f" (declares {evader.declared_speed_m_s:g})"
        yield "evader", f"at {evader_place} m, {speed}, plays {evader.policy}"
    target = scenario.target
    if target is not None:
        yield "target", f"at {_position_words(target.position_m)} m{_shape_words(target)}"
    if isinstance(scenario, TeamScenario):
        first = opening_of(scenario)
        guaranteed = int(first.guaranteed)
        total = float(first.total)
        unit = "m from the target" if scenario.game == "tad" else "s until the captures"
        yield "value", f"{guaranteed} captures guaranteed, {total:.2f} {unit} in all"
    else:
        yield from _condition_rows(scenario)
    expectations = expected(scenario)
    yield "expected", expectations if expectations else "nothing"


def _shape_words(target: Target) -> str:
    """Describe the target's shape; empty for a point."""
    words = ""
    if target.polygon_m:
        corners = ", ".join(f"({_position_words(corner)})" for corner in target.polygon_m)
        words += f", the polygon {corners} m about it"
    if target.radius_m:
        words += f", with {target.radius_m:g} m around"
    return words


def _value(scenario: Scenario) -> str:
    """Say what the game's value at engagement is."""
    first = opening(stack([scenario]))
    value = float(first.value[0])
    winner = winner_name(int(first.winner[0]))
    if winner == "evader":
        return f"the evader wins: the pursuer misses by {value:.2f} m"
    if scenario.game == "pe":
        return f"{value:.2f} s to capture"
    return f"{value:.2f} m from the target, {winner} wins"


def _condition_rows(scenario: Scenario) -> Iterator[tuple[str, str]]:
    disc = scenario.standoff
    disc_words = f"the disc of {disc.radius_m:g} m, {disc.height_m:g} m up"
    yield "captured", f"within {disc.tolerance_m:g} m of {disc_words}"
    value = _value(scenario)
    flight_value = _value(scenario.as_flown())
    if flight_value != value:
        value = f"in mathematics {value}; in flight {flight_value}"
    yield "value", value
    if set(scenario.sensor.model_fields_set):
        settings = [f"{key} = {setting}" for key, setting in scenario.sensor if setting]
        yield "sensor", ", ".join(settings)
    wind_m_s = scenario.wind.velocity_m_s
    if any(wind_m_s):
        yield "wind", f"{_position_words(wind_m_s)} m/s, east and north; {WIND_WORDS}"
    for fault in scenario.fault:
        since = "engagement" if fault.after == "engaged" else "the start"
        words = f"{fault.kind} of the {fault.vehicle} {fault.at_s:g} s after {since}"
        if fault.model_extra:
            for key, setting in fault.model_extra.items():
                words += f", {key} = {setting}"
        yield "fault", words


def expected(scenario: Scenario | TeamScenario) -> str:
    """Return the expectations of a scenario in one line."""
    return "; ".join(_expectation_words(scenario.expect))


def _expectation_words(expectations: Ranges) -> Iterator[str]:
    for column, value in expectations:
        if isinstance(value, Ranges):
            if words := ", ".join(_expectation_words(value)):
                yield f"{column}: {words}"
        elif column == "events":
            yield from (f"has {event!r}" for event in value)
        elif value is not None:
            is_plain = column in {"end", "winner"}
            yield str(value) if is_plain else f"{column} {value}"


def _position_words(place: tuple[float, ...]) -> str:
    numbers = ", ".join(f"{part:g}" for part in place)
    return f"({numbers})"
