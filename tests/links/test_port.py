"""The contract of `VehicleLink`, kept by every link over every wire: real clients, real sockets, a living peer."""

import itertools
import math
import random
import struct
import time

import pytest
from pymavlink.dialects.v20 import common as dialect

from guidance.frames import Ned
from guidance.links.kinds import LINKS
from guidance.links.mavlink.pymavlink_link import MESSAGE_QUEUE_LENGTH
from guidance.messages import (
    Command,
    CommandAck,
    Heartbeat,
    LocalPosition,
    Parameter,
    ParameterRequest,
    ParameterSet,
    Setpoint,
    StatusText,
    Timesync,
)
from tests.links.rigs import EVERY, RIGS, SPEED, Rig, clock

ARM = Command(400, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
STREAM = Command(511, (32.0, 20000.0, 0.0, 0.0, 0.0, 0.0, 0.0))
FLY = Setpoint(Ned((1.5, -2.25, 0.5)), yaw_rad=0.75)


@pytest.fixture(params=RIGS, scope="module")
def opened_once(request, router):
    kind, opened = RIGS[request.param]
    with opened(kind, router) as rig:
        yield rig


@pytest.fixture
def rig(opened_once):
    """A link over MAVLink."""
    return opened_once.fresh()


@pytest.fixture(params=("pymavlink-udp", "mavsdk-udp"), scope="module")
def opened_on_udp(request, router):
    kind, opened = RIGS[request.param]
    with opened(kind, router) as rig:
        yield rig


@pytest.fixture
def protocol(opened_on_udp):
    """A link over MAVLink on one wire: what it says and understands; wires pass whole frames on."""
    return opened_on_udp.fresh()


@pytest.fixture(params=EVERY, scope="module")
def any_opened(request, router):
    kind, opened = EVERY[request.param]
    with opened(kind, router) as rig:
        yield rig


@pytest.fixture
def any_rig(any_opened):
    """A link of any kind, PX4's topics among them."""
    return any_opened.fresh()


def test_every_kind_of_link_is_held_to_this_contract():
    assert {kind for kind, _ in EVERY.values()} == set(LINKS)


def positions(rig: Rig) -> list[int]:
    return [round(message.time_boot_s * 1e3) for message in rig.of(LocalPosition)]


def settle() -> None:
    # Real clients: long enough for two repeats of MAVSDK's Offboard plugin, were it used
    time.sleep(0.11)


def test_messages_come_typed_in_order_and_stamped_on_arrival(any_rig):
    rig = any_rig
    before_s = rig.clock()
    for n in range(50):
        rig.peer.local_position(n)
    assert rig.hear(lambda got: positions(rig)[-1:] == [49])
    if rig.every_position:
        assert positions(rig) == list(range(50))
    else:
        assert positions(rig) == sorted(set(positions(rig)))
    last = rig.of(LocalPosition)[-1]
    assert last == LocalPosition(
        last.received_s, 0.049, Ned((49.5, 2.0, -3.0)), Ned((0.25, 0.5, -0.75))
    )
    stamps = [message.received_s for message in rig.of(LocalPosition)]
    assert before_s <= stamps[0]
    assert stamps == sorted(stamps)
    assert stamps[-1] <= rig.clock()


def test_arrival_is_when_it_arrived_and_not_when_it_was_fetched(any_rig):
    any_rig.peer.local_position(1)
    time.sleep(0.2)
    asked_s = any_rig.clock()
    waited_s = 0.1 * (SPEED if any_rig.clock is clock else 1.0)
    assert any_rig.hear(lambda got: bool(positions(any_rig)))
    assert any_rig.of(LocalPosition)[0].received_s < asked_s - waited_s


def test_one_call_is_one_setpoint_and_nothing_follows(any_rig):
    for _ in range(3):
        any_rig.link.send_setpoint(FLY)
    assert any_rig.hear(lambda got: len(any_rig.setpoints()) >= 3)
    settle()
    any_rig.link.receive()
    assert any_rig.setpoints() == [([1.5, -2.25, 0.5], 0.75)] * 3
    assert any_rig.counted("setpoints_sent") == 3


def test_a_setpoint_is_addressed_to_the_vehicle_in_its_local_frame(protocol):
    protocol.link.send_setpoint(FLY)
    assert protocol.hear(lambda got: bool(protocol.setpoints()))
    (sent,) = protocol.peer.of("SET_POSITION_TARGET_LOCAL_NED")
    assert (sent.target_system, sent.target_component) == (1, 1)
    assert (sent.coordinate_frame, sent.type_mask) == (1, 2503)
    assert (sent.get_srcSystem(), sent.get_srcComponent()) == (1, 195)


def test_a_setpoint_that_is_not_finite_is_refused_and_not_sent(any_rig):
    with pytest.raises(ValueError, match="must be finite"):
        any_rig.link.send_setpoint(Setpoint(Ned((math.nan, 0.0, 0.0))))
    settle()
    assert any_rig.setpoints() == []


def test_a_command_that_cannot_be_encoded_is_refused_and_not_sent(any_rig):
    with pytest.raises(ValueError, match="infinite"):
        any_rig.link.request(Command(22, (math.inf, 0.0, 0.0, 0.0, 0.0, 0.0, 20.0)))
    settle()
    assert any_rig.commands(22) == 0


def test_a_command_that_acts_is_sent_once_and_its_answer_comes_back(any_rig):
    any_rig.link.request(ARM)
    assert any_rig.hear(lambda got: any(one.command == 400 for one in any_rig.of(CommandAck)))
    settle()
    any_rig.link.receive()
    assert any_rig.commands(400) == 1


def asked(rig: Rig) -> list:
    return [
        message
        for message in rig.peer.of("COMMAND_LONG")
        if (message.command, message.param1) == (511, 32.0)
    ]


def test_a_question_is_repeated_until_it_is_answered(protocol):
    protocol.peer.answers = False
    protocol.link.request(STREAM)
    assert protocol.hear(lambda got: len(asked(protocol)) == 2)
    assert [message.confirmation for message in asked(protocol)] == [0, 1]
    protocol.peer.answers = True
    assert protocol.hear(
        lambda got: any(message.command == 511 for message in protocol.of(CommandAck))
    )
    settle()  # one may have been on its way when the answer came
    count = len(asked(protocol))
    for _ in range(3):
        protocol.received += protocol.link.receive()
        settle()
    assert len(asked(protocol)) == count <= 4
    assert protocol.counted("requests_unanswered") == 0


def test_an_unanswered_question_ends_after_its_repeats(protocol):
    protocol.peer.answers = False
    protocol.link.request(STREAM)
    assert protocol.hear(lambda got: protocol.counted("requests_unanswered") == 1)
    assert len(asked(protocol)) == 4


def test_a_command_that_acts_goes_out_once_even_without_an_answer(protocol):
    protocol.peer.answers = False
    protocol.link.request(ARM)
    assert protocol.hear(lambda got: protocol.counted("requests_unanswered") == 1)
    settle()
    assert sum(message.command == 400 for message in protocol.peer.of("COMMAND_LONG")) == 1


def test_nan_parameters_arrive_as_nan(protocol):
    protocol.link.request(
        Command(22, (math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, 20.0))
    )
    assert protocol.hear(
        lambda got: any(message.command == 22 for message in protocol.of(CommandAck))
    )
    (takeoff,) = [message for message in protocol.peer.of("COMMAND_LONG") if message.command == 22]
    assert math.isnan(takeoff.param1)
    assert takeoff.param7 == 20.0


def test_parameters_come_back_as_numbers(protocol):
    protocol.peer.parameters = {"COM_RCL_EXCEPT": 4, "COM_FLTMODE1": -1, "MPC_XY_VEL_MAX": 12.5}
    for name in protocol.peer.parameters:
        protocol.link.request(ParameterRequest(name))
    assert protocol.hear(
        lambda got: (
            {message.name for message in protocol.of(Parameter)} == set(protocol.peer.parameters)
        )
    )
    assert {
        message.name: message.value for message in protocol.of(Parameter)
    } == protocol.peer.parameters


def test_parameters_are_set_as_px4_reads_them(protocol):
    protocol.link.request(ParameterSet("COM_OBL_RC_ACT", 5.0, 6))
    protocol.link.request(ParameterSet("GF_MAX_HOR_DIST", 205.5, 9))
    wanted = {"COM_OBL_RC_ACT": b"\x05\0\0\0", "GF_MAX_HOR_DIST": struct.pack("<f", 205.5)}

    def heard(_):
        return {
            one.param_id: struct.pack("<f", one.param_value)
            for one in protocol.peer.of("PARAM_SET")
        } == wanted

    assert protocol.hear(heard), protocol.peer.of("PARAM_SET")


def test_only_the_configured_system_and_component_is_accepted(rig):
    for n in range(20):
        rig.peer.local_position(1000 + n, system_id=2)
        rig.peer.heartbeat(system_id=2)
        rig.peer.heartbeat(system_id=1, component_id=100)  # a camera that claims a custom mode
        rig.peer.local_position(2000 + n, system_id=1, component_id=191)
        rig.peer.say(
            dialect.MAVLink_heartbeat_message(6, 8, 0, 99, 4, 3), system_id=255, component_id=190
        )
        rig.peer.say(
            dialect.MAVLink_statustext_message(4, b"from the camera", 0, 0), component_id=100
        )
        rig.peer.local_position(n)
    assert rig.hear(lambda got: len(positions(rig)) == 20)
    settle()
    rig.received += rig.link.receive()
    assert positions(rig) == list(range(20))
    assert rig.of(StatusText) == []
    assert {message.custom_mode for message in rig.of(Heartbeat)} <= {6 << 16}


def test_garbage_on_the_wire_is_survived(rig):
    random.seed(7)
    for n in range(30):
        rig.peer.send(random.randbytes(random.randrange(1, 60)))
        rig.peer.send(b"\xfd\x09\x00\x00" + random.randbytes(10))
        rig.peer.local_position(n)
    for n in range(1000, 1020):
        rig.peer.local_position(n)
    assert rig.hear(lambda got: 1019 in positions(rig))
    assert set(range(1010, 1020)) <= set(positions(rig))
    assert set(positions(rig)) <= {*range(30), *range(1000, 1020)}


def test_mavlink_1_is_understood(rig):
    rig.peer.local_position(41, v1=True)
    rig.peer.local_position(42)
    assert rig.hear(lambda got: len(positions(rig)) == 2)
    assert positions(rig) == [41, 42]


def test_unread_messages_are_bounded(any_rig):
    """Catches a queue that grows while nobody reads it, or drops the newest."""
    for n in range(3000):
        any_rig.peer.local_position(n)
        if n % 100 == 0:
            time.sleep(0.001)  # sockets have queues of their own
    time.sleep(0.15)
    got = [message for message in any_rig.link.receive() if isinstance(message, LocalPosition)]
    assert 0 < len(got) <= MESSAGE_QUEUE_LENGTH
    times = [message.time_boot_s for message in got]
    assert times == sorted(times)
    any_rig.peer.local_position(9999)
    assert any_rig.hear(lambda _: 9999 in positions(any_rig))


def test_time_is_asked_for_and_answered(protocol):
    protocol.peer.say(dialect.MAVLink_timesync_message(0, 4242))
    assert protocol.hear(
        lambda got: any(message.ts1 == 4242 for message in protocol.peer.of("TIMESYNC"))
    )
    (answer,) = [message for message in protocol.peer.of("TIMESYNC") if message.ts1 == 4242]
    assert answer.tc1 == pytest.approx(clock() * 1e9, abs=5 * SPEED * 1e9)
    assert protocol.hear(
        lambda got: any(message.tc1 == 0 for message in protocol.peer.of("TIMESYNC"))
    )
    asked = [message for message in protocol.peer.of("TIMESYNC") if message.tc1 == 0][-1]
    protocol.peer.say(dialect.MAVLink_timesync_message(123456789, asked.ts1))
    assert protocol.hear(lambda got: bool(protocol.of(Timesync)))
    assert protocol.of(Timesync)[0][1:] == (123456789, asked.ts1)


def test_texts_are_joined(protocol):
    text = "Arming denied: Resolve system health failures first, then try again, and again"
    protocol.peer.say(dialect.MAVLink_statustext_message(2, text[:50].encode(), 8, 0))
    protocol.peer.say(dialect.MAVLink_statustext_message(2, text[50:].encode(), 8, 1))
    assert protocol.hear(lambda got: bool(protocol.of(StatusText)))
    assert [(message.severity, message.text) for message in protocol.of(StatusText)] == [(2, text)]


def test_our_heartbeat_says_onboard_computer(protocol):
    protocol.link.send_heartbeat()
    assert protocol.hear(lambda got: bool(protocol.peer.of("HEARTBEAT")), timeout_s=4.0)
    heartbeat = protocol.peer.of("HEARTBEAT")[0]
    assert (heartbeat.type, heartbeat.autopilot, heartbeat.get_srcComponent()) == (18, 8, 195)


def test_all_our_frames_are_numbered_as_one_senders(protocol):
    began = len(protocol.peer.heard)

    def done(_):
        protocol.link.send_setpoint(FLY)
        protocol.link.request(ParameterRequest("NONE"))
        protocol.link.send_heartbeat()
        names = {message.get_type() for message in protocol.peer.heard[began:]}
        return names >= {
            "SET_POSITION_TARGET_LOCAL_NED",
            "PARAM_REQUEST_READ",
            "HEARTBEAT",
            "TIMESYNC",
        }

    assert protocol.hear(done, timeout_s=4.0)
    numbers = [message.get_seq() for message in protocol.peer.heard[began:]]
    assert all((later - earlier) % 256 == 1 for earlier, later in itertools.pairwise(numbers))


@pytest.mark.parametrize("name", EVERY)
def test_after_close_there_is_silence_and_closing_twice_is_fine(name, router):
    kind, opened = EVERY[name]
    with opened(kind, router) as rig:
        close_and_listen(rig)


def close_and_listen(rig: Rig) -> None:
    rig.link.send_setpoint(FLY)
    assert rig.hear(lambda got: len(rig.setpoints()) == 1)
    rig.link.close()
    rig.link.close()
    rig.peer.answers = False
    settle()  # PX4's link says farewell as it closes
    before = len(rig.peer.heard)
    rig.link.send_setpoint(FLY)
    rig.link.request(ARM)
    rig.link.send_heartbeat()
    rig.peer.local_position(1)
    settle()
    assert rig.link.receive() == []
    assert len(rig.peer.heard) == before
    assert rig.link.counters()["setpoints_sent"] == 1
