"""`guidance scenario`: runs, lists and explains scenario files."""

import json
from pathlib import Path
from typing import Annotated

import typer

from guidance.cli.arguments import CommandGroup

scenario = typer.Typer(
    cls=CommandGroup, help="Run a scenario file: as mathematics, as a mocked flight, or on a real autopilot."
)

Name = Annotated[str, typer.Argument(help="A scenario file, or the name of a bundled one.")]


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
    from guidance.screen import console  # noqa: PLC0415

    asked = Run(way, config, engage, yes, link, port, out, seed, json_file, over)
    raise typer.Exit(run_scenario(name, asked, console(stderr=json_file == STANDARD_OUTPUT)))


@scenario.command(name="list")
def list_all(
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON list with the expectations.")] = False,
) -> None:
    """List the bundled scenarios; `guidance scenario show NAME` explains one."""
    from guidance.cli.scenario_catalogue import listed, listing  # noqa: PLC0415
    from guidance.screen import console  # noqa: PLC0415

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
    from guidance.cli.scenario_catalogue import explained  # noqa: PLC0415
    from guidance.cli.scenario_catalogue import show as show_scenario  # noqa: PLC0415
    from guidance.screen import console  # noqa: PLC0415

    if as_json:
        typer.echo(json.dumps(explained(name), indent=2))
    if out is not None or not as_json:
        show_scenario(name, console(stderr=as_json), out)
