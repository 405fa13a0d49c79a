"""`guidance scenario`: runs, lists and explains scenario files."""

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from guidance.cli.arguments import CommandGroup, agree, refuse_others
from guidance.cli.fly import may_fly
from guidance.cli.fly_team import fly_and_show, tell_rows
from guidance.cli.streams import printable
from guidance.config import config_folder, find
from guidance.errors import ConfigError, FlightError
from guidance.extras import require
from guidance.files import private_file, writing
from guidance.screen import Cell, console, pairs, sheet
from guidance.sim.expect import CheckedExpectation, Expectations
from guidance.sim.maths import opening, play
from guidance.sim.outcome import Outcome, outcome_json, winner_name
from guidance.sim.scenario import Scenario
from guidance.sim.scenario_file import FOLDER, load_any
from guidance.sim.teams import TeamScenario, opening_of, play_teams, summary_of

scenario = typer.Typer(
    cls=CommandGroup, help="Run a scenario file: as mathematics, as a mocked flight, or on a real autopilot."
)

Name = Annotated[str, typer.Argument(help="A scenario file, or the name of a bundled one.")]

_GAMES: Final = {"pe": "pursuit-evasion", "tad": "target-attacker-defender"}
_WIDE: Final = 120
"""Columns from which on the list shows the expectations."""

_WAYS: Final = ("maths", "fast", "live", "vehicle")
_ONLY_WITH: Final = {
    **dict.fromkeys(("--config", "--vehicle", "--engage", "--yes"), ("vehicle",)),
    **dict.fromkeys(("--link", "--over", "--port"), ("live",)),
    "--out": ("fast", "live", "vehicle"),
}
"""Options of `guidance scenario run`: the ways to which each belongs."""

_REPORTED: Final = "reported"
"""Evader policy in the row of a run `--as vehicle`, where the evader is only reported."""

_STANDARD_OUTPUT: Final = Path("-")


@scenario.command()
def run(
    name: Name,
    way: Annotated[
        str, typer.Option("--as", help="maths, fast (virtual time), live (real time) or vehicle (needs --config).")
    ] = "maths",
    config: Annotated[Path | None, typer.Option(help="The vehicle file, with --as vehicle.")] = None,
    vehicle: Annotated[
        list[str] | None,
        typer.Option(
            help="With --as vehicle and a team: URL of each autopilot, in place of --config. THEY ARE ARMED.",
            metavar="URL",
        ),
    ] = None,
    engage: Annotated[
        bool,
        typer.Option(
            "--engage",
            help="With --as vehicle: THE VEHICLE IS ARMED, takes off and engages at once, without `guidance ctl start` "
            "and `guidance ctl engage`.",
        ),
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="With --engage: do not ask before arming.")] = False,
    link: Annotated[
        str | None, typer.Option(help="With --as live: mavsdk or pymavlink.", show_default="mavsdk")
    ] = None,
    over: Annotated[str | None, typer.Option(help="With --as live: zenoh or udp.", show_default="zenoh")] = None,
    port: Annotated[
        int | None,
        typer.Option(
            help="With --as live: TCP port of the mock's Zenoh session, or first UDP port; 0 is any.", show_default="0"
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="New folder for a flight's record.", show_default="flights/SCENARIO-NUMBER")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed; default: the scenario's.")] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the outcome row to this JSON file; - is standard output.")
    ] = None,
) -> None:
    """Run one scenario and show the outcome beside the game's value.

    The columns are the same for mathematics, mock and vehicle, so `guidance compare` can compare them. A scenario is
    also a test: if an expectation in `[expect]` fails, the exit code is 1.

    - `guidance scenario run pe`: the paper's game between point masses
    - `guidance scenario run pe --as fast`: the same file, flown by the mock in virtual time
    - `guidance scenario run pe --as live`: in real time over Zenoh, or with `--over udp` over UDP
    - `guidance scenario run evader_turns --as vehicle --config config/vehicles/px4.toml`: on a real autopilot, after
      the orders `guidance ctl start` and `guidance ctl engage`; `--engage` **arms** without them
    """
    given = {
        "--config": config,
        "--vehicle": vehicle or None,
        "--engage": engage,
        "--yes": yes,
        "--link": link,
        "--over": over,
        "--port": port,
    }
    _refuse_others(way, given | {"--out": out})
    path, played = load_any(name)
    if seed is not None:
        played = played.model_copy(update={"seed": seed})
    there = console(stderr=json_file == _STANDARD_OUTPUT)
    there.print(f"[bold]{played.title}[/bold]  ({path.name}, as {way})")
    if isinstance(played, TeamScenario):
        may_fly(vehicle or [], yes=yes)
        options = {"link": link or "mavsdk", "port": port or 0, "over": over or "zenoh", "vehicle": vehicle or []}
        verdicts, row = _run_teams(played, path.stem, way, options, out, there)
    else:
        if config is not None:
            outcome = _run_vehicle(played, str(config), out, there, engage=engage, yes=yes)
        elif way == "maths":
            outcome = _run_maths(played, there)
        else:
            options = {"link": link or "mavsdk", "port": port or 0, "over": over or "zenoh"}
            outcome = _run_mock(played, path.stem, {"fast": way == "fast", **options}, out, there)
        there.print(_outcome_table(outcome))
        verdicts, row = played.expect.of(outcome._asdict()), outcome_json(outcome)
    _print_verdicts(verdicts, there)
    _write(json.dumps(row, indent=2) + "\n", json_file)
    raise typer.Exit(0 if all(verdict.held for verdict in verdicts) else 1)


