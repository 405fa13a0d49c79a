"""Differences between the mock and ArduCopter 4.5.7 that other clients found, row by row; all figures measured.

The rows are those of the comparison: 4 mission transfer, 5 guided items, 6 masks, 9 yaw, pause, modes and the mode
switch, 11 speeds, 12 accelerations, 13 take-off height, 23 unsolicited messages, 24 the state, 25 values, 26 the answer
to every command.
"""

import math

import pytest

MEASURED = {
    **dict.fromkeys(
        (
            17,
            20,
            21,
            85,
            115,
            179,
            181,
            182,
            195,
            197,
            198,
            201,
            202,
            203,
            206,
            207,
            208,
            209,
            216,
            300,
        ),
        0,
    ),
    **dict.fromkeys(
        (400, 401, 410, 510, 511, 512, 2001, 2520, 2600, 32000, 42001, 42002, 42003, 42006, 42424),
        0,
    ),
    **dict.fromkeys((42426, 42428, 42651), 0),
    **dict.fromkeys((32, 176, 224, 245, 532, 534, 42007, 42700), 2),
    **dict.fromkeys(
        (22, 84, 178, 183, 184, 185, 189, 193, 204, 205, 211, 218, 500, 520, 601, 1000, 1001, 2000),
        4,
    ),
    **dict.fromkeys((246, 2500, 2501, 10001, 42425, 42429, 42600), 4),
}
"""Result of each command with all parameters 0, on the ground, disarmed and ready; every other one is UNSUPPORTED."""
NEVER_ACCEPTED = 31010  # MAV_CMD_USER_1


def quaternion(pitch, yaw=0.0):
    half_p = 0.5 * pitch
    half_y = 0.5 * yaw
    return (
        math.cos(half_p) * math.cos(half_y),
        -math.sin(half_p) * math.sin(half_y),
        math.sin(half_p) * math.cos(half_y),
        math.cos(half_p) * math.sin(half_y),
    )


def attitude(pitch_deg, thrust, *, mask=7, yaw=0.0, yaw_rate=0.0):
    q = quaternion(math.radians(pitch_deg), yaw)
    return ("SET_ATTITUDE_TARGET", 0, 1, 1, mask, q, 0, 0, yaw_rate, thrust)


def goto(north, east, down):
    return (
        "SET_POSITION_TARGET_LOCAL_NED",
        0,
        1,
        1,
        1,
        0x0DF8,
        north,
        east,
        down,
        0,
        0,
        0,
        0,
        0,
        0,
        0,
        0,
    )


def accelerate(north, *, mask=0xC3F):
    return ("SET_POSITION_TARGET_LOCAL_NED", 0, 1, 1, 1, mask, 0, 0, 0, 0, 0, 0, north, 0, 0, 0, 0)


GROUND = (255, 190)
"""System and component id of a ground station; ArduPilot takes sticks from no other system id."""


def override(*pulses):
    return ("RC_CHANNELS_OVERRIDE", 1, 1, *pulses, *[0] * (8 - len(pulses)), *[0] * 10)


def heading(flight):
    return math.degrees(flight.vehicle.truth.yaw_rad)


def test_row_4_items_are_asked_for_with_mission_request(fly):
    flight = fly("arducopter").run(1.0)
    flight.send("MISSION_COUNT", 1, 1, 1, 0)
    assert flight.last("MISSION_REQUEST").seq == 0
    assert flight.last("MISSION_REQUEST_INT") is None


@pytest.mark.parametrize("asked", ["MISSION_REQUEST", "MISSION_REQUEST_INT"])
def test_row_4_item_0_is_home_in_an_empty_mission_too(fly, asked):
    flight = fly("arducopter").run(1.0)
    flight.send("MISSION_REQUEST_LIST", 1, 1, 0)
    assert flight.last("MISSION_COUNT").count == 0
    flight.send(asked, 1, 1, 0, 0)
    item = flight.last("MISSION_ITEM" if asked == "MISSION_REQUEST" else "MISSION_ITEM_INT")
    home = flight.last("HOME_POSITION")
    scale = 1e7 if asked == "MISSION_REQUEST" else 1
    assert (item.seq, item.command, item.frame) == (0, 16, 0)
    assert item.x * scale == pytest.approx(home.latitude, abs=50)
    assert item.z == pytest.approx(home.altitude * 1e-3, abs=0.01)
    flight.send(asked, 1, 1, 1, 0)
    assert flight.last("MISSION_ACK").type != 0


