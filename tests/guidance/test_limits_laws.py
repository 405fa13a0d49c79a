"""Limits, each law against its closed form, and the names under which each one reports."""

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.errors import ConfigError
from guidance.limits import (
    AltitudeHold,
    Envelope,
    Limiter,
    Memory,
    Polygon,
    Situation,
    StandOff,
    hold_altitude,
    limit,
    start,
)
from guidance.limits.shaping import next_yaw
from guidance.limits.stopping import approach_speed
from guidance.telemetry import Setpoint

DT_S = 0.02
OPEN = Envelope(
    floor_m=-1000.0,
    ceiling_m=1000.0,
    speed_m_s=10.0,
    climb_m_s=4.0,
    descent_m_s=2.0,
    acceleration_m_s2=5.0,
    vertical_acceleration_m_s2=3.0,
    jerk_m_s3=1e6,
    yaw_rate_rad_s=0.5,
    braking_m_s2=2.0,
    vertical_braking_m_s2=1.0,
    reaction_s=0.5,
)
HOVER = Situation((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def settled(velocity, situation=HOVER, envelope=OPEN, **command):
    """Limit a command that has been flown all along, so that acceleration does not act."""
    return limit(Setpoint(velocity, **command), situation, envelope, Memory(velocity), DT_S)


def asked_ground(distance_m, speed, envelope=OPEN):
    """The closing speed that the law allows: c · (reaction + |v|/2a) = distance."""
    return distance_m / (envelope.reaction_s + speed / (2.0 * envelope.braking_m_s2))


@settings(deadline=None)
@given(st.floats(0.0, 1e4), st.floats(0.1, 100.0), st.floats(0.0, 3.0))
def test_the_approach_speed_uses_up_the_distance_exactly(distance, deceleration, lag):
    speed = approach_speed(distance, deceleration, lag)
    assert speed * lag + speed**2 / (2.0 * deceleration) == pytest.approx(distance, rel=1e-6, abs=1e-6)


def test_a_command_within_the_envelope_passes_untouched():
    limited = settled((3.0, -4.0, 1.0), acceleration_ned_m_s2=None, yaw_rad=None)
    assert limited.setpoint == Setpoint((3.0, -4.0, 1.0))
    assert limited.acted == ()


def test_a_ground_velocity_is_scaled_and_keeps_its_direction():
    limited = limit(Setpoint((300.0, -400.0, 1.0)), HOVER, OPEN, Memory((6.0, -8.0, 1.0)), DT_S)
    assert limited.setpoint.velocity_ned_m_s == pytest.approx((6.0, -8.0, 1.0))
    assert limited.acted == (Limiter.SPEED,)


@pytest.mark.parametrize(("down", "allowed"), [(50.0, 2.0), (-50.0, -4.0)])
def test_climb_and_descent_have_their_own_limits_and_cost_no_ground_speed(down, allowed):
    limited = limit(Setpoint((6.0, 8.0, down)), HOVER, OPEN, Memory((6.0, 8.0, allowed)), DT_S)
    assert limited.setpoint.velocity_ned_m_s == pytest.approx((6.0, 8.0, allowed))
    assert limited.acted == (Limiter.VERTICAL_SPEED,)


def test_acceleration_is_limited_on_the_ground_as_a_vector_and_vertically_on_its_own():
    limited = limit(Setpoint((3.0, 4.0, -2.0)), HOVER, OPEN, Memory((0.0, 0.0, 0.0)), DT_S)
    assert limited.setpoint.velocity_ned_m_s == pytest.approx((3.0 * DT_S, 4.0 * DT_S, -3.0 * DT_S))
    assert limited.memory.acceleration_ned_m_s2 == pytest.approx((3.0, 4.0, -3.0))
    assert limited.acted == (Limiter.ACCELERATION, Limiter.VERTICAL_ACCELERATION)


def test_jerk_limits_the_rise_of_acceleration():
    soft = replace(OPEN, jerk_m_s3=10.0)
    memory, accelerations = Memory((0.0, 0.0, 0.0)), []
    for _ in range(5):
        memory = limit(Setpoint((8.0, 0.0, 0.0)), HOVER, soft, memory, DT_S).memory
        accelerations.append(memory.acceleration_ned_m_s2[0])
    assert accelerations == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])


