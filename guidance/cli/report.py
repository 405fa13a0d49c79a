"""`guidance report`: a record as one page."""

from pathlib import Path
from typing import Annotated

import typer

from guidance.extras import require


def report(
    file: Annotated[Path, typer.Argument(help="A record.mcap that a flight wrote.")],
    out: Annotated[Path | None, typer.Option(help="Folder for the page and the pictures; default beside FILE.")] = None,
) -> None:
    """Draw a record: one HTML page that needs nothing else, and its pictures as PNG.

    Tracks in space and from above with fence, stand-off and isochrons, the game and its guarantee over time, velocities
    commanded and flown, ages and latencies, events, and a summary.
    """
    require("guidance report", "plot")
    from guidance.log import making_sense_of  # noqa: PLC0415
    from guidance.session.recorded import recorded_settings  # noqa: PLC0415
    from guidance.viz.report import write_report  # noqa: PLC0415 - matplotlib takes a second

    with making_sense_of(file):
        paths = write_report(file, file.parent if out is None else out, recorded_settings)
    for path in paths:
        typer.echo(str(path))
