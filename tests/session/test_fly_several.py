"""Several vehicles and evaders in one flight: one daemon for each vehicle, all stepped in one world."""

from itertools import pairwise

import pytest

from guidance.clock import VirtualClock
from guidance.flight import State
from guidance.log.reader import cycles_of, scan
from guidance.log.replay import compare
from guidance.log.writer import Recorder
from guidance.session.fly.daemon import Equipment
from guidance.session.fly.mission import Mission
from guidance.session.fly.result import outcome_of_flight
from guidance.session.plan import plan_of
from guidance.sim.scenario import Pursuit
from guidance.sim.stepped import SteppedWorld
from tests.harness.flights import NEAR, flown

pytestmark = pytest.mark.usefixtures("soon_up_and_down")
EAST_M = 60.0


def moved(scenario, east_m):
    """The same game elsewhere."""
    (px, py, pz) = scenario.pursuer.position_m
    (ex, ey) = scenario.evader.position_m
    pursuer = scenario.pursuer.model_copy(update={"position_m": (px + east_m, py, pz)})
    evader = scenario.evader.model_copy(update={"position_m": (ex + east_m, ey)})
    return scenario.model_copy(update={"pursuer": pursuer, "evader": evader})


@pytest.fixture(scope="module")
def several(tmp_path_factory, soon_up_and_down):
    """Two vehicles, each with its own evader, and the record of each."""
    folder = tmp_path_factory.mktemp("several")
    clock = VirtualClock()
    pursuits = (Pursuit(NEAR, "north", "rover1"), Pursuit(moved(NEAR, EAST_M), "south", "rover2"))
    world = SteppedWorld(pursuits, clock)
    records = {
        pursuit.vehicle: Recorder(folder / f"{pursuit.vehicle}.mcap", {"seed": "1"})
        for pursuit in pursuits
    }
    shown = []
    used = {name: Equipment(record=record) for name, record in records.items()}
    result = Mission(pursuits, world, clock, equipment=used, show=shown.append).fly()
    world.close()
    for record in records.values():
        record.close()
    return pursuits, result, folder, shown


@pytest.mark.flight
def test_two_vehicles_capture_an_evader_each_in_one_world(several):
    pursuits, result, _, _ = several
    assert list(result.vehicles) == ["north", "south"]
    assert list(result.evaders) == ["rover1", "rover2"]
    for pursuit in pursuits:
        one = result.vehicles[pursuit.vehicle]
        evader = result.evaders[pursuit.evader]
        assert (one.ended, outcome_of_flight(one, "fast").end) == (State.LANDED, "captured")
        assert evader.capture.vehicle == pursuit.vehicle
        assert one.samples[0].pursuer_m == pytest.approx((*pursuit.scenario.home_m, 0.0), abs=0.5)
        assert evader.track[0][1][:2] == pytest.approx(pursuit.scenario.evader.position_m, abs=0.5)
        assert all(later > sooner for (sooner, _), (later, _) in pairwise(evader.track))


@pytest.mark.flight
def test_a_vehicle_among_several_plays_as_it_plays_alone(several):
    _, result, _, _ = several
    alone = flown(NEAR)
    together = result.vehicles["north"]
    assert together.engaged.value == pytest.approx(alone.engaged.value, abs=0.1)
    played_s = [outcome_of_flight(one, "fast").game_time_s for one in (together, alone)]
    assert played_s[0] == pytest.approx(played_s[1], abs=0.3)


@pytest.mark.flight
def test_every_vehicle_has_its_own_record_that_names_it_and_the_last_one_replays_bit_for_bit(
    several,
):
    pursuits, result, folder, _ = several
    for pursuit in pursuits:
        path = folder / f"{pursuit.vehicle}.mcap"
        assert {cycle.vehicle for cycle in cycles_of(path)} == {pursuit.vehicle}
        raw = {
            item.topic.partition("/")[0]
            for item in scan(path)
            if item.topic.endswith(("/in", "/out"))
        }
        assert raw == {pursuit.vehicle, "rover1", "rover2"}
    settings = plan_of(scenario=pursuit.scenario).flight
    comparison, _ = compare(path, lambda _: settings)
    assert (comparison.differing, comparison.setpoints) == (
        0,
        result.vehicles[pursuit.vehicle].setpoints_sent,
    )


@pytest.mark.flight
def test_progress_names_the_vehicle(several):
    _, _, _, shown = several
    assert {progress.vehicle for progress in shown} == {"north", "south"}
