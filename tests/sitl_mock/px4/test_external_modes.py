"""External modes of the mocked PX4, as a program beside it sees them over its topics and a station over MAVLink."""

import itertools
import math

import pytest

from sitl_mock.px4.events import fnv1a
from tests.harness.copies import copied
from tests.sitl_mock.px4.companion import Companion, as_field

HOLD = 4
RTL = 5
TAKEOFF = 17
LAND = 18
REJECTED = 1


@pytest.fixture
def px4():
    return Companion()


@pytest.fixture(scope="module")
def take_off():
    """Fly a take-off with a registered mode once; its tests continue from copies."""
    px4 = Companion()
    px4.register("Pursuit")
    px4.take_off()
    return px4


@pytest.fixture
def flying(take_off):
    """In the air, with a registered mode 23 that may run."""
    return copied(take_off)


def test_a_mode_is_registered_with_a_number_and_an_arming_check(px4):
    px4.step(1.0)
    reply = px4.register("Pursuit")
    assert reply.success
    assert (reply.request_id, bytes(reply.name).rstrip(b"\0")) == (1, b"Pursuit")
    assert (reply.arming_check_id, reply.mode_id, reply.mode_executor_id) == (0, 23, -1)
    assert reply.px4_ros2_api_version == 1


@pytest.mark.parametrize(
    "wanted",
    [
        {"register_mode": True, "register_arming_check": False},
        {"register_mode": False, "register_mode_executor": True},
    ],
)
def test_a_mode_needs_an_arming_check_and_an_executor_a_mode(px4, wanted):
    reply = px4.register("Pursuit", **wanted)
    assert (reply.success, reply.arming_check_id, reply.mode_id) == (False, -1, -1)


def test_eight_modes_have_places_and_the_ninth_is_refused(px4):
    numbers = [px4.register(f"Mode {index}").mode_id for index in range(9)]
    assert numbers == [23, 24, 25, 26, 27, 28, 29, 30, -1]


def test_a_mode_keeps_its_number_over_a_reboot_by_the_hash_of_its_name(px4):
    first = px4.register("First").mode_id
    second = px4.register("Second").mode_id
    hashes = [px4.vehicle.autopilot.parameters[f"COM_MODE{place}_HASH"] for place in range(3)]
    assert [value & 0xFFFFFFFF for value in hashes] == [fnv1a("First"), fnv1a("Second"), 0]
    px4.vehicle.inject("reboot")
    px4.answers.clear()
    px4.step(1.0)
    assert px4.register("Second").mode_id == second
    assert px4.register("First").mode_id == first
    assert "COM_MODE0_HASH" in px4.vehicle.autopilot.parameters.names


def test_arming_checks_are_asked_for_every_300_ms_and_only_while_there_are_any(px4):
    px4.step(2.0)
    assert px4.last("arming_check_request") is None
    px4.register("Pursuit")
    px4.step(6.0)
    asked_s = [at_s for at_s, _ in px4.heard("arming_check_request")]
    gaps_s = [after - before for before, after in itertools.pairwise(asked_s)]
    assert min(gaps_s) > 0.3
    assert max(gaps_s) < 0.33
    numbers = [message.request_id for _, message in px4.heard("arming_check_request")]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_a_mode_that_may_not_run_is_refused_in_the_air_and_prevents_arming_on_the_ground(px4):
    reply = px4.register("Pursuit", answers={"can_arm_and_run": False})
    px4.until(lambda: px4.last("vehicle_status").pre_flight_checks_pass)
    assert px4.choose(reply.mode_id) == 0  # disarmed every mode may be chosen
    px4.step()
    assert not px4.last("vehicle_status").pre_flight_checks_pass
    assert px4.command(400, 1.0) == REJECTED
    assert px4.choose(HOLD) == 0
    px4.take_off()
    assert px4.choose(reply.mode_id) == REJECTED
    assert px4.state == HOLD
    px4.answers[0] = {"can_arm_and_run": True}
    px4.step(0.5)
    assert px4.choose(reply.mode_id) == 0
    px4.until(lambda: px4.state == reply.mode_id, 0.1)


def test_requirements_of_a_mode_are_checked_by_px4(px4):
    reply = px4.register("Pursuit", answers={"mode_req_manual_control": True})
    px4.take_off()
    assert px4.choose(reply.mode_id) == REJECTED  # there are no sticks
    px4.answers[0] = {"can_arm_and_run": True, "mode_req_local_position": True}
    px4.step(0.5)
    assert px4.choose(reply.mode_id) == 0


