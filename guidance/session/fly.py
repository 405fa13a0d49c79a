"""A scenario flown in whichever world, from connecting to the end, and where its files go.

`fly` is every scenario's flight. `fly_mock` opens a world of the mock around it, in virtual time or as a live process;
`guidance.session.vehicle` does the same for a vehicle that is not ours.
"""

import contextlib
import itertools
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final

from guidance.clock import Clock, MonotonicClock, VirtualClock
from guidance.errors import ConfigError
from guidance.links.opening import KINDS
from guidance.log.background import BackgroundRecorder
from guidance.log.writer import Record, Recorder, started_utc, versions
from guidance.session.daemon import Daemon
from guidance.session.linked_flight import Stopped
from guidance.session.log import SILENT, Logger
from guidance.session.loop import Signals, run
from guidance.session.mission import MOCKED, Conduct, Mission, Progress
from guidance.session.notify import Notifier
from guidance.session.orders import Mailbox
from guidance.session.result import FlightResult
from guidance.session.spec import FlightPlan, plan_of
from guidance.session.vehicle_file import Config
from guidance.session.world import World
from guidance.sim.faulting import check_faults
from guidance.sim.fleet import PURSUER
from guidance.sim.mock_process import OVER, ZENOH
from guidance.sim.scenario import Scenario
from guidance.sim.sensed_evader import SensedEvader

RECORD: Final = "record.mcap"
PICTURE: Final = "flight.png"
OUTCOME: Final = "outcome.json"


def fly(
    scenario: Scenario,
    world: World,
    clock: Clock,
    record: Record | None = None,
    show: Callable[[Progress], None] = lambda _: None,
    *,
    plan: FlightPlan | None = None,
    conduct: Conduct = MOCKED,
    name: str = PURSUER,
    mailbox: Mailbox | None = None,
    log: Logger = SILENT,
    notifier: Notifier | None = None,
    signals: Signals | None = None,
) -> FlightResult:
    """Fly a scenario to its end.

    Args:
        scenario: What is flown.
        world: Where; it is closed by who opened it.
        clock: Its time.
        record: Where the flight is kept.
        show: Is told of every cycle.
        plan: What it is flown by; the scenario's own if not given.
        conduct: What a person allowed, and what becomes of the vehicle.
        name: The vehicle's.
        mailbox: Where a person's orders come in.
        log: Where the daemon logs.
        notifier: Whom it gives signs of life.
        signals: The operating system's; None leaves them to the process.

    Raises:
        ConfigError: If the scenario names what does not exist.
        FlightError: If the vehicle may not fly, or does not get ready.
        LinkError: If the world ends before the flight does.
    """
    heard = SensedEvader(world.evader_source, scenario.sensor, scenario.seed, clock.now_s)
    plan = plan_of(scenario=scenario) if plan is None else plan
    daemon = Daemon(name, plan, world.link, heard, mailbox=mailbox, log=log, notifier=notifier, record=record)
    mission = Mission(scenario, daemon, world, heard, conduct, show=show)
    begun_s = time.perf_counter()
    run(daemon, world, clock, mission=mission, signals=signals, record=record)
    if world.player is not None:
        world.player.stop()
    mission.result.interrupted = not mission.left
    mission.result.wall_s = time.perf_counter() - begun_s
    return mission.result


def fly_mock(
    scenario: Scenario,
    folder: Path,
    show: Callable[[Progress], None],
    *,
    fast: bool,
    link: str,
    port: int,
    over: str = ZENOH,
    on_record: Callable[[Path], None] = lambda _: None,
) -> FlightResult:
    """Fly a scenario against the mock, with the record in a folder.

    Args:
        scenario: What is flown.
        folder: For the record.
        show: Is told of every cycle.
        fast: In virtual time; else in real time, with the mock as a live process.
        link: Which client flies in real time.
        port: Of the mock's Zenoh session, or its first UDP port; 0 is any.
        over: What the live mock is reached over.
        on_record: Is told of the record once it is being written.

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
    with recording(folder / RECORD, metadata_of(scenario, None, None if fast else clock), real_time=not fast) as record:
        on_record(folder / RECORD)
        with _mock(scenario, clock, fast=fast, link=link, port=port, over=over) as world:
            result = fly(scenario, world, clock, record, show)
    if record.failed is not None and result.record_stopped is None:
        result.record_stopped = Stopped(result.duration_s, record.failed)
    result.record_dropped = record.dropped if isinstance(record, BackgroundRecorder) else 0
    return result


@contextlib.contextmanager
def _mock(scenario: Scenario, clock: Clock, *, fast: bool, link: str, port: int, over: str) -> Iterator[World]:
    world: World
    if fast:
        from guidance.sim.stepped import SteppedWorld  # noqa: PLC0415 - only one of the worlds is ever needed

        world = SteppedWorld(scenario, clock)
    else:
        from guidance.sim.live import LiveWorld  # noqa: PLC0415

        world = LiveWorld(scenario, clock, link=link, port=port, over=over)
    try:
        yield world
    finally:
        world.close()


def metadata_of(scenario: Scenario, config: Config | None, clock: Clock | None) -> dict[str, str]:
    """Return what a record says of its flight: files, seed, versions and, where time is real, when it began."""
    return {
        "scenario": scenario.model_dump_json(exclude_unset=config is not None),
        **({} if config is None else {"config": config.model_dump_json()}),
        "seed": str(scenario.seed),
        **versions(),
        **({} if clock is None else {"started_utc": started_utc(clock.now_s())}),
    }


def next_folder(parent: Path, stem: str) -> Path:
    """Return the first of `parent/stem-001`, `-002`, … that is not there yet."""
    return next(folder for number in itertools.count(1) if not (folder := parent / f"{stem}-{number:03d}").exists())


@contextlib.contextmanager
def recording(path: Path, metadata: Mapping[str, str], *, real_time: bool) -> Iterator[Recorder | BackgroundRecorder]:
    """Open the record. In real time it is written from a thread of its own: a slow disk holds up no cycle.

    Raises:
        ConfigError: If it cannot be written.
    """
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
