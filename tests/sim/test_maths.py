import copy
import itertools

import numpy as np
import pytest

from guidance.config import parse_document
from guidance.errors import ConfigError
from guidance.game import Exact, rollout
from guidance.sim.batch import game, stack
from guidance.sim.maths import moments, play_scenarios
from guidance.sim.scenario import Scenario, Wind
from guidance.sim.scenario_file import load_scenario

CHASE = {
    "title": "chase",
    "game": "pe",
    "pursuer": {"position_m": [0.0, 0.0, 15.0], "speed_m_s": 6.0, "speed_set": "cylinder"},
    "evader": {"position_m": [0.0, 25.0], "speed_m_s": 3.0},
}
DEFENCE = {**CHASE, "game": "tad", "target": {"position_m": [20.0, 20.0]}}


def scenario(base=CHASE, **sections):
    document = copy.deepcopy(base)
    for name, values in sections.items():
        document[name] = (
            {**document.get(name, {}), **values} if isinstance(values, dict) else values
        )
    return parse_document(Scenario, document, source="a.toml")


def one(base=CHASE, **sections):
    return play_scenarios([scenario(base, **sections)])[0]


def test_optimal_players_reach_the_value():
    places = itertools.product([(0.0, 25.0), (-18.0, 4.0)], ["ball", "cylinder"])
    for place, speeds in places:
        outcome = one(evader={"position_m": place}, pursuer={"speed_set": speeds})
        assert outcome.end == "captured"
        assert outcome.winner == outcome.predicted_winner == "pursuer"
        assert abs(outcome.regret) < 1e-6
        assert outcome.ratio == pytest.approx(1.0)


def test_right_above_the_evader_any_heading_costs_less_than_a_cycle():
    outcome = one(evader={"position_m": [0.0, 0.0]}, pursuer={"speed_set": "ball"})
    assert 0.0 < outcome.regret < 0.02


def test_both_sides_of_the_barrier_end_as_predicted():
    sides = set()
    for x in (0.0, 5.0, 10.0, 20.0):
        outcome = one(
            DEFENCE, target={"position_m": [x, 5.0]}, evader={"position_m": [25.0, 25.0 - x]}
        )
        assert outcome.winner == outcome.predicted_winner
        sides.add(outcome.winner)
        if outcome.winner == "pursuer":
            assert -1e-6 < outcome.regret < 3.0 * 0.02
            assert outcome.achieved == outcome.evader_to_target_m
        else:
            assert outcome.end == "arrived"
            assert np.isnan(outcome.regret)
            assert outcome.evader_to_target_m < 1e-6
    assert sides == {"pursuer", "evader"}


@pytest.mark.parametrize("policy", ["pure_pursuit", "lead_pursuit", "proportional_navigation"])
def test_no_other_policy_of_the_pursuer_beats_the_value_against_the_optimal_evader(policy):
    outcome = one(
        pursuer={"policy": policy, "position_m": [20.0, 0.0, 15.0]},
        evader={"position_m": [-5.0, 25.0]},
    )
    assert outcome.end == "captured"
    assert outcome.regret > -1e-6


@pytest.mark.parametrize("policy", ["hold", "pure_evade", "random_turns", "waypoints", "recorded"])
def test_no_other_policy_of_the_evader_costs_the_optimal_pursuer_more_than_the_value(policy):
    keys = {
        "waypoints": {"waypoints_m": [[10.0, 30.0], [-20.0, 60.0]]},
        "recorded": {"track": [[0.0, 0.0, 0.0, 0.0], [4.0, 9.0, 2.0, 0.0], [30.0, 9.0, 60.0, 0.0]]},
    }.get(policy, {})
    outcome = one(evader={"policy": policy, **keys}, seed=4)
    assert outcome.end == "captured"
    assert outcome.regret < 1e-6


