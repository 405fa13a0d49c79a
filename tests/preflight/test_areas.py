"""Areas of an uploaded fence, compared with another implementation and with points drawn at random."""

import math
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.control.polygon import Polygon
from guidance.preflight.areas import (
    Ring,
    acts_inside,
    circle_sides,
    contains,
    distance_m,
    middles_of,
    ring_of_circle,
    without_repeats,
)

TOUCHING_M = 0.1
numbers = st.floats(-50.0, 50.0)
whole = st.integers(-3, 3).map(float)
places_of = st.one_of(
    st.tuples(
        st.lists(st.tuples(kind, kind), min_size=3, max_size=7),
        st.lists(st.tuples(kind, kind), min_size=1, max_size=9),
    )
    for kind in (numbers, whole)
)


@given(places_of)
def test_inside_and_distance_are_those_of_the_polygon_fence(drawn):
    corners, places = drawn
    ring = Polygon(tuple(corners), unchecked=True)
    if min(math.dist(*edge) for edge in ring.edges()) < 1e-3:
        return
    inside = contains(corners, np.array(places))
    distances = distance_m(corners, np.array(places))
    for place, is_inside, far_m in zip(places, inside, distances, strict=True):
        nearest_m = min(math.dist(place, point) for point in ring.nearest_points(place))
        assert far_m == pytest.approx(nearest_m, abs=1e-6)
        if nearest_m > 1e-6:
            assert is_inside == ring.contains(place)


def test_the_distance_to_an_edge_without_a_length_is_that_to_its_corner():
    assert distance_m([(1.0, 2.0), (1.0, 2.0)], np.array([(4.0, 6.0)])) == pytest.approx([5.0])


def test_the_distance_to_a_short_edge_is_measured_along_it():
    ring = [(0.0, 0.0), (0.0, 0.5), (0.5, 0.0)]
    assert distance_m(ring, np.array([(-1.0, 0.25)])) == pytest.approx([1.0])


def test_a_ray_through_a_corner_counts_it_once():
    ring = [(0.0, -2.0), (1.0, 0.0), (0.0, 2.0), (-1.0, 0.0)]
    places = [(0.0, -3.0), (0.0, 0.0), (0.0, 3.0), (1.0, -3.0), (-1.0, -3.0)]
    assert list(contains(ring, np.array(places))) == [False, True, False, False, False]


SQUARE = ((0.0, 0.0), (0.0, 4.0), (4.0, 4.0), (4.0, 0.0))


@pytest.mark.parametrize(
    ("cutters", "middles"),
    [
        ([SQUARE], {(0.0, 2.0), (2.0, 4.0), (4.0, 2.0), (2.0, 0.0)}),
        (
            [SQUARE, ((1.0, 1.0), (1.0, 2.0), (3.0, 1.5))],
            {(0.0, 2.0), (2.0, 4.0), (4.0, 2.0), (2.0, 0.0)},
        ),
        (
            [((-1.0, 1.0), (-1.0, 1.5), (5.0, 3.0), (5.0, 1.0))],
            {
                (0.0, 0.5), (0.0, 1.375), (0.0, 2.875),
                (2.0, 4.0),
                (4.0, 3.375), (4.0, 1.875), (4.0, 0.5),
                (2.0, 0.0),
            },
        ),
        (
            [((-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0)), ((3.0, 3.0), (3.0, 9.0), (2.0, 9.0))],
            {(0.0, 2.0), (1.416666667, 4.0), (2.916666667, 4.0), (3.5, 4.0), (4.0, 2.0), (2.0, 0.0)},
        ),
    ],
)  # fmt: skip
def test_a_ring_is_cut_where_other_edges_cross_it_and_nowhere_else(cutters, middles):
    cut = [(round(float(n), 9), round(float(e), 9)) for n, e in middles_of(SQUARE, cutters)]
    assert sorted(cut) == sorted(middles)


def test_every_edge_of_a_ring_with_many_is_cut():
    ring = ring_of_circle((0.0, 0.0), 1000.0, larger=False)
    assert len(ring) > 400
    halves = middles_of(ring, [((-2000.0, 0.1), (2000.0, 0.2), (2000.0, 9000.0))])
    assert len(halves) == len(ring) + 2
    assert distance_m(ring, halves).max() < 1e-9


