"""Arming, take-off, hold, land and return of the PX4 flavour."""

import math

import pytest

from sitl_mock.px4.modes import BY_NAME

HOLD = 0x03040000
TAKEOFF = 0x02040000
LANDED = 1
FLYING = 2


def test_it_is_ready_to_arm_about_five_seconds_after_start(fly):
    flight = fly("px4", ready_after_s=None).run(4.5)
    assert flight.command(400, 1.0) == [1]
    assert not flight.last("SYS_STATUS").onboard_control_sensors_health & 1 << 28
    flight.run(1.0)
    assert flight.last("SYS_STATUS").onboard_control_sensors_health & 1 << 28
    assert flight.command(400, 1.0) == [0]


def test_refusals_are_silent_unless_texts_are_asked_for(fly):
    assert fly("px4", ready_after_s=5.0).run(1.0).texts() == []
    silent = fly("px4", ready_after_s=5.0)
    silent.command(400, 1.0)
    assert silent.texts() == []
    talking = fly("px4", ready_after_s=5.0, texts=True)
    talking.command(400, 1.0)
    assert talking.texts()[0] == "Arming denied: Resolve system health failures first"
    assert any(text.startswith("Preflight Fail:") for text in talking.texts())


def test_arming_refused_by_condition_says_the_reason(fly):
    flight = fly("px4", texts=True).run(1.0)
    flight.vehicle.inject("arm_refused", "Preflight Fail: Compass 0 fault")
    assert flight.command(400, 1.0) == [1]
    assert "Preflight Fail: Compass 0 fault" in flight.texts()
    flight.vehicle.inject("arm_refused", "")
    assert flight.command(400, 1.0) == [0]


@pytest.mark.parametrize("mode", [(4, 5), (4, 6)], ids=["RTL", "LAND"])
def test_it_does_not_arm_in_return_or_land(fly, mode):
    flight = fly("px4").run(1.0)
    flight.command(176, 1, *mode)
    assert flight.command(400, 1.0) == [1]


def test_arming_an_armed_vehicle_is_accepted_and_changes_nothing(fly):
    flight = fly("px4").run(1.0)
    assert flight.command(400, 1.0) == [0]
    armed_s = flight.vehicle.autopilot.state.armed_s
    assert flight.command(400, 1.0) == [0]
    assert flight.vehicle.autopilot.state.armed_s == armed_s


def test_it_disarms_by_itself_ten_seconds_after_arming_without_a_take_off(fly):
    flight = fly("px4").run(1.0)
    flight.command(400, 1.0)
    took_s = flight.until(lambda: not flight.vehicle.armed, 12.0)
    assert took_s == pytest.approx(10.0, abs=0.3)


def test_take_off_to_20_m_takes_about_17_s_and_ends_in_hold(fly):
    flight = fly("px4").run(1.0)
    flight.command(400, 1.0)
    start_s = flight.now_s
    assert flight.command(22, *[math.nan] * 6, 488.0 + 20.0) == [0]
    assert flight.vehicle.autopilot.commander.custom_mode == TAKEOFF
    flight.run(3.0)
    assert flight.last("EXTENDED_SYS_STATE").landed_state == 3
    flight.until(lambda: flight.mode == "HOLD", 25.0)
    assert flight.now_s - start_s == pytest.approx(17.0, abs=1.5)
    flight.run(5.0)
    assert flight.height == pytest.approx(20.0, abs=0.3)
    assert flight.last("EXTENDED_SYS_STATE").landed_state == FLYING
    assert flight.last("HEARTBEAT").custom_mode == HOLD
    assert flight.last("HEARTBEAT").base_mode == 157


