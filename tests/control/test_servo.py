"""The velocity servo against closed forms and first-order plants."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.autopilots import AUTOPILOTS
from guidance.control.servo import ServoGains, ServoMemory, serve
from guidance.frames import Ned

DT_S = 0.02
GAINS = ServoGains(
    acceleration_m_s2=4.0,
    vertical_acceleration_m_s2=2.0,
    jerk_m_s3=20.0,
    settle_per_s=4.0,
    lag_s=0.3,
    drag_per_s=0.2,
    drag_limit_per_s=1.5,
    trim_limit_m_s2=1.5,
    drag_learning_per_s2=2.0,
    trim_learning_per_s2=0.5,
)
IGNORANT = replace(GAINS, drag_per_s=0.0, drag_learning_per_s2=0.0, trim_learning_per_s2=0.0)
STILL = (0.0, 0.0, 0.0)

speeds = st.floats(-20.0, 20.0)
velocities = st.tuples(speeds, speeds, speeds).map(Ned)
steps = st.sampled_from([0.0, 0.005, 0.02, 0.05, 0.1, 0.5])
gains = st.sampled_from(
    [GAINS, IGNORANT, *(autopilot.handling.servo for autopilot in AUTOPILOTS.values())]
)


def ground(vector):
    return math.hypot(vector[0], vector[1])


def difference(one, other):
    return [a - b for a, b in zip(one, other, strict=True)]


def run(wanted, gains, *, plant, seconds):
    """Close the loop: `plant(velocity, served)` is the vehicle's acceleration. Yields (time, velocity, served)."""
    velocity = STILL
    memory = None
    for cycle in range(round(seconds / DT_S)):
        served = _, memory = serve(Ned(wanted), Ned(velocity), memory, gains, dt_s=DT_S)
        yield cycle * DT_S, velocity, served
        velocity = tuple(
            v + a * DT_S for v, a in zip(velocity, plant(velocity, served), strict=True)
        )


def loop(*, drag_per_s=0.0, push=STILL, gain_per_s=1.8, largest_m_s2=math.inf):
    """PX4's velocity loop without its integral: P on velocity, feed-forward, drag, a push, a tilt limit."""

    def plant(velocity, served):
        acceleration, memory = served
        asked = [
            gain_per_s * (command - v) + fed
            for command, v, fed in zip(
                memory.reference_ned_m_s, velocity, acceleration, strict=True
            )
        ]
        size = ground(asked)
        share = min(1.0, largest_m_s2 / size) if size > 0.0 else 1.0
        north = share * asked[0]
        east = share * asked[1]
        drags = [-drag_per_s * v + p for v, p in zip(velocity, push, strict=True)]
        return north + drags[0], east + drags[1], asked[2] + drags[2]

    return plant


@given(st.lists(st.tuples(velocities, velocities, steps), min_size=1, max_size=30), gains)
def test_the_command_never_leaves_what_was_wanted_and_flown(cycles, gains):
    memory = None
    sizes = [ground(cycles[0][1])]
    heights = [cycles[0][1][2]]
    for wanted, flown, dt_s in cycles:
        _, memory = serve(Ned(wanted), Ned(flown), memory, gains, dt_s=dt_s)
        sizes.append(ground(wanted))
        heights.append(wanted[2])
        assert (
            ground(memory.reference_ned_m_s)
            <= max(sizes) + 2.0 * gains.acceleration_m_s2**2 / gains.jerk_m_s3
        )
        slack = 2.0 * gains.vertical_acceleration_m_s2**2 / gains.jerk_m_s3
        assert min(heights) - slack <= memory.reference_ned_m_s[2] <= max(heights) + slack


