"""The pymavlink link and the mock autopilot in virtual time: two MAVLink codecs written apart, and no wire between."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import common

from guidance.autopilots import ARDUCOPTER, PX4, Autopilot, Mode
from guidance.frames import Ned
from guidance.links import MemoryWire, SigningKey
from guidance.links.mavlink.pymavlink_link import AIRCRAFT_PER_S, PymavlinkLink
from guidance.messages import (
    Aircraft,
    CommandAck,
    GlobalPosition,
    Heartbeat,
    Home,
    LandedState,
    LocalPosition,
    Origin,
    Parameter,
    ParameterRequest,
    Setpoint,
    Timesync,
)
from sitl_mock import Home as MockHome
from sitl_mock import MockVehicle
from sitl_mock.mavlink import Decoder, Encoder, Signing

STEP_S = 0.02
PLACE = MockHome(47.397742, 8.545594, 488.0)


class Flight:
    """A mock and a link that share a clock."""

    def __init__(self, flavour: str, profile: Autopilot, **options) -> None:
        self.now_s = 1000.0
        self.profile = profile
        self.mock = MockVehicle(flavour, system_id=1, home=PLACE, noise=False, ready_after_s=1.0)
        ours, self.theirs = MemoryWire.pair(lambda: self.now_s)
        self.link = PymavlinkLink(ours, lambda: self.now_s, system_id=1, **options)
        self.latest: dict[type, Any] = {}
        self.seen: list = []
        self.run(2.0)
        for request in profile.stream_requests():
            self.link.request(request)

    def run(self, duration_s: float, setpoint: Setpoint | None = None) -> list:
        seen = []
        for step in range(round(duration_s / STEP_S)):
            self.now_s += STEP_S
            for frame in self.mock.step(self.now_s, [data for _, data in self.theirs.receive()]):
                self.theirs.send(frame)
            for message in self.link.receive():
                self.latest[type(message)] = message
                seen.append(message)
            if step % 50 == 0:
                self.link.send_heartbeat()
            if setpoint is not None:
                self.link.send_setpoint(setpoint)
        return seen

    def mode(self) -> Mode:
        return self.profile.mode_of(self.latest[Heartbeat].custom_mode)

    def take_off(self) -> None:
        if not self.profile.stream_before_guided:
            self.link.request(self.profile.set_mode(Mode.GUIDED))
            self.run(1.0)
        self.link.request(self.profile.arm())
        self.run(3.0)
        self.link.request(self.profile.takeoff(height_m=10.0, home_amsl_m=PLACE.alt_amsl_m))
        self.run(20.0)
        assert self.latest[LocalPosition].position_ned_m[2] == pytest.approx(-10.0, abs=0.7)


FLAVOURS = [("px4", PX4), ("arducopter", ARDUCOPTER)]


def test_other_systems_positions_and_relayed_adsb_are_other_aircraft():
    flight = Flight("px4", PX4)
    place = {"lat": 473977000, "lon": 85455000}
    known = {
        "altitude": 520_000,
        "altitude_type": 0,
        "heading": 9000,
        "hor_velocity": 800,
        "ver_velocity": 100,
    }
    adsb = {
        "ICAO_address": 0x3C6444,
        **place,
        **known,
        "callsign": b"",
        "emitter_type": 0,
        "tslc": 1,
        "squawk": 0,
    }
    position = {
        "time_boot_ms": 1,
        **place,
        "alt": 500_000,
        "relative_alt": 0,
        "vx": 100,
        "vy": 0,
        "vz": -50,
        "hdg": 0,
    }
    own, other = (common.MAVLink(None, srcSystem=number, srcComponent=1) for number in (1, 7))
    for sender, flags in ((own, 143), (own, 1), (own, 0)):
        flight.theirs.send(common.MAVLink_adsb_vehicle_message(**adsb, flags=flags).pack(sender))
    flight.theirs.send(common.MAVLink_global_position_int_message(**position).pack(other))
    heard = [one for one in flight.run(STEP_S) if isinstance(one, Aircraft)]
    assert [one.name for one in heard] == ["ICAO 3C6444", "ICAO 3C6444", "system 7"]
    assert heard[0].altitude_amsl_m == 520.0
    assert heard[0].velocity_ned_m_s == pytest.approx((0.0, 8.0, -1.0))
    assert math.isnan(heard[1].altitude_amsl_m)
    assert all(map(math.isnan, heard[1].velocity_ned_m_s))
    assert heard[2].velocity_ned_m_s == (1.0, 0.0, -0.5)


@pytest.mark.parametrize(("flavour", "profile"), FLAVOURS)
def test_the_streams_asked_for_arrive_at_their_rates(flavour, profile):
    flight = Flight(flavour, profile)
    flight.run(1.0)
    seen = flight.run(4.0)
    for kind, rate_hz in (
        (LocalPosition, 50.0),
        (GlobalPosition, 10.0),
        (LandedState, 5.0),
        (Heartbeat, 1.0),
    ):
        count = sum(isinstance(message, kind) for message in seen)
        assert count / 4.0 == pytest.approx(rate_hz, rel=0.1, abs=0.3)
    assert flight.link.counters()["garbage_bytes"] == 0
    assert flight.link.counters()["requests_unanswered"] == 0


def test_both_acknowledgements_of_a_px4_mode_change_arrive():
    """Catches a link that hides PX4's second, true answer to a mode request."""
    flight = Flight("px4", PX4)
    flight.take_off()
    flight.link.request(PX4.set_mode(Mode.GUIDED))  # without a stream: accepted first, refused then
    acks = [
        message.result
        for message in flight.run(1.0)
        if isinstance(message, CommandAck) and message.command == 176
    ]
    assert acks == [0, 1]
    assert flight.mode() is Mode.HOLD


