"""`guidance run`: the daemon."""

import contextlib
from typing import TYPE_CHECKING, Annotated

import typer

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
            from guidance.viz.beside import PanelBeside, options_of  # noqa: PLC0415

            control = found.control
            if control.by_tls:
                raise ConfigError(
                    f"--panel with control.endpoint = {control.endpoint!r}: that router judges who may order; "
                    f"leave it out, and run guidance panel --endpoint {control.endpoint} --zenoh FILE (an operator's)"
                )
            options = options_of(control.token_file, found.record.folder)
            closing.callback(PanelBeside(control.endpoint, *options).close)

        run_vehicle(config, beside if panel else lambda _: None)
