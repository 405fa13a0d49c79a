"""`guidance init`, `doctor`, `check`, `schema` and `zenoh`: from a new vehicle file to an autopilot that may fly."""

import contextlib
import datetime
import json
import signal
import threading
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from pkgutil import resolve_name
from typing import Annotated, Any, Final

import typer
from rich.console import Console
from rich.text import Text

from guidance.autopilots import Finding
from guidance.cli import arguments
from guidance.config import config_folder, find
from guidance.errors import ConfigError, FlightError
from guidance.extras import require_extras
from guidance.files import writing
from guidance.links.port import is_px4, parse
from guidance.screen import console, text_table, waiting
from guidance.session.checkup import SURVEY_LIMIT_S, Checkup, checkup_of, examine
from guidance.session.open import discovery
from guidance.session.vehicle_file import load_vehicle

_STYLE: Final = {"refuse": "bold red", "warn": "yellow", "pass": "green"}
_NEXT: Final = """next
  1. edit {out}: the source of evader reports ([evader]) and the size of your field ([limits])
  2. guidance doctor {out}      checks this computer: clock, ports, rights, disk
  3. guidance check {out}       checks the autopilot; --apply sets refused parameters, after asking
  4. guidance run {out}         the daemon; it waits for orders
  5. guidance ctl start         in another terminal, then: guidance ctl engage"""


def init(
    url: Annotated[
        str | None, typer.Argument(help="URL of the autopilot, which is only read.")
    ] = None,
    out: Annotated[Path, typer.Option(help="The new file; none is overwritten.")] = Path(
        "vehicle.toml"
    ),
    autopilot: arguments.Expected = None,
) -> None:
    """Write a commented vehicle file for the autopilot at a URL, and print the next steps.

    Reads the autopilot's limits of speed, height and distance; sets and orders nothing. The file's limits are never
    looser than the autopilot's. The vehicle is called like the file.

    - `guidance init udpin://127.0.0.1:14540`: PX4's SITL, or `sitl-mock run --udp 14540`
    - `guidance init serial:///dev/ttyACM0:921600 --out uav1.toml`: an autopilot on a serial port
    - `guidance init --autopilot px4`: without a vehicle
    """
    if out.exists():
        raise ConfigError(f"--out {out}: exists and is not overwritten; choose another name")
    if url is None and autopilot is None:
        raise ConfigError("no autopilot given: give its URL, or --autopilot px4 or arducopter")
    surveyed = None
    if url is not None:
        parse(url)  # report a wrong URL before waiting
        limit_s = discovery.FOUND_WITHIN_S + discovery.DISCOVERED_WITHIN_S
        with waiting(console(stderr=True), f"a HEARTBEAT at {url}, and its limits", limit_s):
            surveyed = discovery.survey(url, autopilot)
        autopilot = surveyed.autopilot
        read = f"{len(surveyed.parameters)} of {len(surveyed.version.bounds)} limits read"
        typer.echo(f"found    {autopilot}, system {surveyed.found.system_id}: {read}")
    discovery.write_new(
        out, discovery.vehicle_file(str(autopilot), name=out.stem, url=url, surveyed=surveyed)
    )
    typer.echo(f"written  {out}\n{_NEXT.format(out=out)}")


def doctor(
    config: Annotated[
        str | None, typer.Argument(help="A vehicle file; default: the usual ports and folders.")
    ] = None,
    all_rows: arguments.AllRows = False,
    as_json: arguments.AsJson = False,
) -> None:
    """Check this computer: clocks, timing, real-time scheduling, ports, serial rights, folders, disk and extras.

    Changes nothing and needs no vehicle; `guidance check` checks the vehicle. The exit code is 0, or 4 if the daemon
    could not start.

    - `guidance doctor`: the usual ports and this folder
    - `guidance doctor vehicle.toml`: what this file needs
    """
    rows = examine(None if config is None else load_vehicle(find(config, "vehicles")))
    raise typer.Exit(_show(rows, as_json=as_json, all_rows=all_rows))


