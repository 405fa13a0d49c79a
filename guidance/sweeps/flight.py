"""One row of a sweep as a mocked flight in virtual time, without a record."""

from guidance.clock import VirtualClock
from guidance.session.fly import fly
from guidance.session.result import outcome_of_flight
from guidance.sim.outcome import Outcome
from guidance.sim.scenario import Scenario
from guidance.sim.stepped import SteppedWorld


def flown(scenario: Scenario) -> Outcome:
    """Fly a scenario in this process, as fast as it goes.

    Raises:
        GuidanceError: If it cannot be flown.
    """
    clock = VirtualClock()
    world = SteppedWorld(scenario, clock)
    try:
        result = fly(scenario, world, clock)
    finally:
        world.close()
    return outcome_of_flight(result, "fast")
