"""Limits in space, each wall against its closed form: fences, floor and ceiling, stand-off."""

import math
from dataclasses import replace

import pytest

from guidance.control import Limiter, Situation
from guidance.control.braking_law import COVER_M, measure_walls, surge
from guidance.control.polygon import Polygon
from guidance.frames import Ned
from guidance.game import StandOff
from tests.control.scenes import HOVER, OPEN, settled


def asked_ground(distance_m, speed, envelope=OPEN):
    """The closing speed that the law allows: c · (reaction + |v|/2a) = distance."""
    return distance_m / (envelope.reaction_s + speed / (2.0 * envelope.braking_m_s2))


@pytest.mark.parametrize(
    ("limits", "velocity", "distance_m", "axis", "limiter"),
    [
        ({"fence_radius_m": 6.0}, (8.0, 0.0, 0.0), 6.0, 0, Limiter.FENCE_RADIUS),
        (
            {"fence_radius_m": 7.0, "fence_margin_m": 1.0},
            (0.0, 8.0, 0.0),
            6.0,
            1,
            Limiter.FENCE_RADIUS,
        ),
        (
            {"fence_radius_m": 106.0, "home_ned_m": Ned((-100.0, 0.0, 0.0))},
            (8.0, 0.0, 0.0),
            6.0,
            0,
            Limiter.FENCE_RADIUS,
        ),
        (
            {"fence_polygon": Polygon(((-9.0, -90.0), (-9.0, 90.0), (5.0, 90.0), (5.0, -90.0)))},
            (8.0, 0.0, 0.0),
            5.0,
            0,
            Limiter.FENCE_POLYGON,
        ),
        (
            {
                "fence_polygon": Polygon(
                    ((-9.0, -90.0), (-9.0, 90.0), (15.0, 90.0), (15.0, -90.0))
                ),
                "fence_margin_m": 2.0,
                "home_ned_m": Ned((-8.0, 3.0, 0.0)),
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
    assert limited.active == (limiter,)


def test_the_vehicle_s_own_drift_is_taken_from_the_distance():
    moving = Situation(Ned((0.0, 0.0, 0.0)), Ned((4.0, 0.0, 1.0)))
    fenced = replace(OPEN, fence_radius_m=6.0)
    assert settled((8.0, 0.0, 0.0), moving, fenced).setpoint.velocity_ned_m_s[0] == pytest.approx(
        asked_ground(4.0, 8.0)
    )
    away = Situation(Ned((0.0, 0.0, 0.0)), Ned((0.0, 0.0, -4.0)))
    floored = replace(OPEN, floor_m=-1.5)
    assert settled((0.0, 0.0, 2.0), away, floored).setpoint.velocity_ned_m_s[2] == pytest.approx(
        1.0
    )
    assert settled((0.0, 0.0, 2.0), moving, floored).setpoint.velocity_ned_m_s[2] == pytest.approx(
        1.0 / 1.5
    )


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_way_on_of_a_vehicle_that_gathers_speed_is_taken_from_the_distance(axis, side):
    def along(size):
        return tuple(side * size if n == axis else 0.0 for n in range(3))

    gathering = HOVER._replace(acceleration_ned_m_s2=Ned(along(3.5)))
    further_m = abs(surge(HOVER.velocity_ned_m_s, Ned(along(3.5)), OPEN)[axis])
    assert 0.05 < further_m < 1.0
    square = Polygon(((-6.0, -6.0), (-6.0, 6.0), (6.0, 6.0), (6.0, -6.0)))
    allowed = settled(
        along(8.0), gathering, replace(OPEN, fence_polygon=square)
    ).setpoint.velocity_ned_m_s
    assert allowed == pytest.approx(along(asked_ground(6.0 - further_m, 8.0)))


def test_in_a_sharp_corner_both_walls_hold_at_once():
    wedge = Polygon(((12.0, 0.0), (-60.0, 18.0), (-60.0, -18.0)))  # its edges meet at 28 degrees
    for velocity in ((8.0, 0.0, 1.0), (7.0, 3.0, 1.0), (7.0, -3.0, 1.0)):
        north, east, down = settled(
            velocity, envelope=replace(OPEN, fence_polygon=wedge)
        ).setpoint.velocity_ned_m_s
        seconds = OPEN.reaction_s + math.hypot(*velocity[:2]) / (2.0 * OPEN.braking_m_s2)
        for index in (0, 2):
            outward = wedge.outward(index)
            stopped_m = ((north * outward[0] + east * outward[1]) * seconds, 12.0 * outward[0])
            assert stopped_m[0] <= stopped_m[1] + 1e-9
        assert north > 0.5
        assert down == 1.0


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
    fenced = replace(OPEN, fence_radius_m=30.0, home_ned_m=Ned((7.0, -9.0, 0.0)))
    turn = slice(None, None, 1 - 2 * axis)
    north, east = (20.0, 0.0)[turn]
    moving = Situation(Ned((7.0 + north, -9.0 + east, 0.0)), Ned((*velocity[turn], 0.0)))
    allowed = settled((*(8.0, 0.0)[turn], 0.0), moving, fenced).setpoint.velocity_ned_m_s
    assert allowed[axis] == pytest.approx(asked_ground(10.0 - drift_m, 8.0))


def test_what_goes_along_a_polygon_s_edge_is_kept():
    edge = replace(
        OPEN, fence_polygon=Polygon(((-90.0, -90.0), (3.0, -90.0), (3.0, 90.0), (-90.0, 90.0)))
    )
    limited = settled((3.0, 4.0, 1.0), envelope=edge)
    assert limited.setpoint.velocity_ned_m_s == pytest.approx((asked_ground(3.0, 5.0), 4.0, 1.0))


SQUARE = replace(
    OPEN, fence_polygon=Polygon(((-20.0, -20.0), (-20.0, 20.0), (20.0, 20.0), (20.0, -20.0)))
)


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
        (
            (19.995, 0.0),
            (5.0, 4.0),
            (0.005 / (0.5 + math.hypot(5.0, 4.0) / 4.0), 4.0),
        ),  # a hair inside
        (
            (20.005, 19.995),
            (0.0, 8.0),
            (0.0, 0.005 / 2.5),
        ),  # a hair outside one edge, the other one still holds
        ((20.005, 0.0), (5.0, 4.0), (0.0, 4.0)),
        ((20.0, 21.0), (0.0, 8.0), (0.0, 0.0)),
    ],
)
def test_a_polygon_holds_on_its_line_in_its_corners_and_outside(position, velocity, allowed):
    at = Situation(Ned((*position, 0.0)), Ned((0.0, 0.0, 0.0)))
    limited = settled((*velocity, 0.0), at, SQUARE)
    assert limited.setpoint.velocity_ned_m_s == pytest.approx((*allowed, 0.0), abs=1e-9)


def test_past_an_inward_corner_the_way_is_free():
    notched = Polygon(((-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (0.0, 0.0), (-50.0, 50.0)))
    at = Situation(Ned((0.0, -0.5, 0.0)), Ned((0.0, 0.0, 0.0)))
    free = (5.0, 0.0, 0.0)
    closing = (0.0, 5.0, 0.0)
    assert settled(free, at, replace(OPEN, fence_polygon=notched)).setpoint.velocity_ned_m_s == free
    allowed = settled(closing, at, replace(OPEN, fence_polygon=notched)).setpoint.velocity_ned_m_s
    assert allowed == pytest.approx((0.0, asked_ground(0.5, 5.0), 0.0))


def test_a_polygon_keeps_its_margin_from_inside_and_outside():
    with_margin = replace(SQUARE, fence_margin_m=2.0)
    for north in (18.0, 19.0, 20.0, 21.0):
        at = Situation(Ned((north, 0.0, 0.0)), Ned((0.0, 0.0, 0.0)))
        assert settled((5.0, 4.0, 0.0), at, with_margin).setpoint.velocity_ned_m_s == pytest.approx(
            (0.0, 4.0, 0.0)
        )
        assert settled((-5.0, 4.0, 0.0), at, with_margin).setpoint.velocity_ned_m_s == (
            -5.0,
            4.0,
            0.0,
        )


def test_an_acceleration_does_not_lean_on_the_circle_and_may_point_inwards():
    fenced = replace(OPEN, fence_radius_m=6.0, home_ned_m=Ned((0.0, -2.0, 0.0)))
    at_fence = Situation(Ned((0.0, 4.0, 0.0)), Ned((0.0, 0.0, 0.0)))
    out = settled((0.0, 8.0, 0.0), at_fence, fenced, acceleration_ned_m_s2=Ned((2.0, 3.0, 1.0)))
    assert out.setpoint.acceleration_ned_m_s2 == pytest.approx((2.0, 0.0, 1.0), abs=1e-9)
    inwards = settled(
        (0.0, 8.0, 0.0), at_fence, fenced, acceleration_ned_m_s2=Ned((2.0, -3.0, 1.0))
    )
    assert inwards.setpoint.acceleration_ned_m_s2 == pytest.approx((2.0, -3.0, 1.0), abs=1e-9)


@pytest.mark.parametrize("bearing_deg", [0, 90, 200])
def test_at_home_itself_the_circle_has_its_law_and_no_acceleration_leads_towards_it(bearing_deg):
    way = (math.cos(math.radians(bearing_deg)), math.sin(math.radians(bearing_deg)))
    fenced = replace(OPEN, fence_radius_m=1.0)
    asked = (8.0 * way[0], 8.0 * way[1], 0.0)
    # 3 m/s² ahead and 1 m/s² to the side
    fed = Ned((3.0 * way[0] - way[1], 3.0 * way[1] + way[0], 0.0))
    limited = settled(asked, HOVER, fenced, acceleration_ned_m_s2=fed)
    speed = asked_ground(1.0, 8.0)
    assert limited.setpoint.velocity_ned_m_s[:2] == pytest.approx((speed * way[0], speed * way[1]))
    assert limited.setpoint.acceleration_ned_m_s2 == pytest.approx((-way[1], way[0], 0.0))


def test_across_the_radius_no_acceleration_leads_to_where_the_circle_is_flown_to():
    fenced = replace(OPEN, fence_radius_m=6.0)
    east_of_home = Situation(Ned((0.0, 4.0, 0.0)), Ned((0.0, 0.0, 0.0)))
    limited = settled(
        (8.0, 0.0, 0.0), east_of_home, fenced, acceleration_ned_m_s2=Ned((3.0, 0.0, 0.0))
    )
    seconds = OPEN.reaction_s + 8.0 / (2.0 * OPEN.braking_m_s2)
    stop = math.atan2(4.0, 8.0 * seconds)
    normal = (math.cos(stop), math.sin(stop))
    north, east, _ = limited.setpoint.acceleration_ned_m_s2
    assert north * normal[0] + east * normal[1] == pytest.approx(0.0, abs=1e-9)
    assert north * normal[1] - east * normal[0] == pytest.approx(3.0 * normal[1])


def test_the_circle_bends_a_velocity_inwards_so_that_it_stops_on_the_circle():
    fenced = replace(OPEN, fence_radius_m=30.0)
    at_rim = Situation(Ned((30.0, 0.0, 0.0)), Ned((0.0, 0.0, 0.0)))
    north, east, _ = settled((0.0, 8.0, 0.0), at_rim, fenced).setpoint.velocity_ned_m_s
    seconds = OPEN.reaction_s + 8.0 / (2.0 * OPEN.braking_m_s2)
    assert math.hypot(30.0 + north * seconds, east * seconds) == pytest.approx(30.0)
    assert math.atan2(east * seconds, 30.0 + north * seconds) == pytest.approx(
        math.atan2(8.0 * seconds, 30.0)
    )


@pytest.mark.parametrize(
    ("limits", "velocity", "allowed", "limiter"),
    [
        ({"floor_m": 3.0}, 2.0, 1.0 / 1.5, Limiter.FLOOR),
        ({"floor_m": 3.8}, 0.5, 0.2 / 0.75, Limiter.FLOOR),
        ({"ceiling_m": 5.0}, -4.0, -1.0 / 2.5, Limiter.CEILING),
        ({"floor_m": 8.0, "home_ned_m": Ned((0.0, 0.0, 5.0))}, 2.0, 1.0 / 1.5, Limiter.FLOOR),
    ],
)
def test_floor_and_ceiling_allow_the_vertical_speed_that_still_stops(
    limits, velocity, allowed, limiter
):
    limited = settled(
        (7.0, 4.0, velocity),
        Situation(Ned((0.0, 0.0, -4.0)), Ned((0.0, 0.0, 0.0))),
        replace(OPEN, **limits),
    )
    assert limited.setpoint.velocity_ned_m_s == pytest.approx((7.0, 4.0, allowed))
    assert limited.active == (limiter,)


@pytest.mark.parametrize(
    ("height_sd_m", "margin_m"),
    [(0.0, 0.0), (0.3, 0.3), (0.8, 0.5), (9.0, 0.5), (-1.0, 0.0), (math.nan, 0.0)],
)
def test_a_vehicle_stops_above_the_floor_by_the_error_of_its_height(height_sd_m, margin_m):
    at = Situation(Ned((0.0, 0.0, -4.0)), Ned((0.0, 0.0, 0.0)), height_sd_m=height_sd_m)
    limited = settled((0.0, 0.0, 2.0), at, replace(OPEN, floor_m=3.0, floor_margin_m=0.5))
    assert limited.setpoint.velocity_ned_m_s == pytest.approx((0.0, 0.0, (1.0 - margin_m) / 1.5))
    (floor,) = [
        wall
        for wall in measure_walls(at, replace(OPEN, floor_margin_m=0.5))
        if wall.limiter is Limiter.FLOOR
    ]
    assert floor.margin_m == margin_m


ZONE = replace(OPEN, stand_off=StandOff(radius_m=3.0, height_m=5.0))


@pytest.mark.parametrize(
    ("position", "velocity", "allowed"),
    [
        (
            (-10.0, 0.0, -2.0),
            (8.0, 1.0, 1.0),
            (asked_ground(7.0, math.hypot(8.0, 1.0)), 1.0, 1.0),
        ),  # beside
        ((-1.0, 0.0, -6.0), (8.0, 0.0, 2.0), (8.0, 0.0, 1.0 / 1.5)),  # above
        ((-1.0, 0.0, -2.0), (8.0, 3.0, 2.0), (0.0, 3.0, 0.0)),  # inside: no deeper
        ((-1.0, 0.0, -2.0), (-8.0, 0.0, -2.0), (-8.0, 0.0, -2.0)),  # inside: the way out is free
        ((-2.0, 0.0, -50.0), (8.0, 0.0, 2.0), (8.0, 0.0, 2.0)),  # far above
        (
            (0.0, 0.0, -2.0),
            (8.0, 3.0, 2.0),
            (8.0, 3.0, 0.0),
        ),  # right over it and too low: every way out is free
        ((0.0, 0.0, 1.0), (-3.0, 8.0, -4.0), (-3.0, 8.0, -4.0)),
    ],
)
def test_the_stand_off_is_a_wall_beside_and_a_lid_above(position, velocity, allowed):
    limited = settled(
        velocity, Situation(Ned(position), Ned((0.0, 0.0, 0.0)), 0.0, Ned((0.0, 0.0, 0.0))), ZONE
    )
    assert limited.setpoint.velocity_ned_m_s == pytest.approx(allowed, abs=1e-12)
    assert limited.active == ((Limiter.STAND_OFF,) if allowed != velocity else ())


def test_the_stand_off_is_about_the_evader_wherever_that_is():
    here = Situation(
        Ned((-10.0, 2.0, -7.0)),
        Ned((1.0, 0.5, 0.0)),
        0.0,
        Ned((0.0, 0.0, 0.0)),
        Ned((2.0, -1.0, 0.0)),
    )
    there = here._replace(
        position_ned_m=Ned((20.0, -58.0, -3.0)), evader_position_ned_m=Ned((30.0, -60.0, 4.0))
    )
    one, other = (
        settled((8.0, -2.0, 2.0), at, ZONE).setpoint.velocity_ned_m_s for at in (here, there)
    )
    assert one == pytest.approx(other)
    assert one != pytest.approx((8.0, -2.0, 2.0))


@pytest.mark.parametrize("fleeing_m_s", [0.0, 2.0])
def test_across_the_rim_both_closing_parts_share_the_gap(fleeing_m_s):
    # 3 m beside and 4 m above: a gap of 5 m; only the level part of the wall moves with the evader
    place = Ned((-6.0, 0.0, -9.0))
    evader_velocity = Ned((fleeing_m_s, 0.0, 0.0))
    here = Situation(place, Ned((0.0, 0.0, 0.0)), 0.0, Ned((0.0, 0.0, 0.0)), evader_velocity)
    north, _, down = settled((8.0, 0.0, 2.0), here, ZONE).setpoint.velocity_ned_m_s
    closing = 8.0 - fleeing_m_s
    ground_s = 0.5 + closing / 4.0
    vertical_s = 0.5 + 2.0 / 2.0
    used_m = 0.6 * (north - fleeing_m_s) * ground_s + 0.8 * down * vertical_s
    assert used_m == pytest.approx(5.0)
    if fleeing_m_s == 0.0:
        assert north / down == pytest.approx(8.0 / 2.0)


@pytest.mark.parametrize("bearing_deg", [0.0, 90.0, 217.0])
def test_an_evader_that_flees_takes_its_wall_along(bearing_deg):
    cosine = math.cos(math.radians(bearing_deg))
    sine = math.sin(math.radians(bearing_deg))

    def turned(along, across=0.0, down=0.0):
        return Ned((cosine * along - sine * across, sine * along + cosine * across, down))

    # 7 m beside and 2 m above: the gap is across the rim, and this is its way over the ground
    along_m = 53.0 / 7.0
    fleeing = Situation(
        turned(-10.0, down=-7.0), turned(3.0), 0.0, Ned((0.0, 0.0, 0.0)), turned(3.0)
    )
    assert settled(turned(9.0), fleeing, ZONE)[0].velocity_ned_m_s == pytest.approx(
        turned(3.0 + asked_ground(along_m, 6.0))
    )
    faster = fleeing._replace(velocity_ned_m_s=turned(5.0))  # only what it is faster by is drift
    assert settled(turned(9.0), faster, ZONE)[0].velocity_ned_m_s == pytest.approx(
        turned(3.0 + asked_ground(along_m - 1.0, 6.0))
    )
    across = settled(turned(8.0, 5.0), fleeing, ZONE)[0].velocity_ned_m_s
    assert across == pytest.approx(turned(3.0 + asked_ground(along_m, math.hypot(5.0, 5.0)), 5.0))
    for velocity in (
        None,
        Ned((math.nan, 0.0, 0.0)),
        turned(math.inf),
        turned(1e9),
        turned(-3.0),
        turned(0.0, 3.0),
        Ned((0.0, 0.0, 9.0)),
    ):
        other = fleeing._replace(
            evader_velocity_ned_m_s=velocity, velocity_ned_m_s=Ned((0.0, 0.0, 0.0))
        )
        assert settled(turned(8.0), other, ZONE)[0].velocity_ned_m_s == pytest.approx(
            turned(asked_ground(along_m, 8.0))
        )


@pytest.mark.parametrize(
    ("above_m", "share"), [(-3.0, 0.0), (0.0, 0.0), (COVER_M / 4, 0.25), (COVER_M, 1.0), (2.0, 1.0)]
)
def test_beside_the_cylinder_no_flight_of_the_evader_is_trusted_in(above_m, share):
    place = (-10.0, 0.0, -5.0 - above_m)
    fleeing = Situation(
        Ned(place), Ned((0.0, 0.0, 0.0)), 0.0, Ned((0.0, 0.0, 0.0)), Ned((3.0, 0.0, 0.0))
    )
    north, _, _ = settled((9.0, 0.0, 0.0), fleeing, ZONE)[0].velocity_ned_m_s
    along_m = (49.0 + max(0.0, above_m) ** 2) / 7.0
    assert north == pytest.approx(3.0 * share + asked_ground(along_m, 9.0 - 3.0 * share))


def test_inside_the_stand_off_nothing_leads_deeper_however_the_evader_flees():
    inside = Situation(
        Ned((-1.0, 0.0, -2.0)),
        Ned((0.0, 0.0, 0.0)),
        0.0,
        Ned((0.0, 0.0, 0.0)),
        Ned((3.0, 0.0, 0.0)),
    )
    assert settled((8.0, 1.0, 1.0), inside, ZONE)[0].velocity_ned_m_s == pytest.approx(
        (0.0, 1.0, 0.0)
    )


@pytest.mark.parametrize("braking", [0.5, 1.0, 3.0])
def test_each_axis_has_its_own_braking(braking):
    low = Situation(Ned((0.0, 0.0, -4.0)), Ned((0.0, 0.0, 0.0)))
    floored = replace(OPEN, floor_m=3.0, vertical_braking_m_s2=braking)
    assert settled((0.0, 0.0, 2.0), low, floored)[0].velocity_ned_m_s[2] == pytest.approx(
        1.0 / (0.5 + 1.0 / braking)
    )
    fenced = replace(OPEN, fence_radius_m=3.0, braking_m_s2=braking)
    assert settled((8.0, 0.0, 2.0), HOVER, fenced)[0].velocity_ned_m_s[0] == pytest.approx(
        3.0 / (0.5 + 4.0 / braking)
    )


def test_no_evader_no_stand_off():
    assert (
        settled(
            (8.0, 0.0, 0.0), Situation(Ned((-4.0, 0.0, -2.0)), Ned((0.0, 0.0, 0.0))), ZONE
        ).active
        == ()
    )
