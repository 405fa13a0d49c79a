"""The margin over a target with a shape, against a dense search over its outline that knows only the definition."""

from dataclasses import replace

import numpy as np
import pytest

from guidance.game import Ball, Cylinder, Extent, Game, StandOff, Winner, solve
from guidance.game.team import solve_team

DISC = StandOff(3.0, 5.0)
QUAD = ((0.0, 0.0), (15.0, 0.0), (18.0, 12.0), (4.0, 14.0))
SQUARE = ((-40.0, -40.0), (40.0, -40.0), (40.0, 40.0), (-40.0, 40.0))
SHAPES = {
    "disc": Extent(radius_m=6.0),
    "segment": Extent(((0.0, 0.0), (20.0, 5.0))),
    "stadium": Extent(((0.0, 0.0), (20.0, 5.0)), 3.0),
    "polygon": Extent(QUAD),
    "rounded": Extent(QUAD, 2.0),
    "square": Extent(SQUARE),
}
MULTICOPTER = Cylinder(6.0, 3.0, 1.5)
GAMES = {
    "paper": Game(Ball(2.0), 1.0),
    "slow": Game(Ball(1.2), 1.0),
    "stand-off": Game(Ball(2.0), 1.0, standoff=DISC),
    "wind": Game(Ball(3.0), 1.0, 0.5, DISC, wind_m_s=(0.5, -0.3)),
    "moving": Game(Ball(3.0), 1.0, 0.5, target_velocity_m_s=(0.3, 0.1)),
    "cylinder": Game(MULTICOPTER, 3.0, standoff=DISC),
    "moving cylinder": Game(MULTICOPTER, 3.0, target_velocity_m_s=(-2.0, 1.0)),
    "everything": Game(
        MULTICOPTER, 3.0, 0.3, DISC, wind_m_s=(0.5, -0.3), target_velocity_m_s=(-2.0, 1.0)
    ),
}
FINE = 300
"""Points of an outline that are tried first."""


def states(count, seed):
    rng = np.random.default_rng(seed)
    P, E, T = rng.uniform(-40.0, 40.0, (3, count, 3))
    E[:, 2] = 0.0
    T[:, 2] = 0.0
    # Half of the pursuers are low: then an evader may pass them.
    P[:, 2] = np.abs(P[:, 2]) * np.where(rng.uniform(size=count) < 0.5, 1.0, 0.1)
    return P, E, T


def margins(game, P, E, X):
    """The evader's time to points that move with the target, less the pursuer's, found by bisection."""
    v = game.evader_speed_m_s
    drift = np.array(game.target_velocity_m_s)
    way = X - E[..., :2]
    half = (way * drift).sum(axis=-1)
    hand = v * v - drift @ drift
    arrival = (half + np.sqrt(half * half + hand * (way * way).sum(axis=-1))) / hand
    goal = X + drift * arrival[..., None] - P[..., :2]
    height = np.abs(P[..., 2] - game.standoff.height_m)
    speeds = game.pursuer
    low = np.zeros_like(arrival)
    high = np.full_like(arrival, 500.0)
    for _ in range(55):
        t = 0.5 * (low + high)
        beside = np.linalg.norm(goal - np.array(game.wind_m_s) * t[..., None], axis=-1)
        beside = np.maximum(beside - game.standoff.radius_m, 0.0)
        if isinstance(speeds, Ball):
            there = np.hypot(beside, height) <= speeds.speed_m_s * t + game.capture_radius_m
        else:
            above = P[..., 2] > game.standoff.height_m
            vertical = np.where(above, speeds.descent_m_s, speeds.climb_m_s)
            there = (beside <= speeds.horizontal_m_s * t + game.capture_radius_m) & (
                height <= vertical * t + game.capture_radius_m
            )
        high = np.where(there, t, high)
        low = np.where(there, low, t)
    return arrival - high


