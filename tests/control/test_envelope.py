"""Limits: an envelope or a polygon that is none is refused by name, and a polygon is what it looks like."""

import math
from dataclasses import fields, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.control import Envelope, Limits, Situation, Speeds
from guidance.control.polygon import Polygon
from guidance.errors import ConfigError
from guidance.frames import Ned
from tests.control.scenes import OPEN


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
        ({"floor_m": 30.0, "ceiling_m": 30.0}, "floor_m = 30.0: must be below ceiling_m = 30.0"),
        ({"floor_m": math.nan}, "floor_m = nan"),
        ({"ceiling_m": math.inf}, "ceiling_m = inf"),
        ({"floor_m": -math.inf}, "floor_m = -inf"),
        ({"fence_margin_m": -1.0}, "fence_margin_m = -1.0"),
        ({"fence_margin_m": 5.0, "fence_radius_m": 5.0}, "fence_margin_m = 5.0"),
    ],
)
def test_limits_that_contradict_each_other_are_refused_by_name(values, words):
    with pytest.raises(ConfigError, match=words):
        replace(OPEN, **values)


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        (((0.0, 0.0), (1.0, 0.0)), "2 corners"),
        (((0.0, 0.0), (1.0, 0.0), (math.nan, 1.0)), "finite"),
        (((0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (0.0, 1.0)), "edge 1 .* shorter"),
        (((0.0, 0.0), (10.0, 10.0), (10.0, 0.0), (0.0, 10.0)), "edges 0 and 2 cross"),
        (((0.0, 0.0), (10.0, 0.0), (5.0, 0.0)), "edges 0 and 1 cross"),
        (((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (5.0, 0.0), (0.0, 10.0)), "edges 0 and 2 cross"),
        (
            (
                (0.0, 0.0),
                (10.0, 0.0),
                (10.0, 5.0),
                (20.0, 5.0),
                (20.0, 0.0),
                (5.0, 0.0),
                (5.0, -5.0),
            ),
            "cross or touch",
        ),
    ],
)
def test_a_polygon_that_is_none_is_refused(corners, words):
    with pytest.raises(ConfigError, match=words):
        Polygon(corners)


def test_an_envelope_says_for_itself_how_the_vehicle_brakes_and_nothing_of_fences():
    said = {
        "floor_m": 3.0,
        "ceiling_m": 40.0,
        "speed_m_s": 8.0,
        "climb_m_s": 3.0,
        "descent_m_s": 1.5,
        "acceleration_m_s2": 4.0,
        "vertical_acceleration_m_s2": 2.0,
        "jerk_m_s3": 20.0,
        "yaw_rate_rad_s": 1.0,
    }
    cautious = {
        "braking_m_s2": 2.0,
        "vertical_braking_m_s2": 1.0,
        "reaction_s": 0.6,
        "easing_m_s3": 30.0,
        "home_ned_m": (0.0, 0.0, 0.0),
        "fence_radius_m": None,
        "fence_polygon": None,
        "fence_margin_m": 0.0,
        "floor_margin_m": 0.0,
        "stand_off": None,
    }
    envelope = Envelope(**said)
    assert {
        field.name: getattr(envelope, field.name) for field in fields(envelope)
    } == said | cautious


@pytest.mark.parametrize("size", [0.5, 30.0])
@pytest.mark.parametrize("first", range(4))
@pytest.mark.parametrize("along", [(1, 0), (0, 1), (3, 4), (-3, 4), (-3, -4), (5, -1)])
def test_a_spike_that_folds_back_is_refused_and_a_sharp_one_is_not(along, first, size):
    # Integers are exact: the fold lies on its own edge to the last bit, whichever corner comes first.
    tip = (8 * along[0], 8 * along[1])
    back = (4 * along[0], 4 * along[1])
    aside = (2 * along[0] - along[1], 2 * along[1] + along[0])

    def placed(*corners):
        scaled = [(size * north + 2.0, size * east - 7.0) for north, east in corners]
        return tuple(scaled[first:] + scaled[:first])

    with pytest.raises(ConfigError, match="cross or touch"):
        Polygon(placed((0, 0), tip, back, aside))
    straight = Polygon(placed((0, 0), back, tip, aside))  # three corners in a row on one line
    assert len(straight.edges()) == 4


@pytest.mark.parametrize("size", [0.05, 1.0, 400.0])
def test_a_bow_tie_of_any_size_is_refused(size):
    with pytest.raises(ConfigError, match="edges 0 and 2 cross"):
        Polygon(((0.0, 0.0), (size, size), (size, 0.0), (0.0, size)))


def test_a_corner_beside_a_slanting_edge_does_not_touch_it():
    # (4, 5) lies within the box about the edge from (0, 0) to (10, 10), and not on it.
    arrow = Polygon(((0.0, 0.0), (10.0, 10.0), (4.0, 5.0), (5.0, 20.0), (-1.0, 20.0)))
    assert arrow.contains((3.0, 15.0))


