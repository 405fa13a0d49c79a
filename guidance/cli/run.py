"""`guidance run`: the daemon."""

from typing import Annotated

import typer


def run(
    config: Annotated[
        str, typer.Argument(help="A vehicle file, or the name of one that comes along: px4, arducopter.")
    ],
) -> None:
    """Run the offboard guidance daemon of one vehicle, on its companion computer.

    Connects to the autopilot and to the source of the evader's reports, checks both, and waits for orders
    (`guidance ctl`): nothing arms and nothing engages by itself. SIGTERM hands the vehicle to the autopilot and ends;
    SIGHUP reads the file again, on the ground.

    Examples:
        guidance run config/vehicles/px4.toml
    """
    from guidance.session.service import run_vehicle  # noqa: PLC0415 - zenoh and mavsdk take a second

    run_vehicle(config)
