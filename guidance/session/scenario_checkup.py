"""The checks of `guidance check` for a scenario and a vehicle at a URL."""

from collections.abc import Iterator
from contextlib import closing, contextmanager

from guidance.clock import MonotonicClock
from guidance.links.world import World
from guidance.session.checkup import Checkup
from guidance.session.open.url import Asked
from guidance.session.plan import plan_of
from guidance.sim.scenario import PURSUER, Scenario


@contextmanager
def checkup_at(scenario: Scenario, asked: Asked) -> Iterator[Checkup]:
    """Open the vehicle at a URL, to be judged by what a scenario asks of it.

    Raises:
        GuidanceError: For everything that the user can fix.
    """
    clock = MonotonicClock()
    with closing(World()) as world:
        configs, _ = asked.reach(scenario, clock, world)
        config = configs[PURSUER]
        pursuer = scenario.pursuer.model_copy(update={"autopilot": config.vehicle.autopilot})
        yield Checkup(
            config.name,
            plan_of(config, scenario.model_copy(update={"pursuer": pursuer})),
            world,
            clock,
            evader_simulated=True,
        )
