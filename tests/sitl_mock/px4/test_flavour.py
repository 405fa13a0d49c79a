"""PX4 v1.17 against the mock, by row of the list of differences that other people's clients found."""

import itertools
import json
import math
import statistics
from collections import Counter
from pathlib import Path

import pytest

from sitl_mock import MockVehicle
from sitl_mock.mavlink import Decoder
from sitl_mock.px4.events import event_id

NAN = math.nan
REAL_ACKS = json.loads((Path(__file__).parents[2] / "data" / "px4_acks.json").read_text())
"""Answers of PX4 v1.17 (SIH) on the ground to every command of MAVLink's common set, parameters zero."""


def armed(fly, **settings):
    """Ready, and armed in Hold on the ground."""
    flight = fly("px4", **settings)
    flight.until(lambda: flight.vehicle.autopilot.commander.ready_to_arm, 10.0)
    assert flight.command(400, 1.0) == [0]
    return flight


def degrees(flight, north, east):
    """A place as COMMAND_INT's x and y."""
    lat, lon, _ = flight.vehicle.autopilot.frame.to_geodetic(north, east, 0.0)
    return {"x": round(lat * 1e7), "y": round(lon * 1e7)}


def amsl(flight, height):
    return flight.vehicle.autopilot.frame.origin.alt_amsl_m + height


def sticks(pitch=0, roll=0, throttle=500, yaw=0):
    """MANUAL_CONTROL as MAVSDK sends it."""
    return ("MANUAL_CONTROL", 1, pitch, roll, throttle, yaw, *[0] * 11)


@pytest.mark.parametrize("phase_s", [0.0, 0.02, 0.04, 0.06, 0.08])
def test_row_01_a_setpoint_and_the_mode_request_at_once_are_enough(fly, ned_velocity, phase_s):
    flight = fly.airborne("px4", height=10.0)
    flight.run(phase_s)
    flight.send(*ned_velocity(1.0, 0.0, 0.0))
    assert flight.guided() == [0, 0]
    assert flight.mode == "OFFBOARD"


def test_row_01_set_start_arm_as_the_examples_do_flies(fly, ned_velocity):
    flight = armed(fly)
    flight.send(*ned_velocity(0.0, 0.0, 0.0))
    assert flight.guided() == [0, 0]
    flight.run(1.0, ned_velocity(0.0, 0.0, 0.0), every_s=0.06)
    flight.run(6.0, ned_velocity(0.0, 0.0, -1.0), every_s=0.06)
    assert flight.mode == "OFFBOARD"
    assert flight.height > 2.5


def test_row_02_goto_from_the_ground_flies_there(fly):
    flight = armed(fly)
    assert flight.command_int(
        192, 0, -1.0, 1.0, 0.0, NAN, **degrees(flight, 15.0, 0.0), z=amsl(flight, 10.0)
    ) == [0]
    flight.run(20.0)
    assert flight.position == pytest.approx((15.0, 0.0, -10.0), abs=0.6)
    assert flight.mode == "HOLD"


def test_row_02_a_goto_that_does_not_climb_stays_on_the_ground_until_it_disarms(fly):
    flight = armed(fly)
    assert flight.command_int(
        192, 0, -1.0, 1.0, 0.0, NAN, **degrees(flight, 15.0, 0.0), z=amsl(flight, 0.1)
    ) == [0]
    flight.run(12.5)
    assert flight.height == 0.0
    assert not flight.vehicle.armed


def test_row_02_the_throttle_stick_takes_off_above_65_percent(fly):
    flight = fly("px4").run(1.0)
    flight.run(1.0, sticks(), every_s=0.1)
    assert flight.command(176, 1, 3) == [0, 0]
    flight.run(0.2, sticks(), every_s=0.1)
    assert flight.command(400, 1.0) == [0]
    flight.run(3.0, sticks(throttle=620), every_s=0.1)
    assert flight.height == 0.0
    flight.run(6.0, sticks(throttle=800), every_s=0.1)
    assert flight.height > 2.0
    flight.run(4.0, sticks(), every_s=0.1)
    stood = flight.height
    flight.run(3.0, sticks(pitch=800), every_s=0.1)
    assert flight.mode == "POSCTL"
    assert flight.velocity[0] > 2.0
    assert flight.height == pytest.approx(stood, abs=0.4)