@pytest.mark.parametrize(
    ("order_m", "rise_m"), [(0.3, 0.55), (3.0, 0.92), (6.0, 0.94), (9.0, 1.03)]
)
def test_land_ordered_in_the_climb_ends_it_within_the_measured_metre(fly, order_m, rise_m):
    """Catches a trajectory that is ahead of the climbing vehicle: it went on climbing, by up to 4.5 m."""
    flight = fly("px4").run(1.0)
    flight.command(400, 1.0)
    flight.command(22, *[math.nan] * 6, 488.0 + 15.0)
    flight.until(lambda: flight.height > order_m, 20.0)
    flight.command(21)
    highest_m = 0.0
    while flight.height > highest_m:
        highest_m = flight.height
        flight.run(0.02)
    assert highest_m - order_m == pytest.approx(rise_m, abs=0.15)


def test_take_off_without_a_height_uses_mis_takeoff_alt(fly):
    flight = fly("px4", parameters={"MIS_TAKEOFF_ALT": 4.0}).run(1.0)
    flight.command(400, 1.0)
    flight.command(22)
    flight.run(15.0)
    assert flight.height == pytest.approx(4.0, abs=0.3)


def test_nothing_moves_during_the_spool_up(fly):
    flight = fly("px4").run(1.0)
    flight.command(400, 1.0, wait_s=0.0)
    flight.command(22, wait_s=0.0)
    flight.run(0.95)
    assert flight.height == 0.0


def test_disarming_in_the_air_is_refused_and_forced_disarming_falls(fly):
    flight = fly.airborne("px4", texts=True)
    assert flight.command(400, 0.0) == [1]
    assert "Disarming denied: not landed" in flight.texts()
    assert flight.command(400, 0.0, 21196.0) == [0], "what MAVSDK's arm_force sends"
    assert not flight.vehicle.armed
    flight.run(5.0)
    assert flight.height == 0.0


def test_force_does_not_arm_past_the_checks(fly):
    flight = fly("px4", ready_after_s=5.0).run(1.0)
    assert flight.command(400, 1.0, 21196.0) == [1]


def test_landing_slows_down_near_the_ground_and_disarms(fly):
    flight = fly.airborne("px4", height=20.0)
    assert flight.command(21) == [0]
    flight.until(lambda: flight.height < 15.0, 20.0)
    assert flight.velocity[2] == pytest.approx(1.5, abs=0.1)
    flight.until(lambda: flight.height < 3.0, 20.0)
    assert flight.velocity[2] == pytest.approx(0.7, abs=0.1)
    assert flight.last("EXTENDED_SYS_STATE").landed_state == 4
    flight.until(lambda: flight.vehicle.truth.on_ground, 10.0)
    down_s = flight.now_s
    flight.until(lambda: not flight.vehicle.armed, 6.0)
    assert 4.6 <= flight.now_s - down_s <= 5.2, (
        "measured: 2.85 s until that counts as landed, and COM_DISARM_LAND"
    )
    flight.run(0.3)
    assert flight.last("EXTENDED_SYS_STATE").landed_state == LANDED


def test_return_climbs_crosses_descends_and_lands_at_home(fly):
    """Catches a return that is too low, or lands elsewhere."""
    flight = fly.airborne(
        "px4", parameters={"RTL_RETURN_ALT": 25.0, "RTL_DESCEND_ALT": 10.0}, height=5.0
    )
    lat, lon, alt = flight.vehicle.autopilot.frame.to_geodetic(60.0, 0.0, -5.0)
    assert flight.command_int(
        192, 0, -1.0, 1.0, 0.0, math.nan, x=round(lat * 1e7), y=round(lon * 1e7), z=alt
    ) == [0]
    flight.until(lambda: flight.position[0] > 59.0, 40.0)
    assert flight.command(20) == [0]
    highest = 0.0
    while flight.vehicle.armed:
        flight.run(0.2)
        highest = max(highest, flight.height)
        assert flight.now_s < 300.0
    assert highest == pytest.approx(25.0, abs=0.5)
    assert math.hypot(*flight.position[:2]) < 0.5


