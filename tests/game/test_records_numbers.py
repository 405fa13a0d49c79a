"""Numbers of any kind are real numbers, in the widest precision among them; those that are too large are a reason."""

from dataclasses import replace
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from guidance.errors import ConfigError
from guidance.game import (
    EVADER_POLICIES,
    PURSUER_POLICIES,
    Ball,
    Cylinder,
    Game,
    Reason,
    StandOff,
    Winner,
    apollonius_circle,
    apollonius_sphere,
    barrier,
    rollout,
    solve,
)
from guidance.game.records import is_zero
from guidance.game.verification import hji_residual, value_gradient
from guidance.strategies.navigation import StrategyMemory, proportional_navigation

PAPER = Game(Ball(2.0), 1.0)
WHOLE = ([3, 4, 10], [0, 0, 0], [30, 1, 0])
KINDS = {
    "int": np.array,
    "int8": lambda values: np.array(values, dtype=np.int8),
    "unsigned": lambda values: np.array(values, dtype=np.uint64),
    "list": list,
    "tuple": tuple,
    "fractions": lambda values: [Fraction(value) for value in values],
    "decimals": lambda values: np.array([Decimal(value) for value in values]),
    "rows": lambda values: np.array([values, values]),
    "folded": lambda values: [[values], [values]],
}


def same(a, b):
    return all(
        np.array_equal(x, np.broadcast_to(y, x.shape)) and x.dtype == y.dtype
        for x, y in zip(a, b, strict=True)
    )


@pytest.mark.parametrize("kind", KINDS)
def test_whole_numbers_are_real_numbers(games, kind):
    whole = [KINDS[kind](values) for values in WHOLE]
    real = [np.array(values, dtype=float) for values in WHOLE]
    for game in games.values():
        assert same(solve(game, *whole[:2]), solve(game, *real[:2]))
        assert same(
            solve(game, *whole, evader_velocity_m_s=whole[1]),
            solve(game, *real, evader_velocity_m_s=real[1]),
        )
    assert solve(PAPER, *whole).value.flat[0] == pytest.approx(24.4210, abs=1e-4)


def test_every_function_takes_whole_numbers():
    """Catches a function that computes in whole numbers if its arguments are whole."""
    whole = [np.array(values) for values in WHOLE]
    real = [np.array(values, dtype=float) for values in WHOLE]
    for catalogue in (PURSUER_POLICIES, EVADER_POLICIES):
        for policy in catalogue.values():
            np.testing.assert_array_equal(
                policy(PAPER, *whole, whole[1]), policy(PAPER, *real, real[1])
            )
    for shape in (apollonius_circle, apollonius_sphere):
        assert same(shape(*whole[:2], 2), shape(*real[:2], 2.0))
    assert barrier(*whole, 2) == barrier(*real, 2.0)
    assert same(value_gradient(PAPER, *whole), value_gradient(PAPER, *real))
    assert hji_residual(PAPER, *whole) == hji_residual(PAPER, *real)
    assert rollout(PAPER, *whole).time_s == rollout(PAPER, *real).time_s
    steered = [
        proportional_navigation(PAPER, *three, StrategyMemory(), dt_s=0.1, gain=3.0)
        for three in (whole, real)
    ]
    np.testing.assert_array_equal(*steered)


