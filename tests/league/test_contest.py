import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.errors import ConfigError
from guidance.game import End
from guidance.league.contest import TRIAL, contest_of, play_pair, scenario_of_game, worst_rows
from guidance.league.frpn import FRPN, FRPN_LEVEL, frpn, frpn_level
from guidance.league.states import arena_of, batch_at
from guidance.sim.batch import stack
from guidance.sim.maths import opening as opening_of
from guidance.sim.maths import play_scenarios
from guidance.sim.scenario_file import load_scenario
from guidance.strategies import own

POLICY = """
import numpy as np

def choose(observation):
    way = observation[:, 0:3]
    return way / np.linalg.norm(way, axis=1, keepdims=True)

def short(observation):
    return np.zeros((len(observation), 2))

class Trained:
    class observation_space:
        shape = (10,)

    def __call__(self, observation):
        return np.zeros((len(observation), 3))

trained = Trained()
"""


@pytest.fixture
def policy_file(tmp_path, monkeypatch):
    (tmp_path / "policy.py").write_text(POLICY)
    monkeypatch.chdir(tmp_path)
    own.forget()
    return tmp_path


def run(*words):
    return CliRunner().invoke(app, ["league", "run", *words])


def test_the_optimum_loses_nothing_to_the_optimum_and_others_lose():
    """Catches regret that is charged to optimal play, or not to bad play."""
    scenario = load_scenario("tad")[1]
    contest = contest_of(scenario, "optimal", "pursuer", 16, 7)
    best = play_pair(contest, "optimal", "optimal")
    naive = play_pair(contest, "pure_pursuit", "optimal")
    navigating = play_pair(contest, FRPN, "optimal")
    assert np.abs(best.regret).max() < 0.1  # velocities are held near the end
    assert naive.row.median.value > 0.5
    assert navigating.row.median.value > best.row.median.value
    for row in (best.row, naive.row):
        assert row.median.low <= row.median.value <= row.median.high
        assert row.won.low <= row.won.value <= row.won.high
    assert naive.row.won.value <= best.row.won.value


@pytest.mark.parametrize("game", ["pe", "tad"])
def test_the_worst_game_as_a_scenario_has_the_same_regret(game, policy_file):
    """Catches a worst game that is not the game played."""
    contest = contest_of(load_scenario(game)[1], "policy.py:choose", "pursuer", 10, 3)
    played = play_pair(contest, "policy.py:choose", "optimal")
    won = [row for row in worst_rows(played, 10) if played.end[row] == End.CAPTURED]
    outcome = play_scenarios([scenario_of_game(contest, played.row, won[0])])[0]
    if outcome.predicted_winner == "pursuer":
        assert outcome.regret == pytest.approx(played.regret[won[0]], abs=1e-6)


def test_every_built_in_strategy_plays_beside_the_policy_and_against_it(policy_file):
    contest = contest_of(load_scenario("pe")[1], "policy.py:choose", "pursuer", 2, 7)
    built_in = ("optimal", "pure_pursuit", "lead_pursuit", "proportional_navigation", FRPN_LEVEL)
    assert contest.players == ("policy.py:choose", *built_in)
    assert contest.opponents == ("optimal", "pure_evade", "random_turns", "hold")


def test_frpn_turns_by_the_acceleration_of_its_paper():
    """r = (10, 0), w = (0, -5): t = 2, (r + w t)/t² = (2.5, -2.5), a = 19.7 (0.949 (2.5, -2.5) + 0.051 (10, 0))."""
    beside = np.array([[10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0, 0.0]])
    turned = np.array([0.02 * 56.785, 5.0 - 0.02 * 46.738, 0.0])
    assert frpn(beside)[0] == pytest.approx(turned / np.linalg.norm(turned), abs=1e-4)
    standing = np.array([[3.0, 0.0, -4.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    assert frpn(standing)[0] == pytest.approx([0.6, 0.0, -0.8])
    assert frpn_level(standing)[0] == pytest.approx([1.0, 0.0, -1.0])


def test_frpn_flies_a_multicopter_to_the_height_of_the_disc():
    """Catches a navigation law of the league that stays level below or above the disc."""
    contest = contest_of(load_scenario("hover_chase")[1], "optimal", "pursuer", 8, 7)
    assert contest.players[-1] == FRPN_LEVEL
    assert np.abs(play_pair(contest, FRPN_LEVEL, "optimal").regret).max() < 0.05


def test_the_command_prints_the_same_twice_and_its_scenarios_are_scenarios(
    policy_file, monkeypatch
):
    """Catches a league whose output depends on more than its seed, or writes scenarios that cannot be read."""
    monkeypatch.setattr("guidance.league.contest.built_in_policies", lambda *_: ("optimal",))
    near = str(Path(__file__).parents[1] / "data" / "near_chase.toml")
    words = ("policy.py:choose", "--scenario", near, "--games", "6", "--seed", "7", "--json")
    first = run(*words, "--out", "once")
    again = run(*words, "--out", "twice")
    assert first.exit_code == 0, first.output
    assert first.stdout == again.stdout
    document = json.loads(first.stdout)
    assert [row["player"] for row in document["rows"]] == ["policy.py:choose", "optimal"]
    assert (policy_file / "once" / "league.png").stat().st_size > 10_000
    name, scenario = load_scenario(str(policy_file / "once" / "worst-optimal-1.toml"))
    assert scenario.pursuer.policy == "policy.py:choose"
    assert (policy_file / "twice" / "worst-optimal-1.toml").read_bytes() == name.read_bytes()
    refused = run(*words, "--out", "once")
    assert isinstance(refused.exception, ConfigError)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("nowhere.py:choose",), "there is no file nowhere.py"),
        (("policy.py:chose",), "policy.py has no function chose; it has: .*choose"),
        (("cheat",), "pursuer.policy = 'cheat': allowed are .* module:function"),
        (("policy.py:short",), r"answers shape \(16, 2\) of float64 .* must be .* shape \(16, 3\)"),
        (("policy.py:trained",), r"observation_space has shape \(10,\); this game's .* \(8,\)"),
        (("optimal", "--side", "target"), "--side target: must be pursuer or evader"),
        (("optimal", "--seed", str(1 << 40)), r"seed = 1099511627776: must be from 0"),
    ],
)
def test_what_cannot_be_played_is_refused_before_any_game(words, expected, policy_file):
    result = run(*words, "--games", "5")
    assert isinstance(result.exception, ConfigError)
    with pytest.raises(ConfigError, match=expected):
        raise result.exception