@given(st.lists(st.tuples(velocities, velocities, steps), min_size=1, max_size=30), gains)
def test_the_reference_keeps_its_acceleration_and_jerk_whatever_is_asked(cycles, gains):
    memory = None
    for wanted, flown, dt_s in cycles:
        before = memory or ServoMemory(
            Ned(flown), Ned(STILL), Ned(flown), gains.drag_per_s, Ned(STILL)
        )
        _, memory = serve(Ned(wanted), Ned(flown), memory, gains, dt_s=dt_s)
        counted_s = min(dt_s, 0.1)
        moved = difference(memory.reference_ned_m_s, before.reference_ned_m_s)
        assert ground(moved) <= gains.acceleration_m_s2 * counted_s + 1e-9
        assert abs(moved[2]) <= gains.vertical_acceleration_m_s2 * counted_s + 1e-9
        jerked = difference(memory.acceleration_ned_m_s2, before.acceleration_ned_m_s2)
        assert ground(jerked) <= gains.jerk_m_s3 * counted_s + 1e-9
        assert abs(jerked[2]) <= gains.jerk_m_s3 * counted_s + 1e-9


@given(st.lists(st.tuples(velocities, velocities, steps), min_size=1, max_size=60), gains)
def test_what_is_learned_never_winds_up_beyond_its_limits(cycles, gains):
    memory = None
    for wanted, flown, dt_s in cycles:
        _, memory = serve(Ned(wanted), Ned(flown), memory, gains, dt_s=dt_s)
        assert 0.0 <= memory.drag_per_s <= max(gains.drag_limit_per_s, gains.drag_per_s)
        assert ground(memory.trim_ned_m_s2) <= gains.trim_limit_m_s2 + 1e-12
        assert memory.trim_ned_m_s2[2] == 0.0


def test_a_blocked_vehicle_does_not_wind_the_servo_up():
    held = list(run((6.0, 0.0, 0.0), GAINS, plant=lambda _velocity, _served: STILL, seconds=30.0))
    early = next(memory for _, _, (_, memory) in held if memory.expected_ned_m_s[0] > 3.0)
    _, _, (_, late) = held[-1]
    assert late.drag_per_s == pytest.approx(early.drag_per_s, abs=0.05)
    assert late.trim_ned_m_s2[0] == pytest.approx(early.trim_ned_m_s2[0], abs=0.05)


@pytest.mark.parametrize(
    ("wanted", "push"),
    [
        ((0.0, 0.0, 0.0), (1.2, 0.0, 0.0)),
        ((3.0, -1.0, 0.0), (0.0, -0.8, 0.0)),
        ((6.0, 0.0, 0.0), (-0.7, 0.7, 0.0)),
    ],
)
def test_a_constant_push_leaves_no_steady_error(wanted, push):
    *_, (_, velocity, _) = run(wanted, GAINS, plant=loop(push=push), seconds=60.0)
    assert velocity == pytest.approx(wanted, abs=0.01)


@pytest.mark.parametrize("drag_per_s", [0.0, 0.5, 1.0, 1.3])
def test_drag_leaves_no_steady_error(drag_per_s):
    flown = list(run((4.0, 3.0, 0.0), GAINS, plant=loop(drag_per_s=drag_per_s), seconds=30.0))
    assert flown[-1][1] == pytest.approx((4.0, 3.0, 0.0), abs=0.02)
    # PX4's own loop alone stays at P / (P + drag) of the setpoint.
    alone = list(run((4.0, 3.0, 0.0), IGNORANT, plant=loop(drag_per_s=drag_per_s), seconds=30.0))
    assert ground(alone[-1][1]) == pytest.approx(5.0 * 1.8 / (1.8 + drag_per_s), abs=0.01)


def test_a_vehicle_at_its_tilt_limit_overshoots_little_when_it_gets_there():
    # Keeping 5 m/s takes 1.5 m/s² of it: the last vehicle has next to nothing left to get there with.
    for largest_m_s2, overshoot in ((4.0, 0.02), (3.0, 0.05), (2.0, 0.25)):
        plant = loop(drag_per_s=0.3, largest_m_s2=largest_m_s2)
        flown = [
            velocity[0] for _, velocity, _ in run((5.0, 0.0, 0.0), GAINS, plant=plant, seconds=30.0)
        ]
        assert max(flown) < 5.0 * (1.0 + overshoot)
        assert flown[-1] == pytest.approx(5.0, abs=0.05)