def test_parameters_of_any_kind_are_real_numbers():
    state = [np.array(values, dtype=float) for values in WHOLE]
    plain = Game(Ball(4.0), 2.0, 1.0, StandOff(2.0, 1.0), wind_m_s=(1.0, 0.0))
    for number in (int, np.int8, np.float32, Fraction, Decimal, np.float64):
        game = Game(
            Ball(number(4)),
            number(2),
            number(1),
            StandOff(number(2), number(1)),
            wind_m_s=(number(1), number(0)),
        )
        assert game == plain
        assert hash(game) == hash(plain)
        assert same(solve(game, *state), solve(plain, *state))
    rows = [np.tile(values, (3, 1)) for values in state]
    big = np.array([100, 100, 100], dtype=np.int8)
    assert same(solve(Game(Ball(big), big // 2), *rows), solve(Game(Ball(100.0), 50.0), *rows))


@pytest.mark.parametrize(
    ("kinds", "wide"),
    [
        ((np.float32, np.float64, np.float32), np.float64),
        ((np.float64, np.float32, np.float32), np.float64),
        ((np.float32, np.float32, np.float32), np.float32),
        ((np.float32, np.int32, np.float32), np.float64),
        ((np.float32, np.float32, np.longdouble), np.longdouble),
    ],
)
def test_the_answer_has_the_widest_precision(games, kinds, wide):
    for name in ("paper", "ball_everything", "cylinder_everything"):
        given = [np.array(values, dtype=kind) for values, kind in zip(WHOLE, kinds, strict=True)]
        solution = solve(games[name], *given)
        plain = solve(games[name], *WHOLE)
        assert {field.dtype for field in solution[1:-1]} == {np.dtype(wide)}
        np.testing.assert_allclose(solution.value.astype(float), plain.value, rtol=1e-5)


def test_parameters_that_vary_have_a_precision_too():
    rows = [np.tile(np.array(values, dtype=np.float32), (2, 1)) for values in WHOLE]
    assert solve(Game(Ball(np.array([2.0, 3.0])), 1.0), *rows).value.dtype == np.float64
    assert (
        solve(Game(Ball(np.array([2.0, 3.0], dtype=np.float32)), 1.0), *rows).value.dtype
        == np.float32
    )


def test_games_with_rows_are_equal_and_hashed_by_their_numbers():
    one, other = (
        Game(Ball(np.array([2.0, 3.0])), 1.0, np.array([0.0, zero])) for zero in (0.0, -0.0)
    )
    assert one == other
    assert hash(one) == hash(other)
    assert one != Game(Ball(np.array([2.0, 4.0])), 1.0)
    assert one != Game(Ball(np.array([[2.0, 3.0]])), 1.0, np.array([0.0, 0.0]))
    assert one != Game(Ball(np.array([2.0, 3.0])), 1.0, np.array([0.0, 1e-20]))
    assert Game(Ball(2.0), 1.0) != Ball(2.0)
    assert Ball(2.0) != "ball"
    assert (
        len({Ball(2), Ball(2.0), Ball(3.0), Cylinder(2, 2, 2), StandOff(2, 2), StandOff(2.0, 2.0)})
        == 4
    )
    assert replace(one, capture_radius_m=1) == replace(other, capture_radius_m=1.0)


HUGE = {
    "places": (PAPER, 1e160, np.float64),
    "single": (PAPER, 1e20, np.float32),
    "fast": (Game(Ball(1e160), 1.0), 1.0, np.float64),
    "standoff": (Game(Ball(2.0), 1.0, standoff=StandOff(3.0, 2.0)), 1e160, np.float64),
    "cylinder": (Game(Cylinder(2.0, 1.0, 1.0), 1.0), 1e200, np.float64),
    "windy": (Game(Ball(2.0), 1.0, wind_m_s=(0.1, 0.2)), 1e300, np.float64),
    "largest": (PAPER, 1.7e308, np.float64),
}


@pytest.mark.parametrize("name", HUGE)
@pytest.mark.parametrize("with_target", [False, True])
def test_what_overflows_is_a_reason_alone_and_in_a_batch(name, with_target):
    game, size, kind = HUGE[name]
    P, E, T = (
        size * np.array(place, dtype=kind)
        for place in ([0.5, 0.3, 0.7], [-0.2, 0.4, 0.0], [0.1, -0.9, 0.0])
    )
    given = (P, E, T) if with_target else (P, E)
    solution = solve(game, *given)
    assert solution.reason == Reason.OVERFLOW
    assert solution.winner == Winner.UNDECIDED
    assert all(np.isnan(field).all() for field in solution[1:-1])
    rows = solve(
        game,
        *(
            np.stack([place, place * kind(1e-300 if size > 1e30 else 1e-20), place])
            for place in given
        ),
    )
    expected = (
        [Reason.OVERFLOW] * 3
        if name == "fast"
        else [Reason.OVERFLOW, rows.reason[1], Reason.OVERFLOW]
    )
    assert rows.reason.tolist() == expected
    if name != "fast":
        assert rows.reason[1] < Reason.NOT_FINITE
        assert np.isfinite(rows.value[1])


def test_nothing_solved_is_ever_infinite(games):
    """From sizes that vanish when squared to sizes that do not fit."""
    rng = np.random.default_rng(2)
    states = rng.uniform(-1.0, 1.0, (3, 400, 3)) * 10.0 ** rng.uniform(-170.0, 170.0, (400, 1))
    states[1:, :, 2] = 0.0
    for name, game in games.items():
        for given in (states[:2], states):
            solution = solve(game, *given)
            solved = solution.reason < Reason.NOT_FINITE
            aged = solution.reason == Reason.NO_REGION
            assert not aged.any() or (game.information_age_s > 0.0 and len(given) == 3), name
            assert (solution.reason[~solved & ~aged] == Reason.OVERFLOW).all(), name
            for field in (solution.value, solution.meeting_time_s, *solution[3:4], *solution[5:7]):
                assert np.isfinite(field[solved]).all(), name
            size = np.abs(np.stack(given)).max(axis=(0, 2))
            assert not solved[size > 1e155].any(), name
            assert (solved | aged)[size < 1e150].all(), name


def test_undecided_is_worth_nothing():
    """T in both sets at once: the evader is there, and the pursuer holds it captured there."""
    for game in (
        Game(Ball(2.0), 1.0, 1.5),
        Game(Ball(2.0), 1.0, standoff=StandOff(3.0, 0.0)),
        Game(Cylinder(2.0, 1.0, 1.0), 1.0, 1.0),
        Game(Ball(2.0), 1.0, standoff=StandOff(3.0, 0.0), information_age_s=2.0),
    ):
        for T in ([0.0, 0.0, 0.0], [0.2, 0.1, 0.0]):
            solution = solve(
                game, [0.5, 0.0, 0.2 if game.capture_radius_m else 0.0], [0.0, 0.0, 0.0], T
            )
            if solution.winner == Winner.UNDECIDED:
                assert solution.value == 0.0
                assert solution.margin_s == 0.0
                np.testing.assert_array_equal(solution.meeting_point_m, T)
        assert solve(game, [0.5, 0.0, 0.0], np.zeros(3), np.zeros(3)).winner == Winner.UNDECIDED


def test_capture_radii_of_zero_are_none():
    rng = np.random.default_rng(1)
    states = rng.uniform(-9.0, 9.0, (3, 50, 3)) * [1.0, 1.0, 0.0]
    zero = np.zeros(50)
    rows = Game(Ball(2.0), 1.0, zero, StandOff(zero, zero), information_age_s=zero)
    assert same(solve(rows, *states), solve(PAPER, *states))


def test_rows_of_the_papers_game_among_others_are_answered_as_alone():
    rng = np.random.default_rng(1)
    states = rng.uniform(-9.0, 9.0, (3, 60, 3)) * [1.0, 1.0, 0.0]
    states[0, :, 2] = 3.0
    radius = np.where(np.arange(60) % 2, 0.0, 1.0)
    for speeds in (Ball(2.0), Cylinder(2.0, 1.0, 1.0)):
        rows = solve(Game(speeds, 1.0, radius), *states)
        alone = solve(Game(speeds, 1.0), *(array[1::2] for array in states))
        assert same([field[1::2] for field in rows], alone)


def test_an_earlier_answer_of_another_shape_is_refused():
    earlier = solve(PAPER, np.zeros((4, 3)), np.ones((4, 3)))
    with pytest.raises(
        ConfigError, match=r"out: its leading shape is \(4,\); must be that of the states, \(5,\)"
    ):
        solve(PAPER, np.zeros((5, 3)), np.ones((5, 3)), out=earlier)
    with pytest.raises(ConfigError, match=r"out: .*must be that of the states, \(9000,\)"):
        solve(PAPER, np.zeros((9000, 3)), np.ones((9000, 3)), out=earlier)


def test_long_batches_of_any_shape_are_solved_in_chunks():
    rng = np.random.default_rng(1)
    states = rng.uniform(-9.0, 9.0, (3, 20000, 3)) * [1.0, 1.0, 0.0]
    flat = solve(PAPER, *states)
    folded = solve(PAPER, *(array.reshape(200, 100, 3) for array in states))
    assert folded.value.shape == (200, 100)
    assert all(np.array_equal(a.ravel(), b.ravel()) for a, b in zip(flat, folded, strict=True))
    speeds = np.linspace(2.0, 3.0, 200)[:, None]
    crossed = solve(Game(Ball(speeds), 1.0), states[0][:100], states[1][0], states[2][:100])
    assert crossed.value.shape == (200, 100)
    one = solve(Game(Ball(float(speeds[7, 0])), 1.0), states[0][3], states[1][0], states[2][3])
    assert crossed.value[7, 3] == one.value


def test_what_is_zero_in_every_row_is_switched_off():
    for off in (0.0, np.float64(0.0), np.zeros(3)):
        assert is_zero(off)
    for on in (0.5, np.float64(0.5), 1.0, np.float64(1.0), np.array([0.0, 1.0])):
        assert not is_zero(on)


@pytest.mark.parametrize(
    "build",
    [
        lambda: Ball(np.array([2.0 + 1.0j, 3.0])),
        lambda: Game(Ball(2.0), 1.0, capture_radius_m=np.array([1.0j])),
        lambda: Game(Ball(2.0), 1.0, wind_m_s=(np.array([0.1j]), 0.0)),
    ],
)
def test_complex_parameters_are_refused_by_name(build):
    with pytest.raises(
        ConfigError, match=r"(speed_m_s|capture_radius_m|wind_m_s) = .*real numbers"
    ):
        build()
