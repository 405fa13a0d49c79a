"""Old information: how old it may be for the value to be guaranteed, and what becomes of the promise beyond.

The evader is seen as it was; both play from there in small steps, and the value is held against what happens.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.game import Ball, Cylinder, Game, Reason, StandOff, Winner, guaranteed_age_s, solve
from tests.harness.examples import drawn

STEP_S = 0.02
DISC = StandOff(3.0, 2.0)


def played(game, P, E, T, run, limit_s, touch_m=0.1, law=None):
    """Play `solve` on what was seen against a run, a velocity of (t, P, E); return when and where E is captured.

    `law` is the game that is solved instead, if another.
    """
    delay = round(game.information_age_s / STEP_S)
    path, t = [np.array(E)] * (delay + 1), 0.0
    lengths = game.standoff.radius_m, game.standoff.height_m, game.capture_radius_m
    while t < limit_s:
        beside = max(np.hypot(*(P - E)[:2]) - lengths[0], 0.0)
        above = abs(P[2] - lengths[1])
        out = np.hypot(beside, above) if isinstance(game.pursuer, Ball) else max(beside, above)
        if out <= lengths[2] + touch_m:
            return t, E
        if T is not None and np.linalg.norm(E - T) <= game.evader_speed_m_s * STEP_S:
            return np.inf, E
        seen, ran = path[-delay - 1], (path[-delay] - path[-delay - 1]) / STEP_S if delay else None
        solution = solve(law or game, P, seen, T, evader_velocity_m_s=ran)
        P, E = P + STEP_S * solution.pursuer_velocity_m_s, E + STEP_S * np.array(run(t, P, E))
        path.append(E)
        t += STEP_S
    return np.inf, E


@pytest.mark.parametrize(
    ("game", "age"),
    [
        (Game(Ball(2.0), 1.5, 1.0, DISC), 3.0 / 1.5 + 1.0 / 2.0),
        (Game(Ball(2.0), 1.5), 0.0),
        (Game(Cylinder(2.0, 9.0, 9.0), 1.5, 1.0, DISC), 4.0 / 1.5),
        (Game(Ball(2.0), 1.5, 1.0, evader_space="space"), 1.0 / 1.5),
        (Game(Ball(2.0), 1.5, 1.0, DISC, wind_m_s=(0.1, 0.2), target_velocity_m_s=(0.3, 0.0)), 2.5),
    ],
)
def test_the_guaranteed_age_is_where_the_evaders_spread_has_just_filled_the_reach(game, age):
    assert guaranteed_age_s(game) == pytest.approx(age, rel=1e-15)
    P, E, T = np.array([-15.0, 1.0, 9.0]), np.zeros(3), np.array([20.0, 3.0, 0.0])
    for share, reason in ((0.0, Reason.SOLVED), (1.0, Reason.SOLVED), (1.0 + 1e-12, Reason.TOO_OLD)):
        old = Game(
            game.pursuer,
            game.evader_speed_m_s,
            game.capture_radius_m,
            game.standoff,
            share * guaranteed_age_s(game) if age else (share > 1.0) * 1e-9,
            game.wind_m_s,
            game.target_velocity_m_s,
            game.evader_space,
        )
        assert solve(old, P, E).reason == reason
        assert solve(old, P, E, T).reason == (Reason.TOO_OLD if old.information_age_s else Reason.SOLVED)


def test_rows_too_old_say_so_and_facts_of_the_moment_stay():
    age = np.array([0.0, 1.0, 1.5, 3.0])
    game = Game(Ball(2.0), 2.0 - 1e-9, standoff=StandOff(3.0, 0.0), information_age_s=age)
    rows = np.tile([9.0, 0.0, 0.0], (4, 1)), np.zeros((4, 3))
    assert solve(game, *rows).reason.tolist() == [Reason.SOLVED] * 3 + [Reason.TOO_OLD]
    lens = Game(Ball(2.0), 1.0, 1.0, StandOff(1.0, 0.0), 1.8)
    assert guaranteed_age_s(lens) < 1.8
    for target in (None, np.array([9.0, 0.0, 0.0])):
        assert solve(lens, np.zeros(3), np.zeros(3), target).reason == Reason.CAPTURED
    assert solve(lens, np.array([9.0, 9.0, 0.0]), np.zeros(3), np.zeros(3)).reason == Reason.ARRIVED
    assert solve(lens, np.array([0.0, 0.0, 20.0]), np.zeros(3)).reason == Reason.TOO_OLD
    assert solve(game, *rows, np.array([0.0, 30.0, 0.0])).reason.tolist() == [Reason.SOLVED] + [Reason.TOO_OLD] * 3
    old = Game(Ball(2.0), 1.0, information_age_s=1.0)
    assert solve(old, np.array([8.0, 0.0, 0.0]), np.array([0.0, 5.0, 0.0]), np.zeros(3)).margin_s == 0.0
    assert solve(old, np.array([8.0, 0.0, 0.0]), np.array([0.0, 5.0, 0.0]), np.zeros(3)).reason == Reason.TOO_OLD


def test_right_above_the_evader_a_second_is_young_enough_for_a_metre_and_two_are_not():
    """What two seconds promise, 11.90 s, an evader that just runs makes a chase without end of."""
    P, E = np.array([1e-6, 0.0, 20.0]), np.zeros(3)
    young, old = (Game(Ball(2.0), 1.0, standoff=StandOff(1.0, 0.0), information_age_s=age) for age in (1.0, 2.0))
    value = float(solve(young, P, E).value)
    for run in ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)):
        time, _ = played(young, P, E, None, lambda t, P, E, run=run: run, 3.0 * value)
        assert time <= value + 0.1
    promise = solve(old, P, E)
    assert (promise.reason, round(float(promise.value), 2)) == (Reason.TOO_OLD, 11.90)
    time, _ = played(old, P, E, None, lambda t, P, E: (-1.0, 0.0, 0.0), 5.0 * float(promise.value))
    assert time == np.inf


def test_beyond_the_guarantee_an_evader_reaches_the_target_that_the_value_keeps_it_from():
    """The value promises 55.80 m, and the evader runs straight at its target, past where the pursuer looks for it."""
    P, E, T = np.array([12.0, 1e-6, 0.0]), np.zeros(3), np.array([60.0, 0.0, 0.0])
    old = Game(Ball(2.0), 1.0, information_age_s=0.3)
    promise = solve(old, P, E, T)
    assert (promise.reason, promise.winner, round(float(promise.value), 2)) == (Reason.TOO_OLD, Winner.PURSUER, 55.80)
    _, end = played(old, P, E, T, lambda t, P, E: (1.0, 0.0, 0.0), 70.0, touch_m=0.0)
    assert np.linalg.norm(end - T) < 0.03


@pytest.mark.parametrize("speeds", [Ball(2.0), Cylinder(2.0, 1.0, 1.0)])
@settings(max_examples=drawn(1), deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_at_the_guaranteed_age_no_evader_beats_the_value(speeds, seed):
    rng = np.random.default_rng(seed)
    game = Game(speeds, 1.0, standoff=DISC, information_age_s=3.0)
    P, E, T = np.array([*rng.uniform(-6.0, 6.0, 2), 6.0]), np.zeros(3), np.array([*rng.uniform(-9.0, 9.0, 2), 0.0])
    turns = rng.uniform(0.0, 6.3, 400)
    runs = {
        "straight": lambda t, P, E: (np.cos(turns[0]), np.sin(turns[0]), 0.0),
        "turning": lambda t, P, E: (np.cos(turns[int(t)]), np.sin(turns[int(t)]), 0.0),
        "away": lambda t, P, E: (E - P) * [1.0, 1.0, 0.0] / max(np.hypot(*(E - P)[:2]), 1e-9),
    }
    chase = float(solve(game, P, E).value)
    surer = Game(speeds, 1.0, standoff=StandOff(0.0, 2.0))
    floor = float(solve(surer, P, E, T).value) - 3.0
    for run in runs.values():
        assert played(game, P, E, None, run, chase + 1.0)[0] <= chase + 0.2
        if solve(surer, P, E, T).winner > 0 and floor > 0:
            _, end = played(game, P, E, T, run, 60.0, law=surer)
            assert np.linalg.norm(end - T) >= floor - 0.2


def weaving(T, swing, period_s, phase):
    """An evader that runs for its target, off to one side and to the other."""

    def run(t, P, E):
        heading = np.arctan2(*(T - E)[1::-1]) + swing * np.sign(np.sin(2.0 * np.pi * t / period_s + phase))
        return np.cos(heading), np.sin(heading), 0.0

    return run


def test_in_tad_an_evader_beats_the_value_at_an_age_that_pe_forgives_and_not_the_floor():
    P, E, T = np.array([2.9, -4.46, 1.51]), np.zeros(3), np.array([16.0, 0.0, 0.0])
    game = Game(Ball(2.0), 1.0, standoff=StandOff(3.0, 0.0), information_age_s=1.0)
    surer = Game(Ball(2.0), 1.0, standoff=StandOff(2.0, 0.0))
    promise, floor = float(solve(game, P, E, T).value), float(solve(surer, P, E, T).value) - 1.0
    assert game.information_age_s < guaranteed_age_s(game)
    assert promise > floor > 8.0
    run = weaving(T, np.pi / 6.0, 7.0, 0.0)
    _, end = played(game, P, E, T, run, 40.0)
    assert np.linalg.norm(end - T) < promise - 1.0
    when, end = played(game, P, E, T, run, 40.0, law=surer)
    assert when < np.inf
    assert np.linalg.norm(end - T) >= floor


def test_a_pursuer_over_the_meeting_point_does_not_wait_for_an_evader_that_passes_it_by():
    """Once it did, keeping with what it saw, and the evader got to its target."""
    P, E, T = np.array([5.57, -1.31, 2.61]), np.zeros(3), np.array([40.0, 0.0, 0.0])
    game = Game(Ball(2.0), 1.0, standoff=StandOff(3.0, 0.0), information_age_s=1.0)
    when, end = played(game, P, E, T, weaving(T, np.pi / 4.0, 1.0, 0.0), 90.0)
    assert when < np.inf
    assert np.linalg.norm(end - T) > float(solve(game, P, E, T).value) - 2.0
    over = np.array([3.9, 0.0, 0.0])
    for speeds in (Ball(2.0), Cylinder(2.0, 1.0, 1.0)):
        old = Game(speeds, 1.0, standoff=StandOff(3.0, 0.0), information_age_s=1.0)
        answer = solve(old, over, E, T, evader_velocity_m_s=np.array([0.0, 1.0, 0.0]))
        assert answer.meeting_time_s == 0.0
        assert answer.reason == Reason.TOO_OLD
        np.testing.assert_allclose(answer.pursuer_velocity_m_s, [-2.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(("age_s", "radius_m"), [(0.0, 3.0), (0.5, 2.0), (1.5, 0.0), (9.0, 0.0)])
def test_within_the_spread_is_the_game_of_the_smaller_disc(age_s, radius_m):
    game = Game(Cylinder(6.0, 2.0, 1.5), 2.0, standoff=DISC, information_age_s=age_s, wind_m_s=(0.5, 0.1))
    smaller = Game(Cylinder(6.0, 2.0, 1.5), 2.0, standoff=StandOff(radius_m, 2.0), wind_m_s=(0.5, 0.1))
    assert game.within_spread() == smaller
    assert game.standoff == DISC


DENTED = [
    (Game(Ball(1.3), 1.0, information_age_s=0.5), (-1.2416, -2.6638, 0.0663), (-1.6896, -3.1077), (7.4447, 8.2055)),
    (Game(Ball(1.3), 1.0, information_age_s=1.0), (-0.2611, 4.2091, 0.1801), (1.7747, 3.5341), (-11.9474, 6.5783)),
    (Game(Ball(1.3), 1.0, information_age_s=2.0), (2.4502, 5.7326, 0.0291), (4.98, 7.5166), (-8.7586, -1.4508)),
    (
        Game(Ball(2.0), 1.0, information_age_s=1.0, wind_m_s=(0.3, -0.4)),
        (2.5216, 6.322, 0.1272), (3.2007, 7.4153), (-5.4826, -6.0395),
    ),
    (
        Game(Ball(2.0), 1.0, information_age_s=2.0, wind_m_s=(0.3, -0.4)),
        (-2.7981, -6.9946, 0.8637), (-3.3716, -9.1556), (4.2063, 11.4797),
    ),
    (
        Game(Ball(1.95), 1.5, 0.4, information_age_s=3.0),
        (-19.2779, -10.3853, 0.1269), (-17.9101, -7.0783), (-22.5057, -17.274),
    ),
    (
        Game(Cylinder(1.95, 2.0, 2.0), 1.5, 0.4, information_age_s=1.0),
        (4.3424, 12.1597, 0.4589), (4.4923, 11.1393), (4.1599, 14.3507),
    ),
    (
        Game(Ball(1.65), 1.5, information_age_s=0.3, wind_m_s=(0.05, -0.06)),
        (6.3737, -0.544, 0.2804), (5.1146, -0.2705), (16.0962, -2.97),
    ),
    (
        Game(Cylinder(1.65, 2.0, 2.0), 1.5, information_age_s=3.0),
        (17.8835, 5.2255, 0.2381), (18.0, 1.0), (18.2698, 18.0572),
    ),
]  # fmt: skip
"""States whose region has a dent before the pursuer, with a place on either side that is the best of its side."""


@pytest.mark.parametrize(("game", "P", "E", "T"), DENTED)
def test_of_two_places_beside_a_dent_the_better_one_is_taken(oracle, game, P, E, T):
    P, E, T = np.array(P), np.array([*E, 0.0]), np.array([*T, 0.0])
    value = oracle.extremum(game, P, E, T)
    assert float(solve(game, P, E, T).value) == pytest.approx(value, abs=1e-9)
    many = solve(game, *(np.stack([place, place + np.array([0.0, 1e-9, 0.0])]) for place in (P, E, T)))
    np.testing.assert_allclose(many.value, value, atol=1e-8)
    size = 2.0**-12
    capture, age = size * game.capture_radius_m, size * game.information_age_s
    small = replace(game, capture_radius_m=capture, information_age_s=age)
    assert float(solve(small, size * P, size * E, size * T).value) == pytest.approx(size * value, abs=1e-9 * size)