@settings(max_examples=30, deadline=None)
@given(st.floats(-10, 10), st.floats(-10, 10), st.floats(1.0, 50.0), st.sampled_from([0, 1]))
def test_velocity_arrives_without_overshoot_along_a_line(before, wanted, jerk, axis):
    def along(speed):
        return (0.0, speed, 0.0) if axis else (speed, 0.0, 0.0)

    soft, memory = replace(OPEN, jerk_m_s3=jerk), Memory(along(before))
    low, high = min(before, wanted) - 1e-9, max(before, wanted) + 1e-9
    for _ in range(500):
        memory = limit(Setpoint(along(wanted)), HOVER, soft, memory, DT_S).memory
        assert low <= memory.velocity_ned_m_s[axis] <= high
    for _ in range(1500):
        memory = limit(Setpoint(along(wanted)), HOVER, soft, memory, DT_S).memory
    assert memory.velocity_ned_m_s == pytest.approx(along(wanted), abs=1e-6)
    assert memory.acceleration_ned_m_s2[axis] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(
    ("limits", "velocity", "distance_m", "axis", "limiter"),
    [
        ({"fence_radius_m": 6.0}, (8.0, 0.0, 0.0), 6.0, 0, Limiter.FENCE_RADIUS),
        ({"fence_radius_m": 7.0, "fence_margin_m": 1.0}, (0.0, 8.0, 0.0), 6.0, 1, Limiter.FENCE_RADIUS),
        ({"fence_radius_m": 106.0, "home_ned_m": (-100.0, 0.0, 0.0)}, (8.0, 0.0, 0.0), 6.0, 0, Limiter.FENCE_RADIUS),
        (
            {"fence_polygon": Polygon(((-9.0, -90.0), (-9.0, 90.0), (5.0, 90.0), (5.0, -90.0)))},
            (8.0, 0.0, 0.0),
            5.0,
            0,
            Limiter.FENCE_POLYGON,
        ),
        (
            {
                "fence_polygon": Polygon(((-9.0, -90.0), (-9.0, 90.0), (15.0, 90.0), (15.0, -90.0))),
                "fence_margin_m": 2.0,
                "home_ned_m": (-8.0, 3.0, 0.0),
            },
            (8.0, 0.0, 0.0),
            5.0,
            0,
            Limiter.FENCE_POLYGON,
        ),
    ],
)
def test_a_fence_allows_the_speed_that_still_stops(limits, velocity, distance_m, axis, limiter):
    limited = settled(velocity, envelope=replace(OPEN, **limits))
    assert limited.setpoint.velocity_ned_m_s[axis] == pytest.approx(asked_ground(distance_m, 8.0))
    assert limited.setpoint.velocity_ned_m_s[1 - axis] == pytest.approx(0.0)
    assert limited.acted == (limiter,)


def test_the_vehicle_s_own_drift_is_taken_from_the_distance():
    moving = Situation((0.0, 0.0, 0.0), (4.0, 0.0, 1.0))
    fenced = replace(OPEN, fence_radius_m=6.0)
    assert settled((8.0, 0.0, 0.0), moving, fenced).setpoint.velocity_ned_m_s[0] == pytest.approx(
        asked_ground(4.0, 8.0)
    )
    away = Situation((0.0, 0.0, 0.0), (0.0, 0.0, -4.0))
    floored = replace(OPEN, floor_m=-1.5)
    assert settled((0.0, 0.0, 2.0), away, floored).setpoint.velocity_ned_m_s[2] == pytest.approx(1.0)
    assert settled((0.0, 0.0, 2.0), moving, floored).setpoint.velocity_ned_m_s[2] == pytest.approx(1.0 / 1.5)


@pytest.mark.parametrize(
    ("velocity", "drift_m"),
    [
        ((4.0, 0.0), 2.0),
        ((-4.0, 0.0), 0.0),
        ((0.0, 4.0), math.hypot(20.0, 2.0) - 20.0),
        ((0.0, -4.0), math.hypot(20.0, 2.0) - 20.0),
    ],
)
@pytest.mark.parametrize("axis", [0, 1])
def test_the_circle_counts_a_drift_by_how_much_further_out_it_leads(velocity, drift_m, axis):
    fenced = replace(OPEN, fence_radius_m=30.0, home_ned_m=(7.0, -9.0, 0.0))
    turn = slice(None, None, 1 - 2 * axis)
    north, east = (20.0, 0.0)[turn]
    moving = Situation((7.0 + north, -9.0 + east, 0.0), (*velocity[turn], 0.0))
    allowed = settled((*(8.0, 0.0)[turn], 0.0), moving, fenced).setpoint.velocity_ned_m_s
    assert allowed[axis] == pytest.approx(asked_ground(10.0 - drift_m, 8.0))


def test_what_goes_along_a_polygon_s_edge_is_kept():
    edge = replace(OPEN, fence_polygon=Polygon(((-90.0, -90.0), (3.0, -90.0), (3.0, 90.0), (-90.0, 90.0))))
    limited = settled((3.0, 4.0, 1.0), envelope=edge)
    assert limited.setpoint.velocity_ned_m_s == pytest.approx((asked_ground(3.0, 5.0), 4.0, 1.0))


SQUARE = replace(OPEN, fence_polygon=Polygon(((-20.0, -20.0), (-20.0, 20.0), (20.0, 20.0), (20.0, -20.0))))


@pytest.mark.parametrize(
    ("position", "velocity", "allowed"),
    [
        ((25.0, 0.0), (5.0, 4.0), (0.0, 4.0)),  # beyond the north edge: no further, along it freely
        ((25.0, 0.0), (-5.0, 4.0), (-5.0, 4.0)),  # the way in is free
        ((25.0, 19.0), (-1.0, 6.0), (-1.0, 6.0)),  # the other edges hold nothing out there
        ((23.0, 24.0), (3.0, 4.0), (0.0, 0.0)),  # beyond a corner: away from it is further out
        ((23.0, 24.0), (4.0, -3.0), (4.0, -3.0)),  # across that is not
        ((20.0, 0.0), (5.0, 4.0), (0.0, 4.0)),  # on the line
        ((20.0, 20.0), (5.0, 4.0), (0.0, 0.0)),  # in the corner
        ((20.0, 20.0), (-5.0, -4.0), (-5.0, -4.0)),
        ((19.995, 0.0), (5.0, 4.0), (0.005 / (0.5 + math.hypot(5.0, 4.0) / 4.0), 4.0)),  # a hair inside
        ((20.005, 19.995), (0.0, 8.0), (0.0, 0.005 / 2.5)),  # a hair outside one edge, the other one still holds
        ((20.005, 0.0), (5.0, 4.0), (0.0, 4.0)),
        ((20.0, 21.0), (0.0, 8.0), (0.0, 0.0)),
    ],
)
def test_a_polygon_holds_on_its_line_in_its_corners_and_outside(position, velocity, allowed):
    at = Situation((*position, 0.0), (0.0, 0.0, 0.0))
    limited = settled((*velocity, 0.0), at, SQUARE)
    assert limited.setpoint.velocity_ned_m_s == pytest.approx((*allowed, 0.0), abs=1e-9)


