"""The catalogue of strategies: what each of them does, and that it does it at full speed."""

import numpy as np
import pytest

from guidance.game import EVADER_POLICIES, PURSUER_POLICIES, Ball, Cylinder, Game, StandOff, solve

PAPER = Game(Ball(2.0), 1.0)
lead_pursuit = PURSUER_POLICIES["lead_pursuit"]
P = np.array([3.0, 4.0, 12.0])
E = np.zeros(3)
T = np.array([-6.0, 8.0, 0.0])


def test_the_optimal_policies_are_the_solution():
    seen = np.array([0.1, 0.0, 0.0])
    for target in (None, T):
        solution = solve(PAPER, P, E, target, evader_velocity_m_s=seen)
        np.testing.assert_array_equal(
            PURSUER_POLICIES["optimal"](PAPER, P, E, target, seen), solution.pursuer_velocity_m_s
        )
        np.testing.assert_array_equal(
            EVADER_POLICIES["optimal"](PAPER, P, E, target, seen), solution.evader_velocity_m_s
        )
    above = np.array([0.0, 0.0, 5.0])
    followed = PURSUER_POLICIES["optimal"](PAPER, above, E, None, seen)
    np.testing.assert_array_equal(followed[:2], seen[:2])
    np.testing.assert_array_equal(
        EVADER_POLICIES["optimal"](PAPER, above, E, None, -seen), [-1.0, 0.0, 0.0]
    )


def test_pure_pursuit_flies_straight_at_the_evader():
    np.testing.assert_allclose(PURSUER_POLICIES["pure_pursuit"](PAPER, P, E), -2.0 * P / 13.0)


def test_pure_pursuit_of_a_cylinder_uses_both_its_speeds():
    game = Game(Cylinder(5.0, 3.0, 1.0), 1.0, standoff=StandOff(1.0, 2.0))
    np.testing.assert_allclose(PURSUER_POLICIES["pure_pursuit"](game, P, E), [-3.0, -4.0, -1.0])
    np.testing.assert_allclose(
        PURSUER_POLICIES["pure_pursuit"](game, P * [1, 1, 0], E), [-3.0, -4.0, 3.0]
    )
    seen = np.array([0.0, 0.5, 0.0])
    inside = np.array([0.3, 0.0, 2.0])
    np.testing.assert_allclose(PURSUER_POLICIES["pure_pursuit"](game, inside, E, None, seen), seen)


def test_pure_pursuit_of_a_cylinder_holds_within_its_capture_radius():
    game = Game(Cylinder(5.0, 3.0, 1.0), 1.0, standoff=StandOff(1.0, 2.0), capture_radius_m=0.5)
    for distance, flown in ((0.5, 0.0), (1.25, 0.0), (1.75, -5.0)):
        at = np.array([distance, 0.0, 4.0])
        np.testing.assert_allclose(
            PURSUER_POLICIES["pure_pursuit"](game, at, E), [flown, 0.0, -1.0]
        )


def test_pure_pursuit_of_a_stand_off_disc_flies_to_its_edge():
    game = Game(Ball(2.0), 1.0, standoff=StandOff(2.0, 8.0))
    np.testing.assert_allclose(
        PURSUER_POLICIES["pure_pursuit"](game, P, E), 2.0 * np.array([-1.8, -2.4, -4.0]) / 5.0
    )


def test_wind_does_not_turn_a_straight_flight():
    game = Game(Ball(2.0), 1.0, wind_m_s=(0.3, -0.4))
    flown = PURSUER_POLICIES["pure_pursuit"](game, P, E)
    np.testing.assert_allclose(np.cross(flown, P), 0.0, atol=1e-12)
    assert np.linalg.norm(flown - [0.3, -0.4, 0.0]) == pytest.approx(2.0)


def test_task_oriented_players_go_straight_to_the_target_and_stay():
    np.testing.assert_allclose(
        PURSUER_POLICIES["task_oriented"](PAPER, P, E, T), 2.0 * (T - P) / np.linalg.norm(T - P)
    )
    np.testing.assert_allclose(EVADER_POLICIES["task_oriented"](PAPER, P, E, T), [-0.6, 0.8, 0.0])
    np.testing.assert_allclose(
        EVADER_POLICIES["task_oriented"](PAPER, P, 0.99 * T, T), [-0.6, 0.8, 0.0]
    )
    np.testing.assert_array_equal(EVADER_POLICIES["task_oriented"](PAPER, P, T, T), 0.0)
    seen = np.array([0.5, 0.0, 0.0])
    np.testing.assert_array_equal(PURSUER_POLICIES["task_oriented"](PAPER, T, E, T, seen), 0.0)


def test_pure_evade_runs_away_in_the_plane():
    np.testing.assert_allclose(EVADER_POLICIES["pure_evade"](PAPER, P, E), [-0.6, -0.8, 0.0])
    np.testing.assert_array_equal(
        EVADER_POLICIES["pure_evade"](PAPER, np.array([0.0, 0.0, 7.0]), E), [-1.0, 0.0, 0.0]
    )


def test_hold_holds():
    for catalogue in (PURSUER_POLICIES, EVADER_POLICIES):
        np.testing.assert_array_equal(catalogue["hold"](PAPER, P, E, T), 0.0)


def test_lead_pursuit_is_the_collision_triangle():
    E = np.array([30.0, 0.0, 0.0])
    run = np.array([0.0, 1.0, 0.0])
    v = lead_pursuit(PAPER, np.zeros(3), E, None, run)
    assert v[1] == pytest.approx(run[1])  # the line of sight keeps its bearing
    assert np.linalg.norm(v) == pytest.approx(2.0)


def test_lead_pursuit_of_an_evader_that_stands_still_is_pure_pursuit():
    P = np.array([0.0, 0.0, 3.0])
    for E in (np.array([3.0, 4.0, 0.0]), np.array([0.0, 4.0, 0.0])):
        v = lead_pursuit(PAPER, P, E, None, np.zeros(3))
        np.testing.assert_allclose(v, 2.0 * (E - P) / np.linalg.norm(E - P))


def test_lead_pursuit_has_a_steady_evader_on_the_rim_of_the_disc_at_its_height():
    game = Game(Ball(3.0), 1.5, standoff=StandOff(3.0, 5.0), wind_m_s=(0.3, -0.4))
    start = np.array([-20.0, 9.0, 25.0])
    run = np.array([0.9, 1.2, 0.0])
    v = lead_pursuit(game, start, E, None, run)
    assert np.linalg.norm(v - [0.3, -0.4, 0.0]) == pytest.approx(3.0)
    t = -20.0 / v[2]
    assert np.linalg.norm((start + v * t - E - run * t)[:2]) == pytest.approx(3.0)


def test_lead_pursuit_keeps_with_an_evader_that_is_on_the_disc():
    game = Game(Cylinder(3.0, 2.0, 1.0), 1.5, standoff=StandOff(3.0, 5.0), capture_radius_m=0.2)
    run = np.array([0.9, -1.2, 0.0])
    np.testing.assert_array_equal(lead_pursuit(game, np.array([3.1, 0.0, 5.1]), E, None, run), run)
    assert lead_pursuit(game, np.array([3.3, 0.0, 5.0]), E, None, run)[0] < 0.9