def test_reposition_needs_the_flag_to_change_to_hold(fly, ned_velocity):
    flight = fly.airborne("px4", height=10.0)
    stream = ned_velocity(0.0, 0.0, 0.0)
    flight.offboard(stream)
    lat, lon, alt = flight.vehicle.autopilot.frame.to_geodetic(10.0, 5.0, -12.0)
    place = {"x": round(lat * 1e7), "y": round(lon * 1e7), "z": alt}
    assert flight.command_int(192, 0, -1.0, 0.0, 0.0, math.nan, **place) == [3]
    assert flight.command_int(192, 0, -1.0, 1.0, 0.0, math.nan, **place) == [0]
    flight.run(15.0)
    assert flight.position == pytest.approx((10.0, 5.0, -12.0), abs=0.5)


def test_hold_stops_and_stays(fly, ned_velocity):
    stream = ned_velocity(5.0, 0.0, 0.0)
    flight = fly.airborne("px4").offboard(stream).run(8.0, stream)
    assert flight.command(176, 1, 4, 3) == [0, 0]
    flight.run(8.0)
    stopped = flight.position
    flight.run(20.0)
    assert math.dist(stopped, flight.position) < 1.0
    assert math.hypot(*flight.velocity) < 0.05


def test_heartbeat_rate_cannot_be_changed(fly):
    flight = fly("px4").run(1.0)
    assert flight.command(511, 0.0, 100000.0) == [4]


def test_termination_is_final(fly):
    flight = fly.airborne("px4", height=10.0)
    assert flight.command(185, 1.0) == [0]
    flight.run(4.0)
    assert flight.mode == "TERMINATION"
    assert flight.height == 0.0
    flight.run(6.0)
    assert not flight.vehicle.armed
    assert flight.command(176, 1, 4, 3)[-1] != 0
    assert flight.mode == "TERMINATION"


def test_the_simulator_does_not_restart_itself(fly):
    flight = fly("px4").run(1.0)
    assert [flight.command(246, choice) for choice in (0.0, 1.0, 2.0, 3.0)] == [[0], [2], [2], [2]]


@pytest.mark.parametrize(
    ("choice", "speed", "calibration"),
    [(2, 12.0, 0.0), (4, 12.0, 0.0), (3, 8.0, 0.0), (1, 8.0, 0.5)],
)
def test_preflight_storage_resets_what_its_first_parameter_says(fly, choice, speed, calibration):
    flight = fly("px4", parameters={"MPC_XY_VEL_MAX": 8.0, "CAL_GYRO0_XOFF": 0.5}).run(1.0)
    parameters = flight.vehicle.autopilot.parameters
    assert flight.command(245, choice) == [0]
    assert parameters["MPC_XY_VEL_MAX"] == speed
    assert parameters["CAL_GYRO0_XOFF"] == pytest.approx(calibration)
    assert parameters["MAV_SYS_ID"] == 1


def test_preflight_storage_is_refused_while_armed(fly):
    flight = fly.airborne("px4", height=5.0)
    assert flight.command(245, 2.0) == [1]


def test_set_mode_message_is_obeyed(fly):
    flight = fly.airborne("px4", height=5.0)
    flight.send("SET_MODE", 1, 1, 0x06040000)
    flight.run(0.1)
    assert flight.mode == "LAND"


def test_available_modes_are_the_real_ones_with_their_standard_modes(fly):
    flight = fly("px4").run(0.5)
    assert flight.command(512, 435.0, 0.0) == [0]
    listed = [m for _, m in flight.all("AVAILABLE_MODES")]
    assert [m.mode_index for m in listed] == list(range(1, 27))
    standard = {m.custom_mode: m.standard_mode for m in listed if m.standard_mode}
    names = {"ALTCTL": 4, "POSCTL": 1, "MISSION": 6, "RTL": 5, "TAKEOFF": 8, "LAND": 7, "ORBIT": 2}
    assert standard == {BY_NAME[name].number: value for name, value in names.items()}
    assert all(bool(m.mode_name) is not bool(m.standard_mode) for m in listed)
    known = {mode.number for mode in flight.vehicle.autopilot.flavour.modes.modes}
    assert known <= {m.custom_mode for m in listed}
    hidden = [m.custom_mode for m in listed if m.properties & 2]
    assert hidden[0] == BY_NAME["TERMINATION"].number
    assert len(hidden) == 9


