"""A ground station on the vehicle's link: what it hears of a flight, and which of its orders are obeyed."""

import json
from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.config import config_folder, parse_document
from guidance.errors import ConfigError
from guidance.flight import State
from guidance.links.mavlink.frames import ticks
from guidance.links.mavlink.ground_link import COMPONENT_ID, address_of
from guidance.session.observe.ground_station import (
    DENIED,
    ORDERS_BY_COMMAND,
    RESULT_ACCEPTED,
    SIGNED_ONLY,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
)
from guidance.session.vehicle_file import Config
from tests.session.conftest import UNIX_S

QGC = 255
USER_1, USER_2, USER_3, USER_4, USER_5 = ORDERS_BY_COMMAND
STATIONS = [QGC, 254]
KEY = bytes(range(32))


class Station:
    """A ground station that sends commands to component 191 and reads what comes from there."""

    def __init__(self, base, system_id=QGC, key=None):
        self.base = base
        self.mavlink = mavlink.MAVLink(None, system_id, 190)
        if key is not None:
            self.mavlink.signing.secret_key = key
            self.mavlink.signing.sign_outgoing = True
            self.mavlink.signing.timestamp = ticks(UNIX_S) + 1_000_000

    def heard(self, name):
        return [
            sent
            for sent in self.base.sent
            if sent.name == name and sent.message.get_srcComponent() == COMPONENT_ID
        ]

    @property
    def texts(self):
        return [sent.message.text for sent in self.heard("STATUSTEXT")]

    def send(self, command, component_id=COMPONENT_ID, confirmation=0, parameter=0.0):
        message = mavlink.MAVLink_command_long_message(
            1, component_id, command, confirmation, parameter, 0, 0, 0, 0, 0, 0
        )
        self.base.overheard(message.pack(self.mavlink))

    def order(self, command):
        """Send a command twice, as if the first answer were lost; return the answers' results."""
        before = len(self.heard("COMMAND_ACK"))
        self.send(command)
        self.base.run(0.1)
        self.send(command, confirmation=1)
        self.base.run(0.1)
        answers = [sent.message for sent in self.heard("COMMAND_ACK")[before:]]
        assert {(answer.target_system, answer.command) for answer in answers} <= {
            (self.mavlink.srcSystem, command)
        }
        return [answer.result for answer in answers]


def test_a_ground_station_hears_a_heartbeat_a_second_each_state_once_and_the_evader(base):
    """Catches texts that come twice, and an evader drawn elsewhere."""
    base = base.engaged(stations=STATIONS).run(2.0)
    station = Station(base)
    beats_s = [sent.now_s for sent in station.heard("HEARTBEAT")]
    gaps_s = [later - sooner for sooner, later in pairwise(beats_s)]
    assert gaps_s == pytest.approx([1.0] * len(gaps_s), abs=0.021)
    assert {sent.message.type for sent in station.heard("HEARTBEAT")} == {18}
    changes = [str(change.after) for change in base.transitions if change.after != change.before]
    assert len(station.texts) == len(changes)
    assert station.texts[-1].startswith("guidance: engaged, ")
    assert station.texts[-1].endswith(" s to stand-off")
    shown = station.heard("ADSB_VEHICLE")[-1].message
    assert (shown.ICAO_address, shown.callsign) == (address_of(""), "R6H5")
    assert shown.emitter_type == mavlink.ADSB_EMITTER_TYPE_SERVICE_SURFACE
    frame = base.flight.tracking.local_frame
    north_m, east_m, _ = base.flight.tracking.evader(base.now_s).position_ned_m
    latitude_deg, longitude_deg, _ = frame.wgs84_from_ned((north_m, east_m, 0.0))
    assert shown.lat / 1e7 == pytest.approx(latitude_deg, abs=2e-5)
    assert shown.lon / 1e7 == pytest.approx(longitude_deg, abs=2e-5)


def test_a_station_that_may_order_ends_a_game_and_begins_none_without_signing(base):
    """Catches an unsigned order that begins a flight."""
    base = base.engaged(stations=STATIONS)
    station = Station(base)
    assert station.order(USER_5) == [DENIED, DENIED]
    assert station.order(USER_4) == [DENIED, DENIED]
    assert station.order(512) == [UNSUPPORTED, UNSUPPORTED]
    assert base.state is State.ENGAGED
    assert Station(base, system_id=253).order(USER_1) == []
    station.send(USER_1, component_id=190)
    assert base.run(0.2).state is State.ENGAGED
    assert station.order(USER_1) == [RESULT_ACCEPTED, RESULT_ACCEPTED]
    assert base.state is State.HOLDING
    base.run(1.0)
    assert station.texts[-1] == "guidance: held by operator"
    by = [fields.get("by") for _, message, fields in base.log.lines if message == "order"]
    assert by.count("ground station 255") == 1


