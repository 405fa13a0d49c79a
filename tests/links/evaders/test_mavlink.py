"""Evaders carried by MAVLink: units, datum, clock and every way of saying "unknown"."""

import itertools
import math
import socket
import time
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import common as dialect

from guidance.errors import ConfigError
from guidance.estimation import Observer, add_report, predict
from guidance.estimation.measurement import TrackSettings
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.links import MemoryWire, SigningKey
from guidance.links.evaders.carriers import FOLLOW_TARGET, GLOBAL_POSITION, carrier_of
from guidance.links.evaders.mavlink import MavlinkEvader
from guidance.links.mavlink.frames import ticks
from guidance.links.opening import open_wire
from guidance.messages import AltitudeSaid, Datum, EvaderReport
from tests.links.peer import Peer, until
from tests.links.rigs import free_port

UNDULATION_M = 47.3
FRAME = LocalFrame(47.3977418, 8.5455939, Amsl(488.0), undulation_m=UNDULATION_M)
NAN = math.nan


class World:
    def __init__(self, carrier, **pins) -> None:
        self.now_s = 5.0
        ours, theirs = MemoryWire.pair(lambda: self.now_s)
        self.peer = Peer(theirs.send, system_id=9)
        self.source = MavlinkEvader(ours, carrier, **({"system_id": 9} | pins))

    def report(self, message, **say) -> EvaderReport | None:
        self.peer.say(message, **say)
        reports = self.source.receive()
        assert len(reports) <= 1
        return reports[0] if reports else None

    def refused(self) -> dict[str, int]:
        return {name: n for name, n in self.source.counters().items() if name.startswith("refused")}


def follow(
    *,
    ms=1500,
    capabilities=0b11,
    lat=473977418,
    alt=520.0,
    vel=(3.0, -1.0, 0.5),
    cov=(1.5, 2.0, 0.0),
):
    quiet = [0.0] * 3
    return dialect.MAVLink_follow_target_message(
        ms, capabilities, lat, 85455939, alt, vel, quiet, [1, 0, 0, 0], quiet, cov, 0
    )


def is_unknown(velocity) -> bool:
    return all(map(math.isnan, velocity))


def test_follow_target_is_amsl_north_east_down_and_milliseconds_since_boot():
    report = World(FOLLOW_TARGET).report(follow())
    assert report == EvaderReport(
        5.0,
        1.5,
        "FOLLOW_TARGET",
        47.3977418,
        8.5455939,
        520.0,
        Ned((3.0, -1.0, 0.5)),
        2.0,
        report.velocity_sd_m_s,
        said=AltitudeSaid(520.0, Datum.AMSL),
        sequence=0,
    )
    assert math.isnan(report.velocity_sd_m_s)


@pytest.mark.parametrize(
    ("capabilities", "vel", "known"),
    [
        (0b11, (3.0, 0.0, 0.0), True),
        (0b00, (3.0, 0.0, 0.0), True),  # many senders set no capabilities
        (0b01, (3.0, 0.0, 0.0), False),
        (0b11, (0.0, 0.0, 0.0), False),  # "(0,0,0) for unknown"
        (0b11, (NAN, 0.0, 0.0), False),
    ],
)
def test_a_velocity_of_zero_or_without_its_bit_is_unknown_and_never_zero(capabilities, vel, known):
    report = World(FOLLOW_TARGET).report(follow(capabilities=capabilities, vel=vel))
    assert report.velocity_ned_m_s == vel if known else is_unknown(report.velocity_ned_m_s)


def test_accuracy_of_zero_is_unknown():
    assert math.isnan(World(FOLLOW_TARGET).report(follow(cov=(0.0, 0.0, 0.0))).position_sd_m)


@pytest.mark.parametrize(
    ("lat", "alt"), [(2**31 - 1, 500.0), (910000000, 500.0), (473977418, NAN), (473977418, 1e9)]
)
def test_a_follow_target_of_no_place_is_refused_and_counted(lat, alt):
    world = World(FOLLOW_TARGET)
    assert world.report(follow(lat=lat, alt=alt)) is None
    assert sum(world.refused().values()) == 1


def test_only_the_pinned_system_is_the_evader_even_when_it_falls_silent():
    world = World(FOLLOW_TARGET)
    assert world.report(follow(), system_id=255, component_id=190) is None
    assert world.report(follow(), system_id=8) is None
    assert world.report(follow()) is not None
    assert world.source.counters()["foreign"] == 2