TOUCHING = [
    ((0.0, 0.0), (10.0, 10.0), (5.0, 5.0)),  # an edge folded back on another one
    ((0.0, 0.0), (5.0, 5.0), (9.0, 2.0), (10.0, 10.0), (7.0, 7.0)),  # a corner on an edge, aslant
    ((0.0, 0.0), (4.0, 8.0), (2.0, 4.0), (6.0, 0.0)),
    ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (5.0, 0.0), (0.0, 10.0)),  # a corner on an edge
    (
        (0.0, 0.0),
        (10.0, 0.0),
        (10.0, 5.0),
        (20.0, 5.0),
        (20.0, 0.0),
        (5.0, 0.0),
        (5.0, -5.0),
    ),  # edges on one line
    (
        (0.0, 0.0),
        (8.0, 0.0),
        (8.0, 8.0),
        (0.0, 0.0),
        (-8.0, 8.0),
        (-8.0, 0.0),
    ),  # two corners in one place
    ((0.0, 0.0), (10.0, 10.0), (10.0, 0.0), (0.0, 10.0)),  # a bow tie
]
APART = (
    (0.0, 0.0),
    (10.0, 0.0),
    (10.0, 10.0),
    (7.0, 10.0),
    (7.0, 5.0),
    (3.0, 5.0),
    (3.0, 10.0),
    (0.0, 10.0),
)


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("reverse", [False, True])
def test_touching_edges_are_found_in_any_direction_and_collinear_ones_may_be_apart(
    turn, mirrored, reverse
):
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


@pytest.mark.parametrize("clockwise", [True, False])
def test_a_point_as_far_north_as_a_corner_is_inside_or_outside_all_the_same(clockwise):
    corners = ((-5.0, 0.0), (0.0, 5.0), (5.0, 0.0), (0.0, -5.0))
    diamond = Polygon(corners if clockwise else corners[::-1])
    found = [
        diamond.contains((north, east))
        for north in (-5.0, 0.0, 5.0)
        for east in (-6.0, -1.0, 1.0, 6.0)
    ]
    assert found == [False] * 4 + [False, True, True, False] + [False] * 4


@settings(deadline=None)
@given(st.floats(-12, 12), st.floats(-12, 12), st.floats(0.0, 6.0), st.booleans())
def test_inside_is_where_the_polygon_winds_about_the_point(north, east, angle, clockwise):
    # A star with slanting edges; the turns about the point are summed as angles, which owes nothing to any ray.
    corners = []
    for index in range(10):
        radius = (10.0, 4.0)[index % 2]
        bearing = angle + index * math.tau / 10.0
        corners.append((radius * math.cos(bearing), radius * math.sin(bearing)))
    star = Polygon(tuple(corners if clockwise else corners[::-1]))
    turned = 0.0
    for one, other in star.edges():
        before = math.atan2(one[1] - east, one[0] - north)
        turned += math.remainder(math.atan2(other[1] - east, other[0] - north) - before, math.tau)
    if min(math.dist(point, (north, east)) for point in star.nearest_points((north, east))) > 1e-6:
        assert star.contains((north, east)) == (round(turned / math.tau) != 0)


@settings(deadline=None)
@given(st.floats(0.0, 6.0), st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.booleans())
def test_outward_is_away_from_the_inside_wherever_the_polygon_lies(angle, north, east, clockwise):
    corners = []
    for index in range(10):
        radius = (10.0, 4.0)[index % 2]
        bearing = angle + index * math.tau / 10.0
        corners.append((north + radius * math.cos(bearing), east + radius * math.sin(bearing)))
    star = Polygon(tuple(corners if clockwise else corners[::-1]))
    for index, (one, other) in enumerate(star.edges()):
        outward = star.outward(index)
        assert math.hypot(*outward) == pytest.approx(1.0)
        middle = ((one[0] + other[0]) / 2.0, (one[1] + other[1]) / 2.0)
        assert not star.contains((middle[0] + 1e-3 * outward[0], middle[1] + 1e-3 * outward[1]))
        assert star.contains((middle[0] - 1e-3 * outward[0], middle[1] - 1e-3 * outward[1]))


def test_speed_limits_are_from_the_file_or_10_percent_above_the_game_speed():
    game = Speeds(6.0, 3.0, 1.5)
    assert Limits().speeds(game, section="game") == pytest.approx((6.6, 3.3, 1.65))
    given_one = Limits(speed_m_s=7.0, climb_m_s=3.0).speeds(game, section="game")
    assert given_one == pytest.approx((7.0, 3.0, 1.65))  # as fast as the game is enough
    largest = {"speed_m_s": 33.0, "climb_m_s": 11.0, "descent_m_s": 11.0}
    assert Limits(**largest).speeds(game, section="game") == tuple(largest.values())
    for name, value in largest.items():
        for wrong in (0.0, value + 0.5):
            with pytest.raises(ValueError, match=name):
                Limits(**{name: wrong})
    assert Limits(speed_m_s=0.5).speeds(Speeds(0.4, 3.0, 1.5), section="game").speed_m_s == 0.5
    words = r"^limits\.descent_m_s = 1\.4: must be at least own\.descent_m_s = 1\.5, "
    with pytest.raises(ValueError, match=words):
        Limits(descent_m_s=1.4).speeds(game, section="own")


def test_a_situation_with_position_and_velocity_only_assumes_no_other_motion():
    still = (0.0, 0.0, 0.0)
    assert Situation(Ned((1.0, 2.0, 3.0)), Ned(still)) == (
        (1.0, 2.0, 3.0),
        still,
        0.0,
        None,
        None,
        still,
        0.0,
    )
