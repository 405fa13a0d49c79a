"""OFFBOARD of the PX4 flavour, compared with measurements of PX4 v1.17."""

import itertools
import math

import pytest

OFFBOARD = 0x60000
RTL = 0x05040000


def test_without_a_stream_the_first_ack_lies_and_the_mode_stays(fly):
    flight = fly.airborne("px4")
    assert flight.command(176, 1, 6) == [0, 1]
    flight.run(1.5)
    assert flight.mode == "HOLD"


def test_disarmed_the_mode_is_accepted_without_a_stream_but_arming_is_not(fly):
    flight = fly("px4").run(1.0)
    assert flight.command(176, 1, 6) == [0, 0]
    assert flight.mode == "OFFBOARD"
    assert flight.command(400, 1.0) == [1]
    assert not flight.vehicle.armed


@pytest.mark.parametrize("phase_s", [0.0, 0.06])
def test_stream_loss_leads_to_return_after_1_s_and_the_heartbeat_says_so_in_2_s(
    fly, ned_velocity, phase_s
):
    flight = fly.airborne("px4").offboard(ned_velocity(2.0, 0.0, 0.0))
    flight.run(8.0 + phase_s, ned_velocity(2.0, 0.0, 0.0))
    last_s = flight.now_s
    held = flight.velocity[0]
    left_s = flight.until(lambda: flight.mode != "OFFBOARD", 1.5)
    assert flight.mode == "RTL"
    assert 1.0 <= left_s <= 1.13
    assert flight.velocity[0] == pytest.approx(held, abs=0.2), (
        "the last velocity is held until then"
    )
    flight.run(1.1)
    late_s = next(t for t, m in flight.all("HEARTBEAT", last_s) if m.custom_mode == RTL) - last_s
    assert left_s <= late_s <= 2.2
    assert flight.last("HEARTBEAT").system_status == 5


@pytest.mark.parametrize("action", [0, 5])
def test_px4_goes_back_to_offboard_by_itself_when_setpoints_return(fly, ned_velocity, action):
    flight = fly.airborne("px4").change(COM_OBL_RC_ACT=action)
    flight.offboard(ned_velocity(2.0, 0.0, 0.0)).run(3.0)
    assert flight.mode == {0: "RTL", 5: "HOLD"}[action]
    back_s = flight.until(lambda: flight.mode == "OFFBOARD", 1.0, ned_velocity(2.0, 0.0, 0.0))
    assert back_s <= 0.15


def test_the_intent_survives_return_landing_and_disarming(fly, ned_velocity):
    flight = fly.airborne("px4", height=10.0).offboard(ned_velocity(1.0, 0.0, 0.0))
    flight.until(lambda: not flight.vehicle.armed, 200.0)
    assert flight.last("HEARTBEAT").custom_mode in {OFFBOARD, RTL}
    flight.run(1.1)
    assert flight.last("HEARTBEAT").custom_mode == OFFBOARD


@pytest.mark.parametrize(
    ("action", "radio", "mode"),
    [
        (0, True, "POSCTL"),
        (1, True, "ALTCTL"),
        (2, True, "STABILIZED"),
        (3, False, "RTL"),
        (4, False, "LAND"),
        (5, False, "HOLD"),
        (6, False, "TERMINATION"),
        (7, False, "disarmed"),
    ],
)
def test_loss_action_is_what_com_obl_rc_act_says(fly, ned_velocity, action, radio, mode):
    flight = fly.airborne("px4").change(COM_OBL_RC_ACT=action)
    flight.vehicle.inject("rc", radio)
    flight.offboard(ned_velocity(1.0, 0.0, 0.0)).run(1.5)
    assert (flight.mode if flight.vehicle.armed else "disarmed") == mode


