"""The ArduCopter flavour, compared with measurements of ArduCopter 4.5.7."""

import math
import statistics

import pytest


def position(z, *, mask=0x0DF8, frame=1):
    return (
        "SET_POSITION_TARGET_LOCAL_NED",
        0,
        1,
        1,
        frame,
        mask,
        10.0,
        5.0,
        z,
        0,
        0,
        0,
        0,
        0,
        0,
        0,
        0,
    )


def test_only_heartbeats_are_sent_until_a_stream_is_asked_for(fly):
    flight = fly("arducopter").run(5.0)
    told_once = {"HOME_POSITION", "GPS_GLOBAL_ORIGIN"}
    assert {m.get_type() for _, m in flight.heard} - told_once <= {
        "HEARTBEAT",
        "TIMESYNC",
        "STATUSTEXT",
    }
    assert all(len(flight.all(name)) == 1 for name in told_once)
    assert flight.command(511, 32.0, 20000.0) == [0]
    start_s = flight.now_s
    flight.run(10.0)
    assert len(flight.all("LOCAL_POSITION_NED", start_s)) == pytest.approx(500, abs=2)


def test_it_can_be_armed_about_39_s_after_boot(fly):
    flight = fly("arducopter", ready_after_s=None).run(38.0)
    assert flight.command(400, 1.0) == [4]
    assert "Arm: Need Position Estimate" in flight.texts()
    flight.run(1.5)
    assert flight.command(400, 1.0) == [0]


def test_guided_is_accepted_at_boot_with_one_honest_ack(fly):
    flight = fly("arducopter", ready_after_s=39.0).run(0.5)
    assert flight.guided() == [0]
    assert flight.last("HEARTBEAT") is not None
    flight.run(1.0)
    assert flight.last("HEARTBEAT").custom_mode == 4


def test_a_mode_that_does_not_exist_is_failed(fly):
    flight = fly("arducopter").run(1.0)
    assert flight.command(176, 1, 99) == [4]


def test_a_velocity_does_not_take_off(fly, ned_velocity):
    flight = fly("arducopter").run(1.0)
    flight.guided()
    flight.command(400, 1.0)
    flight.run(5.0, ned_velocity(0.0, 0.0, -2.0))
    assert flight.height == 0.0


def test_take_off_needs_armed_and_guided_and_a_relative_frame(fly):
    flight = fly("arducopter").run(1.0)
    assert flight.command(22, 0, 0, 0, 0, 0, 0, 10.0) == [4]
    flight.guided()
    flight.command(400, 1.0)
    assert flight.command_int(22, 0, z=10.0) == [2]
    assert flight.command_int(22, 3, z=10.0) == [0]
    flight.run(15.0)
    assert flight.height == pytest.approx(10.0, abs=0.6)
    assert flight.command(22, 0, 0, 0, 0, 0, 0, 20.0) == [4], "already in the air"


def test_stream_loss_holds_then_brakes_and_stays_guided_without_a_word(fly, ned_velocity):
    flight = fly.airborne("arducopter")
    stream = ned_velocity(5.0, 0.0, 0.0)
    flight.run(8.0, stream)
    said = len(flight.texts())
    speed = flight.velocity[0]
    flight.run(2.9)
    assert flight.velocity[0] == pytest.approx(speed, abs=0.1)
    flight.run(0.8)
    assert flight.velocity[0] < speed - 0.1, "braking from 3.2 to 3.5 s"
    flight.run(2.3)
    assert abs(flight.velocity[0]) < 0.5, "stopped at about 5.7 s"
    flight.run(2.0)
    assert flight.mode == "GUIDED"
    assert len(flight.texts()) == said
    flight.run(3.0, stream)
    assert flight.velocity[0] > 3.5, "and resumes at once"


def test_guid_timeout_is_a_parameter(fly, ned_velocity):
    flight = fly.airborne("arducopter").change(GUID_TIMEOUT=0.5)
    flight.run(6.0, ned_velocity(3.0, 0.0, 0.0))
    flight.run(3.0)
    assert abs(flight.velocity[0]) < 0.5


def test_nan_brakes_at_once(fly, ned_velocity):
    flight = fly.airborne("arducopter")
    flight.run(8.0, ned_velocity(5.0, 0.0, 0.0))
    flight.run(2.9, ned_velocity(math.nan, 0.0, 0.0))
    assert abs(flight.velocity[0]) < 0.5


