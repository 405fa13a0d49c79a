"""Whole flights of scenarios in virtual time: the real core and the real mock, whole MAVLink frames between them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from guidance.clock import VirtualClock
from guidance.config import load, parse_document
from guidance.log.writer import Recorder
from guidance.session.fly.daemon import Equipment
from guidance.session.fly.mission import Mission, Progress
from guidance.session.fly.result import FlightResult
from guidance.sim import mock_files
from guidance.sim.mock_files import fleet
from guidance.sim.scenario import PURSUER, Flown, Scenario
from guidance.sim.scenario_file import load_any
from guidance.sim.stepped import SteppedWorld
from guidance.sim.teams import TeamScenario
from tests.harness.vehicle import SOON_UP_AND_DOWN


@contextmanager
def soon_up_and_down() -> Iterator[None]:
    """Let the PX4s of mocked flights be ready, take off and land soon, for tests of what lies between."""

    def quick(scenario: Flown) -> dict[str, Any]:
        made = fleet(scenario)
        for vehicle in made["vehicle"]:
            if vehicle["flavour"] == "px4":
                vehicle["parameters"] |= SOON_UP_AND_DOWN
                vehicle["ready_after_s"] = 0.5
        return made

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mock_files, "fleet", quick)
        yield


LOW_M = 4.0
LID_M = 3.0


def low_team(name: str, **changes: Any) -> TeamScenario:
    """Return a scenario of teams that comes with the service, flown low, which shortens take-off and landing."""
    document = load_any(name)[1].model_dump(mode="json") | changes
    for pursuer in document["pursuer"]:
        pursuer["position_m"][2] = LOW_M
    document["flight"]["takeoff_height_m"] = LOW_M
    document["flight"]["standoff"]["height_m"] = LID_M
    return parse_document(TeamScenario, document, source=name)


NEAR = load(Scenario, Path(__file__).parents[1] / "data" / "near_chase.toml")
"""Low, a few metres, a few seconds: a whole flight in the least time."""


class Played(Mission):
    """A mission that ends with its game: the way home is left to tests of whole flights."""

    @property
    def finished(self) -> bool:
        """True when every vehicle has played."""
        return super().finished or all(
            vehicle.engaged_s is not None and not vehicle.playing for vehicle in self.vehicles
        )


def flown(
    scenario: Scenario,
    path: Path | None = None,
    watch: Callable[[Progress], None] = lambda _: None,
    mission: type[Mission] = Mission,
) -> FlightResult:
    """Fly a scenario to its end.

    Args:
        scenario: The scenario to fly.
        path: Of its record; None keeps none.
        watch: Is told of every cycle.
        mission: `Played` ends the flight with its game.
    """
    clock = VirtualClock()
    world = SteppedWorld(scenario, clock)
    metadata = {
        "scenario": scenario.model_dump_json(),
        "seed": str(scenario.seed),
        "guidance": "0.1.0",
    }
    recorder = None if path is None else Recorder(path, metadata)
    try:
        used = {PURSUER: Equipment(record=recorder)}
        flight = mission(scenario, world, clock, equipment=used, show=watch)
        return flight.fly().vehicles[PURSUER]
    finally:
        world.close()
        if recorder is not None:
            recorder.close()
