"""The polygon fence: its limit on corners, and the check that its edges do not cross."""

import math
import random
from itertools import combinations, product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.autopilots import PX4
from guidance.control import Limits, Speeds, polygon
from guidance.control.polygon import MOST_CORNERS, Polygon, crossing_edges
from guidance.errors import ConfigError
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.game import StandOff


def star(count):
    """A simple polygon whose corners lie on two circles in turn."""
    return tuple(
        ((100 + 30 * (n % 2)) * math.cos(math.tau * n / count), (100 + 30 * (n % 2)) * math.sin(math.tau * n / count))
        for n in range(count)
    )  # fmt: skip


def turn(a, b, c):
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def on(a, b, point):
    inside = all(min(a[k], b[k]) <= point[k] <= max(a[k], b[k]) for k in (0, 1))
    return inside and turn(a, b, point) == 0


def meet_by_definition(first, second, *, neighbours):
    """Two segments share a point; neighbours another one than their corner."""
    a, b = first
    c, d = second
    shared = {a, b} & {c, d} if neighbours else set()
    ends = ((first, c), (first, d), (second, a), (second, b))
    if len(shared) == 2 or any(on(*line, end) for line, end in ends if end not in shared):
        return True
    return turn(a, b, c) * turn(a, b, d) < 0 and turn(c, d, a) * turn(c, d, b) < 0


def test_any_two_edges_meet_where_they_share_a_point():
    points = list(product(range(3), repeat=2))
    for a, b, c, d in product(points, repeat=4):
        if a != b and c != d:
            met = polygon.edges_meet((a, b), (c, d), neighbours=False)
            assert met is meet_by_definition((a, b), (c, d), neighbours=False)
        if a != b == c != d:
            met = polygon.edges_meet((a, b), (c, d), neighbours=True)
            assert met is meet_by_definition((a, b), (c, d), neighbours=True)


def test_no_crossing_is_missed_and_none_is_made_up():
    draw = random.Random(45)
    points = [(north / 8, east / 8) for north, east in product(range(6), repeat=2)]
    simple = 0
    for _ in range(800):
        corners = draw.choices(points, k=draw.randint(3, 8))
        edges = list(zip(corners, [*corners[1:], corners[0]], strict=True))
        if any(one == other for one, other in edges):
            continue
        pairs = {
            (i, j)
            for i, j in combinations(range(len(edges)), 2)
            if meet_by_definition(edges[i], edges[j], neighbours=j - i in (1, len(edges) - 1))
        }
        assert crossing_edges(edges) in (pairs or {None})
        simple += not pairs
    assert simple > 50


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        (((0.0, 0.0), (1.0, 0.0)), "fence_polygon has 2 corners: needs at least 3"),
        (
            ((0.0, 0.0), (1.0, 0.0), (math.nan, 1.0)),
            r"corner \(nan, 1.0\): must be two finite numbers",
        ),
        (
            ((0.0, 0.0), (0.0, 0.009), (1.0, 0.0)),
            r"edge 0 \(\(0.0, 0.0\), \(0.0, 0.009\)\) is shorter than 0.01 m: omit it",
        ),
        (
            ((0.0, 0.0), (0.0, 4.0), (-1.0, 4.0), (3.0, 1.0), (-1.0, 1.0)),
            "edges 0 and 2 cross or touch",
        ),
        # To a corner and straight back
        (((0.0, 0.0), (4.0, 0.0), (0.0, 0.0), (0.0, 4.0)), "edges 0 and 1 cross or touch"),
    ],
)
def test_a_polygon_that_is_none_is_refused_in_words(corners, words):
    with pytest.raises(ConfigError, match=words):
        Polygon(corners)


def test_an_edge_of_a_centimetre_is_long_enough():
    assert len(Polygon(((0.0, 0.0), (0.0, 0.01), (1.0, 0.0))).edges()) == 3


coordinates = st.floats(-100.0, 100.0)


@given(st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=3))
def test_an_edge_points_out_of_the_polygon_by_its_unit_normal(corners):
    if min(math.dist(a, b) for a, b in combinations(corners, 2)) < 1.0:
        return
    if abs(turn(*corners)) < 10.0:
        return
    triangle = Polygon(tuple(corners))
    for index, ((north1, east1), (north2, east2)) in enumerate(triangle.edges()):
        north, east = triangle.outward(index)
        assert math.hypot(north, east) == pytest.approx(1.0)
        across = north * (north2 - north1) + east * (east2 - east1)
        assert across == pytest.approx(0.0, abs=1e-9)
        middle = (0.5 * (north1 + north2), 0.5 * (east1 + east2))
        assert not triangle.contains((middle[0] + 1e-3 * north, middle[1] + 1e-3 * east))
        assert triangle.contains((middle[0] - 1e-3 * north, middle[1] - 1e-3 * east))


@given(st.floats(-8, 8), st.floats(-8, 8), st.booleans())
def test_inside_and_nearest_edge_of_a_square_are_what_they_look_like(north, east, clockwise):
    corners = ((-5.0, -5.0), (5.0, -5.0), (5.0, 5.0), (-5.0, 5.0))
    square = Polygon(corners if clockwise else corners[::-1])
    if max(abs(north), abs(east)) != 5.0:
        assert square.contains((north, east)) == (max(abs(north), abs(east)) < 5.0)
    nearest = min(math.dist((north, east), point) for point in square.nearest_points((north, east)))
    outside = math.hypot(max(0.0, abs(north) - 5.0), max(0.0, abs(east) - 5.0))
    assert nearest == pytest.approx(outside or 5.0 - max(abs(north), abs(east)))


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


def comparisons(monkeypatch, count):
    """The number of pairs of edges that are compared."""
    compared = []
    meet = polygon.edges_meet

    def counted(edge, other, *, neighbours):
        compared.append((edge, other))
        return meet(edge, other, neighbours=neighbours)

    monkeypatch.setattr(polygon, "edges_meet", counted)
    Polygon(star(count))
    monkeypatch.undo()
    return len(compared)


def test_the_check_compares_each_edge_with_a_few_others(monkeypatch):
    few = comparisons(monkeypatch, 100)
    assert few <= 250
    assert comparisons(monkeypatch, 200) <= 2.2 * few


def test_the_number_of_corners_has_a_limit():
    assert len(Polygon(star(MOST_CORNERS)).edges()) == MOST_CORNERS
    with pytest.raises(ConfigError, match="has 202 corners: at most 200 are allowed"):
        Polygon(star(MOST_CORNERS + 2))


def test_a_new_home_in_flight_does_not_check_the_polygon_again(monkeypatch):
    frame = LocalFrame(47.397742, 8.545594, Amsl(488.0), Amsl(488.0), projection=PX4.projection)
    corners = tuple(frame.wgs84_from_ned(Ned((*corner, 0.0)))[:2] for corner in star(MOST_CORNERS))
    limits = Limits(fence_polygon_deg=corners)
    envelope = limits.envelope(Speeds(6.0, 2.0, 1.5), PX4.handling.dynamics, StandOff(8.0, 10.0))

    def never(_):
        raise AssertionError("the crossing check must not run in a cycle")

    monkeypatch.setattr(polygon, "crossing_edges", never)
    fenced = limits.about_home(envelope, Ned((3.0, 4.0, 0.0)), frame)
    for place, (north, east) in zip(
        fenced.fence_polygon.corners_ne_m, star(MOST_CORNERS), strict=True
    ):
        assert place == pytest.approx((north - 3.0, east - 4.0), abs=1e-3)
