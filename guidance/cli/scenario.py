"""`guidance scenario`: scenario files, run in mathematics, in mocked flight or on a vehicle."""

import json
from pathlib import Path
from typing import Annotated

import typer

from guidance.cli.arguments import CommandGroup

scenario = typer.Typer(
    cls=CommandGroup, help="Run a scenario file: as mathematics, as a mocked flight, or on a real autopilot."
)

Name = Annotated[str, typer.Argument(help="A scenario file, or the name of one that comes along.")]


@scenario.command()
def run(
    name: Name,
    way: Annotated[
        str, typer.Option("--as", help="maths, fast (virtual time), live (real time) or vehicle (needs --config).")
    ] = "maths",
    config: Annotated[Path | None, typer.Option(help="Vehicle configuration, with --as vehicle.")] = None,
    engage: Annotated[
        bool,
        typer.Option(
            "--engage",
            help="With --as vehicle: THE VEHICLE IS ARMED, takes off and engages at once, without `guidance ctl start` "
            "and `guidance ctl engage`.",
        ),
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="With --engage: do not ask before the vehicle is armed.")] = False,
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
    seed: Annotated[int | None, typer.Option(min=0, help="Instead of the scenario's.")] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the outcome row here as JSON; - is standard output.")
    ] = None,
) -> None:
    """Run one scenario; show what it came to beside what the game's value promised.

    The columns are the same for every way, so that mathematics, mock and vehicle can be compared (`guidance compare`).
    A scenario is also a test: where an expectation of its `[expect]` does not hold, the command ends with exit code 1.

    - `guidance scenario run pe`: the paper's game between point masses
    - `guidance scenario run pe --as fast`: the same file flown against the mock autopilot in virtual time
    - `guidance scenario run pe --as live`: in real time over Zenoh, or with `--over udp` over UDP
    - `guidance scenario run evader_turns --as vehicle --config config/vehicles/px4.toml`: on a real autopilot, once a
      person orders `guidance ctl start` and `guidance ctl engage`; with `--engage` it is **armed** without
    """
    from guidance.cli.scenario_run import STANDARD_OUTPUT, Run, run_scenario  # noqa: PLC0415 - `guidance --help` is to be quick
    from guidance.screen import console  # noqa: PLC0415

    asked = Run(way, config, engage, yes, link, port, out, seed, json_file, over)
    raise typer.Exit(run_scenario(name, asked, console(stderr=json_file == STANDARD_OUTPUT)))


@scenario.command(name="list")
def list_all(
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON list, with what each expects.")] = False,
) -> None:
    """List the scenarios that come along, a line each; `guidance scenario show NAME` explains one and draws it."""
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
    out: Annotated[Path | None, typer.Option(help="Picture to write.", show_default="NAME.png here")] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the facts as JSON; the picture is drawn only with --out.")
    ] = False,
) -> None:
    """Explain a scenario: who plays what from where, the game's value, and a picture of how mathematics plays it.

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
