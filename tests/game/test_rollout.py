"""Two policies closed over point masses: ends located exactly, and the paper's own stepping."""

import math
from importlib import import_module

import numpy as np
import pytest

from guidance.game import Ball, Cylinder, End, Exact, Game, Paper, StandOff, rollout, solve

PAPER = Game(Ball(2.0), 1.0)
P = np.array([8.0, 1.42, 9.41])
E = np.array([7.92, 9.6, 0.0])
P_TAD = np.array([6.97, 5.83, 9.15])
E_TAD = np.array([9.80, 0.33, 0.0])
T_TAD = np.zeros(3)


def steady(*velocity):
    return lambda game, pursuer, evader, target=None, evader_velocity_m_s=None: (
        np.array(velocity) + 0.0 * evader
    )


@pytest.mark.parametrize("step_s", [0.01, 0.1])
def test_pure_pursuit_of_a_straight_run_has_its_closed_form(step_s):
    """Catches a rollout whose curved way is not that of its differential equation."""
    d = math.dist(P[:2], E[:2])
    D = math.dist(P, E)
    end = rollout(PAPER, P, E, pursuer_policy="pure_pursuit", stepping=Exact(step_s=step_s))
    assert end.time_s == pytest.approx((2.0 * D + d) / (2.0**2 - 1.0), abs=1e-6)
    assert end.end == End.CAPTURED


@pytest.mark.parametrize(
    "stepping", [Exact(), Exact(step_s=0.5), Exact(order=1), Exact(step_s=0.5, order=1)]
)
def test_optimal_play_is_straight_so_no_step_is_too_long_for_it(stepping):
    """Catches a rollout that steps over the end of a game."""
    chase = rollout(PAPER, P, E, stepping=stepping)
    assert chase.time_s == pytest.approx(solve(PAPER, P, E).value, abs=1e-7)
    np.testing.assert_allclose(chase.evader_m, solve(PAPER, P, E).meeting_point_m, atol=1e-6)
    np.testing.assert_allclose(chase.pursuer_m, chase.evader_m, atol=1e-6)
    assert math.isnan(chase.distance_m)
    race = rollout(PAPER, P_TAD, E_TAD, T_TAD, stepping=stepping)
    assert race.distance_m == pytest.approx(solve(PAPER, P_TAD, E_TAD, T_TAD).value, abs=1e-6)


def test_a_passing_encounter_shorter_than_a_step_is_not_missed():
    """Head-on at 3 m/s with a capture radius of 1 mm: within reach for 0.7 ms of a 0.1 s step."""
    game = Game(Ball(2.0), 1.0, capture_radius_m=1e-3)
    head_on = {"pursuer_policy": steady(2.0, 0.0, 0.0), "evader_policy": steady(-1.0, 0.0, 0.0)}
    end = rollout(
        game, np.zeros(3), np.array([10.0, 0.0, 0.0]), **head_on, stepping=Exact(step_s=0.1)
    )
    assert end.end == End.CAPTURED
    assert end.time_s == pytest.approx((10.0 - 1e-3) / 3.0, abs=1e-8)
    beside = rollout(game, np.zeros(3), np.array([10.0, 2e-3, 0.0]), **head_on, duration_s=7.0)
    assert (beside.end, beside.time_s) == (End.TIME_UP, 7.0)


def test_arrival_is_located_exactly():
    T = np.array([0.3, 0.4, 0.0])
    for chosen in (Exact(step_s=0.3), Exact(step_s=0.3, order=1)):
        end = rollout(
            PAPER, np.array([9.0, 9.0, 9.0]), np.zeros(3), T, pursuer_policy="hold", stepping=chosen
        )
        assert end.end == End.ARRIVED
        assert end.time_s == pytest.approx(0.5, abs=1e-8)
        assert end.distance_m == pytest.approx(0.0, abs=1e-8)


def test_capture_comes_before_an_arrival_at_the_same_instant():
    end = rollout(PAPER, np.zeros(3), np.zeros(3), np.zeros(3))
    assert (end.end, end.time_s) == (End.CAPTURED, 0.0)


