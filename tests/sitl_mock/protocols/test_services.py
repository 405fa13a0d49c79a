"""The small protocols: time, identity, home, modes, FTP, texts, and the session that holds them together."""

import struct

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as dialect

from sitl_mock import MockVehicle, protocols
from sitl_mock.protocols import (
    ARDUPILOT_CAPABILITIES,
    MESSAGES,
    PX4_CAPABILITIES,
    PX4_OWN_ID_ONLY,
    Capability,
    CommandAnswer,
    CommandProtocol,
    FtpError,
    FtpProtocol,
    HomeProtocol,
    Place,
    Session,
    StatusTexts,
    TimeProtocol,
    addressed,
    ardupilot_identity,
    available_modes,
    px4_identity,
)
from sitl_mock.protocols.files import FileTree

# -- time --------------------------------------------------------------------------------------------------------------


def test_a_question_for_the_time_is_answered_with_the_own_clock_and_the_askers_stamp(wire):
    client = wire(TimeProtocol())
    client.now_s = 12.5
    (answer,) = client.send("TIMESYNC", 0, 987_654_321)
    assert (answer.tc1, answer.ts1) == (12_500_000_000, 987_654_321)


def test_an_answer_to_a_timesync_is_not_answered(wire):
    assert wire(TimeProtocol()).send("TIMESYNC", 5, 6) == []


def test_a_broadcast_ping_is_answered_to_the_sender_and_an_answer_is_not_answered(wire):
    client = wire(TimeProtocol(), client=(42, 191))
    (answer,) = client.send("PING", 123_456, 7, 0, 0)
    assert (answer.time_usec, answer.seq, answer.target_system, answer.target_component) == (
        123_456,
        7,
        42,
        191,
    )
    assert client.send("PING", 123_456, 7, 1, 1) == []
    assert client.send("HEARTBEAT", 6, 8, 0, 0, 4, 3) == client.wait(2.0) == []


# -- identity ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("identity", "version", "number"),
    [
        (px4_identity(0xABC), (1, 17, 0), 5_283_920_058_631_409_231 + 0xABC - 1),
        (ardupilot_identity(0xABC), (4, 5, 7), 0xABC),
    ],
)
def test_the_version_message_tells_version_and_number_of_the_vehicle(
    wire, identity, version, number
):
    (message,) = wire(None).read([identity.autopilot_version()])
    packed = message.flight_sw_version
    assert ((packed >> 24), (packed >> 16) & 255, (packed >> 8) & 255, packed & 255) == (
        *version,
        255,
    )
    assert message.uid == number
    assert int.from_bytes(bytes(message.uid2), "little") == (0xABC if identity.uid2 else 0)


def test_capabilities_are_what_the_protocols_do():
    for capabilities in (PX4_CAPABILITIES, ARDUPILOT_CAPABILITIES):
        assert Capability.FTP in capabilities
        wanted = (
            Capability.MISSION_INT
            | Capability.COMMAND_INT
            | Capability.MAVLINK2
            | Capability.MISSION_FENCE
        )
        assert wanted in capabilities
    assert Capability.PARAM_ENCODE_BYTEWISE in PX4_CAPABILITIES
    assert int(ARDUPILOT_CAPABILITIES) == 0xFBEF


# -- home and origin ---------------------------------------------------------------------------------------------------

ZURICH = Place(47.397742, 8.545594, 488.25)


def test_an_origin_that_is_taken_is_confirmed_with_equal_values(wire):
    taken = []
    client = wire(
        HomeProtocol(lambda now_s, place: not taken.append(place), lambda now_s, place: True)
    )
    (answer,) = client.send("SET_GPS_GLOBAL_ORIGIN", 1, 473_977_420, 85_455_940, 488_250)
    assert (answer.get_type(), answer.latitude, answer.longitude, answer.altitude) == (
        "GPS_GLOBAL_ORIGIN",
        473_977_420,
        85_455_940,
        488_250,
    )
    assert taken == [pytest.approx(ZURICH)]


def test_an_origin_that_is_refused_or_nowhere_is_not_confirmed(wire):
    client = wire(HomeProtocol(lambda now_s, place: False, lambda now_s, place: False))
    assert client.send("SET_GPS_GLOBAL_ORIGIN", 1, 473_977_420, 85_455_940, 488_250) == []
    eager = wire(HomeProtocol(lambda now_s, place: True, lambda now_s, place: True))
    assert eager.send("SET_GPS_GLOBAL_ORIGIN", 1, 900_000_001, 0, 0) == []
    assert eager.send("SET_GPS_GLOBAL_ORIGIN", 1, 0, -1_800_000_001, 0) == []
    assert eager.send("SET_GPS_GLOBAL_ORIGIN", 1, 0, 0, 100_000_001) == []
    assert eager.send("PING", 1, 1, 0, 0) == eager.wait(1.0) == []


