"""`guidance ctl`: orders for a running daemon."""

import json
from pathlib import Path
from typing import Annotated

import typer

from guidance.errors import FlightError


def ctl(
    order: Annotated[str, typer.Argument(help="start, engage, hold, land, return, abort, reset or status.")],
    name: Annotated[str | None, typer.Option(help="The vehicle's name; not needed where there is only one.")] = None,
    endpoint: Annotated[str, typer.Option(help="The daemon's control endpoint.")] = "tcp/127.0.0.1:7448",
    token_file: Annotated[
        Path | None, typer.Option(help="The daemon's control.token_file; not needed for a daemon of your own.")
    ] = None,
) -> None:
    """Give a running daemon an order, and print its answer as JSON.

    The daemon lets in who can read its token file: its own user, unless the file's rights say more.

    Ends with 0 if the order was accepted, 4 if it was refused (the answer says why), 3 if nobody answers.

    Examples:
        guidance ctl status

        guidance ctl engage --name px4
    """
    from guidance.session.control_bus import ask, own_name  # noqa: PLC0415 - zenoh takes a moment

    answer = ask(order, endpoint=endpoint, name=name, token_file=token_file, by=own_name("ctl"))
    typer.echo(json.dumps(answer, indent=2))
    if not answer["accepted"]:
        raise typer.Exit(FlightError.exit_code)
