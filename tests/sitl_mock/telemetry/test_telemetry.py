"""Every offered message: it can be requested, packs in every state, and is true."""

import math

import pytest
from pymavlink.dialects.v20 import all as dialect

from sitl_mock.flavours import NAMES, flavour_named
from sitl_mock.mavlink import SPEC_BY_NAME
from sitl_mock.telemetry import builders_of
from sitl_mock.telemetry.on_request import nothing
from tests.witness import page
from tests.witness.cases import ALL_INTERVALS, ALL_STREAMS

ASKED_OTHERWISE = {"PING", "TIMESYNC", "AVAILABLE_MODES"}


def offered(flavour):
    """The messages that a flavour can send."""
    return set(builders_of(flavour)) - flavour_named(flavour).withheld


def ask(flight, name):
    """REQUEST_MESSAGE; the message, or the refusal."""
    before = len(flight.all(name))
    (result,) = flight.command(512, float(SPEC_BY_NAME[name].message_id))
    came = flight.all(name)
    return came[-1][1] if result == 0 and len(came) > before else result


def without_content(flight, flavour, state):
    """The messages that have nothing to tell in a state."""
    nowhere = {name for name, build in builders_of(flavour).items() if build is nothing}
    if state == "booting":
        nowhere |= {"HOME_POSITION", "GPS_GLOBAL_ORIGIN"}
    if flavour == "px4":
        nowhere |= {"RC_CHANNELS"}
        if state == "booting":
            nowhere |= {"OPEN_DRONE_ID_SYSTEM"}
        if state in {"booting", "standing"}:
            nowhere |= {"POSITION_TARGET_GLOBAL_INT"}
    else:
        nowhere |= {"FENCE_STATUS"}
        if state == "booting":
            nowhere |= {"TERRAIN_REQUEST"}
        if flight.vehicle.mode != "GUIDED":
            nowhere |= {"POSITION_TARGET_LOCAL_NED"}
        goal_north_m = flight.vehicle.autopilot.report.setpoint.position_ned_m[0]
        if not flight.vehicle.armed or math.isnan(goal_north_m):
            nowhere |= {"POSITION_TARGET_GLOBAL_INT"}
    return nowhere


@pytest.mark.parametrize("flavour", NAMES)
@pytest.mark.parametrize("state", ["booting", "standing", "moving", "blind"])
def test_every_offered_message_can_be_had_in_every_state(fly, ned_velocity, flavour, state):
    """Catches a message that is offered and cannot be sent in some state."""
    flight = fly(flavour, ready_after_s=0.5 if state != "booting" else 100.0).run(1.0)
    if state in {"moving", "blind"}:
        if flavour == "rover":
            flight.guided()
            flight.command(400, 1.0)
            flight.run(3.0, ned_velocity(1.0, 1.0, 0.0))
        else:
            flight.airborne(5.0)
    if state == "blind":
        flight.vehicle.inject("gps_lost", True)
        flight.vehicle.inject("fence_breach", True)
        flight.run(1.0)
    nowhere = without_content(flight, flavour, state)
    for name in sorted(offered(flavour) - ASKED_OTHERWISE - nowhere):
        assert not isinstance(ask(flight, name), int), name
    for name in nowhere - ASKED_OTHERWISE:
        assert isinstance(ask(flight, name), int), f"there is no {name} to tell"
    assert all(link.unsendable == 0 for link in flight.vehicle.links.values())


@pytest.mark.parametrize("flavour", NAMES)
def test_every_stream_can_be_set_and_asked_for(fly, flavour):
    flight = fly(flavour).run(1.0)
    unlisted = flavour_named(flavour).stream_rules.unlisted
    for name in sorted(offered(flavour) - unlisted - {"HEARTBEAT"}):
        message_id = float(SPEC_BY_NAME[name].message_id)
        assert flight.command(511, message_id, 200_000.0, wait_s=0.02) == [0], name
        assert flight.command(510, message_id, wait_s=0.02) == [0]
        assert flight.last("MESSAGE_INTERVAL").interval_us == 200_000


