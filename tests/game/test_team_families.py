"""Every family of games that teams play, against a search over headings that knows only what a capture is."""

from dataclasses import replace

import numpy as np
import pytest

from guidance.game import Ball, Cylinder, Extent, Game, Reason, StandOff, Winner, solve
from guidance.game.team import match_teams, rollout_teams, solve_team

DISC = StandOff(3.0, 2.0)
U = np.array([2.0, 2.6, 1.7])
GAMES = {
    "speeds": Game(Ball(U), 1.0),
    "capture radius": Game(Ball(U), 1.0, capture_radius_m=np.array([0.5, 1.0, 0.2])),
    "stand-off": Game(Ball(U), 1.0, capture_radius_m=0.3, standoff=DISC),
    "wind": Game(Ball(U), 1.0, wind_m_s=(0.3, -0.4)),
    "stand-off in wind": Game(Ball(U), 1.0, standoff=DISC, wind_m_s=(0.3, -0.2)),
    "moving target": Game(
        Ball(U), 1.0, standoff=StandOff(0.0, 1.0), target_velocity_m_s=(0.3, 0.2)
    ),
    "cylinders": Game(Cylinder(U, 0.9, 0.6), 1.0, capture_radius_m=0.2, standoff=DISC),
    "cylinders in wind": Game(Cylinder(U, 0.9, 0.6), 1.0, standoff=DISC, wind_m_s=(0.1, 0.3)),
}
EXACT_IN_TAD = [name for name in GAMES if "cylinder" not in name]
CALM = [name for name in GAMES if "wind" not in name]


def states(count, n, seed=1):
    rng = np.random.default_rng(seed)
    P = rng.uniform(-20.0, 20.0, (count, n, 3))
    (E, T) = rng.uniform(-20.0, 20.0, (2, count, 3))
    P[..., 2] = np.abs(P[..., 2]) * rng.choice([0.0, 0.3, 1.0], (count, 1))
    E[:, 2] = 0.0
    T[:, 2] = 0.0
    return P, E, T


def of(game, n):
    """The game of the first n pursuers."""
    reach = game.capture_radius_m
    u = game.pursuer.horizontal_m_s[:n]
    pursuer = Ball(u) if isinstance(game.pursuer, Ball) else replace(game.pursuer, horizontal_m_s=u)
    return replace(game, pursuer=pursuer, capture_radius_m=reach[:n] if np.ndim(reach) else reach)


def is_captured(game, P, X, t):
    """Whether a pursuer, (s, n, 3), can have an evader at X, (k, s, 2), after t, (k, s)."""
    t = t[..., None]
    beside = np.hypot(
        *(X[..., None, axis] - P[..., axis] - t * game.wind_m_s[axis] for axis in (0, 1))
    )
    beside = beside - game.standoff.radius_m
    above = abs(P[..., 2] - game.standoff.height_m)
    reach = game.capture_radius_m
    pursuer = game.pursuer
    if isinstance(pursuer, Ball):
        return np.any(
            np.hypot(np.maximum(beside, 0.0), above) <= pursuer.speed_m_s * t + reach, axis=-1
        )
    vertical = np.where(P[..., 2] > game.standoff.height_m, pursuer.descent_m_s, pursuer.climb_m_s)
    return np.any(
        (beside - reach <= pursuer.horizontal_m_s * t) & (above - reach <= vertical * t), axis=-1
    )


def runs(game, P, E, angle):
    """Ends, (k, s, 2), and times, (k, s), of straight runs at angles (k, s), by bisection."""
    n = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    low = np.zeros(angle.shape)
    high = np.full(angle.shape, 1e3)
    for _ in range(55):
        t = 0.5 * (low + high)
        got = is_captured(game, P, E[:, :2] + game.evader_speed_m_s * t[..., None] * n, t)
        low = np.where(got, low, t)
        high = np.where(got, t, high)
    return E[:, :2] + game.evader_speed_m_s * high[..., None] * n, high


def searched(game, P, E, cost):
    """The least cost of a run, (s,): all headings, then ever finer ones about the best two valleys."""
    angle = np.linspace(0.0, 2.0 * np.pi, 240, endpoint=False)[:, None] + np.zeros(len(E))
    costs = cost(*runs(game, P, E, angle))
    best = np.take_along_axis(angle, np.argmin(costs, axis=0)[None], axis=0)
    apart = np.where(np.cos(angle - best) < 0.9, costs, np.inf)
    middle = np.stack([best, np.take_along_axis(angle, np.argmin(apart, axis=0)[None], axis=0)])
    width = angle[1, 0]
    for _ in range(11):
        near = middle + width * np.linspace(-1.0, 1.0, 21)[:, None]
        costs = cost(*runs(game, P, E, near.reshape(-1, len(E)))).reshape(near.shape)
        middle = np.take_along_axis(near, np.argmin(costs, axis=1, keepdims=True), axis=1)
        width *= 0.15
    return costs.min(axis=(0, 1))