@pytest.mark.parametrize(
    "setpoint",
    [
        ("SET_POSITION_TARGET_LOCAL_NED", 0, 1, 1, 1, 2552, 0, 0, -5.0, 0, 0, 0, 0, 0, 0, 0, 0),
        ("SET_POSITION_TARGET_LOCAL_NED", 0, 1, 1, 8, 1479, 0, 0, 0, 0, 0, -1.0, 0, 0, 0, 0, 0),
        ("SET_POSITION_TARGET_LOCAL_NED", 0, 1, 1, 1, 3135, 0, 0, 0, 0, 0, 0, 0, 0, -1.0, 0, 0),
        ("SET_ATTITUDE_TARGET", 0, 1, 1, 7, [1, 0, 0, 0], 0, 0, 0, 0.6),
        ("SET_ATTITUDE_TARGET", 0, 1, 1, 128, [1, 0, 0, 0], 0, 0, 0, 0.6),
    ],
    ids=["position", "velocity in the body's axes", "acceleration", "attitude", "body rates"],
)
def test_row_02_setpoints_of_any_kind_lift_off(fly, setpoint):
    flight = armed(fly)
    flight.send(*setpoint)
    assert flight.guided() == [0, 0]
    flight.run(8.0, setpoint, every_s=0.06)
    assert flight.height > 2.0
    assert flight.mode == "OFFBOARD"


def test_row_03_a_mission_without_a_takeoff_climbs_first_and_is_flown(fly):
    flight = fly("px4").run(1.0)
    corners = [(20.0, 0.0, 10.0), (20.0, 20.0, 15.0), (0.0, 20.0, 10.0)]
    flight.send("MISSION_COUNT", 1, 1, 3, 0)
    for seq, (north, east, height) in enumerate(corners):
        place = degrees(flight, north, east)
        where = (place["x"], place["y"], height)
        flight.send(
            "MISSION_ITEM_INT", 1, 1, seq, 6, 16, int(seq == 0), 1, 0.0, 0.0, 0.0, NAN, *where, 0
        )
    assert flight.last("MISSION_ACK").type == 0
    assert flight.command(400, 1.0) == [0]
    assert flight.command(176, 1, 4, 4) == [0, 0]
    flight.until(lambda: flight.height > 9.0, 25.0)
    assert math.hypot(*flight.position[:2]) < 1.0, "straight up first"
    flight.until(lambda: flight.mode == "HOLD", 60.0)
    assert [m.seq for _, m in flight.all("MISSION_ITEM_REACHED")] == [0, 1, 2]
    for north, east, height in corners:
        nearest = min(
            math.dist((m.x, m.y, m.z), (north, east, -height))
            for _, m in flight.all("LOCAL_POSITION_NED")
        )
        assert nearest < 2.2


def test_row_06_bit_9_beside_a_velocity_is_flown(fly, ned_velocity):
    stream = ned_velocity(1.0, 0.0, 0.0, mask=0xFC7)
    flight = fly.airborne("px4", height=10.0).offboard(stream).run(8.0, stream)
    assert flight.mode == "OFFBOARD"
    assert flight.velocity[0] == pytest.approx(0.9, abs=0.12), "measured 0.83"


def hovering(fly, seed, **settings):
    """A PX4 with its usual noise, 20 m up."""
    return fly.airborne("px4", noise=True, seed=seed, **settings, height=20.0)


