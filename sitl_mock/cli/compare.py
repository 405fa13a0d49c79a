"""`sitl-mock compare`: the mock's messages beside those of a recorded flight."""

from pathlib import Path
from typing import Annotated

import typer


def compare(
    file: Annotated[Path, typer.Argument(help="A .tlog of PX4, ArduCopter or Rover, with what the client sent.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
    ranges: Annotated[bool, typer.Option(help="Also the range of every field on both sides.")] = False,
) -> None:
    """Fly a recorded client against the mock and lay its messages beside the recorded ones.

    `sitl-mock compare flight.tlog` prints how often each message came on both sides, and every difference: messages
    that are missing or extra, rates more than 20 % apart, fields that stand still or are NaN on one side only, on the
    ground and in the air.

    Ends with 0 when there is no difference, with 1 when there is one, with 2 when the file is no such log.
    """
    from sitl_mock.compare.command import compare_file  # noqa: PLC0415 - nothing of it is needed for `--help`

    raise typer.Exit(compare_file(file, as_json=as_json, ranges=ranges))
