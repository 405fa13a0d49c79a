"""The same function gives the same bits for one state and in any batch."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.errors import ConfigError
from guidance.game import (
    EVADER_POLICIES,
    PURSUER_POLICIES,
    Ball,
    Cylinder,
    End,
    Game,
    Reason,
    StandOff,
    Winner,
    solve,
    solve_state,
)
from guidance.game import solution as solving
from guidance.game.verification import value_gradient
from tests.game.bits import same
from tests.harness.examples import drawn


def assert_rows_equal_singles(answer, singles):
    for name, field in answer._asdict().items():
        for row, single in zip(field, singles, strict=True):
            one = getattr(single, name)
            assert np.asarray(row).tobytes() == np.asarray(one, dtype=field.dtype).tobytes(), name


@settings(max_examples=drawn(4), deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 40))
def test_a_batch_is_its_singles_in_every_game(games, oracle, seed, count):
    for game in games.values():
        P, E, T = oracle.states(seed, count, game)
        seen = np.random.default_rng(seed).normal(size=(count, 3))
        P[0, :2] = E[0, :2]
        for target in (None, T):
            answer = solve(game, P, E, target, evader_velocity_m_s=seen)
            singles = [
                solve(
                    game, P[i], E[i], None if target is None else T[i], evader_velocity_m_s=seen[i]
                )
                for i in range(min(count, 12))
            ]
            head = type(answer)(*(field[: len(singles)] for field in answer))
            assert_rows_equal_singles(head, singles)
            vectors = (P, E, target, seen)
            plain = [
                solve_state(game, *three, evader_velocity_m_s=moving)
                for *three, moving in (
                    [None if vector is None else tuple(vector[i].tolist()) for vector in vectors]
                    for i in range(len(singles))
                )
            ]
            assert_rows_equal_singles(head, plain)
            assert {
                type(number)
                for one in plain
                for number in (one.winner, one.value, *one.meeting_point_m)
            } == {
                int,
                float,
            }


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1e200])
def test_a_state_without_an_answer_is_the_row_of_a_batch_in_plain_numbers_too(games, wrong):
    P = (wrong, 0.0, 9.0)
    E = (8.0, 3.0, 0.0)
    for game in games.values():
        row = solve(game, np.array([P]), np.array([E]))
        assert row.reason[0] >= Reason.NOT_FINITE
        assert_rows_equal_singles(row, [solve_state(game, P, E)])


def test_a_game_of_many_numbers_is_not_for_a_single_state():
    with pytest.raises(ConfigError, match="evader_speed_m_s"):
        solve_state(Game(Ball(6.0), np.array([3.0, 4.0])), (0.0, 0.0, 9.0), (8.0, 3.0, 0.0))


@settings(max_examples=drawn(10), deadline=None)
@given(seed=st.integers(0, 2**32 - 1), precision=st.sampled_from([np.float32, np.float64]))
def test_the_layout_in_memory_does_not_matter(games, oracle, seed, precision):
    for name in ("paper", "ball_standoff", "cylinder_everything"):
        P, E, T = (array.astype(precision) for array in oracle.states(seed, 24))
        plain = solve(games[name], P, E, T)
        folded = solve(games[name], *(array.reshape(2, 3, 4, 3) for array in (P, E, T)))
        fortran = solve(games[name], *(np.asfortranarray(array) for array in (P, E, T)))
        backwards = solve(games[name], P[::-1], E[::-1], T[::-1])
        for a, b, c, d in zip(plain, folded, fortran, backwards, strict=True):
            assert same(a, b.reshape(a.shape))
            assert same(a, c)
            assert same(a, np.ascontiguousarray(d[::-1]))


def test_leading_axes_broadcast(games, oracle):
    P, E, T = oracle.states(3, 20)
    crossed = solve(games["paper"], P[:5, None], E[None, 5:12], T[0])
    assert crossed.value.shape == (5, 7)
    assert crossed.pursuer_velocity_m_s.shape == (5, 7, 3)
    assert crossed.value[3, 4] == solve(games["paper"], P[3], E[9], T[0]).value
    few = solve(games["ball_standoff"], P[:5, None], E[None, 5:12], T[0])
    whole = solve(games["ball_standoff"], *np.broadcast_arrays(P[:5, None], E[None, 5:12], T[0]))
    assert all(same(a, b) for a, b in zip(few, whole, strict=True))


def test_single_precision_stays_single_and_close(games, oracle):
    P, E, T = oracle.states(4, 200)
    for name in ("paper", "capture_radius", "cylinder_standoff"):
        single = solve(games[name], *(array.astype(np.float32) for array in (P, E, T)))
        double = solve(games[name], P, E, T)
        for field in ("value", "meeting_point_m", "pursuer_velocity_m_s", "margin_s"):
            assert getattr(single, field).dtype == np.float32
        clear = np.abs(double.margin_s) > 1e-3
        np.testing.assert_allclose(single.value[clear], double.value[clear], rtol=2e-4, atol=2e-3)


@pytest.mark.parametrize("rows", [1, 7])
def test_chunks_join_to_the_whole(games, oracle, rows, monkeypatch):
    P, E, T = oracle.states(5, 100)
    seen = 0.1 * E
    for game in (games["paper"], games["cylinder_standoff"]):
        for target in (None, T):
            whole = solve(game, P, E, target, evader_velocity_m_s=seen)
            with monkeypatch.context() as patched:
                patched.setattr(solving, "ROWS", rows)
                parts = solve(game, P, E, target, evader_velocity_m_s=seen)
            assert all(same(a, b) for a, b in zip(whole, parts, strict=True))


@pytest.mark.parametrize("rows", [8, 8192])
def test_the_arrays_of_an_earlier_answer_are_filled_again(games, oracle, rows, monkeypatch):
    monkeypatch.setattr(solving, "ROWS", rows)
    P, E, T = oracle.states(6, 30)
    earlier = solve(games["paper"], P, E)
    again = solve(games["cylinder"], P, E, T, out=earlier)
    assert all(a is b for a, b in zip(again, earlier, strict=True))
    assert all(same(a, b) for a, b in zip(again, solve(games["cylinder"], P, E, T), strict=True))


def test_the_arrays_of_a_single_answer_are_filled_again(games, oracle):
    P, E, T = (array[0] for array in oracle.states(6, 1))
    earlier = solve(games["paper"], P, E)
    again = solve(games["paper"], P, E, T, out=earlier)
    assert all(a is b for a, b in zip(again, earlier, strict=True))
    assert all(same(a, b) for a, b in zip(again, solve(games["paper"], P, E, T), strict=True))


def test_chunks_of_two_leading_axes_join_to_the_whole(games, oracle, monkeypatch):
    P, E, T = (array.reshape(3, 10, 3) for array in oracle.states(6, 30))
    whole = solve(games["ball_everything"], P, E, T)
    monkeypatch.setattr(solving, "ROWS", 8)
    assert all(
        same(a, b) for a, b in zip(whole, solve(games["ball_everything"], P, E, T), strict=True)
    )


def test_parameters_broadcast_as_states_do(oracle):
    P, E, T = (array.reshape(4, 9, 3) for array in oracle.states(12, 36))
    radius = np.linspace(0.0, 2.0, 9)
    age = np.linspace(0.0, 3.0, 4)[:, None]
    speed = np.linspace(1.5, 3.0, 9)

    def game(spread):
        parts = [spread(part) for part in (speed, radius, age)]
        return Game(
            Ball(parts[0]), 1.0, standoff=StandOff(parts[1], 1.0), information_age_s=parts[2]
        )

    short = game(lambda part: part)
    full = game(lambda part: np.broadcast_to(part, (4, 9)).copy())
    for target in (None, T):
        few = solve(short, P, E, target)
        all_of_them = solve(full, P, E, target)
        assert all(same(a, b) for a, b in zip(few, all_of_them, strict=True))


def test_a_single_answer_has_no_minus_zero(games):
    for name in ("paper", "cylinder", "ball_standoff", "cylinder_standoff"):
        for x, y in ((9.0, 0.0), (-9.0, 0.0), (0.0, 9.0), (0.0, -9.0), (-6.0, -7.0)):
            for z in (0.0, 2.0, 5.0):
                P = np.array([x, y, z])
                E = np.zeros(3)
                for target in (None, P * [1.0, 1.0, 0.0], -P * [1.0, 1.0, 0.0], E):
                    for field in solve(games[name], P, E, target):
                        assert not np.signbit(field[field == 0.0]).any(), name


@pytest.mark.parametrize("evader", [(-0.0, 3.0, 0.0), (3.0, -0.0, -0.0), (0.0, 0.0, 0.0)])
@pytest.mark.parametrize("target", [None, (9.0, -0.0, 0.0), (-0.0, 9.0, 0.0), (0.0, -0.0, -0.0)])
def test_a_state_of_minus_zeros_has_none_in_its_answer(games, evader, target):
    for name in ("paper", "cylinder", "space"):
        answer = solve_state(games[name], (0.0, 0.0, 5.0), evader, target)
        flat = np.hstack([np.ravel(field) for field in answer])
        assert not np.signbit(flat[flat == 0.0]).any()


def test_no_rows_give_no_answers(games):
    answer = solve(games["paper"], np.empty((0, 3)), np.empty((0, 3)))
    assert answer.value.shape == (0,)
    assert answer.meeting_point_m.shape == (0, 3)


PER_ROW = {
    "ball": lambda n: Game(
        Ball(np.linspace(2.0, 4.0, n)),
        np.linspace(0.5, 1.5, n),
        capture_radius_m=np.linspace(0.1, 0.5, n),
        standoff=StandOff(np.linspace(0.0, 2.0, n), 1.0),
        information_age_s=np.linspace(0.0, 0.4, n),
    ),
    "cylinder": lambda n: Game(
        Cylinder(np.linspace(2.0, 4.0, n), np.linspace(0.5, 1.0, n), 0.7),
        np.linspace(0.5, 1.5, n),
        standoff=StandOff(1.0, np.linspace(0.0, 2.0, n)),
    ),
}


def one_row(game, index):
    def number(value):
        return float(value[index]) if np.ndim(value) else value

    pursuer = type(game.pursuer)(
        *(number(getattr(game.pursuer, name)) for name in game.pursuer.__slots__)
    )
    return Game(
        pursuer,
        number(game.evader_speed_m_s),
        capture_radius_m=number(game.capture_radius_m),
        standoff=StandOff(number(game.standoff.radius_m), number(game.standoff.height_m)),
        information_age_s=number(game.information_age_s),
    )


@pytest.mark.parametrize("kind", PER_ROW)
def test_parameters_may_differ_from_row_to_row(oracle, kind, monkeypatch):
    P, E, T = oracle.states(6, 30)
    game = PER_ROW[kind](30)
    assert game.varies
    for target in (None, T):
        answer = solve(game, P, E, target)
        with monkeypatch.context() as patched:
            patched.setattr(solving, "ROWS", 8)
            chunks = solve(game, P, E, target)
        assert all(same(a, b) for a, b in zip(answer, chunks, strict=True))
        for i in range(30):
            single = solve(one_row(game, i), P[i], E[i], None if target is None else T[i])
            np.testing.assert_allclose(answer.value[i], single.value, rtol=1e-12)
            np.testing.assert_allclose(
                answer.pursuer_velocity_m_s[i], single.pursuer_velocity_m_s, atol=1e-6
            )


def full(game, n, last=lambda value: value):
    """The same game, every parameter an array of n rows, of which the last may be another number."""

    def rows(value):
        column = np.full(n, value)
        column[-1] = last(value)
        return column

    pursuer = type(game.pursuer)(
        *(rows(getattr(game.pursuer, name)) for name in game.pursuer.__slots__)
    )
    return Game(
        pursuer,
        rows(game.evader_speed_m_s),
        capture_radius_m=rows(game.capture_radius_m),
        standoff=StandOff(rows(game.standoff.radius_m), rows(game.standoff.height_m)),
        information_age_s=rows(game.information_age_s),
        wind_m_s=tuple(map(rows, game.wind_m_s)),
    )


def test_an_array_of_one_number_is_that_number_and_costs_no_more(oracle, monkeypatch):
    wind = {"wind_m_s": (0.2, -0.1)}
    for game in (Game(Ball(2.0), 1.0), *(one_row(PER_ROW[kind](3), 1) for kind in PER_ROW)):
        P, E, T = oracle.states(8, 20, game)
        for few in (game, replace(game, **wind)):
            for target in (None, T):
                single = solve(few, P, E, target)
                varied = solve(full(few, 20, lambda value: 1.01 * value), P, E, target)
                assert all(same(a[:-1], b[:-1]) for a, b in zip(single, varied, strict=True))
                with monkeypatch.context() as patched:
                    # Asked row by row, where a number varies
                    patched.setattr(solving, "refused_rows", None)
                    alike = solve(full(few, 20), P, E, target)
                assert all(same(a, b) for a, b in zip(single, alike, strict=True))


@pytest.mark.parametrize(
    ("game", "reason"),
    [
        (Game(Ball(np.full(3, 2.0)), np.full(3, 3.0)), Reason.PURSUER_TOO_SLOW),
        (Game(Ball(2.0), np.full(3, -1.0)), Reason.OUT_OF_RANGE),
        (Game(Ball(2.0), 1.0, capture_radius_m=np.full(3, np.nan)), Reason.OUT_OF_RANGE),
        (Game(Ball(2.0), 1.0, wind_m_s=(np.full(3, np.nan), 0.0)), Reason.OUT_OF_RANGE),
    ],
)
def test_an_array_of_one_number_that_no_game_allows_costs_its_rows(game, reason):
    answer = solve(game, np.full((3, 3), 9.0), np.zeros((3, 3)))
    assert answer.reason.tolist() == [reason] * 3
    assert np.isnan(answer.value).all()


def test_an_array_of_one_number_keeps_the_answers_precision():
    few = (np.full((3, 3), 9.0, np.float32), np.zeros((3, 3), np.float32))
    for capture, wide in (
        (np.zeros(3), np.float64),
        (np.zeros(3, np.float32), np.float32),
        (0.0, np.float32),
    ):
        assert solve(Game(Ball(2.0), 1.0, capture_radius_m=capture), *few).value.dtype == wide
    empty = np.empty((0, 3))
    assert solve(Game(Ball(2.0), 1.0, capture_radius_m=np.empty(0)), empty, empty).value.shape == (
        0,
    )


def test_policies_and_gradients_of_a_batch_are_those_of_its_singles(games, oracle):
    P, E, T = oracle.states(7, 9)
    for name in ("paper", "wind", "cylinder_standoff"):
        game = games[name]
        for policy in (*PURSUER_POLICIES.values(), *EVADER_POLICIES.values()):
            batch = policy(game, P, E, T, T - E)
            assert all(
                same(batch[i], policy(game, P[i], E[i], T[i], T[i] - E[i])) for i in range(9)
            )
        gradient = value_gradient(game, P, E, T)
        for i in range(9):
            assert all(
                same(a[i], b)
                for a, b in zip(gradient, value_gradient(game, P[i], E[i], T[i]), strict=True)
            )


def test_the_codes_that_batches_and_files_carry_stay_what_they_are():
    assert {code.name: code.value for code in Winner} == {
        "EVADER": -1,
        "UNDECIDED": 0,
        "PURSUER": 1,
    }
    assert [code.value for code in Reason] == [0, 1, 2, 3, 4, 5, 6, 10, 11, 12, 13, 14]
    assert [code.value for code in End] == [0, 1, 2, 3, 4]