@pytest.mark.parametrize("seed", [1, pytest.param(3, marks=pytest.mark.long)])
def test_row_07_home_jumps_in_height_in_flight_and_nothing_else_of_it_does(fly, ned_velocity, seed):
    """Catches a home that rests where PX4's jumps by metres."""
    flight = hovering(fly, seed)
    begun_s = flight.now_s
    flight.offboard(ned_velocity(1.0, 0.0, 0.0)).run(40.0, ned_velocity(1.0, 0.0, 0.0))
    homes = [m for _, m in flight.all("HOME_POSITION", begun_s)]
    heights = [m.altitude for m in homes]
    jumps = [abs(b - a) for a, b in itertools.pairwise(heights)]
    assert len(set(heights)) >= 0.4 * len(heights), "recorded: 46 values in 98 messages"
    assert 1000 <= max(heights) - min(heights) <= 4000, "recorded: 488.0 to 490.5 m"
    assert 700 <= max(jumps) <= 3000
    assert len({(m.latitude, m.longitude, m.x, m.y) for m in homes}) == 1
    origin_mm = round(flight.vehicle.autopilot.frame.origin.alt_amsl_m * 1e3)
    assert all(abs(m.altitude - (origin_mm - m.z * 1e3)) <= 1.0 for m in homes), (
        "x, y, z say the same"
    )
    assert [m.time_usec for m in homes] == sorted(m.time_usec for m in homes)
    places = [m for _, m in flight.all("GLOBAL_POSITION_INT", begun_s)]
    assert max(abs(b.alt - a.alt) for a, b in itertools.pairwise(places)) < 200
    relative = [m.relative_alt for m in places]
    assert max(abs(b - a) for a, b in itertools.pairwise(relative)) > 900, (
        "heights above home jump along"
    )


@pytest.mark.long
def test_row_07_two_minutes_after_leaving_the_ground_home_stays(fly):
    flight = hovering(fly, 4).run(130.0)
    settled_s = flight.now_s
    flight.run(30.0)
    assert len({m.altitude for _, m in flight.all("HOME_POSITION", settled_s)}) == 1
    assert len({m.altitude for _, m in flight.all("HOME_POSITION")}) > 10


def test_row_07_the_local_frame_stays_and_equal_seeds_wander_equally(fly):
    """Catches an origin that wanders with home."""
    flights = [hovering(fly, seed).run(10.0) for seed in (5, 5, 6)]
    origins = []
    for flight in flights:
        flight.command(512, 49.0)
        origins.append(flight.last("GPS_GLOBAL_ORIGIN"))
    assert len({(m.latitude, m.longitude, m.altitude) for m in origins}) == 1
    first, same, other = (
        [m.altitude for _, m in flight.all("HOME_POSITION")] for flight in flights
    )
    assert first == same
    assert first != other


def test_row_07_home_is_set_at_arming_and_take_off_unless_a_command_has_set_it(fly):
    flight = fly("px4", noise=True, seed=7).run(8.0)
    homes = flight.all("HOME_POSITION")
    assert len({m.time_usec for _, m in homes}) == 1
    assert flight.command(400, 1.0) == [0]
    armed_s = flight.now_s
    flight.run(2.5)
    assert flight.last("HOME_POSITION").time_usec == pytest.approx(armed_s * 1e6, abs=2e5)
    flight.command(22)
    flight.until(lambda: not flight.vehicle.truth.on_ground, 10.0)
    left_s = flight.now_s
    flight.run(0.06)
    assert flight.vehicle.autopilot.state.home_s == pytest.approx(left_s, abs=0.05)
    given = fly("px4", noise=True, seed=7).run(3.0)
    assert given.command_int(179, 0, 0.0, x=473_980_000, y=85_456_000, z=490.0) == [0]
    given.airborne(5.0)
    assert given.last("HOME_POSITION").latitude == pytest.approx(473_980_000, abs=2)


def test_row_07_without_noise_home_rests(fly):
    flight = fly.airborne("px4", noise=False, height=20.0).run(20.0)
    assert len({m.altitude for _, m in flight.all("HOME_POSITION", 10.0)}) == 1


