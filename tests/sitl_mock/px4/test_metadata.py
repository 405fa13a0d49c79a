"""PX4's component metadata as clients use it: named by COMPONENT_METADATA, read over FTP, and parsed by libevents."""

import json
import lzma
import struct

import pytest
from pyulog.libevents_parse.health_and_arming_checks import HealthAndArmingChecks
from pyulog.libevents_parse.parser import Parser

from sitl_mock.protocols import file_crc
from sitl_mock.px4.events import event_of

PARAMETERS = 1
EVENTS = 4


def read_file(flight, path):
    """The content of a file over FTP."""
    content = b""
    flight.send("FILE_TRANSFER_PROTOCOL", 0, 1, 1, ftp(4, path.encode()))
    (size,) = struct.unpack_from("<I", bytes(flight.last("FILE_TRANSFER_PROTOCOL").payload), 12)
    while len(content) < size:
        flight.send("FILE_TRANSFER_PROTOCOL", 0, 1, 1, ftp(5, size=239, offset=len(content)))
        answer = bytes(flight.last("FILE_TRANSFER_PROTOCOL").payload)
        content += answer[12 : 12 + answer[4]]
    return content


def ftp(opcode, data=b"", *, size=None, offset=0):
    length = len(data) if size is None else size
    return (struct.pack("<HBBBBBxI", 1, 0, opcode, length, 0, 0, offset) + data).ljust(251, b"\0")


@pytest.fixture(name="general")
def _general(fly):
    """A flight on the ground, and the general file."""
    flight = fly("px4").run(1.0)
    assert flight.command(512, 397.0) == [0]
    named = flight.last("COMPONENT_METADATA")
    assert named.uri == "mftp://etc/extras/component_general.json.xz"
    content = read_file(flight, named.uri.removeprefix("mftp://"))
    assert file_crc(content) == named.file_crc
    return flight, json.loads(lzma.decompress(content))


def test_the_general_file_names_the_others_with_their_checksums(general):
    flight, document = general
    assert {item["type"] for item in document["metadataTypes"]} == {PARAMETERS, EVENTS}
    for item in document["metadataTypes"]:
        content = read_file(flight, item["uri"].removeprefix("mftp://"))
        assert file_crc(content) == item["fileCrc"]


def test_an_interval_is_accepted_and_nothing_comes(general):
    flight, _ = general
    heard = flight.all("COMPONENT_METADATA")
    assert flight.command(511, 397.0, 100_000.0) == [0]
    flight.run(2.0)
    assert flight.all("COMPONENT_METADATA") == heard


def test_ardupilot_knows_no_metadata(fly):
    assert fly("arducopter").run(1.0).command(512, 397.0) != [0]


@pytest.fixture(name="parser")
def _parser(general):
    flight, document = general
    (uri,) = (item["uri"] for item in document["metadataTypes"] if item["type"] == EVENTS)
    parser = Parser()
    parser.load_definitions(
        json.loads(lzma.decompress(read_file(flight, uri.removeprefix("mftp://"))))
    )
    return parser


def test_every_event_of_a_flight_has_words(fly, parser):
    flight = fly("px4", parameters={"MIS_TAKEOFF_ALT": 2.5})
    flight.until(lambda: flight.vehicle.autopilot.commander.ready_to_arm, 10.0)
    flight.command(176, 1.0, 4.0, 2.0)
    assert flight.command(400, 1.0) == [0]
    flight.run(10.0)
    flight.command(176, 1.0, 4.0, 6.0)
    flight.until(lambda: not flight.vehicle.armed, 60.0)
    events = flight.all("EVENT")
    parsed = [parser.parse(event.id, bytes(event.arguments)) for _, event in events]
    texts = [event.message() for event in parsed if event.type() != "summary"]
    assert "Armed by external command" in texts
    assert "Disarmed by landing" in texts
    assert "Takeoff detected" in texts
    assert all(texts)


def test_a_failsafe_says_what_px4_does(parser):
    event = event_of(2, "Failsafe activated")
    parsed = parser.parse(event.id, event.arguments)
    assert parsed.message() == "Failsafe activated: switching to RTL"


def test_the_report_says_in_words_where_px4_may_arm_and_why_not(fly, parser):
    flight = fly("px4")
    flight.until(lambda: flight.vehicle.autopilot.commander.ready_to_arm, 10.0)
    asked_s = flight.now_s
    flight.command(401, wait_s=3.0)
    checks = HealthAndArmingChecks(debug=False)
    for _, event in flight.all("EVENT", asked_s):
        checks.handle_event(parser.parse(event.id, bytes(event.arguments)))
    components = checks.results.health_components
    said = {check.message for check in checks.results.checks}
    assert checks.results.can_arm(4)
    assert not checks.results.can_arm(14)
    assert {"No offboard signal", "No valid mission available"} <= said
    assert components["gps"].health.is_present
    assert components["system"].arming_check.error
