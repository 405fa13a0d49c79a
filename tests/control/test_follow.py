"""Following as a whole: what is not set up passes, and drift is taken out and put back."""

from dataclasses import replace

import pytest

from guidance.autopilots import AUTOPILOTS, PX4
from guidance.control import Situation
from guidance.control.follow import (
    Drift,
    FollowMemory,
    Gaps,
    Pace,
    follow,
    gaps_to_disc,
)
from guidance.frames import STILL, Ned
from guidance.game import StandOff

FAR = Gaps(60.0, 15.0, Ned((1.0, 0.0, 0.0)))
WANTED = Ned((6.0, 0.0, 1.5))


def followed(*given, dt_s, **said):
    return follow(*given, Pace(dt_s, max_speed_ratio=1.1, meeting_m_s=9.0, **said))


def test_a_vehicle_without_a_servo_gets_the_games_velocity_as_it_is():
    plain = replace(PX4.handling, servo=None)
    result = followed(WANTED, Situation(STILL, STILL), FAR, plain, FollowMemory(), dt_s=0.02)
    assert result == (WANTED, None, WANTED, FollowMemory(), STILL, False)


@pytest.mark.parametrize("name", sorted(AUTOPILOTS))
def test_a_drift_that_is_known_shifts_the_command_by_itself(name):
    handling = AUTOPILOTS[name].handling
    drift = Drift(Ned((0.2, -0.1, 0.05)), Ned((0.0, 0.0, -20.0)))
    at = Situation(Ned((0.0, 0.0, -20.0)), STILL)
    plain = followed(WANTED, at, FAR, handling, FollowMemory(), dt_s=0.0)
    shifted = followed(
        WANTED,
        Situation(Ned((0.0, 0.0, -20.0)), drift.velocity_ned_m_s),
        FAR,
        handling,
        FollowMemory(drift=drift),
        dt_s=0.0,
    )
    moved = [
        one - other
        for one, other in zip(shifted.velocity_ned_m_s, plain.velocity_ned_m_s, strict=True)
    ]
    assert moved == pytest.approx(drift.velocity_ned_m_s)
    assert shifted.desired_ned_m_s == pytest.approx(plain.desired_ned_m_s)


def test_what_braking_at_the_disc_costs_is_not_owed():
    handling = PX4.handling
    near = Gaps(0.2, 0.0, Ned((1.0, 0.0, 0.0)))
    motion = Situation(
        Ned((0.0, 0.0, -5.0)), Ned((3.0, 0.0, 0.0)), evader_velocity_ned_m_s=Ned((3.0, 0.0, 0.0))
    )
    memory = FollowMemory(deficit_m=1.0)
    assert followed(WANTED, motion, near, handling, memory, dt_s=0.02).memory.deficit_m == 1.0
    assert followed(WANTED, motion, FAR, handling, memory, dt_s=0.02).memory.deficit_m > 1.0


def test_the_servo_learns_of_what_it_follows_unless_it_is_held_back():
    handling = PX4.handling
    slow = Situation(Ned((0.0, 0.0, -5.0)), Ned((2.0, 1.0, 0.0)))
    begun = followed(WANTED, slow, FAR, handling, FollowMemory(), dt_s=0.1).memory
    free, held = (
        followed(WANTED, slow, FAR, handling, begun, dt_s=0.1, **said).memory.servo.drag_per_s
        for said in ({}, {"held_back": True})
    )
    assert free > held == begun.servo.drag_per_s


@pytest.mark.parametrize("name", sorted(AUTOPILOTS))
@pytest.mark.parametrize("towards", [(0.6, 0.8), (-0.8, 0.6)])
def test_an_evader_of_unknown_velocity_is_at_rest(name, towards):
    handling = AUTOPILOTS[name].handling
    near = Gaps(1.0, 2.0, Ned((*towards, 0.0)))
    unknown = Situation(Ned((0.0, 0.0, -20.0)), Ned((2.0, 1.0, 0.5)))
    still = unknown._replace(evader_velocity_ned_m_s=STILL)
    one, other = (
        followed(WANTED, at, near, handling, FollowMemory(), dt_s=0.02) for at in (unknown, still)
    )
    assert one == other


@pytest.mark.parametrize(
    ("evader", "gaps_m", "towards"),
    [
        ((4.0, 6.0, -3.0), (5.0 - 3.0, 27.0 - 5.0), Ned((0.6, 0.8, 0.0))),
        ((-2.0, 6.0, -40.0), (5.0 - 3.0, -10.0 - 5.0), Ned((-0.6, 0.8, 0.0))),
        ((1.3, 1.6, -30.0), (0.5 - 3.0, -5.0), Ned((0.6, -0.8, 0.0))),
        ((1.0, 2.0, -25.0), (-3.0, 0.0), STILL),  # right below: no direction leads there
    ],
)
def test_gaps_are_to_the_rim_and_to_the_height_and_point_at_the_evader(evader, gaps_m, towards):
    gaps = gaps_to_disc(Ned((1.0, 2.0, -30.0)), Ned(evader), StandOff(3.0, 5.0))
    assert (gaps.ground_m, gaps.height_m) == pytest.approx(gaps_m)
    assert gaps.towards_ned == pytest.approx(towards)