def registered(name, columns, answer):
    """Register a policy that answers the trial, and in games `answer`."""

    def choose(observation):
        if len(observation) == TRIAL:
            return np.zeros((len(observation), columns))
        return np.full((len(observation), columns), answer)

    own.register_policy(name, choose)
    return name


@pytest.mark.parametrize("game", ["pe", "tad", "hover_chase"])
@pytest.mark.parametrize(("side", "columns"), [("pursuer", 3), ("evader", 2)])
def test_quitting_costs_the_remaining_value_and_never_less_than_playing_badly(game, side, columns):
    """Catches a pursuer that gains by quitting."""
    name = registered("tests.quits:policy", columns, np.nan)
    contest = contest_of(load_scenario(game)[1], name, side, 40, 7)
    quits = play_pair(contest, name, "optimal")
    opening = opening_of(batch_at(arena_of(contest.scenario).template, contest.states))
    assert (quits.row.failed, quits.row.won.value) == (40, 0.0)
    assert (quits.regret >= opening.value - 0.05).all()  # it fails after a cycle
    won_by_player = opening.winner > 0 if side == "pursuer" else opening.winner < 0
    for other in ("pure_pursuit", "optimal") if side == "pursuer" else ("pure_evade", "optimal"):
        if other != "pure_evade" or game != "tad":
            plays = play_pair(contest, other, "optimal")
            finished = won_by_player & (plays.end != End.TIME_UP)
            assert (quits.regret >= plays.regret - 1e-9)[finished].all()


def test_a_pursuer_that_only_waits_pays_for_the_time_limit_and_the_remaining_value():
    """Catches a pursuer that gains by waiting for the time limit."""
    name = registered("tests.waits:policy", 3, 0.0)
    scenario = load_scenario("hover_chase")[1].model_copy(update={"time_limit_s": 20.0})
    contest = contest_of(scenario, name, "pursuer", 10, 7)
    waits = play_pair(contest, name, "hold")
    arena = arena_of(contest.scenario)
    value_s = opening_of(batch_at(arena.template, contest.states)).value
    assert (waits.end == End.TIME_UP).all()
    # The evader stands, so the value at the end is that of the start
    assert waits.regret == pytest.approx(float(arena.template.limit_s) + value_s, abs=1e-6)


def test_a_pursuer_does_not_pay_for_an_evader_without_an_answer():
    name = registered("tests.lost:evader", 2, np.nan)
    contest = contest_of(load_scenario("pe")[1], "optimal", "pursuer", 8, 1)
    played = play_pair(contest, "optimal", name)
    assert played.row.failed == 8
    assert (np.abs(played.regret) < 0.05).all()


@pytest.mark.parametrize("size", [1e308, 1e6])
@pytest.mark.parametrize(("side", "columns"), [("pursuer", 3), ("evader", 2)])
def test_a_huge_action_is_flown_at_full_speed(size, side, columns):
    """Catches an action that overflows and becomes NaN."""
    scenario = load_scenario("hover_chase")[1].model_copy(update={"time_limit_s": 10.0})
    contest = contest_of(scenario, "optimal", side, 8, 1)
    huge = play_pair(contest, registered("tests.huge:policy", columns, size), "optimal")
    full = play_pair(contest, registered("tests.full:policy", columns, 1.0), "optimal")
    assert huge.row.failed == 0
    assert (huge.end == full.end).all()
    assert huge.regret == pytest.approx(full.regret, abs=1e-6)


def test_the_league_plays_the_speed_set_of_the_flight():
    scenario = load_scenario("pe")[1]
    assert scenario.pursuer.speed_set is None
    contest = contest_of(scenario, "optimal", "pursuer", 4, 7)
    assert contest.scenario.pursuer.speed_set == scenario.as_flown().pursuer.speed_set
    played = play_pair(contest, "optimal", "optimal")
    written = scenario_of_game(contest, played.row, 0)
    assert stack([written]).game == stack([written.as_flown()]).game
    named = scenario.model_copy(
        update={"pursuer": scenario.pursuer.model_copy(update={"speed_set": "ball"})}
    )
    assert contest_of(named, "optimal", "pursuer", 4, 7).players[-1] == FRPN


def test_the_league_says_where_its_game_is_not_the_flights(monkeypatch):
    monkeypatch.setattr("guidance.league.contest.built_in_policies", lambda *_: ("optimal",))
    result = run("optimal", "--games", "1", "--scenario", "wind")
    assert "in flight no player knows it" in result.output
    assert "in flight" not in run("optimal", "--games", "1", "--scenario", "hover_chase").output
