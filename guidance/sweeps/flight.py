"""One row of a sweep as a mocked flight in virtual time, without a record."""

from guidance.scenarios.fast import FastWorld
from guidance.scenarios.flown import outcome_of_flight
from guidance.scenarios.fly import fly
from guidance.scenarios.model import Scenario
from guidance.scenarios.outcome import Outcome
from guidance.service.clock import VirtualClock


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