def test_the_systems_that_report_instead_of_the_evader_are_named_until_it_does():
    world = World(FOLLOW_TARGET, system_id=3)
    assert world.source.problem() == ""
    for _ in range(8):
        world.report(follow())
        world.report(follow(), system_id=1, component_id=195)
        world.now_s += 0.5
    assert world.source.problem() == (
        "FOLLOW_TARGET of system 3 is not heard. Heard: system 1, component 195, system 9, component 1; "
        "see evader.system_id"
    )
    Peer(world.peer.send, system_id=3).say(follow())
    assert world.source.receive()
    assert world.source.problem() == ""


def test_a_wrong_component_is_named_and_a_silent_evader_is_no_wrong_one():
    world = World(FOLLOW_TARGET, component_id=191)
    for _ in range(8):
        world.report(follow())
        world.now_s += 0.5
    assert "system 9, component 191 is not heard. Heard: system 9, component 1;" in (
        world.source.problem()
    )
    heard = World(FOLLOW_TARGET)
    assert heard.report(follow()) is not None
    other = Peer(heard.peer.send, system_id=1)
    for _ in range(8):
        heard.now_s += 0.5
        other.say(follow())
        heard.source.receive()
    assert heard.source.problem() == ""


def test_reports_from_other_addresses_are_counted_in_the_next_report():
    world = World(FOLLOW_TARGET)
    other = Peer(lambda data: None, system_id=9)
    elsewhere = [
        other.packed(follow()),
        other.packed(dialect.MAVLink_timesync_message(1, 2)),
        b"\xfd garbage",
    ]
    world.source.wire.impostors = lambda: [elsewhere.pop()] if elsewhere else []
    impostors = [world.report(follow(ms=1500 + n)).impostors for n in range(5)]
    assert impostors == [None, None, 1, None, None]


def test_a_component_can_be_pinned_too():
    world = World(FOLLOW_TARGET, component_id=1)
    assert world.report(follow(), component_id=191) is None
    assert world.report(follow(), component_id=1) is not None


@pytest.mark.parametrize(
    ("carrier", "message"),
    [
        (FOLLOW_TARGET, lambda ms: follow(ms=ms)),
        (
            GLOBAL_POSITION,
            lambda ms: dialect.MAVLink_global_position_int_message(
                ms, 473977418, 85455939, 500000, 0, 1, 2, 3, 0
            ),
        ),
    ],
)
def test_a_clock_that_wraps_at_32_bits_goes_on(carrier, message):
    world = World(carrier)
    wrap = 2**32
    # The fourth came late, from before the wrap
    readings = [
        wrap - 60,
        wrap - 20,
        20,
        wrap - 10,
        60,
    ]
    sent = [world.report(message(ms)).sent_s for ms in readings]
    steps = [round((b - a) * 1e3) for a, b in itertools.pairwise(sent)]
    assert steps == [40, 40, -30, 70]


def test_a_sender_that_restarts_steps_back():
    world = World(FOLLOW_TARGET)
    sent = [world.report(follow(ms=ms)).sent_s for ms in (500_000, 500_100, 30, 130)]
    assert sent[2] - sent[1] == pytest.approx(-500.07)
    assert sent[3] - sent[2] == pytest.approx(0.1)


def test_global_position_int_is_amsl_and_at_rest_means_at_rest():
    message = dialect.MAVLink_global_position_int_message(
        2500, 473977418, -85455939, 520250, 32000, 0, 0, 0, 0
    )
    report = World(GLOBAL_POSITION).report(message)
    assert (report.sent_s, report.latitude_deg, report.longitude_deg) == (
        2.5,
        47.3977418,
        -8.5455939,
    )
    assert report.altitude_amsl_m == 520.25
    assert report.velocity_ned_m_s == (0.0, 0.0, 0.0)
    assert math.isnan(report.position_sd_m)


@pytest.mark.parametrize(("lat", "lon"), [(0, 0), (2**31 - 1, 85455939)])
def test_a_global_position_before_the_first_fix_is_refused(lat, lon):
    world = World(GLOBAL_POSITION)
    assert (
        world.report(dialect.MAVLink_global_position_int_message(1, lat, lon, 1, 1, 1, 1, 1, 1))
        is None
    )
    assert world.refused() == {"refused_invalid": 1}


def odometry(
    *,
    frame=1,
    child=1,
    position=(100.0, 50.0, -20.0),
    q=(1.0, 0.0, 0.0, 0.0),
    v=(3.0, 0.0, 0.0),
    pose=NAN,
):
    covariance = [NAN] * 21
    for index, variance in zip((0, 6, 11), (pose, pose * 4, pose), strict=True):
        covariance[index] = variance
    return dialect.MAVLink_odometry_message(
        12_345_678, frame, child, *position, list(q), *v, 0, 0, 0, covariance, [NAN] * 21, 2, 1, 100
    )


