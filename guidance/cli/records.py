"""`guidance log`, `replay` and `report`: inspect, export, replay and draw a flight record."""

import json
import math
from collections import Counter
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.text import Text

from guidance.cli.arguments import AsJson, CommandGroup
from guidance.errors import ConfigError
from guidance.extras import require_extras
from guidance.log import (
    Survey,
    compare,
    events_of,
    record_errors,
    reports_of,
    title_of,
)
from guidance.log import export as exports
from guidance.log.bag import BAG_FOLDER, write_bag
from guidance.log.entries import CYCLE, cycle_entry
from guidance.log.replay import Comparison, Difference
from guidance.screen import console, live, pairs, text_table
from guidance.session.flight_files import RECORD, changes_of, recorded_settings
from guidance.texts import printable

log = typer.Typer(cls=CommandGroup, help="Inspect a flight record, and export it for other tools.")


def record_file(path: Path) -> Path:
    """Return a record; of a flight's folder, the one in it.

    Raises:
        ConfigError: If the folder contains the records of several vehicles, or none.
    """
    if not path.is_dir():
        return path
    record = path / RECORD
    if record.exists():
        return record
    vehicles = sorted(_records_in(path))
    if vehicles:
        names = ", ".join(vehicles)
        raise ConfigError(f"{path}: a team flight; name a vehicle's folder: {names}")
    raise ConfigError(f"{path}: contains no {RECORD}; give a record or a flight's folder")


def _records_in(folder: Path) -> dict[str, Path]:
    """Return the records of a team flight's folder by vehicle; empty for any other."""
    records = sorted(folder.glob(f"*/{RECORD}"))
    return {record.parent.name: record for record in records}


def team_records(path: Path) -> dict[str, Path]:
    """Return the records of a flight by vehicle; of a single one by an empty name.

    Raises:
        ConfigError: If the folder contains no record.
    """
    if path.is_dir() and not (path / RECORD).exists():
        records = _records_in(path)
        if records:
            return records
    return {"": record_file(path)}


def bag_folder(path: Path) -> Path:
    """Return the default folder of a bag: in a flight's folder, or beside a record under its name."""
    if path.is_dir() or path.name == RECORD:
        folder = path if path.is_dir() else path.parent
        return folder / BAG_FOLDER
    return path.with_name(f"{path.stem}-{BAG_FOLDER}")


File = Annotated[
    Path,
    typer.Argument(help="A record.mcap of a flight, or its folder.", callback=record_file),
]


@log.command()
def info(file: File, as_json: AsJson = False) -> None:
    """Show duration, channels and versions of a record, and whether it is complete."""
    survey = Survey()
    with record_errors(file):
        reports = Counter[str]()
        for report in reports_of(file, survey):
            datum = "unknown" if report.said is None else str(report.said.datum)
            clock = "with" if math.isfinite(report.sent_s) else "without"
            reports[f"{report.source}, altitudes {datum}, {clock} the sender's clock"] += 1
        title = title_of(survey.metadata)
        topics = sorted(survey.messages)
    if as_json:
        channels = {
            topic: {"messages": survey.messages[topic], "bytes": survey.data_bytes[topic]}
            for topic in topics
        }
        summary = {
            "title": title,
            "duration_s": round(survey.duration_s, 3),
            "channels": channels,
            "evader_reports": dict(reports),
            "metadata": dict(survey.metadata),
            "missing_messages": survey.missing,
            "torn": survey.torn,
            "missing_files": survey.missing_files,
            "damaged_chunks": survey.damaged_chunks,
        }
        typer.echo(json.dumps(summary, indent=2))
        return
    target = console()
    heading = f"{title}: {survey.duration_s:.2f} s"
    target.print(Text(printable(heading)))
    # Channels, the evader's reports by source, metadata and faults.
    rows = []
    for topic in topics:
        messages = str(survey.messages[topic])
        size_kib = survey.data_bytes[topic] / 1024
        rows.append((messages, f"{size_kib:.1f}", Text(printable(topic))))
    target.print(text_table(("messages", "KiB", "channel"), rows, left=(2,)))
    for source, count in reports.items():
        target.print(Text(f"{count} reports of the evader by {printable(source)}"))
    metadata = []
    for name, text in survey.metadata.items():
        shortened = text if len(text) < 100 else text[:97] + "..."
        metadata.append((printable(name), Text(printable(shortened))))
    target.print(pairs(metadata))
    for fault in survey.faults:
        target.print(Text(printable(fault)))
    if not survey.faults:
        target.print("whole")


