import numpy as np
import pytest

from guidance.errors import ConfigError
from guidance.game import PURSUER_POLICIES, Ball, Cylinder, Game, StandOff, solve
from guidance.strategies import OPTIMAL, Course, Strategy, StrategyMemory, evade, pursue
from guidance.strategies.navigation import proportional_navigation

lead_pursuit = PURSUER_POLICIES["lead_pursuit"]
POINT = Game(Ball(2.0), 1.0)
COPTER = Game(Cylinder(4.0, 2.0, 1.0), 2.0, standoff=StandOff(3.0, 5.0))


def chased(game, law, P, E, run, *, step_s=0.01, most_s=200.0):
    """Time to the capture of an evader at constant velocity, and the headings, without a game."""
    previous = None
    headings = []
    now_s = 0.0
    while now_s < most_s:
        v = law(game, P, E, run, previous, step_s)
        headings.append(np.arctan2(v[1], v[0]))
        P = P + step_s * v
        E = E + step_s * run
        previous = v
        now_s = now_s + step_s
        beside = np.hypot(*(P - E)[:2]) - game.standoff.radius_m
        if beside <= 0.02 * 4.0 and abs(P[2] - game.standoff.height_m) < 0.05:
            return now_s, np.array(headings)
    raise AssertionError("never caught")


def lead(game, P, E, run, previous, step_s):
    return lead_pursuit(game, P, E, None, run)


def navigation(gain):
    def law(game, P, E, run, previous, step_s):
        return proportional_navigation(
            game, P, E, run, StrategyMemory(previous), dt_s=step_s, gain=gain
        )

    return law


def test_proportional_navigation_turns_gain_times_as_fast_as_the_line_of_sight():
    P = np.zeros(3)
    E = np.array([20.0, 0.0, 0.0])
    run = np.array([0.0, 1.0, 0.0])
    previous = np.array([2.0, 0.0, 0.0])
    rate = 1.0 / 20.0
    for gain in (1.0, 3.0, 5.0):
        v = proportional_navigation(
            POINT, P, E, run, StrategyMemory(previous), dt_s=1e-3, gain=gain
        )
        assert np.arctan2(v[1], v[0]) == pytest.approx(gain * rate * 1e-3, rel=1e-6)


def test_in_space_a_ball_turns_its_whole_velocity_by_the_laws_own_equation():
    rng = np.random.default_rng(4)
    P, E, run, previous = rng.uniform(-20.0, 20.0, (4, 200, 3))
    P[:, 2] = np.abs(P[:, 2]) + 1.0
    E[:, 2] = 0.0
    run[:, 2] = 0.0
    run *= 0.9 / np.linalg.norm(run, axis=-1, keepdims=True)
    previous *= 2.0 / np.linalg.norm(previous, axis=-1, keepdims=True)
    r = E - P
    closes = np.sum(r * previous, axis=-1) > 0
    v = proportional_navigation(POINT, P, E, run, StrategyMemory(previous), dt_s=1e-6, gain=4.0)
    rate = 4.0 * np.cross(r, run - previous) / np.sum(r * r, axis=-1, keepdims=True)
    np.testing.assert_allclose(
        ((v - previous) / 1e-6)[closes], np.cross(rate, previous)[closes], atol=1e-5
    )
    np.testing.assert_allclose(
        v[~closes], 2.0 * (r / np.linalg.norm(r, axis=-1, keepdims=True))[~closes]
    )
    np.testing.assert_allclose(np.linalg.norm(v, axis=-1), 2.0)
    assert 50 < np.count_nonzero(closes) < 150


def test_from_above_it_keeps_the_velocity_that_has_the_evader():
    game = Game(Ball(2.0), 1.0, standoff=StandOff(3.0, 5.0))
    P = np.array([0.0, 0.0, 40.0])
    E = np.array([20.0, 7.0, 0.0])
    run = np.array([0.6, 0.8, 0.0])
    led = lead_pursuit(POINT, P, E, None, run)
    np.testing.assert_allclose(
        proportional_navigation(POINT, P, E, run, StrategyMemory(led), dt_s=0.02, gain=4.0),
        led,
        atol=1e-12,
    )
    begun = proportional_navigation(game, P, E, run, StrategyMemory(), dt_s=0.02, gain=4.0)
    distance = np.hypot(20.0, 7.0)
    rim = np.array([*(E[:2] * (1.0 - 3.0 / distance)), 5.0])
    np.testing.assert_allclose(begun, 2.0 * (rim - P) / np.linalg.norm(rim - P))


def test_in_wind_its_course_is_over_the_ground_and_its_speed_through_the_air():
    game = Game(Ball(2.0), 1.0, wind_m_s=(0.3, -0.4), standoff=StandOff(3.0, 5.0))
    P = np.array([-4.0, 9.0, 30.0])
    E = np.array([20.0, 0.0, 0.0])
    v = proportional_navigation(game, P, E, np.zeros(3), StrategyMemory(), dt_s=0.02, gain=3.0)
    sight = np.array([24.0, -9.0, 0.0])
    sight *= 1.0 - 3.0 / np.linalg.norm(sight)
    sight[2] = -25.0
    np.testing.assert_allclose(np.cross(v, sight), 0.0, atol=1e-12)
    assert np.linalg.norm(v - [0.3, -0.4, 0.0]) == pytest.approx(2.0)


