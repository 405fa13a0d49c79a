"""The body alone: closed forms of falling, tilting, drag and the ground."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sitl_mock.dynamics import (
    CALM,
    PX4_AIRFRAME,
    Kind,
    Setpoint,
    Surroundings,
    arducopter_quadrotor,
    attitude_of,
    px4_quadrotor,
)
from sitl_mock.dynamics.multicopter import body_at, step_body
from sitl_mock.dynamics.values import GRAVITY_M_S2, Demand
from sitl_mock.vector import ZERO, Vector
from tests.harness.examples import drawn

VEHICLES = {"px4": px4_quadrotor, "arducopter": arducopter_quadrotor}
every_copter = pytest.mark.parametrize("make", VEHICLES.values(), ids=VEHICLES.keys())


def test_without_motors_it_falls_by_the_closed_form_of_linear_drag(fly):
    vehicle = px4_quadrotor()
    motion = vehicle.initial(Vector((0.0, 0.0, -500.0)), 0.0, flying=True)
    trace = fly(vehicle, Setpoint(Kind.STOPPED), 4.0, motion=motion, dt_s=0.01)
    drag = PX4_AIRFRAME.drag_1_s
    spun_down_s = PX4_AIRFRAME.rotor_lag_s
    closed = GRAVITY_M_S2 / drag * (1.0 - np.exp(-drag * (trace.time_s - spun_down_s)))
    after = trace.time_s > 0.5
    assert trace.velocity[after, 2] == pytest.approx(closed[after], abs=0.06)


def test_a_steady_lean_reaches_the_speed_where_drag_balances_it():
    frame = dataclasses.replace(PX4_AIRFRAME, drag_1_s=0.3, drag_1_m=0.05)
    lean = 0.4
    body = body_at(Vector((0.0, 0.0, -50.0)), 0.0, on_ground=False)
    high = CALM._replace(ground_down_m=1e6)
    for _ in range(6000):
        body = step_body(
            frame, body, Demand(0.0, lean, GRAVITY_M_S2 / math.cos(lean), 0.0), high, 0.01
        )
    # Along the body: drag of the air speed along it, momentum drag by the root of the thrust. The part of the drag that
    # points up relieves the thrust, which holds the height.
    along = body.velocity_ned_m_s[1] * math.cos(lean)
    drag = 0.3 * math.sqrt(1.0 / math.cos(lean)) * along + 0.05 * along**2
    assert drag / math.cos(lean) == pytest.approx(GRAVITY_M_S2 * math.tan(lean), rel=1e-3)


@given(lean_n=st.floats(-0.7, 0.7), lean_e=st.floats(-0.7, 0.7), yaw=st.floats(-math.pi, math.pi))
def test_reported_attitude_tilts_the_thrust_axis_as_the_body_leans(lean_n, lean_e, yaw):
    body = body_at(ZERO, yaw)._replace(lean_n_rad=lean_n, lean_e_rad=lean_e)
    roll, pitch, heading, *_ = attitude_of(body)
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, heading) for f in (math.cos, math.sin))
    # Third column of the aerospace rotation matrix, body to NED; thrust is along minus z.
    thrust = -np.array([cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr])
    lean = math.hypot(lean_n, lean_e)
    size = math.sin(lean) / lean if lean else 1.0
    assert thrust == pytest.approx([lean_n * size, lean_e * size, -math.cos(lean)], abs=1e-9)


@given(thrust=st.floats(0.0, GRAVITY_M_S2 - 1e-6), lean=st.floats(-0.7, 0.7))
def test_thrust_below_the_weight_leaves_it_standing(thrust, lean):
    body = body_at(Vector((1.0, 2.0, 0.0)), 0.5)
    for _ in range(50):
        body = step_body(PX4_AIRFRAME, body, Demand(lean, 0.0, thrust, 1.0), CALM, 0.02)
    assert body.on_ground
    assert body.position_ned_m == (1.0, 2.0, 0.0)
    assert attitude_of(body)[:3] == (0.0, 0.0, 0.5)


@every_copter
def test_an_impact_ends_at_rest_on_the_ground_and_never_below_it(fly, make):
    vehicle = make()
    motion = vehicle.initial(Vector((0.0, 0.0, -15.0)), 0.0, flying=True)
    trace = fly(
        vehicle, Setpoint(Kind.STOPPED), 5.0, motion=motion, around=Surroundings(ground_down_m=2.0)
    )
    assert trace.velocity[:, 2].max() > 8.0
    assert trace.position[:, 2].max() == 2.0
    assert trace.motion.body.on_ground
    assert trace.motion.body.velocity_ned_m_s == (0.0, 0.0, 0.0)


@every_copter
def test_hover_in_wind_leans_against_its_drag_and_stays(fly, make, stream):
    vehicle = make()
    windy = Surroundings(wind_ned_m_s=(0.0, 6.0, 0.0), ground_down_m=1e6)
    trace = fly(vehicle, stream(), 60.0, around=windy)
    frame = vehicle.airframe
    drag = 6.0 * frame.drag_1_s + 36.0 * frame.drag_1_m
    assert np.linalg.norm(trace.velocity[-1]) < 0.02
    assert math.tan(-trace.motion.body.lean_e_rad) == pytest.approx(drag / GRAVITY_M_S2, rel=0.02)


@every_copter
def test_half_the_step_gives_the_same_flight(fly, make, stream):
    def orders(now_s: float) -> Setpoint:
        return FAST if now_s < 4.0 else SLOW

    FAST = stream(5.0, -2.0, -1.0)
    SLOW = stream(0.0, 1.0, 0.5)
    coarse = fly(make(), orders, 8.0, dt_s=0.02)
    fine = fly(make(), orders, 8.0, dt_s=0.01)
    assert np.abs(coarse.velocity - fine.velocity[1::2]).max() < 0.15
    assert np.sqrt(np.mean((coarse.velocity - fine.velocity[1::2]) ** 2)) < 0.03


@every_copter
def test_a_long_step_is_its_short_ones(make, stream):
    vehicle = make()
    order = stream(3.0, 1.0, -0.5)
    once = vehicle.step(
        vehicle.initial(Vector((0.0, 0.0, -9.0)), 1.0, flying=True), order, CALM, 1.0
    )
    motion = vehicle.initial(Vector((0.0, 0.0, -9.0)), 1.0, flying=True)
    for _ in range(50):
        motion = vehicle.step(motion, order, CALM, 0.02)
    assert once.body.position_ned_m == pytest.approx(motion.body.position_ned_m, abs=1e-9)
    assert once.body.velocity_ned_m_s == pytest.approx(motion.body.velocity_ned_m_s, abs=1e-9)


@every_copter
@settings(max_examples=drawn(40))
@given(
    command=st.tuples(*[st.floats(-50.0, 50.0)] * 3),
    wind=st.tuples(*[st.floats(-15.0, 15.0)] * 3),
    kind=st.sampled_from(list(Kind)),
)
def test_any_order_in_any_wind_stays_finite_and_repeats_itself(make, command, wind, kind):
    def flight():
        vehicle = make()
        motion = vehicle.initial(Vector((0.0, 0.0, -3.0)), 0.0, flying=True)
        # A motion to be tracked is of the autopilot's own making, and whole.
        order = Setpoint(kind, velocity_ned_m_s=Vector(command))
        if kind is Kind.TRACK:
            place = Vector((0.0, 0.0, -3.0))
            order = order._replace(position_ned_m=place, acceleration_ned_m_s2=ZERO)
        around = Surroundings(wind_ned_m_s=Vector(wind))
        for _ in range(100):
            motion = vehicle.step(motion, order, around, 0.02)
        return motion

    once = flight()
    assert once == flight()
    numbers = [*once.body.position_ned_m, *once.body.velocity_ned_m_s, *attitude_of(once.body)]
    assert all(math.isfinite(number) for number in numbers)
    assert once.body.position_ned_m[2] <= 0.0


def test_a_memory_of_another_flavour_starts_afresh(stream):
    motion = arducopter_quadrotor().initial(Vector((0.0, 0.0, -9.0)), 0.0, flying=True)
    after = px4_quadrotor().step(motion, stream(1.0), CALM, 0.02)
    assert after.body.position_ned_m == pytest.approx((0.0, 0.0, -9.0), abs=0.01)


def test_changed_parameters_take_over_in_flight_without_a_jolt(fly, stream):
    before = fly(px4_quadrotor(), stream(4.0), 10.0).motion
    frugal = px4_quadrotor(airframe=dataclasses.replace(PX4_AIRFRAME, drag_1_s=0.9))
    after = frugal.step(before, stream(4.0), CALM._replace(ground_down_m=1e6), 0.02)
    assert after.body.velocity_ned_m_s == pytest.approx(before.body.velocity_ned_m_s, abs=0.05)
