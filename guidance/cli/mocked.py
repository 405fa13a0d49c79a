"""What `guidance fly` does around a flight of the mock: the world, the record, the live line, the summary."""

import contextlib
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from rich.console import Console

from guidance.cli.showing import live_line, report
from guidance.clock import Clock, MonotonicClock, VirtualClock
from guidance.errors import ConfigError
from guidance.links.opening import KINDS
from guidance.log.background import BackgroundRecorder
from guidance.log.writer import started_utc, versions
from guidance.session.flown import outcome_of_flight
from guidance.session.fly import FlightResult, fly
from guidance.session.linked_flight import Stopped
from guidance.session.recording import RECORD, next_folder, recording
from guidance.sim.faulting import check_faults
from guidance.sim.files import load_scenario
from guidance.sim.mock_process import OVER, ZENOH
from guidance.sim.scenario import Scenario
from guidance.sim.world import World


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
    report(console, result, outcome_of_flight(result, "fast" if fast else "live"), folder)
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
    if link not in KINDS:
        raise ConfigError(f"--link {link}: allowed are {', '.join(KINDS)}")
    if over not in OVER:
        raise ConfigError(f"--over {over}: allowed are {', '.join(OVER)}")
    if not 0 <= port <= 65535:
        raise ConfigError(f"--port {port}: allowed is 0 (pick a free one) to 65535")
    check_faults(scenario)
    clock: Clock = VirtualClock() if fast else MonotonicClock()
    metadata = {"scenario": json.dumps(scenario.model_dump(mode="json")), "seed": str(scenario.seed), **versions()}
    if not fast:  # virtual time is no time of day
        metadata["started_utc"] = started_utc(clock.now_s())
    with recording(folder / RECORD, metadata, real_time=not fast) as recorder, live_line(console) as show:
        on_record(folder / RECORD)
        flying_s = time.perf_counter()
        with _world(scenario, clock, fast=fast, link=link, port=port, over=over) as world:
            result = fly(scenario, world, clock, recorder, show)
        result.wall_s = time.perf_counter() - flying_s
    if recorder.failed is not None and result.record_stopped is None:
        result.record_stopped = Stopped(result.duration_s, recorder.failed)
    if isinstance(recorder, BackgroundRecorder) and recorder.dropped:
        console.print(f"[yellow]the disk was too slow: {recorder.dropped} messages are not in the record[/yellow]")
    return result


@contextlib.contextmanager
def _world(scenario: Scenario, clock: Clock, *, fast: bool, link: str, port: int, over: str) -> Iterator[World]:
    world: World
    if fast:
        from guidance.sim.fast import FastWorld  # noqa: PLC0415 - only one of the worlds is ever needed

        world = FastWorld(scenario, clock)
    else:
        from guidance.sim.live import LiveWorld  # noqa: PLC0415

        world = LiveWorld(scenario, clock, link=link, port=port, over=over)
    try:
        yield world
    finally:
        world.close()
