import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test, parallel_seed_test

from guidance import league
from guidance.errors import ConfigError
from guidance.game import End
from guidance.league import PursuitEnv, PursuitParallelEnv, PursuitVectorEnv
from guidance.league.play import Games
from guidance.league.sides import side_of
from guidance.league.states import arena_of, random_states, scenario_at, seeds_of
from guidance.sim.maths import play_scenarios
from guidance.sim.scenario_file import load_scenario


@pytest.mark.parametrize(
    ("scenario", "side", "between_points"),
    [("pe", "pursuer", False), ("tad", "evader", True), ("slow_reports", "pursuer", False)],
)
def test_gymnasiums_checks_pass(scenario, side, between_points):
    check_env(
        PursuitEnv(scenario, side=side, between_points=between_points), skip_render_check=True
    )


@pytest.mark.parametrize("scenario", ["tad", "teams_tad", "teams_chase"])
def test_pettingzoos_checks_pass(scenario):
    parallel_api_test(PursuitParallelEnv(scenario, step_s=2.0), num_cycles=30)
    parallel_seed_test(lambda: PursuitParallelEnv(scenario, step_s=2.0), num_cycles=5)


@pytest.mark.parametrize("name", ["pe", "tad", "wind", "hover_chase"])
def test_games_end_as_the_mathematics_ends_them(name):
    scenario = load_scenario(name)[1]
    arena = arena_of(scenario)
    seeds = seeds_of(5, 12)
    games = Games(arena, seeds, 0.02)
    while (games.moment.end == End.RUNNING).any():
        games.step(None, None)
    states = random_states(arena, seeds)
    outcomes = play_scenarios([scenario_at(scenario, states, row) for row in range(12)])
    assert [End(end).name.lower() for end in games.moment.end] == [row.end for row in outcomes]
    assert games.moment.now_s == pytest.approx([row.game_time_s for row in outcomes], abs=0.03)


@pytest.mark.parametrize("scenario", ["pe", "tad"])
@pytest.mark.parametrize("side", ["pursuer", "evader"])
def test_rewards_of_an_episode_are_minus_its_regret_and_optimal_play_has_none(scenario, side):
    environment = PursuitVectorEnv(scenario, 16, side=side, between_points=True)
    environment.reset(seed=3)
    games = environment.games
    speed_m_s = 3.0 if side == "pursuer" else 1.5
    columns = environment.single_action_space.shape[0]
    total = np.zeros(16)
    seen = 0
    for number in range(400):
        best = getattr(games.solution, f"{side}_velocity_m_s")[:, :columns] / speed_m_s
        if number > 200:  # from now on it plays badly
            best = best * 0.9
        _, reward, terminated, truncated, info = environment.step(best)
        total += reward
        over = terminated | truncated
        seen += np.count_nonzero(over)
        assert total[over] == pytest.approx(-info["regret"][over], abs=1e-9)
        assert (np.abs(info["regret"]) < 1e-6).all() or number > 200
        assert ((info["winner"] != 0) == over).all()
        total[over] = 0.0
    assert seen > 16
    assert info["regret"].max() > 0.1


def test_a_state_depends_on_its_seed_only_and_an_environment_on_its_own():
    arena = arena_of(load_scenario("tad")[1])
    many = random_states(arena, seeds_of(2, 50))
    alone = random_states(arena, seeds_of(2, 1, first=37))
    assert (many.pursuer_m[37] == alone.pursuer_m[0]).all()
    assert (many.evader_m[37] == alone.evader_m[0]).all()
    first = PursuitVectorEnv("tad", 8)
    again = PursuitVectorEnv("tad", 8)
    for environment in (first, again):
        environment.reset(seed=9)
    actions = np.random.default_rng(1).uniform(-1.0, 1.0, (60, 8, 3))
    for action in actions:
        for one, other in zip(first.step(action)[:4], again.step(action)[:4], strict=True):
            assert (one == other).all()


def test_what_the_pursuer_sees_is_late_where_the_scenario_has_a_sensor():
    side = side_of("slow_reports", "pursuer", "pure_evade", between_points=False)
    games = Games(side.arena, seeds_of(1, 4), 0.1)
    for _ in range(5):
        games.step(np.zeros((4, 3)), None)
    offset_m = games.moment.evader_m - games.moment.pursuer_m
    assert np.abs(side.observe(games)[:, :2] - offset_m[:, :2]).max() > 0.05


@pytest.mark.parametrize(
    ("actions", "words"),
    [
        (np.zeros((4, 2)), r"actions: shape \(4, 2\), dtype float64: must be .* shape \(4, 3\)"),
        (np.zeros((4, 3), dtype=complex), r"dtype complex128: must be real"),
        (
            np.array([[0.0, 0.0, 0.0]] * 3 + [[0.0, np.nan, 0.0]]),
            r"actions\[3\] = \[0.0, nan, 0.0\]",
        ),
        (np.array([["a", "b", "c"]] * 4), r"dtype <U1: must be real"),
    ],
)
def test_wrong_actions_are_refused_with_what_is_allowed(actions, words):
    environment = PursuitVectorEnv("pe", 4)
    environment.reset(seed=0)
    with pytest.raises(ConfigError, match=words):
        environment.step(actions)


def test_wrong_arguments_and_a_missing_extra_are_named(monkeypatch):
    for arguments, words in [
        ({"side": "target"}, "side = 'target': must be one of pursuer, evader"),
        ({"opponent": "cheat"}, r"evader.policy = 'cheat': allowed are"),
        ({"num_envs": 0}, "num_envs = 0: must be"),
        ({"step_s": 0.0}, "step_s = 0.0: must be from"),
    ]:
        with pytest.raises(ConfigError, match=words):
            PursuitVectorEnv("pe", **arguments)
    environment = PursuitParallelEnv("pe")
    environment.reset(seed=1)
    with pytest.raises(ConfigError, match="actions: none for evader"):
        environment.step({"pursuer": np.zeros(3)})
    monkeypatch.setattr("guidance.extras.find_spec", lambda name: None)
    with pytest.raises(
        ConfigError, match=r"needs gymnasium, pettingzoo.*pursuit-guidance\[league\]"
    ):
        _ = league.PursuitVectorEnv
