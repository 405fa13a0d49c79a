"""A flight that defends a place with a shape: its end, its record as the page shows it, and its pictures."""

import itertools

import numpy as np
import pytest

from guidance.session.fly.result import outcome_of_flight
from guidance.sim.maths import play_scenarios
from guidance.sim.scenario import Scenario
from guidance.viz.figures import draw_scenario
from guidance.viz.panel.snapshot import frames_of
from guidance.viz.report import draw_flight
from tests.harness.flights import flown

HALL = ((-6.0, -4.0), (6.0, -4.0), (6.0, 4.0), (-6.0, 4.0))
SCENARIO = Scenario.model_validate(
    {
        "title": "A hall with a margin of one metre",
        "game": "tad",
        "seed": 1,
        "pursuer": {"position_m": (14.0, 12.0, 8.0), "speed_m_s": 5.0, "takeoff_height_m": 5.0},
        "evader": {"position_m": (34.0, 4.0), "speed_m_s": 2.0},
        "target": {"position_m": (0.0, 0.0), "polygon_m": HALL, "radius_m": 1.0},
        "standoff": {"radius_m": 2.0, "height_m": 5.0},
    }
)


@pytest.fixture(scope="module")
def flight(tmp_path_factory, soon_up_and_down):
    """The flight and its record."""
    record = tmp_path_factory.mktemp("shaped") / "record.mcap"
    return flown(SCENARIO, record), record


@pytest.mark.flight
def test_the_evader_is_captured_before_it_reaches_the_hall(flight):
    outcome = outcome_of_flight(flight[0], "fast")
    (predicted,) = play_scenarios([SCENARIO])
    assert (outcome.end, predicted.end) == ("captured", "captured")
    assert outcome.predicted_evader_to_target_m == pytest.approx(
        predicted.predicted_evader_to_target_m, abs=1.0
    )
    assert outcome.evader_to_target_m == pytest.approx(predicted.evader_to_target_m, rel=0.15)


@pytest.mark.flight
def test_the_page_shows_the_hall_with_its_margin(flight):
    page = frames_of(flight[1])
    edge = np.array(page["scenes"][-1]["scene"]["target_edge_m"])
    assert page["frames"]
    assert edge.min(axis=0) == pytest.approx([-7.0, -5.0])
    assert edge.max(axis=0) == pytest.approx([7.0, 5.0])
    assert all(abs(a).max() > 4.0 for a in edge)
    assert edge[0].tolist() == edge[-1].tolist()
    assert any(np.hypot(*(b - a)) > 7.0 for a, b in itertools.pairwise(edge))


@pytest.mark.flight
def test_the_pictures_of_the_scenario_and_of_the_flight_are_drawn(flight, tmp_path):
    draw_scenario(SCENARIO, tmp_path / "scenario.png")
    draw_flight(flight[1], tmp_path / "flight.png", SCENARIO.title)
    assert all((tmp_path / name).stat().st_size > 20_000 for name in ("scenario.png", "flight.png"))
