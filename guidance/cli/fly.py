"""`guidance fly`: a pursuit, flown."""

import contextlib
import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from guidance.cli import INTERRUPTED
from guidance.cli.arguments import Expected, FlightFolder, Json, Link, Panel, Port, Scenario, Seed, Yes, agree, refuse
from guidance.cli.viewers import CommandBeside, panel_beside
from guidance.extras import how_to_add, require
from guidance.sim.scenario_file import load_any
from guidance.sim.teams import TeamScenario


def fly(
    ctx: typer.Context,
    scenario: Scenario = "pe",
    vehicle: Annotated[list[str] | None, typer.Option(help="URL of an autopilot. IT IS ARMED.", metavar="URL")] = None,
    autopilot: Expected = None,
    yes: Yes = False,
    end: Annotated[str, typer.Option(help="End of a flight with --vehicle: return home, or land.")] = "return",
    fast: Annotated[bool, typer.Option("--fast", help="Fly in virtual time, as fast as the processor goes.")] = False,
    link: Link = "mavsdk",
    port: Port = 0,
    out: FlightFolder = None,
    seed: Seed = None,
    view: Annotated[bool, typer.Option("--view", help="Show the flight in Rerun (needs the extra viz).")] = False,
    panel: Panel = False,
    as_json: Json = False,
) -> None:
    """Fly a pursuit, of the mock or of an autopilot that runs already, and show how it compares with the game's value.

    Starts the mock (a PX4-flavoured copter and a ground rover) as a child process on a loopback Zenoh session, connects
    as to a real vehicle, arms, takes off, flies to the scenario's start, plays the game at 50 Hz over MAVLink until the
    stand-off disc around the evader is reached, holds, lands and disarms. Writes the record (MCAP), a picture (PNG) and
    the outcome row (JSON). With `--json` that row is also printed, and text for people goes to standard error.

    With `--vehicle URL` nothing is started: the autopilot there, PX4 or ArduCopter, is **armed**, climbs, flies to the
    start, plays, returns and lands. The scenario is laid about its home, and its evader is simulated here and reports
    over UDP as a real one would. Preflight has to pass (`guidance check --vehicle URL --apply`). Ctrl-C lands it; the
    pilot's mode switch takes it at any moment. The command asks before it
    flies a vehicle that is not on loopback.

    - `guidance fly`: the paper's PE game, in real time
    - `guidance fly config/scenarios/tad.toml`: the paper's TAD game
    - `guidance fly --fast`: the same flight in virtual time
    - `guidance fly --link pymavlink`: with pymavlink instead of MAVSDK
    - `guidance fly --view`: with a view of it in the browser, from a process of its own
    - `guidance fly --panel`: with the operator's page, its picture and its orders
    - `guidance fly hover_chase --vehicle udpin://127.0.0.1:14540`: PX4's SITL
    - `guidance fly hover_chase --vehicle tcpout://127.0.0.1:5760`: ArduPilot's SITL
    - `guidance fly teams_guard`: a team, with one page for all of it, which ends with the flight
    - `guidance fly teams_guard --vehicle URL1 --vehicle URL2 --vehicle URL3`: a team
    """
    if not vehicle:
        refuse(ctx, "the mock", "with --vehicle", "--yes", "--autopilot", "--end")
    else:
        refuse(ctx, f"--vehicle {' '.join(vehicle)}", "without it, with the mock", "--fast", "--port")
        may_fly(vehicle, yes=yes)
    if fast:
        refuse(ctx, "--fast", "in real time", "--link", "--port", "--panel")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    with contextlib.ExitStack() as closing:
        team = isinstance(load_any(scenario)[1], TeamScenario)
        page = panel or (team and not (fast or as_json) and how_to_add("panel") is None)
        folder = Path("flights") if out is None else out.parent
        beside = _Beside(closing, view=view, panel=page, folder=folder)
        try:
            from guidance.cli.fly_scenario import fly_scenario  # noqa: PLC0415 - zenoh, mavsdk take a second
            from guidance.session.fly import Asked, MockOptions, Onlooker  # noqa: PLC0415

            mock = MockOptions(fast=fast, link=link, port=port)
            how = Asked(tuple(vehicle), autopilot, link, end) if vehicle else mock
            onlooker = Onlooker(on_record=beside.record, on_control=beside.control)
            code = fly_scenario(scenario, how, out, seed, onlooker, as_json=as_json)
        except KeyboardInterrupt:
            nothing = "nothing was armed" if vehicle else "nothing was recorded"
            kept = f"the record so far is {beside.records[0]}" if beside.records else nothing
            typer.echo(f"interrupted: {'' if vehicle else 'the mock was ended; '}{kept}", err=True)
            raise typer.Exit(INTERRUPTED) from None
        if view or panel:
            beside.stay()
    raise typer.Exit(code)


def may_fly(vehicles: list[str], *, yes: bool) -> None:
    """Ask before vehicles are armed that are not on loopback."""
    from guidance.links.port import parse  # noqa: PLC0415

    for url in vehicles:
        if not (parse(url).on_loopback or yes):
            agree(f"{url} may be a real vehicle. Arm and fly it? Propellers will turn")


class _Beside:
    """The viewer and the page beside a flight, each if asked for."""

    def __init__(self, closing: contextlib.ExitStack, *, view: bool, panel: bool, folder: Path) -> None:
        for asked, what, extra in ((view, "the view", "viz"), (panel, "--panel", "panel")):
            if asked:
                require(what, extra)
        self._closing, self._view, self._panel, self._folder = closing, view, panel, folder
        self._running: list[CommandBeside] = []
        self.records: list[Path] = []

    def record(self, path: Path) -> None:
        """Show a record that is being written."""
        self.records.append(path)
        if self._view:
            self._add(CommandBeside("view", str(path), "--follow", "--port", "0", "--web-port", "0"))

    def control(self, endpoint: str) -> None:
        """Serve the page of a flight that takes orders here."""
        if self._panel:
            self._add(panel_beside(endpoint, self._folder))

    def _add(self, one: CommandBeside) -> None:
        self._running.append(one)
        self._closing.callback(one.close)

    def stay(self) -> None:
        """Keep the viewer and the page open until Ctrl-C."""
        if self._running:
            with contextlib.suppress(KeyboardInterrupt):
                typer.echo("the view stays: Ctrl-C ends it")
                for one in self._running:
                    one.child.wait()
