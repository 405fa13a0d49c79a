import math

import pytest

from guidance.autopilots import PX4
from guidance.frames import Ned
from guidance.messages import (
    Attitude,
    CommandAck,
    Heartbeat,
    Home,
    LandedState,
    LocalPosition,
    Odometry,
    Origin,
)
from guidance.vehicle import VehicleState, local_frame, observe


def local(received_s, boot_s, position=(0.0, 0.0, -10.0), velocity=(0.0, 0.0, 0.0)):
    return LocalPosition(received_s, boot_s, Ned(position), Ned(velocity))


def test_nothing_heard_has_infinite_age_and_is_neither_armed_nor_on_the_ground():
    state = VehicleState()
    assert state.age_s(Heartbeat, 5.0) == math.inf
    assert not state.armed
    assert not state.on_ground
    assert state.yaw_rad == 0.0
    assert state.latest.get(LocalPosition) is None


def test_the_latest_message_of_each_kind_is_kept_with_its_age():
    state = observe(
        VehicleState(),
        [Heartbeat(1.0, 0, True, 4, 12), Attitude(1.5, 0.1, 0.3), LandedState(2.0, 1)],
    )
    assert state.armed
    assert state.on_ground
    assert state.yaw_rad == 0.3
    assert state.age_s(Heartbeat, 4.0) == 3.0


def test_repeated_and_older_local_positions_are_passed_over():
    state = observe(
        VehicleState(), [local(1.0, 1.0), local(1.1, 1.0, (9.0, 9.0, 9.0)), local(1.2, 0.9)]
    )
    assert state.latest.get(LocalPosition) == local(1.0, 1.0)
    assert state.reboots == 0


def test_a_changed_reset_counter_is_a_jump_and_the_first_one_is_not():
    state = observe(VehicleState(), [Odometry(1.0, 7), Odometry(1.1, 7)])
    assert state.resets == 0
    assert observe(state, [Odometry(1.2, 8), Odometry(1.3, 8)]).resets == 1


def test_an_acknowledgement_is_not_a_state():
    assert observe(VehicleState(), [CommandAck(1.0, 400, 0)]).latest == {}


def test_the_fold_leaves_the_old_state_as_it_was():
    before = observe(VehicleState(), [Odometry(1.0, 7)])
    observe(before, [Odometry(1.1, 8)])
    assert before.latest.get(Odometry) == Odometry(1.0, 7)


def test_the_local_frame_is_the_estimators_origin_not_home():
    home = Home(1.0, 47.4, 8.5, 500.0, Ned((30.0, 40.0, -2.0)))
    state = observe(VehicleState(), [home])
    frame = local_frame(state, PX4.projection)
    assert frame.ned_from_wgs84(home.latitude_deg, home.longitude_deg, frame.home) == pytest.approx(
        (30.0, 40.0, -2.0), abs=2e-3
    )
    told = local_frame(observe(state, [Origin(1.1, 47.3, 8.4, 400.0)]), PX4.projection)
    assert (told.latitude_deg, told.longitude_deg, told.altitude.metres) == (47.3, 8.4, 400.0)
    assert told.home.metres == 500.0


def test_no_frame_before_home_is_known():
    assert (
        local_frame(observe(VehicleState(), [Origin(1.0, 47.3, 8.4, 400.0)]), PX4.projection)
        is None
    )


WRAP_S = 2.0**32 / 1e3


def flown_across(stamps_s):
    """Return the state of a vehicle that flies north at 5 m/s, its positions stamped so."""
    flown = [
        local(1.0 + 0.02 * n, stamp_s, (0.1 * n, 0.0, -10.0), (5.0, 0.0, 0.0))
        for n, stamp_s in enumerate(stamps_s)
    ]
    return observe(VehicleState(), flown)


def test_a_clock_of_32_bits_that_wraps_is_neither_a_reboot_nor_a_jump():
    stamps_s = [(WRAP_S - 0.1 + 0.02 * n) % WRAP_S for n in range(11)]
    state = flown_across(stamps_s)
    assert (state.reboots, state.resets, state.contradicted_s) == (0, 0, ())
    assert state.latest.get(LocalPosition).position_ned_m.north == pytest.approx(1.0)
    assert state.acceleration_ned_m_s2 == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("uptime_days", [0.001, 10.0, 24.8, 24.9, 40.0, 48.0])
def test_a_reboot_is_one_after_any_uptime(uptime_days):
    uptime_s = 86_400.0 * uptime_days
    assert flown_across([uptime_s, uptime_s + 0.02, 5.0]).reboots == 1


def test_a_jump_before_the_wrap_and_a_position_after_it_are_in_order():
    before_s = WRAP_S - 0.05
    jumped = [
        local(1.0, before_s),
        local(1.02, before_s + 0.02, (7.0, 0.0, -10.0)),
        local(1.1, 0.05, (7.0, 0.0, -10.0)),
    ]
    state = observe(VehicleState(), jumped)
    assert (state.resets, state.reboots) == (1, 0)
    late = observe(state, [local(1.12, before_s + 0.01, (0.0, 0.0, -10.0))])
    assert late.contradicted_s == ()  # older than the jump
