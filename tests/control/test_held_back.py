import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.control import Envelope, Limiter, Situation
from guidance.control.braking_law import RETURN_PER_S, held_back, measure_walls
from guidance.control.polygon import Polygon
from guidance.frames import Ned

PLAIN = {
    "floor_m": 3.0,
    "ceiling_m": 60.0,
    "speed_m_s": 6.0,
    "climb_m_s": 3.0,
    "descent_m_s": 1.5,
    "acceleration_m_s2": 4.0,
    "vertical_acceleration_m_s2": 2.0,
    "jerk_m_s3": 20.0,
    "yaw_rate_rad_s": 1.0,
    "home_ned_m": Ned((10.0, -20.0, 0.0)),
    "fence_margin_m": 1.0,
}
CIRCLE = Envelope(**PLAIN, fence_radius_m=30.0)
SQUARE = Envelope(
    **PLAIN, fence_polygon=Polygon(((-30.0, -30.0), (-30.0, 30.0), (30.0, 30.0), (30.0, -30.0)))
)
speeds = st.floats(-6.0, 6.0)


def at(north, east):
    """A position given about home."""
    return (10.0 + north, -20.0 + east, -12.0)


def kept(velocity, position, envelope):
    return held_back(
        Ned(velocity), measure_walls(Situation(Ned(position), Ned(velocity)), envelope), envelope
    )


@given(speeds, speeds, st.floats(-3.0, 3.0), st.floats(-15.0, 15.0), st.floats(-15.0, 15.0))
def test_far_inside_nothing_is_changed(north, east, down, x, y):
    for envelope in (CIRCLE, SQUARE, Envelope(**PLAIN)):
        assert kept((north, east, down), at(0.3 * x, 0.3 * y), envelope) == (
            north,
            east,
            down,
        )


@pytest.mark.parametrize("envelope", [CIRCLE, SQUARE], ids=["circle", "polygon"])
def test_on_the_margins_line_nothing_leads_out_and_beyond_it_the_way_is_in(envelope):
    assert kept((3.0, 1.0, 0.5), at(29.0, 0.0), envelope) == pytest.approx(
        (0.0, 1.0, 0.5), abs=1e-9
    )
    north, east, _ = kept((3.0, 1.0, 0.5), at(29.6, 0.0), envelope)
    assert (north, east) == pytest.approx((-0.6 * RETURN_PER_S, 1.0), abs=1e-9)


@pytest.mark.parametrize("bearing", [0.0, 0.7, 2.5, -1.9])
@pytest.mark.parametrize("gap_m", [0.2, 0.7, 3.0])
def test_towards_the_circle_exactly_as_fast_as_it_can_brake_whatever_goes_along_it(bearing, gap_m):
    outward = (math.cos(bearing), math.sin(bearing))
    along = (-math.sin(bearing), math.cos(bearing))
    asked = tuple(6.0 * a + 2.0 * b for a, b in zip(outward, along, strict=True))
    north, east, down = kept(
        (*asked, 1.0), at(*((29.0 - gap_m) * part for part in outward)), CIRCLE
    )
    speed = north * outward[0] + east * outward[1]
    assert speed * CIRCLE.reaction_s + speed**2 / (2 * CIRCLE.braking_m_s2) == pytest.approx(gap_m)
    assert (north * along[0] + east * along[1], down) == pytest.approx((2.0, 1.0))


@pytest.mark.parametrize(("north_m", "way_m"), [(0.5, 0.5), (0.0, 1.0), (-0.5, 1.5)])
def test_at_home_and_on_the_way_there_too_a_circle_has_its_law(north_m, way_m):
    small = replace(CIRCLE, fence_radius_m=2.0)
    speed, east, down = kept((6.0, 0.0, 1.0), at(north_m, 0.0), small)
    assert speed * small.reaction_s + speed**2 / (2 * small.braking_m_s2) == pytest.approx(way_m)
    assert (east, down) == (0.0, 1.0)


