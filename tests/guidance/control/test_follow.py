"""Following as a whole: what is not set up passes, and drift is taken out and put back."""

import pytest

from guidance.autopilots import PROFILES
from guidance.control import Envelope
from guidance.control.approach import Gaps
from guidance.control.catch_up import CatchUp
from guidance.control.follow import Drift, Following, FollowMemory, Motion, follow
from guidance.control.handling import HANDLING, handling
from guidance.errors import ConfigError

FAR = Gaps(60.0, 15.0, 1.0, 0.0)
WANTED = (6.0, 0.0, 1.5)
STILL = (0.0, 0.0, 0.0)


def test_a_vehicle_without_a_servo_gets_the_games_velocity_as_it_is():
    followed = follow(WANTED, Motion(STILL, STILL, STILL), FAR, None, FollowMemory(), most=1.1, dt_s=0.02)
    assert followed == (WANTED, None, WANTED, FollowMemory())


@pytest.mark.parametrize("name", sorted(HANDLING))
def test_a_drift_that_is_known_shifts_the_command_by_itself(name):
    following = HANDLING[name].following
    drift = Drift((0.2, -0.1, 0.05), (0.0, 0.0, -20.0))
    at = Motion((0.0, 0.0, -20.0), STILL, STILL)
    plain = follow(WANTED, at, FAR, following, FollowMemory(), most=1.1, dt_s=0.0)
    shifted = follow(
        WANTED,
        Motion((0.0, 0.0, -20.0), drift.velocity_ned_m_s, STILL),
        FAR,
        following,
        FollowMemory(drift=drift),
        most=1.1,
        dt_s=0.0,
    )
    moved = [one - other for one, other in zip(shifted.velocity_ned_m_s, plain.velocity_ned_m_s, strict=True)]
    assert moved == pytest.approx(drift.velocity_ned_m_s)
    assert shifted.wanted_ned_m_s == pytest.approx(plain.wanted_ned_m_s)


def test_what_braking_at_the_disc_costs_is_not_owed():
    following = Following(
        servo=HANDLING["px4"].following.servo, approach=HANDLING["px4"].following.approach, catch_up=CatchUp()
    )
    near = Gaps(0.2, 0.0, 1.0, 0.0)
    motion = Motion((0.0, 0.0, -5.0), (3.0, 0.0, 0.0), (3.0, 0.0, 0.0))
    memory = FollowMemory(owed_m=1.0)
    assert follow(WANTED, motion, near, following, memory, most=1.1, dt_s=0.02).memory.owed_m == 1.0
    assert follow(WANTED, motion, FAR, following, memory, most=1.1, dt_s=0.02).memory.owed_m > 1.0


def test_every_autopilot_has_a_handling_that_its_own_limits_allow():
    assert set(HANDLING) == set(PROFILES)
    for one in HANDLING.values():
        servo, approach = one.following.servo, one.following.approach
        assert servo.acceleration_m_s2 <= one.acceleration_m_s2
        assert servo.vertical_acceleration_m_s2 <= one.vertical_acceleration_m_s2
        assert servo.jerk_m_s3 <= one.jerk_m_s3
        assert approach.braking_m_s2 <= servo.acceleration_m_s2
        assert approach.vertical_braking_m_s2 <= servo.vertical_acceleration_m_s2
        Envelope(
            floor_m=3.0,
            ceiling_m=100.0,
            speed_m_s=9.0,
            climb_m_s=3.0,
            descent_m_s=1.5,
            acceleration_m_s2=one.acceleration_m_s2,
            vertical_acceleration_m_s2=one.vertical_acceleration_m_s2,
            jerk_m_s3=one.jerk_m_s3,
            yaw_rate_rad_s=0.8,
            braking_m_s2=one.braking_m_s2,
            vertical_braking_m_s2=one.vertical_braking_m_s2,
            reaction_s=one.reaction_s,
        )


def test_an_autopilot_without_a_handling_is_refused_by_name():
    with pytest.raises(ConfigError, match=r"autopilot = 'rover': allowed are px4, arducopter"):
        handling("rover")
