"""`guidance init` and `schema`: writes a vehicle file, and prints the JSON Schema of every file."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from guidance.session.new_vehicle_file import Surveyed


def init(
    url: Annotated[
        str | None, typer.Argument(help="URL of the autopilot, which is only read; asked for if missing.")
    ] = None,
    out: Annotated[Path, typer.Option(help="The file to write; existing files are not overwritten.")] = Path(
        "vehicle.toml"
    ),
    name: Annotated[
        str | None, typer.Option(help="Name of the vehicle in orders and records; default: the file's name.")
    ] = None,
    autopilot: Annotated[
        str | None,
        typer.Option(help="px4 or arducopter; default: from HEARTBEAT. Needed without a URL."),
    ] = None,
) -> None:
    """Write a commented vehicle file for the autopilot at a URL, and print the next steps.

    Reads the autopilot's limits of speed, height and distance; sets and orders nothing. The file's limits are never
    looser than the autopilot's.

    - `guidance init udpin://127.0.0.1:14540`: PX4's SITL, or `sitl-mock run --udp 14540`
    - `guidance init serial:///dev/ttyACM0:921600 --out uav1.toml`: an autopilot on a serial port
    - `guidance init --autopilot px4`: without a vehicle
    """
    from guidance.errors import ConfigError  # noqa: PLC0415 - slow import
    from guidance.session.new_vehicle_file import vehicle_file, write_new  # noqa: PLC0415

    if out.exists():
        raise ConfigError(f"--out {out}: exists and is not overwritten; choose another name")
    if url is None and autopilot is None:
        url, autopilot = _asked()
    surveyed = None if url is None else _surveyed(url, autopilot)
    chosen = str(autopilot) if surveyed is None else surveyed.autopilot
    write_new(out, vehicle_file(chosen, name=name or out.stem, url=url, surveyed=surveyed))
    typer.echo(f"written  {out}")
    typer.echo(_next(out))


def _asked() -> tuple[str | None, str | None]:
    from guidance.errors import ConfigError  # noqa: PLC0415

    if not sys.stdin.isatty():
        raise ConfigError("no autopilot given: give its URL, or --autopilot px4 or arducopter")
    url = typer.prompt("URL of the autopilot (empty if there is none yet)", default="", show_default=False)
    if url:
        return url, None
    return None, typer.prompt("Autopilot (px4 or arducopter)", default="px4")


def _surveyed(url: str, autopilot: str | None) -> "Surveyed":
    from guidance.autopilots import autopilot_named  # noqa: PLC0415
    from guidance.links.endpoint import parse  # noqa: PLC0415
    from guidance.screen import console, waiting  # noqa: PLC0415
    from guidance.session.fly_vehicle import FOUND_WITHIN_S  # noqa: PLC0415
    from guidance.session.new_vehicle_file import READ_WITHIN_S, survey  # noqa: PLC0415

    parse(url)  # report a wrong URL before waiting
    with waiting(console(stderr=True), f"a HEARTBEAT at {url}, and its limits", FOUND_WITHIN_S + READ_WITHIN_S):
        surveyed = survey(url, autopilot)
    count = len(autopilot_named(surveyed.autopilot).bounds)
    typer.echo(
        f"found    {surveyed.autopilot}, system {surveyed.found.system_id}: "
        f"{len(surveyed.parameters)} of {count} limits read"
    )
    return surveyed


def _next(out: Path) -> str:
    return f"""next
  1. edit {out}: the source of evader reports ([evader]) and the size of your field ([limits])
  2. guidance doctor {out}      checks this computer: clock, ports, rights, disk
  3. guidance check {out}       checks the autopilot; --apply sets refused parameters, after asking
  4. guidance run {out}         the daemon; it waits for orders
  5. guidance ctl start         in another terminal, then: guidance ctl engage"""


def schema(
    kind: Annotated[str, typer.Argument(help="vehicle, scenario or sweep.")],
) -> None:
    """Print the JSON Schema of a file, for editors that complete and check TOML (Even Better TOML, Taplo).

    It gives the meaning, range and allowed names of every key. The end of a key's name is its unit.

    - `guidance schema vehicle > vehicle.schema.json`
    """
    from guidance.errors import ConfigError  # noqa: PLC0415

    if kind not in KINDS:
        raise ConfigError(f"{kind}: allowed are {', '.join(KINDS)}")
    typer.echo(json.dumps(KINDS[kind](), indent=2))


def _vehicle() -> dict[str, Any]:
    from guidance.session.vehicle_file import Config  # noqa: PLC0415 - slow import

    return _titled("Vehicle", Config.model_json_schema())


def _scenario() -> dict[str, Any]:
    from guidance.sim.scenario_file import json_schema  # noqa: PLC0415 - slow import

    return json_schema()


def _sweep() -> dict[str, Any]:
    from guidance.extras import require  # noqa: PLC0415

    require("schema sweep", "sim")
    from guidance.sweeps.plan import Sweep  # noqa: PLC0415 - slow import

    return _titled("Sweep", Sweep.model_json_schema())


def _titled(title: str, content: dict[str, Any]) -> dict[str, Any]:
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **content, "title": title}


KINDS: dict[str, Callable[[], dict[str, Any]]] = {"vehicle": _vehicle, "scenario": _scenario, "sweep": _sweep}
