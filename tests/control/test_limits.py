"""The `[limits]` section: what it refuses by key, the envelope that it makes, and the tighter of two."""

import math

import pytest
from pydantic import ValidationError

from guidance.autopilots import ARDUCOPTER, PX4
from guidance.control import Envelope, Limits, Speeds
from guidance.control.limits import FARTHEST_FENCE_M, Dynamics, farthest_evader_m
from guidance.control.polygon import Polygon
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.game import StandOff

SPEEDS = Speeds(8.0, 2.0, 1.0)
DYNAMICS = Dynamics(acceleration_m_s2=5.0, vertical_acceleration_m_s2=2.0, jerk_m_s3=20.0)
SQUARE_M = ((-50.0, -50.0), (50.0, -50.0), (50.0, 60.0), (-50.0, 60.0))
SQUARE_DEG = ((47.0, 8.0), (47.001, 8.0), (47.001, 8.001), (47.0, 8.001))


def refusal(**keys):
    """Return why a section is refused."""
    with pytest.raises(ValidationError) as refused:
        Limits(**keys)
    return str(refused.value)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (
            {"floor_m": 10.0, "ceiling_m": 10.0},
            "limits.floor_m = 10: must be below limits.ceiling_m = 10",
        ),
        (
            {"fence_polygon_ne_m": SQUARE_M, "fence_polygon_deg": SQUARE_DEG},
            "limits.fence_polygon_ne_m and limits.fence_polygon_deg: only one polygon is allowed",
        ),
        (
            {"fence_radius_m": None},
            "limits.fence_radius_m: missing; give it or one of limits.fence_polygon_ne_m, limits.",
        ),
        ({"fence_polygon_deg": ()}, "limits.fence_polygon_deg has 0 corners: needs at least 3"),
        (
            {"fence_polygon_deg": SQUARE_DEG[:2]},
            "limits.fence_polygon_deg, in metres about its first corner",
        ),
        (
            {"fence_polygon_deg": ((47.0, 8.0), (47.2, 8.0), (47.2, 8.1))},
            "limits.fence_polygon_deg reaches 23495 m from its first corner: at most 20000 m",
        ),
    ],
)
def test_a_section_is_refused_by_key_and_value(keys, words):
    assert words in refusal(**keys)


@pytest.mark.parametrize(
    "keys",
    [
        {"floor_m": 9.0, "ceiling_m": 10.0},
        {"fence_radius_m": None, "fence_polygon_ne_m": SQUARE_M},
        {"fence_radius_m": None, "fence_polygon_deg": SQUARE_DEG},
        {"fence_radius_m": None, "fence_plan_file": "fence.plan"},
        {"fence_polygon_deg": ((47.0, 8.0), (47.17, 8.0), (47.17, 8.01))},
    ],
)
def test_a_section_with_one_fence_is_taken(keys):
    assert Limits(**keys)
    assert FARTHEST_FENCE_M == 20_000.0


@pytest.mark.parametrize(
    ("keys", "reach_m"),
    [
        ({}, 200.0),
        ({"fence_polygon_ne_m": SQUARE_M}, math.hypot(50.0, 60.0)),
        ({"fence_polygon_ne_m": SQUARE_M, "fence_radius_m": 40.0}, 40.0),
        ({"fence_polygon_ne_m": SQUARE_M, "fence_radius_m": None}, math.hypot(50.0, 60.0)),
        ({"fence_polygon_deg": SQUARE_DEG, "fence_radius_m": None}, math.inf),
        ({"fence_polygon_deg": SQUARE_DEG, "fence_radius_m": 70.0}, 70.0),
    ],
)
def test_the_reach_is_that_of_the_nearer_fence(keys, reach_m):
    limits = Limits(**keys)
    assert limits.reach_m == pytest.approx(reach_m)
    envelope = limits.envelope(SPEEDS, DYNAMICS, StandOff(6.0, 8.0))
    assert envelope.reach_m == pytest.approx(reach_m)