def test_parameters_and_places_are_read():
    flight = Flight("px4", PX4)
    for name in ("COM_OF_LOSS_T", "COM_OBL_RC_ACT", "NO_SUCH_PARAM"):
        flight.link.request(ParameterRequest(name))
    for message_id in (49, 242):
        flight.link.request(PX4.request_message(message_id))
    seen = flight.run(4.0)
    values = {message.name: message.value for message in seen if isinstance(message, Parameter)}
    assert values == {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 0.0}
    assert flight.link.counters()["requests_unanswered"] == 1
    for kind in (Origin, Home):
        place = next(message for message in seen if isinstance(message, kind))
        assert (place.latitude_deg, place.longitude_deg) == pytest.approx(
            (PLACE.lat_deg, PLACE.lon_deg), abs=1e-6
        )
        assert place.altitude_amsl_m == pytest.approx(PLACE.alt_amsl_m, abs=1.0)


def test_the_vehicles_clock_is_found_by_timesync():
    flight = Flight("px4", PX4)
    flight.run(3.0)
    heard = flight.latest[Timesync]
    position = flight.latest[LocalPosition]
    assert heard.local_ns <= heard.received_s * 1e9
    offset_s = heard.remote_ns / 1e9 - heard.local_ns / 1e9
    assert math.isfinite(offset_s)
    assert position.time_boot_s <= flight.now_s


def test_a_signed_vehicle_needs_the_key_in_both_directions():
    key = bytes(range(32))
    ours, theirs = MemoryWire.pair(lambda: 5.0)
    signing = Signing(key)
    signing.advance_to(1_800_000_000.0)
    encoder = Encoder(1, 1, signing=signing, link_id=2)
    decoder = Decoder(signing=signing)
    link = PymavlinkLink(
        ours, lambda: 5.0, system_id=1, signing_key=SigningKey(key, 1_800_000_000.0)
    )
    theirs.send(encoder.pack("LOCAL_POSITION_NED", 1000, 1.0, 2.0, -3.0, 0.5, 0.5, 0.5))
    theirs.send(Encoder(1, 1).pack("LOCAL_POSITION_NED", 2000, 1.0, 2.0, -3.0, 0.5, 0.5, 0.5))
    assert [message.time_boot_s for message in link.receive()] == [1.0]
    link.send_setpoint(Setpoint(Ned((1.0, 0.0, 0.0))))
    (frame,) = [data for _, data in theirs.receive()]
    assert [message.get_type() for message in decoder.feed(frame)] == [
        "SET_POSITION_TARGET_LOCAL_NED"
    ]
    assert decoder.feed(frame) == []  # a replay


def test_on_a_signed_link_only_adsb_names_aircraft():
    key = bytes(range(32))
    ours, theirs = MemoryWire.pair(lambda: 5.0)
    signing = Signing(key)
    signing.advance_to(1_800_000_000.0)
    link = PymavlinkLink(
        ours, lambda: 5.0, system_id=1, signing_key=SigningKey(key, 1_800_000_000.0)
    )
    place = (473977000, 85455000)
    adsb = (0x3C6444, *place, 0, 520_000, 9000, 800, 100, b"", 1, 1, 143, 0)
    for system_id in (1, 7):
        encoder = Encoder(system_id, 1, signing=signing, link_id=system_id)
        theirs.send(encoder.pack("GLOBAL_POSITION_INT", 1, *place, 500_000, 0, 100, 0, -50, 0))
        theirs.send(encoder.pack("ADSB_VEHICLE", *adsb))
    heard = [one.name for one in link.receive() if isinstance(one, Aircraft)]
    assert heard == ["ICAO 3C6444"]


def test_a_flood_of_other_systems_positions_is_bounded_and_pushes_nothing_out():
    flight = Flight("px4", PX4)
    place = (1, 474000000, 85000000, 1, 1, 0, 0, 0, 0)
    for number in range(3000):
        other = common.MAVLink(None, srcSystem=2 + number % 200, srcComponent=1)
        flight.theirs.send(common.MAVLink_global_position_int_message(*place).pack(other))
        if number % 1000 == 0:
            flight.link.poll()
    heard = flight.link.receive()
    assert sum(isinstance(one, Aircraft) for one in heard) <= 2 * AIRCRAFT_PER_S
    assert flight.link.counters()["aircraft_dropped"] > 0
    assert flight.link.counters()["overflowed"] == 0