def _refuse_others(way: str, given: Mapping[str, Any]) -> None:
    if way not in _WAYS:
        raise ConfigError(f"--as {way}: allowed are {', '.join(_WAYS)}")
    if given["--config"] is None and given["--vehicle"] is None and way == "vehicle":
        raise ConfigError("--config: missing; --as vehicle needs a vehicle file, and a team --vehicle URL for each")
    elsewhere = {option: f"with --as {' or '.join(of)}" for option, of in _ONLY_WITH.items() if way not in of}
    refuse_others(f"--as {way}", given, elsewhere)
    if not (given["--engage"] or given["--vehicle"]):
        refuse_others("orders by hand", given, {"--yes": "with --engage, which arms"})


def _print_verdicts(verdicts: Sequence[CheckedExpectation], there: Console) -> None:
    """Show which expectations hold."""
    rows: list[Sequence[Cell]] = []
    for verdict in verdicts:
        held = Text("holds", "green") if verdict.held else Text("FAILS", "red")
        rows.append([verdict.column, verdict.expected, _shown(verdict.value), held])
    if rows:
        there.print(sheet(("column", "expected", "came out", "verdict"), rows, left=range(4), title="expected"))


def _write(text: str, json_file: Path | None) -> None:
    if json_file == _STANDARD_OUTPUT:
        sys.stdout.write(text)
    elif json_file is not None:
        with writing(json_file):
            private_file(json_file).write_text(text, encoding="utf-8")


def _run_teams(
    scenario: TeamScenario, stem: str, way: str, options: dict[str, Any], out: Path | None, there: Console
) -> tuple[Sequence[CheckedExpectation], Any]:
    """Play or fly teams and show one row per evader; return the expectations and the rows as plain values."""
    if way == "maths":
        rows = play_teams([scenario])[0]
        tell_rows(rows, there)
    else:
        from guidance.cli.fly_scenario import live_line  # noqa: PLC0415 - zenoh and mavsdk take a second
        from guidance.session.flight_files import flight_folder  # noqa: PLC0415
        from guidance.session.fly import Asked, MockOptions, Onlooker  # noqa: PLC0415

        urls = options.pop("vehicle")
        how = [Asked(url) for url in urls] if way == "vehicle" else MockOptions(fast=way == "fast", **options)
        with flight_folder(out, stem) as folder, live_line(there) as show:
            rows = fly_and_show(scenario, folder, how, Onlooker(show), there)
    if not rows:
        raise FlightError("no game: not all vehicles engaged")
    return scenario.expect.verdicts(summary_of(rows)), [outcome_json(row) for row in rows]


def _run_maths(scenario: Scenario, there: Console) -> Outcome:
    if scenario.fault:
        there.print("the mathematics ignores faults")
    return play([scenario])[0]


def _run_vehicle(
    scenario: Scenario, config: str, out: Path | None, there: Console, *, engage: bool, yes: bool
) -> Outcome:
    from guidance.session.flight_files import flight_folder  # noqa: PLC0415 - slow imports
    from guidance.session.fly import fly_vehicle  # noqa: PLC0415
    from guidance.session.result import outcome_of_flight  # noqa: PLC0415
    from guidance.session.vehicle_file import load_vehicle  # noqa: PLC0415

    def say(words: str) -> None:
        there.print(words, soft_wrap=True, highlight=False)

    own = load_vehicle(find(config, "vehicles"))
    if engage and not yes:  # also on loopback: a real vehicle may be behind a router
        agree(f"{config}: {own.vehicle.url} may be a real vehicle. Arm it, take off and engage? Propellers will turn")
    with flight_folder(out, own.name) as folder:
        result = fly_vehicle(scenario, own, folder, say, engage=engage)
    # The evader is out there, and does what it wants: no policy of the file's is its.
    return outcome_of_flight(result, "vehicle")._replace(evader_policy=_REPORTED)