def test_the_envelope_has_the_limits_the_speeds_the_dynamics_and_the_disc_a_metre_smaller():
    limits = Limits(
        floor_m=4.0, ceiling_m=40.0, fence_radius_m=90.0, fence_margin_m=3.0, yaw_rate_deg_s=90.0,
        fence_polygon_ne_m=SQUARE_M,
    )  # fmt: skip
    assert limits.envelope(SPEEDS, DYNAMICS, StandOff(6.0, 4.5)) == Envelope(
        acceleration_m_s2=5.0,
        vertical_acceleration_m_s2=2.0,
        jerk_m_s3=20.0,
        braking_m_s2=DYNAMICS.braking_m_s2,
        vertical_braking_m_s2=DYNAMICS.vertical_braking_m_s2,
        reaction_s=DYNAMICS.reaction_s,
        easing_m_s3=DYNAMICS.easing_m_s3,
        floor_m=4.0,
        ceiling_m=40.0,
        fence_radius_m=90.0,
        fence_margin_m=3.0,
        fence_polygon=Polygon(SQUARE_M),
        speed_m_s=8.0,
        climb_m_s=2.0,
        descent_m_s=1.0,
        yaw_rate_rad_s=math.pi / 2.0,
        floor_margin_m=0.5,
        stand_off=StandOff(5.0, 3.5),
    )


@pytest.mark.parametrize(
    ("disc_height_m", "margin_m"), [(3.0, 0.0), (5.5, 0.5), (6.0, 1.0), (9.0, 1.0)]
)
def test_the_margin_above_the_floor_is_a_metre_where_the_disc_leaves_one(disc_height_m, margin_m):
    envelope = Limits(floor_m=5.0).envelope(SPEEDS, DYNAMICS, StandOff(6.0, disc_height_m))
    assert envelope.floor_margin_m == pytest.approx(margin_m)


def test_a_small_disc_keeps_half_a_metre():
    envelope = Limits().envelope(SPEEDS, DYNAMICS, StandOff(1.2, 1.5))
    assert envelope.stand_off == StandOff(0.5, 0.5)


def test_the_tighter_of_two_is_taken_key_by_key():
    ours = Limits(floor_m=5.0, ceiling_m=60.0, fence_radius_m=100.0, fence_polygon_ne_m=SQUARE_M)
    theirs = Limits(
        floor_m=7.0, ceiling_m=80.0, fence_radius_m=None, fence_polygon_deg=SQUARE_DEG,
        fence_margin_m=4.0, speed_m_s=9.0, yaw_rate_deg_s=30.0,
    )  # fmt: skip
    expected = ours.model_copy(
        update={"floor_m": 7.0, "fence_margin_m": 4.0, "speed_m_s": 9.0, "yaw_rate_deg_s": 30.0}
    )
    assert ours.tighter(theirs) == expected
    assert Limits().tighter(Limits()) == Limits()


@pytest.mark.parametrize("projection", [PX4.projection, ARDUCOPTER.projection])
def test_corners_in_degrees_become_metres_about_home(projection):
    limits = Limits(fence_radius_m=None, fence_polygon_deg=SQUARE_DEG)
    envelope = limits.envelope(SPEEDS, DYNAMICS, StandOff(6.0, 8.0))
    frame = LocalFrame(47.0, 8.0, Amsl(500.0), projection=projection)
    placed = limits.about_home(envelope, Ned((10.0, 0.0, 0.0)), frame)
    corners_m = placed.fence_polygon.corners_ne_m
    assert corners_m[0] == pytest.approx((-10.0, 0.0), abs=0.01)
    assert corners_m[2] == pytest.approx((101.2, 75.9), abs=0.2)
    plain = Limits().envelope(SPEEDS, DYNAMICS, StandOff(6.0, 8.0))
    assert Limits().about_home(plain, Ned((10.0, 0.0, 0.0)), frame) is plain


def test_an_evader_beyond_fence_disc_and_its_way_meanwhile_cannot_be_met():
    far_m = farthest_evader_m(100.0, evader_speed_m_s=3.0, speed_m_s=6.0, standoff_radius_m=7.0)
    assert far_m == 100.0 + 7.0 + 100.0