@pytest.mark.parametrize(
    "setpoint", [{"frame": 12}, {"target": (7, 1)}], ids=["frame 12", "another vehicle"]
)
def test_what_is_for_others_is_ignored(fly, ned_velocity, setpoint):
    flight = fly.airborne("arducopter")
    flight.run(3.0, ned_velocity(3.0, 0.0, 0.0, **setpoint))
    assert math.hypot(*flight.velocity) < 0.2


@pytest.mark.parametrize(
    ("frame", "north", "east"), [(1, 3.0, 0.0), (7, 3.0, 0.0), (8, 0.0, 3.0), (9, 0.0, 3.0)]
)
def test_frames_1_7_8_and_9_are_taken_and_body_frames_turn(fly, ned_velocity, frame, north, east):
    flight = fly.airborne("arducopter", yaw_deg=90.0)
    # A body's is relative
    stream = ned_velocity(3.0, 0.0, 0.0, frame=frame, yaw=0.0 if frame in {8, 9} else math.pi / 2)
    flight.run(6.0, stream)
    assert flight.velocity[0] == pytest.approx(north, abs=0.3)
    assert flight.velocity[1] == pytest.approx(east, abs=0.3)


@pytest.mark.parametrize("mask", [0x0FFF, 2503 | 0b100000], ids=["nothing", "one axis ignored"])
def test_a_mask_that_makes_no_sense_stops(fly, ned_velocity, mask):
    flight = fly.airborne("arducopter")
    flight.run(6.0, ned_velocity(4.0, 0.0, 0.0))
    flight.run(3.0, ned_velocity(4.0, 0.0, 0.0, mask=mask))
    assert abs(flight.velocity[0]) < 0.6


def test_speeds_beyond_the_limits_are_flown(fly, ned_velocity):
    """WPNAV_SPEED does not hold in GUIDED: the client has to clamp."""
    flight = fly.airborne("arducopter").change(WPNAV_SPEED=500.0)
    flight.run(20.0, ned_velocity(9.0, 0.0, 0.0))
    assert flight.velocity[0] > 8.0


def test_a_position_is_flown_to_and_outlives_the_timeout(fly):
    flight = fly.airborne("arducopter")
    flight.send(*position(-15.0))
    flight.run(25.0)
    assert flight.position == pytest.approx((10.0, 5.0, -15.0), abs=0.5)


def test_setpoints_count_in_guided_only(fly, ned_velocity):
    flight = fly.airborne("arducopter")
    flight.command(176, 1, 17)
    flight.run(4.0, ned_velocity(4.0, 0.0, 0.0))
    assert flight.mode == "BRAKE"
    assert abs(flight.velocity[0]) < 0.2


def test_brake_stops_within_three_seconds(fly, ned_velocity):
    flight = fly.airborne("arducopter")
    flight.run(8.0, ned_velocity(5.0, 0.0, 0.0))
    assert flight.command(176, 1, 17) == [0]
    flight.run(2.9)
    assert math.hypot(*flight.velocity) < 0.6


def test_loiter_without_a_radio_sinks_at_2_4_m_s(fly):
    flight = fly.airborne("arducopter", height=40.0)
    assert flight.command(176, 1, 5) == [0]
    flight.run(6.0)
    assert flight.velocity[2] == pytest.approx(2.4, abs=0.2)


def test_return_climbs_to_rtl_alt_comes_home_and_disarms(fly):
    flight = fly.airborne("arducopter", height=5.0)
    flight.send(*position(-5.0))
    flight.run(15.0)
    assert flight.command(20) == [0]
    highest = 0.0
    while flight.vehicle.armed:
        flight.run(0.2)
        highest = max(highest, flight.height)
        assert flight.now_s < 200.0
    assert highest == pytest.approx(15.0, abs=0.6)
    assert math.hypot(*flight.position[:2]) < 0.6


def test_landing_is_slow_below_ten_metres_and_disarms(fly):
    flight = fly.airborne("arducopter", height=15.0)
    assert flight.command(21) == [0]
    flight.until(lambda: flight.height < 6.0, 30.0)
    assert flight.velocity[2] == pytest.approx(0.5, abs=0.1)
    flight.until(lambda: not flight.vehicle.armed, 30.0)
    assert flight.height == 0.0


def test_it_disarms_by_itself_after_disarm_delay(fly):
    flight = fly("arducopter").run(1.0)
    flight.guided()
    flight.command(400, 1.0)
    assert flight.until(lambda: not flight.vehicle.armed, 12.0) == pytest.approx(10.0, abs=0.3)


