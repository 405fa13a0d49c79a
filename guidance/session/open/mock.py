"""Mocks, in virtual time or as a live process."""

from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial

from guidance.clock import MonotonicClock, VirtualClock
from guidance.links.opening import MAVLINK_LINKS
from guidance.session.fly.daemon import Equipment
from guidance.session.open.opened import (
    FlyableScenario,
    Onlooker,
    Opened,
    check_option,
    pursuits_and_team,
)
from guidance.session.orders import control_bus
from guidance.session.orders.mailbox import Mailbox
from guidance.sim import live, mock_files, stepped


@dataclass(frozen=True, slots=True, kw_only=True)
class MockOptions:
    """Options of the mock.

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
    over: str = "zenoh"

    def __post_init__(self) -> None:
        check_option("--link", self.link, MAVLINK_LINKS)
        check_option("--over", self.over, live.OVER)

    @property
    def way(self) -> str:
        """The kind of run in an outcome row."""
        return "fast" if self.fast else "live"

    def open(self, scenario: FlyableScenario, onlooker: Onlooker, stack: ExitStack) -> Opened:
        """Open the mocks, and take orders."""
        (pursuits, team) = pursuits_and_team(scenario)
        clock = VirtualClock() if self.fast else MonotonicClock()
        mock_files.faulted_fleet(pursuits)  # refuses faults that a vehicle cannot have
        mailboxes = {pursuit.vehicle: Mailbox() for pursuit in pursuits}
        equipment = {name: Equipment(mailbox=mailbox) for name, mailbox in mailboxes.items()}
        buses = stack.enter_context(
            control_bus.opened(mailboxes, onlooker.control, onlooker.on_control, team)
        )
        in_real_time = partial(live.LiveWorld, link=self.link, port=self.port, over=self.over)
        world = (stepped.SteppedWorld if self.fast else in_real_time)(pursuits, clock)
        return Opened(pursuits, stack.enter_context(closing(world)), clock, buses, equipment, {})

    def left_out(self, _scenario: FlyableScenario) -> Sequence[str]:
        """Nothing: a mock has faults and wind."""
        return ()