@pytest.mark.parametrize("current", [2, 3])
def test_row_5_a_mission_item_with_current_2_is_flown_to_and_with_3_has_no_effect(fly, current):
    flight = fly.airborne("arducopter", height=10.0)
    lat, lon, _ = flight.vehicle.autopilot.frame.to_geodetic(20.0, 5.0, 0.0)
    flight.send("MISSION_ITEM", 1, 1, 0, 3, 16, current, 0, 0, 0, 0, 0, lat, lon, 12.0, 0)
    assert flight.last("MISSION_ACK").type == 0
    flight.run(20.0)
    wanted = (20.0, 5.0, -12.0) if current == 2 else (0.0, 0.0, -10.0)
    assert flight.position == pytest.approx(wanted, abs=0.5)


def test_row_5_outside_of_guided_it_is_an_error(fly):
    flight = fly("arducopter").run(1.0)
    flight.send("MISSION_ITEM", 1, 1, 0, 3, 16, 2, 0, 0, 0, 0, 0, 47.0, 8.0, 12.0, 0)
    assert flight.last("MISSION_ACK").type == 1


def test_row_6_a_velocity_with_the_force_bit_beside_it_is_flown(fly, ned_velocity):
    flight = fly.airborne("arducopter", height=10.0)
    flight.run(5.0, ned_velocity(2.0, 0.0, 0.0, mask=0xFC7))
    assert flight.position[0] == pytest.approx(8.2, abs=0.8)


def test_row_6_a_force_is_ignored(fly):
    flight = fly.airborne("arducopter", height=10.0)
    flight.run(3.0, accelerate(1.0, mask=0xE3F))
    assert math.hypot(*flight.velocity) < 0.1


def test_row_9_the_nose_turns_as_condition_yaw_says(fly):
    flight = fly.airborne("arducopter", height=10.0)
    assert flight.command(115, 90.0, 20.0, 1.0, 0.0) == [0]
    flight.run(1.9)
    assert heading(flight) == pytest.approx(40.0, abs=8.0)
    flight.run(5.0)
    assert heading(flight) == pytest.approx(90.0, abs=2.0)
    assert flight.command(115, 45.0, 0.0, -1.0, 1.0) == [0]
    flight.run(4.0)
    assert heading(flight) == pytest.approx(45.0, abs=2.0)
    assert flight.command(115, 400.0) == [4]


def test_row_9_the_long_way_round_is_turned_when_the_direction_says_so(fly):
    flight = fly.airborne("arducopter", height=10.0)
    flight.command(115, 60.0, 60.0, -1.0, 0.0)
    flight.run(2.0)
    assert heading(flight) < -60.0
    flight.run(4.0)
    assert heading(flight) == pytest.approx(60.0, abs=3.0)


def test_row_9_a_guided_flight_pauses_and_goes_on(fly):
    flight = fly.airborne("arducopter", height=10.0)
    flight.send(*goto(-40.0, 0.0, -10.0))
    flight.run(3.5)
    paused_at = flight.position[0]
    assert flight.command(193, 0.0) == [0]
    flight.run(5.0)
    assert math.hypot(*flight.velocity) < 0.25
    assert flight.position[0] < paused_at - 4.0, "it brakes, it does not jump"
    assert flight.command(193, 1.0) == [0]
    flight.run(12.0)
    assert flight.position[0] == pytest.approx(-40.0, abs=0.5)
    assert flight.command(193, 7.0) == [2]


def test_row_9_what_cannot_be_paused_says_so(fly):
    flight = fly("arducopter").run(1.0)
    assert flight.command(193, 0.0) == [4]
    assert "Failed to pause" in flight.texts()


ACCEPTED_ON_THE_GROUND = {0, 1, 2, 3, 4, 5, 6, 7, 9, 11, 16, 17, 18, 19, 20, 21, 24}


def test_row_9_the_ground_accepts_the_modes_that_the_real_one_accepts(fly):
    flight = fly("arducopter").run(1.0)
    answers = {mode: flight.command(176, 1, mode, wait_s=0.02) for mode in range(31)}
    assert answers == {mode: [0 if mode in ACCEPTED_ON_THE_GROUND else 4] for mode in range(31)}