@pytest.mark.parametrize("asked", [(5.0, -2.0, 3.0), (4.0, 0.5, -1.0), (-2.0, -4.0, 2.0)])
@pytest.mark.parametrize("braking_m_s2", [1.0, 2.0])
def test_the_far_side_is_a_wall_across_the_way_to_the_stop_point(asked, braking_m_s2):
    small = replace(CIRCLE, fence_radius_m=6.0, braking_m_s2=braking_m_s2)
    radius_m = small.fence_radius_m - small.fence_margin_m
    north_m = -1.5
    east_m = 2.0
    stop_s = small.reaction_s + math.hypot(asked[0], asked[1]) / (2.0 * braking_m_s2)
    bearing = math.atan2(east_m + asked[1] * stop_s, north_m + asked[0] * stop_s)
    towards = (math.cos(bearing), math.sin(bearing))
    room_m = radius_m - north_m * towards[0] - east_m * towards[1]
    north, east, down = kept(asked, at(north_m, east_m), small)
    speed = north * towards[0] + east * towards[1]
    assert speed * small.reaction_s + speed**2 / (2.0 * braking_m_s2) == pytest.approx(room_m)
    across = asked[1] * towards[0] - asked[0] * towards[1]
    assert (east * towards[0] - north * towards[1], down) == pytest.approx((across, asked[2]))


@given(speeds, speeds, st.floats(0.0, 2 * math.pi), st.floats(0.0, 60.0))
def test_the_speed_along_the_circle_is_kept(north, east, bearing, distance):
    position = at(distance * math.cos(bearing), distance * math.sin(bearing))
    velocity = kept((north, east, 0.0), position, CIRCLE)
    along = (-math.sin(bearing), math.cos(bearing))
    if distance > 0.01:
        before, after = (v[0] * along[0] + v[1] * along[1] for v in ((north, east), velocity[:2]))
        assert after == pytest.approx(before, abs=1e-6)


def fences(position, envelope):
    walls = measure_walls(Situation(Ned(position), Ned((0.0, 0.0, 0.0))), envelope)
    return [wall for wall in walls if wall.limiter in {Limiter.FENCE_POLYGON, Limiter.FENCE_RADIUS}]


def test_a_fence_itself_lies_beyond_its_wall_by_the_margin():
    for envelope in (CIRCLE, SQUARE):
        for north_m in (29.9, 30.1):
            beyond_m = max(
                -wall.gap_m - wall.margin_m for wall in fences(at(north_m, 0.0), envelope)
            )
            assert beyond_m == pytest.approx(north_m - 30.0)
    both = replace(CIRCLE, fence_polygon=SQUARE.fence_polygon)
    within = {
        wall.limiter: wall.gap_m + wall.margin_m > 0.0 for wall in fences(at(29.0, 29.0), both)
    }
    # In the square's corner
    assert within == {
        Limiter.FENCE_RADIUS: False,
        Limiter.FENCE_POLYGON: True,
    }
    assert fences(at(500.0, 0.0), Envelope(**PLAIN)) == []


@given(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0))
def test_edges_are_measured_along_unit_normals_and_outside_only_the_nearest(x, y):
    edges = [(wall.normal_ned, wall.gap_m + wall.margin_m) for wall in fences(at(x, y), SQUARE)]
    farthest = max(abs(x), abs(y))
    assert all(math.hypot(*normal) == pytest.approx(1.0) for normal, _ in edges)
    nearest = min(abs(gap_m) for _, gap_m in edges)
    beyond = math.hypot(max(abs(x) - 30.0, 0.0), max(abs(y) - 30.0, 0.0))
    assert nearest == pytest.approx(beyond if farthest > 30.0 else 30.0 - farthest, abs=0.011)
    assert len(edges) == 4 if farthest < 30.0 else all(gap_m <= 0.01 for _, gap_m in edges)


@pytest.mark.parametrize(
    ("height_m", "asked_m_s", "kept_m_s"),
    [
        (2.6, 1.0, -0.4 * RETURN_PER_S),
        (3.0, 1.0, 0.0),
        (2.0, -3.0, -3.0),
        (61.0, -1.0, RETURN_PER_S),
        (50.0, 1.0, 1.0),
    ],
)
def test_beyond_floor_and_ceiling_too_the_way_is_back(height_m, asked_m_s, kept_m_s):
    assert kept((0.0, 0.0, asked_m_s), (10.0, -20.0, -height_m), CIRCLE)[2] == pytest.approx(
        kept_m_s
    )
