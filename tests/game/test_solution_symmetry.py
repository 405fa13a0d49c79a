"""The games know no place, no direction and no unit; their values have no jumps where the formulas have seams."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.game import Ball, Cylinder, Game, Reason, StandOff, solve
from tests.harness.examples import drawn

some = settings(max_examples=drawn(6), deadline=None)
seeds = st.integers(0, 2**32 - 1)


def turned(game, angle):
    wind, drift = (
        rotation(angle)[:2, :2] @ np.array(pair)
        for pair in (game.wind_m_s, game.target_velocity_m_s)
    )
    return Game(
        game.pursuer,
        game.evader_speed_m_s,
        capture_radius_m=game.capture_radius_m,
        standoff=game.standoff,
        information_age_s=game.information_age_s,
        wind_m_s=tuple(wind),
        target_velocity_m_s=tuple(drift),
        evader_space=game.evader_space,
    )


def rotation(angle):
    return np.array(
        [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]]
    )


def stretched(game, length, speed):
    """The same game in other units: lengths times `length`, speeds times `speed`, so times times length/speed."""
    pursuer = type(game.pursuer)(
        *(speed * getattr(game.pursuer, name) for name in game.pursuer.__slots__)
    )
    return Game(
        pursuer,
        speed * game.evader_speed_m_s,
        capture_radius_m=length * game.capture_radius_m,
        standoff=StandOff(length * game.standoff.radius_m, length * game.standoff.height_m),
        information_age_s=length / speed * game.information_age_s,
        wind_m_s=tuple(speed * part for part in game.wind_m_s),
        target_velocity_m_s=tuple(speed * part for part in game.target_velocity_m_s),
        evader_space=game.evader_space,
    )


def clear(solution):
    """Away from the barrier, where the winner would turn by rounding."""
    return np.abs(solution.margin_s) > 1e-6


@some
@given(seed=seeds, angle=st.floats(-7.0, 7.0))
def test_turning_the_world_turns_the_play(games, oracle, seed, angle):
    """Catches an axis that is favoured: north for east, or a velocity without its frame."""
    turn = rotation(angle)
    for name, game in games.items():
        P, E, T = oracle.states(seed, 10, game)
        for target in (None, T):
            here = solve(game, P, E, target)
            there = solve(
                turned(game, angle), P @ turn.T, E @ turn.T, None if target is None else T @ turn.T
            )
            good = clear(here)
            np.testing.assert_array_equal(here.winner[good], there.winner[good])
            np.testing.assert_allclose(
                there.value[good], here.value[good], atol=1e-9, rtol=1e-9, err_msg=name
            )
            for field in ("meeting_point_m", "pursuer_velocity_m_s", "evader_velocity_m_s"):
                np.testing.assert_allclose(
                    getattr(there, field)[good],
                    (getattr(here, field) @ turn.T)[good],
                    atol=2e-5,
                    err_msg=name,
                )


@some
@given(seed=seeds, shift=st.tuples(*[st.floats(-100.0, 100.0)] * 3))
def test_moving_the_world_moves_the_play(games, oracle, seed, shift):
    """Catches a coordinate that is taken for a difference of coordinates."""
    for name, game in games.items():
        P, E, T = oracle.states(seed, 10, game)
        for target in (None, T):
            here = solve(game, P, E, target)
            there = solve(game, P + shift, E + shift, None if target is None else T + shift)
            good = clear(here)
            np.testing.assert_allclose(
                there.value[good], here.value[good], atol=1e-9, rtol=1e-9, err_msg=name
            )
            np.testing.assert_allclose(
                there.meeting_point_m[good],
                here.meeting_point_m[good] + shift,
                atol=2e-5,
                err_msg=name,
            )
            np.testing.assert_allclose(
                there.pursuer_velocity_m_s[good],
                here.pursuer_velocity_m_s[good],
                atol=2e-5,
                err_msg=name,
            )


@pytest.mark.parametrize(("length", "speed"), [(2.0**-5, 1.0), (2.0**-9, 4.0), (2.0, 0.25)])
def test_a_game_in_other_units_is_the_same_game_bit_for_bit(games, oracle, length, speed):
    """Catches a constant with a hidden unit."""
    units = {
        "margin_s": length / speed,
        "meeting_point_m": length,
        "meeting_time_s": length / speed,
    }
    units |= {"pursuer_velocity_m_s": speed, "evader_velocity_m_s": speed}
    for name, game in games.items():
        P, E, T = oracle.states(7, 200, game)
        other = stretched(game, length, speed)
        for target in (None, T):
            units["value"] = length / speed if target is None else length
            here = solve(game, P, E, target)
            there = solve(
                other, length * P, length * E, None if target is None else length * target
            )
            for field, value in here._asdict().items():
                expected = units[field] * value if field in units else value
                np.testing.assert_array_equal(
                    getattr(there, field), expected, err_msg=f"{name} {field}"
                )


@some
@given(seed=seeds, turn=st.floats(0.0, 6.28))
def test_the_pe_value_has_no_jump_right_above_the_evader(games, oracle, seed, turn):
    step = 1e-7 * np.array([np.cos(turn), np.sin(turn), 0.0])
    for name, game in games.items():
        P, E, _ = oracle.states(seed, 5, game)
        P[:, :2] = E[:, :2]
        np.testing.assert_allclose(
            solve(game, P + step, E).value, solve(game, P, E).value, atol=1e-6, err_msg=name
        )


@some
@given(seed=seeds)
def test_values_and_strategies_have_no_jump_across_the_barrier(games, oracle, seed):
    """Catches a jump of value or velocity between two branches of the solution at the barrier.

    Along a line from a state that the pursuer wins to one that the evader wins, close in on the barrier.
    """
    for name, game in games.items():
        P, E, T = oracle.states(seed, 30, game)
        margin = np.nan_to_num(solve(game, P, E, T).margin_s)
        winning = np.argmax(margin)
        losing = np.argmin(margin)
        if margin[winning] <= 0 or margin[losing] >= 0:
            continue
        low = 0.0
        high = 1.0

        def on(share, states=(P, E, T), winning=winning, losing=losing):
            return [(1.0 - share) * array[winning] + share * array[losing] for array in states]

        for _ in range(32):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if solve(game, *on(middle)).margin_s > 0 else (low, middle)
        here = solve(game, *on(low))
        there = solve(game, *on(high))
        if game.information_age_s > 0.0 and Reason.NO_REGION in (here.reason, there.reason):
            continue
        assert (here.winner, there.winner) == (1, -1)
        assert here.value == pytest.approx(0.0, abs=1e-6)
        assert there.value == pytest.approx(0.0, abs=1e-6)
        if here.meeting_time_s > 0.5:
            np.testing.assert_allclose(
                there.meeting_point_m, here.meeting_point_m, atol=1e-4, err_msg=name
            )
            np.testing.assert_allclose(
                there.evader_velocity_m_s, here.evader_velocity_m_s, atol=1e-3, err_msg=name
            )


@pytest.mark.parametrize("pursuer", [Ball(2.0), Cylinder(2.0, 0.7, 0.5)])
def test_a_stand_off_disc_that_shrinks_becomes_point_capture(pursuer, oracle):
    P, E, T = oracle.states(11, 50)
    near = Game(
        pursuer, 1.0, standoff=StandOff(1e-9, 1e-9), capture_radius_m=1e-9, information_age_s=1e-9
    )
    for target in (None, T):
        point = solve(Game(pursuer, 1.0), P, E, target)
        almost = solve(near, P, E, target)
        np.testing.assert_allclose(almost.value, point.value, atol=1e-6)
        np.testing.assert_allclose(
            almost.pursuer_velocity_m_s, point.pursuer_velocity_m_s, atol=1e-5
        )
