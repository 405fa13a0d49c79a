"""`sitl-mock modes`: the table of modes and transitions of a flavour, drawn from the code."""

from typing import Annotated

import typer


def modes(
    flavour: Annotated[str, typer.Option(help="px4, arducopter or rover; all of them if not given.")] = "",
) -> None:
    """Draw modes, their numbers, what they need and what changes by itself, as Markdown."""
    from sitl_mock.flavours import NAMES, flavour_named  # noqa: PLC0415 - nothing of it is needed for `--help`

    tables = [flavour_named(name).modes for name in ([flavour] if flavour else NAMES)]
    typer.echo("\n\n".join("\n".join(table.markdown()) for table in tables))
