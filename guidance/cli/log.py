"""`guidance log`: what a record holds, its events, and the same in formats of other tools."""

import json
import math
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from guidance.cli.groups import CommandGroup

if TYPE_CHECKING:
    from guidance.messages import EvaderReport

log = typer.Typer(cls=CommandGroup, help="Look into a flight record, and export it for other tools.")

File = Annotated[Path, typer.Argument(help="A record.mcap that a flight wrote.")]
Json = Annotated[bool, typer.Option("--json", help="Print it as JSON.")]


@log.command()
def info(file: File, as_json: Json = False) -> None:
    """Show what a record holds: how long, which channels, which versions, and whether it is whole."""
    from guidance.log import making_sense_of, reports_of, survey_of, title_of  # noqa: PLC0415 - numpy takes its time

    with making_sense_of(file):
        survey = survey_of(file)
        reports = Counter(map(_words, reports_of(file)))
        title = title_of(survey.metadata)
    if as_json:
        channels = {
            topic: {"messages": survey.messages[topic], "bytes": survey.data_bytes[topic]}
            for topic in sorted(survey.messages)
        }
        told = {"title": title, "duration_s": round(survey.duration_s, 3), "channels": channels}
        told |= {"evader_reports": dict(reports), "metadata": dict(survey.metadata)}
        typer.echo(json.dumps({**told, "missing_messages": survey.missing, "torn": survey.torn}, indent=2))
        return
    typer.echo(f"{title}: {survey.duration_s:.2f} s")
    for topic in sorted(survey.messages):
        count, data = survey.messages[topic], survey.data_bytes[topic]
        typer.echo(f"{count:9d} messages {data / 1024:10.1f} KiB  {topic}")
    for words, count in reports.items():
        typer.echo(f"{count:9d} reports of the evader by {words}")
    for name, text in survey.metadata.items():
        typer.echo(f"{name:>12}  {text if len(text) < 100 else text[:97] + '...'}")
    if survey.missing:
        typer.echo(f"{survey.missing} messages are missing in between: the file is damaged")
    typer.echo("whole" if survey.torn is None else f"torn ({survey.torn}): all that can be read is counted here")


def _words(report: "EvaderReport") -> str:
    datum = "unknown" if report.said is None else str(report.said.datum)
    clock = "with" if math.isfinite(report.sent_s) else "without"
    return f"{report.source}, altitudes {datum}, {clock} the sender's clock"


@log.command()
def events(file: File, as_json: Json = False) -> None:
    """List the events: what happened, when, and what it changed."""
    from guidance.log import events_of, making_sense_of  # noqa: PLC0415

    with making_sense_of(file):
        events = list(events_of(file))
    if as_json:
        typer.echo(json.dumps([event._asdict() for event in events], indent=2))
        return
    for event in events:
        typer.echo(f"{event.now_s:10.3f} s  {event.event}  {event.detail}".rstrip())


@log.command()
def export(
    file: File,
    out: Annotated[Path, typer.Argument(help="Ends in .tlog, .csv, .parquet, .geojson or .kml.")],
) -> None:
    """Write a record in another format, by the ending of the wanted file.

    - `.tlog`: the raw frames, for QGroundControl, Mission Planner and mavlogdump
    - `.csv`, `.parquet`: one row a cycle, for spreadsheets and pandas
    - `.geojson`, `.kml`: tracks, fence and changes of state on a map
    """
    from guidance.log import making_sense_of  # noqa: PLC0415
    from guidance.log.export import export as write  # noqa: PLC0415
    from guidance.session.recorded import recorded_settings  # noqa: PLC0415

    with making_sense_of(file):
        written = write(file, out, recorded_settings)
    typer.echo(f"{out}: {written}")
