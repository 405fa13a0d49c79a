"""Closed forms written out again as the paper and geometry give them, one state at a time."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.game import (
    Ball,
    Cylinder,
    Game,
    StandOff,
    apollonius_circle,
    apollonius_sphere,
    barrier,
    solve,
)
from tests.harness.examples import drawn

DELTA = 2.0
PAPER = Game(Ball(DELTA), 1.0)
P_PE = np.array([8.0, 1.42, 9.41])
E_PE = np.array([7.92, 9.6, 0.0])
P_TAD = np.array([6.97, 5.83, 9.15])
E_TAD = np.array([9.80, 0.33, 0.0])
T_TAD = np.zeros(3)

places = st.tuples(*[st.floats(-50.0, 50.0)] * 2)
heights = st.floats(0.0, 50.0)
patient = settings(deadline=None)


def as_written_pe(P, E, delta, v):
    """Time, q*, u* and v* by the formulas of section III, trigonometry and all."""
    (xp, yp, zp) = P
    (xe, ye) = E[:2]
    d = math.hypot(xe - xp, ye - yp)
    cos = (xe - xp) / d
    sin = (ye - yp) / d
    root = math.sqrt((delta**2 - 1) * zp**2 + delta**2 * d**2)
    r = math.sqrt(zp**2 / (delta**2 - 1) + delta**2 * d**2 / (delta**2 - 1) ** 2)
    q = (
        (delta**2 * xe - xp) / (delta**2 - 1) + r * cos,
        (delta**2 * ye - yp) / (delta**2 - 1) + r * sin,
        0.0,
    )
    cos_phi = (delta**2 * d + root) / (delta * (d + root))
    sin_phi = (delta**2 - 1) * zp / (delta * (d + root))
    u = delta * v
    return (
        (d + root) / (v * (delta**2 - 1)),
        q,
        (u * cos_phi * cos, u * cos_phi * sin, -u * sin_phi),
        (v * cos, v * sin),
    )


def as_written_tad(P, E, delta, v):
    """Final distance, g*, u* and v* by the formulas of section IV, with T at the origin."""
    (xp, yp, zp) = P
    (xe, ye) = E[:2]
    hand = delta**2 - 1
    d = math.hypot(xe - xp, ye - yp)
    r = math.sqrt(zp**2 / hand + delta**2 * d**2 / hand**2)
    away = math.hypot(delta**2 * xe - xp, delta**2 * ye - yp)
    cos = (delta**2 * xe - xp) / away
    sin = (delta**2 * ye - yp) / away
    f = (xe - xp) * cos + (ye - yp) * sin
    alpha = math.sqrt(d**2 + hand**2 * r**2 - 2 * r * hand * f)
    across = delta**4 * d**2 + hand**2 * r**2 - 2 * r * delta**2 * hand * f
    slant = math.sqrt(across + hand**2 * zp**2)
    g = ((delta**2 * xe - xp) / hand - r * cos, (delta**2 * ye - yp) / hand - r * sin, 0.0)
    velocity_e = (v * (xe - xp - r * hand * cos) / alpha, v * (ye - yp - r * hand * sin) / alpha)
    u = delta * v
    velocity_p = (
        u * (delta**2 * (xe - xp) - r * hand * cos) / slant,
        u * (delta**2 * (ye - yp) - r * hand * sin) / slant,
        -u * hand * zp / slant,
    )
    return away / hand - r, g, velocity_p, velocity_e


@patient
@given(P=places, z=heights, E=places, delta=st.floats(1.05, 5.0), v=st.floats(0.2, 5.0))
def test_pe_is_as_the_paper_writes_it(P, z, E, delta, v):
    P = np.array([*P, z])
    E = np.array([*E, 0.0])
    if math.dist(P[:2], E[:2]) < 1e-3:
        return
    time, q, u_star, v_star = as_written_pe(P, E, delta, v)
    solution = solve(Game(Ball(delta * v), v), P, E)
    assert solution.winner == 1
    assert solution.margin_s == math.inf
    assert solution.value == pytest.approx(time, rel=1e-12)
    assert solution.meeting_time_s == pytest.approx(time, rel=1e-12)
    np.testing.assert_allclose(solution.meeting_point_m, q, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(solution.pursuer_velocity_m_s, u_star, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(solution.evader_velocity_m_s, (*v_star, 0.0), rtol=1e-9, atol=1e-9)


@patient
@given(P=places, z=heights, E=places, delta=st.floats(1.05, 5.0), v=st.floats(0.2, 5.0))
def test_tad_is_as_the_paper_writes_it_on_both_sides_of_the_barrier(P, z, E, delta, v):
    P = np.array([*P, z])
    E = np.array([*E, 0.0])
    T = np.zeros(3)
    B = delta**2 * (E[0] ** 2 + E[1] ** 2) - (P @ P)
    if abs(B) < 1e-3 or math.dist(P, E) < 0.1:
        return
    assert barrier(P, E, T, delta) == pytest.approx(B, rel=1e-12)
    solution = solve(Game(Ball(delta * v), v), P, E, T)
    assert solution.winner == math.copysign(1, B)
    assert solution.margin_s * delta * v * (
        delta * math.hypot(*E) + math.hypot(*P)
    ) == pytest.approx(B, rel=1e-6)
    if B > 0:
        left, g, u_star, v_star = as_written_tad(P, E, delta, v)
        assert solution.value == pytest.approx(left, rel=1e-6, abs=1e-6)
        np.testing.assert_allclose(solution.meeting_point_m, g, rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(
            solution.meeting_time_s * v, math.dist(g, E), rtol=1e-7, atol=1e-7
        )
        np.testing.assert_allclose(solution.pursuer_velocity_m_s, u_star, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(
            solution.evader_velocity_m_s, (*v_star, 0.0), rtol=1e-6, atol=1e-6
        )
    else:
        assert solution.value == pytest.approx(
            math.hypot(*P) - delta * math.hypot(*E), rel=1e-9, abs=1e-9
        )
        np.testing.assert_array_equal(solution.meeting_point_m, T)
        assert solution.meeting_time_s == pytest.approx(math.hypot(*E) / v)
        np.testing.assert_allclose(
            solution.pursuer_velocity_m_s, -delta * v * P / math.hypot(*P), atol=1e-9
        )
        if math.hypot(*E) > 1e-9:
            np.testing.assert_allclose(
                solution.evader_velocity_m_s, -v * E / math.hypot(*E), atol=1e-9
            )


@patient
@given(P=places, z=heights, E=places, turn=st.floats(0.0, 6.28), delta=st.floats(1.05, 5.0))
def test_every_point_of_the_circle_is_delta_times_as_far_from_the_pursuer(P, z, E, turn, delta):
    P = np.array([*P, z])
    E = np.array([*E, 0.0])
    circle = apollonius_circle(P, E, delta)
    sphere = apollonius_sphere(P, E, delta)
    for (centre, radius), up in ((circle, 0.0), (sphere, 0.7)):
        outward = np.array(
            [math.cos(turn) * math.cos(up), math.sin(turn) * math.cos(up), math.sin(up)]
        )
        X = centre + radius * outward
        assert math.dist(X, P) == pytest.approx(delta * math.dist(X, E), rel=1e-9, abs=1e-9)
    assert circle.centre_m[2] == 0.0
    section = math.sqrt(max(sphere.radius_m**2 - sphere.centre_m[2] ** 2, 0.0))
    assert circle.radius_m == pytest.approx(section, rel=1e-6, abs=1e-6)


def test_the_circle_lies_in_its_evaders_plane_at_whatever_height_that_is():
    up = np.array([0.0, 0.0, 3.0])
    circle = apollonius_circle(P_PE, E_PE, 2.0)
    raised = apollonius_circle(P_PE + up, E_PE + up, 2.0)
    np.testing.assert_array_equal(raised.centre_m, circle.centre_m + up)
    assert raised.radius_m == pytest.approx(circle.radius_m, rel=1e-15)


def test_a_barrier_of_one_square_metre_is_like_any_other():
    P = np.array([1.0, 1.0, 1.0])
    E = np.array([1.0, 0.0, 0.0])
    T = np.zeros(3)
    assert barrier(P, E, T, 2.0) == 1.0
    circle = apollonius_circle(P, E, 2.0)
    solution = solve(Game(Ball(2.0), 1.0), P, E, T)
    assert solution.value == pytest.approx(
        math.hypot(*circle.centre_m) - circle.radius_m, rel=1e-14
    )
    assert solution.margin_s == pytest.approx(1.0 - math.sqrt(3.0) / 2.0, rel=1e-14)


def test_circles_of_a_batch_may_have_ratios_of_their_own():
    P = np.stack([P_PE, P_TAD])
    E = np.stack([E_PE, E_TAD])
    ratio = np.array([2.0, 3.0])
    for shape in (apollonius_circle, apollonius_sphere):
        both = shape(P, E, ratio)
        for index in range(2):
            single = shape(P[index], E[index], float(ratio[index]))
            np.testing.assert_allclose(both.centre_m[index], single.centre_m)
            assert both.radius_m[index] == pytest.approx(single.radius_m)


@patient
@given(P=places, z=st.floats(-20.0, 50.0), E=places, R=st.floats(0.0, 5.0), h=st.floats(0.0, 10.0))
def test_the_stand_off_game_is_the_papers_with_d_less_r_and_z_less_h(P, z, E, R, h):
    P = np.array([*P, z])
    E = np.array([*E, 0.0])
    d = math.dist(P[:2], E[:2])
    if d <= R:
        return
    nearer = E.copy()
    nearer[:2] = P[:2] + (E - P)[:2] * (d - R) / d
    plain = solve(PAPER, np.array([*P[:2], abs(z - h)]), nearer)
    assert solve(Game(Ball(DELTA), 1.0, standoff=StandOff(R, h)), P, E).value == pytest.approx(
        plain.value, abs=1e-9
    )


@patient
@given(P=places, z=heights, E=places, length=st.floats(0.0, 5.0), delta=st.floats(1.05, 4.0))
def test_a_capture_radius_has_its_closed_form(P, z, E, length, delta):
    d = math.dist(P, E)
    v = 1.5
    D2 = d**2 + z**2
    if length**2 >= D2:
        return
    lead = d - delta * length
    expected = (lead + math.sqrt(lead**2 + (delta**2 - 1) * (D2 - length**2))) / (
        v * (delta**2 - 1)
    )
    game = Game(Ball(delta * v), v, capture_radius_m=length)
    assert solve(game, np.array([*P, z]), np.array([*E, 0.0])).value == pytest.approx(
        expected, rel=1e-7, abs=1e-7
    )


@patient
@given(d=st.floats(0.1, 50.0), length=st.floats(0.0, 5.0))
def test_in_the_plane_capture_takes_the_gap_over_the_speed_in_hand(d, length):
    game = Game(Ball(3.0), 1.0, capture_radius_m=length)
    expected = max(d - length, 0.0) / (3.0 - 1.0)
    assert solve(game, np.zeros(3), np.array([d, 0.0, 0.0])).value == pytest.approx(
        expected, abs=1e-12
    )


@patient
@given(P=places, z=st.floats(-30.0, 30.0), E=places, R=st.floats(0.0, 5.0), h=st.floats(0.0, 10.0))
def test_a_cylinder_takes_the_longer_of_its_two_parts(P, z, E, R, h):
    a = 12.0
    up = 3.0
    down = 1.5
    v = 4.0
    d = math.dist(P, E)
    game = Game(Cylinder(a, up, down), v, standoff=StandOff(R, h))
    expected = max((d - R) / (a - v), (z - h) / down, (h - z) / up, 0.0)
    solution = solve(game, np.array([*P, z]), np.array([*E, 0.0]))
    assert solution.value == pytest.approx(expected, abs=1e-12)
    vertical = 0.0 if abs(z - h) <= 1e-9 else (-down if z > h else up)
    assert solution.pursuer_velocity_m_s[2] == vertical
    horizontal = (np.array(E) - P) * a / d if d - R > 1e-9 else np.zeros(2)
    np.testing.assert_allclose(solution.pursuer_velocity_m_s[:2], horizontal, atol=1e-9)


@patient
@given(P=places, z=heights, E=places)
def test_a_cylinders_tad_is_the_nearer_of_planar_disc_and_falling_disc(P, z, E):
    a = 3.0
    b = 0.8
    v = 1.0
    P = np.array([*P, z])
    E = np.array([*E, 0.0])
    T = np.zeros(3)
    delta = a / v
    centre, radius = apollonius_circle(np.array([*P[:2], 0.0]), E, delta)
    planar = math.hypot(*centre) - radius
    falling = math.hypot(*E) - v * z / b
    solution = solve(Game(Cylinder(a, 5.0, b), v), P, E, T)
    if min(abs(planar), abs(falling)) < 1e-6:
        return
    assert solution.winner == (1 if min(planar, falling) > 0 else -1)
    if solution.winner > 0:
        assert solution.value == pytest.approx(min(planar, falling), rel=1e-9, abs=1e-9)
        g = centre - radius * centre / math.hypot(*centre)
        way = (g - P)[:2]
        if math.hypot(*way) > 1e-6:
            np.testing.assert_allclose(
                solution.pursuer_velocity_m_s[:2], a * way / math.hypot(*way), atol=1e-6
            )


def test_a_second_of_age_delays_the_papers_capture_to_11_24_s():
    d = math.dist(P_PE[:2], E_PE[:2])
    z = P_PE[2]
    l_eff = -2.0
    lead = d - DELTA * l_eff
    expected = (lead + math.sqrt(lead**2 + 3 * (d**2 + z**2 - l_eff**2))) / 3 - 1.0
    value = solve(Game(Ball(2.0), 1.0, information_age_s=1.0), P_PE, E_PE).value
    assert value == pytest.approx(expected, rel=1e-12)
    assert round(float(value), 2) == 11.24


@pytest.mark.parametrize(("wind", "published"), [(0.5, 7.62), (-0.5, 18.76)])
def test_wind_along_the_line_of_flight_only_changes_the_pursuers_start(wind, published):
    """Wind carries P: the capture is as in still air from the point to which P would have drifted."""
    time = solve(Game(Ball(2.0), 1.0, wind_m_s=(0.0, wind)), P_PE, E_PE)
    drifted = P_PE + np.array([0.0, wind * float(time.value), 0.0])
    assert solve(PAPER, drifted, E_PE).value == pytest.approx(time.value, rel=1e-12)
    through_air = time.pursuer_velocity_m_s - [0.0, wind, 0.0]
    np.testing.assert_allclose(
        through_air, solve(PAPER, drifted, E_PE).pursuer_velocity_m_s, atol=1e-12
    )
    assert round(float(time.value), 2) == published


@settings(max_examples=drawn(30), deadline=None)
@given(
    P=places, z=heights, E=places, zE=st.floats(-20.0, 20.0), T=places, zT=st.floats(-20.0, 20.0)
)
def test_an_evader_in_space_plays_on_the_sphere(P, z, E, zE, T, zT):
    P = np.array([*P, z])
    E = np.array([*E, zE])
    T = np.array([*T, zT])
    game = Game(Ball(2.0), 1.0, evader_space="space")
    chase = solve(game, P, E)
    race = solve(game, P, E, T)
    assert chase.value == pytest.approx(math.dist(P, E) / (2.0 - 1.0), rel=1e-9)
    if math.dist(P, E) > 1e-3:
        np.testing.assert_allclose(chase.evader_velocity_m_s, (E - P) / math.dist(P, E), atol=1e-7)
        np.testing.assert_allclose(
            chase.pursuer_velocity_m_s, 2.0 * (E - P) / math.dist(P, E), atol=1e-7
        )
    centre, radius = apollonius_sphere(P, E, 2.0)
    left = math.dist(centre, T) - radius
    if abs(left) < 1e-6 or math.dist(P, E) < 1e-3:
        return
    assert race.winner == math.copysign(1, left)
    if left > 0:
        g = centre - radius * (centre - T) / math.dist(centre, T)
        assert race.value == pytest.approx(left, rel=1e-7, abs=1e-7)
        np.testing.assert_allclose(race.meeting_point_m, g, atol=1e-5)
        np.testing.assert_allclose(
            race.pursuer_velocity_m_s, 2.0 * (g - P) / math.dist(g, P), atol=1e-4
        )
    else:
        np.testing.assert_allclose(race.meeting_point_m, T, atol=1e-9)
        assert race.value == pytest.approx(math.dist(P, T) - 2.0 * math.dist(E, T), abs=1e-9)


@pytest.mark.parametrize("radius", [0.2, 0.6, 2.0])
def test_a_ball_spends_its_whole_speed_on_the_way_to_a_disc_of_any_size(radius):
    """At distances below a metre, where a constant of one metre in the code would be wrong."""
    game = Game(Ball(2.0), 1.0, standoff=StandOff(radius, 0.0))
    for beyond in (0.1, 0.3, 5.0):
        velocity = solve(
            game, np.array([radius + beyond, 0.0, 0.2]), np.zeros(3)
        ).pursuer_velocity_m_s
        assert np.linalg.norm(velocity) == pytest.approx(2.0, rel=1e-12)


@pytest.mark.parametrize("strength", [0.5, 1.0, 1.5])
def test_along_the_line_of_flight_the_wind_adds_to_the_closing_speed(strength):
    for sign in (1.0, -1.0):
        game = Game(Ball(3.0), 1.0, wind_m_s=(sign * strength, 0.0))
        solution = solve(game, np.array([-10.0, 0.0, 0.0]), np.zeros(3))
        assert float(solution.value) == pytest.approx(
            10.0 / (3.0 + sign * strength - 1.0), rel=1e-14
        )
