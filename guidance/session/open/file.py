"""The vehicle of a configuration file."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import ClassVar

from guidance.clock import MonotonicClock
from guidance.errors import ConfigError
from guidance.session.fly.loop import Signals
from guidance.session.fly.mission import MissionPolicy
from guidance.session.open.links import open_vehicle
from guidance.session.open.opened import FlyableScenario, Onlooker, Opened, lost_features
from guidance.session.orders.mailbox import ORDER_OF
from guidance.session.plan import plan_of
from guidance.session.vehicle_file import Config
from guidance.sim.scenario import Pursuit
from guidance.sim.teams import TeamScenario


@dataclass(frozen=True, slots=True)
class ByFile:
    """The vehicle of a configuration file; the evader is whatever its evader source reports.

    Preflight must pass. Ctrl-C hands the vehicle over as the file says (flight.on_terminate).

    Attributes:
        config: The file's content.
        engage: A person allowed to start and to engage; else one has to order `guidance ctl start` and
            `guidance ctl engage`.
    """

    config: Config
    engage: bool
    way: ClassVar[str] = "vehicle"

    def open(self, scenario: FlyableScenario, _: Onlooker, stack: ExitStack) -> Opened:
        """Open all that the file names, and wait for the vehicle.

        Raises:
            ConfigError: If file and scenario contradict each other, or a team plays.
            LinkError: If vehicle or evader cannot be reached.
        """
        config = self.config
        clock = MonotonicClock()
        if isinstance(scenario, TeamScenario):
            raise ConfigError(
                "--config: one vehicle; a team needs --vehicle URL for each of its vehicles"
            )
        plan_of(config, scenario)  # refused before anything is opened
        name = config.name
        hand_over = ORDER_OF[config.flight.on_terminate]
        signals = stack.enter_context(Signals(hand_over).installed())
        world, bus, equipment = open_vehicle(config, clock, stack, tapped=True)
        policy = MissionPolicy(self.engage, hand_over=hand_over)
        return Opened(
            (Pursuit(scenario, name),),
            world,
            clock,
            {name: bus},
            {name: equipment},
            {name: config},
            policy,
            signals,
        )

    def left_out(self, scenario: FlyableScenario) -> Sequence[str]:
        """Name the features of a scenario that this vehicle flies without."""
        return lost_features(scenario, evader_simulated=False)