@pytest.mark.parametrize(("mode", "name"), [(6, "RTL"), (9, "LAND"), (17, "BRAKE")])
def test_modes_that_cannot_be_armed_in(fly, mode, name):
    flight = fly("arducopter").run(1.0)
    assert flight.command(176, 1, mode) == [0]
    assert flight.command(400, 1.0) == [4]
    assert f"Arm: {name} mode not armable" in flight.texts()


@pytest.mark.parametrize("magic", [2989.0, 21196.0])
def test_arming_can_be_forced_past_the_checks(fly, magic):
    flight = fly("arducopter", ready_after_s=39.0).run(1.0)
    assert flight.command(400, 1.0, magic) == [0]


def test_disarming_in_the_air_fails_unless_forced(fly):
    flight = fly.airborne("arducopter", height=5.0)
    assert flight.command(400, 0.0) == [4]
    assert flight.command(400, 0.0, 21196.0) == [0]


def test_a_lost_radio_returns_for_good(fly):
    flight = fly.airborne("arducopter")
    flight.vehicle.inject("rc", True)
    flight.run(0.5)
    flight.vehicle.inject("rc", False)
    flight.run(1.0)
    assert flight.mode == "RTL"
    flight.vehicle.inject("rc", True)
    flight.run(1.0)
    assert flight.mode == "RTL"


@pytest.mark.parametrize(("action", "mode"), [(0, "GUIDED"), (1, "RTL"), (5, "LAND")])
def test_a_lost_ground_station_does_what_fs_gcs_enable_says(fly, action, mode):
    flight = fly.airborne("arducopter", source=(255, 190)).change(FS_GCS_ENABLE=action)
    flight.send("HEARTBEAT", 6, 8, 0, 0, 4, 3)
    flight.run(5.5)
    assert flight.mode == mode


def test_only_the_ground_station_of_sysid_mygcs_can_be_lost(fly):
    flight = fly.airborne("arducopter", source=(255, 190))
    flight.change(FS_GCS_ENABLE=1, SYSID_MYGCS=200)
    flight.send("HEARTBEAT", 6, 8, 0, 0, 4, 3)
    flight.run(6.0)
    assert flight.mode == "GUIDED"


@pytest.mark.parametrize("sticks", ["override", "manual control"])
@pytest.mark.parametrize(("system_id", "heard"), [(255, True), (1, False), (254, False)])
def test_sticks_count_only_from_the_system_id_of_sysid_mygcs(fly, sticks, system_id, heard):
    flight = fly("arducopter", source=(system_id, 190)).run(1.0)
    if sticks == "override":
        flight.send("RC_CHANNELS_OVERRIDE", 1, 1, 1500, 1500, 1700, 1500, *[0] * 14)
    else:
        flight.send("MANUAL_CONTROL", 1, 0, 0, 700, 0, *[0] * 11)
    assert flight.vehicle.autopilot.state.pilot.known is heard


def test_a_lost_estimate_lands(fly):
    flight = fly.airborne("arducopter")
    flight.vehicle.inject("estimator_invalid", True)
    flight.run(0.5)
    assert flight.mode == "LAND"


def test_a_fence_returns(fly, ned_velocity):
    flight = fly.airborne("arducopter", height=10.0).change(FENCE_ENABLE=1, FENCE_RADIUS=30.0)
    flight.until(lambda: flight.position[0] > 31.0, 30.0, ned_velocity(5.0, 0.0, 0.0))
    flight.run(0.2)
    assert flight.mode == "RTL"


def test_targets_beyond_the_fence_are_refused_and_the_last_one_is_kept(fly):
    """Measured: messages without a word, DO_REPOSITION FAILED without a change of the mode, an item with an error."""
    flight = fly.airborne("arducopter", height=10.0)
    flight.change(FENCE_ENABLE=1, FENCE_RADIUS=40.0, FENCE_ALT_MAX=20.0)
    lat, lon, _ = flight.vehicle.autopilot.frame.to_geodetic(60.0, 0.0, 0.0)
    place = {"x": round(lat * 1e7), "y": round(lon * 1e7), "z": 10.0}
    flight.send(*position(-10.0))
    flight.send(*position(-30.0))
    flight.send(*position(-10.0)[:6], 60.0, *position(-10.0)[7:])
    assert flight.command_int(192, 6, -1.0, **place) == [4]
    flight.send("MISSION_ITEM", 1, 1, 0, 3, 16, 2, 0, 0, 0, 0, 0, lat, lon, 10.0, 0)
    flight.run(6.0)
    assert flight.last("MISSION_ACK").type == 1
    assert flight.position == pytest.approx((10.0, 5.0, -10.0), abs=0.5)
    flight.command(176, 1, 5)
    assert flight.command_int(192, 6, -1.0, 1.0, **place) == [4]
    assert flight.mode == "LOITER"


