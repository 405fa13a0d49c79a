"""The polygon fence: its limit on corners, and the check that its edges do not cross."""

import math
from itertools import combinations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.autopilots import PX4
from guidance.control import Limits, Speeds, polygon
from guidance.control.polygon import MOST_CORNERS, Polygon, crossing_edges
from guidance.errors import ConfigError
from guidance.frames import Amsl, LocalFrame
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
    if any(on(*line, end) for line, end in ends if end not in shared):
        return True
    return turn(a, b, c) * turn(a, b, d) < 0 and turn(c, d, a) * turn(c, d, b) < 0


corner = st.tuples(st.integers(0, 6), st.integers(0, 6))


@given(st.lists(corner, min_size=3, max_size=9, unique=True))
def test_the_sweep_agrees_with_the_comparison_of_all_pairs(corners):
    edges = list(zip(corners, [*corners[1:], corners[0]], strict=True))
    pairs = [
        (i, j)
        for i, j in combinations(range(len(edges)), 2)
        if meet_by_definition(edges[i], edges[j], neighbours=j - i in (1, len(edges) - 1))
    ]
    crossing = crossing_edges(edges)
    assert (crossing is None) is (pairs == [])
    assert crossing is None or crossing in pairs


def comparisons(monkeypatch, count):
    """The number of pairs of edges that are compared."""
    compared = []
    meet = polygon._meet

    def counted(edge, other, *, neighbours):
        compared.append((edge, other))
        return meet(edge, other, neighbours=neighbours)

    monkeypatch.setattr(polygon, "_meet", counted)
    Polygon(star(count))
    monkeypatch.undo()
    return len(compared)


def test_the_check_compares_each_edge_with_a_few_others(monkeypatch):
    few = comparisons(monkeypatch, 100)
    assert few <= 300
    assert comparisons(monkeypatch, 200) <= 2.2 * few


def test_the_number_of_corners_has_a_limit():
    assert len(Polygon(star(MOST_CORNERS)).edges()) == MOST_CORNERS
    with pytest.raises(ConfigError, match="has 202 corners: at most 200 are allowed"):
        Polygon(star(MOST_CORNERS + 2))


def test_a_new_home_in_flight_does_not_check_the_polygon_again(monkeypatch):
    frame = LocalFrame(47.397742, 8.545594, Amsl(488.0), Amsl(488.0), projection=PX4.projection)
    corners = tuple(frame.wgs84_from_ned((*corner, 0.0))[:2] for corner in star(MOST_CORNERS))
    limits = Limits(fence_polygon_deg=corners)
    envelope = limits.envelope(Speeds(6.0, 2.0, 1.5), PX4.handling.dynamics, StandOff(8.0, 10.0))

    def never(_):
        raise AssertionError("the crossing check must not run in a cycle")

    monkeypatch.setattr(polygon, "crossing_edges", never)
    fenced = limits.about_home(envelope, (3.0, 4.0, 0.0), frame)
    assert len(fenced.fence_polygon.corners_ne_m) == MOST_CORNERS
