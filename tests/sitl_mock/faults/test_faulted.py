"""Requests, transports and hostile frames, in one process and without sleeping."""

import contextlib
import json
import socket

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl_mock import ConfigError, MockVehicle, TransportError
from sitl_mock.faults import KINDS, Faulted, frames, parse_script
from sitl_mock.faults.faulted import MAX_COPIES
from sitl_mock.faults.queryable import answer, read_request
from sitl_mock.mavlink import SPEC_BY_ID, Decoder, Encoder, Signing
from sitl_mock.transports.disturbance import RETRY_S, Disturbances
from sitl_mock.transports.udp import UdpEndpoint
from tests.sitl_mock.vehicle.hostile import HostileTraffic


class Router:
    """An endpoint that notes when it goes down and comes up; the first attempts to come up may fail."""

    def __init__(self, failures=0):
        self.events = []
        self.failures = failures

    def go_down(self):
        self.events.append("down")

    def come_up(self):
        if self.failures:
            self.failures -= 1
            raise TransportError("port taken")
        self.events.append("up")


@pytest.fixture(scope="module")
def plain_vehicle():
    return Faulted(MockVehicle())


def test_a_restart_lasts_as_long_as_the_fault_and_retries_while_the_port_is_taken():
    script = parse_script({"fault": [{"kind": "router_restart", "for_s": 2.0}]})
    vehicle = Faulted(MockVehicle(), "uav1", script)
    router = Router(failures=1)
    disturbances = Disturbances({"uav1": vehicle}, [router])
    disturbances.carry_out(9.0)
    assert router.events == []
    vehicle.step(10.0)
    disturbances.carry_out(10.0)
    disturbances.carry_out(11.9)
    assert router.events == ["down"]
    disturbances.carry_out(12.0)
    disturbances.carry_out(12.0 + RETRY_S - 0.01)
    assert router.events == ["down"]
    disturbances.carry_out(12.0 + RETRY_S)
    assert router.events == ["down", "up"]


def test_a_port_change_moves_one_vehicle_and_keeps_its_file_descriptor():
    ends = UdpEndpoint("onboard", {"uav1": (0, 0), "uav2": (0, 0)}, lambda: 0.0)
    try:
        script = parse_script({"fault": [{"kind": "udp_port_change", "vehicle": "uav1"}]})
        vehicle = Faulted(MockVehicle(), "uav1", script)
        before = ends.describe()
        filenos = ends.filenos()
        vehicle.step(0.0)
        Disturbances({"uav1": vehicle}, [ends]).carry_out(0.0)
        after = ends.describe()
        assert after["uav1"] != before["uav1"]
        assert after["uav2"] == before["uav2"]
        assert ends.filenos() == filenos
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.sendto(b"hello", ("127.0.0.1", int(after["uav1"].rsplit(":", 1)[1])))
            assert [arrival.data for arrival in ends.receive()] == [b"hello"]
    finally:
        ends.close()


@pytest.mark.parametrize(
    ("parameters", "payload", "values"),
    [
        ("", None, {}),
        ("do=list", None, {"do": "list"}),
        (
            "do=inject;kind=loss;probability=0.5",
            None,
            {"do": "inject", "kind": "loss", "probability": 0.5},
        ),
        ("messages=ATTITUDE,ODOMETRY", None, {"messages": ["ATTITUDE", "ODOMETRY"]}),
        (
            "commands=[400,22];text=hello there",
            None,
            {"commands": [400, 22], "text": "hello there"},
        ),
        ("do=list", b'{"do": "clear"}', {"do": "clear"}),
    ],
)
def test_a_request_is_read_from_parameters_or_payload(parameters, payload, values):
    assert read_request(parameters, payload) == values


@pytest.mark.parametrize("payload", [b"{", b"[1]", b"\xff\xfe", b"3"])
def test_a_payload_that_is_no_object_is_refused(payload):
    with pytest.raises(ConfigError, match="payload"):
        read_request("", payload)


