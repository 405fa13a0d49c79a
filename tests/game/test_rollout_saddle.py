"""Optimal play is an equilibrium: whoever leaves it alone does no better, in the exact rollout."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.game import EVADER_POLICIES, PURSUER_POLICIES, End, Exact, rollout, solve
from tests.harness.examples import drawn

PLAYED = ("wind", "space", "ball_standoff", "cylinder_standoff")
"""The paper's game is that of the wind, and its capture radius is in both games with a stand-off."""
STEPPING = Exact(step_s=0.4)
few = settings(max_examples=drawn(1), deadline=None)
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module", params=PLAYED)
def played(request, games):
    return games[request.param]


def constant(velocities):
    """A policy that keeps one velocity for each game of the batch."""
    return lambda game, pursuer, evader, target=None, evader_velocity_m_s=None: velocities


def side_by_side(policies):
    """Policies for the rows of the first axis, each for its own."""

    def policy(game, pursuer, evader, target=None, evader_velocity_m_s=None):
        targets = [None] * len(policies) if target is None else target
        rows = zip(policies, pursuer, evader, targets, strict=True)
        return np.stack([each(game, P, E, T) for each, P, E, T in rows])

    return policy


def times(count, states):
    return np.stack([states] * count)


def courses(seed, count, *, speed, level=False):
    """Random constant velocities at full speed."""
    rng = np.random.default_rng(seed)
    courses = rng.normal(size=(count, 3))
    if level:
        courses[:, 2] = 0.0
    return speed * courses / np.linalg.norm(courses, axis=1, keepdims=True)


def start(game, oracle, seed, count):
    # Near each other, to play less
    P, E, T = (0.5 * place for place in oracle.states(seed, count, game))
    P[:, 2] = np.maximum(P[:, 2], game.standoff.height_m + 0.5)
    return P, E, T


@few
@given(seed=seeds)
def test_optimal_play_takes_the_value(played, oracle, seed):
    """Catches play of both sides that is not worth the value."""
    P, E, T = start(played, oracle, seed, 4)
    chase = rollout(played, P, E, stepping=STEPPING)
    np.testing.assert_array_equal(chase.end, End.CAPTURED)
    np.testing.assert_allclose(chase.time_s, solve(played, P, E).value, atol=2e-3)
    race = rollout(played, P, E, T, stepping=STEPPING)
    solution = solve(played, P, E, T)
    np.testing.assert_array_equal(race.end == End.CAPTURED, solution.winner > 0)
    won = solution.winner > 0
    np.testing.assert_allclose(race.distance_m[won], solution.value[won], atol=5e-3)
    np.testing.assert_allclose(race.time_s, solution.meeting_time_s, atol=2e-2)


@few
@given(seed=seeds)
def test_no_evader_escapes_the_optimal_pursuer_for_longer_than_the_value(played, oracle, seed):
    """Catches a strategy of the pursuer that takes longer than the value."""
    P, E, _ = start(played, oracle, seed, 4)
    steady = constant(
        courses(seed, 4, speed=played.evader_speed_m_s, level=played.evader_space == "plane")
    )
    evaders = [EVADER_POLICIES["pure_evade"], EVADER_POLICIES["hold"], steady]
    end = rollout(
        played, times(3, P), times(3, E), evader_policy=side_by_side(evaders), stepping=STEPPING
    )
    np.testing.assert_array_equal(end.end, End.CAPTURED)
    assert (end.time_s <= solve(played, P, E).value + 2e-3).all()


@few
@given(seed=seeds)
def test_no_pursuer_catches_the_optimal_evader_sooner_than_the_value(played, oracle, seed):
    """Catches a play of the evader that another course of the pursuer beats, in PE."""
    P, E, _ = start(played, oracle, seed, 4)
    value = solve(played, P, E).value
    pursuers = [
        PURSUER_POLICIES["pure_pursuit"],
        PURSUER_POLICIES["hold"],
        constant(courses(seed, 4, speed=0.5)),
    ]
    policy = side_by_side(pursuers)
    limit = float(value.max())
    end = rollout(
        played, times(3, P), times(3, E), pursuer_policy=policy, stepping=STEPPING, duration_s=limit
    )
    assert ((end.time_s >= value - 2e-3) | (end.end != End.CAPTURED)).all()
    assert (end.end[1] != End.CAPTURED).all()


@few
@given(seed=seeds)
def test_no_evader_comes_closer_to_its_target_than_the_value(played, oracle, seed):
    """Catches a play of the pursuer that another course of the evader beats, in TAD."""
    P, E, T = start(played, oracle, seed, 4)
    solution = solve(played, P, E, T)
    won = solution.winner > 0
    P = P[won]
    E = E[won]
    T = T[won]
    value = solution.value[won]
    steady = constant(
        courses(seed, len(P), speed=played.evader_speed_m_s, level=played.evader_space == "plane")
    )
    evaders = side_by_side(
        [EVADER_POLICIES["task_oriented"], EVADER_POLICIES["pure_evade"], steady]
    )
    end = rollout(
        played,
        times(3, P),
        times(3, E),
        times(3, T),
        evader_policy=evaders,
        stepping=STEPPING,
        duration_s=40.0,
    )
    assert not (end.end == End.ARRIVED).any()
    assert ((end.distance_m >= value - 5e-3) | (end.end != End.CAPTURED)).all()


@few
@given(seed=seeds)
def test_no_pursuer_keeps_the_optimal_evader_farther_from_its_target_than_the_value(
    played, oracle, seed
):
    """Catches a play of the evader that another course of the pursuer beats, in TAD."""
    P, E, T = start(played, oracle, seed, 4)
    solution = solve(played, P, E, T)
    won = solution.winner > 0
    named = [PURSUER_POLICIES[name] for name in ("pure_pursuit", "task_oriented", "hold")]
    pursuers = side_by_side([*named, constant(courses(seed, 4, speed=0.5))])
    end = rollout(
        played,
        times(4, P),
        times(4, E),
        times(4, T),
        pursuer_policy=pursuers,
        stepping=STEPPING,
        duration_s=60.0,
    )
    assert (end.end[:, ~won] == End.ARRIVED).all()
    assert (end.end != End.TIME_UP).all()
    assert (end.distance_m[:, won] <= solution.value[won] + 5e-3).all()
