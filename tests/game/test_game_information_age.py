"""Old information: how old it may be for the value to be guaranteed, and what becomes of the promise beyond.

The evader is seen as it was; both play from there in small steps, and the value is held against what happens.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.game import (
    Ball,
    Cylinder,
    Game,
    Reason,
    StandOff,
    Winner,
    guaranteed_age_s,
    solve,
    solve_state,
)
from tests.harness.examples import drawn

STEP_S = 0.02
DISC = StandOff(3.0, 2.0)


def played(game, P, E, T, run, limit_s, touch_m=0.1, law=None):
    """Play `solve` on what was seen against a run, a velocity of (t, P, E); return when and where E is captured.

    `law` is the game that is solved instead, if another.
    """
    delay = round(game.information_age_s / STEP_S)
    path = [np.array(E)] * (delay + 1)
    t = 0.0
    lengths = game.standoff.radius_m, game.standoff.height_m, game.capture_radius_m
    while t < limit_s:
        beside = max(np.hypot(*(P - E)[:2]) - lengths[0], 0.0)
        above = abs(P[2] - lengths[1])
        out = np.hypot(beside, above) if isinstance(game.pursuer, Ball) else max(beside, above)
        if out <= lengths[2] + touch_m:
            return t, E
        if T is not None and np.linalg.norm(E - T) <= game.evader_speed_m_s * STEP_S:
            return np.inf, E
        seen = path[-delay - 1]
        ran = (path[-delay] - path[-delay - 1]) / STEP_S if delay else None
        solution = solve(law or game, P, seen, T, evader_velocity_m_s=ran)
        if solution.reason == Reason.NO_REGION:
            solution = solve(game.within_spread(), P, seen, T, evader_velocity_m_s=ran)
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
    P = np.array([-15.0, 1.0, 9.0])
    E = np.zeros(3)
    T = np.array([20.0, 3.0, 0.0])
    for share, reason in (
        (0.0, Reason.SOLVED),
        (1.0, Reason.SOLVED),
        (1.0 + 1e-12, Reason.TOO_OLD),
    ):
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
        assert solve(old, P, E, T).reason == (
            Reason.TOO_OLD if old.information_age_s else Reason.SOLVED
        )


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
    assert (
        solve(game, *rows, np.array([0.0, 30.0, 0.0])).reason.tolist()
        == [Reason.SOLVED] + [Reason.TOO_OLD] * 3
    )
    old = Game(Ball(2.0), 1.0, information_age_s=1.0)
    assert (
        solve(old, np.array([8.0, 0.0, 0.0]), np.array([0.0, 5.0, 0.0]), np.zeros(3)).margin_s
        == 0.0
    )
    assert (
        solve(old, np.array([8.0, 0.0, 0.0]), np.array([0.0, 5.0, 0.0]), np.zeros(3)).reason
        == Reason.TOO_OLD
    )


def test_right_above_the_evader_a_second_is_young_enough_for_a_metre_and_two_are_not():
    """At an age of 2 s the value is 11.90 s, but an evader that runs straight is never captured."""
    P = np.array([1e-6, 0.0, 20.0])
    E = np.zeros(3)
    young, old = (
        Game(Ball(2.0), 1.0, standoff=StandOff(1.0, 0.0), information_age_s=age)
        for age in (1.0, 2.0)
    )
    value = float(solve(young, P, E).value)
    for run in ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)):
        time, _ = played(young, P, E, None, lambda t, P, E, run=run: run, 3.0 * value)
        assert time <= value + 0.1
    promise = solve(old, P, E)
    assert (promise.reason, round(float(promise.value), 2)) == (Reason.TOO_OLD, 11.90)
    time, _ = played(old, P, E, None, lambda t, P, E: (-1.0, 0.0, 0.0), 5.0 * float(promise.value))
    assert time == np.inf


@pytest.mark.parametrize("speeds", [Ball(2.0), Cylinder(2.0, 1.0, 1.0)])
@settings(max_examples=drawn(1), deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_at_the_guaranteed_age_no_evader_beats_the_value(speeds, seed):
    rng = np.random.default_rng(seed)
    game = Game(speeds, 1.0, standoff=DISC, information_age_s=3.0)
    P = np.array([*rng.uniform(-6.0, 6.0, 2), 6.0])
    E = np.zeros(3)
    T = np.array([*rng.uniform(-9.0, 9.0, 2), 0.0])
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
        heading = np.arctan2(*(T - E)[1::-1]) + swing * np.sign(
            np.sin(2.0 * np.pi * t / period_s + phase)
        )
        return np.cos(heading), np.sin(heading), 0.0

    return run


def test_in_tad_the_floor_of_the_smaller_disc_is_kept_with_it_near_the_evader_or_always():
    P = np.array([2.9, -4.46, 1.51])
    E = np.zeros(3)
    T = np.array([16.0, 0.0, 0.0])
    game = Game(Ball(2.0), 1.0, standoff=StandOff(3.0, 0.0), information_age_s=1.0)
    surer = Game(Ball(2.0), 1.0, standoff=StandOff(2.0, 0.0))
    promise = float(solve(game, P, E, T).value)
    floor = float(solve(surer, P, E, T).value) - 1.0
    assert game.information_age_s < guaranteed_age_s(game)
    assert promise > floor > 8.0
    run = weaving(T, np.pi / 6.0, 7.0, 0.0)
    _, end = played(game, P, E, T, run, 40.0)
    assert np.linalg.norm(end - T) >= floor
    when, end = played(game, P, E, T, run, 40.0, law=surer)
    assert when < np.inf
    assert np.linalg.norm(end - T) >= floor


def test_a_pursuer_at_the_meeting_point_does_not_wait_for_a_passing_evader():
    """An earlier version followed the position it saw, and the evader reached its target."""
    P = np.array([5.57, -1.31, 2.61])
    E = np.zeros(3)
    T = np.array([40.0, 0.0, 0.0])
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
    game = Game(
        Cylinder(6.0, 2.0, 1.5), 2.0, standoff=DISC, information_age_s=age_s, wind_m_s=(0.5, 0.1)
    )
    smaller = Game(
        Cylinder(6.0, 2.0, 1.5), 2.0, standoff=StandOff(radius_m, 2.0), wind_m_s=(0.5, 0.1)
    )
    assert game.within_spread() == smaller
    assert game.standoff == DISC


FROM_THE_SIDE = (
    Game(
        Cylinder(8.836520974778615, 5.384580568890779, 2.800081101877117),
        7.797371474769411,
        4.3773225155011595,
        StandOff(7.703514006176481, 5.361043859726303),
        1.6226744835230473,
        (0.035476315511596836, 0.8061814190935084),
    ),
    (43.213707684863905, -1.5553951266193877, 10.162604582781492),
    (44.76474311449985, 1.1825888462751633, 1.3633376712074785),
    (-4.213120699247874, 4.1048247158971165, 1.3633376712074785),
)
"""An earlier version returned 36.4 m; an evader that runs straight at 2.6331 rad reaches 34.6 m."""
AHEAD = (
    Game(Ball(1.3), 1.0, information_age_s=0.5),
    (-1.24, -2.66, 0.07),
    (-1.69, -3.11, 0.0),
    (7.44, 8.21, 0.0),
)


@pytest.mark.parametrize(("game", "P", "E", "T"), [FROM_THE_SIDE, AHEAD])
def test_beyond_the_guaranteed_age_tad_has_no_value(game, P, E, T):
    assert game.information_age_s > guaranteed_age_s(game)
    answer = solve(game, P, E, T)
    assert (answer.reason, answer.winner) == (Reason.NO_REGION, Winner.UNDECIDED)
    assert np.isnan(answer.value)
    assert np.isnan(answer.pursuer_velocity_m_s).all()
    assert solve_state(game, P, E, T).reason == Reason.NO_REGION
    many = solve(game, *(np.stack([place, place]) for place in (P, E, T)))
    assert many.reason.tolist() == [Reason.NO_REGION] * 2
    assert np.isfinite(solve(game, P, E).value)
    assert np.isfinite(solve(game.within_spread(), P, E, T).value)


@pytest.mark.parametrize("speeds", [Ball(2.0), Cylinder(2.0, 1.0, 0.7)])
def test_up_to_the_guaranteed_age_tad_has_the_least_value_of_all_headings(oracle, speeds):
    """Catches a wrong value of TAD at the oldest information that is guaranteed."""
    P, E, T = oracle.states(5, 8)
    for radius_m, capture_m, wind in (
        (2.0, 0.0, (0.0, 0.0)),
        (1.0, 0.8, (0.0, 0.0)),
        (2.0, 0.3, (0.3, -0.4)),
    ):
        game = Game(speeds, 1.0, capture_m, StandOff(radius_m, 1.0), wind_m_s=wind)
        game = replace(game, information_age_s=guaranteed_age_s(game))
        answer = solve(game, P, E, T)
        for row in np.flatnonzero(answer.winner > 0):
            least = oracle.extremum(game, P[row], E[row], T[row])
            assert float(answer.value[row]) == pytest.approx(least, abs=1e-8)


def nearest_end(game, P, E, T):
    """The least distance from T of straight runs that begin at E, seen τ ago, in still air: by the definition."""
    v = game.evader_speed_m_s
    u = game.pursuer.horizontal_m_s
    age = game.information_age_s
    toward = (T - E) / np.linalg.norm(T - E)
    aside = (P - E) - ((P - E) @ toward) * toward
    aside = (
        aside / np.linalg.norm(aside)
        if game.evader_space == "space"
        else np.cross([0, 0, 1.0], toward)
    )
    middle = 0.0
    width = np.pi
    for _ in range(6):
        turns = (middle + width * np.linspace(-1.0, 1.0, 721))[:, None]
        run = np.cos(turns) * toward + np.sin(turns) * aside
        low = np.zeros((721, 1))
        high = np.full((721, 1), 1e3)
        for _ in range(60):
            t = 0.5 * (low + high)
            away = E + v * (t + age) * run - P
            if game.evader_space == "space":
                gap = np.linalg.norm(away, axis=-1)
            else:
                gap = np.maximum(np.linalg.norm(away[:, :2], axis=-1) - game.standoff.radius_m, 0.0)
            height = abs(P[2] - game.standoff.height_m) if game.evader_space == "plane" else 0.0
            if isinstance(game.pursuer, Ball):
                free = np.hypot(gap, height)[:, None] > u * t + game.capture_radius_m
            else:
                high_up = height - game.capture_radius_m > game.pursuer.descent_m_s * t
                free = (gap[:, None] > u * t + game.capture_radius_m) | high_up
            low = np.where(free, t, low)
            high = np.where(free, high, t)
        left = np.linalg.norm(E + v * (high + age) * run - T, axis=-1)
        middle = float(turns[left.argmin(), 0])
        width /= 100.0
    return left.min()


NEAR = {
    "ball": Game(Ball(4.0), 2.0, standoff=StandOff(4.0, 2.0), information_age_s=1.9),
    "ball, capture": Game(Ball(2.0), 1.5, 2.0, information_age_s=0.9),
    "cylinder": Game(Cylinder(3.0, 2.0, 2.0), 2.0, 0.5, StandOff(3.0, 2.0), information_age_s=1.6),
    "space": Game(Ball(1.7672), 1.6843, 2.8267, information_age_s=1.4733, evader_space="space"),
}


@pytest.mark.parametrize("game", NEAR.values(), ids=NEAR)
def test_near_the_pursuer_tad_with_age_has_the_value_of_straight_runs_or_none(game):
    """Catches a wrong value of TAD with old information, near the pursuer."""
    assert game.information_age_s <= guaranteed_age_s(game)
    rng = np.random.default_rng(4)
    P, E, T = rng.uniform(-8.0, 8.0, (3, 30, 3))
    T *= 4.0
    if game.evader_space == "plane":
        P[:, 2] = abs(P[:, 2])
        E[:, 2] = 0.0
        T[:, 2] = 0.0
    answer = solve(game, P, E, T)
    assert np.count_nonzero((answer.winner > 0) & (answer.reason == Reason.TOO_OLD)) > 3
    for row in np.flatnonzero((answer.winner > 0) & (answer.reason == Reason.TOO_OLD)):
        least = nearest_end(game, P[row], E[row], T[row])
        assert float(answer.value[row]) == pytest.approx(least, abs=1e-6)


@pytest.mark.parametrize(
    ("game", "P", "E", "T"),
    [
        (
            NEAR["space"],
            (-22.728, 19.738, 12.442),
            (-26.502, 19.799, 13.78),
            (23.453, -18.924, 18.943),
        ),
        (
            replace(NEAR["ball"], information_age_s=2.0),
            (3.0, 4.0, 2.0),
            (0.0, 0.0, 0.0),
            (37.0, 2.0, 0.0),
        ),
    ],
)
def test_tad_has_no_value_where_a_part_of_the_evaders_spread_can_be_captured_now(game, P, E, T):
    answer = solve_state(game, P, E, T)
    assert answer.reason == Reason.NO_REGION
    assert np.isnan(answer.value)


@pytest.mark.parametrize(
    ("game", "P", "E", "T"),
    [
        (
            Game(
                Cylinder(1.2555, 3.0, 1.5),
                1.2169,
                standoff=StandOff(4.8285, 3.0536),
                information_age_s=2.4401,
            ),
            (-20.9115, -5.2769, 14.3013),
            (-16.5145, -0.5244, 0.0),
            (-29.6149, -1.7417, 0.0),
        ),
        (
            Game(
                Cylinder(9.0149, 3.0, 1.5),
                3.0336,
                3.6612,
                StandOff(2.3605, 2.7196),
                information_age_s=1.066,
            ),
            (15.1812, 18.5775, 22.7628),
            (20.8726, 16.4302, 0.0),
            (-23.8927, -26.9758, 0.0),
        ),
    ],
)
def test_tad_has_a_value_where_the_disc_before_the_pursuer_is_level_covers_the_dent(game, P, E, T):
    answer = solve_state(game, P, E, T)
    assert answer.reason == Reason.TOO_OLD
    P, E, T = map(np.array, (P, E, T))
    assert answer.value == pytest.approx(nearest_end(game, P, E, T), abs=1e-6)
    # A level pursuer has only the planar region, with its dent
    level = solve_state(game, (*P[:2], game.standoff.height_m + game.capture_radius_m), E, T)
    assert level.reason == Reason.NO_REGION
