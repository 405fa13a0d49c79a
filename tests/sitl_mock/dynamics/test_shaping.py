"""Smooth references: limits kept, targets reached, no overrun; and the dead time of streamed setpoints."""

import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sitl_mock.dynamics import ARDUCOPTER_TRAVEL, PX4_TRAVEL, Kind, Setpoint
from sitl_mock.dynamics.multicopter import Pending, advance_pending
from sitl_mock.dynamics.shaping import (
    Reference,
    advance,
    shape_one,
    shape_pair,
    sqrt_controller,
    travel,
)
from sitl_mock.vector import ZERO, Vector
from tests.harness.examples import drawn

NAN = math.nan
DT_S = 0.02
speeds = st.floats(-12.0, 12.0)


@given(gain=st.floats(0.2, 8.0), second=st.floats(0.5, 10.0))
def test_the_square_root_controller_is_smooth_where_its_two_ends_meet(gain, second):
    corner = second / gain**2
    assert sqrt_controller(corner * (1 + 1e-9), gain, second) == pytest.approx(
        gain * corner, rel=1e-6
    )
    slope = (
        sqrt_controller(corner * 1.0001, gain, second) - sqrt_controller(corner, gain, second)
    ) / (corner * 0.0001)
    assert slope == pytest.approx(gain, rel=1e-3)


@given(start=st.floats(0.1, 50.0), second=st.floats(0.5, 10.0))
def test_following_the_square_root_controller_brakes_with_the_second_derivative_it_plans(
    start, second
):
    step = 1e-4
    before = sqrt_controller(start, 20.0, second)
    after = sqrt_controller(start - before * step, 20.0, second)
    assert (before - after) / step <= second * 1.01


@given(wanted=st.tuples(speeds, speeds), accel=st.floats(0.5, 6.0), jerk=st.floats(1.0, 12.0))
def test_a_horizontal_reference_keeps_its_limits_and_arrives(wanted, accel, jerk):
    reference = Reference(ZERO, ZERO)
    settle = jerk / accel
    for _ in range(3000):
        _, (v_n, v_e, _), (a_n, a_e, _) = reference
        n, e = shape_pair(wanted, (v_n, v_e), (a_n, a_e), (0.0, 0.0), accel, jerk, settle, DT_S)
        assert math.hypot(n, e) <= accel * 1.0001
        assert math.hypot(n - a_n, e - a_e) <= jerk * DT_S * 1.0001
        reference = advance(reference, (n, e, 0.0), DT_S)
    assert reference.velocity_ned_m_s[:2] == pytest.approx(wanted, abs=0.02)


@given(wanted=speeds, forward=st.floats(-1.0, 1.0))
def test_a_vertical_reference_ends_on_the_speed_and_acceleration_of_its_target(wanted, forward):
    velocity = 0.0
    acceleration = 0.0
    for step in range(2500):
        target = wanted + forward * step * DT_S
        acceleration = shape_one(target, velocity, acceleration, forward, 4.0, 5.0, 1.25, DT_S)
        velocity += acceleration * DT_S
    assert velocity == pytest.approx(wanted + forward * 2500 * DT_S, abs=0.05)
    assert acceleration == pytest.approx(forward, abs=0.01)


@pytest.mark.parametrize("limits", [PX4_TRAVEL, ARDUCOPTER_TRAVEL], ids=["px4", "arducopter"])
@settings(max_examples=drawn(25))
@example(to=(0.0, 3.0, 0.0))
@given(to=st.tuples(st.floats(-200.0, 200.0), st.floats(-200.0, 200.0), st.floats(-60.0, 60.0)))
def test_travel_ends_at_the_place_and_hardly_overruns_it(limits, to):
    """Catches a shaper that overruns or never ends."""
    order = Setpoint(Kind.TRAVEL, position_ned_m=Vector(to))
    reference = Reference(ZERO, ZERO)
    furthest = 0.0
    fastest = 0.0
    distance = math.hypot(to[0], to[1])
    for _ in range(7000):
        reference = travel(limits, reference, order, DT_S)
        (n, e, _), (v_n, v_e, _), _ = reference
        fastest = max(fastest, math.hypot(v_n, v_e))
        if distance > 1.0:
            furthest = max(furthest, (n * to[0] + e * to[1]) / distance)
    assert reference.position_ned_m == pytest.approx(to, abs=0.05)
    assert furthest <= distance + 0.2
    assert fastest <= limits.speed_m_s + 0.05


def test_px4_travels_along_the_straight_line_at_the_slower_pace_of_both_directions():
    order = Setpoint(
        Kind.TRAVEL, position_ned_m=Vector((30.0, 40.0, -10.0)), speed_m_s=5.0, climb_m_s=0.5
    )
    reference = Reference(ZERO, ZERO)
    for _ in range(400):
        reference = travel(PX4_TRAVEL, reference, order, DT_S)
    n, e, d = reference.velocity_ned_m_s
    assert d == pytest.approx(-0.5, abs=0.02)
    assert (n, e) == pytest.approx((1.5, 2.0), abs=0.1)


def test_travel_obeys_the_speeds_of_its_order():
    order = Setpoint(
        Kind.TRAVEL, position_ned_m=Vector((80.0, 0.0, -40.0)), speed_m_s=2.0, climb_m_s=1.0
    )
    reference = Reference(ZERO, ZERO)
    for _ in range(500):
        reference = travel(PX4_TRAVEL, reference, order, DT_S)
    assert reference.velocity_ned_m_s == pytest.approx((2.0, 0.0, -1.0), abs=0.01)


def test_travel_without_a_place_follows_a_velocity():
    order = Setpoint(
        Kind.TRAVEL,
        position_ned_m=Vector((0.0, 0.0, NAN)),
        velocity_ned_m_s=Vector((NAN, NAN, 0.7)),
    )
    reference = Reference(ZERO, ZERO)
    for _ in range(500):
        reference = travel(PX4_TRAVEL, reference, order, DT_S)
    assert reference.velocity_ned_m_s == pytest.approx((0.0, 0.0, 0.7), abs=0.01)


def test_streamed_setpoints_arrive_late_complete_and_in_order():
    orders = [
        Setpoint(Kind.STREAM, velocity_ned_m_s=Vector((float(k), 0.0, 0.0))) for k in range(10)
    ]
    pending = Pending(0.0, Setpoint(Kind.BRAKE))
    obeyed = []
    for order in orders:
        pending = advance_pending(pending, order, 0.04, DT_S)
        obeyed.append(pending.obeyed)
    assert [order.kind for order in obeyed[:2]] == [Kind.BRAKE, Kind.BRAKE]
    assert obeyed[2:] == orders[:8]


def test_any_other_order_is_obeyed_at_once():
    pending = advance_pending(Pending(0.0, Setpoint(Kind.BRAKE)), Setpoint(Kind.STREAM), 0.5, DT_S)
    stop = Setpoint(Kind.STOPPED)
    pending = advance_pending(pending, stop, 0.5, DT_S)
    assert pending.obeyed is stop
    assert pending.waiting == ()