def outline(shape, share):
    """Points of a shape's outline by the share of the way around it."""
    corners = np.array(shape.corners_m)
    after = np.roll(corners, -1, axis=0)
    ways = after - corners
    lengths = np.linalg.norm(ways, axis=-1)
    if len(corners) == 1:
        turns = np.array([2.0 * np.pi])
        lengths = np.zeros(1)
        headings = np.zeros(1)
    else:
        headings = np.arctan2(ways[:, 1], ways[:, 0]) - 0.5 * np.pi
        turns = (np.roll(headings, -1) - headings) % (2.0 * np.pi)
    ends = np.cumsum(np.stack([lengths, shape.radius_m * turns], axis=-1).ravel())
    at = (share % 1.0) * ends[-1]
    piece = np.searchsorted(ends, at, side="right").clip(0, len(ends) - 1)
    side = piece // 2
    along = at - np.concatenate([[0.0], ends])[piece]
    arc = piece % 2 == 1
    turned = headings[side] + np.where(arc, along / max(shape.radius_m, 1e-300), 0.0)
    straight = np.where(arc, lengths[side], along) / np.maximum(lengths[side], 1e-300)
    outward = np.stack([np.cos(turned), np.sin(turned)], axis=-1)
    return corners[side] + straight[..., None] * ways[side] + shape.radius_m * outward


def searched(game, P, E, T, rounds=8):
    """The least margin of the best pursuer: many points and the corners, then finer ones around the three best."""
    pursuers = np.atleast_3d(P).reshape(len(P), -1, 3).swapaxes(0, 1)[:, :, None]
    E = E[:, None]
    T = T[:, None]
    shape = game.target_extent

    def margin_of_best(X):
        return np.max([margins(game, pursuer, E, X) for pursuer in pursuers], axis=0)

    def judged(share):
        return margin_of_best(T[..., :2] + outline(shape, share))

    share = np.broadcast_to(np.arange(FINE) / FINE, (len(P), FINE))
    first = judged(share)
    local = np.where(
        (first <= np.roll(first, 1, axis=1)) & (first <= np.roll(first, -1, axis=1)), first, np.inf
    )
    least = first.min(axis=1)
    if shape.radius_m == 0.0:
        at_corners = margin_of_best(T[..., :2] + np.array(shape.corners_m))
        least = np.minimum(least, at_corners.min(axis=1))
    middle = np.argsort(local, axis=1)[:, :3] / FINE
    width = 1.0 / FINE
    for _ in range(rounds):
        tried = middle[..., None] + width * np.linspace(-1.0, 1.0, 13)
        found = judged(tried.reshape(len(P), -1)).reshape(tried.shape)
        middle = np.take_along_axis(tried, found.argmin(axis=2)[..., None], axis=2)[..., 0]
        least = np.minimum(least, found.min(axis=(1, 2)))
        width /= 4.0
    return least


def compared(game, shape, count, seed):
    game = replace(game, target_extent=shape)
    P, E, T = states(count, seed)
    answer = solve(game, P, E, T)
    outside = np.array([shape.distance_m(t, e) > 0.0 for t, e in zip(T, E, strict=True)])
    np.testing.assert_allclose(
        answer.margin_s[outside], searched(game, P, E, T)[outside], atol=1e-8
    )
    value = np.where(answer.winner == Winner.PURSUER, answer.value, 0.0)
    assert np.all(value >= 0.0)
    return answer


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
@pytest.mark.parametrize("game", GAMES.values(), ids=GAMES)
def test_the_margin_is_the_least_over_the_whole_shape(game, shape):
    compared(game, shape, 10, seed=5)


@pytest.mark.long
@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
@pytest.mark.parametrize("game", GAMES.values(), ids=GAMES)
def test_the_margin_is_the_least_over_the_whole_shape_in_a_thousand_states(game, shape):
    compared(game, shape, 1000, seed=11)


KINKS = {"paper": (10, 16, 27, 42), "everything": (19, 27, 75, 96, 116, 188)}
"""States in which some shape's least margin is at a kink, where the margins of two pursuers are equal."""


