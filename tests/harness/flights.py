"""Whole flights of scenarios in virtual time: the real core and the real mock, whole MAVLink frames between them."""

from collections.abc import Callable
from pathlib import Path

from guidance.clock import VirtualClock
from guidance.config import load
from guidance.log.writer import Recorder
from guidance.session.fly.daemon import Equipment
from guidance.session.fly.mission import Mission, Progress
from guidance.session.fly.result import FlightResult
from guidance.sim.scenario import PURSUER, Scenario
from guidance.sim.stepped import SteppedWorld

NEAR = load(Scenario, Path(__file__).parents[1] / "data" / "near_chase.toml")
"""Low, a few metres, a few seconds: a whole flight in the least time."""


def flown(
    scenario: Scenario, path: Path | None = None, watch: Callable[[Progress], None] = lambda _: None
) -> FlightResult:
    """Fly a scenario to its end.

    Args:
        scenario: The scenario to fly.
        path: Of its record; None keeps none.
        watch: Is told of every cycle.
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
        return Mission(scenario, world, clock, equipment=used, show=watch).fly().vehicles[PURSUER]
    finally:
        world.close()
        if recorder is not None:
            recorder.close()
