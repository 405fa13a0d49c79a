"""The least time to the end of a game, for any play."""

import math

import numpy as np
import pytest

from guidance.game import Ball, Cylinder, Game, StandOff
from guidance.game.arrays import NUMPY
from guidance.game.rollout import look_ahead

NANOMETRE_M = 1e-9


def test_a_capture_takes_players_who_fly_at_each_other_at_least_that_long(games, oracle):
    for name, game in games.items():
        P, E, T = oracle.states(31, 60, game)
        P[:20] = E[:20] + 0.25 * P[:20]
        ahead = look_ahead(NUMPY, game, P, E, T)
        d = np.hypot(*(P - E)[:, :2].T)
        z = P[:, 2] - E[:, 2] - game.standoff.height_m
        beside = np.maximum(d - game.standoff.radius_m, 0.0)
        slack = game.capture_radius_m
        if isinstance(game.pursuer, Ball):
            closing = game.pursuer.speed_m_s + game.evader_speed_m_s + math.hypot(*game.wind_m_s)
            expected = np.maximum(np.hypot(beside, z) - slack, 0.0) / closing
        else:
            closing = (
                game.pursuer.horizontal_m_s + game.evader_speed_m_s + math.hypot(*game.wind_m_s)
            )
            vertical = np.where(z > 0, game.pursuer.descent_m_s, game.pursuer.climb_m_s)
            slack += 2.0 * NANOMETRE_M
            expected = np.maximum(
                np.maximum(beside - slack, 0.0) / closing,
                np.maximum(np.abs(z) - slack, 0.0) / vertical,
            )
        np.testing.assert_allclose(ahead.capture_s, expected, rtol=1e-12, err_msg=name)


def test_an_arrival_takes_an_evader_and_a_target_that_meet_at_least_that_long(games, oracle):
    for name, game in games.items():
        P, E, T = oracle.states(32, 20, game)
        T[:, 2] += 7.0
        way = (T - E) * [1.0, 1.0, float(game.evader_space == "space")]
        expected = np.linalg.norm(way, axis=1) / (
            game.evader_speed_m_s + math.hypot(*game.target_velocity_m_s)
        )
        np.testing.assert_allclose(
            look_ahead(NUMPY, game, P, E, T).arrival_s, expected, rtol=1e-12, err_msg=name
        )
        assert np.isinf(look_ahead(NUMPY, game, P, E, None).arrival_s).all()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_cylinder_turns_half_a_nanometre_inside_of_its_height(side):
    game = Game(Cylinder(2.0, 0.7, 0.5), 1.0)
    vertical = 0.5 if side > 0 else 0.7
    for over, left in ((0.5, math.inf), (1.0, math.inf), (1.5, 1.0), (4.0, 3.5), (9e9, 9e9 - 0.5)):
        P = np.array([5.0, 0.0, side * over * NANOMETRE_M])
        turn = look_ahead(NUMPY, game, P, np.zeros(3), None).turn_s
        assert turn == pytest.approx(left * NANOMETRE_M / vertical, rel=1e-12)


def test_what_is_within_the_capture_radius_is_no_height_to_lose():
    near = Game(Cylinder(2.0, 0.7, 0.5), 1.0, StandOff().radius_m + 0.5)
    far = Game(Ball(2.0), 1.0)
    P = np.array([5.0, 0.0, 4.5])
    E = np.zeros(3)
    assert look_ahead(NUMPY, near, P, E, None).turn_s == pytest.approx(4.0 / 0.5)
    assert look_ahead(NUMPY, near, P * [1.0, 1.0, 0.1], E, None).turn_s == math.inf
    assert look_ahead(NUMPY, far, P, E, None).turn_s == math.inf