def test_row_07_the_receiver_scatters_as_the_recorded_one_does(fly):
    """Catches a receiver that is quieter than the recorded one."""
    flight = hovering(fly, 8).run(40.0)
    fixes = [m for _, m in flight.all("GPS_RAW_INT", flight.now_s - 40.0)]
    steps = [(b.alt - a.alt) * 1e-3 for a, b in itertools.pairwise(fixes)]
    rms_m = (sum(step * step for step in steps) / len(steps) / 2.0) ** 0.5
    assert rms_m == pytest.approx(0.54, abs=0.1), "white: a step's variance is twice a reading's"


def test_row_10_an_orbit_is_flown_round_its_centre_facing_it(fly):
    flight = fly.airborne("px4", height=10.0)
    assert flight.command_int(
        34, 0, 10.0, 2.0, 0.0, NAN, **degrees(flight, 0.0, 0.0), z=amsl(flight, 10.0)
    ) == [0]
    flight.until(lambda: math.hypot(*flight.position[:2]) > 8.5, 15.0)
    flight.run(6.0)
    begun_s = flight.now_s
    flight.run(25.0)
    track = [m for _, m in flight.all("LOCAL_POSITION_NED", begun_s)]
    assert all(math.hypot(m.x, m.y) == pytest.approx(10.0, abs=1.0) for m in track)
    assert all(-m.z == pytest.approx(10.0, abs=0.5) for m in track)
    turned = sum(
        math.remainder(math.atan2(b.y, b.x) - math.atan2(a.y, a.x), math.tau)
        for a, b in itertools.pairwise(track)
    )
    assert turned == pytest.approx(25.0 * 2.0 / 10.0, rel=0.25), (
        "clockwise, at 2 m/s less the drag's share"
    )
    attitude = flight.last("ATTITUDE")
    place = flight.last("LOCAL_POSITION_NED")
    assert abs(math.remainder(attitude.yaw - math.atan2(-place.y, -place.x), math.tau)) < 0.3
    flight.run(1.1)
    assert flight.last("HEARTBEAT").custom_mode == 0x01030000


def test_row_10_an_orbit_with_a_negative_radius_turns_the_other_way(fly):
    flight = fly.airborne("px4", height=10.0)
    assert flight.command(34, -5.0, 2.0, 0.0) == [0]
    flight.run(20.0)
    n, e = flight.position[:2]
    v_n, v_e = flight.velocity[:2]
    assert n * v_e - e * v_n < -3.0


def test_row_10_follow_me_stays_behind_a_target_at_its_height(fly):
    flight = fly.airborne("px4", height=10.0)
    assert flight.command(176, 1, 4, 8) == [0, 0]
    begun_s = flight.now_s
    for second in range(40):
        place = degrees(flight, 2.0 * second, 5.0)
        target = (place["x"], place["y"], amsl(flight, 0.0), [2.0, 0.0, 0.0])
        rest = ([0.0] * 3, [1.0, 0, 0, 0], [0.0] * 3, [0.0] * 3, 0)
        flight.send("FOLLOW_TARGET", second * 1000, 0, *target, *rest)
        flight.run(1.0)
    assert flight.now_s - begun_s == pytest.approx(40.0, abs=0.1)
    assert flight.mode == "FOLLOW"
    assert flight.position[0] == pytest.approx(80.0 - 8.0, abs=2.5), "FLW_TGT_DST behind"
    assert flight.position[1] == pytest.approx(5.0, abs=1.5)
    assert flight.height == pytest.approx(8.0, abs=0.5), "FLW_TGT_HT"
    flight.run(10.0)
    assert math.hypot(*flight.velocity[:2]) < 0.3, (
        "a target that is heard of no more is taken to stand"
    )