def test_past_an_inward_corner_the_way_is_free():
    notched = Polygon(((-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (0.0, 0.0), (-50.0, 50.0)))
    at = Situation((0.0, -0.5, 0.0), (0.0, 0.0, 0.0))
    free, closing = (5.0, 0.0, 0.0), (0.0, 5.0, 0.0)
    assert settled(free, at, replace(OPEN, fence_polygon=notched)).setpoint.velocity_ned_m_s == free
    allowed = settled(closing, at, replace(OPEN, fence_polygon=notched)).setpoint.velocity_ned_m_s
    assert allowed == pytest.approx((0.0, asked_ground(0.5, 5.0), 0.0))


def test_a_polygon_keeps_its_margin_from_inside_and_outside():
    with_margin = replace(SQUARE, fence_margin_m=2.0)
    for north in (18.0, 19.0, 20.0, 21.0):
        at = Situation((north, 0.0, 0.0), (0.0, 0.0, 0.0))
        assert settled((5.0, 4.0, 0.0), at, with_margin).setpoint.velocity_ned_m_s == pytest.approx((0.0, 4.0, 0.0))
        assert settled((-5.0, 4.0, 0.0), at, with_margin).setpoint.velocity_ned_m_s == (-5.0, 4.0, 0.0)


def test_an_acceleration_does_not_lean_on_the_circle_and_may_point_inwards():
    fenced = replace(OPEN, fence_radius_m=6.0, home_ned_m=(0.0, -2.0, 0.0))
    at_fence = Situation((0.0, 4.0, 0.0), (0.0, 0.0, 0.0))
    out = settled((0.0, 8.0, 0.0), at_fence, fenced, acceleration_ned_m_s2=(2.0, 3.0, 1.0))
    assert out.setpoint.acceleration_ned_m_s2 == pytest.approx((2.0, 0.0, 1.0), abs=1e-9)
    inwards = settled((0.0, 8.0, 0.0), at_fence, fenced, acceleration_ned_m_s2=(2.0, -3.0, 1.0))
    assert inwards.setpoint.acceleration_ned_m_s2 == pytest.approx((2.0, -3.0, 1.0), abs=1e-9)


def test_at_home_itself_the_circle_has_no_direction_and_still_its_law():
    fenced = replace(OPEN, fence_radius_m=1.0)
    limited = settled((8.0, 0.0, 0.0), HOVER, fenced, acceleration_ned_m_s2=(3.0, 0.0, 0.0))
    assert limited.setpoint.velocity_ned_m_s[0] == pytest.approx(asked_ground(1.0, 8.0))


def test_the_circle_bends_a_velocity_inwards_so_that_it_stops_on_the_circle():
    fenced = replace(OPEN, fence_radius_m=30.0)
    at_rim = Situation((30.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    north, east, _ = settled((0.0, 8.0, 0.0), at_rim, fenced).setpoint.velocity_ned_m_s
    seconds = OPEN.reaction_s + 8.0 / (2.0 * OPEN.braking_m_s2)
    assert math.hypot(30.0 + north * seconds, east * seconds) == pytest.approx(30.0)
    assert math.atan2(east * seconds, 30.0 + north * seconds) == pytest.approx(math.atan2(8.0 * seconds, 30.0))


@pytest.mark.parametrize(
    ("limits", "velocity", "allowed", "limiter"),
    [
        ({"floor_m": 3.0}, 2.0, 1.0 / 1.5, Limiter.FLOOR),
        ({"ceiling_m": 5.0}, -4.0, -1.0 / 2.5, Limiter.CEILING),
        ({"floor_m": 8.0, "home_ned_m": (0.0, 0.0, 5.0)}, 2.0, 1.0 / 1.5, Limiter.FLOOR),
    ],
)
def test_floor_and_ceiling_allow_the_vertical_speed_that_still_stops(limits, velocity, allowed, limiter):
    limited = settled((7.0, 0.0, velocity), Situation((0.0, 0.0, -4.0), (0.0, 0.0, 0.0)), replace(OPEN, **limits))
    assert limited.setpoint.velocity_ned_m_s == pytest.approx((7.0, 0.0, allowed))
    assert limited.acted == (limiter,)


ZONE = replace(OPEN, stand_off=StandOff(radius_m=3.0, height_m=5.0))


@pytest.mark.parametrize(
    ("position", "velocity", "allowed"),
    [
        ((-10.0, 0.0, -2.0), (8.0, 1.0, 1.0), (asked_ground(7.0, math.hypot(8.0, 1.0)), 1.0, 1.0)),  # beside
        ((-1.0, 0.0, -6.0), (8.0, 0.0, 2.0), (8.0, 0.0, 1.0 / 1.5)),  # above
        ((-1.0, 0.0, -2.0), (8.0, 3.0, 2.0), (0.0, 3.0, 0.0)),  # inside: no deeper
        ((-1.0, 0.0, -2.0), (-8.0, 0.0, -2.0), (-8.0, 0.0, -2.0)),  # inside: the way out is free
        ((-2.0, 0.0, -50.0), (8.0, 0.0, 2.0), (8.0, 0.0, 2.0)),  # far above
        ((0.0, 0.0, -2.0), (8.0, 3.0, 2.0), (8.0, 3.0, 0.0)),  # right over it and too low: every way out is free
        ((0.0, 0.0, 1.0), (-3.0, 8.0, -4.0), (-3.0, 8.0, -4.0)),
    ],
)
def test_the_stand_off_is_a_wall_beside_and_a_lid_above(position, velocity, allowed):
    limited = settled(velocity, Situation(position, (0.0, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0)), ZONE)
    assert limited.setpoint.velocity_ned_m_s == pytest.approx(allowed, abs=1e-12)
    assert limited.acted == ((Limiter.STAND_OFF,) if allowed != velocity else ())


def test_across_the_rim_both_closing_parts_share_the_gap():
    position = (-6.0, 0.0, -9.0)  # 3 m beside and 4 m above: a gap of 5 m
    north, _, down = settled((8.0, 0.0, 2.0), Situation(position, (0.0, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0)), ZONE)[
        0
    ].velocity_ned_m_s
    ground_s, vertical_s = 0.5 + 8.0 / 4.0, 0.5 + 2.0 / 2.0
    assert 0.6 * north * ground_s + 0.8 * down * vertical_s == pytest.approx(5.0)
    assert north / down == pytest.approx(8.0 / 2.0)


@pytest.mark.parametrize("bearing_deg", [0.0, 90.0, 217.0])
def test_a_target_that_flees_takes_its_wall_along(bearing_deg):
    cosine, sine = math.cos(math.radians(bearing_deg)), math.sin(math.radians(bearing_deg))

    def turned(along, across=0.0, down=0.0):
        return (cosine * along - sine * across, sine * along + cosine * across, down)

    fleeing = Situation(turned(-10.0, down=-2.0), turned(3.0), 0.0, (0.0, 0.0, 0.0), turned(3.0))
    assert settled(turned(8.0), fleeing, ZONE)[0].velocity_ned_m_s == pytest.approx(
        turned(3.0 + asked_ground(7.0, 5.0))
    )
    faster = fleeing._replace(velocity_ned_m_s=turned(5.0))  # only what it is faster by is drift
    assert settled(turned(8.0), faster, ZONE)[0].velocity_ned_m_s == pytest.approx(turned(3.0 + asked_ground(6.0, 5.0)))
    across = settled(turned(8.0, 5.0), fleeing, ZONE)[0].velocity_ned_m_s
    assert across == pytest.approx(turned(3.0 + asked_ground(7.0, math.hypot(5.0, 5.0)), 5.0))
    for velocity in (
        None,
        (math.nan, 0.0, 0.0),
        turned(math.inf),
        turned(1e9),
        turned(-3.0),
        turned(0.0, 3.0),
        (0.0, 0.0, 9.0),
    ):
        other = fleeing._replace(target_velocity_ned_m_s=velocity, velocity_ned_m_s=(0.0, 0.0, 0.0))
        assert settled(turned(8.0), other, ZONE)[0].velocity_ned_m_s == pytest.approx(turned(asked_ground(7.0, 8.0)))


def test_across_the_rim_a_target_that_flees_moves_the_level_part_of_the_wall():
    position = (-6.0, 0.0, -9.0)  # 3 m beside and 4 m above: a gap of 5 m
    fleeing = Situation(position, (0.0, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0), (2.0, 0.0, 0.0))
    north, _, down = settled((8.0, 0.0, 2.0), fleeing, ZONE).setpoint.velocity_ned_m_s
    ground_s, vertical_s = 0.5 + 6.0 / 4.0, 0.5 + 2.0 / 2.0
    assert 0.6 * (north - 2.0) * ground_s + 0.8 * down * vertical_s == pytest.approx(5.0)


def test_inside_the_stand_off_a_target_that_flees_may_be_followed():
    inside = Situation((-1.0, 0.0, -2.0), (0.0, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0), (3.0, 0.0, 0.0))
    assert settled((8.0, 1.0, 1.0), inside, ZONE)[0].velocity_ned_m_s == pytest.approx((3.0, 1.0, 0.0))


@pytest.mark.parametrize("braking", [0.5, 1.0, 3.0])
def test_each_axis_has_its_own_braking(braking):
    low = Situation((0.0, 0.0, -4.0), (0.0, 0.0, 0.0))
    floored = replace(OPEN, floor_m=3.0, vertical_braking_m_s2=braking)
    assert settled((0.0, 0.0, 2.0), low, floored)[0].velocity_ned_m_s[2] == pytest.approx(1.0 / (0.5 + 1.0 / braking))
    fenced = replace(OPEN, fence_radius_m=3.0, braking_m_s2=braking)
    assert settled((8.0, 0.0, 2.0), HOVER, fenced)[0].velocity_ned_m_s[0] == pytest.approx(3.0 / (0.5 + 4.0 / braking))


def test_no_target_no_stand_off():
    assert settled((8.0, 0.0, 0.0), Situation((-4.0, 0.0, -2.0), (0.0, 0.0, 0.0)), ZONE).acted == ()


NAN = math.nan


@pytest.mark.parametrize(
    "command",
    [
        Setpoint((NAN, 0.0, 0.0)),
        Setpoint((0.0, math.inf, 0.0)),
        Setpoint((0.0, 0.0, -1e9)),
        Setpoint((1.0, 0.0, 0.0), (NAN, 0.0, 0.0)),
        Setpoint((1.0, 0.0, 0.0), down_m=math.inf),
        Setpoint((1.0, 0.0, 0.0), yaw_rad=NAN),
    ],
)
def test_a_command_that_is_no_number_becomes_a_smooth_stop(command):
    limited = limit(command, HOVER, OPEN, Memory((4.0, 0.0, 0.0), yaw_rad=0.3), DT_S)
    assert limited.acted == (Limiter.COMMAND, Limiter.ACCELERATION)
    assert limited.setpoint == Setpoint((pytest.approx(4.0 - 5.0 * DT_S), 0.0, 0.0), yaw_rad=pytest.approx(0.3))


@pytest.mark.parametrize(
    "situation",
    [
        HOVER._replace(position_ned_m=(0.0, NAN, 0.0)),
        HOVER._replace(velocity_ned_m_s=(0.0, 0.0, math.inf)),
        HOVER._replace(yaw_rad=NAN),
        HOVER._replace(target_position_ned_m=(NAN, 0.0, 0.0)),
    ],
)
def test_a_place_that_is_not_known_stops_the_vehicle_at_once(situation):
    limited = limit(Setpoint((4.0, 0.0, 0.0), yaw_rad=1.0), situation, OPEN, Memory((4.0, 0.0, 0.0), yaw_rad=0.2), DT_S)
    assert limited == (Setpoint((0.0, 0.0, 0.0)), (Limiter.SITUATION,), Memory((0.0, 0.0, 0.0), yaw_rad=0.2))


@pytest.mark.parametrize(("dt_s", "counted"), [(5.0, 0.1), (math.inf, 0.1), (-1.0, 0.0), (NAN, 0.0)])
def test_a_late_or_impossible_step_is_not_made_up_for(dt_s, counted):
    limited = limit(Setpoint((8.0, 0.0, 0.0)), HOVER, OPEN, Memory((0.0, 0.0, 0.0)), dt_s)
    assert limited.setpoint.velocity_ned_m_s[0] == pytest.approx(5.0 * counted)
    assert limited.acted == (Limiter.CLOCK, Limiter.ACCELERATION)


@pytest.mark.parametrize(
    "memory", [None, Memory((NAN, 0.0, 0.0)), Memory((1.0, 0.0, 0.0), yaw_rad=math.inf), Memory((0.0, 0.0, 1e9))]
)
def test_without_a_usable_memory_the_vehicle_s_own_motion_is_the_start(memory):
    moving = Situation((0.0, 0.0, 0.0), (3.0, 4.0, -1.0), 0.7)
    limited = limit(Setpoint((3.0, 4.0, -1.0), yaw_rad=0.7), moving, OPEN, memory, DT_S)
    assert limited.setpoint == Setpoint((3.0, 4.0, -1.0), yaw_rad=pytest.approx(0.7))
    assert limited.acted == ()


def test_a_start_in_a_gale_is_within_the_envelope():
    assert start(Situation((0.0, 0.0, 0.0), (30.0, 40.0, 9.0), 0.7), OPEN) == Memory((6.0, 8.0, 2.0), yaw_rad=0.7)
    assert start(Situation((0.0, 0.0, 0.0), (NAN, 0.0, 0.0), 0.7), OPEN) == Memory((0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("before", "wanted", "after"),
    [
        (0.0, 2.0, 0.01),
        (0.0, -2.0, -0.01),
        (3.1, -3.1, 3.11),
        (-3.1, 3.1, -3.11),
        (0.0, 0.004, 0.004),
        (0.2, 0.2 + math.tau, 0.2),
    ],
)
def test_yaw_turns_the_short_way_at_the_turn_rate(before, wanted, after):
    assert next_yaw(wanted, before, OPEN, DT_S) == pytest.approx(after)
    limited = limit(Setpoint((0.0, 0.0, 0.0), yaw_rad=wanted), HOVER, OPEN, Memory((0.0,) * 3, yaw_rad=before), DT_S)
    assert limited.setpoint.yaw_rad == limited.memory.yaw_rad == pytest.approx(after)
    assert (Limiter.YAW in limited.acted) == (abs(math.remainder(after - wanted, math.tau)) > 1e-6)


def test_while_no_yaw_is_asked_for_the_memory_follows_the_nose():
    limited = settled((1.0, 0.0, 0.0), HOVER._replace(yaw_rad=2.0))
    assert limited.setpoint.yaw_rad is None
    assert limited.memory.yaw_rad == 2.0


def test_a_feed_forward_within_the_limits_passes_and_a_large_one_is_scaled():
    limited = settled((1.0, 0.0, 0.0), acceleration_ned_m_s2=(3.0, 0.0, -1.0))
    assert limited.setpoint.acceleration_ned_m_s2 == pytest.approx((3.0, 0.0, -1.0))
    assert limited.acted == ()
    limited = settled((1.0, 0.0, 0.0), acceleration_ned_m_s2=(30.0, 40.0, -9.0))
    assert limited.setpoint.acceleration_ned_m_s2 == pytest.approx((3.0, 4.0, -3.0))
    assert limited.acted == (Limiter.FEED_FORWARD,)


def test_a_feed_forward_rises_at_the_jerk_limit_from_the_last_one_sent():
    soft = replace(OPEN, jerk_m_s3=10.0)
    memory = Memory((1.0, 0.0, 0.0), feed_forward_ned_m_s2=(0.5, 0.0, 0.0))
    limited = limit(Setpoint((1.0, 0.0, 0.0), (3.0, 0.0, 2.0)), HOVER, soft, memory, DT_S)
    assert limited.setpoint.acceleration_ned_m_s2 == pytest.approx((0.7, 0.0, 0.2))
    assert limited.memory.feed_forward_ned_m_s2 == limited.setpoint.acceleration_ned_m_s2
    assert settled((1.0, 0.0, 0.0)).memory.feed_forward_ned_m_s2 == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("velocity", "limits", "wanted", "allowed"),
    [
        ((8.0, 0.0, 0.0), {"fence_radius_m": 6.0}, (3.0, 2.0, 1.0), (0.0, 2.0, 1.0)),
        ((8.0, 0.0, 0.0), {"fence_radius_m": 6.0}, (-3.0, 2.0, 1.0), (-3.0, 2.0, 1.0)),
        ((0.0, 0.0, 2.0), {"floor_m": -1.0}, (3.0, 2.0, 1.0), (3.0, 2.0, 0.0)),
        ((10.0, 0.0, 0.0), {}, (3.0, 2.0, 1.0), (0.0, 2.0, 1.0)),
        ((10.0, 0.0, 0.0), {}, (-3.0, 2.0, 1.0), (-3.0, 2.0, 1.0)),
        ((0.0, 0.0, 2.0), {}, (3.0, 2.0, 1.0), (3.0, 2.0, 0.0)),
        ((0.0, 0.0, -4.0), {}, (3.0, 2.0, -1.0), (3.0, 2.0, 0.0)),
        ((0.0, 0.0, -4.0), {}, (3.0, 2.0, 1.0), (3.0, 2.0, 1.0)),
        ((0.0, 0.0, -3.0), {}, (3.0, 2.0, -1.0), (3.0, 2.0, -1.0)),  # faster than the descent, slower than the climb
        ((6.0, 8.0, 0.0), {}, (3.0, 4.0, 1.0), (0.0, 0.0, 1.0)),
        ((0.0, -10.0, 0.0), {}, (1.0, -3.0, 1.0), (1.0, 0.0, 1.0)),
    ],
)
def test_a_feed_forward_does_not_lean_on_a_limit_that_acts(velocity, limits, wanted, allowed):
    at = HOVER._replace(position_ned_m=(0.001, 0.0, 0.0)) if "fence_radius_m" in limits else HOVER
    limited = settled(velocity, at, replace(OPEN, **limits), acceleration_ned_m_s2=wanted)
    assert limited.setpoint.acceleration_ned_m_s2 == pytest.approx(allowed, abs=1e-9)


def test_nothing_winds_up_behind_a_wall():
    fenced, memory = replace(OPEN, fence_radius_m=6.0, jerk_m_s3=20.0), None
    at_fence = Situation((6.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for _ in range(200):
        memory = limit(Setpoint((8.0, 0.0, 0.0)), at_fence, fenced, memory, DT_S).memory
    assert memory.velocity_ned_m_s == (0.0, 0.0, 0.0)
    assert memory.acceleration_ned_m_s2 == (0.0, 0.0, 0.0)
    released = limit(Setpoint((-8.0, 0.0, 0.0)), at_fence, fenced, memory, DT_S)
    assert released.setpoint.velocity_ned_m_s[0] == pytest.approx(-20.0 * DT_S**2)


@pytest.mark.parametrize(
    ("wanted_m", "vertical", "limits", "sent_m"),
    [
        (-21.0, 0.0, {}, -21.0),
        (-40.0, 0.0, {}, -24.0),  # gain 1: no more than the climb of 4 m/s
        (-40.0, -1.0, {}, -23.0),  # of which one is commanded already
        (0.0, 0.0, {}, -18.0),
        (-18.0, 0.0, {"floor_m": 19.5}, -20.0 + 0.5 / 1.5),  # the braking curve of the floor
        (-15.0, 0.0, {"floor_m": 25.0}, -20.0),  # below the floor: no deeper
        (-22.0, 0.0, {"floor_m": 25.0}, -22.0),  # the way back is free
        (-60.0, 0.0, {"height_gain_per_s": 0.1, "ceiling_m": 30.0}, -30.0),  # never beyond, however slow
        (-10.0, 0.0, {"height_gain_per_s": 0.1, "floor_m": 15.0}, -15.0),
        (-10.0, 0.0, {"height_gain_per_s": 2.0}, -19.0),
    ],
)
def test_a_height_is_cut_to_what_the_autopilot_may_make_of_it(wanted_m, vertical, limits, sent_m):
    at = Situation((0.0, 0.0, -20.0), (0.0, 0.0, 0.0))
    limited = settled((0.0, 0.0, vertical), at, replace(OPEN, **limits), down_m=wanted_m)
    assert limited.setpoint.down_m == pytest.approx(sent_m)
    assert (Limiter.HEIGHT in limited.acted) == (sent_m != wanted_m)


@pytest.mark.parametrize(
    ("position", "sent_m"),
    [
        ((1.0, 0.0, -6.0), -6.0 + 1.0 / 1.5),  # above the lid: its braking curve
        ((4.0, 0.0, -2.0), 0.0 - 2.0 + 2.0),  # beside: down is free
        ((1.0, 0.0, -2.0), -2.0),  # inside: no deeper
        ((3.3, 0.0, -5.4), -5.4),  # across the rim: what may not be, is not
    ],
)
def test_a_height_does_not_lead_into_the_stand_off(position, sent_m):
    at = Situation(position, (0.0, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0))
    assert settled((0.0, 0.0, 0.0), at, ZONE, down_m=30.0).setpoint.down_m == pytest.approx(sent_m)


@pytest.mark.parametrize(
    "name",
    [
        "speed_m_s",
        "climb_m_s",
        "descent_m_s",
        "acceleration_m_s2",
        "vertical_acceleration_m_s2",
        "jerk_m_s3",
        "yaw_rate_rad_s",
        "braking_m_s2",
        "vertical_braking_m_s2",
        "reaction_s",
        "height_gain_per_s",
        "fence_radius_m",
    ],
)
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf, 2e6])
def test_a_limit_that_is_no_positive_number_is_refused_by_name(name, value):
    with pytest.raises(ConfigError, match=rf"^{name} = {value}: allowed is"):
        replace(OPEN, **{name: value})


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"floor_m": 30.0, "ceiling_m": 30.0}, "floor_m = 30.0: allowed is less than ceiling_m = 30.0"),
        ({"floor_m": math.nan}, "floor_m = nan"),
        ({"ceiling_m": math.inf}, "ceiling_m = inf"),
        ({"floor_m": -math.inf}, "floor_m = -inf"),
        ({"home_ned_m": (0.0, math.nan, 0.0)}, "home_ned_m"),
        ({"fence_margin_m": -1.0}, "fence_margin_m = -1.0"),
        ({"fence_margin_m": 5.0, "fence_radius_m": 5.0}, "fence_margin_m = 5.0"),
    ],
)
def test_limits_that_contradict_each_other_are_refused_by_name(values, words):
    with pytest.raises(ConfigError, match=words):
        replace(OPEN, **values)


