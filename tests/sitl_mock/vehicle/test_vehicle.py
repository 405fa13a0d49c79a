"""The vehicle as a whole: determinism, streams, links, clock, conditions, bad settings."""

import itertools
import math
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sitl_mock import ConfigError, Home, MockVehicle
from sitl_mock.flavours import NAMES
from sitl_mock.mavlink import Decoder, Encoder
from sitl_mock.protocols import PX4_GCS_HZ, PX4_ONBOARD_HZ
from sitl_mock.vehicle.conditions import CONDITIONS
from sitl_mock.world import LocalFrame
from tests.harness.examples import drawn


def flown_bytes(flight, ned_velocity):
    flight.airborne(6.0)
    flight.run(5.0, ned_velocity(1.0, 2.0, 0.0))
    return b"".join(flight.frames)


@pytest.mark.parametrize("flavour", ["px4", "arducopter"])
def test_equal_seeds_give_equal_bytes_and_others_do_not(fly, ned_velocity, flavour):
    """Catches randomness outside of the seed, or a clock of the computer."""
    first, again, other = (
        flown_bytes(fly(flavour, noise=True, seed=seed, texts=True), ned_velocity)
        for seed in (4, 4, 5)
    )
    assert first == again
    assert flavour == "arducopter" or first != other


def test_what_is_sent_does_not_depend_on_how_often_it_is_stepped():
    fine = MockVehicle("px4", seed=2)
    coarse = MockVehicle("px4", seed=2)
    fine_frames = [frame for tick in range(301) for frame in fine.step(tick * 0.01)]
    coarse_frames = [frame for tick in range(31) for frame in coarse.step(tick * 0.1)]
    assert fine_frames == coarse_frames


def test_px4_streams_at_the_measured_rates(fly):
    flight = fly("px4").run(2.0)
    start_s = flight.now_s
    flight.run(20.0)
    heard = flight.counts(start_s)
    streamed = {
        name: hertz
        for name, hertz in PX4_ONBOARD_HZ.items()
        if name != "POSITION_TARGET_GLOBAL_INT"
    }
    for name, rate_hz in streamed.items():
        assert heard[name] == pytest.approx(20.0 * rate_hz, abs=1.01), name
    assert set(heard) == set(streamed), "the goal of an automatic mode is sent while armed"


def test_each_link_has_its_own_rates_sequence_and_requests():
    vehicle = MockVehicle("px4", links={"onboard": "onboard", "gcs": "gcs"}, ready_after_s=0.5)
    encoder = Encoder(255, 190)
    decoders = {"onboard": Decoder(), "gcs": Decoder()}
    heard = {"onboard": [], "gcs": []}
    vehicle.step_links(0.0, {})
    request = encoder.pack("COMMAND_LONG", 1, 1, 511, 0, 32.0, 50000.0, *[0.0] * 5)
    for tick in range(1, 501):
        out = vehicle.step_links(tick * 0.02, {"gcs": [request] if tick == 50 else []})
        for name, frames in out.items():
            for frame in frames:
                heard[name] += decoders[name].feed(frame, whole=True)
    for name, messages in heard.items():
        steps = {(b.get_seq() - a.get_seq()) % 256 for a, b in itertools.pairwise(messages)}
        assert steps == {1}, name
    counts = {name: Counter(m.get_type() for m in messages) for name, messages in heard.items()}
    assert counts["gcs"]["ATTITUDE"] == pytest.approx(PX4_GCS_HZ["ATTITUDE"] * 10, abs=1)
    assert counts["onboard"]["ATTITUDE"] == pytest.approx(1000, abs=1)
    assert counts["gcs"]["LOCAL_POSITION_NED"] == pytest.approx(50 + 9 * 20 + 1, abs=2)
    assert counts["onboard"]["LOCAL_POSITION_NED"] == pytest.approx(300, abs=2)
    assert (counts["gcs"]["COMMAND_ACK"], counts["onboard"]["COMMAND_ACK"]) == (1, 0)


@pytest.mark.parametrize("flavour", ["px4", "arducopter", "rover"])
def test_a_quiet_link_sends_heartbeats_and_what_is_asked_for(flavour):
    vehicle = MockVehicle(flavour, links={"onboard": "quiet"}, texts=False)
    encoder = Encoder(255, 190)
    decoder = Decoder()
    heard = []
    request = encoder.pack("COMMAND_LONG", 1, 1, 511, 0, 32.0, 1e5, 0, 0, 0, 0, 0)
    for tick in range(500):
        for frame in vehicle.step(tick * 0.02, [request] if tick == 250 else []):
            heard += decoder.feed(frame, whole=True)
    counts = Counter(message.get_type() for message in heard)
    announced = {"HOME_POSITION", "GPS_GLOBAL_ORIGIN", "EVENT"}
    assert {name: count for name, count in counts.items() if name not in announced} == {
        "HEARTBEAT": 10,
        "COMMAND_ACK": 1,
        "LOCAL_POSITION_NED": 50,
    }