def test_row_9_circle_goes_round_a_point_ahead_with_the_nose_to_it(fly):
    flight = fly.airborne("arducopter", source=GROUND, yaw_deg=180.0, height=20.0)
    middle = override(1500, 1500, 1500, 1500)
    flight.send(*middle)
    flight.run(0.1)
    assert flight.command(176, 1, 7) == [0]
    entered_s = flight.now_s
    places = []
    speeds = []
    while flight.now_s < entered_s + 19.0:
        flight.send(*middle)
        flight.run(0.5)
        places.append(flight.position)
        speeds.append(math.hypot(*flight.velocity[:2]))
    away = [math.dist(place[:2], (-10.0, 0.0)) for place in places[8:]]
    assert min(away) > 9.0
    assert max(away) < 10.6
    assert max(speeds[16:]) == pytest.approx(3.4, abs=0.1)
    assert flight.height == pytest.approx(20.0, abs=0.3)
    north, east, _ = flight.position
    to_centre = math.degrees(math.atan2(-east, -10.0 - north))
    assert abs(math.remainder(heading(flight) - to_centre, 360.0)) < 15.0


def test_row_9_the_mode_switch_on_channel_5_chooses_the_mode_of_its_position(fly):
    flight = fly.airborne("arducopter", source=GROUND, height=20.0)
    for pulse, mode in ((1300, "LAND"), (1700, "LOITER"), (1100, "CIRCLE")):
        flight.send(*override(1500, 1500, 1500, 1500, pulse))
        flight.run(0.5)
        assert flight.mode == mode


def test_row_9_a_switch_that_does_not_move_does_not_fight_a_client(fly):
    flight = fly.airborne("arducopter", source=GROUND, height=20.0)
    flight.send(*override(1500, 1500, 1500, 1500, 1700))
    flight.run(0.5)
    flight.guided()
    flight.send(*override(1500, 1500, 1500, 1500, 1700))
    flight.run(0.5)
    assert flight.mode == "GUIDED"


def test_row_9_loiter_climbs_beyond_the_dead_band_and_sinks_without_override(fly):
    flight = fly.airborne("arducopter", source=GROUND, height=30.0)
    flight.command(176, 1, 5)
    for _ in range(5):
        flight.send(*override(1500, 1500, 1700, 1500))
        flight.run(0.7)
    assert flight.velocity[2] == pytest.approx(-0.62, abs=0.1)
    flight.run(6.0)
    assert flight.velocity[2] == pytest.approx(2.42, abs=0.2)
    assert flight.mode == "LOITER", "an override that ends is no lost radio"


def test_row_9_a_throttle_below_the_failsafes_value_is_a_lost_radio(fly):
    flight = fly.airborne("arducopter", source=GROUND, height=20.0)
    flight.send(*override(1500, 1500, 900, 1500))
    flight.run(0.5)
    assert flight.mode == "RTL"


def test_row_11_a_changed_speed_is_flown_until_the_kind_of_flight_changes(fly, ned_velocity):
    flight = fly.airborne("arducopter", height=10.0)
    flight.send(*goto(60.0, 0.0, -10.0))
    flight.run(1.0)
    assert flight.command(178, 1.0, 1.0) == [0]
    flight.run(6.0)
    assert flight.velocity[0] == pytest.approx(1.0, abs=0.05)
    flight.command(178, 1.0, 5.0)
    flight.run(4.0)
    assert flight.velocity[0] > 4.5
    flight.run(3.0, ned_velocity(0.0, 0.0, 0.0))
    flight.send(*goto(-60.0, 0.0, -10.0))
    flight.run(6.0)
    assert flight.velocity[0] < -6.0, "a velocity in between has forgotten the speed"


def test_row_11_the_climb_has_a_speed_of_its_own(fly):
    flight = fly.airborne("arducopter", height=10.0)
    flight.send(*goto(0.0, 0.0, -20.0))
    assert flight.command(178, 2.0, 1.0) == [0]
    flight.run(5.0)
    assert flight.velocity[2] == pytest.approx(-0.98, abs=0.1)


def test_row_12_an_acceleration_is_kept_while_it_is_sent_and_ends_with_the_timeout(fly):
    flight = fly.airborne("arducopter", height=10.0)
    flight.run(2.0, accelerate(1.0))
    assert flight.velocity[0] == pytest.approx(1.9, abs=0.25)
    flight.run(2.5)
    assert flight.velocity[0] > 3.8
    flight.run(5.0)
    assert abs(flight.velocity[0]) < 0.3


@pytest.mark.parametrize("noise", [False, True])
def test_row_13_a_take_off_to_10_m_hovers_above_9_9(fly, noise):
    flight = fly.airborne("arducopter", noise=noise, height=10.0)
    flight.run(6.0)
    assert 9.9 < flight.height < 10.1


def test_row_13_the_take_off_takes_as_long_as_the_real_one(fly):
    flight = fly("arducopter").run(1.0)
    flight.guided()
    flight.command(400, 1.0)
    flight.run(0.5)
    flight.command(22, 0, 0, 0, 0, 0, 0, 10.0)
    assert flight.until(lambda: flight.height > 9.5, 20.0) == pytest.approx(8.2, abs=1.2)


