"""`guidance run` and `ctl`: the daemon of a vehicle, and the orders for it."""

import contextlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from guidance.cli.arguments import TokenFile, ZenohFile, refuse_others
from guidance.cli.short_order import show
from guidance.errors import FlightError
from guidance.session.control_socket import ENDPOINT, ask_here, own_name

if TYPE_CHECKING:
    from guidance.session.vehicle_file import Config


def run(
    config: Annotated[
        str, typer.Argument(help="A vehicle file, or the name of one that comes along: px4, arducopter.")
    ],
    panel: Annotated[
        bool, typer.Option("--panel", help="Serve the operator's page beside it (needs the extra panel).")
    ] = False,
) -> None:
    """Run the offboard guidance daemon of one vehicle, on its companion computer.

    Connects to the autopilot and to the source of the evader's reports, checks both, and waits for orders
    (`guidance ctl`, `guidance panel`): nothing arms and nothing engages by itself. SIGTERM hands the vehicle to the
    autopilot and ends; SIGHUP reads the file again, on the ground.

    - `guidance run vehicle.toml`: it waits, and says for what
    - `guidance run config/vehicles/px4.toml --panel`: with the operator's page beside it
    """
    from guidance.session.service import run_vehicle  # noqa: PLC0415 - zenoh and mavsdk take a second

    with contextlib.ExitStack() as closing:

        def beside(found: "Config") -> None:
            from guidance.errors import ConfigError  # noqa: PLC0415
            from guidance.viz.subprocesses import PanelBeside, options_of  # noqa: PLC0415

            control = found.control
            if control.by_tls:
                raise ConfigError(
                    f"--panel with control.endpoint = {control.endpoint!r}: that router judges who may order; "
                    f"leave it out, and run guidance panel --endpoint {control.endpoint} --zenoh FILE (an operator's)"
                )
            options = options_of(control.token_file, found.record.folder)
            closing.callback(PanelBeside(control.endpoint, *options).close)

        run_vehicle(config, beside if panel else lambda _: None)


def ctl(
    order: Annotated[str, typer.Argument(help="start, engage, hold, land, return, abort, reset, status or alive.")],
    name: Annotated[str | None, typer.Option(help="The vehicle's name; not needed where there is only one.")] = None,
    endpoint: Annotated[str, typer.Option(help="The daemon's control endpoint.")] = ENDPOINT,
    token_file: TokenFile = None,
    zenoh: ZenohFile = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the answer as JSON.")] = False,
    watch: Annotated[bool, typer.Option("--watch", help="With status or alive: once a second, until Ctrl-C.")] = False,
) -> None:
    """Give a running daemon an order, and say what became of it; `status` shows where the flight stands.

    - `start`: THE VEHICLE IS ARMED, takes off, flies to the start and stands by
    - `engage`: plays the game, after standing by or a hold
    - `hold`, `return`, `land`: hands the vehicle to the autopilot's mode of that name, until the next order
    - `abort`: lands at once; on the ground it ends the flight, and `reset` begins another
    - `alive`: a sign of life, where `flight.operator_timeout_s` asks for one; every other order is one too
    - `reset`: after a flight is over, on the ground: ready for another one

    The daemon lets in who can read its token file: its own user, unless the file's rights say more. From another
    computer orders go by a router, which judges certificates (`docs/zenoh.md`).

    Exit codes: 0 accepted, 4 refused (the answer says why), 3 no answer.

    - `guidance ctl status --watch`: where the flight stands, as it changes
    - `guidance ctl engage --name px4`: to one of several daemons
    - `guidance ctl alive --watch`: a person is there, until Ctrl-C; and where the flight stands
    - `guidance ctl status --json`: for programs
    - `guidance ctl hold --endpoint tls/192.168.1.10:7447 --zenoh keys/operator.toml`: by a router
    """
    if order not in {"alive", "status"} or as_json:
        said = "with status and alive, for people"
        refuse_others(f"{order} --json" if as_json else order, {"--watch": watch}, {"--watch": said})

    def asked() -> Mapping[str, Any]:
        return _ask(order, endpoint, name, token_file, zenoh)

    if watch:
        from guidance.cli.daemon_status import watch as show_again  # noqa: PLC0415 - rich takes a fifth of a second
        from guidance.screen import console  # noqa: PLC0415

        show_again(console(), asked)
        return
    answer = asked()
    if as_json:
        typer.echo(json.dumps(answer, indent=2))
    elif order == "status":
        from guidance.cli.daemon_status import status_table  # noqa: PLC0415 - likewise
        from guidance.screen import console  # noqa: PLC0415

        console().print(status_table(answer))
    else:
        show(answer)
    if not answer["accepted"]:
        raise typer.Exit(FlightError.exit_code)


def _ask(order: str, endpoint: str, name: str | None, token_file: Path | None, zenoh: Path | None) -> Mapping[str, Any]:
    """Ask by the socket on this computer if there is one, else over Zenoh, which takes a second to import and open."""
    by = own_name("ctl")
    answer = None
    if zenoh is None:
        answer = ask_here(order, endpoint=endpoint, name=name, token_file=token_file, by=by)
    if answer is not None:
        return answer
    from guidance.links.zenoh_access import read_credentials  # noqa: PLC0415
    from guidance.session.control_bus import ask  # noqa: PLC0415

    credentials = read_credentials(zenoh)
    return ask(order, endpoint=endpoint, name=name, token_file=token_file, credentials=credentials, by=by)
