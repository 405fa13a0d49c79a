"""Implementation of `sitl-mock compare`: from a file's path to the exit code."""

import json
from pathlib import Path

import typer
from rich.console import Console
from rich.table import Table

from sitl_mock.compare.behaviour import (
    Behaviour,
    behaviour_of,
    differences,
    span,
)
from sitl_mock.compare.recording import fly_recording, read_tlog


def compare_file(file: Path, *, as_json: bool, ranges: bool) -> int:
    """Compare a recording with the mock, print the result, and give the exit code: 0 alike, 1 different.

    Raises:
        ConfigError: The file is no tlog of a vehicle that the mock knows.
    """
    recording = read_tlog(file)
    recorded = behaviour_of(recording.said)
    mock = behaviour_of(fly_recording(recording))
    departures = differences(recorded, mock)
    if as_json:
        typer.echo(
            json.dumps(
                {
                    "flavour": recording.flavour,
                    "duration_s": round(recording.end_s, 3),
                    "one_sided": recording.one_sided,
                    "notes": list(recording.notes),
                    "messages": {
                        name: {
                            side: {"count": stream.count, "rate_hz": round(stream.rate_hz, 3)}
                            for side, stream in (
                                ("recorded", recorded.get(name)),
                                ("mock", mock.get(name)),
                            )
                            if stream is not None
                        }
                        for name in sorted({*recorded, *mock})
                    },
                    "fields": {
                        name: {
                            f"{label} ({phase})": [
                                span(values),
                                span(mock[name].fields[phase][label]),
                            ]
                            for phase, fields in recorded[name].fields.items()
                            for label, values in fields.items()
                            if label in mock[name].fields.get(phase, {})
                        }
                        for name in sorted(recorded.keys() & mock.keys())
                    },
                    "differences": [difference._asdict() for difference in departures],
                },
                indent=1,
            )
        )
    else:
        console = Console()
        for note in recording.notes:
            console.print(f"Note: {note}.", soft_wrap=True)
        table = Table(title=f"{recording.flavour}, {recording.end_s:.0f} s: messages")
        for column in ("message", "recorded", "Hz", "mock", "Hz"):
            table.add_column(column, justify="left" if column == "message" else "right")
        for name in sorted({*recorded, *mock}):
            cells = []
            for stream in (recorded.get(name), mock.get(name)):
                if stream is None:
                    cells += ["-", "-"]
                else:
                    cells += [str(stream.count), f"{stream.rate_hz:.2f}"]
            table.add_row(name, *cells)
        console.print(table)
        if ranges:
            console.print(_ranges(recorded, mock))
        if departures:
            columns = ("what", "message", "field", "recorded", "mock")
            table = Table(*columns, title=f"{len(departures)} differences")
            for departure in departures:
                table.add_row(*departure)
            console.print(table)
        else:
            console.print("No difference.")
    return 1 if departures else 0


def _ranges(recorded: Behaviour, mock: Behaviour) -> Table:
    table = Table(title="values")
    for column in ("message", "field", "phase", "recorded", "mock"):
        table.add_column(column)
    for name in sorted(recorded.keys() & mock.keys()):
        for phase, fields in recorded[name].fields.items():
            for label, values in fields.items():
                other = mock[name].fields.get(phase, {}).get(label)
                table.add_row(
                    name, label, phase, span(values), "-" if other is None else span(other)
                )
    return table