@pytest.mark.parametrize(
    ("start", "target", "end"), [(3e-9, 5.0, End.CAPTURED), (5.0, 1e-9, End.ARRIVED)]
)
def test_an_end_that_is_a_nanosecond_away_has_come_and_no_other(start, target, end):
    """At 3 m/s to each other, or at 1 m/s to the target."""
    for share, expected in ((1.0, end), (1.1, End.TIME_UP)):
        P = np.array([share * start, 0.0, 0.0])
        T = np.array([0.0, share * target, 0.0])
        names = {"pursuer_policy": "hold", "evader_policy": "hold", "duration_s": 1e-12}
        assert rollout(PAPER, P, np.zeros(3), T, **names).end == expected


def test_time_is_up_when_it_is():
    end = rollout(
        PAPER, P, E, pursuer_policy="hold", evader_policy="hold", duration_s=0.035, keep_path=True
    )
    assert (end.end, end.time_s) == (End.TIME_UP, 0.035)
    assert [float(sample.time_s) for sample in end.path] == pytest.approx(
        [0.0, 0.01, 0.02, 0.03, 0.035]
    )
    np.testing.assert_array_equal(end.pursuer_m, P)


def test_ten_minutes_without_a_path_are_what_is_played_by_default():
    end = rollout(
        PAPER, P, E, pursuer_policy="hold", evader_policy="hold", stepping=Exact(step_s=100.0)
    )
    assert (end.end, end.time_s, end.path) == (End.TIME_UP, 600.0, ())


def test_a_game_that_takes_too_many_steps_is_given_up(monkeypatch):
    """So close beside the evader that the least time to a capture never lets a step be long."""
    monkeypatch.setattr(import_module("guidance.game.rollout"), "SPARE_STEPS", 5)
    side_by_side = {"pursuer_policy": "hold", "evader_policy": "hold"}
    end = rollout(
        PAPER,
        np.array([1e-6, 0.0, 0.0]),
        np.zeros(3),
        **side_by_side,
        duration_s=0.05,
        keep_path=True,
    )
    assert end.end == End.TIME_UP
    assert end.time_s < 0.05
    assert len(end.path) == 11


@pytest.mark.parametrize(("start", "direction"), [(6.5, -1.0), (3.5, 1.0)])
def test_a_cylinder_levels_out_at_its_disc_without_chatter(start, direction):
    game = Game(Cylinder(4.0, 3.0, 1.0), 1.0, standoff=StandOff(2.0, 5.0))
    end = rollout(
        game,
        np.array([0.0, 0.0, start]),
        np.array([30.0, 0.0, 0.0]),
        stepping=Exact(step_s=0.2),
        keep_path=True,
    )
    assert end.end == End.CAPTURED
    assert end.time_s == pytest.approx(28.0 / 3.0, abs=1e-6)
    heights = np.array([sample.pursuer_m[2] for sample in end.path])
    assert (direction * np.diff(heights) >= -1e-8).all()
    assert heights[-1] == pytest.approx(5.0, abs=1e-8)


@pytest.mark.parametrize("z", [9.0, 1.0])
def test_a_cylinder_that_falls_or_climbs_longer_than_it_flies_ends_with_its_height(z):
    game = Game(Cylinder(4.0, 3.0, 1.0), 1.0, standoff=StandOff(2.0, 5.0))
    end = rollout(game, np.array([0.0, 0.0, z]), np.array([1.0, 0.0, 0.0]))
    assert end.time_s == pytest.approx({9.0: 4.0, 1.0: 4.0 / 3.0}[z], abs=1e-6)


def test_wind_carries_the_pursuer_and_the_value_knows():
    game = Game(Ball(2.0), 1.0, wind_m_s=(0.0, 0.5))
    assert rollout(game, P, E).time_s == pytest.approx(solve(game, P, E).value, abs=1e-6)


def test_a_moving_target_moves():
    game = Game(Ball(2.0), 1.0, target_velocity_m_s=(0.0, 0.5))
    end = rollout(
        game, np.array([99.0, 0.0, 9.0]), np.zeros(3), np.array([3.0, 0.0, 0.0]), keep_path=True
    )
    assert end.end == End.ARRIVED
    np.testing.assert_allclose(end.path[-1].target_m, [3.0, 0.5 * float(end.time_s), 0.0])
    assert end.time_s == pytest.approx(3.0 / math.sqrt(1.0 - 0.25), abs=1e-6)


