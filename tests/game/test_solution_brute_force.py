"""Values and winners against brute force over headings, from the definition of capture alone (conftest)."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from guidance.game import Ball, Cylinder, Game, StandOff, solve
from tests.harness.examples import drawn

some = settings(max_examples=drawn(3), deadline=None, suppress_health_check=[HealthCheck.too_slow])
seeds = st.integers(0, 2**32 - 1)


@some
@given(seed=seeds)
def test_the_pe_value_is_the_longest_escape_over_all_headings(game, oracle, seed):
    for P, E, _ in zip(*oracle.states(seed, 2, game), strict=True):
        assert solve(game, P, E).value == pytest.approx(
            oracle.extremum(game, P, E, None), rel=1e-8, abs=1e-8
        )


@some
@given(seed=seeds)
def test_the_tad_value_is_the_closest_capture_over_all_headings(tad_game, oracle, seed):
    for P, E, T in zip(*oracle.states(seed, 2, tad_game), strict=True):
        solution = solve(tad_game, P, E, T)
        if solution.winner > 0:
            assert solution.value == pytest.approx(
                oracle.extremum(tad_game, P, E, T), rel=1e-8, abs=1e-7
            )


@settings(max_examples=drawn(20), deadline=None)
@given(seed=seeds)
def test_the_evader_wins_if_it_reaches_its_target_before_the_pursuer(game, oracle, seed):
    states = oracle.states(seed, 40, game)
    for P, E, T, winner in zip(*states, solve(game, *states).winner, strict=True):
        arrival = max(np.linalg.norm(E - T) / game.evader_speed_m_s - game.information_age_s, 0.0)
        assert winner == -np.sign(oracle.shortfall(game, P, T, arrival))


@settings(max_examples=drawn(20), deadline=None)
@given(seed=seeds)
def test_the_value_of_a_lost_game_is_the_shortfall_at_the_arrival(games, oracle, seed):
    for name in (
        "paper",
        "capture_radius",
        "age",
        "ball_standoff",
        "wind",
        "ball_everything",
        "space",
    ):
        game = games[name]
        states = oracle.states(seed, 40, game)
        solution = solve(game, *states)
        for P, E, T, winner, value in zip(*states, solution.winner, solution.value, strict=True):
            if winner < 0:
                arrival = max(
                    np.linalg.norm(E - T) / game.evader_speed_m_s - game.information_age_s, 0.0
                )
                assert value == pytest.approx(
                    oracle.shortfall(game, P, T, arrival), rel=1e-9, abs=1e-9
                )


@settings(max_examples=drawn(20), deadline=None)
@given(seed=seeds)
def test_the_margin_is_the_evaders_arrival_less_the_pursuers_soonest_guard(game, oracle, seed):
    states = oracle.states(seed, 10, game)
    solution = solve(game, *states)
    for P, E, T, margin in zip(*states, solution.margin_s, strict=True):
        arrival = max(np.linalg.norm(E - T) / game.evader_speed_m_s - game.information_age_s, 0.0)
        guard = arrival - margin
        assert guard >= -1e-12
        if guard > 1e-9:
            assert oracle.shortfall(game, P, T, guard) == pytest.approx(0.0, abs=1e-9)
        else:
            assert oracle.shortfall(game, P, T, 0.0) <= 1e-9


@st.composite
def any_game(draw):
    """A game with every parameter drawn, half of them switched off now and then."""
    v = draw(st.floats(0.5, 8.0))
    ratio = draw(st.floats(1.1, 4.0))
    off = st.just(0.0)
    length = off | st.floats(0.1, 3.0)
    age = off | st.floats(0.05, 1.0)
    share = draw(off | st.floats(0.0, 0.8)) * (ratio - 1.0) * v
    turn = draw(st.floats(0.0, 6.28))
    pursuer = Ball(ratio * v)
    if draw(st.booleans()):
        pursuer = Cylinder(ratio * v, draw(st.floats(0.2, 3.0)) * v, draw(st.floats(0.2, 3.0)) * v)
    return Game(
        pursuer,
        v,
        capture_radius_m=draw(length),
        standoff=StandOff(draw(length), draw(length)),
        information_age_s=draw(age),
        wind_m_s=(share * np.cos(turn), share * np.sin(turn)),
    )


@settings(max_examples=drawn(40), deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(game=any_game(), seed=seeds)
def test_any_combination_of_parameters_keeps_to_the_definition(oracle, game, seed):
    for P, E, T in zip(*oracle.states(seed, 1, game), strict=True):
        assert solve(game, P, E).value == pytest.approx(
            oracle.extremum(game, P, E, None), rel=1e-7, abs=1e-7
        )
        solution = solve(game, P, E, T)
        if solution.winner > 0:
            assert solution.value == pytest.approx(
                oracle.extremum(game, P, E, T), rel=1e-7, abs=1e-6
            )
