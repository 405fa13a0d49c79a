"""The walls together, and the braking law at its limits, each against its closed form."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.control import Limiter, Situation
from guidance.control.braking_law import (
    Constraint,
    Separation,
    Wall,
    approach_speed,
    braked,
    constraints_of,
    held_back,
    measure_walls,
    obey,
    surge,
)
from guidance.control.polygon import Polygon
from guidance.frames import Ned
from guidance.game import StandOff
from tests.control.scenes import HOVER, OPEN

STILL = (0.0, 0.0, 0.0)
DOWN = (0.0, 0.0, 1.0)
NORTH = (1.0, 0.0, 0.0)
SQUARE = Polygon(((-90.0, -90.0), (-90.0, 90.0), (90.0, 90.0), (90.0, -90.0)))
ALL = replace(
    OPEN,
    floor_m=3.0,
    ceiling_m=60.0,
    fence_radius_m=100.0,
    fence_polygon=SQUARE,
    fence_margin_m=2.0,
    floor_margin_m=1.0,
    stand_off=StandOff(radius_m=4.0, height_m=6.0),
)
AT_10_M = HOVER._replace(position_ned_m=Ned((0.0, 0.0, -10.0)))
MATE = Separation(Ned((30.0, 0.0, -10.0)), 8.0, 3.0)


def test_every_wall_counts_however_many_others_there_are_and_the_circle_is_last():
    situation = AT_10_M._replace(evader_position_ned_m=Ned((20.0, 0.0, 0.0)))
    walls = measure_walls(situation, ALL, [MATE, MATE])
    assert [wall.limiter for wall in walls] == [
        Limiter.STAND_OFF,
        Limiter.SEPARATION,
        Limiter.SEPARATION,
        *[Limiter.FENCE_POLYGON] * 4,
        Limiter.FLOOR,
        Limiter.CEILING,
        Limiter.FENCE_RADIUS,
    ]
    assert [wall.approached for wall in walls] == [True] + [False] * 9
    gaps_m = [round(wall.gap_m, 6) for wall in walls]
    assert gaps_m == [math.hypot(16.0, 4.0).__round__(6), 11, 11, 88, 88, 88, 88, 7, 50, 98]
    assert [wall.margin_m for wall in walls] == [0, 0, 0, 2, 2, 2, 2, 0, 0, 2]


def test_a_situation_and_a_wall_say_nothing_that_they_were_not_told():
    assert Situation(Ned(STILL), Ned(STILL)) == (STILL, STILL, 0.0, None, None, STILL, 0.0)
    assert Wall(Limiter.FLOOR, Ned(DOWN), 5.0) == (
        Limiter.FLOOR,
        DOWN,
        5.0,
        0.0,
        math.inf,
        STILL,
        False,
    )


@pytest.mark.parametrize(("above_m", "share"), [(0.0, 0.0), (0.25, 0.5), (0.5, 1.0), (3.0, 1.0)])
def test_a_fleeing_evader_is_trusted_from_half_a_metre_above_the_disc(above_m, share):
    situation = Situation(
        Ned((0.0, 0.0, -6.0 - above_m)), Ned(STILL), 0.0, Ned((3.0, 0.0, 0.0)), Ned((2.0, 0.0, 0.0))
    )
    wall = measure_walls(situation, ALL)[0]
    assert wall.velocity_ned_m_s == pytest.approx((2.0 * share, 0.0, 0.0))


@pytest.mark.parametrize("down_m", [-5.0, 0.0])
@pytest.mark.parametrize("away_m", [1.0, 4.0])
def test_inside_the_stand_off_its_side_and_its_top_are_walls(down_m, away_m):
    situation = HOVER._replace(
        position_ned_m=Ned((0.0, 0.0, down_m)),
        evader_position_ned_m=Ned((0.6 * away_m, 0.8 * away_m, 0.0)),
    )
    side, top = (wall for wall in measure_walls(situation, ALL) if wall.approached)
    assert side.normal_ned == pytest.approx((0.6, 0.8, 0.0))
    assert top.normal_ned == DOWN
    assert side.gap_m == top.gap_m == max(away_m - 4.0, -down_m - 6.0)


@pytest.mark.parametrize("above_m", [4.0, -4.0])
def test_a_mate_above_or_below_is_a_wall_halfway_to_its_cylinder(above_m):
    mate = Separation(Ned((2.0, 0.0, -30.0 - above_m)), 8.0, 3.0)
    situation = HOVER._replace(position_ned_m=Ned((0.0, 0.0, -30.0)))
    (wall,) = (
        wall for wall in measure_walls(situation, ALL, [mate]) if wall.limiter is Limiter.SEPARATION
    )
    assert wall == Wall(Limiter.SEPARATION, Ned((0.0, 0.0, -above_m / 4.0)), 0.5)


@pytest.mark.parametrize(("height_m", "towards"), [(3.0, -1.0), (2.9, 0.0)])
@pytest.mark.parametrize("above_m", [0.0, 0.5, 2.0])
def test_below_the_floor_no_mate_above_is_in_the_way_up(height_m, towards, above_m):
    mate = Separation(Ned((0.0, 0.0, -height_m - above_m)), 8.0, 3.0)
    situation = HOVER._replace(position_ned_m=Ned((0.0, 0.0, -height_m)))
    walls = measure_walls(situation, ALL, [mate])
    vertical = [wall.normal_ned[2] for wall in walls if wall.limiter is Limiter.SEPARATION]
    if above_m == 0.0:
        towards = 1.0
    assert vertical == ([towards] if towards else [])


def test_the_floors_margin_does_not_hide_a_vehicle_below_it():
    mate = Separation(Ned((0.0, 0.0, -20.0)), 8.0, 3.0)
    doubtful = HOVER._replace(position_ned_m=Ned((0.0, 0.0, -3.5)), height_sd_m=1.0)
    walls = measure_walls(doubtful, ALL, [mate])
    assert not [wall for wall in walls if wall.limiter is Limiter.SEPARATION]


UNEVEN = (
    replace(OPEN, braking_m_s2=2.0, vertical_braking_m_s2=0.4),
    replace(OPEN, braking_m_s2=0.4, vertical_braking_m_s2=2.0),
)
wall_of = st.sampled_from([(NORTH, 0), (DOWN, 2), ((0.0, 0.0, -1.0), 2), ((0.0, -1.0, 0.0), 1)])


@given(st.sampled_from(UNEVEN), wall_of, st.floats(0.0, 20.0), st.floats(0.0, 9.0))
def test_a_desired_velocity_closes_on_a_wall_as_fast_as_stops_before_it(
    envelope, wall, gap_m, speed
):
    normal, axis = wall
    velocity = tuple(speed * part for part in normal)
    kept = held_back(Ned(velocity), (Wall(Limiter.FLOOR, Ned(normal), gap_m),), envelope)
    braking = envelope.vertical_braking_m_s2 if axis == 2 else envelope.braking_m_s2
    allowed = min(speed, approach_speed(gap_m, braking, envelope.reaction_s))
    assert kept == pytest.approx(tuple(allowed * part for part in normal), abs=1e-9)


@pytest.mark.parametrize("braking_m_s2", [0.4, 2.0])
def test_a_speed_that_does_not_quite_stop_before_the_wall_is_reduced(braking_m_s2):
    envelope = replace(OPEN, braking_m_s2=braking_m_s2)
    allowed = approach_speed(5.0, braking_m_s2, envelope.reaction_s)
    wall = (Wall(Limiter.FENCE_RADIUS, Ned(NORTH), 5.0),)
    for excess in (0.001, 0.1, 0.5):
        kept = held_back(Ned((allowed + excess, 0.0, 0.0)), wall, envelope)
        assert kept == pytest.approx((allowed, 0.0, 0.0))


@pytest.mark.parametrize(("beyond_m", "back_m_s"), [(0.5, 0.25), (2.0, 1.0), (9.0, 1.0)])
def test_beyond_a_wall_the_way_back_is_half_its_length_a_second_up_to_one_metre(beyond_m, back_m_s):
    wall = Wall(Limiter.FENCE_RADIUS, Ned(NORTH), -beyond_m)
    assert held_back(Ned((3.0, 2.0, 0.0)), (wall,), OPEN) == pytest.approx((-back_m_s, 2.0, 0.0))


def test_the_evaders_wall_is_left_to_the_approach():
    wall = Wall(Limiter.STAND_OFF, Ned(NORTH), -1.0, approached=True)
    fast = Situation(Ned(STILL), Ned((9.0, 0.0, 0.0)))
    assert held_back(Ned((9.0, 0.0, 0.0)), (wall,), OPEN) == (9.0, 0.0, 0.0)
    assert braked(Ned((1.0, 0.0, 0.0)), fast, (wall,), OPEN) == (1.0, 0.0, 0.0)
    speeding_up = fast._replace(acceleration_ned_m_s2=Ned((4.0, 0.0, 0.0)))
    far = (wall._replace(gap_m=20.0),)
    (steady,) = constraints_of(Ned((9.0, 0.0, 0.0)), fast, far, OPEN)
    (gaining,) = constraints_of(Ned((9.0, 0.0, 0.0)), speeding_up, far, OPEN)
    assert gaining == steady


@pytest.mark.parametrize(
    ("flown", "gap_m", "fed"),
    [
        (0.0, -1.0, (1.0, 0.0, 0.0)),  # beyond the wall, and at rest
        (2.0, 3.0, (1.0, 0.0, 0.0)),  # 2 m/s are drift for 1 s and stop in 1 m
        (-2.0, -1.0, (1.0, 0.0, 0.0)),
    ],
)
def test_a_feed_forward_is_left_alone_where_no_wall_needs_braking(flown, gap_m, fed):
    situation = Situation(Ned(STILL), Ned((flown, 0.0, 0.0)))
    wall = Wall(Limiter.FENCE_RADIUS, Ned(NORTH), gap_m)
    assert braked(Ned(fed), situation, (wall,), OPEN) == fed
    assert braked(None, situation, (wall,), OPEN) is None
    nearer = wall._replace(gap_m=gap_m - 0.1)
    assert (braked(Ned(fed), situation, (nearer,), OPEN) != fed) is (flown > 0.0)


@pytest.mark.parametrize("reaction_s", [0.5, 1.5])
def test_walls_within_drift_and_stop_are_constraints_and_no_others(reaction_s):
    envelope = replace(
        OPEN, reaction_s=reaction_s, braking_m_s2=2.0, vertical_braking_m_s2=1.5, easing_m_s3=10.0
    )
    situation = Situation(
        Ned(STILL), Ned((3.0, 4.0, 0.0)), acceleration_ned_m_s2=Ned((3.0, 1.0, 0.0))
    )
    way_on_m = math.hypot(*surge(situation.velocity_ned_m_s, Ned((3.0, 1.0, 0.0)), envelope))
    assert way_on_m > 0.1
    stop_m = 6.0 * reaction_s + 6.0**2 / (2.0 * 1.5)
    reach_m = 5.0 * reaction_s + way_on_m + stop_m
    for off_m, count in ((-1e-6, 1), (1e-6, 0)):
        wall = Wall(Limiter.FENCE_RADIUS, Ned(NORTH), reach_m + off_m)
        assert len(constraints_of(Ned((6.0, 0.0, 0.0)), situation, (wall,), envelope)) == count


def test_floor_and_ceiling_are_constraints_within_the_stop_of_the_vertical_speed():
    envelope = replace(OPEN, reaction_s=0.5, braking_m_s2=2.0, vertical_braking_m_s2=1.5)
    situation = Situation(Ned(STILL), Ned((3.0, 4.0, 0.0)))
    reach_m = 5.0 * 0.5 + 2.0 * 0.5 + 2.0**2 / (2.0 * 1.5)
    for normal, down in ((DOWN, 2.0), ((0.0, 0.0, -1.0), -2.0)):
        for off_m, count in ((-1e-6, 1), (1e-6, 0)):
            wall = Wall(Limiter.FLOOR, Ned(normal), reach_m + off_m)
            asked = Ned((6.0, 0.0, down))
            assert len(constraints_of(asked, situation, (wall,), envelope)) == count


def test_a_vehicle_at_rest_on_a_wall_has_it_for_a_constraint():
    wall = Wall(Limiter.FENCE_RADIUS, Ned(NORTH), 0.0)
    assert len(constraints_of(Ned(STILL), HOVER, (wall,), OPEN)) == 1


def test_the_time_to_stop_counts_the_speed_relative_to_the_wall():
    rising = Wall(Limiter.FLOOR, Ned(DOWN), 2.0, velocity_ned_m_s=Ned((0.0, 0.0, -1.0)))
    (constraint,) = constraints_of(Ned((0.0, 0.0, 2.0)), HOVER, (rising,), OPEN)
    assert constraint.vertical_s == pytest.approx(0.5 + 3.0 / (2.0 * 1.0))


circles = st.tuples(st.floats(-9, 9), st.floats(-9, 9), st.floats(-9, 9), st.floats(-9, 9))


@given(circles, st.floats(0.3, 3.0), st.floats(0.0, 9.0))
def test_a_circle_keeps_the_stop_point_inside_and_leaves_alone_what_stops_there(
    drawn, ground_s, spare_m
):
    north, east, v_north, v_east = drawn
    distance_m = math.hypot(north, east) + spare_m
    circle = Constraint(Limiter.FENCE_RADIUS, Ned(NORTH), distance_m, ground_s, 1.0, (north, east))
    kept, active = obey(Ned((v_north, v_east, 1.0)), (circle,))
    stop_m = math.hypot(north + kept[0] * ground_s, east + kept[1] * ground_s)
    asked_m = math.hypot(north + v_north * ground_s, east + v_east * ground_s)
    assert stop_m <= distance_m + 1e-6
    assert (active == ()) is (asked_m <= distance_m + 1e-9)
    assert kept[2] == 1.0


@pytest.mark.parametrize(("speed", "kept"), [(0.0, 0.0), (0.3, 0.3), (0.8, 0.5)])
def test_a_small_circle_is_one_too(speed, kept):
    circle = Constraint(Limiter.FENCE_RADIUS, Ned(NORTH), 0.5, about_m=(0.0, 0.0))
    assert obey(Ned((speed, 0.0, 0.0)), (circle,))[0] == pytest.approx((kept, 0.0, 0.0))
