"""The rover drives where its nose points."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl_mock.dynamics import CALM, Kind, Rover, Setpoint, Surroundings, rover
from sitl_mock.vector import ZERO, Vector

GROUND = Surroundings()


def drive(fly, order, seconds, *, yaw_rad=0.0, vehicle=None):
    vehicle = vehicle or rover()
    return fly(vehicle, order, seconds, motion=vehicle.initial(ZERO, yaw_rad), around=GROUND)


def test_it_accelerates_to_the_commanded_velocity_at_its_limit(fly, stream):
    trace = drive(fly, stream(3.0), 6.0)
    assert trace.at(1.0, 0) == pytest.approx(2.0, abs=0.05)
    assert trace.velocity[-1] == pytest.approx([3.0, 0.0, 0.0], abs=1e-6)


def test_it_does_not_exceed_its_speed(fly, stream):
    trace = drive(fly, stream(30.0, 40.0), 15.0, vehicle=Rover(speed_max_m_s=4.0))
    assert np.linalg.norm(trace.velocity, axis=1).max() <= 4.0 + 1e-9
    assert trace.velocity[-1] == pytest.approx([2.4, 3.2, 0.0], abs=0.01)


def test_it_turns_on_the_spot_before_it_drives_back(fly, stream):
    trace = drive(fly, stream(-3.0, 0.01), 6.0)
    assert trace.position[:, 0].max() < 0.01
    assert trace.velocity[-1, 0] == pytest.approx(-3.0, abs=0.01)


@given(n=st.floats(-9.0, 9.0), e=st.floats(-9.0, 9.0), d=st.floats(-5.0, 5.0))
def test_it_never_slides_sideways_nor_leaves_the_ground(n, e, d):
    vehicle = rover()
    motion = vehicle.initial(ZERO, 0.7)
    order = Setpoint(Kind.STREAM, velocity_ned_m_s=Vector((n, e, d)))
    for _ in range(150):
        motion = vehicle.step(motion, order, CALM, 0.02)
        v_n, v_e, v_d = motion.body.velocity_ned_m_s
        yaw = motion.body.yaw_rad
        assert v_n * -math.sin(yaw) + v_e * math.cos(yaw) == pytest.approx(0.0, abs=1e-9)
        assert (motion.body.position_ned_m[2], v_d) == (0.0, 0.0)


def test_it_drives_to_a_place_and_stops_there(fly):
    trace = drive(
        fly,
        Setpoint(Kind.TRAVEL, position_ned_m=Vector((20.0, -15.0, math.nan)), speed_m_s=3.0),
        40.0,
    )
    assert np.hypot(*(trace.position[-1, :2] - [20.0, -15.0])) < 0.5
    assert np.linalg.norm(trace.velocity, axis=1).max() <= 3.0 + 1e-9
    assert np.linalg.norm(trace.velocity[-1]) < 1e-6


@pytest.mark.parametrize("kind", [Kind.STOPPED, Kind.IDLING, Kind.BRAKE])
def test_it_stops_at_its_braking_limit(fly, stream, kind):
    vehicle = rover()
    moving = drive(fly, stream(4.0), 6.0).motion
    trace = fly(vehicle, Setpoint(kind), 4.0, motion=moving, around=GROUND)
    assert trace.position[-1, 0] - moving.body.position_ned_m[0] == pytest.approx(
        4.0**2 / (2 * 2.0), abs=0.1
    )
    assert np.linalg.norm(trace.velocity[-1]) == 0.0


def test_a_yaw_and_a_yaw_rate_turn_it_on_the_spot(fly, stream):
    assert drive(fly, stream(yaw_rad=1.0), 4.0).motion.body.yaw_rad == pytest.approx(1.0, abs=0.01)
    spun = drive(fly, stream(yaw_rate_rad_s=0.3), 5.0).motion.body
    assert spun.yaw_rad == pytest.approx(1.5, abs=0.1)
    assert spun.position_ned_m == (0.0, 0.0, 0.0)


def test_it_cannot_start_in_the_air():
    with pytest.raises(ValueError, match="cannot start in the air"):
        rover().initial(Vector((0.0, 0.0, -5.0)), 0.0, flying=True)