def test_one_hertz_holds_offboard_and_0_8_hertz_flips(fly, ned_velocity):
    stream = ned_velocity(1.0, 0.0, 0.0)
    flight = fly.airborne("px4").offboard(stream)
    modes = set()
    for _ in range(10):
        flight.run(0.98, None)
        flight.run(0.02, stream)
        modes.add(flight.mode)
    assert modes == {"OFFBOARD"}
    flown = []
    for _ in range(8):
        for _ in range(125 // 2):
            flight.run(0.02)
            flown.append(flight.mode)
        flight.run(0.02, stream)
        flown.append(flight.mode)
    flips = sum(a != b for a, b in itertools.pairwise(flown))
    assert set(flown) == {"OFFBOARD", "RTL"}
    assert 12 <= flips <= 17, "to RTL and back in every period"


def test_companion_heartbeats_do_not_matter_while_setpoints_go_on(fly, ned_velocity):
    flight = fly.airborne("px4")
    flight.run(2.0, ("HEARTBEAT", 18, 8, 0, 0, 4, 3), every_s=1.0)
    flight.offboard(ned_velocity(0.5, 0.0, 0.0)).run(15.0, ned_velocity(0.5, 0.0, 0.0))
    assert flight.mode == "OFFBOARD"


@pytest.mark.parametrize(
    "setpoint",
    [
        {"north": math.nan, "east": math.nan, "down": math.nan},
        {"north": 1.0, "east": 0.0, "down": 0.0, "mask": 0x0FFF},
        {"north": 1.0, "east": 0.0, "down": 0.0, "frame": 12},
        {"north": 1.0, "east": 0.0, "down": 0.0, "target": (7, 1)},
        {"north": 1.0, "east": 0.0, "down": 0.0, "mask": (2503 | 0x200) & ~0x1C0},
    ],
    ids=["nan", "all ignored", "frame 12", "another vehicle", "force in place of an acceleration"],
)
def test_what_is_no_setpoint_keeps_nothing_alive(fly, ned_velocity, setpoint):
    good = ned_velocity(1.0, 0.0, 0.0)
    bad = ned_velocity(
        setpoint.pop("north"), setpoint.pop("east"), setpoint.pop("down"), **setpoint
    )
    flight = fly.airborne("px4").offboard(good)
    flight.run(1.5, bad)
    assert flight.mode == "RTL"


def test_target_0_0_is_taken(fly, ned_velocity):
    stream = ned_velocity(2.0, 0.0, 0.0, target=(0, 0))
    flight = fly.airborne("px4").offboard(stream).run(6.0, stream)
    assert flight.mode == "OFFBOARD"
    assert flight.velocity[0] > 1.5


def test_body_frame_is_turned_by_the_heading(fly, ned_velocity):
    stream = ned_velocity(3.0, 0.0, 0.0, frame=8, yaw=math.pi / 2)
    flight = fly.airborne("px4", yaw_deg=90.0).offboard(stream).run(8.0, stream)
    assert flight.velocity[1] > 2.2
    assert abs(flight.velocity[0]) < 0.3


@pytest.mark.parametrize(
    ("mask", "velocity"),
    [(2503 | 0b100100, (2.0, 0.0, 0.0)), (2503, (2.0, math.nan, 0.0))],
    ids=["no vertical axis", "half of a pair"],
)
def test_an_incomplete_setpoint_keeps_offboard_and_does_not_move_silently(
    fly, ned_velocity, mask, velocity
):
    flight = fly.airborne("px4", texts=True)
    stream = ned_velocity(*velocity, mask=mask)
    flight.offboard(stream)
    before = flight.position
    said = len(flight.texts())
    flight.run(8.0, stream)
    assert flight.mode == "OFFBOARD"
    assert math.dist(flight.position, before) < 0.5
    assert len(flight.texts()) == said


def test_velocity_with_height_holds_the_height(fly):
    flight = fly.airborne("px4")
    stream = (
        "SET_POSITION_TARGET_LOCAL_NED",
        0,
        1,
        1,
        1,
        3555,
        0,
        0,
        -20.0,
        5.0,
        0.0,
        0.0,
        0,
        0,
        0,
        0,
        0,
    )
    flight.offboard(stream).run(3.0, stream)
    start = flight.position
    while flight.position[0] - start[0] < 50.0:
        flight.run(0.1, stream)
        assert abs(flight.position[2] + 20.0) < 0.3
    assert flight.mode == "OFFBOARD"


def test_a_setpoint_outside_offboard_is_proof_of_life_and_nothing_else(fly, ned_velocity):
    flight = fly.airborne("px4")
    before = flight.position
    flight.run(5.0, ned_velocity(5.0, 0.0, 0.0))
    assert flight.mode == "HOLD"
    assert math.dist(flight.position, before) < 0.5


def test_a_global_setpoint_is_flown_to(fly):
    flight = fly.airborne("px4")
    frame = flight.vehicle.autopilot.frame
    lat, lon, _ = frame.to_geodetic(30.0, -20.0, 0.0)
    stream = (
        "SET_POSITION_TARGET_GLOBAL_INT", 0, 1, 1, 6, 0x0DF8, round(lat * 1e7), round(lon * 1e7), 25.0,
        0, 0, 0, 0, 0, 0, 0, 0,
    )  # fmt: skip
    flight.offboard(stream).run(30.0, stream)
    assert flight.position == pytest.approx((30.0, -20.0, -25.0), abs=0.8)


def global_target(flight, frame, height):
    lat, lon, _ = flight.vehicle.autopilot.frame.to_geodetic(0.0, 0.0, 0.0)
    return (
        "SET_POSITION_TARGET_GLOBAL_INT", 0, 1, 1, frame, 0x0DF8, round(lat * 1e7), round(lon * 1e7), height,
        0, 0, 0, 0, 0, 0, 0, 0,
    )  # fmt: skip


@pytest.mark.parametrize(("home_m", "flown_m"), [(4.33, 7.66), (-2.63, 14.63)])
def test_a_relative_height_is_flown_with_the_sign_fault_of_px4(fly, home_m, flown_m):
    """12 m above home, which is above or below the origin: v1.17 flew to 7.87 and 14.87 m."""
    flight = fly.airborne("px4", height=12.0)
    lat, lon, alt = flight.vehicle.autopilot.frame.to_geodetic(0.0, 0.0, -home_m)
    assert flight.command(179, 0, 0, 0, math.nan, lat, lon, alt) == [0]
    stream = global_target(flight, 6, 12.0)
    flight.offboard(stream).run(12.0, stream)
    assert flight.height == pytest.approx(flown_m, abs=0.3)


def test_a_global_frame_that_px4_does_not_know_is_refused_with_a_text(fly):
    flight = fly.airborne("px4", texts=True)
    flight.send(*global_target(flight, 3, 12.0))
    flight.run(0.1)
    assert flight.texts()[-1] == "SET_POSITION_TARGET_GLOBAL_INT invalid coordinate frame 3"
    assert flight.last("STATUSTEXT").text == "frame 3\t"


def test_an_attitude_target_leans_and_climbs(fly):
    flight = fly.airborne("px4")
    lean = math.radians(10.0)
    level = (
        "SET_ATTITUDE_TARGET",
        0,
        1,
        1,
        7,
        (math.cos(-lean / 2), 0.0, math.sin(-lean / 2), 0.0),
        0,
        0,
        0,
        0.52,
    )
    flight.offboard(level).run(2.0, level)
    assert flight.mode == "OFFBOARD"
    assert flight.velocity[0] > 1.0, "nose down leans forward"


def test_a_pilot_in_posctl_is_not_fought_by_the_stream(fly, ned_velocity):
    flight = fly.airborne("px4")
    flight.vehicle.inject("rc", True)
    stream = ned_velocity(2.0, 0.0, 0.0)
    flight.offboard(stream).run(2.0, stream)
    flight.vehicle.inject("pilot_mode", "POSCTL")
    flight.run(5.0, stream)
    assert flight.mode == "POSCTL"
    assert math.hypot(*flight.velocity) < 0.5


def test_sticks_do_not_leave_offboard_unless_com_rc_override_says_so(fly, ned_velocity):
    """Catches sticks that take over whatever COM_RC_OVERRIDE says."""
    stream = ned_velocity(1.0, 0.0, 0.0)
    for override, mode in ((1, "OFFBOARD"), (3, "POSCTL")):
        flight = fly.airborne("px4").change(COM_RC_OVERRIDE=override)
        flight.vehicle.inject("rc", True)
        flight.offboard(stream).run(1.0, stream)
        flight.vehicle.inject("sticks", (0.0, 0.8, 0.0, 0.0))
        flight.run(1.0, stream)
        assert flight.mode == mode


def test_offboard_may_be_refused_by_condition(fly, ned_velocity):
    flight = fly.airborne("px4")
    flight.vehicle.inject("offboard_refused", True)
    flight.run(0.5, ned_velocity(1.0, 0.0, 0.0))
    assert flight.guided() == [0, 1]


def test_lost_position_estimate_counts_as_a_lost_stream(fly, ned_velocity):
    stream = ned_velocity(1.0, 0.0, 0.0)
    flight = fly.airborne("px4").offboard(stream)
    flight.vehicle.inject("gps_lost", True)
    flight.run(6.0, stream)
    assert flight.mode == "DESCEND"


def test_taking_off_by_thrust_alone_works_and_the_ground_holds_otherwise(fly):
    def thrust(share):
        return ("SET_ATTITUDE_TARGET", 0, 1, 1, 7, (1.0, 0.0, 0.0, 0.0), 0, 0, 0, share)

    flight = fly("px4").run(1.0)
    flight.offboard(thrust(0.4))
    flight.command(400, 1.0, wait_s=0.0)
    flight.run(2.0, thrust(0.4))
    assert flight.height == 0.0
    flight.run(4.0, thrust(0.6))
    assert flight.height > 1.0
