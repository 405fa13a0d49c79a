import json
from pathlib import Path

import pytest

from guidance.clock import VirtualClock
from guidance.config import load
from guidance.service.record import Recorder
from guidance.session.fly import fly
from guidance.sim.fast import FastWorld
from guidance.sim.scenario import Scenario

SHORT = load(Scenario, Path(__file__).parents[1] / "data" / "short_chase.toml")


@pytest.fixture(scope="session")
def record(tmp_path_factory):
    """The record of one mocked flight in virtual time."""
    path = tmp_path_factory.mktemp("view") / "record.mcap"
    clock = VirtualClock()
    world = FastWorld(SHORT, clock)
    recorder = Recorder(path, {"scenario": json.dumps(SHORT.model_dump(mode="json"))})
    try:
        fly(SHORT, world, clock, recorder, lambda _: None)
    finally:
        world.close()
        recorder.close()
    return path