def test_a_pure_pursuit_is_that_of_a_rollout():
    """Both integrate its curve by Runge-Kutta, with different steps."""
    chase = scenario(
        pursuer={"policy": "pure_pursuit", "position_m": [9.0, 0.0, 15.0]},
        evader={"policy": "pure_evade"},
    )
    batch = stack([chase])
    exact = rollout(
        batch.game,
        batch.pursuer_m,
        batch.evader_m,
        pursuer_policy="pure_pursuit",
        evader_policy="pure_evade",
        stepping=Exact(0.02),
    )
    assert play_scenarios([chase])[0].game_time_s == pytest.approx(
        float(exact.time_s[0]), abs=0.002
    )


def mixed(count=24):
    """Scenarios of many kinds and numbers."""
    rng = np.random.default_rng(5)
    rows = []
    for i in range(count):
        evader = {
            "position_m": rng.uniform(-30, 30, 2).tolist(),
            "speed_m_s": float(rng.uniform(1.0, 3.5)),
        }
        evader["policy"] = ["optimal", "random_turns", "hold"][i % 3]
        pursuer = {
            "policy": ["optimal", "pure_pursuit", "proportional_navigation", "lead_pursuit"][i % 4]
        }
        pursuer["position_m"] = [0.0, 0.0, 8.0]
        sensor = (
            {"rate_hz": 2.0, "latency_s": 0.3, "position_noise_m": 0.5, "dropout": 0.3}
            if i % 5 == 0
            else {}
        )
        rows.append(
            scenario(evader=evader, pursuer=pursuer, sensor=sensor, seed=i, time_limit_s=4.0)
        )
    return rows


def test_a_game_is_the_same_in_a_batch_in_any_order_and_alone():
    """Catches a game of a sweep that depends on the rows beside it."""
    rows = mixed()
    together = play_scenarios(rows)
    backwards = play_scenarios(rows[::-1])[::-1]
    for number, (row, outcome, again) in enumerate(zip(rows, together, backwards, strict=True)):
        assert repr(outcome) == repr(again)
        if number % 7 == 0:  # every policy, with a sensor and without
            assert repr(play_scenarios([row])[0]) == repr(outcome)
    assert {outcome.end for outcome in together} == {"captured", "time_up"}


def test_an_evader_that_is_faster_than_declared_is_noticed():
    honest = one()
    slower = one(evader={"speed_m_s": 2.0, "declared_speed_m_s": 3.0})
    assert slower.game_time_s < honest.game_time_s
    assert slower.regret < 0.0
    faster = one(evader={"speed_m_s": 4.0, "declared_speed_m_s": 3.0})
    assert faster.end == "captured"
    assert faster.regret > 1.0


def test_the_wind_carries_the_pursuer():
    with_it = one(wind={"velocity_m_s": [0.0, 2.0]})
    against = one(wind={"velocity_m_s": [0.0, -2.0]})
    assert with_it.game_time_s < one().game_time_s < against.game_time_s
    assert abs(with_it.regret) < 1e-6
    assert abs(against.regret) < 1e-6


def test_the_fence_holds_the_pursuer_back():
    """Catches a fence that mathematics plays through."""
    outcome = one(limits={"fence_radius_m": 40.0}, time_limit_s=25.0)
    assert outcome.end == "time_up"
    assert outcome.limits == ("fence",)
    assert np.isnan(outcome.capture_time_s)
    last = list(moments(stack([scenario(limits={"fence_radius_m": 40.0}, time_limit_s=25.0)])))[-1]
    assert np.hypot(*(last.pursuer_m[0, :2] - [0.0, -2.0])) == pytest.approx(40.0)


def test_the_pursuer_stays_outside_the_disc_and_above_the_floor():
    for moment in moments(stack([scenario(evader={"position_m": [4.0, 0.0]})])):
        assert moment.pursuer_m[0, 2] >= 5.0 - 1e-9
    assert one().min_standoff_m >= 3.0