def compared_teams(game, shape, count, seed, rows=...):
    game = replace(game, target_extent=shape)
    P, E, T = (part[rows] for part in states(count, seed))
    others = states(count, seed + 1)[0][rows]
    P = np.stack([P, others], axis=1)
    answer = solve_team(game, P, E, T)
    outside = np.array([shape.distance_m(t, e) > 0.0 for t, e in zip(T, E, strict=True)])
    expected = searched(game, P, E, T, rounds=14)
    np.testing.assert_allclose(answer.margin_s[outside], expected[outside], atol=1e-8)


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
@pytest.mark.parametrize("name", KINKS)
def test_the_margin_of_a_team_is_the_least_over_the_whole_shape(name, shape):
    compared_teams(GAMES[name], shape, 600, seed=8, rows=list(KINKS[name]))


@pytest.mark.long
@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
@pytest.mark.parametrize("game", GAMES.values(), ids=GAMES)
def test_the_margin_of_a_team_is_the_least_over_the_whole_shape_in_a_thousand_states(game, shape):
    compared_teams(game, shape, 1000, seed=21)


def test_a_moving_disc_is_lost_where_the_evader_meets_it_first():
    # The point that is nearest now is not the one that a moving target brings to the evader first.
    game = Game(
        MULTICOPTER, 3.0, target_velocity_m_s=(-2.0, 1.0), target_extent=Extent(radius_m=12.0)
    )
    answer = solve(game, [2.0, -9.0, 22.0], [-21.0, -24.0, 0.0], [14.0, 16.0, 0.0])
    assert answer.winner == Winner.EVADER
    assert float(answer.margin_s) == pytest.approx(-0.467, abs=1e-3)


def test_an_evader_that_may_be_at_a_moving_side_already_has_the_least_margin_along_it():
    game = Game(
        Cylinder(12.0, 3.0, 1.5),
        3.0,
        0.2,
        DISC,
        information_age_s=0.4,
        target_velocity_m_s=(1.5, -1.0),
    )
    P = [-23.55, 24.28, 4.88]
    E = [13.53, -7.36, 0.0]
    T = np.array([1.78, -7.3, 0.0])
    shaped = replace(game, target_extent=Extent(QUAD))
    along_first_side = np.linspace(0.0, 15.0, 1501)[:, None] * np.array([1.0, 0.0, 0.0])
    tried = solve(game, P, E, T + along_first_side).margin_s
    assert solve(shaped, P, E, T).margin_s <= tried.min() + 1e-9


@pytest.mark.parametrize("size_m", [1e4, 1e6, 1e7])
def test_a_large_shape_has_the_answer_of_its_nearest_edge(size_m):
    near = 100.0
    P, E, _ = states(200, seed=3)
    E[:, 1] = 1.0 + np.abs(E[:, 1])
    for game in GAMES.values():
        answers = []
        for half_m in (near, size_m):
            square = Extent(
                [(x * half_m, y * half_m) for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
            )
            fixed = replace(game, target_extent=square, target_velocity_m_s=(0.0, 0.0))
            answers.append(solve(fixed, P, E, np.array([0.0, -half_m, 0.0])))
        small, large = answers
        np.testing.assert_array_equal(small.winner, large.winner)
        np.testing.assert_allclose(large.margin_s, small.margin_s, atol=1e-8)
        np.testing.assert_allclose(large.value, small.value, atol=1e-7)


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_several_pursuers_against_each_evader_are_their_single_states(shape):
    # Some evaders are inside the shape, so that rows are chosen by the evader alone.
    game = replace(GAMES["stand-off"], target_extent=shape)
    P, E, _ = states(12, seed=4)
    E[:2] = 5.0, 2.0, 0.0
    answer = solve(game, P[:, None], E, np.zeros(3))
    for index in np.ndindex(4, 4):
        single = solve(game, P[index[0]], E[index[1]], np.zeros(3))
        np.testing.assert_array_equal(answer.margin_s[index], single.margin_s)
