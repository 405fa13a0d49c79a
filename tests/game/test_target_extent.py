"""Targets with an extent, against a search over headings that knows nothing of the solver, and against points."""

from dataclasses import replace

import numpy as np
import pytest

from guidance.errors import ConfigError
from guidance.game import (
    Ball,
    Cylinder,
    Exact,
    Extent,
    Game,
    StandOff,
    Winner,
    rollout,
    solve,
    solve_state,
)
from guidance.game.team import solve_team

DISC = StandOff(3.0, 5.0)
GAMES = {
    "paper": Game(Ball(2.0), 1.0),
    "stand-off": Game(Ball(2.0), 1.0, standoff=DISC),
    "cylinder": Game(Cylinder(4.0, 2.0, 1.0), 2.0, standoff=DISC),
    "wind": Game(Ball(3.0), 1.0, capture_radius_m=0.5, standoff=DISC, wind_m_s=(0.5, -0.3)),
    "moving": Game(Ball(3.0), 1.0, capture_radius_m=0.5, target_velocity_m_s=(0.3, 0.1)),
    "cylinder in wind": Game(Cylinder(4.0, 2.0, 1.0), 2.0, standoff=DISC, wind_m_s=(0.5, -0.3)),
}
QUAD = ((0.0, 0.0), (15.0, 0.0), (18.0, 12.0), (4.0, 14.0))
SHAPES = {
    "disc": Extent(radius_m=6.0),
    "segment": Extent(((0.0, 0.0), (20.0, 5.0))),
    "stadium": Extent(((0.0, 0.0), (20.0, 5.0)), 3.0),
    "polygon": Extent(QUAD),
    "rounded": Extent(QUAD, 2.0),
}


def states(count, seed=1):
    rng = np.random.default_rng(seed)
    P, E, T = rng.uniform(-40.0, 40.0, (3, count, 3))
    P[:, 2] = 6.0 + 0.5 * abs(P[:, 2])
    E[:, 2] = 0.0
    T[:, 2] = 0.0
    return P, E, T


def distance(shape, x, y):
    """Distance of places from a shape, by the definition: the least over the lines of its polygon; 0 inside."""
    corners = np.array(shape.corners_m)
    gaps = []
    inside = len(corners) > 2
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        way = b - a
        share = np.clip(
            ((x - a[0]) * way[0] + (y - a[1]) * way[1]) / max(way @ way, 1e-300), 0.0, 1.0
        )
        gaps.append(np.hypot(x - a[0] - share * way[0], y - a[1] - share * way[1]))
        inside = inside & (way[0] * (y - a[1]) - way[1] * (x - a[0]) >= 0.0)
    return np.maximum(np.where(inside, 0.0, np.min(gaps, axis=0)) - shape.radius_m, 0.0)


def is_caught(game, P, X, t):
    away = np.hypot(*(X - P[:2] - t[:, None] * np.array(game.wind_m_s)).T) - game.standoff.radius_m
    high = abs(P[2] - game.standoff.height_m)
    reach = game.capture_radius_m
    if isinstance(game.pursuer, Ball):
        return np.hypot(np.maximum(away, 0.0), high) <= game.pursuer.speed_m_s * t + reach
    speed = game.pursuer
    vertical = speed.descent_m_s if P[2] > game.standoff.height_m else speed.climb_m_s
    return (away - reach <= speed.horizontal_m_s * t) & (high - reach <= vertical * t)


def ends(game, pursuers, E, headings):
    """Ends of straight runs, found by bisection from the definition of the capture, and their times."""
    n = np.stack([np.cos(headings), np.sin(headings)], axis=-1)
    low = np.zeros(len(n))
    high = np.full(len(n), 1e3)
    for _ in range(60):
        t = 0.5 * (low + high)
        X = E[:2] + game.evader_speed_m_s * t[:, None] * n
        got = np.any([is_caught(game, P, X, t) for P in pursuers], axis=0)
        low = np.where(got, low, t)
        high = np.where(got, t, high)
    return E[:2] + game.evader_speed_m_s * high[:, None] * n, high