def test_a_take_off_through_the_fence_is_accepted_and_returns(fly):
    flight = fly("arducopter", parameters={"FENCE_ENABLE": 1, "FENCE_ALT_MAX": 12.0}).run(0.5)
    flight.command(176, 1, 4)
    flight.command(400, 1)
    assert flight.command(22, 0, 0, 0, 0, 0, 0, 20.0) == [0]
    flight.until(lambda: flight.mode == "RTL", 20.0)
    assert 12.0 < flight.height < 14.0


def test_prearm_checks_are_told_on_request(fly):
    flight = fly("arducopter", ready_after_s=10.0).run(1.0)
    assert flight.command(401) == [0]
    assert "PreArm: Need Position Estimate" in flight.texts()


NO_FIX = "GPS 1: Bad fix"
NO_HOME = "AHRS: waiting for home"
NO_AREA = "Fences enabled, but none selected"
NOWHERE = "Fence requires position"


@pytest.mark.parametrize("mode", ["STABILIZE", "ALT_HOLD", "GUIDED"])
@pytest.mark.parametrize(
    ("kinds", "words"), [(0, []), (1, []), (2, [NOWHERE]), (4, [NO_AREA]), (7, [NOWHERE])]
)
def test_a_fence_needs_a_position_as_on_the_real_one(fly, mode, kinds, words):
    """As measured on ArduCopter 4.5.7 before its home was set, and with its GPS off; 0: without a fence."""
    number = {"STABILIZE": 0, "ALT_HOLD": 2, "GUIDED": 4}[mode]
    fence = {"FENCE_ENABLE": int(kinds > 0), "FENCE_TYPE": kinds or 7}
    flight = fly("arducopter", parameters=fence, ready_after_s=3.0).run(0.5)
    flight.command(176, 1, number)
    if kinds > 1 and mode != "GUIDED":
        assert refusals(flight) == [NO_HOME, *words]
    flight.run(4.0)
    flight.vehicle.inject("gps_lost", True)
    flight.until(lambda: not flight.vehicle.autopilot.state.estimator.position_valid, 60.0)
    without = refusals(flight)
    if kinds > 1 or mode == "GUIDED":
        assert without == [NO_FIX, *words]
    else:
        assert without == []


def refusals(flight):
    """Try to arm; the texts of why not."""
    before = len(flight.texts())
    result = flight.command(400, 1.0)
    flight.run(0.1)
    told = [text.removeprefix("Arm: ") for text in flight.texts()[before:] if "Arm: " in text]
    assert result == ([4] if told else [0])
    return told


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"ANGLE_MAX": 100}, "Check ANGLE_MAX"),
        ({"FS_THR_VALUE": 900}, "Check FS_THR_VALUE"),
        ({"ACRO_BAL_ROLL": 9}, "Check ACRO_BAL_ROLL/PITCH"),
        ({"PILOT_SPEED_UP": 0}, "Check PILOT_SPEED_UP"),
    ],
)
def test_prearm_checks_name_a_bad_parameter_and_arming_is_refused(fly, parameters, text):
    flight = fly("arducopter").run(1.0)
    for name, value in parameters.items():
        flight.vehicle.autopilot.parameters.set(name, value)
    assert flight.command(401) == [0]
    assert flight.texts()[-1] == f"PreArm: {text}"
    assert flight.command(400, 1.0) == [4]
    assert f"Arm: {text}" in flight.texts()
    flight.vehicle.autopilot.parameters.set("ARMING_CHECK", 0)
    assert flight.command(400, 1.0) == [0]
    assert flight.command(401) == [1], "refused while armed"


