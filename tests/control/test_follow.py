"""Following as a whole: what is not set up passes, and drift is taken out and put back."""

import pytest

from guidance.autopilots import AUTOPILOTS, PX4
from guidance.control.envelope import Situation
from guidance.control.follow import CatchUp, Drift, Following, FollowMemory, Gaps, follow

FAR = Gaps(60.0, 15.0, 1.0, 0.0)
WANTED = (6.0, 0.0, 1.5)
STILL = (0.0, 0.0, 0.0)


def test_a_vehicle_without_a_servo_gets_the_games_velocity_as_it_is():
    followed = follow(WANTED, Situation(STILL, STILL), FAR, None, FollowMemory(), most=1.1, dt_s=0.02)
    assert followed == (WANTED, None, WANTED, FollowMemory())


@pytest.mark.parametrize("name", sorted(AUTOPILOTS))
def test_a_drift_that_is_known_shifts_the_command_by_itself(name):
    following = AUTOPILOTS[name].handling.following
    drift = Drift((0.2, -0.1, 0.05), (0.0, 0.0, -20.0))
    at = Situation((0.0, 0.0, -20.0), STILL)
    plain = follow(WANTED, at, FAR, following, FollowMemory(), most=1.1, dt_s=0.0)
    shifted = follow(
        WANTED,
        Situation((0.0, 0.0, -20.0), drift.velocity_ned_m_s),
        FAR,
        following,
        FollowMemory(drift=drift),
        most=1.1,
        dt_s=0.0,
    )
    moved = [one - other for one, other in zip(shifted.velocity_ned_m_s, plain.velocity_ned_m_s, strict=True)]
    assert moved == pytest.approx(drift.velocity_ned_m_s)
    assert shifted.desired_ned_m_s == pytest.approx(plain.desired_ned_m_s)


def test_what_braking_at_the_disc_costs_is_not_owed():
    following = Following(
        servo=PX4.handling.following.servo, approach=PX4.handling.following.approach, catch_up=CatchUp()
    )
    near = Gaps(0.2, 0.0, 1.0, 0.0)
    motion = Situation((0.0, 0.0, -5.0), (3.0, 0.0, 0.0), evader_velocity_ned_m_s=(3.0, 0.0, 0.0))
    memory = FollowMemory(deficit_m=1.0)
    assert follow(WANTED, motion, near, following, memory, most=1.1, dt_s=0.02).memory.deficit_m == 1.0
    assert follow(WANTED, motion, FAR, following, memory, most=1.1, dt_s=0.02).memory.deficit_m > 1.0