@pytest.mark.parametrize("values", [{"radius_m": 0.0, "height_m": 5.0}, {"radius_m": 3.0, "height_m": math.nan}])
def test_a_stand_off_without_size_is_refused_by_name(values):
    with pytest.raises(ConfigError, match=r"stand_off\.(radius_m = 0.0|height_m = nan): allowed"):
        StandOff(**values)


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        (((0.0, 0.0), (1.0, 0.0)), "2 corners"),
        (((0.0, 0.0), (1.0, 0.0), (math.nan, 1.0)), "finite"),
        (((0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (0.0, 1.0)), "edge 1 .* shorter"),
        (((0.0, 0.0), (10.0, 10.0), (10.0, 0.0), (0.0, 10.0)), "edges 0 and 2 cross"),
        (((0.0, 0.0), (10.0, 0.0), (5.0, 0.0)), "edges 0 and 1 cross"),
        (((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (5.0, 0.0), (0.0, 10.0)), "edges 0 and 2 cross"),
        (((0.0, 0.0), (10.0, 0.0), (10.0, 5.0), (20.0, 5.0), (20.0, 0.0), (5.0, 0.0), (5.0, -5.0)), "cross or touch"),
    ],
)
def test_a_polygon_that_is_none_is_refused(corners, words):
    with pytest.raises(ConfigError, match=words):
        Polygon(corners)


