"""`guidance scenario`: runs, lists and explains scenario files."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.table import Table
from rich.text import Text

from guidance.cli.arguments import CommandGroup
from guidance.cli.streams import printable
from guidance.config import config_folder
from guidance.extras import require
from guidance.screen import console, pairs, sheet
from guidance.sim.expect import Expectations
from guidance.sim.maths import opening
from guidance.sim.outcome import winner_name
from guidance.sim.scenario import Scenario
from guidance.sim.scenario_file import FOLDER, load_any
from guidance.sim.team_maths import opening_of
from guidance.sim.teams import TeamScenario

scenario = typer.Typer(
    cls=CommandGroup, help="Run a scenario file: as mathematics, as a mocked flight, or on a real autopilot."
)

Name = Annotated[str, typer.Argument(help="A scenario file, or the name of a bundled one.")]

_GAMES: Final = {"pe": "pursuit-evasion", "tad": "target-attacker-defender"}
_WIDE: Final = 120
"""Columns from which on the list shows the expectations."""


@scenario.command()
def run(
    name: Name,
    way: Annotated[
        str, typer.Option("--as", help="maths, fast (virtual time), live (real time) or vehicle (needs --config).")
    ] = "maths",
    config: Annotated[Path | None, typer.Option(help="The vehicle file, with --as vehicle.")] = None,
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
        Path | None,
        typer.Option(help="New folder for a flight's record.", show_default="flights/SCENARIO-NUMBER"),
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
    from guidance.cli.scenario_run import STANDARD_OUTPUT, Run, run_scenario  # noqa: PLC0415 - slow import

    asked = Run(way, config, engage, yes, link, port, out, seed, json_file, over)
    raise typer.Exit(run_scenario(name, asked, console(stderr=json_file == STANDARD_OUTPUT)))


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
    rows = ([Text(row[name], no_wrap=True, overflow="ellipsis") for name in shown] for row in listed())
    table = sheet(shown, rows, left=range(len(shown)))
    for column in table.columns[:-1]:
        column.no_wrap = True  # cut the last column
    return table


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