def check(
    ctx: typer.Context,
    name: Annotated[
        str | None, typer.Argument(help="A vehicle file; with --vehicle a scenario (default: pe).")
    ] = None,
    vehicle: Annotated[
        str | None, typer.Option(help="URL of an autopilot that runs already.", metavar="URL")
    ] = None,
    parameters: arguments.Parameters = None,
    autopilot: arguments.Expected = None,
    link: arguments.Link = "mavsdk",
    apply: Annotated[
        bool, typer.Option("--apply", help="Set refused parameters, and check again.")
    ] = False,
    advised: Annotated[
        bool, typer.Option("--advised", help="With --apply: also those with a warning.")
    ] = False,
    yes: arguments.Yes = False,
    all_rows: arguments.AllRows = False,
    as_json: arguments.AsJson = False,
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
    from guidance.session.open.url import Asked  # noqa: PLC0415 - slow imports
    from guidance.session.scenario_checkup import checkup_at  # noqa: PLC0415 - slow imports
    from guidance.sim.scenario_file import load_scenario  # noqa: PLC0415

    if vehicle is not None:
        awaited = f"{'VehicleStatus of PX4' if is_px4(vehicle) else 'a HEARTBEAT'} at {vehicle}"
        limit_s = discovery.FOUND_WITHIN_S
        _, scenario = load_scenario(name if name else "pe")
        opening = checkup_at(
            scenario, Asked((vehicle,), autopilot, link, parameters=tuple(parameters or ()))
        )
    else:
        arguments.refuse(
            ctx,
            "a vehicle file, which has this key",
            "with --vehicle",
            "--autopilot",
            "--link",
            "--parameters",
        )
        if name is None:
            raise typer.BadParameter("give a vehicle file, or --vehicle URL", param_hint="CONFIG")
        vehicle_config = load_vehicle(find(name, "vehicles"))
        awaited = vehicle_config.vehicle.awaited
        limit_s = vehicle_config.vehicle.connect_timeout_s
        opening = checkup_of(vehicle_config)
    with contextlib.ExitStack() as closing:
        with waiting(console(stderr=True), awaited, limit_s):
            checkup = closing.enter_context(opening)
        rows = _findings(checkup)
        if apply and _apply(checkup, advised=advised, yes=yes, quiet=as_json):
            rows = _findings(checkup)
    raise typer.Exit(_show(rows, as_json=as_json, all_rows=all_rows))


def _findings(checkup: Checkup) -> Sequence[Finding]:
    """Read and judge; the waiting line names the missing data."""
    with waiting(console(stderr=True), "parameters, positions and rates", SURVEY_LIMIT_S) as tell:
        return checkup.rows(report=lambda lacking: tell(lacking or "rates to be counted"))


def _apply(checkup: Checkup, *, advised: bool, yes: bool, quiet: bool) -> bool:
    """Set parameters, after asking; return whether any were to be set."""
    screen = console()
    screen.quiet = quiet
    changes = checkup.changes(advised=advised)
    _print_table(
        screen,
        (
            (change.verdict, change.name, f"{change.now} becomes {change.then}: {change.why}")
            for change in changes
        ),
    )
    if not changes:
        screen.print("no parameter needs to be set")
        return False
    if not yes:
        arguments.agree(f"Set these {len(changes)} parameters?")
    for name, value, is_set in checkup.apply(changes):
        read = "not read back" if value is None else f"reads {value:g}"
        screen.print(f"{'set ' if is_set else 'NOT SET'} {name}: {read}", soft_wrap=True)
    return True


def _show(rows: Sequence[Finding], *, as_json: bool, all_rows: bool) -> int:
    """Print refusals, then warnings, then the passed rows or only their number; return the exit code."""
    refused = [row.name for row in rows if row.verdict == "refuse"]
    if as_json:
        typer.echo(json.dumps([row._asdict() for row in rows], indent=2))
    else:
        screen = console()
        order = list(_STYLE)[: 3 if all_rows else 2]
        lines = []
        for verdict in order:
            for row in rows:
                if row.verdict == verdict:
                    words = f"{row.value}; expected: {row.wanted}"
                    if row.advice:
                        words += f". Fix: {row.advice}"
                    lines.append((row.verdict, row.name, words))
        _print_table(screen, lines)
        if len(lines) < len(rows):
            screen.print(
                f"{len(rows) - len(lines)} more rows pass; --all shows them", soft_wrap=True
            )
        words = f"refused: {', '.join(refused)}" if refused else "nothing is refused"
        screen.print(words, style=_STYLE["refuse" if refused else "pass"])
    return FlightError.exit_code if refused else 0


def _print_table(screen: Console, lines: Iterable[tuple[str, str, str]]) -> None:
    """Print verdicts, names and explanations, which wrap in their column."""
    rows = [
        (Text(verdict, style=_STYLE[verdict]), name, Text(words)) for verdict, name, words in lines
    ]
    if rows:
        screen.print(text_table(("verdict", "name", "value"), rows, left=range(3)))


def schema(kind: Annotated[str, typer.Argument(help="vehicle, scenario or sweep.")]) -> None:
    """Print the JSON Schema of a file, for editors that complete and check TOML (Even Better TOML, Taplo).

    It gives the meaning, range and allowed names of every key. The end of a key's name is its unit.

    - `guidance schema vehicle > vehicle.schema.json`
    """
    if kind not in SCHEMAS:
        raise ConfigError(f"{kind}: allowed are {', '.join(SCHEMAS)}")
    typer.echo(json.dumps(schema_of(kind), indent=2))


SCHEMAS: Final = {
    "vehicle": "guidance.session.vehicle_file:vehicle_schema",
    "scenario": "guidance.sim.scenario_file:scenario_schema",
    "sweep": "guidance.sweeps.plan:Plan.model_json_schema",
}
"""Kind of file -> the function that makes its schema, imported when it is asked for."""


def schema_of(kind: str) -> dict[str, Any]:
    """Return the JSON Schema of a kind of file."""
    if kind == "sweep":
        require_extras("schema sweep", "sim")
    content = resolve_name(SCHEMAS[kind])()
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **content,
        "title": kind.capitalize(),
    }


