"""What `guidance fly` does around the flight: the folder, the record, the live line, the summary, the picture."""

import contextlib
import itertools
import json
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from guidance.errors import ConfigError
from guidance.scenarios.faulting import check_faults
from guidance.scenarios.flown import ending_words, outcome_of_flight
from guidance.scenarios.fly import FlightResult, Progress, fly
from guidance.scenarios.loading import load_scenario
from guidance.scenarios.mock_process import OVER, ZENOH
from guidance.scenarios.model import Scenario
from guidance.scenarios.outcome import Outcome
from guidance.scenarios.world import World
from guidance.service.background import BackgroundRecorder
from guidance.service.clock import Clock, MonotonicClock, VirtualClock
from guidance.service.cycle import Stopped
from guidance.service.record import Recorder, started_utc, versions

LINKS = ("mavsdk", "pymavlink")
REDRAW_S = 0.1


def fly_scenario(
    name: str,
    *,
    fast: bool,
    link: str,
    port: int,
    out: Path | None,
    seed: int | None,
    on_record: Callable[[Path], None] = lambda _: None,
) -> int:
    """Fly a scenario by name or path; return the exit code: 0 when the game ended as it should have.

    `on_record` is told of the record once it is being written.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    path, scenario = load_scenario(name)
    if seed is not None:
        scenario = scenario.model_copy(update={"seed": seed})
    console = Console()
    folder = out if out is not None else next_folder(Path("flights"), path.stem)
    console.print(f"[bold]{scenario.title}[/bold]  ({path.name}, {'virtual time' if fast else link})")
    result = flown(scenario, console, folder, fast=fast, link=link, port=port, on_record=on_record)
    _report(console, result, folder, fast=fast)
    return 0 if result.captured else 4


def flown(
    scenario: Scenario,
    console: Console,
    folder: Path,
    *,
    fast: bool,
    link: str,
    port: int,
    over: str = ZENOH,
    on_record: Callable[[Path], None] = lambda _: None,
) -> FlightResult:
    """Fly a scenario against the mock with a live line on the console and the record in a folder.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    if link not in LINKS:
        raise ConfigError(f"--link {link}: allowed are {', '.join(LINKS)}")
    if over not in OVER:
        raise ConfigError(f"--over {over}: allowed are {', '.join(OVER)}")
    if not 0 <= port <= 65535:
        raise ConfigError(f"--port {port}: allowed is 0 (pick a free one) to 65535")
    check_faults(scenario)
    clock: Clock = VirtualClock() if fast else MonotonicClock()
    metadata = {"scenario": json.dumps(scenario.model_dump(mode="json")), "seed": str(scenario.seed), **versions()}
    if not fast:  # virtual time is no time of day
        metadata["started_utc"] = started_utc(clock.now_s())
    with recording(folder / "record.mcap", metadata, real_time=not fast) as recorder, _line(console) as show:
        on_record(folder / "record.mcap")
        flying_s = time.perf_counter()
        with _world(scenario, clock, fast=fast, link=link, port=port, over=over) as world:
            result = fly(scenario, world, clock, recorder, show)
        result.wall_s = time.perf_counter() - flying_s
    if recorder.failed is not None and result.record_stopped is None:
        result.record_stopped = Stopped(result.duration_s, recorder.failed)
    if isinstance(recorder, BackgroundRecorder) and recorder.dropped:
        console.print(f"[yellow]the disk was too slow: {recorder.dropped} messages are not in the record[/yellow]")
    return result


def next_folder(parent: Path, stem: str) -> Path:
    """Return the first of `parent/stem-001`, `-002`, … that is not there yet."""
    return next(folder for number in itertools.count(1) if not (folder := parent / f"{stem}-{number:03d}").exists())


@contextlib.contextmanager
def recording(path: Path, metadata: Mapping[str, str], *, real_time: bool) -> Iterator[Recorder | BackgroundRecorder]:
    """Open the record. In real time it is written from a thread of its own: a slow disk holds up no cycle."""
    try:
        written = Recorder(path, metadata)
    except OSError as error:
        raise ConfigError(
            f"--out {path.parent}: cannot be written ({error.strerror}); choose another folder"
        ) from error
    recorder = BackgroundRecorder(written) if real_time else written
    try:
        yield recorder
    finally:
        recorder.close()


