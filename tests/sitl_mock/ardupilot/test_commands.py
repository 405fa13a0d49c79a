"""Commands that the ArduPilot flavours share."""

import math

import pytest


def place(flight, north, east):
    lat, lon, _ = flight.vehicle.autopilot.frame.to_geodetic(north, east, 0.0)
    return {"x": round(lat * 1e7), "y": round(lon * 1e7)}


def test_reposition_is_flown_in_guided_and_its_speed_is_not_looked_at(fly):
    flight = fly.airborne("arducopter", height=10.0)
    assert flight.command_int(192, 6, 2.0, 0.0, 0.0, 0.0, **place(flight, 15.0, -5.0), z=12.0) == [
        0
    ]
    fastest = 0.0
    for _ in range(250):
        flight.run(0.1)
        fastest = max(fastest, math.hypot(*flight.velocity[:2]))
    assert flight.position == pytest.approx((15.0, -5.0, -12.0), abs=0.5)
    assert fastest > 3.0


def test_reposition_changes_to_guided_only_when_asked_to(fly):
    flight = fly.airborne("arducopter", height=10.0)
    flight.command(176, 1, 17)
    assert flight.command_int(192, 6, -1.0, 0.0, 0.0, 0.0, **place(flight, 5.0, 0.0), z=10.0) == [2]
    assert flight.command_int(192, 6, -1.0, 1.0, 0.0, 0.0, **place(flight, 5.0, 0.0), z=10.0) == [0]
    assert flight.mode == "GUIDED"


@pytest.mark.parametrize("flavour", ["arducopter", "rover"])
def test_home_can_be_set_here_or_anywhere_on_earth(fly, flavour):
    flight = fly(flavour).run(1.0)
    assert flight.command(179, 1.0) == [0]
    assert flight.vehicle.autopilot.state.home_m == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    assert flight.command(179, 0.0, 0, 0, 0, 47.3978, 8.5456, 490.0) == [0]
    assert flight.vehicle.autopilot.state.home_m[2] == pytest.approx(-2.0, abs=0.01)
    assert flight.command(179, 0.0, 0, 0, 0, math.nan, 8.5456, 490.0) == [2]
    assert flight.command(179, 0.0, 0, 0, 0, 120.0, 8.5456, 490.0) == [2]


def test_termination_stops_the_motors(fly):
    flight = fly.airborne("arducopter", height=10.0)
    assert flight.command(185, 0.0) == [4]
    assert flight.vehicle.armed
    assert flight.command(185, 1.0) == [0]
    assert not flight.vehicle.armed


def test_reboot_fails_while_armed(fly):
    flight = fly("rover").run(1.0)
    flight.command(400, 1.0)
    assert flight.command(246, 1.0) == [4]
    flight.command(400, 0.0)
    assert flight.command(246, 1.0) == [0]
    flight.run(0.1)
    assert flight.vehicle.autopilot.boots == 2


@pytest.mark.parametrize(
    ("number", "params", "result"),
    [(178, (1.0, -1.0), 4), (224, (3.0,), 2), (31000, (), 3), (400, (7.0,), 3)],
)
def test_what_cannot_be_done_fails_or_is_unsupported(fly, number, params, result):
    assert fly("arducopter").run(1.0).command(number, *params) == [result]


def test_set_mode_message_and_the_pilots_switch_are_obeyed(fly):
    flight = fly.airborne("arducopter", height=5.0)
    flight.send("SET_MODE", 1, 1, 17)
    assert flight.mode == "BRAKE"
    flight.vehicle.inject("pilot_mode", "LOITER")
    flight.run(0.1)
    assert flight.mode == "LOITER"


def test_a_refused_mode_leaves_the_old_one(fly):
    flight = fly.airborne("arducopter", height=5.0)
    flight.vehicle.inject("offboard_refused", True)
    flight.command(176, 1, 17)
    assert flight.guided() == [4]
    assert flight.mode == "BRAKE"


def test_a_global_setpoint_is_flown_to(fly):
    flight = fly.airborne("arducopter", height=10.0)
    where = place(flight, -12.0, 4.0)
    flight.send(
        "SET_POSITION_TARGET_GLOBAL_INT", 0, 1, 1, 6, 0x0DF8, where["x"], where["y"], 14.0, *[0] * 8
    )
    flight.run(25.0)
    assert flight.position == pytest.approx((-12.0, 4.0, -14.0), abs=0.5)


@pytest.mark.parametrize("frame", [7, 9])
def test_an_offset_counts_from_here(fly, frame):
    flight = fly.airborne("arducopter", height=10.0)
    flight.send("SET_POSITION_TARGET_LOCAL_NED", 0, 1, 1, frame, 0x0DF8, 6.0, 0.0, -2.0, *[0] * 8)
    flight.run(15.0)
    assert flight.position == pytest.approx((6.0, 0.0, -12.0), abs=0.5)


def test_a_rover_flies_nothing_and_drives_by_stick(fly):
    flight = fly("rover").run(1.0)
    flight.command(400, 1.0)
    flight.vehicle.inject("sticks", (0.0, 0.0, 0.5, 0.0))
    flight.run(4.0)
    assert flight.velocity[0] > 0.5
    flight.vehicle.inject("sticks", (0.0, 0.0, 0.0, 0.0))
    flight.run(3.0)
    assert abs(flight.velocity[0]) < 0.05


