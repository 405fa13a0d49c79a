"""Lines and rings on a map are cut at the date line, where RFC 7946 asks for it."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.log.date_line import cut_line, cut_ring


def area(ring):
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in itertools.pairwise(ring)) / 2.0


def square(longitude_deg, *, clockwise):
    corners = [(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1), (-0.1, -0.1)]
    ring = [
        (math.remainder(longitude_deg + east_deg, 360.0), 10.0 + north_deg, 5.0)
        for east_deg, north_deg in corners
    ]
    return ring[::-1] if clockwise else ring


def test_a_line_across_the_date_line_has_two_pieces_that_meet_there():
    pieces = cut_line([(179.5, 1.0, 10.0), (179.9, 1.0, 10.0), (-179.7, 2.0, 20.0)])
    expected = [
        [(179.5, 1.0, 10.0), (179.9, 1.0, 10.0), (180.0, 1.25, 12.5)],
        [(-180.0, 1.25, 12.5), (-179.7, 2.0, 20.0)],
    ]
    assert [len(piece) for piece in pieces] == [3, 2]
    assert [place for piece in pieces for place in piece] == [
        pytest.approx(place) for piece in expected for place in piece
    ]


def test_a_line_elsewhere_stays_as_it_is():
    line = [(8.0, 47.0, 400.0), (8.1, 47.0, 401.0)]
    assert cut_line(line) == [line]


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize(
    ("longitude_deg", "count"), [(0.0, 1), (8.0, 1), (180.0, 2), (-179.95, 2), (179.95, 2)]
)
def test_a_ring_keeps_its_area_and_turns_anticlockwise(longitude_deg, count, clockwise):
    pieces = cut_ring(square(longitude_deg, clockwise=clockwise))
    assert len(pieces) == count
    assert sum(map(area, pieces)) == pytest.approx(0.04)
    for piece in pieces:
        assert area(piece) > 0.0
        assert piece[0] == piece[-1]
        assert all(-180.0 <= longitude_deg <= 180.0 for longitude_deg, _, _ in piece)


@given(
    st.lists(st.tuples(st.floats(-179.0, 179.0), st.floats(-80.0, 80.0)), min_size=2, max_size=8),
    st.floats(-180.0, 180.0),
)
def test_a_line_is_as_long_in_pieces_as_whole(steps, start_deg):
    places = [(start_deg, 0.0, 0.0)]
    for east_deg, north_deg in steps:
        longitude_deg = math.remainder(places[-1][0] + east_deg / 2.0, 360.0)
        places.append((longitude_deg, north_deg, 0.0))
    length_deg = sum(abs(math.remainder(b[0] - a[0], 360.0)) for a, b in itertools.pairwise(places))
    pieces = cut_line(places)
    inside = [abs(b[0] - a[0]) for piece in pieces for a, b in itertools.pairwise(piece)]
    assert sum(inside) == pytest.approx(length_deg, abs=1e-9)
    assert all(abs(place[0]) <= 180.0 + 1e-9 for piece in pieces for place in piece)