def test_home_can_be_set_by_its_message(wire):
    taken = []
    client = wire(
        HomeProtocol(lambda now_s, place: True, lambda now_s, place: not taken.append(place))
    )
    assert (
        client.send(
            "SET_HOME_POSITION", 1, 473_977_420, 85_455_940, 488_250, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
        )
        == []
    )
    assert taken == [pytest.approx(ZURICH)]


# -- modes -------------------------------------------------------------------------------------------------------------

MODES = ((0x030000, 1, 0, ""), (0x03040000, 0, 1, "Hold"), (0x060000, 0, 3, "Offboard"))


def test_all_modes_or_one_of_them_are_listed(wire):
    client = wire(None)
    every = client.read(available_modes(MODES, 0))
    assert [(m.mode_index, m.number_modes, m.mode_name) for m in every] == [
        (1, 3, ""),
        (2, 3, "Hold"),
        (3, 3, "Offboard"),
    ]
    told = [(m.custom_mode, m.standard_mode, m.properties, m.mode_name) for m in every]
    assert told == list(MODES)
    assert [m.mode_name for m in client.read(available_modes(MODES, 2))] == ["Hold"]
    assert available_modes(MODES, 4) == []


# -- FTP ---------------------------------------------------------------------------------------------------------------


def ftp(client, opcode, sequence=7, session=0, data=b""):
    head = struct.pack("<HBBBBBBI", sequence, session, opcode, len(data), 0, 0, 0, 0)
    return client.send("FILE_TRANSFER_PROTOCOL", 0, 1, 1, list((head + data).ljust(251, b"\0")))


@pytest.mark.parametrize(
    ("opcode", "error"),
    [
        (4, FtpError.FILE_NOT_FOUND),
        (3, FtpError.FILE_NOT_FOUND),
        (5, FtpError.INVALID_SESSION),
        (15, FtpError.INVALID_SESSION),
        (0, FtpError.UNKNOWN_COMMAND),
        (16, FtpError.UNKNOWN_COMMAND),
        (200, FtpError.UNKNOWN_COMMAND),
    ],
)
def test_a_request_for_a_file_is_refused_at_once_with_the_next_sequence(wire, opcode, error):
    client = wire(FtpProtocol(FileTree({})), client=(42, 191))
    (answer,) = ftp(client, opcode, sequence=0xFFFF, data=b"@PARAM/param.pck")
    assert (answer.target_network, answer.target_system, answer.target_component) == (0, 42, 191)
    head = struct.pack("<HBBBBBBI", 0, 0, 129, 1, opcode, 0, 0, 0)
    assert bytes(answer.payload) == head + bytes((error,)) + bytes(251 - 13)


@pytest.mark.parametrize("opcode", [1, 2])
def test_closing_what_was_never_open_succeeds(wire, opcode):
    (answer,) = ftp(wire(FtpProtocol(FileTree({}))), opcode)
    assert (answer.payload[3], answer.payload[4], answer.payload[5]) == (128, 0, opcode)


def test_answers_are_not_answered(wire):
    client = wire(FtpProtocol(FileTree({})))
    assert (
        ftp(client, 128)
        == ftp(client, 129)
        == client.send("PING", 1, 1, 0, 0)
        == client.wait(1.0)
        == []
    )


# -- STATUSTEXT --------------------------------------------------------------------------------------------------------


def assembled(messages):
    """Put chunks together as the message's definition says: until one that does not fill its field."""
    text = b""
    for chunk, message in enumerate(messages):
        assert message.chunk_seq == chunk
        raw = message._text_raw
        text += raw
        if len(raw) < 50:
            assert chunk == len(messages) - 1
            return text
    raise AssertionError("no chunk ends the text")


def test_a_short_text_is_one_message_without_an_id(wire):
    (message,) = wire(None).read(StatusTexts().replies(4, "x" * 50))
    assert (message.severity, message.text, message.id, message.chunk_seq) == (4, "x" * 50, 0, 0)