@contextlib.contextmanager
def _world(scenario: Scenario, clock: Clock, *, fast: bool, link: str, port: int, over: str) -> Iterator[World]:
    world: World
    if fast:
        from guidance.scenarios.fast import FastWorld  # noqa: PLC0415 - only one of the worlds is ever needed

        world = FastWorld(scenario, clock)
    else:
        from guidance.scenarios.live import LiveWorld  # noqa: PLC0415

        world = LiveWorld(scenario, clock, link=link, port=port, over=over)
    try:
        yield world
    finally:
        world.close()


@contextlib.contextmanager
def _line(console: Console) -> Iterator[Any]:
    """Show one live line, redrawn ten times a second; where there is no terminal, a plain line at every change."""
    drawn_s = 0.0
    shown = ""
    told = False
    with Live(console=console, auto_refresh=False, transient=True) as live:

        def show(progress: Progress) -> None:
            nonlocal drawn_s, shown, told
            if progress.record_stopped is not None and not told:
                told = True
                console.print(f"[yellow]{progress.now_s:7.1f} s  {record_words(progress.record_stopped)}[/yellow]")
            if not console.is_terminal:
                if str(progress.state) != shown:
                    shown = str(progress.state)
                    console.print(f"{progress.now_s:7.1f} s  {shown}")
                return
            if time.perf_counter() - drawn_s >= REDRAW_S:
                drawn_s = time.perf_counter()
                live.update(Text(_words(progress), no_wrap=True, overflow="crop"), refresh=True)

        yield show


def record_words(stopped: Stopped | None) -> str:
    """Say whether everything was recorded."""
    return "whole" if stopped is None else f"recording stopped at {stopped.now_s:.1f} s: {stopped.reason}"


def _words(progress: Progress) -> str:
    words = f"{progress.now_s:6.1f} s  {progress.state:<11} in {progress.mode:<7}"
    certificate, unit = progress.certificate, progress.unit
    if certificate is None:
        return words
    return (
        f"{words} range {certificate.gap_m:5.1f} m, {certificate.height_gap_m:5.1f} m up"
        f"  value to go {certificate.value:5.1f} {unit}"
    )


def _report(console: Console, result: FlightResult, folder: Path, *, fast: bool) -> None:
    from guidance.scenarios.picture import draw  # noqa: PLC0415 - matplotlib takes a second

    outcome = outcome_of_flight(result, "fast" if fast else "live")
    console.print(_table(result, outcome))
    if fast:
        speed = result.duration_s / result.wall_s
        console.print(
            f"{result.duration_s:.1f} s of flight in {result.wall_s:.2f} s: {speed:.0f} times faster than real time"
        )
    console.print(f"record   {folder / 'record.mcap'}", soft_wrap=True, highlight=False)
    try:
        draw(result, outcome, folder / "flight.png")
    except OSError as error:
        console.print(f"[yellow]picture  {folder / 'flight.png'}: cannot be written ({error.strerror})[/yellow]")
    else:
        console.print(f"picture  {folder / 'flight.png'}", soft_wrap=True, highlight=False)


def _table(result: FlightResult, outcome: Outcome) -> Table:
    unit, what = ("s", "capture time") if outcome.game == "pe" else ("m", "evader's final distance to T")
    title = f"{ending_words(outcome)}, {what}"
    table = Table(title=title, title_justify="left", show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold")
    table.add_column(justify="right")
    rows = {
        "value predicted at engagement": f"{outcome.predicted:.2f} {unit}",
        "flown": f"{outcome.achieved:.2f} {unit}",
        "flown / predicted": f"{outcome.ratio:.3f}",
        "game lasted": f"{outcome.game_time_s:.2f} s",
        "setpoints sent": f"{result.setpoints_sent}",
        "late ticks": f"{result.late_ticks} of {result.cycles}",
        "guarantee alarms": f"{outcome.alarms}",
        "flight ended": f"{result.ended}, after {outcome.duration_s:.1f} s",
        "record": record_words(result.record_stopped),
    }
    for name, value in rows.items():
        table.add_row(name, value)
    return table