zenoh = typer.Typer(
    cls=arguments.CommandGroup, help="Certificates and a router for Zenoh between machines."
)


@zenoh.command()
def keys(
    names: Annotated[
        list[str],
        typer.Argument(help="Names of the parties: uav1, uav1-guidance, evader1, operator."),
    ],
    out: Annotated[Path, typer.Option(help="Folder of the certificates.")] = Path("keys"),
    host: Annotated[list[str] | None, typer.Option(help="A name or address of the router.")] = None,
) -> None:
    """Create a test authority, a certificate for the router and one for each name, for mutual TLS.

    They are valid for a year. Run it again to add names to the same authority. NAME.toml holds the settings of a
    party: pass it as `--zenoh keys/NAME.toml` to `guidance ctl`, `guidance view` and `sitl-mock run`, or copy it to the
    section `zenoh` of a vehicle file. Only you can read the keys. Keep ca.key off the computers that fly: it can sign
    any certificate.

    - `guidance zenoh keys uav1 uav1-guidance evader1 operator viewer --host 192.168.1.10`
    """
    require_extras("guidance zenoh keys", "keys")
    from guidance.links.zenoh.keys import make_keys  # noqa: PLC0415 - cryptography takes a moment

    begin = datetime.datetime.fromtimestamp(time.time_ns() / 1e9, datetime.UTC)
    validity = begin - datetime.timedelta(hours=1), begin + datetime.timedelta(days=365)
    with writing(out):
        hosts = ["localhost", "127.0.0.1"]
        if host:
            hosts += host
        written = make_keys(out, names, hosts, validity)
    for path in written:
        typer.echo(path)


@zenoh.command()
def router(
    config: Annotated[str, typer.Argument(help="zenohd's configuration.")] = "zenoh/router.json5",
    keys: Annotated[Path | None, typer.Option(help="Folder of `guidance zenoh keys`.")] = None,
    listen: Annotated[
        str | None, typer.Option(help="Endpoint that replaces the file's: tls/0.0.0.0:7447.")
    ] = None,
) -> None:
    """Run a Zenoh router until Ctrl-C, for computers without zenohd.

    The default configuration (`config/zenoh/router.json5`) admits parties with a certificate of our authority and
    restricts each to its own keys. zenohd reads the same file.

    - `guidance zenoh router --keys keys --listen tls/0.0.0.0:7447`
    """
    from guidance.links.zenoh.session import open_router  # noqa: PLC0415 - zenoh takes a moment

    path = Path(config)
    path = path if path.is_file() else config_folder() / path
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    with open_router(path, keys, listen):
        typer.echo(f"routing by {path}{'' if listen is None else f' at {listen}'}; Ctrl-C ends it")
        ended.wait()