def test_follow_me_near_the_ground_climbs_to_a_metre_and_stays_with_the_target(fly):
    """FLW_TGT_HT 0.2 and FLW_TGT_DST 2: v1.17 stayed within 4.8 m of the target, in the air."""
    flight = fly.airborne("px4", height=2.0)
    flight.vehicle.autopilot.parameters.set("FLW_TGT_HT", 0.2)
    flight.vehicle.autopilot.parameters.set("FLW_TGT_DST", 2.0)
    assert flight.command(176, 1, 4, 8) == [0, 0]
    lowest_m = math.inf
    for second in range(25):
        place = degrees(flight, 2.0 * second, 0.0)
        target = (place["x"], place["y"], amsl(flight, 0.0), [2.0, 0.0, 0.0])
        rest = ([0.0] * 3, [1.0, 0, 0, 0], [0.0] * 3, [0.0] * 3, 0)
        flight.send("FOLLOW_TARGET", second * 1000, 0, *target, *rest)
        flight.run(1.0)
        lowest_m = min(lowest_m, flight.height)
    assert math.dist(flight.position[:2], (50.0, 0.0)) < 4.0
    assert lowest_m > 0.5


def test_row_11_a_change_of_speed_is_obeyed_and_kept_by_the_next_goto(fly):
    flight = fly.airborne("px4", height=10.0)
    assert flight.command(178, 1.0, 2.0, -1.0) == [0]
    assert flight.command_int(
        192, 0, -1.0, 1.0, 0.0, NAN, **degrees(flight, 80.0, 0.0), z=amsl(flight, 10.0)
    ) == [0]
    flight.run(10.0)
    assert 1.5 < flight.velocity[0] < 2.1, "measured 1.6"
    assert flight.command(178, 1.0, 0.0, 0.0) == [0]
    flight.run(4.0)
    assert flight.velocity[0] > 2.5, "none is the default again"


def test_row_17_a_mode_that_does_not_exist_is_accepted_twice_and_changes_nothing(fly):
    flight = fly("px4").run(1.0)
    before = flight.mode
    assert flight.command(176, 1, 9, 9) == [0, 0]
    assert flight.command(176, 1, 10) == [0, 0], "TERMINATION"
    assert flight.command(176, 0, 6, 0) == [0, 0]
    assert flight.command(176, 1, 4, 7) == [0, 1], "a sub-mode of AUTO that does not exist"
    assert flight.mode == before


@pytest.mark.parametrize("real", REAL_ACKS, ids=lambda real: str(real["answers"]))
def test_row_26_every_common_command_is_answered_on_the_ground_as_the_real_one_does(fly, real):
    flight = fly("px4").run(1.0)
    for number in real["commands"]:
        assert flight.command(number, *[0.0] * 7, wait_s=0.06) == real["answers"], number


def test_row_26_every_number_up_to_700_that_is_no_command_is_unsupported(fly):
    """Commands in the order of the measurement on v1.17; 246 and 247 end its simulator."""
    known = {number for real in REAL_ACKS for number in real["commands"]} | {246, 247}
    flight = fly("px4").run(1.0)
    answered = {
        number: flight.command(number, *[0.0] * 7, wait_s=0.02)
        for number in {*range(1, 701)} - known
    }
    assert len(answered) + len(known) > 705
    assert {number for number, answers in answered.items() if answers != [3]} == set()


ARMING_REPORT = (
    "commander_arming_check_summary",
    "check_modes_local_pos",
    "check_modes_global_pos",
    "check_modes_local_alt",
    "check_modes_mission",
    "check_modes_offboard_signal",
    "check_modes_home_position",
    "check_modes_manual_control",
    "check_modes_cannot_takeoff",
    "commander_health_summary",
)
EVENTS_OF_A_HOP = [
    "commander_armed_by",
    "commander_takeoff_detected",
    "commander_landing_current_pos",
    "commander_landing_detected",
    "commander_disarmed_by",
]