def test_odometry_is_metres_about_the_evaders_own_origin():
    report = World(carrier_of("odometry", FRAME)).report(odometry(pose=0.25))
    assert FRAME.ned_from_wgs84(
        report.latitude_deg, report.longitude_deg, Amsl(report.altitude_amsl_m)
    ) == (pytest.approx((100.0, 50.0, -20.0), abs=1e-3))
    assert report.altitude_amsl_m == pytest.approx(508.0)
    assert report.said == (20.0, Datum.ORIGIN)
    assert report.sent_s == pytest.approx(12.345678)
    assert report.position_sd_m == 1.0
    assert math.isnan(report.velocity_sd_m_s)


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 180.0, 270.0])
def test_a_body_velocity_is_turned_by_the_attitude(heading_deg):
    half = math.radians(heading_deg) / 2.0
    report = World(carrier_of("odometry", FRAME)).report(
        odometry(child=12, q=(math.cos(half), 0.0, 0.0, math.sin(half)))
    )
    heading = math.radians(heading_deg)
    assert report.velocity_ned_m_s == pytest.approx(
        (3 * math.cos(heading), 3 * math.sin(heading), 0.0), abs=1e-6
    )


def test_a_body_that_pitches_down_flies_down():
    half = math.radians(-90.0) / 2.0
    report = World(carrier_of("odometry", FRAME)).report(
        odometry(child=12, q=(math.cos(half), 0.0, math.sin(half), 0.0))
    )
    assert report.velocity_ned_m_s == pytest.approx((0.0, 0.0, 3.0), abs=1e-6)


@pytest.mark.parametrize(
    "bad", [{"child": 20}, {"child": 12, "q": (0.0, 0.0, 0.0, 0.0)}, {"v": (NAN, 0.0, 0.0)}]
)
def test_an_odometry_velocity_that_cannot_be_turned_is_unknown(bad):
    assert is_unknown(World(carrier_of("odometry", FRAME)).report(odometry(**bad)).velocity_ned_m_s)


@pytest.mark.parametrize(
    "bad", [{"frame": 20}, {"frame": 4}, {"position": (NAN, 0.0, 0.0)}, {"position": (1e9, 0, 0)}]
)
def test_an_odometry_in_another_frame_or_nowhere_is_refused(bad):
    world = World(carrier_of("odometry", FRAME))
    assert world.report(odometry(**bad)) is None
    assert sum(world.refused().values()) == 1


def drone_id(**changes):
    fields = {
        "target_system": 0,
        "target_component": 0,
        "id_or_mac": [0] * 20,
        "status": 2,
        "direction": 9000,
        "speed_horizontal": 400,
        "speed_vertical": 50,
        "latitude": 473977418,
        "longitude": 85455939,
        "altitude_barometric": 480.0,
        "altitude_geodetic": 600.0,
        "height_reference": 0,
        "height": 20.0,
        "horizontal_accuracy": 11,
        "vertical_accuracy": 4,
        "barometer_accuracy": 4,
        "speed_accuracy": 3,
        "timestamp": 3599.5,
        "timestamp_accuracy": 1,
    }
    return dialect.MAVLink_open_drone_id_location_message(**(fields | changes))


def test_remote_id_is_ellipsoidal_and_its_climb_is_up():
    report = World(carrier_of("open_drone_id", FRAME)).report(drone_id())
    assert report.altitude_amsl_m == pytest.approx(600.0 - UNDULATION_M)
    assert report.said == (600.0, Datum.ELLIPSOID)
    assert report.velocity_ned_m_s == pytest.approx((0.0, 4.0, -0.5), abs=1e-9)
    assert (report.position_sd_m, report.velocity_sd_m_s, report.sent_s) == (1.5, 0.5, 3599.5)


@pytest.mark.parametrize(
    "unknown", [{"direction": 36100}, {"speed_horizontal": 25500}, {"speed_vertical": 6300}]
)
def test_remote_id_sentinels_make_the_velocity_unknown(unknown):
    assert is_unknown(
        World(carrier_of("open_drone_id", FRAME)).report(drone_id(**unknown)).velocity_ned_m_s
    )


@pytest.mark.parametrize(
    "unknown",
    [
        {"altitude_geodetic": -1000.0},
        {"altitude_geodetic": NAN},
        {"latitude": 0, "longitude": 0},
        {"latitude": 2**31 - 1},
    ],
)
def test_remote_id_without_a_place_is_refused(unknown):
    world = World(carrier_of("open_drone_id", FRAME))
    assert world.report(drone_id(**unknown)) is None
    assert sum(world.refused().values()) == 1


