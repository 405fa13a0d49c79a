"""The values solve the Hamilton-Jacobi-Isaacs equation, and the closed gradients are their derivatives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.game import Ball, Game, solve
from guidance.game.verification import hji_residual, value_gradient
from tests.game import gradient as closed
from tests.harness.examples import drawn

few = settings(max_examples=drawn(2), deadline=None)
seeds = st.integers(0, 2**32 - 1)
STEP_M = 1e-4


def smooth(game, P, E, T):
    """States where the value is smooth within the reach of a finite difference.

    Not on the barrier, not at the end of the game, not with P's height spent at the very instant that its distance is,
    not at the corners of the disc, and not where two headings of the evader are nearly as good as each other.
    """
    here = closed.value_gradient(game, P, E, T)
    good = np.ones(len(P), dtype=bool)
    rng = np.random.default_rng(0)
    for _ in range(3):
        moves = rng.normal(size=(3, 3)) * 4 * STEP_M
        moves[1:, 2] = 0.0
        there = closed.value_gradient(
            game, P + moves[0], E + moves[1], None if T is None else T + moves[2]
        )
        for a, b in zip(here, there, strict=True):
            good &= np.abs(a - b).max(axis=1) < 0.05
    solution = solve(game, P, E, T)
    return good & (solution.value > 0.1) & (solution.meeting_time_s > 0.1)


@few
@given(seed=seeds)
def test_the_residual_vanishes_in_pe(games, oracle, seed):
    for name, game in games.items():
        P, E, _ = oracle.states(seed, 24, game)
        in_space = game.evader_space == "space"
        good = solve(game, P, E).value > 0.1 if in_space else smooth(game, P, E, None)
        assert good.mean() > 0.5, name
        assert np.abs(hji_residual(game, P[good], E[good], step_m=STEP_M)).max() < 1e-7, name


@pytest.mark.parametrize("name", ["ball_standoff", "cylinder", "cylinder_everything"])
def test_the_residual_vanishes_below_the_disc_too(games, oracle, name):
    P, E, T = oracle.states(41, 24)
    P[:, 2] -= 20.0
    for target in (None, T):
        good = smooth(games[name], P, E, target)
        assert good.mean() > 0.5
        state = (P[good], E[good], None if target is None else target[good])
        assert np.abs(hji_residual(games[name], *state, step_m=STEP_M)).max() < 1e-6
    assert set(solve(games[name], P[good], E[good], T[good]).winner.tolist()) == {-1, 1}


def test_the_residual_vanishes_on_the_axes_too():
    P = np.array([0.0, 3.0, 4.0])
    E = np.array([2.0, 0.0, 0.0])
    assert hji_residual(Game(Ball(2.0), 1.0), P, E) == pytest.approx(0.0, abs=1e-9)


@few
@given(seed=seeds)
def test_the_residual_vanishes_in_tad_on_both_sides_of_the_barrier(games, oracle, seed):
    """Catches velocities that are not those of the value's own gradient (Isaacs' equation)."""
    sides = set()
    for name, game in games.items():
        P, E, T = oracle.states(seed, 24, game)
        if game.evader_space == "space":
            solution = solve(game, P, E, T)
            good = (
                (solution.meeting_time_s > 0.1)
                & (np.abs(solution.margin_s) > 0.2)
                & (solution.value > 0.5)
            )
        else:
            good = smooth(game, P, E, T)
        assert good.mean() > 0.4, name
        residual = hji_residual(game, P[good], E[good], T[good], step_m=STEP_M)
        assert np.abs(residual).max() < 1e-6, name
        sides |= set(solve(game, P[good], E[good], T[good]).winner.tolist())
    assert sides == {-1, 1}


@few
@given(seed=seeds)
def test_the_closed_gradient_is_the_derivative_of_the_value(games, oracle, seed):
    """Catches a gradient that is not that of the closed form, in any family of games."""
    for name, game in games.items():
        if game.evader_space == "space":
            continue
        P, E, T = oracle.states(seed, 24, game)
        for target in (None, T):
            good = smooth(game, P, E, target)
            state = (P[good], E[good], None if target is None else target[good])
            expected = closed.value_gradient(game, *state)
            found = value_gradient(game, *state, step_m=STEP_M)
            for ours, theirs in zip(found, expected, strict=True):
                np.testing.assert_allclose(ours, theirs, atol=2e-6, err_msg=name)


def test_the_pe_gradient_is_the_papers():
    P = np.array([8.0, 1.42, 9.41])
    E = np.array([7.92, 9.6, 0.0])
    delta = 2.0
    v = 1.5
    (dx, dy) = (P - E)[:2]
    z = P[2]
    d = np.hypot(dx, dy)
    root = np.sqrt((delta**2 - 1) * z**2 + delta**2 * np.hypot(dx, dy) ** 2)
    by_x = (dx / d + delta**2 * dx / root) / ((delta**2 - 1) * v)
    by_y = (dy / d + delta**2 * dy / root) / ((delta**2 - 1) * v)
    gradient = value_gradient(Game(Ball(delta * v), v), P, E)
    np.testing.assert_allclose(gradient.pursuer, [by_x, by_y, z / (v * root)], rtol=1e-9)
    np.testing.assert_allclose(gradient.evader, [-by_x, -by_y, 0.0], rtol=1e-9)
    np.testing.assert_array_equal(gradient.target, 0.0)


def test_the_tad_gradient_is_the_papers():
    P = np.array([6.97, 5.83, 9.15])
    E = np.array([9.8, 0.33, 0.0])
    T = np.zeros(3)
    delta = 2.0
    d = np.hypot(*(P - E)[:2])
    root = np.sqrt((delta**2 - 1) * P[2] ** 2 + delta**2 * d**2)
    away = np.linalg.norm((delta**2 * E - P)[:2])
    hand = delta**2 - 1
    by_pursuer = (P - delta**2 * E)[:2] / (hand * away) - delta**2 * (P - E)[:2] / (hand * root)
    by_evader = delta**2 * (delta**2 * E - P)[:2] / (hand * away) - delta**2 * (E - P)[:2] / (
        hand * root
    )
    gradient = value_gradient(Game(Ball(2.0), 1.0), P, E, T)
    np.testing.assert_allclose(gradient.pursuer, [*by_pursuer, -P[2] / root], rtol=1e-9)
    np.testing.assert_allclose(gradient.evader, [*by_evader, 0.0], rtol=1e-9)