@given(
    st.text(
        alphabet=st.characters(min_codepoint=32, max_codepoint=0x17F), min_size=51, max_size=400
    )
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_long_text_comes_back_whole_from_its_chunks(wire, text):
    assert assembled(wire(None).read(StatusTexts().replies(6, text))) == text.encode()


def test_long_texts_have_ids_that_differ_and_are_never_zero(wire):
    texts = StatusTexts()
    client = wire(None)
    ids = [{message.id for message in client.read(texts.replies(6, "y" * 100))} for _ in range(3)]
    assert ids == [{1}, {2}, {3}]
    for _ in range(0xFFFF - len(ids)):
        texts.replies(6, "y" * 51)
    assert {message.id for message in client.read(texts.replies(6, "y" * 100))} == {1}


def test_a_text_without_end_is_cut_to_256_chunks():
    assert len(StatusTexts().replies(6, "z" * 20_000)) == 256


# -- session -----------------------------------------------------------------------------------------------------------


def session(executed, **options):
    command = CommandProtocol(
        1, 1, lambda now_s, c: executed.append(c) or [CommandAnswer(0), CommandAnswer(0, delay_s=1)]
    )
    return Session(
        1, 1, command=command, time=TimeProtocol(), ftp=FtpProtocol(FileTree({})), **options
    )


def test_a_session_gives_each_message_to_its_protocol_and_the_rest_back(wire):
    executed = []
    held = session(executed)
    client = wire(held)
    assert client.send("COMMAND_LONG", 1, 1, 400, 0, *[0.0] * 7)[0].get_type() == "COMMAND_ACK"
    assert client.send("TIMESYNC", 0, 5)[0].get_type() == "TIMESYNC"
    assert client.wait(1.1)[0].get_type() == "COMMAND_ACK"
    setpoint = client.as_received(_heartbeat())
    assert held.handle(0.0, setpoint) is None
    assert len(executed) == 1


def _heartbeat():
    return dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def test_a_session_drops_what_is_meant_for_another(wire):
    client = wire(session([]))
    assert client.send("FILE_TRANSFER_PROTOCOL", 0, 2, 1, [0] * 251) == []
    assert client.send("FILE_TRANSFER_PROTOCOL", 0, 1, 2, [0] * 251) == []
    assert len(client.send("FILE_TRANSFER_PROTOCOL", 0, 0, 0, [0] * 251)) == 1


def test_px4_ignores_parameters_missions_and_ftp_to_system_zero(wire):
    client = wire(session([], own_id_only=PX4_OWN_ID_ONLY))
    assert client.send("FILE_TRANSFER_PROTOCOL", 0, 0, 0, [0] * 251) == []
    assert len(client.send("FILE_TRANSFER_PROTOCOL", 0, 1, 0, [0] * 251)) == 1
    assert len(client.send("PING", 1, 1, 0, 0)) == 1


def test_a_protocol_with_an_unknown_name_is_refused():
    with pytest.raises(KeyError, match="telepathy"):
        Session(1, 1, telepathy=FtpProtocol(FileTree({})))


def test_every_protocol_that_sends_late_says_when_it_is_idle():
    exported = [getattr(protocols, name) for name in protocols.__all__]
    late = [kind for kind in exported if hasattr(kind, "advance")]
    assert len(late) >= 6
    assert all(hasattr(kind, "is_idle") or kind is Session for kind in late)


def test_no_message_belongs_to_two_protocols():
    names = [name for group in MESSAGES.values() for name in group]
    assert len(names) == len(set(names))


def test_a_message_without_a_target_is_for_everybody():
    assert addressed(_heartbeat(), 1, 1)


def test_timesync_uses_the_clock_of_the_vehicles_telemetry_independent_of_its_boot():
    vehicle = MockVehicle("rover")
    vehicle.step(1000.0)
    sender = dialect.MAVLink(None, 255, 190)
    question = dialect.MAVLink_timesync_message(0, 7).pack(sender)
    interval = dialect.MAVLink_command_long_message(2, 1, 511, 0, 33, 20_000, 0, 0, 0, 0, 0)
    interval.target_system = vehicle.system_id
    frames = vehicle.step(1003.0, [bytes(interval.pack(sender)), bytes(question)]) + vehicle.step(
        1003.1
    )
    heard = [dialect.MAVLink(None).decode(bytearray(frame)) for frame in frames]
    answer = next(one for one in heard if one.get_type() == "TIMESYNC" and one.ts1 == 7)
    position = next(one for one in reversed(heard) if one.get_type() == "GLOBAL_POSITION_INT")
    assert answer.tc1 / 1e9 == pytest.approx(3.0)
    assert position.time_boot_ms / 1e3 == pytest.approx(3.1, abs=0.03)