def test_the_mode_follows_velocities_and_holds_until_the_first_one(flying):
    """Catches an external mode that drifts before its first setpoint."""
    flying.choose(23)
    height_m = flying.height_m
    flying.step(1.0)
    assert math.hypot(flying.last("vehicle_local_position").vx, 0.0) < 0.3
    for _ in range(400):
        flying.fly(5.0)
        flying.step()
    position = flying.last("vehicle_local_position")
    assert position.vx == pytest.approx(4.5, abs=0.2)  # as recorded over MAVLink
    assert flying.height_m == pytest.approx(height_m, abs=0.5)


def test_setpoints_in_hold_move_the_vehicle_since_both_write_one_topic(flying):
    before_m = flying.last("vehicle_local_position").x
    for _ in range(200):
        flying.fly(5.0)
        flying.step()
    assert flying.state == HOLD
    assert 0.3 < flying.last("vehicle_local_position").x - before_m < 4.0  # 2.1 m on the real one


def test_a_silent_program_loses_its_mode_in_flight_after_1_to_1_3_s(flying):
    flying.choose(23)
    flying.until(lambda: flying.state == 23, 0.2)
    flying.answers.clear()
    left_s = flying.until(lambda: flying.state != 23)
    assert 0.9 < left_s < 1.35
    assert flying.state == RTL
    flying.step(0.4)
    assert flying.last("arming_check_request").valid_registrations_mask == 0


def test_a_mode_that_replies_again_is_flown_again_three_times_and_then_no_more(flying):
    flying.choose(23)
    flying.until(lambda: flying.state == 23, 0.2)
    for _ in range(3):
        flying.answers[0] = None
        flying.until(lambda: flying.state != 23)
        flying.answers[0] = {"can_arm_and_run": True}
        flying.until(lambda: flying.state == 23, 1.0)
    flying.answers[0] = None
    flying.until(lambda: flying.state != 23)
    flying.answers[0] = {"can_arm_and_run": True}
    flying.step(2.0)
    assert flying.state != 23


def test_a_silent_mode_that_is_not_chosen_is_forgotten_and_may_come_back_with_its_number(px4):
    px4.register("Pursuit")
    px4.answers.clear()
    px4.until(lambda: not px4.last("vehicle_status").can_set_nav_states_mask >> 23 & 1, 5.0)
    assert px4.register("Pursuit").mode_id == 23


def test_an_unregistered_mode_is_left_at_once(flying):
    flying.choose(23)
    flying.send("unregister_ext_component", name=as_field("Pursuit"), arming_check_id=0, mode_id=23)
    flying.step(0.3)
    assert flying.state == RTL


def test_unregistering_a_chosen_mode_on_the_ground_chooses_hold(px4):
    reply = px4.register("Pursuit")
    px4.choose(reply.mode_id)
    px4.send(
        "unregister_ext_component",
        name=as_field("Pursuit"),
        arming_check_id=0,
        mode_id=23,
        mode_executor_id=-1,
    )
    px4.step(0.2)
    assert px4.state == HOLD


def test_a_mode_alone_does_not_take_off(px4):
    reply = px4.register("Pursuit")
    px4.until(lambda: px4.last("vehicle_status").pre_flight_checks_pass)
    px4.choose(reply.mode_id)
    assert px4.command(400, 1.0) == 0
    for _ in range(250):
        px4.fly(0.0, 0.0, -2.0)
        px4.step()
    assert px4.height_m < 0.5


def test_a_replacing_mode_flies_in_place_of_the_internal_one_which_takes_over_when_it_is_silent(
    px4,
):
    reply = px4.register(
        "Better Return", enable_replace_internal_mode=True, replace_internal_mode=RTL
    )
    px4.take_off()
    assert px4.command(20) == 0
    px4.until(lambda: px4.state == reply.mode_id, 0.2)
    assert px4.last("vehicle_status").nav_state_user_intention == reply.mode_id
    px4.answers.clear()
    px4.until(lambda: px4.state == RTL, 2.0)
    assert not px4.last("vehicle_status").failsafe


def test_a_mode_cannot_be_replaced_twice(px4):
    assert px4.register("A", enable_replace_internal_mode=True, replace_internal_mode=RTL).success
    assert not px4.register(
        "B", enable_replace_internal_mode=True, replace_internal_mode=RTL
    ).success


