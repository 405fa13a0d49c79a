"""Scenarios flown from connecting to the end: in any world, or by the mock in virtual time or as a live process."""

import contextlib
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from guidance.clock import Clock, MonotonicClock, VirtualClock
from guidance.errors import ConfigError
from guidance.links.opening import KINDS
from guidance.log.entries import FLIGHT_OVER
from guidance.log.writer import BackgroundRecorder
from guidance.session.control_bus import broadcasting, opened
from guidance.session.daemon import Equipment
from guidance.session.flight_files import RECORD, Stopped, flight_metadata, recording
from guidance.session.loop import Signals, World, run
from guidance.session.mission import Mission, Show
from guidance.session.orders import Mailbox
from guidance.session.plan import FlightPlan
from guidance.session.result import FlightResult, MissionResult, closing_detail
from guidance.session.sequencer import MOCKED, MissionPolicy
from guidance.sim.live import OVER, ZENOH, LiveWorld
from guidance.sim.mock_files import check_faults
from guidance.sim.scenario import PURSUER, Flown, Scenario
from guidance.sim.stepped import SteppedWorld


def fly(
    flown: Flown,
    world: World,
    clock: Clock,
    *,
    plans: Mapping[str, FlightPlan] | None = None,
    equipment: Mapping[str, Equipment] | None = None,
    policy: MissionPolicy = MOCKED,
    show: Show = lambda _: None,
    signals: Signals | None = None,
) -> MissionResult:
    """Fly a scenario, or several pursuits at the same time, to the end. The caller closes the world.

    Args:
        flown: Who pursues whom.
        world: All vehicles and evaders.
        clock: The world's time.
        plans: Flight plans by vehicle; by default the scenario's own.
        equipment: Of the daemons, by vehicle.
        policy: Which orders the mission may give, and how vehicles are handed over.
        show: Called for each vehicle in every cycle.
        signals: Of the operating system; None leaves them to the process.

    Raises:
        ConfigError: If a scenario names what does not exist.
        FlightError: If a vehicle may not fly, or does not get ready.
        LinkError: If the world ends before the flight does.
    """
    mission = Mission(flown, world, clock, plans=plans, equipment=equipment, policy=policy, show=show)
    begun_s = time.perf_counter()
    run(mission.daemons, world, clock, mission=mission, signals=signals)
    return mission.stop(time.perf_counter() - begun_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class MockOptions:
    """How the mock flies.

    Attributes:
        fast: In virtual time; else in real time, with the mock as a live process.
        link: Which client flies in real time.
        port: Of the live mock's Zenoh session, or its first UDP port; 0 is any.
        over: Transport to the live mock.

    Raises:
        ConfigError: If an option has an unknown value.
    """

    fast: bool
    link: str = "mavsdk"
    port: int = 0
    over: str = ZENOH

    def __post_init__(self) -> None:
        if self.link not in KINDS:
            raise ConfigError(f"--link {self.link}: allowed are {', '.join(KINDS)}")
        if self.over not in OVER:
            raise ConfigError(f"--over {self.over}: allowed are {', '.join(OVER)}")
        if not 0 <= self.port <= 65535:
            raise ConfigError(f"--port {self.port}: allowed is 0 (pick a free one) to 65535")

    @property
    def way(self) -> str:
        """The kind of run in an outcome row."""
        return "fast" if self.fast else "live"


def fly_mock(
    scenario: Scenario,
    folder: Path,
    show: Show,
    options: MockOptions,
    *,
    on_record: Callable[[Path], None] = lambda _: None,
    control: str | None = None,
    on_control: Callable[[str], None] = lambda _: None,
) -> FlightResult:
    """Fly a scenario against the mock, with the record in a folder.

    Args:
        scenario: The scenario.
        folder: For the record.
        show: Called in every cycle.
        options: In which time and over which links.
        on_record: Called with the record's path when it is open.
        control: Endpoint for orders and onlookers; a free one if that is in use. None opens none.
        on_control: Called with the endpoint.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    check_faults(scenario)
    clock: Clock = VirtualClock() if options.fast else MonotonicClock()
    metadata = flight_metadata(scenario, None, None if options.fast else clock)
    mailbox = Mailbox()
    with recording(folder / RECORD, metadata, real_time=not options.fast) as record:
        on_record(folder / RECORD)
        with (
            contextlib.closing(_mock(scenario, clock, options)) as world,
            opened(PURSUER, mailbox, control, on_control) as bus,
            broadcasting(PURSUER, bus, metadata) as broadcast,
        ):
            used = Equipment(mailbox=mailbox, record=record, broadcast=broadcast)
            result = fly(scenario, world, clock, equipment={PURSUER: used}, show=show).vehicles[PURSUER]
            if broadcast is not None:
                broadcast.event(clock.now_s(), FLIGHT_OVER, closing_detail(result, options.way, folder))
    if record.failed is not None and result.record_stopped is None:
        result.record_stopped = Stopped(result.duration_s, record.failed)
    result.record_dropped = record.dropped if isinstance(record, BackgroundRecorder) else 0
    return result


def _mock(scenario: Scenario, clock: Clock, options: MockOptions) -> World:
    if options.fast:
        return SteppedWorld(scenario, clock)
    return LiveWorld(scenario, clock, link=options.link, port=options.port, over=options.over)
