import json

import pytest

from guidance.clock import VirtualClock
from guidance.config import load
from guidance.log.writer import Recorder
from guidance.session.fly import fly
from guidance.session.recorded import recorded_settings
from guidance.sim.files import load_scenario
from guidance.sim.scenario import Scenario
from guidance.sim.stepped import SteppedWorld
from guidance.viz.report import write_report


def flown(scenario, path):
    clock = VirtualClock()
    world = SteppedWorld(scenario, clock)
    recorder = Recorder(path, {"scenario": json.dumps(scenario.model_dump(mode="json")), "seed": "0"})
    try:
        return fly(scenario, world, clock, recorder, lambda _: None)
    finally:
        world.close()
        recorder.close()


@pytest.fixture(scope="session")
def pe(request, tmp_path_factory):
    """A short PE flight: its result, its record, the folder of its report."""
    folder = tmp_path_factory.mktemp("pe")
    result = flown(load(Scenario, request.config.rootpath / "tests" / "data" / "short_chase.toml"), folder / "r.mcap")
    write_report(folder / "r.mcap", folder, recorded_settings)
    return result, folder / "r.mcap", folder


@pytest.fixture(scope="session")
def tad(tmp_path_factory):
    """The paper's TAD game, flown and reported."""
    folder = tmp_path_factory.mktemp("tad")
    result = flown(load_scenario("tad")[1], folder / "r.mcap")
    write_report(folder / "r.mcap", folder, recorded_settings)
    return result, folder / "r.mcap", folder


@pytest.fixture(scope="session")
def record(request, tmp_path_factory):
    """The record of a short PE flight."""
    path = tmp_path_factory.mktemp("view") / "record.mcap"
    flown(load(Scenario, request.config.rootpath / "tests" / "data" / "short_chase.toml"), path)
    return path