def _run_mock(scenario: Scenario, stem: str, options: dict[str, Any], out: Path | None, there: Console) -> Outcome:
    from guidance.cli.fly_scenario import flown  # noqa: PLC0415 - slow imports
    from guidance.session.flight_files import RECORD, flight_folder  # noqa: PLC0415
    from guidance.session.fly import MockOptions  # noqa: PLC0415
    from guidance.session.result import outcome_of_flight  # noqa: PLC0415

    how = MockOptions(**options)
    with flight_folder(out, stem) as folder:
        result = flown(there, scenario, folder, how)
    there.print(f"record   {folder / RECORD}", soft_wrap=True, highlight=False)
    return outcome_of_flight(result, how.way)


def _outcome_table(outcome: Outcome) -> Table:
    unit = "s" if outcome.game == "pe" else "m"
    shown = ((name, value) for name, value in outcome._asdict().items() if name != "scenario")
    return pairs((name, _shown(value, unit if name == "regret" else _unit(name))) for name, value in shown)


def _unit(column: str) -> str:
    """Return the unit that ends the name of a column, or that its name implies."""
    if column.endswith("_m_s"):
        return "m/s"
    return {"s": "s", "m": "m"}.get(column.rpartition("_")[2], "")


def _shown(value: Any, unit: str = "") -> str:  # noqa: ANN401 - any column
    if isinstance(value, tuple):
        return ", ".join(value) or "none"
    if isinstance(value, float):
        return "-" if value != value else f"{round(value, 3) + 0.0:.3f} {unit}".rstrip()  # noqa: PLR0124 - NaN
    return str(value) or "-"


@scenario.command(name="list")
def list_all(
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON list with the expectations.")] = False,
) -> None:
    """List the bundled scenarios; `guidance scenario show NAME` explains one."""
    if as_json:
        typer.echo(json.dumps(listed(), indent=2))
    else:
        there = console()
        there.print(listing(there.width))


@scenario.command()
def show(
    name: Name,
    out: Annotated[Path | None, typer.Option(help="Draw a picture into this file.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the facts as JSON.")] = False,
) -> None:
    """Explain a scenario: players, places and the game's value. `--out` draws how the mathematics plays it.

    - `guidance scenario show barrier_pursuer`
    - `guidance scenario show my_own.toml --out my_own.png`
    """
    if out is not None:
        require(f"--out {out}", "plot")
        from guidance.viz.figures import check_picture  # noqa: PLC0415 - matplotlib is optional

        check_picture(out)
    path, shown = load_any(name)
    title, about = shown.title, " ".join(shown.description.split())
    facts = list(facts_of(shown))
    there = console(stderr=as_json)
    if as_json:
        said: dict[str, list[str]] = {}
        for fact, words in facts:
            said.setdefault(fact, []).append(words)
        typer.echo(json.dumps({"file": path.name, "title": title, "description": about, "facts": said}, indent=2))
    else:  # the file may be a stranger's
        there.print(printable(title), style="bold", markup=False, end="")
        there.print(f"  ({printable(path.name)})\n{printable(about)}\n", markup=False)
        there.print(pairs((fact, Text(printable(words))) for fact, words in facts))
    if out is not None:
        _draw(shown, out)
        there.print(f"picture  {out}", soft_wrap=True, markup=False)


def names() -> list[str]:
    """Return the names of the bundled scenarios."""
    return sorted(path.stem for path in (config_folder() / FOLDER).glob("*.toml"))


def listed() -> list[dict[str, str]]:
    """Return the rows of `guidance scenario list`: name, game, title and expectations."""
    scenarios = {name: load_any(name)[1] for name in names()}
    return [
        {"name": name, "game": one.game, "title": one.title, "expected": expected(one)}
        for name, one in scenarios.items()
    ]


def listing(width: int) -> Table:
    """Return the table of `guidance scenario list`; expectations are shown from 120 columns on."""
    shown = ("name", "game", "title", "expected")[: 4 if width >= _WIDE else 3]
    return sheet(shown, ([row[name] for name in shown] for row in listed()), left=range(len(shown)))