def test_time_since_boot_starts_with_the_first_step():
    vehicle = MockVehicle("px4")
    decoder = Decoder()
    vehicle.step(1234.5)
    messages = [m for frame in vehicle.step(1235.5) for m in decoder.feed(frame, whole=True)]
    assert max(m.time_boot_ms for m in messages if m.get_type() == "ATTITUDE") == pytest.approx(
        1000, abs=11
    )


@pytest.mark.parametrize("flavour", NAMES)
def test_local_and_global_position_agree_through_the_origin(fly, ned_velocity, flavour):
    flight = fly(flavour, start_ned=(12.0, -7.0, 0.0), noise=True).run(1.0)
    for message_id in (32.0, 33.0):
        flight.command(511, message_id, 20000.0)
    flight.command(512, 49.0)
    origin = flight.last("GPS_GLOBAL_ORIGIN")
    frame = LocalFrame(
        Home(origin.latitude * 1e-7, origin.longitude * 1e-7, origin.altitude * 1e-3)
    )
    local = flight.last("LOCAL_POSITION_NED")
    place = flight.last("GLOBAL_POSITION_INT")
    assert frame.to_local(place.lat * 1e-7, place.lon * 1e-7, place.alt * 1e-3) == pytest.approx(
        (local.x, local.y, local.z), abs=0.05
    )


def test_the_origin_may_lie_elsewhere(fly):
    origin = LocalFrame(Home(47.397742, 8.545594, 488.0)).to_geodetic(-100.0, 50.0, 3.0)
    flight = fly("px4", origin=origin).run(1.0)
    local = flight.last("LOCAL_POSITION_NED")
    assert (local.x, local.y, local.z) == pytest.approx((100.0, -50.0, -3.0), abs=0.02)
    assert flight.height == pytest.approx(3.0, abs=0.01)
    flight.airborne(5.0)
    assert flight.height == pytest.approx(8.0 - 3.0, abs=0.6)


def test_the_origin_can_be_set_before_arming_and_is_confirmed(fly):
    flight = fly("px4").run(1.0)
    wanted = flight.vehicle.autopilot.frame.to_geodetic(-40.0, 10.0, 0.0)
    place = (
        round(wanted.lat_deg * 1e7),
        round(wanted.lon_deg * 1e7),
        round(wanted.alt_amsl_m * 1e3),
    )
    flight.send("SET_GPS_GLOBAL_ORIGIN", 1, *place, 0)
    told = flight.last("GPS_GLOBAL_ORIGIN")
    assert (told.latitude, told.longitude, told.altitude) == place
    flight.run(0.2)
    local = flight.last("LOCAL_POSITION_NED")
    assert (local.x, local.y, local.z) == pytest.approx((40.0, -10.0, 0.0), abs=0.02)
    flight.airborne(5.0)
    assert flight.last("GLOBAL_POSITION_INT").relative_alt == pytest.approx(5000, abs=600)
    before = len(flight.all("GPS_GLOBAL_ORIGIN"))
    flight.send("SET_GPS_GLOBAL_ORIGIN", 1, *place, 0)
    assert len(flight.all("GPS_GLOBAL_ORIGIN")) == before, "not in the air"


def test_estimation_noise_has_the_measured_size():
    """Catches an estimate that is better or worse than PX4's."""
    vehicle = MockVehicle("px4", seed=1, ready_after_s=0.5)
    encoder = Encoder(1, 195)
    stream = encoder.pack(
        "SET_POSITION_TARGET_LOCAL_NED", 0, 1, 1, 1, 2503, 0, 0, 0, 0, 0, -0.5, 0, 0, 0, 0, 0
    )
    for tick in range(1, 100):
        vehicle.step(tick * 0.02, [stream])
    for command in ((176, 1.0, 6.0), (400, 1.0, 0.0)):
        vehicle.step(
            2.0, [encoder.pack("COMMAND_LONG", 1, 1, command[0], 0, *command[1:], *[0.0] * 5)]
        )
    errors = []
    for tick in range(101, 10_000):
        vehicle.step(tick * 0.02, [stream] if tick % 10 == 0 else [])
        if tick > 1000 and tick % 10 == 0:
            state = vehicle.autopilot.state
            body = vehicle.truth
            errors.append(
                [a - b for a, b in zip(state.position_m, body.position_ned_m, strict=True)]
                + [a - b for a, b in zip(state.velocity_m_s, body.velocity_ned_m_s, strict=True)]
            )
    for axis, expected in enumerate((0.13, 0.21, 0.31, 0.17, 0.30, 0.16)):
        spread = math.sqrt(sum(row[axis] ** 2 for row in errors) / len(errors))
        assert spread == pytest.approx(expected, rel=0.45), axis