def test_row_08_texts_go_to_a_ground_station_and_events_to_everybody(fly):
    flight = fly("px4")
    silent = fly("px4")
    for each in (flight, silent):
        heartbeat = ("HEARTBEAT", 6 if each is flight else 18, 8, 0, 0, 4, 3)
        each.run(2.0, heartbeat, every_s=1.0)
        assert each.command(400, 1.0) == [0]
        each.run(1.0, heartbeat, every_s=1.0)
        each.command(22)
        each.run(6.0, heartbeat, every_s=1.0)
        each.command(21)
        each.until(lambda each=each: not each.vehicle.armed, 30.0, heartbeat)
        each.run(0.1)
    said = [
        "Armed by external command",
        "Using default takeoff altitude: 2.5 m",
        "Takeoff detected",
        "Landing at current position",
        "Landing detected",
        "Disarmed by landing",
    ]
    assert flight.texts() == said
    assert silent.texts() == []
    reported = {event_id(name) for name in ARMING_REPORT}
    ids = [m.id for _, m in silent.all("EVENT")]
    assert [number for number in ids if number not in reported] == [
        event_id(name) for name in EVENTS_OF_A_HOP
    ]
    assert [m.id for _, m in flight.all("EVENT")] == ids
    assert event_id(EVENTS_OF_A_HOP[0]) == 0x0190CAF3, "as recorded"
    numbers = [m.sequence for _, m in silent.all("EVENT")]
    assert numbers == list(range(len(ids)))
    silent.run(3.1)
    assert silent.last("CURRENT_EVENT_SEQUENCE").sequence == numbers[-1]


@pytest.mark.parametrize("interval_us", [0.0, -1.0])
def test_texts_have_no_default_interval_so_asking_for_it_silences_them(fly, interval_us):
    flight = fly("px4")
    heartbeat = ("HEARTBEAT", 6, 8, 0, 0, 4, 3)
    flight.run(2.0, heartbeat, every_s=1.0)
    assert flight.command(511, 253.0, interval_us) == [0]
    assert flight.command(400, 1.0) == [0]
    flight.run(6.0, heartbeat, every_s=1.0)
    assert flight.texts() == []
    assert flight.command(511, 253.0, 50_000.0) == [0]
    assert flight.command(400, 0.0) == [0]
    flight.run(1.5, heartbeat, every_s=1.0)
    assert flight.texts() == ["Disarmed by external command"]


def test_row_08_a_missed_event_is_sent_again_and_one_that_is_gone_is_named(fly):
    flight = fly("px4").run(1.0)
    for _ in range(12):
        flight.command(400, 1.0)
        flight.command(400, 0.0)
    before = len(flight.all("EVENT"))
    assert before >= 24
    newest = flight.last("EVENT").sequence
    flight.send("REQUEST_EVENT", 1, 1, newest - 1, newest)
    assert [m.sequence for _, m in flight.all("EVENT")[before:]] == [newest - 1, newest]
    flight.send("REQUEST_EVENT", 1, 1, 0, 0)
    error = flight.last("RESPONSE_EVENT_ERROR")
    assert (error.sequence, error.sequence_oldest_available, error.reason) == (0, newest - 19, 0)


def test_row_16_a_landing_from_12_4_m_takes_as_long_as_the_real_one(fly):
    flight = fly.airborne("px4", height=12.4)
    assert flight.command(21) == [0]
    begun_s = flight.now_s
    flight.until(lambda: flight.height < 1.0, 20.0)
    assert flight.now_s - begun_s == pytest.approx(13.2, abs=1.5), "measured 13.0 s"
    flight.run(1.0)
    assert flight.velocity[2] == pytest.approx(0.3, abs=0.08), "MPC_LAND_CRWL near the ground"
    flight.until(lambda: not flight.vehicle.armed, 20.0)
    assert flight.now_s - begun_s == pytest.approx(21.9, abs=2.2), (
        "measured 21.9 s, and 25 s with another wander"
    )


def test_row_18_the_ground_stations_link_carries_what_the_real_one_does():
    vehicle = MockVehicle("px4", ready_after_s=0.5, links={"gcs": "gcs"})
    decoder = Decoder()
    heard = Counter()
    for step in range(1501):
        for frame in vehicle.step(step * 0.02):
            if step > 500:
                heard.update(m.get_type() for m in decoder.feed(frame, whole=True))
    rates = {name: count / 20.0 for name, count in heard.items()}
    assert 355 <= sum(rates.values()) <= 385, "measured 368 messages a second"
    for name in (
        "ATTITUDE",
        "LOCAL_POSITION_NED",
        "GLOBAL_POSITION_INT",
        "ATTITUDE_TARGET",
        "SERVO_OUTPUT_RAW",
    ):
        assert rates[name] == pytest.approx(49.5, abs=0.6)
    assert rates["GPS_RAW_INT"] == pytest.approx(4.95, abs=0.1)
    assert rates["VFR_HUD"] == pytest.approx(3.96, abs=0.1)
    assert "HIGHRES_IMU" not in rates


