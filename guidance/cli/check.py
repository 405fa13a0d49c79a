"""`guidance check`: preflight alone."""

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from guidance.preflight import Row

_STYLE = {"pass": "green", "warn": "yellow", "refuse": "bold red"}


def check(
    config: Annotated[
        str, typer.Argument(help="A vehicle file, or the name of one that comes along: px4, arducopter.")
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print the rows as JSON.")] = False,
) -> None:
    """Read the autopilot's parameters, frames and stream rates, and judge them. Sets nothing.

    Ends with 0 if the vehicle may fly guided, with 4 if something is refused.

    Examples:
        guidance check config/vehicles/px4.toml
    """
    from guidance.preflight import refusals  # noqa: PLC0415 - NumPy takes a moment
    from guidance.service.command import check_vehicle  # noqa: PLC0415 - zenoh and mavsdk take a second

    rows = check_vehicle(config)
    if as_json:
        typer.echo(json.dumps([row._asdict() for row in rows], indent=2))
    else:
        _print(rows, refusals(rows))
    raise typer.Exit(4 if refusals(rows) else 0)


def _print(rows: "Sequence[Row]", refused: Sequence[str]) -> None:
    from rich.console import Console  # noqa: PLC0415 - only where somebody looks
    from rich.table import Table  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    table = Table(box=None, pad_edge=False)
    for heading in ("name", "value", "wanted", "verdict", "how to set it"):
        table.add_column(heading, overflow="fold")
    for row in rows:
        verdict = Text(str(row.verdict), style=_STYLE[str(row.verdict)])
        table.add_row(Text(row.name), Text(row.value), Text(row.wanted), verdict, Text(row.advice))
    console = Console()
    console.print(table)
    words = f"refused: {', '.join(refused)}" if refused else "nothing is refused"
    console.print(words, style=_STYLE["refuse" if refused else "pass"])
