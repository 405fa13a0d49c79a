"""`guidance ctl`: orders for a running daemon."""

import json
from typing import Annotated

import typer

from guidance.errors import FlightError


def ctl(
    order: Annotated[str, typer.Argument(help="start, engage, hold, land, return, abort, reset or status.")],
    name: Annotated[str | None, typer.Option(help="The vehicle's name; not needed where there is only one.")] = None,
    endpoint: Annotated[str, typer.Option(help="The daemon's control endpoint.")] = "tcp/127.0.0.1:7448",
) -> None:
    """Give a running daemon an order, and print its answer as JSON.

    Ends with 0 if the order was accepted, 4 if it was refused (the answer says why), 3 if nobody answers.

    Examples:
        guidance ctl status

        guidance ctl engage --name px4
    """
    from guidance.service.ask import ask  # noqa: PLC0415 - zenoh takes a moment

    answer = ask(order, endpoint=endpoint, name=name)
    typer.echo(json.dumps(answer, indent=2))
    if not answer["accepted"]:
        raise typer.Exit(FlightError.exit_code)