def test_row_19_on_the_ground_everything_that_is_measured_varies(fly):
    flight = fly("px4", noise=True, seed=3).run(6.0)
    begun_s = flight.now_s
    flight.run(10.0)

    def spread(message, field):
        return statistics.pstdev(getattr(m, field) for _, m in flight.all(message, begun_s))

    measured = {
        ("ATTITUDE", "roll"): 0.0003, ("ATTITUDE", "pitchspeed"): 0.006,
        ("HIGHRES_IMU", "xacc"): 0.07, ("HIGHRES_IMU", "zgyro"): 0.007, ("HIGHRES_IMU", "ymag"): 0.013,
        ("HIGHRES_IMU", "abs_pressure"): 0.0073, ("LOCAL_POSITION_NED", "vy"): 0.03,
        ("LOCAL_POSITION_NED", "x"): 0.05, ("GPS_RAW_INT", "alt"): 540.0,
    }  # fmt: skip
    for (message, field), sd in measured.items():
        assert sd / 3.0 < spread(message, field) < sd * 3.0, (message, field)
    assert flight.height == 0.0
    assert max(abs(m.x) for _, m in flight.all("LOCAL_POSITION_NED")) < 0.7


def test_row_20_position_target_is_the_moving_trajectory(fly):
    flight = fly.airborne("px4", height=10.0)
    flight.command_int(
        192, 0, -1.0, 1.0, 0.0, NAN, **degrees(flight, 40.0, 0.0), z=amsl(flight, 10.0)
    )
    begun_s = flight.now_s
    flight.run(6.0)
    targets = [m for _, m in flight.all("POSITION_TARGET_LOCAL_NED", begun_s)]
    assert all(math.isfinite(m.x + m.vx + m.afx) and m.type_mask == 0 for m in targets[1:])
    assert 5.0 < targets[-1].x < 35.0, "on its way, and not the goal"
    assert max(m.vx for m in targets) == pytest.approx(5.0, abs=0.1)
    place = flight.last("POSITION_TARGET_GLOBAL_INT")
    assert place.lat_int == pytest.approx(degrees(flight, 40.0, 0.0)["x"], abs=2), "the goal itself"


def test_row_20_the_target_is_a_downward_acceleration_on_the_ground_else_the_stream(
    fly, ned_velocity
):
    flight = fly("px4").run(2.0)
    idle = flight.last("POSITION_TARGET_LOCAL_NED")
    assert (idle.type_mask, idle.afz) == (63, 100.0)
    assert flight.last("POSITION_TARGET_GLOBAL_INT") is None
    flight = (
        fly.airborne("px4", height=10.0)
        .offboard(ned_velocity(2.0, 0.0, 0.0))
        .run(3.0, ned_velocity(2.0, 0.0, 0.0))
    )
    target = flight.last("POSITION_TARGET_LOCAL_NED")
    assert (target.type_mask, target.vx) == (7, 2.0)
    assert math.isfinite(target.afx)


def test_row_21_odometry_is_in_the_local_frame_with_variances(fly):
    flight = fly.airborne("px4", yaw_deg=90.0, height=10.0)
    flight.command(192, -1.0, 1.0, 0.0, NAN, 47.3980, 8.5460, amsl(flight, 10.0))
    flight.run(4.0)
    odometry = flight.last("ODOMETRY")
    local = flight.last("LOCAL_POSITION_NED")
    assert (odometry.frame_id, odometry.child_frame_id, odometry.quality) == (1, 1, 0)
    assert (odometry.vx, odometry.vy) == pytest.approx((local.vx, local.vy), abs=0.15)
    assert odometry.reset_counter in {9, 10}
    known = [index for index, value in enumerate(odometry.pose_covariance) if math.isfinite(value)]
    assert known == [0, 6, 11, 15, 18, 20]
    assert odometry.pose_covariance[0] == pytest.approx(0.043, abs=0.005)