def test_row_23_home_and_origin_come_unasked_when_they_are_set_and_at_arming(fly):
    flight = fly("arducopter").run(2.0)
    assert [len(flight.all(name)) for name in ("HOME_POSITION", "GPS_GLOBAL_ORIGIN")] == [1, 1]
    flight.guided()
    flight.command(400, 1.0)
    assert [len(flight.all(name)) for name in ("HOME_POSITION", "GPS_GLOBAL_ORIGIN")] == [2, 2]
    flight.run(10.0)
    assert len(flight.all("HOME_POSITION")) == 2


def test_row_24_the_state_is_standby_until_airborne_and_again_after_landing(fly):
    flight = fly("arducopter").run(1.1)
    flight.guided()
    flight.command(400, 1.0)
    flight.run(3.0)
    assert flight.last("HEARTBEAT").base_mode & 128
    assert flight.last("HEARTBEAT").system_status == 3
    flight.command(22, 0, 0, 0, 0, 0, 0, 5.0)
    flight.run(5.0)
    assert flight.last("HEARTBEAT").system_status == 4
    flight.command(21)
    flight.until(lambda: not flight.vehicle.armed, 40.0)
    flight.run(1.1)
    assert flight.last("HEARTBEAT").system_status == 3


def test_row_25_the_fix_is_6(fly):
    flight = fly("arducopter").run(1.0)
    flight.command(512, 24.0)
    assert flight.last("GPS_RAW_INT").fix_type == 6


def test_row_26_every_command_is_answered_as_the_real_one_answers_it(fly):
    """Known commands each get a fresh vehicle, because they may change it; unknown ones change nothing."""
    others = {
        *range(1, 700),
        2000,
        2003,
        2510,
        2800,
        3000,
        4001,
        5000,
        30001,
        31000,
        NEVER_ACCEPTED,
        43003,
    }
    answered = {
        number: fly("arducopter").run(1.0).command(number, wait_s=0.02) for number in MEASURED
    }
    same = fly("arducopter").run(1.0)
    answered |= {number: same.command(number, wait_s=0.02) for number in others - MEASURED.keys()}
    assert len(answered) >= 705
    expected = {number: [MEASURED.get(number, 3)] for number in answered}
    assert answered == expected


def test_attitude_targets_lean_and_the_thrust_is_a_climb_about_one_half(fly):
    flight = fly.airborne("arducopter", height=10.0)
    flight.run(3.0, attitude(-20.0, 0.5))
    assert flight.velocity[0] == pytest.approx(6.26, abs=0.8)
    assert flight.height == pytest.approx(10.0, abs=0.2)
    flight.run(2.0, attitude(0.0, 0.6))
    assert flight.velocity[2] == pytest.approx(-0.5, abs=0.1)
    flight.run(8.0)
    assert abs(flight.velocity[2]) < 0.1, "the climb ends with the timeout"
    flight.run(3.0, attitude(0.0, 0.4))
    assert flight.velocity[2] == pytest.approx(0.3, abs=0.1)


def test_attitude_targets_take_off_and_turn_without_a_position(fly):
    flight = fly("arducopter").run(1.0)
    assert flight.command(176, 1, 20) == [0]
    assert flight.command(400, 1.0) == [0]
    flight.run(6.0, attitude(0.0, 0.7, yaw=math.pi / 2))
    assert flight.height > 2.0
    assert heading(flight) == pytest.approx(90.0, abs=3.0)


@pytest.mark.parametrize(
    ("params", "results", "text"),
    [
        ((1.0,), [0], "Initialising ArduPilot"),
        ((0, 0, 1.0), [5, 0], "Barometer calibration complete"),
        ((0, 0, 0, 0, 1.0), [0], "Place vehicle level and press any key."),
        ((0, 0, 0, 0, 2.0), [0], "Trim OK: roll=0.01 pitch=-0.00 yaw=0.00"),
        ((0, 0, 0, 0, 4.0), [1], ""),
        ((0, 1.0), [3], ""),
    ],
)
def test_row_14_calibrations_are_answered_with_the_real_ones_texts(fly, params, results, text):
    flight = fly("arducopter").run(1.0)
    assert flight.command(241, *params, wait_s=1.5) == results
    assert not text or text in flight.texts()


def test_row_14_nothing_is_calibrated_while_armed(fly):
    flight = fly.airborne("arducopter", height=5.0)
    assert flight.command(42424) == [4]
    assert "Disarm to allow compass calibration" in flight.texts()