@log.command()
def events(file: File, as_json: AsJson = False) -> None:
    """List the events of a record: time, event and detail."""
    with record_errors(file):
        events = list(events_of(file))
    if as_json:
        documents = [event._asdict() for event in events]
        typer.echo(json.dumps(documents, indent=2))
        return
    rows = []
    for event in events:
        name = Text(printable(event.event))
        detail = Text(printable(event.words))
        rows.append((f"{event.now_s:.3f}", name, detail))
    console().print(text_table(("time, s", "event", "detail"), rows, left=(1, 2)))


@log.command()
def export(
    file: Annotated[
        Path,
        typer.Argument(help="A record.mcap of a flight, or a flight's folder, also of a team."),
    ],
    out: Annotated[
        Path | None,
        typer.Argument(
            help="Name with one of the endings below; default: a bag in the flight's folder."
        ),
    ] = None,
) -> None:
    """Write a record in another format, chosen by the ending of OUT.

    - no ending: a folder with a ROS 2 bag (MCAP), for RViz, Foxglove and `ros2 bag`; of a team all vehicles
    - `.tlog`: the raw frames, for QGroundControl, Mission Planner and mavlogdump
    - `.csv`, `.parquet`: one row per cycle, for spreadsheets and pandas
    - `.geojson`, `.kml`: tracks, fence and state changes on a map
    """
    if out is None or not out.suffix:
        records = team_records(file)
        bag = bag_folder(file) if out is None else out
        with record_errors(file):
            written = write_bag(records, bag, recorded_settings)
        typer.echo(f"{bag}: {written}")
        return
    record = record_file(file)
    with record_errors(record):
        written = exports.export(record, out, recorded_settings)
    typer.echo(f"{out}: {written}")