def test_remote_id_time_goes_on_over_the_full_hour_and_may_be_unknown():
    world = World(carrier_of("open_drone_id", FRAME))
    sent = [
        world.report(drone_id(timestamp=second)).sent_s
        for second in (3598.5, 3599.5, 0.5, 65535.0, 1.5)
    ]
    assert sent[:3] == [3598.5, 3599.5, 3600.5]
    assert math.isnan(sent[3])
    assert sent[4] == 3601.5


def test_undefined_accuracy_classes_are_unknown():
    report = World(carrier_of("open_drone_id", FRAME)).report(
        drone_id(horizontal_accuracy=0, speed_accuracy=200)
    )
    assert math.isnan(report.position_sd_m)
    assert math.isnan(report.velocity_sd_m_s)


def test_one_relayed_identity_can_be_pinned():
    world = World(carrier_of("open_drone_id", FRAME, id_or_mac="010203"))
    assert world.report(drone_id()) is None
    assert world.report(drone_id(id_or_mac=[1, 2, 3] + [0] * 17)) is not None
    assert world.refused() == {"refused_other_id": 1}


def adsb(**changes):
    fields = {
        "ICAO_address": 0xABCDEF,
        "lat": 473977418,
        "lon": 85455939,
        "altitude_type": 0,
        "altitude": 600_000,
        "heading": 18000,
        "hor_velocity": 5000,
        "ver_velocity": -200,
        "callsign": b"N12345",
        "emitter_type": 14,
        "tslc": 1,
        "flags": 0x8F,
        "squawk": 1200,
    }
    return dialect.MAVLink_adsb_vehicle_message(**(fields | changes))


def test_adsb_altitude_has_the_datum_of_its_type():
    assert (
        World(carrier_of("adsb", FRAME, icao_address=0xABCDEF)).report(adsb()).altitude_amsl_m
        == 600.0
    )
    geometric = World(carrier_of("adsb", FRAME, icao_address=0xABCDEF)).report(
        adsb(altitude_type=1)
    )
    assert geometric.altitude_amsl_m == pytest.approx(600.0 - UNDULATION_M)
    assert geometric.said == (600.0, Datum.ELLIPSOID)
    assert geometric.velocity_ned_m_s == pytest.approx((-50.0, 0.0, 2.0), abs=1e-9)
    assert math.isnan(geometric.sent_s)


@pytest.mark.parametrize("missing", [4, 8, 128])
def test_an_adsb_velocity_without_its_flags_is_unknown(missing):
    assert is_unknown(
        World(carrier_of("adsb", FRAME, icao_address=0xABCDEF))
        .report(adsb(flags=0x8F & ~missing))
        .velocity_ned_m_s
    )


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"ICAO_address": 1}, "refused_other_id"),
        ({"tslc": 3}, "refused_old"),
        ({"flags": 0x8E}, "refused_position"),
        ({"flags": 0x8D}, "refused_altitude"),
    ],
)
def test_adsb_of_others_or_old_or_of_no_place_is_refused(change, reason):
    world = World(carrier_of("adsb", FRAME, icao_address=0xABCDEF))
    assert world.report(adsb(**change)) is None
    assert world.refused() == {reason: 1}


@pytest.mark.parametrize("kind", ["open_drone_id", "adsb"])
def test_a_carrier_of_ellipsoidal_heights_asks_for_the_geoid_before_the_flight(kind):
    with pytest.raises(ConfigError, match="undulation_m"):
        carrier_of(kind, replace(FRAME, undulation_m=None))


def global_position(ms: int):
    return dialect.MAVLink_global_position_int_message(
        ms, 473977418, 85455939, 520250, 32000, 0, 0, 0, 0
    )


class AskedWorld(World):
    """An evader whose boot was at our 2 s, and whose way to us takes 30 ms each way."""

    def __init__(self, carrier, **pins) -> None:
        super().__init__(carrier, **pins)
        ours, self.theirs = MemoryWire.pair(lambda: self.now_s)
        self.peer = Peer(self.theirs.send, system_id=9)
        self.source = MavlinkEvader(ours, carrier, system_id=9, clock=lambda: self.now_s)

    def second(
        self, message=global_position, *, boot_s: float = 2.0, answer_as: int = 9
    ) -> list[EvaderReport]:
        reports = []
        for _ in range(10):
            sent_s = self.now_s
            self.now_s += 0.03
            self.peer.say(message(round((sent_s - boot_s) * 1e3)))
            for _, data in self.theirs.receive():
                self.peer.hear(data)
            for question in self.peer.of("TIMESYNC"):
                answer = dialect.MAVLink_timesync_message(round((sent_s - 2.0) * 1e9), question.ts1)
                self.peer.say(answer, system_id=answer_as)
            self.peer.heard.clear()
            reports += self.source.receive()
            self.now_s += 0.07
        return reports