def test_a_rover_drives_a_mission_and_holds_at_its_end(fly):
    flight = fly("rover").run(1.0)
    from sitl_mock.protocols import PlanItem, PlanKind

    points = [(0.0, 0.0), (8.0, 0.0), (8.0, 8.0)]
    items = []
    for seq, point in enumerate(points):
        where = place(flight, *point)
        items.append(PlanItem(seq, 3, 16, 0, 1, 0.0, 1.0, 0.0, 0.0, where["x"], where["y"], 0.0))
    flight.vehicle.autopilot.plans.set_plan(PlanKind.MISSION, items)
    flight.command(400, 1.0)
    assert flight.command(300) == [0]
    flight.until(lambda: flight.mode == "HOLD", 60.0)
    assert [m.seq for _, m in flight.all("MISSION_ITEM_REACHED")] == [1, 2]
    flight.run(3.0)
    assert math.dist(flight.position[:2], (8.0, 8.0)) < 2.0


def test_a_rover_stays_in_loiter_and_a_lost_radio_sends_it_home(fly, ned_velocity):
    flight = fly("rover").run(1.0)
    flight.guided()
    flight.command(400, 1.0)
    flight.run(6.0, ned_velocity(2.0, 0.0, 0.0))
    assert flight.command(176, 1, 5) == [0]
    flight.run(5.0)
    assert math.hypot(*flight.velocity) < 0.1
    flight.vehicle.inject("rc", True)
    flight.run(0.5)
    flight.vehicle.inject("rc", False)
    flight.run(1.0)
    assert flight.mode == "RTL"


@pytest.mark.parametrize(
    ("charge", "low", "critical", "mode"),
    [(0.12, 1, 2, "LAND"), (0.05, 0, 2, "RTL"), (0.05, 1, 2, "LAND")],
)
def test_battery_failsafes_do_what_their_parameters_say(fly, charge, low, critical, mode):
    flight = fly.airborne("arducopter", height=5.0)
    flight.change(BATT_FS_LOW_ACT=low, BATT_FS_CRT_ACT=critical)
    flight.vehicle.inject("battery", charge)
    flight.run(0.5)
    assert flight.mode == mode
    assert flight.vehicle.autopilot.commander.system_status == 5


def test_a_failsafe_on_the_ground_disarms(fly):
    flight = fly("arducopter").run(1.0)
    flight.command(400, 1.0)
    flight.vehicle.inject("estimator_invalid", True)
    flight.run(0.3)
    assert not flight.vehicle.armed


def test_a_target_above_terrain_stops_a_copter_that_has_no_data_of_it(fly):
    flight = fly.airborne("arducopter", height=10.0)
    there = (round(47.3980 * 1e7), round(8.545594 * 1e7), 15.0)
    for frame in (10, 11):
        flight.send("SET_POSITION_TARGET_GLOBAL_INT", 0, 1, 1, frame, 0xDF8, *there, *(0.0,) * 8)
        flight.run(8.0)
        assert flight.height == pytest.approx(10.0, abs=0.5)
        assert flight.command_int(192, frame, -1.0, 1.0, x=there[0], y=there[1], z=15.0) == [0]
        flight.run(8.0)
        assert flight.height == pytest.approx(10.0, abs=0.5)
    assert abs(flight.vehicle.truth.position_ned_m[0]) < 1.0


@pytest.mark.parametrize("number", [195, 201])
def test_the_nose_turns_to_a_region_of_interest_until_the_next_target(fly, number):
    flight = fly.airborne("arducopter", height=10.0)
    east = (47.397742, 8.545594 + 0.001, 488.0)
    assert flight.command(number, 0.0, 0.0, 0.0, 0.0, *east) == [0]
    flight.run(6.0)
    assert math.degrees(flight.vehicle.truth.yaw_rad) == pytest.approx(90.0, abs=3.0)
    assert flight.command(197, *(0.0,) * 7) == [0]
    target = ("SET_POSITION_TARGET_LOCAL_NED", 0, 1, 1, 1, 0xDF8, 20.0, 0.0, -10.0, *(0.0,) * 8)
    flight.send(*target)
    flight.run(6.0)
    assert math.degrees(flight.vehicle.truth.yaw_rad) == pytest.approx(0.0, abs=5.0)


def test_a_servo_is_set_on_a_free_output_only(fly):
    flight = fly("arducopter", ready_after_s=0.5, texts=True).run(1.0)
    assert [flight.command(183, float(channel), 1500.0) for channel in (1, 5, 9, 14, 17)] == [
        *([4], [0], [0], [0], [4]),
    ]
    flight.command(512, 36.0)
    outputs = flight.last("SERVO_OUTPUT_RAW")
    assert [getattr(outputs, f"servo{n}_raw") for n in (1, 5, 8, 9, 14)] == [
        *(1000, 1500, 0, 1500, 1500),
    ]
    texts = [message.text for _, message in flight.all("STATUSTEXT")]
    assert "ServoRelayEvent: Channel 1 is already in use" in texts


def test_the_banner_has_three_lines_and_comes_before_a_list_of_parameters(fly):
    flight = fly("arducopter", ready_after_s=0.5, texts=True).run(1.0)
    for ask in (lambda: flight.command(42428), lambda: flight.send("PARAM_REQUEST_LIST", 1, 1)):
        begun_s = flight.now_s
        ask()
        flight.run(0.5)
        lines = [message.text for _, message in flight.all("STATUSTEXT", begun_s)]
        assert lines[0].startswith("ArduCopter V4.5.7")
        assert [len(lines), len(lines[1]), lines[2]] == [3, 32, "Frame: QUAD/PLUS"]


def test_a_list_of_parameters_asked_of_another_vehicle_brings_no_banner(fly):
    flight = fly("arducopter", ready_after_s=0.5, texts=True).run(1.0)
    begun_s = flight.now_s
    for target in ((77, 1), (1, 100)):
        flight.send("PARAM_REQUEST_LIST", *target)
    flight.run(0.5)
    assert flight.all("STATUSTEXT", begun_s) == []
