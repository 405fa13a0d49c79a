"""`guidance log`, `replay` and `report`: a record looked into, exported, put through the present code, and drawn."""

import json
import math
from collections import Counter
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from guidance.cli.arguments import CommandGroup
from guidance.extras import require

if TYPE_CHECKING:
    from guidance.log import Comparison, ReplayedCycle
    from guidance.log.replay import Apart
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
    from guidance.session.flight_files import recorded_settings  # noqa: PLC0415

    with making_sense_of(file):
        written = write(file, out, recorded_settings)
    typer.echo(f"{out}: {written}")


def replay(
    file: Annotated[Path, typer.Argument(help="A record.mcap that a flight wrote.")],
    changes: Annotated[
        list[str] | None,
        typer.Option("--with", help="KEY=VALUE: what another setting would have commanded; may be repeated."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="CSV with both velocities of every cycle.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the counts as JSON.")] = False,
) -> None:
    """Feed the recorded inputs through the present code and compare the setpoints bit for bit.

    Exits with 1 and shows the first difference with its inputs if there is one. With `--with`, shows how far what
    another setting would have commanded lies from what was; the motion of both vehicles stays as recorded.

    - `guidance replay flights/pe-001/record.mcap`: has the code changed what it commands?
    - `guidance replay record.mcap --with policy=pure_pursuit`: another policy at the same moments
    - `guidance replay record.mcap --with pursuer.speed_m_s=4.0 --out both.csv`
    """
    from guidance.log import making_sense_of  # noqa: PLC0415 - numpy takes its time
    from guidance.log.replay import compare_into  # noqa: PLC0415
    from guidance.session.flight_files import changes_of, recorded_settings  # noqa: PLC0415

    wanted = changes_of(changes or [])
    with making_sense_of(file):
        comparison, survey = compare_into(file, partial(recorded_settings, changes=wanted), out, what_if=bool(wanted))
    if survey.torn is not None:
        typer.echo(f"the record is torn ({survey.torn}): read up to {survey.last_s or 0.0:.2f} s", err=True)
    if survey.missing:
        typer.echo(f"{survey.missing} messages are missing in between: the file is damaged", err=True)
    if as_json:
        typer.echo(json.dumps(_counted(comparison, what_if=bool(wanted)), indent=2))
        raise typer.Exit(1 if comparison.first is not None and not wanted else 0)
    if out is not None:
        typer.echo(f"both velocities: {out}")
    typer.echo(f"{comparison.cycles} cycles, {comparison.setpoints} setpoints recorded")
    if wanted:
        typer.echo(f"{comparison.differing} cycles differ")
        typer.echo(_apart("wanted by the policy", comparison.wanted))
        typer.echo(_apart("commanded", comparison.commanded))
        return
    if comparison.first is not None:
        typer.echo(f"{comparison.differing} cycles differ; the first:")
        typer.echo(_shown(comparison.first))
        raise typer.Exit(1)
    typer.echo("every setpoint, state and request came back bit for bit")


def _counted(comparison: "Comparison", *, what_if: bool) -> dict[str, Any]:
    counts = {name: getattr(comparison, name) for name in ("cycles", "setpoints", "differing")}
    if not what_if:
        return counts
    return counts | {name: asdict(getattr(comparison, name)) for name in ("wanted", "commanded")}


def _apart(what: str, apart: "Apart") -> str:
    count = max(1, apart.cycles)
    return (
        f"{what} over {apart.cycles} cycles: {apart.speed_sum_m_s / count:.2f} m/s apart on average, "
        f"{apart.speed_most_m_s:.2f} at most; {math.degrees(apart.angle_sum_rad / count):.1f}° on average, "
        f"{math.degrees(apart.angle_most_rad):.1f}° at most"
    )


def _shown(step: "ReplayedCycle") -> str:
    from guidance.log.entries import CYCLE, cycle_entry  # noqa: PLC0415

    recorded, present = CYCLE.plain(step.row), CYCLE.plain(cycle_entry(step.row.flight_inputs, step.outputs))
    lines = [f"at {step.row.now_s:.6f} s, in state {step.row.state}:"]
    for name in step.differing:
        lines += [f"  {name}", f"    recorded  {json.dumps(recorded.get(name))}"]
        lines.append(f"    now       {json.dumps(present.get(name))}")
    lines.append("  inputs")
    for name, value in recorded["inputs"].items():
        lines += [f"    {name}  {json.dumps(one)}" for one in value]
    return "\n".join(lines)


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
    from guidance.session.flight_files import recorded_settings  # noqa: PLC0415
    from guidance.viz.report import write_report  # noqa: PLC0415 - matplotlib takes a second

    with making_sense_of(file):
        paths = write_report(file, file.parent if out is None else out, recorded_settings)
    for path in paths:
        typer.echo(str(path))