def test_the_evaders_clock_is_asked_for_and_goes_along_with_a_report():
    world = AskedWorld(GLOBAL_POSITION)
    reports = [report for _ in range(3) for report in world.second()]
    answers = [report.timesync for report in reports if report.timesync is not None]
    assert 2 <= len(answers) <= 4  # once a second
    for answer in answers:
        middle_s = 0.5 * (answer.local_ns / 1e9 + answer.received_s)
        assert answer.remote_ns / 1e9 - middle_s == pytest.approx(-2.0, abs=0.06)
    assert world.source.counters()["clock_answers"] == len(answers)


def test_answers_of_somebody_else_say_nothing_of_the_evaders_clock():
    world = AskedWorld(GLOBAL_POSITION)
    assert all(report.timesync is None for _ in range(3) for report in world.second(answer_as=1))


def test_an_answer_by_another_clock_than_the_reports_is_not_used():
    world = AskedWorld(GLOBAL_POSITION)
    assert all(report.timesync is None for _ in range(3) for report in world.second(boot_s=-1000.0))
    assert world.source.counters()["clock_disagrees"] >= 2


def test_a_source_without_a_clock_never_sends():
    ours, theirs = MemoryWire.pair(lambda: 1.0)
    source = MavlinkEvader(ours, GLOBAL_POSITION, system_id=9)
    Peer(theirs.send, system_id=9).say(global_position(5))
    assert len(source.receive()) == 1
    assert theirs.receive() == []


@pytest.mark.parametrize(
    "kind", ["follow_target", "global_position", "odometry", "open_drone_id", "adsb"]
)
def test_nothing_is_sent_before_an_evader_has_reported(kind):
    ours, theirs = MemoryWire.pair(lambda: 1.0)
    source = MavlinkEvader(
        ours, carrier_of(kind, FRAME, icao_address=5), system_id=9, clock=lambda: 1.0
    )
    Peer(theirs.send, system_id=9).heartbeat()
    assert source.receive() == []
    source.close()
    assert ours.counters()["wire_sent"] == 0


def test_garbage_and_other_messages_are_nothing():
    world = World(FOLLOW_TARGET)
    world.peer.send(b"\xfd\xff\x00garbage")
    world.peer.heartbeat()
    assert world.report(follow()) is not None
    assert world.source.counters()["garbage_bytes"] > 0


def test_the_estimate_needs_no_guess_of_the_delay_once_the_evaders_clock_is_known():
    settings = TrackSettings(declared_speed_m_s=3.0)
    world = AskedWorld(GLOBAL_POSITION)
    observer = Observer()
    ages = []
    for _ in range(3):
        for report in world.second():
            observer = add_report(observer, report, FRAME, settings)
        ages.append(
            predict(observer.track.estimate, Ned((0.0, 0.0, 0.0)), world.now_s, settings).age_s
        )
    # The last report was true when it was sent, 0.1 s ago
    assert ages[-1] == pytest.approx(0.1, abs=0.03)


def test_unsigned_reports_sent_first_do_not_keep_a_signed_evader_out():
    key = SigningKey(bytes(range(32)))
    port = free_port()
    wire = open_wire(
        f"udpin://127.0.0.1:{port}", clock=time.monotonic, systems=(9,), signing_key=key
    )
    source = MavlinkEvader(wire, FOLLOW_TARGET, system_id=9, clock=time.monotonic, signing_key=key)
    reports = []
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as forgers,
        socket.socket(type=socket.SOCK_DGRAM) as theirs,
    ):
        forger = Peer(lambda data: forgers.sendto(data, ("127.0.0.1", port)), system_id=9)
        evader = Peer(lambda data: theirs.sendto(data, ("127.0.0.1", port)), system_id=9)
        signing = evader.mavlink.signing
        signing.secret_key = key.secret
        signing.sign_outgoing = True
        signing.timestamp = ticks(time.time())

        def arrived() -> bool:
            forger.say(follow(alt=900.0))
            evader.say(follow())
            reports.extend(source.receive())
            return len(reports) >= 3

        assert until(arrived)
    assert {report.altitude_amsl_m for report in reports} == {520.0}
    assert source.counters()["wire_unsigned"] > 0
    assert all(report.impostors is None for report in reports)
    source.close()
