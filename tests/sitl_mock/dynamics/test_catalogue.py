"""Parameters set over MAVLink change how the vehicle moves, as they do on the real autopilots."""

import math

import pytest

from sitl_mock.dynamics import CALM, Kind, Setpoint
from sitl_mock.flavours import flavour_named
from sitl_mock.protocols import ParameterStore
from sitl_mock.vector import ZERO


def plant(name, **changed):
    kind = flavour_named(name)
    return kind.plant(ParameterStore(kind.parameters, changed))


def test_angle_max_sets_the_speed_of_arducopter_and_wpnav_speed_does_not(fly, stream):
    vehicle = plant("arducopter", ANGLE_MAX=3000, WPNAV_SPEED=500)
    assert fly(vehicle, stream(25.0), 60.0).mean(0, 55.0, 60.0) == pytest.approx(10.3, abs=0.15)


def test_wpnav_accel_slows_guided(fly, stream):
    quick, slow = (
        fly(plant("arducopter", WPNAV_ACCEL=accel), stream(5.0), 15.0).first(0, 4.5)
        for accel in (250, 100)
    )
    assert slow - quick == pytest.approx(4.5 / 1.0 - 4.5 / 2.5, abs=0.6)


def test_mpc_tiltmax_caps_px4(fly, stream):
    trace = fly(plant("px4", MPC_TILTMAX_AIR=20.0), stream(12.0), 40.0)
    assert trace.mean(0, 35.0, 40.0) == pytest.approx(
        9.80665 * math.tan(math.radians(20.0)), abs=0.05
    )


@pytest.mark.parametrize(
    ("name", "down_m_s", "reached"),
    [("MPC_Z_VEL_MAX_UP", -8.0, -5.0), ("MPC_Z_VEL_MAX_DN", 8.0, 3.0)],
)
def test_vertical_maxima_truncate_px4(fly, stream, name, down_m_s, reached):
    trace = fly(plant("px4", **{name: abs(reached)}), stream(d=down_m_s), 20.0)
    assert trace.mean(2, 18.0, 20.0) == pytest.approx(reached, abs=0.03)


@pytest.mark.parametrize("name", ["px4", "arducopter", "rover"])
def test_every_flavour_has_a_vehicle_that_steps(name):
    vehicle = plant(name)
    motion = vehicle.initial(ZERO, 0.0)
    for _ in range(10):
        motion = vehicle.step(motion, Setpoint(Kind.IDLING), CALM, 0.02)
    assert motion.body.on_ground