def _draw(scenario: Scenario | TeamScenario, path: Path) -> None:
    from guidance.viz.pictures import draw_scenario, draw_teams  # noqa: PLC0415 - matplotlib is optional

    if isinstance(scenario, TeamScenario):
        draw_teams(scenario, path)
    else:
        draw_scenario(scenario, path)


def facts_of(scenario: Scenario | TeamScenario) -> Iterator[tuple[str, str]]:
    """Yield the facts of a scenario by name."""
    if isinstance(scenario, TeamScenario):
        yield from _team_facts(scenario)
        return
    pursuer, evader, disc = scenario.pursuer, scenario.evader, scenario.standoff
    speeds = f"{pursuer.speed_m_s:g} m/s"
    if pursuer.speed_set == "cylinder":
        speeds += f" level, {pursuer.climb_m_s:g} up, {pursuer.descent_m_s:g} down"
    yield "game", _GAMES[scenario.game]
    yield "pursuer", f"at {_place(pursuer.position_m)} m, {speeds} ({pursuer.speed_set}), plays {pursuer.policy}"
    declared = "" if evader.declared_speed_m_s is None else f" (declares {evader.declared_speed_m_s:g})"
    yield "evader", f"at {_place(evader.position_m)} m, {evader.speed_m_s:g} m/s{declared}, plays {evader.policy}"
    if scenario.target is not None:
        yield "target", f"at {_place(scenario.target.position_m)} m"
    yield "captured", f"within {disc.tolerance_m:g} m of the disc of {disc.radius_m:g} m, {disc.height_m:g} m up"
    yield "value", _value(scenario)
    if set(scenario.sensor.model_fields_set):
        yield "sensor", ", ".join(f"{key} = {value}" for key, value in scenario.sensor if value)
    if any(scenario.wind.velocity_m_s):
        yield "wind", f"{_place(scenario.wind.velocity_m_s)} m/s, east and north"
    for fault in scenario.fault:
        keys = "".join(f", {key} = {value}" for key, value in fault.keys().items())
        since = "engagement" if fault.after == "engaged" else "the start"
        yield "fault", f"{fault.kind} of the {fault.vehicle} {fault.at_s:g} s after {since}{keys}"
    yield "expected", expected(scenario) or "nothing"


def _team_facts(scenario: TeamScenario) -> Iterator[tuple[str, str]]:
    yield "game", _GAMES[scenario.game] + ", of teams"
    for player, groups in (("pursuers", scenario.pursuer), ("evaders", scenario.evader)):
        for group in groups:
            about = f", scattered over {group.scatter_m:g} m" if group.scatter_m else ""
            place = _place(group.position_m)
            yield player, f"{group.count} at {place} m{about}, {group.speed_m_s:g} m/s, plays {group.policy}"
    if scenario.target is not None:
        yield "target", f"at {_place(scenario.target.position_m)} m"
    first = opening_of(scenario)
    unit = "m from the target" if scenario.game == "tad" else "s until the captures"
    yield "value", f"{int(first.guaranteed)} captures guaranteed, {float(first.total):.2f} {unit} in all"
    yield "expected", expected(scenario) or "nothing"


def expected(scenario: Scenario | TeamScenario) -> str:
    """Return the expectations of a scenario in one line."""
    if isinstance(scenario, TeamScenario):
        return ", ".join(f"{column} {value}" for column, value in scenario.expect if value is not None)
    parts = [*_said(scenario.expect)]
    for run in ("maths", "flown"):
        said = ", ".join(_said(getattr(scenario.expect, run)))
        parts += [f"{run}: {said}"] if said else []
    return "; ".join(parts)


def _said(expectations: Expectations) -> Iterator[str]:
    for column in Expectations.model_fields:
        value = getattr(expectations, column)
        if column == "events":
            yield from (f"has {event!r}" for event in value)
        elif value is not None:
            yield str(value) if column in {"end", "winner"} else f"{column} {value}"


def _value(scenario: Scenario) -> str:
    first = opening([scenario])
    value, winner = float(first.value[0]), winner_name(int(first.winner[0]))
    if winner == "evader":
        return f"the evader wins: the pursuer misses by {value:.2f} m"
    return f"{value:.2f} s to capture" if scenario.game == "pe" else f"{value:.2f} m from the target, {winner} wins"


def _place(place: tuple[float, ...]) -> str:
    return f"({', '.join(f'{part:g}' for part in place)})"
