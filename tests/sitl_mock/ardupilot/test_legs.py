"""AUTO's legs, against what ArduCopter 4.5.7 flew."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl_mock.ardupilot.legs import Rise, curve
from sitl_mock.vector import ZERO, Vector

WPNAV = {
    "WPNAV_SPEED": 1000.0,
    "WPNAV_SPEED_UP": 250.0,
    "WPNAV_SPEED_DN": 150.0,
    "WPNAV_ACCEL": 250.0,
    "WPNAV_ACCEL_Z": 100.0,
    "WPNAV_JERK": 1.0,
}


@pytest.mark.parametrize(
    ("goal", "real_m_s"),
    [
        ((30.0, 0.0, 0.0), 5.57),
        ((0.0, 20.0, -5.0), 4.45),
        ((-30.0, 0.0, 5.0), 5.58),
        ((0.0, -20.0, 0.0), 4.31),
    ],
)
def test_a_leg_is_as_fast_in_its_middle_as_the_real_one_was(goal, real_m_s):
    leg = curve(ZERO, Vector(goal), 0.0, math.nan, WPNAV)
    assert leg.along(leg.end_s / 2.0).speed_m_s == pytest.approx(real_m_s, rel=0.03)


@given(
    length_m=st.floats(0.01, 2000.0),
    climb=st.floats(-1.0, 1.0),
    speed_m_s=st.one_of(st.just(math.nan), st.floats(0.3, 20.0)),
    share=st.floats(0.0, 1.0),
)
def test_a_leg_begins_and_ends_at_rest_within_its_limits_and_is_its_own_integral(
    length_m, climb, speed_m_s, share
):
    goal = (length_m * math.sqrt(1.0 - climb * climb), 0.0, length_m * climb)
    leg = curve(ZERO, Vector(goal), 5.0, speed_m_s, WPNAV)
    assert leg.along(5.0) == (0.0, 0.0, 0.0)
    assert leg.along(leg.end_s) == (pytest.approx(leg.length_m), 0.0, 0.0)
    at_s = 5.0 + share * (leg.end_s - 5.0)
    step_s = 1e-4 * (leg.end_s - 5.0)
    before, now, after = (leg.along(at_s + k * step_s) for k in (-1, 0, 1))
    slack = 0.9 * step_s + 1e-6
    assert (after.distance_m - before.distance_m) / (2.0 * step_s) == pytest.approx(
        now.speed_m_s, abs=5.0 * slack
    )
    assert (after.speed_m_s - before.speed_m_s) / (2.0 * step_s) == pytest.approx(
        now.accel_m_s2, abs=slack
    )
    level = abs(leg.direction[0])
    high = abs(leg.direction[2])
    cruise = speed_m_s if speed_m_s > 0.0 else 10.0
    assert now.speed_m_s * level <= cruise + 1e-6
    assert now.speed_m_s * high <= (2.5 if climb < 0.0 else 1.5) + 1e-6
    assert abs(now.accel_m_s2) * level <= 2.5 + 1e-6
    assert abs(now.accel_m_s2) * high <= 1.0 + 1e-6


def test_a_rise_whose_acceleration_is_limited_has_a_level_part():
    rise = Rise(speed_m_s=8.0, accel_m_s2=2.0, jerk_m_s3=1.0)
    assert rise.lasts_s == pytest.approx(6.0)
    assert rise.at(3.0)[1:] == pytest.approx((4.0, 2.0))
    assert rise.at(6.0).distance_m == pytest.approx(24.0)
