"""One row of a sweep as a mocked flight in virtual time, without a record."""

from guidance.clock import VirtualClock
from guidance.session.flown import outcome_of_flight
from guidance.session.fly import fly
from guidance.sim.fast import FastWorld
from guidance.sim.outcome import Outcome
from guidance.sim.scenario import Scenario


def flown(scenario: Scenario) -> Outcome:
    """Fly a scenario in this process, as fast as it goes.

    Raises:
        GuidanceError: If it cannot be flown.
    """
    clock = VirtualClock()
    world = FastWorld(scenario, clock)
    try:
        result = fly(scenario, world, clock, None, lambda _: None)
    finally:
        world.close()
    return outcome_of_flight(result, "fast")
