"""The open flight that every way of opening returns, and its onlookers."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from guidance.clock import Clock
from guidance.errors import ConfigError
from guidance.links.world import World
from guidance.links.zenoh.session import Session
from guidance.session.flight_files import TEAM_FOLDER
from guidance.session.fly.daemon import Equipment
from guidance.session.fly.loop import Signals
from guidance.session.fly.mission import MOCKED, MissionPolicy, Show
from guidance.session.output_sections import RosSection
from guidance.session.vehicle_file import Config
from guidance.sim.scenario import EVADER, Pursuit, Scenario
from guidance.sim.team_flight import pursuits_of_team
from guidance.sim.teams import TeamScenario


class Onlooker(NamedTuple):
    """Callbacks and endpoints for watching a flight and giving it orders.

    Attributes:
        show: Called ten times a second and at every event.
        on_record: Called with the record's path when it is open.
        control: Endpoint for orders and broadcasts; a free one if that is in use. None opens none.
        on_control: Called with the endpoint.
        ros: Where the flight's ROS 2 topics are published; None for those of a vehicle file only.
    """

    show: Show = lambda _: None
    on_record: Callable[[Path], None] = lambda _: None
    control: str | None = None
    on_control: Callable[[str], None] = lambda _: None
    ros: RosSection | None = None


NOBODY: Final = Onlooker()


FlyableScenario = Scenario | TeamScenario
"""A scenario of one vehicle, or of a team."""


class Opened(NamedTuple):
    """Everything that a flight needs, open; by the vehicle's name. `configs` are of vehicles that are not mocks."""

    pursuits: Sequence[Pursuit]
    world: World
    clock: Clock
    buses: Mapping[str, Session]
    equipment: Mapping[str, Equipment]
    configs: Mapping[str, Config]
    policy: MissionPolicy = MOCKED
    signals: Signals | None = None


def pursuits_and_team(scenario: FlyableScenario) -> tuple[Sequence[Pursuit], str]:
    """Return who pursues whom, and the name of the team; empty without one."""
    if isinstance(scenario, Scenario):
        return (Pursuit(scenario),), ""
    return pursuits_of_team(scenario), TEAM_FOLDER


def declared_m_s(pursuits: Sequence[Pursuit]) -> dict[str, float]:
    """Return the declared speeds of the evaders, by name."""
    return {
        pursuit.evader: pursuit.scenario.evader.believed_speed_m_s for pursuit in reversed(pursuits)
    }


def check_option(option: str, value: str, allowed: Sequence[str]) -> None:
    """Refuse an option's value that is not allowed, with ConfigError."""
    if value not in allowed:
        raise ConfigError(f"{option} {value}: allowed are {', '.join(allowed)}")


def lost_features(scenario: FlyableScenario, *, evader_simulated: bool) -> Sequence[str]:
    """Name the features of a scenario that an outside vehicle flies without; a simulated evader keeps its faults."""
    if isinstance(scenario, TeamScenario):
        return ()
    lost = []
    if any(fault.vehicle != EVADER or not evader_simulated for fault in scenario.fault):
        lost.append("faults")
    if any(scenario.wind.velocity_m_s):
        lost.append("wind")
    return lost


class Way(Protocol):
    """A way to open a flight."""

    @property
    def way(self) -> str:
        """The kind of run in an outcome row."""

    def open(self, scenario: FlyableScenario, onlooker: Onlooker, stack: ExitStack) -> Opened:
        """Open everything; the stack closes it. Raises GuidanceError for everything that the user can fix."""

    def left_out(self, scenario: FlyableScenario) -> Sequence[str]:
        """Name the features of a scenario that this way flies without."""