@pytest.mark.parametrize("flavour", ["px4", "arducopter"])
def test_the_intervals_are_accepted_that_the_real_autopilot_accepts(fly, flavour):
    flight = fly(flavour).run(1.0)
    real = page.read()[flavour][ALL_INTERVALS]["real"]
    accepted = [
        str(number)
        for number in sorted(dialect.mavlink_map)
        if flight.command(511, float(number), 0.0, wait_s=0.02) == [0]
    ]
    assert f"{len(accepted)} accepted: {', '.join(accepted)}" == real


@pytest.mark.parametrize("flavour", ["px4", "arducopter"])
def test_the_messages_come_on_the_ground_that_come_from_the_real_autopilot(fly, flavour):
    flight = fly(flavour).run(2.0)
    accepted = [
        number
        for number in sorted(dialect.mavlink_map)
        if flight.command(511, float(number), 200_000.0, wait_s=0.02) == [0]
    ]
    begun_s = flight.now_s
    flight.run(2.0)
    came = {SPEC_BY_NAME[name].message_id for name in flight.counts(begun_s)}
    real = page.read()[flavour][ALL_STREAMS]["real"]
    assert ", ".join(str(number) for number in accepted if number in came) == real


def test_px4_sends_the_simulators_truth_if_a_client_wants_it(fly):
    flight = fly("px4").run(1.0)
    assert flight.command(511, 115.0, 100_000.0) == [0]
    flight.run(1.0)
    sent = flight.last("HIL_STATE_QUATERNION")
    origin = flight.vehicle.autopilot.state.frame.origin
    assert sent.alt == pytest.approx(origin.alt_amsl_m * 1e3, abs=100.0)
    assert (sent.time_usec, sent.attitude_quaternion[0]) == (0, pytest.approx(1.0, abs=0.1))


@pytest.mark.parametrize("name", ["PROTOCOL_VERSION", "HIGHRES_IMU", "FLIGHT_INFORMATION"])
def test_arducopter_fails_to_send_what_the_real_one_does_not_know(fly, name):
    assert ask(fly("arducopter").run(1.0), name) == 4


def test_an_unknown_message_is_refused(fly):
    flight = fly("px4").run(1.0)
    assert flight.command(512, 12921.0)[0] != 0
    assert flight.command(511, 12921.0, 1e5)[0] != 0
    assert flight.command(512, math.nan)[0] != 0
    assert flight.command(511, math.nan, 1e5)[0] != 0
    assert flight.command(510, math.nan)[0] != 0


def test_attitude_says_the_same_as_angles_and_as_a_quaternion(fly, ned_velocity):
    flight = fly.airborne("px4", yaw_deg=70.0)
    flight.offboard(ned_velocity(4.0, 0.0, 0.0)).run(1.0, ned_velocity(4.0, 0.0, 0.0))
    turn = ask(flight, "ATTITUDE_QUATERNION")
    angles = flight.last("ATTITUDE")
    w = turn.q1
    x = turn.q2
    y = turn.q3
    z = turn.q4
    assert math.hypot(w, x, y, z) == pytest.approx(1.0, abs=1e-6)
    assert math.asin(2.0 * (w * y - z * x)) == pytest.approx(angles.pitch, abs=0.05)
    assert math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)) == pytest.approx(
        angles.yaw, abs=0.05
    )


def test_heights_agree(fly):
    flight = fly.airborne("px4", height=12.0)
    altitude = ask(flight, "ALTITUDE")
    hud = ask(flight, "VFR_HUD")
    place = ask(flight, "GLOBAL_POSITION_INT")
    assert altitude.altitude_relative == pytest.approx(flight.height, abs=0.1)
    assert altitude.altitude_amsl == pytest.approx(488.0 + flight.height, abs=0.1)
    assert hud.alt == pytest.approx(altitude.altitude_amsl, abs=0.1)
    assert place.relative_alt == pytest.approx(flight.height * 1000.0, abs=100)


