"""Scenarios with faults or wind: flown in virtual time, or refused before the start."""

import math
import tomllib

import pytest
import tomlkit

from guidance.config import parse_document
from guidance.errors import ConfigError
from guidance.flight import State
from guidance.flight.settings import LIMITS_S
from guidance.session.fly.result import outcome_of_flight
from guidance.session.open.mock import MockOptions
from guidance.session.recorded_flight import fly_recorded
from guidance.sim.mock_files import faulted_fleet, fleet, script
from guidance.sim.scenario import Scenario
from tests.harness import flights

pytestmark = [pytest.mark.flight, pytest.mark.usefixtures("soon_up_and_down")]

CHASE = {
    "title": "a chase",
    "game": "pe",
    "pursuer": {"position_m": (8.0, 3.0, 4.5), "speed_m_s": 3.0, "takeoff_height_m": 3.0},
    "evader": {"position_m": (8.0, 18.0), "speed_m_s": 1.5},
    "standoff": {"height_m": 3.0},
    "limits": {"floor_m": 1.5},
    "hold_s": 0.5,
}


def scenario(**sections):
    return parse_document(Scenario, {**CHASE, **sections}, source="test")


def flown(**sections):
    result = flights.flown(scenario(**sections))
    return result, outcome_of_flight(result, "fast")


@pytest.mark.parametrize("autopilot", ["px4", "arducopter"])
def test_a_pilots_takeover_ends_the_run_two_seconds_later_as_yielded(autopilot):
    mode = {"px4": "POSCTL", "arducopter": "LOITER"}[autopilot]
    result, outcome = flown(
        pursuer={**CHASE["pursuer"], "autopilot": autopilot},
        fault=[{"kind": "pilot_mode", "mode": mode, "at_s": 3.0}],
    )
    assert (outcome.end, outcome.winner) == ("yielded", "none")
    # HEARTBEAT, which shows the mode, comes once a second.
    assert 3.0 <= outcome.game_time_s <= 4.2
    engaged_s = next(
        transition.now_s for transition in result.transitions if transition.after == "engaged"
    )
    assert result.samples[-1].now_s - engaged_s == pytest.approx(outcome.game_time_s + 2.0, abs=0.1)


def test_a_radio_that_falls_silent_fails_the_flight_and_says_why():
    _, outcome = flown(fault=[{"kind": "silence", "at_s": 2.0}])
    assert (outcome.end, outcome.reason) == ("failed", "vehicle telemetry lost")
    assert outcome.game_time_s > 2.0


def test_an_evader_that_is_lost_for_good_fails_the_flight_for_that_reason():
    _, outcome = flown(fault=[{"kind": "silence", "vehicle": "evader", "at_s": 1.0}])
    assert (outcome.end, outcome.reason) == ("failed", "evader lost")


def test_a_vehicle_that_will_not_arm_never_engages_and_says_so(monkeypatch):
    monkeypatch.setitem(LIMITS_S, State.CHECKING, 15.0)  # of 90, to wait less
    _, outcome = flown(fault=[{"kind": "arm_refused", "after": "start"}])
    assert outcome.end == "failed"
    assert outcome.reason.startswith("never engaged: ")
    assert math.isnan(outcome.predicted)


def test_faults_of_the_evader_count_from_engagement_though_it_is_guided_long_before():
    result, outcome = flown(
        fault=[
            {
                "kind": "evader_stale",
                "vehicle": "evader",
                "at_s": 2.0,
                "for_s": 3.0,
                "as": "silence",
            }
        ]
    )
    assert outcome.end == "captured"
    lost = next(
        transition for transition in result.transitions if transition.event == "evader lost"
    )
    engaged_s = next(
        transition.now_s for transition in result.transitions if transition.after == "engaged"
    )
    assert lost.now_s - engaged_s == pytest.approx(2.0 + 1.5, abs=0.3)


def test_wind_blows_on_the_pursuer_for_the_whole_flight_and_is_captured_against():
    wind = {"velocity_m_s": (1.4, 0.0)}
    asked = script(scenario(wind=wind))["fault"]
    assert [(each["kind"], each["vehicle"], each["east"], each["north"]) for each in asked] == [
        ("wind_gust", "pursuer", 1.4, 0.0)
    ]
    _, outcome = flown(wind=wind)
    assert outcome.end == "captured"
    # The autopilot holds the speed over ground, so the promise is the same as in still air.
    _, still = flown()
    assert outcome.predicted == pytest.approx(still.predicted, abs=0.1)


def test_the_files_for_a_child_process_say_what_is_flown_in_this_one():
    windy = scenario(
        wind={"velocity_m_s": (1.0, -0.5)},
        fault=[{"kind": "loss", "after": "start", "messages": ["HEARTBEAT"]}],
    )
    for document in (fleet(windy), script(windy)):
        assert tomllib.loads(tomlkit.dumps(document)) == document


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ({"kind": "gremlins"}, "fault[1].kind = 'gremlins': allowed are loss"),
        (
            {"kind": "ekf_jump", "nort": 4.0},
            "fault[1].nort = 4.0: ekf_jump has no such key; allowed are north",
        ),
        ({"kind": "ekf_jump", "north": "far"}, "fault[1].north = 'far': allowed is a number"),
        ({"kind": "pilot_mode", "mode": "SLEEP"}, "fault[1].mode = 'SLEEP': allowed are"),
        ({"kind": "pilot_mode"}, "fault[1].mode is missing"),
    ],
)
@pytest.mark.parametrize("after", ["engaged", "start"])
def test_a_wrong_fault_is_refused_by_its_place_key_and_value_before_anything_starts(
    fault, words, after
):
    wrong = scenario(fault=[{"kind": "silence", "at_s": 1.0}, {**fault, "after": after}])
    with pytest.raises(ConfigError) as caught:
        faulted_fleet(wrong)
    assert words in str(caught.value)


def test_a_flight_with_a_wrong_fault_leaves_nothing_behind(tmp_path):
    with pytest.raises(ConfigError, match="gremlins"):
        fly_recorded(
            scenario(fault=[{"kind": "gremlins"}]), tmp_path / "out", MockOptions(fast=True)
        )
    assert list(tmp_path.iterdir()) == []
