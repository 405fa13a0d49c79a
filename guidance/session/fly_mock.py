"""A flight of the mock, in virtual time or of a live process."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

from guidance.clock import Clock, MonotonicClock, VirtualClock
from guidance.errors import ConfigError
from guidance.links.opening import KINDS
from guidance.log.entries import FLIGHT_OVER
from guidance.log.writer import BackgroundRecorder
from guidance.session.control_bus import broadcasting, opened
from guidance.session.flight_files import RECORD, flight_metadata, recording
from guidance.session.fly import fly
from guidance.session.linked_flight import Stopped
from guidance.session.loop import World
from guidance.session.mission import Progress
from guidance.session.orders import Mailbox
from guidance.session.result import FlightResult, closing_detail
from guidance.sim.live import OVER, ZENOH
from guidance.sim.mock_files import check_faults
from guidance.sim.scenario import PURSUER, Scenario


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
    control: str | None = None,
    on_control: Callable[[str], None] = lambda _: None,
) -> FlightResult:
    """Fly a scenario against the mock, with the record in a folder.

    Args:
        scenario: The scenario.
        folder: For the record.
        show: Called in every cycle.
        fast: In virtual time; else in real time, with the mock as a live process.
        link: Which client flies in real time.
        port: Of the mock's Zenoh session, or its first UDP port; 0 is any.
        over: Transport to the live mock.
        on_record: Called with the record's path when it is open.
        control: Endpoint for orders and onlookers; a free one if that is in use. None opens none.
        on_control: Called with the endpoint.

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
    metadata = flight_metadata(scenario, None, None if fast else clock)
    with recording(folder / RECORD, metadata, real_time=not fast) as record:
        on_record(folder / RECORD)
        mailbox = Mailbox()
        with (
            _mock(scenario, clock, fast=fast, link=link, port=port, over=over) as world,
            opened(PURSUER, mailbox, control, on_control) as bus,
            broadcasting(PURSUER, bus, metadata) as broadcast,
        ):
            result = fly(scenario, world, clock, record, show, mailbox=mailbox, broadcast=broadcast)
            if broadcast is not None:
                broadcast.event(clock.now_s(), FLIGHT_OVER, closing_detail(result, "fast" if fast else "live", folder))
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
