"""AUTO's legs and the slowing before a fence, against what ArduCopter 4.5.7 flew."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl_mock.ardupilot.avoidance import avoiding
from sitl_mock.ardupilot.legs import Rise, curve
from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.protocols import PlanItem, PlanKind

WPNAV = {
    "WPNAV_SPEED": 1000.0,
    "WPNAV_SPEED_UP": 250.0,
    "WPNAV_SPEED_DN": 150.0,
    "WPNAV_ACCEL": 250.0,
    "WPNAV_ACCEL_Z": 100.0,
    "WPNAV_JERK": 1.0,
}
SIDE_M = 25.0


@pytest.mark.parametrize(
    ("goal", "real_m_s"),
    [((30.0, 0.0, 0.0), 5.57), ((0.0, 20.0, -5.0), 4.45), ((-30.0, 0.0, 5.0), 5.58), ((0.0, -20.0, 0.0), 4.31)],
)
def test_a_leg_is_as_fast_in_its_middle_as_the_real_one_was(goal, real_m_s):
    leg = curve((0.0, 0.0, 0.0), goal, 0.0, math.nan, WPNAV)
    assert leg.along(leg.end_s / 2.0).speed_m_s == pytest.approx(real_m_s, rel=0.03)


@given(
    length_m=st.floats(0.01, 2000.0),
    climb=st.floats(-1.0, 1.0),
    speed_m_s=st.one_of(st.just(math.nan), st.floats(0.3, 20.0)),
    share=st.floats(0.0, 1.0),
)
def test_a_leg_begins_and_ends_at_rest_within_its_limits_and_is_its_own_integral(length_m, climb, speed_m_s, share):
    goal = (length_m * math.sqrt(1.0 - climb * climb), 0.0, length_m * climb)
    leg = curve((0.0, 0.0, 0.0), goal, 5.0, speed_m_s, WPNAV)
    assert leg.along(5.0) == (0.0, 0.0, 0.0)
    assert leg.along(leg.end_s) == (pytest.approx(leg.length_m), 0.0, 0.0)
    at_s, step_s = 5.0 + share * (leg.end_s - 5.0), 1e-4 * (leg.end_s - 5.0)
    before, now, after = (leg.along(at_s + k * step_s) for k in (-1, 0, 1))
    slack = 0.9 * step_s + 1e-6
    assert (after.distance_m - before.distance_m) / (2.0 * step_s) == pytest.approx(now.speed_m_s, abs=5.0 * slack)
    assert (after.speed_m_s - before.speed_m_s) / (2.0 * step_s) == pytest.approx(now.accel_m_s2, abs=slack)
    level, high = abs(leg.direction[0]), abs(leg.direction[2])
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


@pytest.fixture
def square(fly):
    """A copter in GUIDED at 10 m in a square of 50 m, with the fence on; its parameters by keyword."""

    def make(**parameters):
        flight = fly("arducopter", parameters={"FENCE_ENABLE": 1, "FENCE_TYPE": 4, **parameters}).run(0.5)
        frame = flight.vehicle.autopilot.frame
        corners = [(SIDE_M, SIDE_M), (SIDE_M, -SIDE_M), (-SIDE_M, -SIDE_M), (-SIDE_M, SIDE_M)]
        places = [frame.to_geodetic(*corner, 0.0) for corner in corners]
        items = [
            PlanItem(seq, 0, 5001, 0, 1, 4.0, 0, 0, 0, round(lat * 1e7), round(lon * 1e7), 0.0)
            for seq, (lat, lon, _) in enumerate(places)
        ]
        flight.vehicle.autopilot.plans.set_plan(PlanKind.FENCE, items)
        return flight

    return make


@pytest.mark.parametrize(
    ("real", "stream", "axis"),
    [
        ([(15.24, 4.44), (17.77, 3.86), (20.06, 3.09), (21.70, 2.24), (22.76, 1.20)], (5.0, 0.0, 0.0), 0),
        ([(17.10, 3.81), (19.41, 3.19), (21.13, 2.46), (22.46, 1.50), (23.09, 0.57)], (-3.0, 4.0, 0.0), 1),
    ],
)
def test_towards_a_fence_it_is_as_fast_at_each_distance_as_the_real_one(square, ned_velocity, real, stream, axis):
    flight = square()
    flight.guided()
    flight.command(400, 1.0)
    flight.command(22, 0, 0, 0, 0, 0, 0, 10.0)
    flight.run(14.0)
    flown = []
    for _ in range(90):
        flight.run(0.1, ned_velocity(*stream))
        flown.append((flight.position[axis], flight.velocity[axis], flight.velocity[1 - axis]))
    for place_m, speed_m_s in real:
        _, speed, aside = min(flown, key=lambda row: abs(row[0] - place_m))
        assert speed == pytest.approx(speed_m_s, abs=0.4)
        if place_m < SIDE_M - 2.0:
            assert aside == pytest.approx(stream[1 - axis], abs=0.25), "it slides along the fence"
    assert max(place for place, *_ in flown) < SIDE_M - 1.5
    assert flight.mode == "GUIDED"


def test_it_goes_back_from_the_margin_and_only_where_it_is_asked_to_avoid(square):
    ask = Setpoint(Kind.STREAM, velocity_ned_m_s=(5.0, 1.0, -0.5))

    def allowed(place, **parameters):
        vehicle = square(**parameters).vehicle.autopilot
        vehicle.state.position_m = place
        return avoiding(vehicle.state, vehicle.plans, ask).velocity_ned_m_s

    assert allowed((0.0, 0.0, -10.0)) == (5.0, 1.0, -0.5)
    assert allowed((22.5, 0.0, -10.0)) == pytest.approx((0.5, 1.0, -0.5), abs=0.02)
    assert allowed((23.5, 0.0, -10.0)) == pytest.approx((-0.5, 0.0, -0.5), abs=0.02)
    assert allowed((24.8, 0.0, -10.0)) == pytest.approx((-0.75, 0.0, -0.5), abs=0.02)
    for off in ({"AVOID_ENABLE": 2}, {"FENCE_ENABLE": 0}, {"FENCE_TYPE": 3}):
        assert allowed((23.5, 0.0, -10.0), **off) == (5.0, 1.0, -0.5)