@pytest.mark.parametrize(("mode", "standard"), [("HOLD", 0), ("POSCTL", 1)])
def test_current_mode_tells_the_standard_mode(fly, mode, standard):
    flight = fly.airborne("px4").change(COM_RC_IN_MODE=1)
    if mode == "POSCTL":
        flight.send("MANUAL_CONTROL", 1, 0, 0, 500, 0, *[0] * 11)
        flight.run(0.3)
        assert flight.command(176, 1, 3)[-1] == 0
    assert flight.command(512, 436.0) == [0]
    assert flight.last("CURRENT_MODE").standard_mode == standard


def test_a_command_for_another_vehicle_is_not_answered(fly):
    flight = fly("px4").run(1.0)
    assert flight.command(400, 1.0, target=(2, 1)) == []
    assert not flight.vehicle.armed


BATTERY = 100
MOTOR = 101
OFF = 1
WORKING = 0


def test_an_injected_failure_empties_the_battery_until_it_works_again(fly):
    flight = fly.airborne("px4", texts=True)
    before = len(flight.texts())
    assert flight.command(420, BATTERY, OFF, 0.0) == [0]
    flight.run(0.5)
    assert flight.last("SYS_STATUS").voltage_battery == 14400
    flight.until(lambda: flight.mode == "LAND", 10.0)
    assert flight.last("SYS_STATUS").battery_remaining <= 4
    assert flight.texts()[before:] == [
        "Low battery",
        "Critical battery",
        "Failsafe activated: entering Hold for 5 seconds",
        "Emergency battery level",
        "Failsafe activated",
    ]
    assert flight.command(420, BATTERY, WORKING, 0.0) == [0]
    flight.run(8.0)
    battery = flight.vehicle.autopilot.state.battery
    assert battery.remaining == pytest.approx(battery.charge, abs=0.02)


@pytest.mark.parametrize(("mode", "seconds"), [(0, math.inf), (1, 3.5)])
def test_a_stopped_motor_is_felt_if_the_allocation_cares(fly, mode, seconds):
    """On v1.17 the vehicle hovers on, or with CA_FAILURE_MODE falls from 19 m in 3.4 s."""
    flight = fly.airborne("px4").change(CA_FAILURE_MODE=mode)
    assert flight.command(420, MOTOR, OFF, 1) == [0]
    begun_s = flight.now_s
    while flight.height > 0.0 and flight.now_s < begun_s + 6.0:
        flight.run(0.1)
    if seconds == math.inf:
        assert flight.height == pytest.approx(20.0, abs=0.6)
    else:
        assert flight.now_s - begun_s == pytest.approx(seconds, abs=0.5)


@pytest.mark.parametrize(
    ("unit", "kind", "instance", "enabled", "answers"),
    [
        (BATTERY, OFF, 1, 1, [3]),
        (BATTERY, OFF, 0, 0, [2]),
        (BATTERY, 2, 0, 1, []),
        (MOTOR, OFF, 0, 1, [0]),
        (MOTOR, 2, 1, 1, [0]),
        (MOTOR, 3, 1, 1, [3]),
        (MOTOR, 7, 1, 1, [3]),
        (MOTOR, OFF, 9, 1, [3]),
        (MOTOR, OFF, 0, 0, [2]),
        (4, OFF, 0, 1, []),
    ],
)
def test_other_failures_are_answered_as_sih_does(fly, unit, kind, instance, enabled, answers):
    flight = fly("px4", parameters={"SYS_FAILURE_EN": enabled}).run(1.0)
    assert flight.command(420, unit, kind, instance) == answers
