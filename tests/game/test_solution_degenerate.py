"""The states where the formulas divide by zero or have nothing left to say: finite, sensible, and named."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.game import Ball, Cylinder, Game, Reason, StandOff, Winner, solve
from guidance.game.policies import EVADER_POLICIES, PURSUER_POLICIES
from tests.harness.examples import drawn

BALL = Game(Ball(2.0), 1.0)
CYLINDER = Game(Cylinder(2.0, 0.7, 0.5), 1.0)
HELD = Game(Cylinder(2.0, 0.7, 0.5), 1.0, standoff=StandOff(3.0, 5.0), capture_radius_m=0.25)
ORIGIN = np.zeros(3)


def at(*place):
    return np.array(place, dtype=float)


def test_right_above_an_unknown_evader_the_ball_goes_straight_down():
    solution = solve(BALL, at(3, 4, 6), at(3, 4, 0))
    assert solution.reason == Reason.OVERHEAD
    assert solution.value == pytest.approx(6.0 / math.sqrt(2.0**2 - 1.0))
    np.testing.assert_array_equal(solution.pursuer_velocity_m_s, (0.0, 0.0, -2.0))
    np.testing.assert_array_equal(solution.evader_velocity_m_s, (1.0, 0.0, 0.0))


def test_right_above_a_running_evader_the_ball_copies_it_and_descends_with_the_rest():
    solution = solve(BALL, at(3, 4, 6), at(3, 4, 0), evader_velocity_m_s=at(0.6, -0.8, 0))
    np.testing.assert_allclose(
        solution.pursuer_velocity_m_s, (0.6, -0.8, -math.sqrt(3.0)), rtol=1e-15
    )
    np.testing.assert_allclose(solution.evader_velocity_m_s, (0.6, -0.8, 0.0))
    slower = solve(BALL, at(3, 4, 6), at(3, 4, 0), evader_velocity_m_s=at(0.0, 0.5, 0))
    np.testing.assert_allclose(
        slower.pursuer_velocity_m_s, (0.0, 0.5, -math.sqrt(3.75)), rtol=1e-15
    )
    np.testing.assert_allclose(slower.evader_velocity_m_s, (0.0, 1.0, 0.0))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_half_a_metre_over_or_under_the_evader_the_ball_still_goes_straight(side):
    solution = solve(
        Game(Ball(2.0), 1.0, standoff=StandOff(0.0, 3.0)), at(3, 4, 3.0 + 0.5 * side), at(3, 4, 0)
    )
    assert solution.reason == Reason.OVERHEAD
    np.testing.assert_array_equal(solution.pursuer_velocity_m_s, (0.0, 0.0, -2.0 * side))


@pytest.mark.parametrize("pursuer", [Ball(0.5), Cylinder(0.5, 0.2, 0.2)])
def test_what_is_captured_now_does_not_depend_on_any_speed(pursuer):
    game = Game(pursuer, 0.25, capture_radius_m=1.0)
    for distance, reason in ((0.9, Reason.CAPTURED), (1.5, Reason.SOLVED)):
        for target in (None, at(90, 0, 0)):
            assert solve(game, at(distance, 0, 0), ORIGIN, target).reason == reason


def test_an_evader_seen_faster_than_its_bound_is_copied_at_its_bound():
    solution = solve(BALL, at(3, 4, 6), at(3, 4, 0), evader_velocity_m_s=at(6, -8, 0))
    np.testing.assert_allclose(
        solution.pursuer_velocity_m_s, (0.6, -0.8, -math.sqrt(3.0)), rtol=1e-15
    )


@pytest.mark.parametrize(("x", "y"), [(0, 1), (1, 0)])
def test_carried_right_over_the_evader_by_the_wind_the_ball_copies_it(x, y):
    """A start so far upwind that P is over E at the capture: wind and time are powers of two, so it is exactly so."""
    turned = [x, y, 2]
    game = Game(Ball(1.25), 0.75, wind_m_s=((0.25, 0.0)[x], (0.25, 0.0)[y]))
    solution = solve(
        game, at(-2.0, 0.0, 8.0)[turned], ORIGIN, evader_velocity_m_s=at(0.0, 0.75, 0.0)[turned]
    )
    assert solution.value == 8.0
    assert solution.reason == Reason.OVERHEAD
    np.testing.assert_allclose(solution.pursuer_velocity_m_s, at(0.25, 0.75, -1.0)[turned])
    np.testing.assert_allclose(solution.evader_velocity_m_s, at(0.0, 0.75, 0.0)[turned])
    np.testing.assert_allclose(solution.meeting_point_m, at(0.0, 6.0, 0.0)[turned])


def test_below_the_disc_the_ball_climbs_while_it_follows():
    game = Game(Ball(2.0), 1.0, standoff=StandOff(0.0, 9.0))
    solution = solve(game, at(3, 4, 6), at(3, 4, 0), evader_velocity_m_s=at(0.6, -0.8, 0))
    np.testing.assert_allclose(solution.pursuer_velocity_m_s, (0.6, -0.8, math.sqrt(3.0)))


def test_above_an_evader_that_cannot_leave_the_disc_the_ball_only_descends():
    game = Game(Ball(2.0), 1.0, standoff=StandOff(5.0, 2.0))
    for P in (at(3, 4, 6), at(4, 4, 6)):
        solution = solve(game, P, at(3, 4, 0))
        assert solution.value == pytest.approx(4.0 / 2.0)
        assert solution.reason == Reason.SOLVED
        np.testing.assert_allclose(solution.pursuer_velocity_m_s, (0, 0, -2.0), atol=1e-15)


@pytest.mark.parametrize(
    ("height", "reason"), [(11.0, Reason.SOLVED), (12.0, Reason.SOLVED), (13.0, Reason.OVERHEAD)]
)
def test_every_heading_is_as_good_only_once_the_evader_can_be_past_the_rim(height, reason):
    """The disc is 5 m wide and 2 m up: from 12 m the pursuer is there when the evader is on its rim."""
    game = Game(Ball(2.0), 1.0, standoff=StandOff(5.0, 2.0))
    assert solve(game, at(3, 4, height), at(3, 4, 0)).reason == reason


def test_over_an_evader_last_seen_below_a_pursuer_in_its_plane_stays_in_it():
    game = Game(Ball(2.0), 1.0, information_age_s=1.0)
    for seen in (None, at(0.6, -0.8, 0)):
        solution = solve(game, at(3, 4, 0), at(3, 4, 0), evader_velocity_m_s=seen)
        assert (solution.reason, solution.value) == (Reason.TOO_OLD, 1.0)
        np.testing.assert_allclose(
            solution.pursuer_velocity_m_s, (0, 0, 0) if seen is None else seen, atol=1e-15
        )


def test_a_cylinder_above_the_evader_keeps_with_it_and_descends_in_full():
    solution = solve(CYLINDER, at(3, 4, 6), at(3, 4, 0), evader_velocity_m_s=at(0.6, -0.8, 0))
    np.testing.assert_allclose(solution.pursuer_velocity_m_s, (0.6, -0.8, -0.5))
    assert solution.value == pytest.approx(12.0)
    assert solution.reason == Reason.OVERHEAD
    still = solve(CYLINDER, at(3, 4, 6), at(3, 4, 0))
    np.testing.assert_array_equal(still.pursuer_velocity_m_s, (0.0, 0.0, -0.5))


@pytest.mark.parametrize("height", [4.75, 5.0, 5.25])
def test_inside_the_disc_and_its_tolerance_the_pursuer_only_follows(height):
    solution = solve(HELD, at(1, 1, height), at(0, 0, 0), evader_velocity_m_s=at(0.3, 0.4, 0))
    assert solution.value == 0.0
    assert solution.reason == Reason.CAPTURED
    np.testing.assert_allclose(solution.pursuer_velocity_m_s, (0.3, 0.4, 0.0))
    race = solve(
        HELD, at(1, 1, height), at(0, 0, 0), at(9, 0, 0), evader_velocity_m_s=at(0.3, 0.4, 0)
    )
    assert (race.value, race.winner, race.reason) == (9.0, Winner.PURSUER, Reason.CAPTURED)
    np.testing.assert_allclose(race.pursuer_velocity_m_s, (0.3, 0.4, 0.0))


@pytest.mark.parametrize("pursuer", [Ball(2.0), Cylinder(2.0, 0.7, 0.5)])
def test_an_evader_seen_a_while_ago_is_captured_once_it_cannot_have_left_the_disc(pursuer):
    game = Game(pursuer, 1.0, standoff=StandOff(3.0, 5.0), information_age_s=1.0)
    for distance, reason in (
        (1.5, Reason.CAPTURED),
        (2.0, Reason.CAPTURED),
        (2.5, Reason.SOLVED),
        (4.5, Reason.SOLVED),
    ):
        assert solve(game, at(distance, 0, 5), ORIGIN).reason == reason
        in_tad = Reason.TOO_OLD if reason == Reason.SOLVED else reason
        assert solve(game, at(distance, 0, 5), ORIGIN, at(90, 0, 0)).reason == in_tad


def test_below_the_disc_a_cylinder_climbs_at_its_climb_speed():
    solution = solve(HELD, at(1, 1, 2.0), at(0, 0, 0))
    assert solution.value == pytest.approx((3.0 - 0.25) / 0.7)
    np.testing.assert_array_equal(solution.pursuer_velocity_m_s, (0.0, 0.0, 0.7))
    assert solution.reason == Reason.SOLVED


def test_in_the_evaders_plane_everybody_stays_in_it():
    for target in (None, at(40, 3, 0)):
        solution = solve(BALL, at(-5, 0, 0), ORIGIN, target)
        assert solution.pursuer_velocity_m_s[2] == 0.0
    assert solve(BALL, at(-5, 0, 0), ORIGIN).value == pytest.approx(5.0)


def test_at_the_evader_the_game_is_over():
    for game in (BALL, CYLINDER):
        chase = solve(game, ORIGIN, ORIGIN)
        race = solve(game, ORIGIN, ORIGIN, at(3, 4, 0))
        assert (chase.value, chase.reason) == (0.0, Reason.CAPTURED)
        assert (race.value, race.winner, race.reason) == (5.0, Winner.PURSUER, Reason.CAPTURED)
        np.testing.assert_array_equal(chase.pursuer_velocity_m_s, 0.0)
        np.testing.assert_array_equal(race.meeting_point_m, 0.0)
        np.testing.assert_allclose(race.evader_velocity_m_s, (0.6, 0.8, 0.0))


def test_an_evader_at_its_target_has_won_and_stays():
    for game in (BALL, CYLINDER):
        solution = solve(game, at(0, 0, 7), ORIGIN, ORIGIN)
        assert (solution.winner, solution.reason, solution.meeting_time_s) == (
            Winner.EVADER,
            Reason.ARRIVED,
            0.0,
        )
        assert solution.value == pytest.approx(7.0)
        np.testing.assert_array_equal(solution.evader_velocity_m_s, 0.0)
        assert solution.pursuer_velocity_m_s[2] < 0


def test_all_three_in_one_place_is_the_barrier():
    solution = solve(BALL, ORIGIN, ORIGIN, ORIGIN)
    assert (solution.winner, solution.value, solution.margin_s) == (Winner.UNDECIDED, 0.0, 0.0)
    assert solution.reason == Reason.CAPTURED


def test_a_state_on_the_barrier_is_undecided_and_both_go_for_the_target():
    solution = solve(BALL, at(8, 0, 0), at(0, 4, 0), ORIGIN)
    assert (solution.winner, solution.reason, solution.margin_s) == (
        Winner.UNDECIDED,
        Reason.ON_BARRIER,
        0.0,
    )
    assert solution.value == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(solution.pursuer_velocity_m_s, (-2.0, 0.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(solution.evader_velocity_m_s, (0.0, -1.0, 0.0), atol=1e-9)


@pytest.mark.parametrize("pursuer", [Ball(2.0), Cylinder(2.0, 0.7, 0.5)])
def test_on_the_barrier_of_a_stand_off_both_take_the_time_that_the_evader_needs(pursuer):
    solution = solve(
        Game(pursuer, 1.0, standoff=StandOff(3.0, 2.0)), at(11, 0, 2), at(0, 4, 0), ORIGIN
    )
    assert (solution.winner, solution.reason, solution.margin_s) == (
        Winner.UNDECIDED,
        Reason.ON_BARRIER,
        0.0,
    )
    assert (solution.value, solution.meeting_time_s) == (0.0, 4.0)
    np.testing.assert_array_equal(solution.meeting_point_m, 0.0)
    np.testing.assert_array_equal(solution.pursuer_velocity_m_s, (-2.0, 0.0, 0.0))
    np.testing.assert_array_equal(solution.evader_velocity_m_s, (0.0, -1.0, 0.0))


def test_a_cylinder_captures_by_both_distances_and_a_ball_by_the_total():
    reasons = [
        solve(Game(pursuer, 1.0, capture_radius_m=1.0), at(0.8, 0, 0.8), ORIGIN, at(9, 0, 0)).reason
        for pursuer in (Cylinder(2.0, 0.7, 0.5), Ball(2.0))
    ]
    assert reasons == [Reason.CAPTURED, Reason.SOLVED]


def test_an_evader_runs_until_it_is_there():
    for game in (BALL, CYLINDER):
        solution = solve(game, at(20, 0, 7), at(0.25, 0, 0), ORIGIN)
        assert (solution.winner, solution.reason, solution.meeting_time_s) == (
            Winner.EVADER,
            Reason.SOLVED,
            0.25,
        )
        np.testing.assert_array_equal(solution.evader_velocity_m_s, (-1.0, 0.0, 0.0))


@pytest.mark.parametrize("pursuer", [Ball(2.0), Cylinder(2.0, 0.7, 0.5)])
def test_an_evader_that_may_be_at_a_guarded_target_is_undecided(pursuer):
    """Seen half a second ago a tenth of a metre from it, and the pursuer is well within its capture radius."""
    game = Game(
        pursuer, 1.0, standoff=StandOff(3.0, 2.0), capture_radius_m=0.5, information_age_s=0.5
    )
    solution = solve(game, at(0, 0, 2.2), at(0.1, 0, 0), ORIGIN)
    assert (solution.winner, solution.reason, solution.meeting_time_s) == (
        Winner.UNDECIDED,
        Reason.CAPTURED,
        0.0,
    )
    assert solution.value == 0.0


def test_a_target_at_the_centre_of_the_circle_is_finite():
    P = at(0, 0, 9)
    E = at(3, 0, 0)
    solution = solve(BALL, P, E, at(4, 0, 0))
    assert solution.winner == Winner.EVADER
    assert all(np.isfinite(field).all() for field in solution)


def test_the_pursuer_that_guards_the_target_in_time_waits_there():
    solution = solve(CYLINDER, ORIGIN, at(9, 0, 0), ORIGIN)
    assert solution.winner == Winner.PURSUER
    late = solve(BALL, at(0.5, 0, 30), at(1, 0, 0), ORIGIN)
    assert late.winner == Winner.EVADER
    there = solve(
        Game(Ball(2.0), 1.0, standoff=StandOff(1.0, 3.0)), at(30, 0, 3), at(1, 0, 0), ORIGIN
    )
    assert there.winner == Winner.EVADER
    np.testing.assert_allclose(there.pursuer_velocity_m_s, (-2.0, 0.0, 0.0))


def test_a_cylinder_with_nothing_to_gain_horizontally_holds_over_its_point():
    solution = solve(HELD, at(0.5, 0, 25), at(8, 0, 0), ORIGIN)
    assert solution.winner == Winner.EVADER
    np.testing.assert_array_equal(solution.pursuer_velocity_m_s, (0.0, 0.0, -0.5))


def test_an_evader_in_space_that_is_captured_is_followed_in_space():
    game = Game(Ball(2.0), 1.0, capture_radius_m=1.0, evader_space="space")
    seen = at(0.1, 0.2, -0.3)
    held = solve(game, at(0, 0, 0.5), ORIGIN, evader_velocity_m_s=seen)
    assert (held.value, held.reason) == (0.0, Reason.CAPTURED)
    np.testing.assert_allclose(held.pursuer_velocity_m_s, seen)
    fast = solve(game, at(0, 0, 0.5), ORIGIN, evader_velocity_m_s=at(0, 0, -30))
    np.testing.assert_allclose(fast.pursuer_velocity_m_s, (0, 0, -1.0))
    free = solve(game, at(0, 0, 5.0), ORIGIN, evader_velocity_m_s=seen)
    np.testing.assert_allclose(free.pursuer_velocity_m_s, (0, 0, -2.0))


def test_an_evader_in_space_is_captured_by_its_distance_in_space():
    game = Game(Ball(2.0), 1.0, capture_radius_m=1.5, evader_space="space")
    for P, reason in (
        ((5, 0, 0), Reason.SOLVED),
        ((0, 5, 0), Reason.SOLVED),
        ((0, 0, 1), Reason.CAPTURED),
    ):
        for target in (at(-20, 0, 0), at(0, 0, -20)):
            assert solve(game, at(*P), ORIGIN, target).reason == reason


def test_a_cylinder_holds_what_it_has_met_to_a_nanometre_and_no_more():
    for over, fraction in ((1e-9, 0.0), (1.1e-9, 1.0)):
        beside = solve(CYLINDER, at(over, 0, 5), ORIGIN, evader_velocity_m_s=ORIGIN)
        np.testing.assert_allclose(
            beside.pursuer_velocity_m_s, (-2.0 * fraction, 0, -0.5), atol=1e-12
        )
        above = solve(CYLINDER, at(5, 0, over), ORIGIN)
        np.testing.assert_allclose(
            above.pursuer_velocity_m_s, (-2.0, 0, -0.5 * fraction), atol=1e-12
        )


@pytest.mark.parametrize("age", [0.0, 0.5])
def test_a_cylinder_over_its_disc_holds_in_tad_as_in_pe(age):
    """Catches jumps to full speed over a part of the disc that is reached, against a weaving evader.

    Step by step against a weaving evader: a part that is reached is held, without jumps to full speed.
    """
    game = Game(
        Cylinder(12.0, 3.0, 1.5),
        3.0,
        standoff=StandOff(4.0, 5.0),
        capture_radius_m=0.2,
        information_age_s=age,
    )
    step = 0.02
    run = at(3.0, 0, 0)
    for target in (None, at(300, 100, 0)):
        P = at(1.0, 0.5, 50.0)
        E = ORIGIN
        for tick in range(1200):
            solution = solve(game, P, E, target, evader_velocity_m_s=run)
            assert np.hypot(*solution.pursuer_velocity_m_s[:2]) <= 3.0 + 1e-9
            assert solution.winner == Winner.PURSUER
            angle = 0.5 * math.sin(0.01 * tick)
            run = at(3.0 * math.cos(angle), 3.0 * math.sin(angle), 0)
            P = P + step * solution.pursuer_velocity_m_s
            E = E + step * run


def test_a_pursuer_over_a_guarded_target_waits_there_whatever_it_sees():
    for speeds in (Ball(2.0), Cylinder(2.0, 0.7, 0.5)):
        game = Game(speeds, 1.0, standoff=StandOff(3.0, 5.0))
        waits = solve(game, at(0, 0, 40), at(6, 0, 0), ORIGIN, evader_velocity_m_s=at(-1, 0, 0))
        assert waits.winner == Winner.EVADER
        np.testing.assert_array_equal(waits.pursuer_velocity_m_s[:2], 0.0)


def test_all_three_on_one_line_in_space_no_velocity_is_beyond_its_bound():
    """P is at a possible position of E, up to rounding, so its direction is a rounding error."""
    rng = np.random.default_rng(6)
    E = rng.uniform(-20.0, 20.0, (300, 3))
    way = rng.normal(size=(300, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    game = Game(Ball(2.0), 1.0, 1.0, information_age_s=1.0, evader_space="space")
    solution = solve(game, E + way, E, E + 5.0 * way)
    assert np.isfinite(solution.value).all()
    assert np.linalg.norm(solution.pursuer_velocity_m_s, axis=1).max() <= 2.0 + 1e-12
    assert np.linalg.norm(solution.evader_velocity_m_s, axis=1).max() <= 1.0 + 1e-12


grid = st.sampled_from([-3.0, -1.0, 0.0, 0.0, 0.5, 1.0, 2.0, 3.0])
place = st.tuples(grid, grid, grid).map(np.array)


@settings(max_examples=drawn(20), deadline=None)
@given(P=place, E=place, T=place, seen=place)
def test_no_state_is_without_a_finite_answer(games, P, E, T, seen):
    """Places on a coarse grid, so that all kinds of coincidence happen."""
    for name, game in games.items():
        level = 0.0 if game.evader_space == "plane" else 1.0
        E = E * [1, 1, level]
        T = T * [1, 1, level]
        for target in (None, T):
            solution = solve(game, P, E, target, evader_velocity_m_s=seen)
            for field in solution._replace(margin_s=0.0):
                assert np.isfinite(field).all(), name
            assert solution.value >= -1e-12, name
            assert solution.meeting_time_s >= 0.0, name
            speed = np.linalg.norm(solution.evader_velocity_m_s)
            assert speed <= game.evader_speed_m_s * (1 + 1e-12), name
            through_air = solution.pursuer_velocity_m_s - [*game.wind_m_s, 0.0]
            if isinstance(game.pursuer, Ball):
                assert np.linalg.norm(through_air) <= game.pursuer.speed_m_s * (1 + 1e-12), name
            else:
                assert math.hypot(*through_air[:2]) <= game.pursuer.horizontal_m_s * (1 + 1e-12), (
                    name
                )
                assert -game.pursuer.descent_m_s <= through_air[2] <= game.pursuer.climb_m_s, name
        for policy in (*PURSUER_POLICIES.values(), *EVADER_POLICIES.values()):
            assert np.isfinite(policy(game, P, E, T, seen)).all(), name