def test_an_evader_in_space_is_met_on_its_sphere():
    game = Game(Ball(2.0), 1.0, evader_space="space")
    P = np.array([0.0, 0.0, 9.0])
    E = np.array([1.0, 2.0, 3.0])
    T = np.array([-9.0, 0.0, -4.0])
    end = rollout(game, P, E, T)
    solution = solve(game, P, E, T)
    assert end.distance_m == pytest.approx(solution.value, abs=1e-6)
    np.testing.assert_allclose(end.evader_m, solution.meeting_point_m, atol=1e-6)
    late = rollout(game, P, E, np.array([1.0, 2.0, 2.0]), pursuer_policy="hold")
    assert (late.end, round(float(late.time_s), 6)) == (End.ARRIVED, 1.0)


@pytest.mark.parametrize(
    "stepping", [Exact(step_s=0.1), Exact(step_s=0.1, order=1), Paper(step_s=0.1, capture_m=0.1)]
)
def test_a_batch_is_its_single_games(stepping):
    """Catches a game of a batch that is changed by the game beside it."""
    rng = np.random.default_rng(8)
    P, E, T = rng.uniform(-9.0, 9.0, (3, 7, 3)) * [1.0, 1.0, 0.0]
    P[:, 2] = rng.uniform(0.0, 9.0, 7)
    for names in ({}, {"pursuer_policy": "pure_pursuit"}, {"evader_policy": "task_oriented"}):
        batch = rollout(PAPER, P, E, T, **names, stepping=stepping, duration_s=30.0)
        for index in range(0, 7, 3):
            single = rollout(
                PAPER, P[index], E[index], T[index], **names, stepping=stepping, duration_s=30.0
            )
            for a, b in zip(batch[:-1], single[:-1], strict=True):
                np.testing.assert_array_equal(a[index], b)


def test_one_start_broadcasts_against_many():
    end = rollout(
        PAPER, P, np.stack([E, E + np.array([1.0, 0.0, 0.0])]), stepping=Exact(step_s=0.1)
    )
    assert end.pursuer_m.shape == (2, 3)
    assert end.time_s[0] == rollout(PAPER, P, E, stepping=Exact(step_s=0.1)).time_s


def test_the_papers_stepping_counts_samples_and_reads_the_distance_at_the_pursuer():
    """P 1.005 m from E, which stays: after 50 steps of 2 cm, 5 mm are left; that is sample 51."""
    start = np.array([1.005, 0.0, 0.0])
    names = {"pursuer_policy": "pure_pursuit", "evader_policy": "hold"}
    end = rollout(
        PAPER,
        start,
        np.zeros(3),
        np.array([-3.0, 0.0, 0.0]),
        **names,
        stepping=Paper(),
        keep_path=True,
    )
    assert end.end == End.CAPTURED
    assert end.time_s == pytest.approx(0.51)
    assert len(end.path) == 51
    assert end.distance_m == pytest.approx(3.005)
    never = rollout(
        PAPER,
        start,
        np.zeros(3),
        pursuer_policy="hold",
        evader_policy="hold",
        stepping=Paper(),
        duration_s=0.1,
    )
    assert (never.end, never.time_s) == (End.TIME_UP, 0.1)


def test_the_papers_stepping_captures_within_its_radius_and_not_at_it():
    stay = {
        "pursuer_policy": "hold",
        "evader_policy": "hold",
        "stepping": Paper(capture_m=0.25),
        "duration_s": 0.01,
    }
    for distance, end in ((0.25, End.TIME_UP), (0.24, End.CAPTURED)):
        assert rollout(PAPER, np.array([distance, 0.0, 0.0]), np.zeros(3), **stay).end == end


@pytest.mark.parametrize("stepping", [Exact(order=1), Paper()])
def test_a_policy_sees_how_the_evader_just_moved(stepping):
    seen = []

    def watching(game, pursuer, evader, target=None, evader_velocity_m_s=None):
        seen.append(evader_velocity_m_s.copy())
        return 0.0 * pursuer

    names = {"pursuer_policy": watching, "evader_policy": steady(0.0, 0.7, 0.0)}
    rollout(PAPER, P, E, **names, stepping=stepping, duration_s=0.03)
    np.testing.assert_array_equal(seen[:2], [[0, 0, 0], [0, 0.7, 0]])
    np.testing.assert_array_equal(seen[2:], [[0, 0.7, 0]] * (len(seen) - 2))
