"""The watch sees what it is there for: the same flight with its fence, and with a service that knows of none."""

from dataclasses import replace

import pytest

from guidance.config import parse_document
from guidance.flight.observed import Echo
from guidance.sim.scenario import Scenario
from tests.faults import flying
from tests.faults.drawing import KINDS, Case, draw_case

pytestmark = pytest.mark.flight

TO_THE_FENCE = {
    "title": "an evader that flees to the fence",
    "game": "pe",
    "pursuer": {
        "position_m": (0, 0, 4.0),
        "speed_m_s": 5.0,
        "takeoff_height_m": 3.5,
        "autopilot": "arducopter",
    },
    "evader": {"position_m": (0.0, 10.0), "speed_m_s": 3.0},
    "standoff": {"radius_m": 2.0, "height_m": 3.5},
    "limits": {"floor_m": 2.0, "fence_radius_m": 16.0},
    "time_limit_s": 6.0,
}


def case(**sections):
    return Case(0, 0, parse_document(Scenario, {**TO_THE_FENCE, **sections}, source="test"))


@pytest.fixture(scope="module")
def starts():
    """The beginning of the flight, which is flown once."""
    return flying.Starts()


def test_a_fence_holds_and_the_flight_is_as_wanted(starts):
    row = flying.fly(case(), starts=starts)
    assert row.violations == ()
    assert row.end == "holding (hold)"


def test_a_service_that_knows_of_no_fence_is_found_out(monkeypatch):
    planned = flying.plan

    def unfenced(case):
        plan = planned(case)
        cycle = plan.flight.cycle
        envelope = replace(cycle.envelope, fence_radius_m=1e4)
        return replace(
            plan, flight=plan.flight.model_copy(update={"cycle": replace(cycle, envelope=envelope)})
        )

    monkeypatch.setattr(flying, "plan", unfenced)
    (violation,) = flying.fly(case()).violations
    assert violation.invariant == "fence"
    assert violation.amount > 1.0


def test_another_program_is_told_from_ours_and_a_service_that_is_deaf_to_it_is_found_out(
    starts, monkeypatch
):
    stranger = {
        "kind": "second_source",
        "after": "engaged",
        "at_s": 0.5,
        "north": -3.0,
        "east": -3.0,
        "down": 0.0,
        "rate_hz": 5.0,
    }
    joined = case(fault=[stranger])
    assert flying.fly(joined, starts=starts).violations == ()
    monkeypatch.setattr(Echo, "hear", lambda *_, **__: None)
    (violation,) = flying.fly(joined, starts=starts).violations
    assert violation.invariant == "another program is noticed"


def test_a_flight_that_goes_on_from_a_copy_is_the_one_from_the_ground(tmp_path):
    drawn = draw_case(1, 15)
    kept = flying.Starts()
    kept.keep(drawn, flying.Sortie(drawn).stand_by())
    copied = flying.fly(drawn, starts=kept)
    whole = flying.fly(drawn, tmp_path)
    assert copied._replace(processor_s=0.0) == whole._replace(processor_s=0.0)
    assert copied.end == "yielded (vehicle telemetry lost)"


def test_the_same_number_is_the_same_flight_and_no_fault_is_left_out():
    assert draw_case(3, 17) == draw_case(3, 17) != draw_case(4, 17)
    assert {kind for number in range(2 * len(KINDS)) for kind in draw_case(1, number).kinds} == set(
        KINDS
    )