def replay(
    file: File,
    changes: Annotated[
        list[str] | None, typer.Option("--with", help="KEY=VALUE; may be repeated.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run the present code on the recorded inputs and compare the setpoints bit for bit.

    If one differs, exits with 1 and shows the first difference with its inputs. With `--with`, shows how the commands
    differ under another setting; the motion of both vehicles stays as recorded.

    - `guidance replay flights/pe-001/record.mcap`: does the code still send the same commands?
    - `guidance replay record.mcap --with policy=pure_pursuit`: another policy on the same inputs
    - `guidance replay record.mcap --with pursuer.speed_m_s=4.0`: another speed
    """
    changed = changes_of([] if changes is None else changes)
    comparison, survey = _compared(file, changed)
    for fault in survey.faults:
        typer.echo(f"the record is not whole: {printable(fault)}", err=True)
    if not comparison.cycles:
        raise ConfigError(f"{file}: has no cycle: nothing was replayed")
    if as_json:
        names = ("cycles", "setpoints", "differing")
        document = {name: getattr(comparison, name) for name in names}
        if changed:
            document["wanted"] = comparison.wanted._asdict()
            document["commanded"] = comparison.commanded._asdict()
        typer.echo(json.dumps(document, indent=2))
    else:
        typer.echo(f"{comparison.cycles} cycles, {comparison.setpoints} setpoints recorded")
        if changed:
            typer.echo(f"{comparison.differing} cycles differ")
            typer.echo(_difference("wanted by the policy", comparison.wanted))
            typer.echo(_difference("commanded", comparison.commanded))
        else:
            typer.echo(_same_or_first(comparison))
    if not changed and (comparison.first is not None or not comparison.setpoints):
        raise typer.Exit(1)


def _compared(file: Path, changes: Mapping[str, Any]) -> tuple[Comparison, Survey]:
    """Replay a record and show on a terminal how far it is."""
    replayed_s = 0.0

    def note(now_s: float) -> None:
        nonlocal replayed_s
        replayed_s = now_s

    def progress() -> str:
        return f"replaying: {replayed_s:.0f} s of flight time"

    settings_of = partial(recorded_settings, changes=changes)
    with record_errors(file), live(console(stderr=True), progress):
        return compare(file, settings_of, what_if=bool(changes), watch=note)


def _same_or_first(comparison: Comparison) -> str:
    if comparison.first is not None:
        recorded = CYCLE.plain(comparison.first.row)
        row = comparison.first.row
        present = CYCLE.plain(cycle_entry(row.now_s, row.inputs, comparison.first.outputs))
        lines = [f"at {row.now_s:.6f} s, in state {row.state}:"]
        for name in comparison.first.differing:
            recorded_text = json.dumps(recorded.get(name))
            present_text = json.dumps(present.get(name))
            lines.append(f"  {name}")
            lines.append(f"    recorded  {recorded_text}")
            lines.append(f"    now       {present_text}")
        lines.append("  inputs")
        for name, value in recorded["inputs"].items():
            parts = value
            if not isinstance(value, list):
                parts = [value]
            lines.extend(f"    {name}  {json.dumps(part)}" for part in parts)
        first_difference = "\n".join(lines)
        return f"{comparison.differing} cycles differ; the first:\n{first_difference}"
    if comparison.setpoints:
        return "every setpoint, state and request came back bit for bit"
    return "no setpoint was recorded, so none was compared; every state came back"


def _difference(quantity: str, difference: Difference) -> str:
    cycles, sum_rad, greatest_rad, sum_m_s, greatest_m_s = difference
    count = max(1, cycles)
    mean_m_s = sum_m_s / count
    mean_deg = math.degrees(sum_rad / count)
    greatest_deg = math.degrees(greatest_rad)
    speeds = f"{mean_m_s:.2f} m/s apart on average, {greatest_m_s:.2f} at most"
    angles = f"{mean_deg:.1f}° on average, {greatest_deg:.1f}° at most"
    return f"{quantity} over {cycles} cycles: {speeds}; {angles}"


def report(
    files: Annotated[
        list[Path], typer.Argument(help="One or more record.mcap of flights, or a flight's folder.")
    ],
    out: Annotated[
        Path | None, typer.Option(help="Folder; of several records, each has one in it.")
    ] = None,
    animate: Annotated[
        bool, typer.Option("--animate", help="Write flight.webp, too: plan and height.")
    ] = False,
) -> None:
    """Draw records: one self-contained HTML page for each, and its pictures as PNG. A team flight has one for all.

    Tracks in space and from above with fence, stand-off and isochrons, the game and its guarantee over time, commanded
    and flown velocities, ages and latencies, events, and a summary. They go next to a flight's record.mcap; for a
    daemon's record, into a folder of its name.

    - `guidance report flights/pe-001/record.mcap`
    - `guidance report flights/teams_guard-001`: the merged report of a team flight
    - `guidance report records/*.mcap --animate`
    """
    require_extras("guidance report", "plot")
    from guidance.viz.report import write_report, write_team_report  # noqa: PLC0415 - matplotlib loads slowly

    for path in files:
        team = _records_in(path)
        file = path / RECORD if path.is_dir() else path
        record_folder = file.parent if file.name == RECORD else file.with_suffix("")
        if out is None:
            folder = record_folder
        elif len(files) == 1:
            folder = out
        else:
            folder = out / record_folder.name
        with record_errors(file):
            if team:
                paths = write_team_report(team, folder)
            else:
                paths = write_report(file, folder, animate=animate)
        typer.echo("\n".join(map(str, paths)))