def test_an_executor_arms_takes_off_pursues_and_lands(px4):
    reply = px4.register("Pursuit", register_mode_executor=True)
    assert reply.mode_executor_id == 1
    px4.until(lambda: px4.last("vehicle_status").pre_flight_checks_pass)
    own = {"topic": "vehicle_command_mode_executor", "source_component": 1001}
    px4.choose(reply.mode_id)
    px4.until(lambda: px4.last("vehicle_status").executor_in_charge == 1, 0.2)
    assert px4.command(400, 1.0, **own) == 0
    nan = math.nan
    assert px4.command(22, nan, nan, nan, nan, nan, nan, nan, **own) == 0
    px4.until(lambda: px4.last("mode_completed") is not None)
    assert (px4.last("mode_completed").nav_state, px4.state) == (TAKEOFF, TAKEOFF)
    assert px4.last("vehicle_status").executor_in_charge == 1
    assert px4.command(100001, 23.0, **own) == 0
    px4.until(lambda: px4.state == 23, 0.2)
    assert px4.command(21, **own) == 0
    px4.until(lambda: px4.last("mode_completed").nav_state == LAND, 60.0)
    px4.until(lambda: px4.last("vehicle_status").arming_state == 1)
    assert px4.state == 23  # after disarming the mode of the executor in charge is chosen again


def test_a_pilots_choice_ends_an_executor(px4):
    reply = px4.register("Pursuit", register_mode_executor=True)
    px4.choose(reply.mode_id)
    px4.step(0.1)
    assert px4.choose(HOLD) == 0
    px4.step(0.1)
    assert px4.last("vehicle_status").executor_in_charge == 0


def test_commands_of_an_executor_that_is_not_in_charge_are_taken_as_v1_17_does(px4):
    px4.register("Pursuit", register_mode_executor=True)
    px4.until(lambda: px4.last("vehicle_status").pre_flight_checks_pass)
    own = {"topic": "vehicle_command_mode_executor", "source_component": 1001}
    assert px4.command(400, 1.0, **own) == 0


def test_a_control_mode_that_says_disarmed_stops_the_motors_for_up_to_half_a_second(flying):
    flying.choose(23)
    flying.step(1.0)
    flying.send("config_control_setpoints", source_id=23, flag_control_velocity_enabled=True)
    flying.step(0.02)
    assert flying.last("vehicle_control_mode").source_id == 23
    flying.step(0.6)
    fallen_m_s = max(
        message.vz for at_s, message in flying.heard("vehicle_local_position", since=-80)
    )
    assert 1.0 < fallen_m_s < 5.5
    assert flying.last("vehicle_control_mode").flag_armed
    flying.step(3.0)
    assert abs(flying.last("vehicle_local_position").vz) < 0.5


def test_a_station_sees_and_chooses_the_mode_by_its_name(flying):
    flying.tell("COMMAND_LONG", 1, 1, 512, 0, 435.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    flying.step(0.1)
    modes = {mode.custom_mode: mode for mode in flying.mavlink_messages("AVAILABLE_MODES")}
    own = modes[4 << 16 | 11 << 24]
    assert (own.mode_name, own.properties & 2) == ("Pursuit", 0)
    assert modes[4 << 16 | 12 << 24].mode_name == "(Mode not available)"
    flying.tell("COMMAND_LONG", 1, 1, 176, 0, 1.0, 4.0, 11.0, 0.0, 0.0, 0.0, 0.0)
    flying.until(lambda: flying.state == 23, 0.2)
    flying.step(1.1)
    assert flying.mavlink_messages("HEARTBEAT")[-1].custom_mode == 4 << 16 | 11 << 24


def test_two_checks_count_each_for_itself(px4):
    px4.register("A")
    px4.register("B", answers={"can_arm_and_run": False})
    px4.take_off()
    assert px4.choose(24) == REJECTED
    assert px4.choose(23) == 0


def test_a_check_without_a_mode_forbids_arming_in_every_mode_and_is_forgotten_when_silent(px4):
    reply = px4.register("Watcher", register_mode=False, answers={"can_arm_and_run": False})
    assert reply.mode_id == -1
    px4.step(1.0)
    assert px4.command(400, 1.0) == REJECTED
    px4.answers.clear()
    px4.until(lambda: px4.last("vehicle_status").pre_flight_checks_pass, 3.0)
    assert px4.command(400, 1.0) == 0


@pytest.mark.parametrize(
    "frame",
    [
        b"",
        b"trajectory_setpoint",
        b"trajectory_setpoint\0",
        b"trajectory_setpoint\0\x00\x01\x00\x00" + bytes(10),
        b"trajectory_setpoint\0\x00\x01\x00\x00" + bytes(80),
        b"vehicle_status\0\x00\x01\x00\x00" + bytes(200),
        b"\xff\xfe\0" + bytes(60),
        b"arming_check_reply\0" + bytes(3),
    ],
)
def test_samples_of_wrong_size_or_topic_are_counted_and_dropped(px4, frame):
    px4.send_bytes(frame)
    px4.step()
    counts = px4.vehicle.counters()["topics"]
    assert counts["samples"] == 0
    assert counts["wrong_size"] + counts["unknown_topic"] == 1
