"""The attacker's flights with late telemetry: a fence of 40 m, a delay that grows to 3 s, or 1.5 s from the start."""

import pytest

from guidance.config import parse_document
from guidance.flight import State
from guidance.flight.settings import LIMITS_S
from guidance.sim.scenario import Scenario
from tests.faults import flying
from tests.faults.drawing import Case

pytestmark = pytest.mark.flight


def flown(autopilot, **delay):
    """Fly after an evader that flees across the fence."""
    document = {
        "title": "to the fence",
        "game": "pe",
        "pursuer": {
            "position_m": (0, 0, 8.0),
            "speed_m_s": 7.0,
            "takeoff_height_m": 7.0,
            "autopilot": autopilot,
            "speed_set": "cylinder",
        },
        "evader": {"position_m": (0.0, 25.0), "speed_m_s": 4.0},
        "standoff": {"radius_m": 3.0, "height_m": 6.0},
        "limits": {"floor_m": 3.0, "fence_radius_m": 40.0},
        "time_limit_s": 20.0,
        "fault": [{"kind": "delay", "vehicle": "pursuer", "direction": "out", **delay}],
    }
    return flying.fly(Case(0, 0, parse_document(Scenario, document, source="test")))


@pytest.mark.parametrize("autopilot", ["px4", "arducopter"])
def test_a_growing_delay_is_named_and_no_fence_is_crossed(autopilot):
    row = flown(autopilot, delay_s=3.0, grows_s=10.0, at_s=0.0, after="engaged")
    assert row.violations == ()
    assert row.end == "holding (vehicle telemetry late)"
    assert row.breaches_m.get("fence", 0.0) == 0.0


def test_with_a_constant_delay_nothing_takes_off(monkeypatch):
    monkeypatch.setitem(LIMITS_S, State.CHECKING, 15.0)  # of 90, to wait less
    row = flown("arducopter", delay_s=1.5, at_s=0.0, after="start")
    assert row.violations == ()
    assert row.breaches_m == {}
    assert row.end == "failed (phase took too long)"