def searched(game, pursuers, E, T):
    """Least distance of an end from the target's set: many headings, then finer ones around the best."""
    middle = 0.0
    width = np.pi
    for count in (1201, 201, 201, 201, 201):
        headings = middle + width * np.linspace(-1.0, 1.0, count)
        X, t = ends(game, pursuers, E, headings)
        x, y = (X - T[:2] - t[:, None] * np.array(game.target_velocity_m_s)).T
        gaps = distance(game.target_extent, x, y)
        best = np.argmin(gaps)
        middle = headings[best]
        width = 4.0 * width / (count - 1)
    return gaps[best]


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
@pytest.mark.parametrize("game", GAMES.values(), ids=GAMES)
def test_the_value_is_the_distance_between_region_and_set(game, shape):
    game = replace(game, target_extent=shape)
    P, E, T = states(3)
    answer = solve(game, P, E, T)
    won = answer.winner == Winner.PURSUER
    found = np.array([searched(game, P[row : row + 1], E[row], T[row]) for row in range(3)])
    np.testing.assert_allclose(answer.value[won], found[won], atol=1e-8)
    assert not np.any(found[~won] > 1e-9) or not np.any(answer.margin_s[~won] > 0.0)
    assert np.any(won)


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
@pytest.mark.parametrize("game", GAMES.values(), ids=GAMES)
def test_both_players_values_change_at_equal_rates_along_their_play(game, shape):
    # Isaacs' equation: max over the evader and min over the pursuer of dV/dt is zero along both optimal velocities.
    game = replace(game, target_extent=shape, target_velocity_m_s=(0.0, 0.0))
    P, E, T = states(30, seed=3)
    answer = solve(game, P, E, T)
    h = 1e-4
    later, sooner = (
        solve(
            game, P + s * h * answer.pursuer_velocity_m_s, E + s * h * answer.evader_velocity_m_s, T
        )
        for s in (1.0, -1.0)
    )
    same = (
        (answer.winner == Winner.PURSUER)
        & (later.winner == answer.winner)
        & (sooner.winner == answer.winner)
    )
    rate = (later.value - sooner.value) / (2.0 * h)
    assert np.count_nonzero(same) > 10
    np.testing.assert_allclose(np.sort(abs(rate[same]))[:-2], 0.0, atol=1e-5)


@pytest.mark.parametrize("game", GAMES.values(), ids=GAMES)
def test_a_polygon_of_one_corner_is_the_point_to_the_bit(game):
    P, E, T = states(200)
    corner = replace(game, target_extent=Extent(((7.0, -3.0),)))
    zero = np.zeros(3)
    for one, other in zip(
        solve(corner, P, E, zero), solve(game, P, E, np.array([7.0, -3.0, 0.0])), strict=True
    ):
        np.testing.assert_array_equal(one, other)
    for one, other in zip(
        solve(game, P, E, T), solve(replace(game, target_extent=Extent()), P, E, T), strict=True
    ):
        np.testing.assert_array_equal(one, other)


def test_single_states_and_batches_have_the_same_bits():
    P, E, T = states(40)
    for game in GAMES.values():
        shaped = replace(game, target_extent=SHAPES["rounded"])
        batch = solve(shaped, P, E, T)
        for row in range(0, 40, 5):
            one = solve_state(shaped, *(tuple(place[row].tolist()) for place in (P, E, T)))
            for field, value in zip(batch, one, strict=True):
                np.testing.assert_array_equal(field[row], value)