TOUCHING = [
    ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (5.0, 0.0), (0.0, 10.0)),  # a corner on an edge
    ((0.0, 0.0), (10.0, 0.0), (10.0, 5.0), (20.0, 5.0), (20.0, 0.0), (5.0, 0.0), (5.0, -5.0)),  # edges on one line
    ((0.0, 0.0), (8.0, 0.0), (8.0, 8.0), (0.0, 0.0), (-8.0, 8.0), (-8.0, 0.0)),  # two corners in one place
    ((0.0, 0.0), (10.0, 10.0), (10.0, 0.0), (0.0, 10.0)),  # a bow tie
]
APART = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (7.0, 10.0), (7.0, 5.0), (3.0, 5.0), (3.0, 10.0), (0.0, 10.0))


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("reverse", [False, True])
def test_edges_that_touch_are_found_whichever_way_they_lie_and_edges_on_one_line_may_be_apart(turn, mirrored, reverse):
    def placed(corners):
        for _ in range(turn):
            corners = tuple((-east, north) for north, east in corners)
        corners = tuple((east, north) for north, east in corners) if mirrored else corners
        return corners[::-1] if reverse else corners

    for corners in TOUCHING:
        with pytest.raises(ConfigError, match="cross or touch"):
            Polygon(placed(corners))
    assert Polygon(placed(APART)).contains(placed(((5.0, 2.0), (5.0, 2.0)))[0])
    assert not Polygon(placed(APART)).contains(placed(((5.0, 8.0), (5.0, 8.0)))[0])