@pytest.mark.parametrize("seed", range(1))
def test_rare_late_and_noisy_reports_cost_time(seed):
    """Catches a fault of the sensor that has no effect on the game."""
    turning = {"policy": "random_turns", "turn_every_s": 2.0, "position_m": [0.0, 40.0]}
    low = {"position_m": [0.0, 0.0, 7.0]}
    clear, rare, late, noisy = (
        one(sensor=sensor, pursuer=low, evader=turning, seed=seed).game_time_s
        for sensor in (
            {},
            {"rate_hz": 1.0},
            {"rate_hz": 1.0, "latency_s": 0.5},
            {"rate_hz": 5.0, "position_noise_m": 2.0},
        )
    )
    assert clear < rare < late
    assert clear < noisy


def test_perfect_reports_at_every_cycle_are_as_good_as_seeing():
    """Catches a delay or an error that perfect reports add."""
    seen = one().game_time_s
    assert one(sensor={"rate_hz": 50.0}).game_time_s == pytest.approx(seen, abs=0.02)


def test_the_pursuer_waits_for_a_lost_evader_and_then_gives_up():
    """Catches an outage that mathematics plays on through, or gives up at once."""
    back = one(sensor={"rate_hz": 5.0, "outages_s": [[2.0, 6.0]]})
    assert back.end == "captured"
    assert "evader lost" in back.events
    gone = one(sensor={"rate_hz": 5.0, "outages_s": [[2.0, 60.0]]})
    assert gone.end == "failed"
    assert gone.reason == "evader lost"
    assert gone.game_time_s == pytest.approx(2.0 + 1.5 + 10.0, abs=0.3)


def test_an_evader_that_seems_too_fast_for_a_game_ends_it():
    """Reports of its velocity are so noisy that sooner or later one passes what this pursuer can catch."""
    outcome = one(
        evader={"speed_m_s": 4.0, "declared_speed_m_s": 2.0},
        wind={"velocity_m_s": [0.0, 1.9]},
        sensor={"velocity_noise_m_s": 1.0, "rate_hz": 10.0},
    )
    assert outcome.end == "failed"
    assert outcome.reason == "evader too fast for this vehicle"
    assert outcome.events == (outcome.reason,)


def test_the_library_scenario_of_the_paper_has_the_value_that_the_game_gives():
    chase = load_scenario("hover_chase")[1]
    level = chase.evader.position_m[1] - chase.standoff.radius_m - chase.standoff.tolerance_m
    assert play_scenarios([chase])[0].predicted == pytest.approx(
        level / (chase.pursuer.speed_m_s - chase.evader.speed_m_s)
    )


def test_an_evader_plays_in_still_air_even_if_the_wind_leaves_the_pursuer_no_margin():
    windy = scenario().model_copy(update={"wind": Wind(velocity_m_s=(3.0, 3.0))})
    assert game(windy).wind_m_s == (0.0, 0.0)
    with pytest.raises(ConfigError, match="wind"):
        stack([windy])


@pytest.mark.parametrize(("spare_m", "winner"), [(0.004, "none"), (0.02, "pursuer")])
def test_a_win_within_the_error_of_a_cycle_is_not_promised(spare_m, winner):
    """In a plane with the target between both: L = (2 E − P + R) / 3 with the disc's rim and the tolerance as R."""
    standoff = {"radius_m": 3.0, "height_m": 8.0, "tolerance_m": 0.5}
    base = {
        "title": "close",
        "game": "tad",
        "target": {"position_m": [0.0, 0.0]},
        "pursuer": {"position_m": [-13.5, 0.0, 8.0], "speed_m_s": 4.0, "speed_set": "cylinder"},
        "evader": {"position_m": [0.5 * (10.0 + 3.0 * spare_m), 0.0], "speed_m_s": 2.0},
        "standoff": standoff,
    }
    (outcome,) = play_scenarios([parse_document(Scenario, base, source="close")])
    assert outcome.predicted_evader_to_target_m == pytest.approx(spare_m, rel=1e-6)
    assert outcome.predicted_winner == winner