def test_the_target_reported_is_the_setpoint_in_force(fly, ned_velocity):
    flight = (
        fly.airborne("px4")
        .offboard(ned_velocity(1.5, -0.5, 0.25))
        .run(1.0, ned_velocity(1.5, -0.5, 0.25))
    )
    target = ask(flight, "POSITION_TARGET_LOCAL_NED")
    assert (target.vx, target.vy, target.vz) == pytest.approx((1.5, -0.5, 0.25))
    assert math.isnan(target.x)


def test_receiver_and_estimate_part_by_the_estimators_error(fly):
    flight = fly.airborne("px4")
    flight.vehicle.inject("ekf_jump_m", (10.0, 0.0, 0.0))
    flight.run(0.02)
    receiver = ask(flight, "GPS_RAW_INT")
    estimate = ask(flight, "GLOBAL_POSITION_INT")
    assert (estimate.lat - receiver.lat) * 1e-7 * 111_194.0 == pytest.approx(10.0, abs=0.6)


def test_the_radio_is_reported_while_it_is_there(fly):
    flight = fly("px4").run(1.0)
    assert ask(flight, "RC_CHANNELS") == 2
    flight.send("RC_CHANNELS_OVERRIDE", 1, 1, 1700, 1400, 1600, 1500, *[65535] * 14)
    channels = ask(flight, "RC_CHANNELS")
    assert channels.chancount == 8
    assert channels.chan1_raw == 1700
    assert flight.last("SYS_STATUS") is not None
    flight.run(0.3)
    assert ask(flight, "SYS_STATUS").onboard_control_sensors_health & 0x10000
    flight.run(1.0)
    assert not ask(flight, "SYS_STATUS").onboard_control_sensors_health & 0x10000


def test_pulses_that_are_none_are_no_radio(fly):
    flight = fly("px4").run(1.0)
    flight.send("RC_CHANNELS_OVERRIDE", 1, 1, 0, 65535, 1500, 1500, *[65535] * 14)
    flight.send("MANUAL_CONTROL", 1, 5000, 0, 500, 0, 0, 0, 0, *[0] * 8)
    assert not flight.vehicle.autopilot.state.pilot.known


@pytest.mark.parametrize("remaining", [0.9, 0.12, 0.06, 0.03])
def test_the_battery_says_how_bad_it_is(fly, remaining):
    flight = fly("px4").run(1.0)
    flight.vehicle.inject("battery", remaining)
    flight.run(0.1)
    battery = ask(flight, "BATTERY_STATUS")
    assert battery.battery_remaining == pytest.approx(remaining * 100.0, abs=1.0)
    assert battery.charge_state == {0.9: 1, 0.12: 2, 0.06: 3, 0.03: 4}[remaining]


def test_wind_is_reported_from_where_it_comes(fly):
    flight = fly("arducopter").run(1.0)
    flight.vehicle.inject("wind_m_s", (0.0, 6.0, 0.0))
    flight.run(0.1)
    wind = ask(flight, "WIND")
    assert (wind.direction, wind.speed) == pytest.approx((270.0, 6.0))


def test_wind_and_gusts_push(fly):
    flight = fly.airborne("arducopter", seed=3, height=10.0)
    flight.vehicle.inject("wind_m_s", (8.0, 0.0, 0.0))
    flight.vehicle.inject("gust_m_s", 2.0)
    flight.run(5.0)
    tilts = [abs(m.pitch) for _, m in flight.all("ATTITUDE")] or [
        abs(ask(flight, "ATTITUDE").pitch)
    ]
    assert max(tilts) > 0.01, "leans into the wind"
    flight.vehicle.inject("gust_m_s", 0.0)
    flight.run(1.0)
    assert flight.mode == "GUIDED"