def test_over_a_signed_link_a_station_starts_and_engages_and_unsigned_orders_are_dropped(base):
    """Catches a signed order that is not obeyed."""
    base = base.ready(stations=STATIONS, key=KEY)
    assert Station(base).order(USER_1) == []
    station = Station(base, key=KEY)
    assert station.order(USER_5) == [TEMPORARILY_REJECTED, TEMPORARILY_REJECTED]
    assert station.order(USER_4) == [RESULT_ACCEPTED, RESULT_ACCEPTED]
    assert base.until(State.CLIMBING).ground[0].counters()["unsigned"] == 2


def results(station, since):
    """Return the answers that a station has heard since it had heard so many."""
    return [answer.message.result for answer in station.heard("COMMAND_ACK")[since:]]


def test_a_hold_that_is_pressed_again_after_somebody_engaged_holds_though_it_calls_itself_a_repeat(
    base,
):
    """Catches a HOLD that is answered and not obeyed."""
    base = base.engaged(stations=STATIONS)
    station = Station(base)
    assert station.order(USER_1) == [RESULT_ACCEPTED, RESULT_ACCEPTED]
    base.run(2.0)
    assert base.order("engage")["accepted"]
    base.until(State.ENGAGED)
    heard = len(station.heard("COMMAND_ACK"))
    station.send(USER_1, confirmation=1)
    base.run(0.2)
    assert results(station, heard) == [RESULT_ACCEPTED]
    assert base.state is State.HOLDING


def test_a_repeated_start_or_engagement_does_not_begin_again_what_a_person_ended(base):
    """Catches a late repeat that begins again what a person ended."""
    base = base.standing_by(stations=STATIONS, key=KEY)
    station = Station(base, key=KEY)
    station.send(USER_5)
    base.until(State.ENGAGED)
    assert base.order("hold")["accepted"]
    base.run(2.0)
    heard = len(station.heard("COMMAND_ACK"))
    station.send(USER_5, confirmation=1)
    base.run(3.0)
    assert results(station, heard) == [TEMPORARILY_REJECTED]
    assert base.state is State.HOLDING
    assert station.texts[-1] == "guidance: engage refused: ended since; order anew"
    station.send(USER_5)  # a person orders it again
    base.until(State.ENGAGED)


def test_an_order_is_repeated_by_the_same_sender_with_the_same_parameters_only(base):
    base = base.engaged(stations=STATIONS)
    station = Station(base)
    assert station.order(USER_1) == [RESULT_ACCEPTED, RESULT_ACCEPTED]
    station.send(USER_1, confirmation=1, parameter=float("nan"))
    Station(base, system_id=254).send(USER_1, confirmation=1)
    base.run(0.2)
    by = [fields.get("by") for _, message, fields in base.log.lines if message == "order"]
    assert by[-3:] == ["ground station 255", "ground station 255", "ground station 254"]


def test_after_a_reset_a_repeated_hold_is_not_said_to_be_in_force(base):
    """Catches a repeat that is answered with the verdict of an earlier flight."""
    base = base.standing_by(stations=STATIONS)
    station = Station(base)
    assert station.order(USER_3) == [RESULT_ACCEPTED, RESULT_ACCEPTED]
    base.until(State.LANDED)
    assert base.order("reset")["accepted"]
    heard = len(station.heard("COMMAND_ACK"))
    station.send(USER_3, confirmation=1)
    base.run(0.2)
    assert results(station, heard) == [TEMPORARILY_REJECTED]


def test_unsigned_commands_do_not_crowd_out_a_signed_one(base):
    a_second = 100
    base = base.engaged(stations=STATIONS, key=KEY)
    stranger = Station(base)
    station = Station(base, key=KEY)
    for _ in range(a_second):
        stranger.send(USER_2)
    station.send(USER_1)
    base.run(0.1)
    assert base.state is State.HOLDING
    assert base.ground[0].counters()["unsigned"] == a_second


def test_one_stations_commands_do_not_crowd_out_anothers(base):
    base = base.engaged(stations=STATIONS)
    for _ in range(50):
        Station(base, system_id=254).send(USER_4)
    Station(base).send(USER_1)
    base.run(0.1)
    assert base.state is State.HOLDING
    counters = base.ground[0].counters()
    assert (counters["commands"], counters["dropped"]) == (11, 40)


def test_the_custom_actions_of_qgroundcontrol_are_the_orders():
    path = config_folder() / "qgroundcontrol" / "guidance.json"
    document = json.loads(path.read_text(encoding="utf-8"))
    assert (document["version"], document["fileType"]) == (1, "MavlinkActions")
    labels = {action["mavCmd"]: action["label"] for action in document["actions"]}
    assert labels == {command: f"Guidance: {order}" for command, order in ORDERS_BY_COMMAND.items()}
    assert {action["compId"] for action in document["actions"]} == {COMPONENT_ID}
    for action in document["actions"]:
        assert ("signed" in action["description"]) == (
            ORDERS_BY_COMMAND[action["mavCmd"]] in SIGNED_ONLY
        )


def test_the_vehicle_is_no_ground_station(vehicle_document):
    document = vehicle_document(ground_station={"orders_from": [255, 1]})
    with pytest.raises(ConfigError, match=r"orders_from = \[255, 1\]: has vehicle.system_id"):
        parse_document(Config, document, source="test")