def test_frozen_telemetry_leaves_the_heartbeats(fly):
    flight = fly("px4").run(1.0)
    flight.vehicle.inject("telemetry_frozen", True)
    start_s = flight.now_s
    flight.run(5.0)
    assert {m.get_type() for t, m in flight.heard if t > start_s} == {"HEARTBEAT"}
    flight.vehicle.inject("telemetry_frozen", False)
    assert flight.run(0.1).last("ATTITUDE").time_boot_ms > 6000


def test_a_silent_vehicle_sends_nothing_and_still_obeys(fly):
    flight = fly("px4").run(1.0)
    flight.vehicle.inject("silent", True)
    before = len(flight.heard)
    assert flight.command(400, 1.0) == []
    assert len(flight.heard) == before
    assert flight.vehicle.armed


def test_a_reboot_in_the_air_starts_the_clock_anew_and_lets_it_fall(fly):
    flight = fly.airborne("px4", height=10.0)
    flight.vehicle.inject("reboot")
    flight.run(3.0)
    assert flight.last("ATTITUDE").time_boot_ms <= 3000
    assert not flight.vehicle.armed
    assert flight.height == 0.0
    assert flight.last("HEARTBEAT").get_seq() < 60 * 20


def test_time_since_boot_may_jump_and_wraps_at_32_bits(fly):
    flight = fly("px4").run(1.0)
    flight.vehicle.inject("time_jump_s", 2**32 / 1000.0 - 2.0)
    flight.run(2.0)
    times = [m.time_boot_ms for _, m in flight.all("ATTITUDE", 1.1)]
    assert max(times) > 2**32 - 1000
    assert times[-1] < 2000


def test_wind_pushes_a_drifting_vehicle_and_a_gust_is_fought(fly):
    flight = fly.airborne("px4")
    flight.vehicle.inject("push_m_s", (4.0, 0.0, 0.0))
    flight.run(0.1)
    assert flight.velocity[0] > 2.0
    flight.run(8.0)
    assert abs(flight.velocity[0]) < 0.3


@pytest.mark.parametrize("name", CONDITIONS)
def test_a_condition_with_a_wrong_value_names_itself(name):
    if CONDITIONS[name].parse("wrong") == "wrong" if name in {"arm_refused"} else False:
        assert MockVehicle("px4").inject(name, "any text") is None
        return
    with pytest.raises(ConfigError, match=name):
        MockVehicle("px4").inject(name, object() if name != "pilot_mode" else "NO_SUCH_MODE")


def test_an_unknown_condition_lists_those_there_are():
    with pytest.raises(ConfigError, match="gps_lost"):
        MockVehicle("px4").inject("gps_last", True)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"flavour": "px5"}, "px5"),
        ({"system_id": 0}, "system_id = 0"),
        ({"links": {"a": "radio"}}, "links.a = 'radio'"),
        ({"parameters": {"COM_OF_LOSS_TT": 1.0}}, "COM_OF_LOSS_TT"),
    ],
)
def test_a_wrong_setting_is_named_with_what_is_allowed(wrong, named):
    with pytest.raises(ConfigError, match=named):
        MockVehicle(**wrong)


@settings(max_examples=drawn(60), deadline=None)
@given(
    st.floats(-80, 80), st.floats(-179, 179), st.floats(0, 3000),
    st.floats(-5000, 5000), st.floats(-5000, 5000), st.floats(-500, 500),
)  # fmt: skip
def test_local_frames_are_undone_by_their_inverse(lat, lon, alt, north, east, down):
    frame = LocalFrame(Home(lat, lon, alt))
    assert frame.to_local(*frame.to_geodetic(north, east, down)) == pytest.approx(
        (north, east, down), abs=1e-5
    )


def test_local_frames_agree_with_the_tangent_plane_within_a_kilometre():
    import pymap3d

    home = Home(47.397742, 8.545594, 488.0)
    lat, lon, _ = LocalFrame(home).to_geodetic(600.0, -700.0, 0.0)
    north, east, _ = pymap3d.geodetic2ned(lat, lon, home.alt_amsl_m, *home)
    assert (north, east) == pytest.approx((600.0, -700.0), abs=0.1)