def test_an_evader_that_wins_runs_to_where_it_arrives_before_the_pursuer_by_most():
    shape = Extent(QUAD, 1.0)
    game = Game(Ball(2.0), 1.0, target_extent=shape)
    P, E, T = states(80, seed=5)
    answer = solve(game, P, E, T)
    rows = np.flatnonzero((answer.winner == Winner.EVADER) & (answer.meeting_time_s > 0.0))
    assert len(rows) > 8
    around = np.random.default_rng(0).uniform(-2.0, 20.0, (4000, 2))
    inside = around[distance(shape, *around.T) == 0.0]
    for row in rows:
        places = T[row, :2] + inside
        sooner = np.hypot(*(places - E[row, :2]).T) - 0.5 * np.hypot(
            np.hypot(*(places - P[row, :2]).T), P[row, 2]
        )
        assert answer.margin_s[row] <= sooner.min() + 1e-12
        assert distance(shape, *(answer.meeting_point_m[row, :2] - T[row, :2])) < 1e-9


@pytest.mark.parametrize(
    "evader", ["optimal", pytest.param("task_oriented", marks=pytest.mark.long)]
)
def test_an_optimal_pursuer_keeps_the_distance_whatever_the_evader_plays(evader):
    game = Game(Ball(2.0), 1.0, standoff=DISC, target_extent=SHAPES["polygon"])
    P, E, T = (0.5 * place for place in states(3, seed=8))
    value = solve(game, P, E, T)
    step = Exact(0.25, order=1)
    ended = rollout(game, P, E, T, evader_policy=evader, stepping=step, duration_s=60.0)
    won = value.winner == Winner.PURSUER
    assert np.all(ended.distance_m[won] >= value.value[won] - 0.3)
    if evader == "optimal":
        np.testing.assert_allclose(ended.distance_m[won], value.value[won], atol=0.3)


def test_two_pursuers_defend_a_line_that_neither_defends_alone():
    game = Game(Ball(1.3), 1.0, target_extent=Extent(((-30.0, 0.0), (30.0, 0.0))))
    P = np.array([[-28.0, 0.0, 0.0], [28.0, 0.0, 0.0]])
    E = np.array([0.0, 30.0, 0.0])
    T = np.zeros(3)
    assert {int(solve(game, one, E, T).winner) for one in P} == {Winner.EVADER}
    answer = solve_team(game, P, E, T)
    assert answer.winner == Winner.PURSUER
    assert float(answer.value) == pytest.approx(searched(game, P, E, T), abs=1e-6)


@pytest.mark.parametrize(
    "shape", [SHAPES[name] for name in ("disc", "stadium", "polygon", "rounded")]
)
def test_the_outline_goes_once_around_the_shape(shape):
    corners = np.array(shape.corners_m)
    outline = np.array(shape.outline_m())
    around = (
        np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=-1).sum()
        + 2.0 * np.pi * shape.radius_m
    )
    drawn = np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=-1).sum()
    assert 0.99 * around < drawn <= around * (1.0 + 1e-12)
    assert np.all(distance(shape, *outline.T) < 1e-9)


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        ((), "one or more pairs"),
        (((0.0, 0.0, 0.0),), "one or more pairs"),
        (((0.0, float("nan")),), "one or more pairs"),
        (
            ((0.0, 0.0), (4.0, 0.0), (0.0, 4.0), (1.0, 1.0)),
            r"\(1, 1\) is no corner of a convex polygon",
        ),
        (((0.0, 0.0), (0.0, 0.0)), r"\(0, 0\) is no corner"),
    ],
)
def test_a_shape_that_is_not_convex_is_refused_with_the_corner(corners, words):
    with pytest.raises(ConfigError, match=words):
        Extent(corners)


def test_an_evader_in_space_has_a_point_for_a_target():
    with pytest.raises(ConfigError, match="evader_space"):
        Game(Ball(2.0), 1.0, evader_space="space", target_extent=Extent(radius_m=1.0))


def test_a_point_has_no_outline_and_a_disc_has_one_of_its_radius():
    assert Extent().outline_m() == []
    assert {round(float(np.hypot(*point)), 9) for point in Extent(radius_m=6.0).outline_m()} == {
        6.0
    }