def test_a_removed_value_of_fs_gcs_enable_is_reported_but_does_not_refuse_arming(fly):
    flight = fly("arducopter").run(1.0)
    flight.vehicle.autopilot.parameters.set("FS_GCS_ENABLE", 2)
    assert flight.command(401) == [0]
    assert flight.texts()[-1] == "PreArm: FS_GCS_ENABLE=2 removed, see FS_OPTIONS"
    assert flight.command(400, 1.0) == [0]
    assert "Arm: FS_GCS_ENABLE=2 removed, see FS_OPTIONS" in flight.texts()


@pytest.mark.parametrize(("north_m", "highest_m"), [(0.0, 6.0), (3.0, 9.0)])
def test_close_to_home_the_return_climbs_by_the_cone_of_rtl_cone_slope(fly, north_m, highest_m):
    flight = fly.airborne("arducopter", height=6.0)
    flight.send("SET_POSITION_TARGET_LOCAL_NED", 0, 1, 1, 1, 0x0DF8, north_m, 0.0, -6.0, *[0] * 8)
    flight.run(20.0)
    assert flight.command(20) == [0]
    highest = 0.0
    while highest < flight.height + 1.0:
        flight.run(0.2)
        highest = max(highest, flight.height)
        assert flight.now_s < 200.0
    assert highest == pytest.approx(highest_m, abs=0.6)


def test_the_estimators_flags_are_those_that_ardupilots_tests_wait_for(fly):
    flight = fly("arducopter", ready_after_s=1.0).run(0.5)
    flight.command(512, 193.0)
    assert not flight.last("EKF_STATUS_REPORT").flags & 256
    flight.run(1.0)
    flight.command(512, 193.0)
    assert flight.last("EKF_STATUS_REPORT").flags == 831


def test_a_reset_of_the_parameters_takes_effect_at_the_next_boot(fly):
    flight = fly("arducopter", parameters={"WPNAV_SPEED": 700.0}, system_id=1).run(1.0)
    parameters = flight.vehicle.autopilot.parameters
    assert flight.command(245, 2.0) == [0]
    assert flight.texts()[-1] == "All parameters reset, reboot board"
    assert parameters["WPNAV_SPEED"] == 700.0
    assert flight.command(246, 1.0) == [0]
    flight.run(1.0)
    assert parameters["WPNAV_SPEED"] == parameters.definitions["WPNAV_SPEED"].default


def test_sys_status_and_battery_are_those_of_the_real_simulator(fly):
    """Present, enabled and health, volts, centiamperes: as ArduCopter 4.5.7 sent them."""

    def told(flight):
        flight.command(512, 1)
        status = flight.last("SYS_STATUS")
        return (
            hex(status.onboard_control_sensors_present),
            hex(status.onboard_control_sensors_enabled),
            hex(status.onboard_control_sensors_health),
            status.voltage_battery,
        )

    flight = fly("arducopter").run(1.0)
    assert told(flight) == ("0x5371fc2f", "0x52619c2f", "0x57719c2f", 12600)
    flight.vehicle.autopilot.parameters.set("FENCE_ENABLE", 1)
    assert told(flight) == ("0x5371fc2f", "0x52719c2f", "0x57719c2f", 12600)
    flight = fly.airborne("arducopter", parameters={"FENCE_ENABLE": 1}, height=10.0)
    assert told(flight) == ("0x5371fc2f", "0x5371fc2f", "0x5771fc2f", 12600)
    assert flight.last("SYS_STATUS").current_battery == pytest.approx(2811, abs=15)
    flight.vehicle.autopilot.parameters.set("FENCE_ALT_MAX", 8.0)
    flight.run(0.5)
    assert told(flight)[2] == "0x5761fc2f"
    flight.command(512, 162)
    assert flight.last("FENCE_STATUS").breach_status == 1


def test_the_estimate_on_the_ground_is_never_quite_still(fly):
    """Standard deviations on the real one: 1.2e-5 rad, 2.4e-4 m, 2.6e-4 m/s, 0.33 mrad/s."""
    flight = fly("arducopter", noise=True)
    for message in (30, 32, 27):
        flight.command(511, message, 20_000)
    flight.run(5.0)
    for name, field, sd in (
        ("ATTITUDE", "roll", 1.2e-5),
        ("LOCAL_POSITION_NED", "x", 2.5e-4),
        ("LOCAL_POSITION_NED", "vx", 2.5e-4),
        ("RAW_IMU", "xgyro", 0.33),
    ):
        values = [getattr(message, field) for _, message in flight.all(name)]
        assert statistics.pstdev(values) == pytest.approx(sd, rel=0.35), (name, field)