def test_on_the_disc_a_ball_only_follows():
    game = Game(Ball(2.0), 1.0, standoff=StandOff(3.0, 5.0), capture_radius_m=0.1)
    run = np.array([0.5, -0.2, 0.0])
    for P in (np.array([2.0, 0.0, 5.0]), np.array([3.05, 0.0, 5.05])):
        v = proportional_navigation(
            game,
            P,
            np.zeros(3),
            run,
            StrategyMemory(np.array([1.0, 0.0, -1.0])),
            dt_s=0.02,
            gain=3.0,
        )
        np.testing.assert_array_equal(v, run)


def test_from_above_it_loses_less_than_pure_pursuit_to_an_evader_that_runs_its_best():
    P = np.array([0.0, 0.0, 40.0])
    E = np.array([30.0, 0.0, 0.0])
    run = np.array([1.0, 0.0, 0.0])
    value = float(solve(POINT, P, E).value)
    pure, navigated = (
        chased(POINT, law, P, E, run, step_s=0.02)[0] for law in (navigation(1.0), navigation(4.0))
    )
    assert 0.0 < navigated - value < 0.25 * (pure - value)


def test_on_a_collision_course_it_keeps_its_heading():
    P = np.zeros(3)
    E = np.array([20.0, 0.0, 0.0])
    run = np.array([0.0, 1.0, 0.0])
    previous = np.array([np.sqrt(3.0), 1.0, 0.0])
    v = proportional_navigation(POINT, P, E, run, StrategyMemory(previous), dt_s=0.02, gain=4.0)
    np.testing.assert_allclose(v, previous, atol=1e-12)


def test_it_starts_on_the_line_of_sight_and_returns_to_it_from_any_course():
    P = np.zeros(3)
    E = np.array([0.0, 20.0, 0.0])
    for previous in (None, np.array([0.0, -2.0, 0.0]), np.zeros(3)):
        v = proportional_navigation(
            POINT, P, E, np.zeros(3), StrategyMemory(previous), dt_s=0.02, gain=3.0
        )
        np.testing.assert_allclose(v, [0.0, 2.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("game", [POINT, COPTER])
def test_the_laws_are_as_good_as_their_names_against_an_evader_that_crosses(game):
    """Catches a navigation law with the wrong sign or gain, which still captures."""
    run = game.evader_speed_m_s * np.array([0.0, 1.0, 0.0])
    height = game.standoff.height_m
    P = np.array([0.0, 0.0, height + 2.0])
    E = np.array([60.0, 0.0, 0.0])
    pure, _ = chased(game, navigation(1.0), P, E, run)
    navigated, _ = chased(game, navigation(4.0), P, E, run)
    led, _ = chased(game, lead, P, E, run)
    assert led <= navigated < pure


def test_a_batch_is_its_rows_bit_for_bit():
    rng = np.random.default_rng(3)
    P, E = rng.uniform(-20, 20, (2, 40, 3)) * [1, 1, 0.5] + [0, 0, 10]
    E[:, 2] = 0.0
    run, previous = rng.uniform(-1, 1, (2, 40, 3)) * [1, 1, 0]
    dt = rng.uniform(0.0, 0.02, 40)
    for game in (POINT, COPTER):
        navigated = proportional_navigation(
            game, P, E, run, StrategyMemory(previous), dt_s=dt, gain=3.0
        )
        for i in range(40):
            alone = proportional_navigation(
                game, P[i], E[i], run[i], StrategyMemory(previous[i]), dt_s=dt[i], gain=3.0
            )
            np.testing.assert_array_equal(alone, navigated[i])


def test_a_name_that_is_no_strategy_and_a_course_that_does_not_fit_are_refused():
    with pytest.raises(ConfigError, match="policy = 'swerve': allowed are optimal"):
        Strategy("swerve")
    with pytest.raises(ConfigError, match="a course is needed for waypoints"):
        Strategy("waypoints")
    with pytest.raises(ConfigError, match="and only for these"):
        Strategy(OPTIMAL, Course(np.zeros(2), np.zeros((2, 3))))


def test_a_course_is_flown_no_faster_than_the_speed_set_allows():
    course = Course(np.array([0.0, 1.0]), np.array([[0.0, 0.0, 9.0], [30.0, 40.0, -30.0]]))
    place = np.array([0.0, 0.0, 9.0])
    memory = StrategyMemory(None, 0.0)
    strategy = Strategy("recorded", course)
    v = pursue(strategy, COPTER, place, place, None, place, memory, dt_s=0.02)
    np.testing.assert_allclose(v, [2.4, 3.2, -1.0])
    assert np.linalg.norm(
        pursue(strategy, POINT, place, place, None, place, memory, dt_s=0.02)
    ) == pytest.approx(2.0)
    assert np.linalg.norm(evade(strategy, COPTER, place, place, None, memory)) == pytest.approx(2.0)
