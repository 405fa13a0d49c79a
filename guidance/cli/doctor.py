"""`guidance doctor`: is this computer ready to fly a vehicle."""

from typing import Annotated

import typer


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
    from guidance.cli.check import tell  # noqa: PLC0415
    from guidance.config import find  # noqa: PLC0415 - pydantic takes a moment
    from guidance.session.host import examine  # noqa: PLC0415
    from guidance.session.plan_fence import load_vehicle  # noqa: PLC0415

    rows = examine(None if config is None else load_vehicle(find(config, "vehicles")))
    raise typer.Exit(tell(rows, as_json=as_json))
