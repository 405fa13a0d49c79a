import gymnasium
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
    """Catches an environment that breaks PettingZoo's own rules."""
    parallel_api_test(PursuitParallelEnv(scenario, step_s=0.5), num_cycles=60)
    parallel_seed_test(lambda: PursuitParallelEnv(scenario, step_s=0.5), num_cycles=5)


@pytest.mark.parametrize("name", ["pe", "tad", "wind", "hover_chase"])
def test_games_end_as_the_mathematics_ends_them(name):
    """Catches environments that end a game at another time or with another winner than the mathematics."""
    scenario = load_scenario(name)[1]
    arena = arena_of(scenario)
    seeds = seeds_of(5, 5, first=7)  # one of TAD's is lost
    games = Games(arena, seeds, 0.02)
    while (games.moment.end == End.RUNNING).any():
        games.step(None, None)
    states = random_states(arena, seeds)
    outcomes = play_scenarios([scenario_at(scenario, states, row) for row in range(5)])
    assert [End(end).name.lower() for end in games.moment.end] == [row.end for row in outcomes]
    assert games.moment.now_s == pytest.approx([row.game_time_s for row in outcomes], abs=0.03)


@pytest.mark.parametrize("scenario", ["pe", "tad"])
@pytest.mark.parametrize("side", ["pursuer", "evader"])
def test_rewards_of_an_episode_are_minus_its_regret_and_optimal_play_has_none(scenario, side):
    """Catches rewards that do not add up to the regret."""
    environment = PursuitVectorEnv(scenario, 16, side=side, between_points=True)
    environment.reset(seed=3)
    games = environment.games
    speed_m_s = 3.0 if side == "pursuer" else 1.5
    columns = environment.single_action_space.shape[0]
    total = np.zeros(16)
    seen = 0
    for number in range(600):
        best = getattr(games.solution, f"{side}_velocity_m_s")[:, :columns] / speed_m_s
        if number > 300:  # from now on it plays badly
            best = best * 0.9
        _, reward, terminated, truncated, info = environment.step(best)
        total += reward
        over = terminated | truncated
        seen += np.count_nonzero(over)
        assert total[over] == pytest.approx(-info["regret"][over], abs=1e-9)
        assert (np.abs(info["regret"]) < 1e-6).all() or number > 300
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


def test_each_seed_of_a_list_is_of_its_own_environment():
    one = PursuitVectorEnv("pe", 3)
    other = PursuitVectorEnv("pe", 3)
    first = one.reset(seed=[1, 2, 3])[0]
    second = other.reset(seed=[1, 99, 3])[0]
    assert (first == second).all(axis=1).tolist() == [True, False, True]
    alone = PursuitEnv("pe").reset(seed=3)[0]
    assert (first[2] == alone).all()
    with pytest.raises(ConfigError, match="seed: 2 in the list, must be 3"):
        one.reset(seed=[1, 2])


def test_a_reset_mask_begins_only_its_games_anew():
    environment = PursuitVectorEnv("pe", 4)
    everybody = {"reset_mask": np.ones(4, dtype=bool)}
    with pytest.raises(gymnasium.error.ResetNeeded):
        environment.reset(options={"reset_mask": np.array([True, False, False, False])})
    environment.reset(seed=1, options=everybody)
    before = environment.step(np.tile([1.0, 0.0, 0.0], (4, 1)))[0]
    after, info = environment.reset(options={"reset_mask": np.array([True, False, True, False])})
    assert (before == after).all(axis=1).tolist() == [False, True, False, True]
    assert (info["regret"] != 0.0).tolist() == [False, True, False, True]
    for mask in (np.ones(3, dtype=bool), [True] * 4, np.ones(4)):
        with pytest.raises(ConfigError, match=r"reset_mask.* must be an array of 4 truth values"):
            environment.reset(options={"reset_mask": mask})


def test_no_step_follows_the_end():
    environment = PursuitEnv("pe")
    with pytest.raises(gymnasium.error.ResetNeeded):
        environment.step(np.zeros(3))
    observation, _ = environment.reset(seed=0)
    over = False
    while not over:
        way = observation[:3] / np.linalg.norm(observation[:3])
        observation, _, terminated, truncated, _ = environment.step(way)
        over = terminated or truncated
    with pytest.raises(gymnasium.error.ResetNeeded):
        environment.step(np.zeros(3))
    environment.reset()
    environment.step(np.zeros(3))


def test_after_the_end_a_parallel_game_has_no_results():
    environment = PursuitParallelEnv("pe", step_s=0.5)
    environment.reset(seed=0)
    while environment.agents:
        environment.step({"pursuer": np.zeros(3), "evader": np.zeros(2)})
    assert environment.step({}) == ({}, {}, {}, {}, {})


@pytest.mark.parametrize(("scenario", "side"), [("pe", "evader"), ("hover_chase", "pursuer")])
def test_observations_at_full_speed_are_in_their_space(scenario, side):
    environment = PursuitVectorEnv(scenario, 16, side=side, opponent="optimal")
    environment.reset(seed=0)
    environment.action_space.seed(0)
    for _ in range(200):
        observations = environment.step(environment.action_space.sample())[0]
        assert all(map(environment.single_observation_space.contains, observations))


@pytest.mark.parametrize("step_s", [0.1, 0.5, 2.0])
def test_the_optimal_pursuer_is_as_good_however_long_the_evaders_steps_are(step_s):
    environment = PursuitVectorEnv(
        "hover_chase", 64, side="evader", opponent="optimal", step_s=step_s
    )
    environment.reset(seed=5)
    games = environment.games
    while (games.moment.end == End.RUNNING).any():
        games.step(None, games.solution.evader_velocity_m_s)
    assert games.score == pytest.approx(games.opening_score, abs=1e-3)


def test_a_step_that_costs_an_optimal_player_is_warned_of_with_its_cost():
    with pytest.warns(UserWarning, match=r"step_s = 2: the pursuer's optimal actions.* up to \d"):
        PursuitVectorEnv("hover_chase", 2, step_s=2.0)
    PursuitVectorEnv("hover_chase", 2, step_s=0.5)
    PursuitVectorEnv("pe", 2, step_s=2.0, between_points=True)


def test_gymnasium_makes_the_registered_ids_and_draws_their_games():
    environment = gymnasium.make(
        "Pursuit-v0", scenario="tad", side="evader", render_mode="rgb_array"
    )
    assert environment.action_space.dtype == np.float32
    environment.reset(seed=1)
    frames = [environment.render()]
    for _ in range(10):
        environment.step(np.array([1.0, 0.0], dtype=np.float32))
    frames.append(environment.render())
    assert [(frame.shape, frame.dtype) for frame in frames] == [((480, 640, 3), np.uint8)] * 2
    assert (frames[0] != frames[1]).any()
    assert gymnasium.make_vec("Pursuit-v0", num_envs=3).reset(seed=1)[0].shape == (3, 8)
    with pytest.raises(ConfigError, match="render_mode = 'human': must be rgb_array"):
        PursuitEnv("pe", render_mode="human")


def test_a_picture_without_matplotlib_names_the_extra(monkeypatch):
    monkeypatch.setattr("guidance.extras.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"rgb_array.*matplotlib.*pursuit-guidance\[plot\]"):
        PursuitEnv("pe", render_mode="rgb_array")


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