def check_tad(name, count, n):
    game = of(GAMES[name], n)
    P, E, T = states(count, n)
    answer = solve_team(game, P, E, T)
    won = answer.winner == Winner.PURSUER
    drift = np.array(game.target_velocity_m_s)
    found = searched(
        game,
        P[won],
        E[won],
        lambda X, t: np.hypot(*np.moveaxis(X - T[won, :2] - t[..., None] * drift, -1, 0)),
    )
    value = answer.value[won]
    bound = answer.lower_bound[won]
    proven = answer.reason[won] != Reason.BRACKET
    assert np.count_nonzero(won) > 0.4 * count
    np.testing.assert_allclose(value[proven], found[proven], atol=1e-8)
    assert np.all(value <= found + 1e-8)
    assert np.all(bound >= found - 1e-8)
    assert np.mean(proven) > (0.8 if "cylinder" in name else 0.9999)


def check_pe(name, count, n):
    game = of(GAMES[name], n)
    P, E, _ = states(count, n)
    answer = solve_team(game, P, E)
    found = -searched(game, P, E, lambda _, t: -t)
    proven = answer.reason != Reason.BRACKET
    np.testing.assert_allclose(answer.value[proven], found[proven], atol=1e-8)
    assert np.all(answer.value >= found - 1e-8)
    assert np.all(answer.lower_bound <= found + 1e-8)
    assert np.all(proven) or n > 2 or "wind" in name
    if name in CALM:
        np.testing.assert_allclose(answer.lower_bound, found, atol=1e-8)


@pytest.mark.parametrize("n", [2, 3])
@pytest.mark.parametrize("name", GAMES)
def test_no_run_ends_closer_to_the_target_than_the_value(name, n):
    check_tad(name, 24, n)


@pytest.mark.parametrize("n", [2, 3])
@pytest.mark.parametrize("name", GAMES)
def test_no_run_lasts_longer_than_the_value(name, n):
    check_pe(name, 24, n)


@pytest.mark.long
@pytest.mark.parametrize("name", GAMES)
def test_a_thousand_states_of_each_family_have_the_value_of_a_search(name):
    check_tad(name, 1000, 2)
    check_pe(name, 1000, 2)


@pytest.mark.parametrize("name", ["stand-off", "cylinders", "wind"])
def test_a_game_for_each_pair_is_the_game_with_arrays(name):
    arrays = of(GAMES[name], 3)
    (P, E, T) = states(2, 3, seed=5)
    P = P[0]
    lists = [[one_of(arrays, i)] * 2 for i in range(3)]
    for goal in (T[0], None):
        found = match_teams(lists, P, E, goal)
        whole = match_teams(columns(arrays), P, E, goal)
        for one, other in zip(found, whole, strict=True):
            np.testing.assert_array_equal(one, other)


def one_of(game, i):
    """The game of one pursuer with single numbers."""
    u = float(game.pursuer.horizontal_m_s[i])
    reach = game.capture_radius_m
    pursuer = Ball(u) if isinstance(game.pursuer, Ball) else replace(game.pursuer, horizontal_m_s=u)
    return replace(
        game, pursuer=pursuer, capture_radius_m=float(reach[i]) if np.ndim(reach) else reach
    )


def columns(game):
    """The same game with the pursuers along the last axis but one, as `match_teams` takes them."""
    u = game.pursuer.horizontal_m_s[:, None]
    return replace(
        game,
        pursuer=Ball(u)
        if isinstance(game.pursuer, Ball)
        else replace(game.pursuer, horizontal_m_s=u),
    )


def test_a_pair_without_a_game_is_not_matched():
    fast = Game(Ball(2.0), 1.0)
    (P, E, _) = states(2, 2, seed=3)
    for goal in (np.zeros(3), None):
        found = match_teams([[fast, None], [fast, fast]], P[0], E, goal)
        assert found.first[1] != 0
        assert found.second[1] != 0
        assert np.isnan(found.alone[0, 1])
        assert not found.beats[0, 1]
    lone = match_teams([[None, None], [fast, fast]], P[0], E)
    only = match_teams(fast, P[0, 1:], E)
    np.testing.assert_array_equal(lone.lower_bound, only.lower_bound)
    assert lone.evader_of[0] == -1
    assert lone.pursuer_velocity_m_s[0].tolist() == [0.0, 0.0, 0.0]


def test_teams_defend_a_target_with_an_extent():
    shape = Extent(((-8.0, 0.0), (8.0, 0.0), (0.0, 6.0)), 1.0)
    game = Game(Cylinder(4.0, 2.0, 1.5), 2.0, 0.2, DISC, target_extent=shape)
    P = np.array([[9.0, 9.0, 4.0], [-9.0, 8.0, 2.0]])
    E = np.array([[1.0, 30.0, 0.0]])
    found = match_teams(game, P, E, np.zeros(3))
    team = solve_team(game, P, E[0], np.zeros(3))
    assert found.value[0] == pytest.approx(float(team.value), abs=1e-6)
    assert found.value[0] >= solve(game, P, E, np.zeros(3)).value.max()
    played = rollout_teams(game, P, E, np.zeros(3), evader_policy="task_oriented", step_s=0.1)
    assert played.distance_m[0] >= found.value[0] - 2.0 * 6.0 * 0.1