def test_what_drag_costs_falls_with_the_speed_at_once():
    memory = ServoMemory(Ned((6.0, 0.0, 0.0)), Ned(STILL), Ned((6.0, 0.0, 0.0)), 0.8, Ned(STILL))
    fast, _ = serve(Ned((6.0, 0.0, 0.0)), Ned((6.0, 0.0, 0.0)), memory, IGNORANT, dt_s=DT_S)
    slow, _ = serve(
        Ned((3.0, 0.0, 0.0)),
        Ned((3.0, 0.0, 0.0)),
        memory._replace(reference_ned_m_s=Ned((3.0, 0.0, 0.0))),
        IGNORANT,
        dt_s=DT_S,
    )
    assert fast[0] == pytest.approx(4.8)
    assert slow[0] == pytest.approx(2.4)


def test_the_reference_takes_the_time_that_acceleration_and_jerk_need():
    gains = replace(IGNORANT, settle_per_s=1e3)
    times = (time for time, _, (_, memory) in run((6.0, 0.0, 0.0), gains, plant=loop(), seconds=5.0)
             if memory.reference_ned_m_s[0] > 5.999)  # fmt: skip
    assert next(times) == pytest.approx(6.0 / 4.0 + 4.0 / 20.0, abs=0.08)  # Δv / a + a / j


def test_the_reference_arrives_without_overshoot():
    flown = run((6.0, 0.0, -1.5), IGNORANT, plant=loop(), seconds=6.0)
    references = [memory.reference_ned_m_s for _, _, (_, memory) in flown]
    assert max(reference[0] for reference in references) <= 6.0 + 1e-9
    assert min(reference[2] for reference in references) >= -1.5 - 1e-9
    assert references[-1] == pytest.approx((6.0, 0.0, -1.5), abs=1e-3)


def test_the_acceleration_fed_forward_is_the_references_own():
    before = STILL
    for _, _, (fed, memory) in run((6.0, -2.0, 1.0), IGNORANT, plant=loop(), seconds=3.0):
        rate = [change / DT_S for change in difference(memory.reference_ned_m_s, before)]
        assert fed == pytest.approx(rate, abs=1e-9)
        before = memory.reference_ned_m_s


def test_it_begins_at_the_vehicles_own_velocity():
    _, memory = serve(Ned((6.0, 0.0, 0.0)), Ned((2.0, 1.0, -0.5)), None, GAINS, dt_s=0.0)
    assert memory.reference_ned_m_s == (2.0, 1.0, -0.5)
    assert memory.expected_ned_m_s == (2.0, 1.0, -0.5)
    assert memory.drag_per_s == GAINS.drag_per_s


def test_a_late_cycle_is_not_made_up_for():
    late, longest = (
        serve(Ned((6.0, 0.0, 0.0)), Ned(STILL), None, GAINS, dt_s=dt_s) for dt_s in (5.0, 0.1)
    )
    assert late == longest


def test_nothing_is_learned_from_an_error_that_is_too_large():
    memory = ServoMemory(
        Ned((5.0, 0.0, 0.0)), Ned(STILL), Ned((5.0, 0.0, 0.0)), 0.4, Ned((0.1, 0.0, 0.0))
    )
    flown_m_s = (5.0 - 3.0 * GAINS.learning_within_m_s - 0.1, 4.0, 3.0)
    far, near, less = (
        serve(Ned((5.0, 0.0, 0.0)), Ned((one, 0.0, 0.0)), memory, GAINS, dt_s=DT_S)[1]
        for one in flown_m_s
    )
    assert (far.drag_per_s, far.trim_ned_m_s2) == (0.4, (0.1, 0.0, 0.0))
    assert near.drag_per_s == pytest.approx(0.4 + 2.0 * 1.0 * DT_S / 5.0)
    assert near.trim_ned_m_s2[0] == pytest.approx(0.1 + 0.5 * 1.0 * DT_S)
    assert 0.4 < less.drag_per_s < near.drag_per_s


CRUISE = (3.0, 4.0, 1.0)


