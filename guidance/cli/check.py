"""`guidance check` and `doctor`: check the autopilot, and set its parameters; check this computer."""

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
            help="A vehicle file, or the name of a bundled one: px4, arducopter. With --vehicle: the scenario "
            "to fly; default: pe."
        ),
    ] = None,
    vehicle: Annotated[
        str | None,
        typer.Option(help="URL of a running autopilot; no vehicle file is needed.", metavar="URL"),
    ] = None,
    autopilot: Annotated[
        str | None, typer.Option(help="px4 or arducopter; default: from HEARTBEAT (with --vehicle).")
    ] = None,
    link: Annotated[
        str | None, typer.Option(help="mavsdk or pymavlink (with --vehicle).", show_default="mavsdk")
    ] = None,
    apply: Annotated[
        bool, typer.Option("--apply", help="Set refused parameters, after asking, and check again.")
    ] = False,
    advised: Annotated[
        bool, typer.Option("--advised", help="With --apply: also set parameters with a warning.")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="With --apply: do not ask.")] = False,
    all_rows: Annotated[bool, typer.Option("--all", help="Show the passed rows, too.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the rows as JSON.")] = False,
) -> None:
    """Check the autopilot's parameters, frames and stream rates. Sets nothing without `--apply`.

    `--apply` shows the parameters to set, with present value, new value and reason. It sets them only on the ground and
    disarmed, reads each one back, and checks again.

    The exit code is 0 if the vehicle may fly, 4 if something is refused.

    - `guidance check config/vehicles/px4.toml`: the vehicle of a file
    - `guidance check --vehicle udpin://127.0.0.1:14540 --apply`: prepare PX4's SITL for `guidance fly --vehicle`
    - `guidance check hover_chase --vehicle tcpout://127.0.0.1:5760 --apply --yes`: no questions
    """
    if (yes or advised) and not apply:
        raise typer.BadParameter("only with --apply", param_hint="--yes" if yes else "--advised")
    if as_json and apply and not yes:
        raise typer.BadParameter("asks a question with --apply; add --yes", param_hint="--json")
    if vehicle is None:
        given = {"--autopilot": autopilot, "--link": link}
        refuse_others("a vehicle file, which has this key", given, dict.fromkeys(given, "with --vehicle"))
    with contextlib.ExitStack() as closing:
        checkup = _opened(closing, name, vehicle, autopilot, link or "mavsdk")
        rows = _judged(checkup)
        if apply:
            rows = _apply(checkup, rows, advised=advised, yes=yes, quiet=as_json)
    raise typer.Exit(show(rows, as_json=as_json, all_rows=all_rows))


def show(rows: "Sequence[Finding]", *, as_json: bool, all_rows: bool) -> int:
    """Print the findings and return the exit code."""
    from guidance.preflight import refusals  # noqa: PLC0415 - slow import

    refused = refusals(rows)
    if as_json:
        typer.echo(json.dumps([row._asdict() for row in rows], indent=2))
    else:
        _print_rows(rows, all_rows=all_rows)
        _print_verdict(refused)
    return FlightError.exit_code if refused else 0


def _checkup(
    name: str | None, vehicle: str | None, autopilot: str | None, link: str
) -> "AbstractContextManager[Checkup]":
    if vehicle is not None:
        from guidance.links.endpoint import parse  # noqa: PLC0415
        from guidance.session.fly_vehicle import Asked, checkup_at  # noqa: PLC0415 - zenoh and mavsdk take a second
        from guidance.sim.scenario_file import load_scenario  # noqa: PLC0415

        parse(vehicle)  # report a wrong URL before waiting
        return checkup_at(load_scenario(name or "pe")[1], Asked(vehicle, autopilot, link))
    if name is None:
        raise typer.BadParameter("give a vehicle file, or --vehicle URL", param_hint="CONFIG")
    from guidance.session.checkup import checkup_of  # noqa: PLC0415 - zenoh and mavsdk take a second

    return checkup_of(name)


def _opened(
    closing: contextlib.ExitStack, name: str | None, vehicle: str | None, autopilot: str | None, link: str
) -> "Checkup":
    """Open the vehicle and show a waiting line."""
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
    """Read and judge; the waiting line names the missing data."""
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
            typer.echo("no parameter needs to be set")
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
    _print_table(("name", "now", "new", "verdict", "reason"), lines)


def _print_rows(rows: "Sequence[Finding]", *, all_rows: bool) -> None:
    """Print refusals, then warnings, then the passed rows or only their number."""
    order = ("refuse", "warn", "pass") if all_rows else ("refuse", "warn")
    shown = [row for verdict in order for row in rows if row.verdict == verdict]
    lines = [(row.name, row.value, row.wanted, str(row.verdict), row.advice) for row in shown]
    if lines:
        _print_table(("name", "value", "expected", "verdict", "how to fix it"), lines)
    passed = sum(row.verdict == "pass" for row in rows)
    if passed and not all_rows:
        typer.echo(f"{passed} more rows pass; --all shows them")


def _print_table(headings: Sequence[str], lines: Sequence[Sequence[str]]) -> None:
    """Print rows whose fourth cell is a verdict."""
    from rich.text import Text  # noqa: PLC0415 - slow import

    from guidance.screen import console, sheet  # noqa: PLC0415

    rows = [[Text(cell, style=_STYLE[cell] if n == 3 else "") for n, cell in enumerate(line)] for line in lines]
    console().print(sheet(headings, rows, left=range(len(headings))))


def _print_verdict(refused: Sequence[str]) -> None:
    from guidance.screen import console  # noqa: PLC0415

    words = f"refused: {', '.join(refused)}" if refused else "nothing is refused"
    console().print(words, style=_STYLE["refuse" if refused else "pass"])


def doctor(
    config: Annotated[
        str | None, typer.Argument(help="A vehicle file with ports and folders; default: the usual ones.")
    ] = None,
    all_rows: Annotated[bool, typer.Option("--all", help="Show the passed rows, too.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the rows as JSON.")] = False,
) -> None:
    """Check this computer: clocks, timing, real-time scheduling, ports, serial rights, folders, disk and extras.

    Changes nothing and needs no vehicle; `guidance check` checks the vehicle. The exit code is 0, or 4 if the daemon
    could not start.

    - `guidance doctor`: the usual ports and this folder
    - `guidance doctor vehicle.toml`: what this file needs
    """
    from guidance.config import find  # noqa: PLC0415 - pydantic takes a moment
    from guidance.session.host import examine  # noqa: PLC0415
    from guidance.session.vehicle_file import load_vehicle  # noqa: PLC0415

    rows = examine(None if config is None else load_vehicle(find(config, "vehicles")))
    raise typer.Exit(show(rows, as_json=as_json, all_rows=all_rows))
