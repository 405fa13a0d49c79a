import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.game import Ball, Cylinder
from guidance.strategies import bounded, random_turns, recorded, waypoints

START = np.array([1.0, 2.0, 0.0])


def followed(course, start, duration_s, step_s=0.01):
    """Positions of a point that follows the course, every step."""
    places = [start]
    for k in range(round(duration_s / step_s)):
        places.append(places[-1] + step_s * course.velocity_m_s(k * step_s, places[-1]))
    return np.array(places)


def test_waypoints_are_passed_one_after_the_other_at_full_speed_and_the_last_is_kept():
    course = waypoints(START, [(4.0, 2.0, 0.0), (4.0, 6.0, 0.0)], Ball(2.0))
    np.testing.assert_allclose(course.times_s, [0.0, 1.5, 3.5])
    np.testing.assert_allclose(course.velocity_m_s(0.0, START), [2.0, 0.0, 0.0])
    path = followed(course, START, 6.0)
    np.testing.assert_allclose(path[150], [4.0, 2.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(path[-1], [4.0, 6.0, 0.0], atol=1e-9)


def test_a_multicopters_legs_last_as_long_as_the_slower_of_level_and_vertical_flight():
    course = waypoints(START, [(7.0, 2.0, 3.0), (7.0, 2.0, 0.0)], Cylinder(2.0, 0.5, 1.0))
    np.testing.assert_allclose(np.diff(course.times_s), [6.0, 3.0])


def test_who_is_beside_the_course_goes_back_to_it():
    course = waypoints(START, [(50.0, 2.0, 0.0)], Ball(2.0))
    path = followed(course, START + np.array([0.0, 3.0, 0.0]), 10.0)
    assert abs(path[-1, 1] - 2.0) < 3.0 * np.exp(-4.5)


def test_corners_are_the_times_of_the_table():
    course = waypoints(START, [(4.0, 2.0, 0.0), (4.0, 6.0, 0.0)], Ball(2.0))
    assert [float(course.corner_s(t)) for t in (0.0, 1.0, 1.5, 3.5)] == [1.5, 1.5, 3.5, np.inf]


@given(st.integers(0, 2**40), st.floats(0.5, 8.0), st.floats(0.1, np.pi))
def test_random_turns_are_at_full_speed_and_no_sharper_than_allowed(seed, every_s, max_turn_rad):
    course = random_turns(
        START, 1.5, seed, stream=1, every_s=every_s, max_turn_rad=max_turn_rad, duration_s=40.0
    )
    legs = np.diff(course.places_m, axis=0)
    np.testing.assert_allclose(np.linalg.norm(legs, axis=1), 1.5 * every_s)
    assert not legs[:, 2].any()
    heading = np.arctan2(legs[:, 1], legs[:, 0])
    turn = (np.diff(heading) + np.pi) % (2.0 * np.pi) - np.pi
    assert np.all(np.abs(turn) <= max_turn_rad + 1e-6)
    assert course.times_s[-1] >= 40.0


def test_a_recorded_track_is_moved_to_where_the_player_starts():
    course = recorded(START, [(10.0, 5.0, 5.0, 0.0), (12.0, 9.0, 5.0, 0.0)])
    np.testing.assert_allclose(
        course.velocity_m_s(1.0, START + np.array([2.0, 0.0, 0.0])), [2.0, 0.0, 0.0]
    )
    np.testing.assert_allclose(
        course.velocity_m_s(5.0, START + np.array([4.0, 0.0, 0.0])), 0.0, atol=1e-12
    )


def test_courses_of_a_batch_are_those_of_its_rows():
    starts = np.random.default_rng(1).uniform(-9.0, 9.0, (5, 3))
    speeds = np.linspace(1.0, 2.0, 5)
    seeds = np.arange(5)
    turning = {"stream": 2, "every_s": 2.0, "max_turn_rad": 1.0, "duration_s": 9.0}
    points = [(1.0, 1.0, 1.0), (-3.0, 0.0, 2.0)]
    track = [(0.0, 0.0, 0.0, 0.0), (4.0, 9.0, 0.0, 1.0)]
    for batch, alone in (
        (
            random_turns(starts, speeds, seeds, **turning),
            lambda i: random_turns(starts[i], speeds[i], i, **turning),
        ),
        (
            waypoints(starts, points, Ball(speeds)),
            lambda i: waypoints(starts[i], points, Ball(speeds[i])),
        ),
        (recorded(starts, track), lambda i: recorded(starts[i], track)),
    ):
        now_s = np.linspace(0.0, 8.0, 5)
        together = batch.velocity_m_s(now_s, starts)
        corners = batch.corner_s(now_s)
        for i in range(5):
            np.testing.assert_array_equal(alone(i).velocity_m_s(now_s[i], starts[i]), together[i])
            assert alone(i).corner_s(now_s[i]) == corners[i]


@pytest.mark.parametrize("speed", [0.0, 1.0, 5.0])
def test_a_bounded_velocity_keeps_its_heading(speed):
    v = np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0], [0.3, 0.4, 0.0]])
    w = bounded(v, speed)
    np.testing.assert_allclose(np.linalg.norm(w, axis=1), np.minimum([5.0, 0.0, 0.5], speed))
    np.testing.assert_allclose(np.cross(v, w), 0.0, atol=1e-12)