def test_row_22_the_prearm_bit_is_never_present_and_healthy_while_landing(fly):
    prearm = 0x10000000
    flight = fly("px4").run(1.0)
    assert flight.last("SYS_STATUS").onboard_control_sensors_health == 0x1320C83F, "as recorded"
    flight = fly.airborne("px4", height=5.0)
    flight.command(21)
    flight.until(lambda: not flight.vehicle.armed, 30.0)
    for _, status in flight.all("SYS_STATUS", 1.0):
        assert status.onboard_control_sensors_present & ~0x1010000 == 0x0200402F
        assert status.onboard_control_sensors_health & prearm


@pytest.mark.parametrize(
    ("mode", "before", "armed", "after"),
    [(-1, 0, 0, 0), (0, 0, 1, 0), (1, 1, 1, 0), (2, 1, 1, 1), (3, 0, 1, 1)],
)
def test_the_logging_bit_is_present_while_px4_writes_a_log(fly, mode, before, armed, after):
    flight = fly("px4", parameters={"SDLOG_MODE": mode}).run(6.0)
    present = []
    for arms in (0.0, 1.0, 0.0):
        flight.command(400, arms)
        flight.run(1.0)
        present.append(flight.last("SYS_STATUS").onboard_control_sensors_present >> 24 & 1)
    assert present == [before, armed, after]


def test_row_24_px4_is_active_from_arming_and_not_ready_before_its_checks_pass(fly):
    flight = fly("px4", ready_after_s=3.0).run(1.5)
    assert flight.last("HEARTBEAT").system_status == 0
    flight.run(3.0)
    assert flight.last("HEARTBEAT").system_status == 3
    flight.command(400, 1.0)
    flight.run(1.1)
    assert (flight.last("HEARTBEAT").system_status, flight.last("HEARTBEAT").base_mode) == (4, 157)


def test_row_27_nothing_that_px4_streams_is_missing(fly, ned_velocity):
    flight = fly.airborne("px4", height=10.0)
    begun_s = flight.now_s
    flight.run(10.0)
    counts = flight.counts(begun_s)
    real = {
        "VIBRATION": 0.5, "SCALED_PRESSURE": 1.0, "POSITION_TARGET_GLOBAL_INT": 10.0, "OPEN_DRONE_ID_LOCATION": 1.0,
        "OPEN_DRONE_ID_SYSTEM": 1.0, "GNSS_INTEGRITY": 1.0, "CURRENT_EVENT_SEQUENCE": 0.33,
        "TIME_ESTIMATE_TO_TARGET": 0.5, "LINK_NODE_STATUS": 1.0,
    }  # fmt: skip
    for name, hertz in real.items():
        assert counts[name] == pytest.approx(10.0 * hertz, abs=1.0), name
    assert flight.last("OPEN_DRONE_ID_LOCATION").status == 2
    flight.offboard(ned_velocity(0.0, 0.0, 0.0)).run(1.0, ned_velocity(0.0, 0.0, 0.0))
    before = len(flight.all("POSITION_TARGET_GLOBAL_INT"))
    flight.run(3.0, ned_velocity(0.0, 0.0, 0.0))
    assert len(flight.all("POSITION_TARGET_GLOBAL_INT")) == before, "OFFBOARD has none"


def test_row_28_autopilot_version_says_what_the_real_one_says(fly):
    flight = fly("px4").run(1.0)
    assert flight.command(512, 148.0) == [0]
    version = flight.last("AUTOPILOT_VERSION")
    assert version.capabilities == 59647
    assert version.flight_sw_version == 17891583
    assert list(version.flight_custom_version) == [0, 0, 0, 196, 209, 42, 241, 214]
    assert version.uid == 5283920058631409231
    assert version.board_version == 1
    assert not any(version.uid2)
