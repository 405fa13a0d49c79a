"""`guidance check` and `doctor`: is the vehicle ready, and setting what it wants; is this computer."""

import contextlib
import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from guidance.cli.arguments import agree, refuse_others
from guidance.errors import FlightError

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from guidance.preflight import Finding, ParameterChange
    from guidance.session.checkup import Applied, Checkup

_STYLE = {"pass": "green", "warn": "yellow", "refuse": "bold red"}


def check(
    name: Annotated[
        str | None,
        typer.Argument(
            help="A vehicle file, or the name of one that comes along: px4, arducopter. With --vehicle: the scenario "
            "that is to be flown, pe if not given."
        ),
    ] = None,
    vehicle: Annotated[
        str | None,
        typer.Option(help="URL of an autopilot that runs; no vehicle file is needed.", metavar="URL"),
    ] = None,
    autopilot: Annotated[
        str | None, typer.Option(help="px4 or arducopter; found by HEARTBEAT if not given (with --vehicle).")
    ] = None,
    link: Annotated[
        str | None, typer.Option(help="mavsdk or pymavlink (with --vehicle).", show_default="mavsdk")
    ] = None,
    apply: Annotated[
        bool, typer.Option("--apply", help="Set the parameters that are refused, after asking, and judge again.")
    ] = False,
    advised: Annotated[bool, typer.Option("--advised", help="With --apply: set also what is only warned of.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="With --apply: do not ask.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the rows as JSON.")] = False,
) -> None:
    """Read the autopilot's parameters, frames and stream rates, and judge them. Sets nothing without `--apply`.

    With `--apply` the parameters to be set are shown first, with their values now and then and why. They are set on
    the ground only, never while the vehicle is armed; each is read back, and everything is judged again.

    Ends with 0 if the vehicle may fly guided, with 4 if something is refused.

    - `guidance check config/vehicles/px4.toml`: the vehicle of a file
    - `guidance check --vehicle udpin://127.0.0.1:14540 --apply`: PX4's SITL, made ready for `guidance fly --vehicle`
    - `guidance check hover_chase --vehicle tcpout://127.0.0.1:5760 --apply --yes`: ArduPilot's, without being asked
    """
    if (yes or advised) and not apply:
        raise typer.BadParameter("only with --apply", param_hint="--yes" if yes else "--advised")
    if as_json and apply and not yes:
        raise typer.BadParameter("with --apply only where nothing is asked: add --yes", param_hint="--json")
    if vehicle is None:
        given = {"--autopilot": autopilot, "--link": link}
        refuse_others("a vehicle file, which says it", given, dict.fromkeys(given, "with --vehicle"))
    with contextlib.ExitStack() as closing:
        checkup = _opened(closing, name, vehicle, autopilot, link or "mavsdk")
        rows = _judged(checkup)
        if apply:
            rows = _apply(checkup, rows, advised=advised, yes=yes, quiet=as_json)
    raise typer.Exit(tell(rows, as_json=as_json))


def tell(rows: "Sequence[Finding]", *, as_json: bool) -> int:
    """Print what was found and what is refused; return the exit code."""
    from guidance.preflight import refusals  # noqa: PLC0415 - NumPy takes a moment

    refused = refusals(rows)
    if as_json:
        typer.echo(json.dumps([row._asdict() for row in rows], indent=2))
    else:
        _print_rows(rows)
        _print_verdict(refused)
    return FlightError.exit_code if refused else 0


def _checkup(
    name: str | None, vehicle: str | None, autopilot: str | None, link: str
) -> "AbstractContextManager[Checkup]":
    if vehicle is not None:
        from guidance.links.endpoint import parse  # noqa: PLC0415
        from guidance.session.fly_vehicle import Asked, checkup_at  # noqa: PLC0415 - zenoh and mavsdk take a second
        from guidance.sim.scenario_file import load_scenario  # noqa: PLC0415

        parse(vehicle)  # which is wrong before anybody waits
        return checkup_at(load_scenario(name or "pe")[1], Asked(vehicle, autopilot, link))
    if name is None:
        raise typer.BadParameter("give a vehicle file, or --vehicle URL", param_hint="CONFIG")
    from guidance.session.checkup import checkup_of  # noqa: PLC0415 - zenoh and mavsdk take a second

    return checkup_of(name)


def _opened(
    closing: contextlib.ExitStack, name: str | None, vehicle: str | None, autopilot: str | None, link: str
) -> "Checkup":
    """Open the vehicle, and say meanwhile who is waited for."""
    from guidance.screen import console, waiting  # noqa: PLC0415

    opening = _checkup(name, vehicle, autopilot, link)
    with waiting(console(stderr=True), *_awaited(name, vehicle)):
        return closing.enter_context(opening)


def _awaited(name: str | None, vehicle: str | None) -> tuple[str, float]:
    from guidance.config import find  # noqa: PLC0415
    from guidance.session.fly_vehicle import FOUND_WITHIN_S  # noqa: PLC0415
    from guidance.session.vehicle_file import load_vehicle  # noqa: PLC0415

    if vehicle is not None:
        return f"a HEARTBEAT at {vehicle}", FOUND_WITHIN_S
    own = load_vehicle(find(name or "", "vehicles")).vehicle
    return f"a HEARTBEAT of system {own.system_id}, component {own.component_id} at {own.url}", own.connect_timeout_s


def _judged(checkup: "Checkup") -> "Sequence[Finding]":
    """Read and judge, and say meanwhile what is still missing."""
    from guidance.screen import console, waiting  # noqa: PLC0415
    from guidance.session.checkup import SURVEY_LIMIT_S  # noqa: PLC0415

    with waiting(console(stderr=True), "parameters, positions and rates", SURVEY_LIMIT_S) as wait:

        def told(lacking: str) -> None:
            wait.what = lacking or "rates to be counted"

        return checkup.rows(told=told)


def _apply(
    checkup: "Checkup", rows: "Sequence[Finding]", *, advised: bool, yes: bool, quiet: bool
) -> "Sequence[Finding]":
    wanted = checkup.changes(advised=advised)
    if not wanted:
        if not quiet:
            typer.echo("no parameter is to be set")
        return rows
    if not quiet:
        _print_changes(wanted)
    if not yes:
        agree(f"Set these {len(wanted)} parameters?")
    done: list[Applied] = []
    checkup.apply(wanted, done.append)
    if not quiet:
        for one in done:
            read = "not read back" if one.read_back is None else f"reads {one.read_back:g}"
            typer.echo(f"{'set ' if one.done else 'NOT SET'} {one.name}: {read}")
    return _judged(checkup)


def _print_changes(wanted: "Sequence[ParameterChange]") -> None:
    lines = [(one.name, one.now, one.then, str(one.verdict), one.why) for one in wanted]
    _print_table(("name", "now", "then", "as it is", "why"), lines)


def _print_rows(rows: "Sequence[Finding]") -> None:
    lines = [(row.name, row.value, row.wanted, str(row.verdict), row.advice) for row in rows]
    _print_table(("name", "value", "wanted", "verdict", "how to set it"), lines)


def _print_table(headings: Sequence[str], lines: Sequence[Sequence[str]]) -> None:
    """Print rows whose fourth cell is a verdict."""
    from rich.text import Text  # noqa: PLC0415 - only where somebody looks

    from guidance.screen import Sheet, console  # noqa: PLC0415

    rows = [[Text(cell, style=_STYLE[cell] if n == 3 else "") for n, cell in enumerate(line)] for line in lines]
    console().print(Sheet(headings, rows, left=range(len(headings))))


def _print_verdict(refused: Sequence[str]) -> None:
    from guidance.screen import console  # noqa: PLC0415

    words = f"refused: {', '.join(refused)}" if refused else "nothing is refused"
    console().print(words, style=_STYLE["refuse" if refused else "pass"])


def doctor(
    config: Annotated[
        str | None, typer.Argument(help="A vehicle file, for its ports, folders and rights; the usual ones without.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the rows as JSON.")] = False,
) -> None:
    """Look at this computer: clocks, cadence, real-time scheduling, ports, serial rights, folders, disk and extras.

    Nothing is changed, and no vehicle is needed; `guidance check` looks at the vehicle. Ends with 0, or with 4 if
    something keeps a daemon from starting.

    - `guidance doctor`: the usual ports, this folder
    - `guidance doctor vehicle.toml`: what this file needs
    """
    from guidance.config import find  # noqa: PLC0415 - pydantic takes a moment
    from guidance.session.host import examine  # noqa: PLC0415
    from guidance.session.vehicle_file import load_vehicle  # noqa: PLC0415

    rows = examine(None if config is None else load_vehicle(find(config, "vehicles")))
    raise typer.Exit(tell(rows, as_json=as_json))