@settings(deadline=None)
@given(st.floats(-8, 8), st.floats(-8, 8), st.booleans())
def test_inside_and_nearest_edge_of_a_square_are_what_they_look_like(north, east, clockwise):
    corners = ((-5.0, -5.0), (5.0, -5.0), (5.0, 5.0), (-5.0, 5.0))
    square = Polygon(corners if clockwise else corners[::-1])
    if max(abs(north), abs(east)) != 5.0:
        assert square.contains((north, east)) == (max(abs(north), abs(east)) < 5.0)
    nearest = min(math.dist((north, east), point) for point in square.nearest_points((north, east)))
    outside = math.hypot(max(0.0, abs(north) - 5.0), max(0.0, abs(east) - 5.0))
    assert nearest == pytest.approx(outside or 5.0 - max(abs(north), abs(east)))
    for index, (one, other) in enumerate(square.edges()):
        middle = ((one[0] + other[0]) / 2.0, (one[1] + other[1]) / 2.0)
        assert square.outward(index) == pytest.approx((middle[0] / 5.0, middle[1] / 5.0))


def held_at(error_m, *, trim_m_s=0.0, dt_s=DT_S, **limits):
    """A hold at 50 m, found `error_m` too high (down positive: it has to sink by that much)."""
    envelope = replace(OPEN, **limits)
    memory = AltitudeHold(-50.0, trim_m_s)
    return hold_altitude(memory, down_m=-50.0 - error_m, wanted_down_m=None, envelope=envelope, dt_s=dt_s)


