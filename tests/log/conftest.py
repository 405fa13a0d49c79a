import json
from pathlib import Path

import pytest

from guidance.clock import VirtualClock
from guidance.config import load
from guidance.log.writer import Recorder
from guidance.session.fly import fly
from guidance.sim.scenario import Scenario
from guidance.sim.stepped import SteppedWorld

SHORT = load(Scenario, Path(__file__).parents[1] / "data" / "short_chase.toml")


@pytest.fixture(scope="session")
def flight(tmp_path_factory):
    """One mocked flight in virtual time: its result and its record."""
    path = tmp_path_factory.mktemp("records") / "record.mcap"
    clock = VirtualClock()
    world = SteppedWorld(SHORT, clock)
    metadata = {"scenario": json.dumps(SHORT.model_dump(mode="json")), "seed": "0", "guidance": "0.1.0"}
    recorder = Recorder(path, metadata)
    try:
        return fly(SHORT, world, clock, recorder, lambda _: None), path
    finally:
        world.close()
        recorder.close()