@pytest.mark.parametrize("radius_m", [0.1, 1.0, 30.0, 100.0, 333.0, 1000.0])
def test_a_circles_ring_is_two_centimetres_from_it_and_on_the_asked_side(radius_m):
    centre = (20.0, -30.0)
    inner = ring_of_circle(centre, radius_m, larger=False)
    outer = ring_of_circle(centre, radius_m, larger=True)
    assert len(inner) == len(outer) == circle_sides(radius_m)
    for ring, least_m, most_m in (
        (inner, radius_m - 0.02, radius_m),
        (outer, radius_m, radius_m + 0.021),
    ):
        edges = Polygon(ring, unchecked=True).edges()
        middles = [(0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])) for a, b in edges]
        far_m = [math.dist(centre, point) for point in (*ring, *middles)]
        assert least_m - 1e-9 <= min(far_m) <= max(far_m) <= most_m + 1e-9
    assert inner[0] == (20.0 + radius_m, -30.0)


def test_the_smallest_circle_still_has_a_shape():
    assert circle_sides(1e-3) == 36


def test_the_largest_fence_has_the_most_sides_and_is_still_within_the_tolerance():
    sides = circle_sides(10_000.0)
    assert sides == circle_sides(1e9) == 720
    assert 10_000.0 * (1.0 - math.cos(math.pi / sides)) < TOUCHING_M


def acts_at(areas, place, *, one_is_enough):
    """Whether the autopilot acts at a place, by the definition of areas."""
    inclusions = [inside(area.corners_m, place) for area in areas if area.inclusion]
    if inclusions and not (any(inclusions) if one_is_enough else all(inclusions)):
        return True
    return any(inside(area.corners_m, place) for area in areas if not area.inclusion)


def inside(ring, place):
    return Polygon(ring, unchecked=True).contains(place)


def far_m(ring, place):
    nearest = Polygon(ring, unchecked=True).nearest_points(place)
    return min(math.dist(place, point) for point in nearest)


def drawn_area(draw):
    """A ring around ours, one beside it, or one that crosses itself anywhere."""
    kind = draw.choice(["around", "around", "beside", "crossed"])
    if kind == "crossed":
        ring = tuple((draw.uniform(-15, 15), draw.uniform(-15, 15)) for _ in range(4))
        return Ring(ring, inclusion=draw.random() < 0.5)
    north = 0.0
    east = 0.0
    size_m = draw.uniform(8, 40)
    if kind == "beside":
        north = draw.uniform(-15, 15)
        east = draw.uniform(-15, 15)
        size_m = draw.uniform(1, 5)
    turns = sorted(draw.uniform(0.0, math.tau) for _ in range(draw.randint(5, 9)))
    ring = tuple((north + size_m * math.cos(t), east + size_m * math.sin(t)) for t in turns)
    return Ring(ring, inclusion=kind == "around")


@pytest.mark.parametrize("one_is_enough", [True, False])
def test_an_area_acts_inside_ours_where_a_point_shows_it_and_nowhere_else(one_is_enough):
    draw = random.Random(17)
    answers = {True: 0, False: 0}
    for _ in range(120):
        ours = (ring_of_circle((0.0, 0.0), draw.uniform(4.0, 9.0), larger=False),)
        if draw.random() < 0.5:
            ours += (((-7.0, -6.0), (-7.0, 6.0), (7.0, 8.0), (3.0, -9.0)),)
        areas = tuple(drawn_area(draw) for _ in range(draw.randint(1, 3)))
        point = acts_inside(ours, areas, one_inclusion_is_enough=one_is_enough)
        answers[point is None] += 1
        places = [(draw.uniform(-9.0, 9.0), draw.uniform(-9.0, 9.0)) for _ in range(30)]
        shown = [
            place
            for place in places
            if all(inside(ring, place) and far_m(ring, place) > 0.2 for ring in ours)
            and all(far_m(area.corners_m, place) > 0.2 for area in areas)
            and acts_at(areas, place, one_is_enough=one_is_enough)
        ]
        assert point is not None or shown == []
        if point is not None:
            assert all(
                inside(ring, point) or far_m(ring, point) <= TOUCHING_M + 1e-6 for ring in ours
            )
            around = [
                (point[0] + size * math.cos(turn), point[1] + size * math.sin(turn))
                for size in (0.0, 1e-5, 0.12)
                for turn in np.arange(0.0, math.tau, 0.2)
            ]
            assert any(acts_at(areas, place, one_is_enough=one_is_enough) for place in around)
    assert min(answers.values()) > 20


def test_repeated_corners_go_and_the_order_stays():
    a = (0.0, 0.0)
    b = (0.0, 1.0)
    c = (1.0, 0.0)
    assert without_repeats([a, a, b, b, c, a]) == (a, b, c)
    assert without_repeats([a]) == (a,)
    assert without_repeats([a, a]) == (a,)
    assert without_repeats([a, b, a]) == (a, b)
    assert without_repeats([a, b]) == (a, b)