def taught(error, gains, memory=None):
    """What one error, expected less flown, teaches a vehicle that cruises at 5 m/s over the ground."""
    memory = memory or ServoMemory(Ned(CRUISE), Ned(STILL), Ned(CRUISE), 0.4, Ned((0.1, -0.2, 0.0)))
    flown = tuple(difference(CRUISE, error))
    return serve(Ned(CRUISE), Ned(flown), memory, gains, dt_s=DT_S)[1]


@pytest.mark.parametrize(
    ("error", "counted"),
    [
        ((0.3, -0.1, 7.0), 1.0),  # an error of height teaches nothing, and hides nothing
        ((0.3, 0.4, 0.0), 1.0),
        ((0.6, -0.8, 0.0), 0.25),  # twice as much as is learned from in full
        ((0.84, 1.12, 0.0), (0.5 / 1.4) ** 2),
        ((0.96, -1.28, 0.0), 0.0),
    ],
)
def test_a_lesson_is_the_error_along_the_way_for_drag_and_all_of_it_for_trim(error, counted):
    gains = replace(GAINS, learning_within_m_s=0.5)
    learned = taught(error, gains)
    along = (3.0 * error[0] + 4.0 * error[1]) / 5.0
    assert learned.drag_per_s - 0.4 == pytest.approx(
        2.0 * (along / 5.0) * DT_S * counted, abs=1e-12
    )
    trim = (0.1 + 0.5 * error[0] * DT_S * counted, -0.2 + 0.5 * error[1] * DT_S * counted, 0.0)
    assert learned.trim_ned_m_s2 == pytest.approx(trim, abs=1e-12)


def test_a_trim_beyond_its_limit_is_scaled_back_to_it():
    held = taught(
        STILL, GAINS, ServoMemory(Ned(CRUISE), Ned(STILL), Ned(CRUISE), 0.4, Ned((3.0, -4.0, 0.0)))
    )
    assert held.trim_ned_m_s2 == pytest.approx((0.9, -1.2, 0.0))


def test_what_is_expected_of_the_vehicle_is_the_reference_late_by_its_lag():
    _, late = serve(
        Ned(CRUISE),
        Ned(STILL),
        ServoMemory(Ned(CRUISE), Ned(STILL), Ned((1.0, -1.0, -1.0)), 0.4, Ned(STILL)),
        GAINS,
        dt_s=0.06,
    )
    left = math.exp(-0.06 / 0.3)
    assert late.expected_ned_m_s == pytest.approx(
        (3.0 - 2.0 * left, 4.0 - 5.0 * left, 1.0 - 2.0 * left)
    )


def test_a_held_back_vehicle_does_not_change_the_expected_response():
    memory = ServoMemory(Ned(CRUISE), Ned(STILL), Ned((2.0, 4.0, 1.0)), 0.4, Ned((0.1, -0.2, 0.0)))
    free, held = (
        serve(Ned(CRUISE), Ned((2.5, 3.0, 0.0)), memory, GAINS, dt_s=DT_S, held_back=one)[1]
        for one in (False, True)
    )
    assert (held.drag_per_s, held.trim_ned_m_s2) == (memory.drag_per_s, memory.trim_ned_m_s2)
    assert free.drag_per_s != held.drag_per_s
    assert free._replace(drag_per_s=held.drag_per_s, trim_ned_m_s2=held.trim_ned_m_s2) == held


def test_gains_that_say_nothing_of_it_learn_nothing():
    said = {"acceleration_m_s2": 4.0, "vertical_acceleration_m_s2": 2.0, "jerk_m_s3": 20.0}
    plain = {"settle_per_s": 4.0, "lag_s": 0.3, "learning_within_m_s": 1.0}
    nothing = dict.fromkeys(
        (
            "drag_per_s",
            "drag_limit_per_s",
            "trim_limit_m_s2",
            "drag_learning_per_s2",
            "trim_learning_per_s2",
        ),
        0.0,
    )
    assert ServoGains(**said) == ServoGains(**said, **plain, **nothing)