@pytest.mark.parametrize("error_m", [0.1, -0.1, 1.0, -1.0, 3.0])
def test_a_hold_asks_for_the_speed_that_still_brakes_at_the_height(error_m):
    out = held_at(error_m, dt_s=0.0)
    speed = abs(out.velocity_down_m_s)
    assert math.copysign(1.0, out.velocity_down_m_s) == math.copysign(1.0, error_m)
    # gain 0.8/s near the height, √(2 · braking · distance) far from it: v/0.8 + v²/(2 · braking) = distance.
    assert speed / 0.8 + speed**2 / (2.0 * OPEN.vertical_braking_m_s2) == pytest.approx(abs(error_m))


@pytest.mark.parametrize(("error_m", "speed"), [(500.0, 2.0), (-500.0, -4.0)])
def test_a_hold_far_away_climbs_and_sinks_at_the_limits(error_m, speed):
    assert held_at(error_m, trim_m_s=0.1).velocity_down_m_s == speed


@pytest.mark.parametrize(
    ("error_m", "dt_s", "trim_m_s"),
    [
        (0.5, 0.02, 0.1 + 0.08 * 0.5 * 0.02),
        (-0.5, 0.05, 0.1 - 0.08 * 0.5 * 0.05),
        (1.49, 0.02, 0.1 + 0.08 * 1.49 * 0.02),
        (1.51, 0.02, 0.1),  # far away it waits
        (0.5, 7.0, 0.1 + 0.08 * 0.5 * 0.1),  # a late step is not made up for
        (0.5, -7.0, 0.1),
        (0.5, math.nan, 0.1),
    ],
)
def test_the_trim_of_a_hold_is_the_slow_integral_of_a_small_error(error_m, dt_s, trim_m_s):
    out = held_at(error_m, trim_m_s=0.1, dt_s=dt_s)
    assert out.memory == AltitudeHold(-50.0, pytest.approx(trim_m_s))
    assert out.velocity_down_m_s - held_at(error_m, dt_s=0.0).velocity_down_m_s == pytest.approx(trim_m_s)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_trim_of_a_hold_is_bounded(sign):
    assert held_at(sign, trim_m_s=0.4999 * sign, dt_s=0.1).memory.trim_m_s == 0.5 * sign


def test_a_hold_begins_without_trim_and_keeps_a_wanted_height_over_its_own():
    begun = hold_altitude(None, down_m=-50.0, wanted_down_m=None, envelope=OPEN, dt_s=DT_S)
    assert begun == (0.0, AltitudeHold(-50.0, 0.0))
    moved = hold_altitude(begun.memory, down_m=-50.0, wanted_down_m=-60.0, envelope=OPEN, dt_s=DT_S)
    assert moved.memory.down_m == -60.0
    assert moved.velocity_down_m_s < 0.0
    kept = hold_altitude(moved.memory, down_m=-50.0, wanted_down_m=None, envelope=OPEN, dt_s=DT_S)
    assert kept.memory.down_m == -60.0


@pytest.mark.parametrize(("down_m", "held_m"), [(-3.0, -10.0), (-90.0, -40.0)])
def test_a_hold_stays_between_floor_and_ceiling_above_home(down_m, held_m):
    between = replace(OPEN, floor_m=5.0, ceiling_m=35.0, home_ned_m=(0.0, 0.0, -5.0))
    assert hold_altitude(None, down_m=down_m, wanted_down_m=None, envelope=between, dt_s=DT_S).memory.down_m == held_m