def test_answers_are_json_and_do_what_they_say():
    vehicle = Faulted(MockVehicle())
    vehicle.step(0.0)
    number = answer(vehicle, {"do": "inject", "kind": "gps_loss"})["number"]
    listed = answer(vehicle, {})
    assert [(each["number"], each["state"]) for each in listed] == [(number, "waiting")]
    vehicle.step(0.1)
    assert json.loads(json.dumps(answer(vehicle, {"do": "list"})))[0]["state"] == "acting"
    assert answer(vehicle, {"do": "clear", "number": number}) == {"cleared": 1}
    vehicle.step(0.2)
    assert answer(vehicle, {"do": "clear"}) == {"cleared": 0}
    assert answer(vehicle, {"do": "kinds"}).keys() == KINDS.keys()
    with pytest.raises(ConfigError, match="do = 'dance'"):
        answer(vehicle, {"do": "dance"})
    with pytest.raises(ConfigError, match="loud = 1"):
        answer(vehicle, {"do": "list", "loud": 1})


JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | st.sampled_from(sorted(KINDS)),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=4,
)
KEYS = sorted(
    {key for kind in KINDS.values() for key in kind.options}
    | {"number", "at_s", "for_s", "messages", "link"}
)


@given(
    do=st.sampled_from(["inject", "clear", "list", "kinds"]) | JSON,
    kind=st.sampled_from(sorted(KINDS)) | JSON,
    keys=st.dictionaries(st.sampled_from(KEYS), JSON, max_size=3),
)
def test_any_request_is_answered_or_refused_in_words(plain_vehicle, do, kind, keys):
    """Catches a request over the bus that ends in an exception."""
    request = {"do": do, **keys} | ({"kind": kind} if do == "inject" else {})
    with contextlib.suppress(ConfigError):  # anything else would leave a query without an answer
        json.dumps(answer(plain_vehicle, request))
    plain_vehicle.clear()


def test_faults_that_double_each_other_do_not_multiply_without_end():
    doubling = [{"kind": "duplicate", "copies": 10, "messages": ["HEARTBEAT"]}] * 12
    vehicle = Faulted(MockVehicle(), "uav1", parse_script({"fault": doubling}))
    vehicle.step(0.0)
    beats = [frame for frame in vehicle.step(1.05) if frames.message_id(frame) == 0]
    assert len(beats) in {MAX_COPIES, 2 * MAX_COPIES}


def test_hostile_bytes_pass_every_fault_without_exception_or_change_of_state():
    """Catches a fault that trusts the bytes it changes."""
    needs = {"ack_wrong": {"result": 3}, "param_echo": {"parameter": "COM_OF_LOSS_T", "value": 1}}
    both = [
        {
            "kind": name,
            **needs.get(name, {}),
            **({"direction": "both", "messages": []} if kind.scope.open else {}),
        }
        for name, kind in KINDS.items()
        if kind.scope is not None and name not in {"loss", "router_restart"}
    ]
    traffic = HostileTraffic(5)
    vehicle = Faulted(MockVehicle(), "uav1", parse_script({"fault": both}))
    for count in range(200):
        vehicle.step(count * 0.02, [make() for make in traffic.kinds.values()])
    vehicle.step(4.5, [b""])
    assert not vehicle.vehicle.armed
    assert vehicle.vehicle.mode == "HOLD"


@pytest.mark.parametrize("key", [None, bytes(range(32))])
def test_a_changed_frame_is_the_frame_an_encoder_would_have_made(key):
    signing = Signing(key)
    check = Decoder(signing=Signing(key))
    encoder = Encoder(7, 1, signing=signing)
    frame = encoder.pack("LOCAL_POSITION_NED", 100, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    (message,) = check.feed(
        frames.changed(frame, {"x": -1.5, "time_boot_ms": 2**32 + 5}, key), whole=True
    )
    assert (message.x, message.y, message.time_boot_ms) == (-1.5, 2.0, 5)
    assert (message.get_srcSystem(), message.get_seq()) == (7, frame[4])


def test_base_sizes_are_those_of_mavlink_1():
    """Lengths of the MAVLink 1 messages, as in the C headers' *_MIN_LEN."""
    known = {
        0: 9,
        1: 31,
        24: 30,
        32: 28,
        33: 28,
        77: 3,
        147: 36,
        148: 60,
        242: 52,
        253: 51,
        331: 230,
    }
    assert {number: SPEC_BY_ID[number].base_size for number in known} == known
