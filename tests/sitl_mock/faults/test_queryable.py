"""Faults of a fleet that runs: over the Zenoh queryable, and those that strike sockets and sessions."""

import json
import socket
import time

import pytest
import zenoh

from sitl_mock import MockVehicle, TransportError
from sitl_mock.child import running
from sitl_mock.faults import Faulted, queryable
from sitl_mock.mavlink import Decoder
from sitl_mock.transports.zenoh_session import ZenohEndpoint, configuration, with_port

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def fleet():
    with running(
        [{"name": "uav1", "ready_after_s": 0.5}, {"name": "uav2", "ready_after_s": 0.5}]
    ) as started:
        yield started


@pytest.fixture
def session(fleet):
    with zenoh.open(configuration("client", fleet["uav1"].zenoh, connect=True)) as opened:
        yield opened


def ask(session, request, key="uav1/faults"):
    """The reply to one query, or its error."""
    payload = None if request is None else json.dumps(request)
    (reply,) = list(session.get(key, payload=payload, timeout=5.0))
    return json.loads(bytes((reply.ok or reply.err).payload)), reply.ok is not None


def heard(session, name, seconds):
    """Count messages of a name within some seconds."""
    decoder = Decoder()
    names = []
    with session.declare_subscriber("uav1/mavlink_raw/out") as subscriber:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            sample = subscriber.try_recv()
            if sample is None:
                time.sleep(0.005)  # a real server in real time
                continue
            names += [m.get_type() for m in decoder.feed(bytes(sample.payload), whole=True)]
    return names.count(name)


def test_a_query_injects_lists_and_clears(session):
    told, _ = ask(session, {"do": "inject", "kind": "loss", "messages": ["ATTITUDE"]})
    number = told["number"]
    end_s = time.monotonic() + 5.0  # a busy machine may delay the step that puts it in place
    while (listed := ask(session, {"do": "list"})[0])[0][
        "state"
    ] == "waiting" and time.monotonic() < end_s:
        time.sleep(0.02)
    assert [(each["number"], each["kind"], each["state"]) for each in listed] == [
        (number, "loss", "acting")
    ]
    assert heard(session, "ATTITUDE", 0.3) == 0
    assert ask(session, {"do": "clear", "number": number}) == ({"cleared": 1}, True)
    assert heard(session, "ATTITUDE", 0.5) > 25
    assert ask(session, None) == ([], True)


def test_a_query_may_carry_its_keys_as_parameters(session):
    told, good = ask(
        session,
        None,
        "uav1/faults?do=inject;kind=loss;probability=1;messages=ATTITUDE,ODOMETRY;for_s=60",
    )
    assert good
    assert ask(session, None)[0][0]["messages"] == ["ATTITUDE", "ODOMETRY"]
    assert ask(session, None, "uav1/faults?do=clear") == ({"cleared": 1}, True)
    assert told["number"] > 0


def test_kinds_are_told_with_their_keys(session):
    told, _ = ask(session, {"do": "kinds"})
    assert told["ack_wrong"]["required"] == ["result"]
    assert "probability" in told["loss"]["options"]


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"do": "inject", "kind": "los"}, ["fault.kind", "'los'", "loss"]),
        ({"do": "inject", "kind": "loss", "probability": 2}, ["fault.probability", "2", "0 to 1"]),
        ({"do": "inject", "kind": "pilot_mode", "mode": "FLY"}, ["fault.mode", "'FLY'", "POSCTL"]),
        ({"do": "inject"}, ["fault.kind", "None"]),
        ({"do": "explode"}, ["do", "'explode'", "inject"]),
        ({"do": "list", "all": True}, ["all", "True"]),
        ({"do": "clear", "number": 77}, ["number", "77"]),
        ([1, 2], ["payload", "JSON object"]),
    ],
)
def test_a_wrong_query_is_answered_with_what_is_wrong(session, request_, words):
    told, good = ask(session, request_)
    assert not good
    for word in words:
        assert word in told["error"]


def test_a_payload_that_is_no_json_is_answered_too(session):
    (reply,) = list(session.get("uav1/faults", payload=b"\xff{", timeout=5.0))
    assert "JSON" in json.loads(bytes(reply.err.payload))["error"]


def test_faults_of_one_vehicle_are_not_the_others(session):
    ask(session, {"do": "inject", "kind": "silence", "for_s": 60})
    assert ask(session, None, "uav2/faults") == ([], True)
    ask(session, {"do": "clear"})


def test_a_client_outlives_a_restart_of_the_router(session):
    assert heard(session, "HEARTBEAT", 1.2) >= 1
    told, good = ask(session, {"do": "inject", "kind": "router_restart", "for_s": 0.5})
    assert good, told
    end_s = time.monotonic() + 10.0
    time.sleep(0.6)
    while not heard(session, "ATTITUDE", 0.3):
        assert time.monotonic() < end_s
    listed, good = ask(session, None)
    assert (listed, good) == ([], True)


def test_a_vehicle_that_changes_its_port_is_heard_from_the_new_one(fleet, session):
    vehicle = fleet["uav1"]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(("127.0.0.1", vehicle.udp_port))
        client.settimeout(2.0)
        assert client.recvfrom(2048)[1] == ("127.0.0.1", vehicle.udp_listens)
        ask(session, {"do": "inject", "kind": "udp_port_change"})
        end_s = time.monotonic() + 3.0
        while (address := client.recvfrom(2048)[1])[1] == vehicle.udp_listens:
            assert time.monotonic() < end_s
        assert address[0] == "127.0.0.1"


def test_what_is_declared_on_an_endpoint_comes_back_with_it():
    place = with_port("tcp/127.0.0.1:0")
    faulted = Faulted(MockVehicle())
    endpoint = ZenohEndpoint(["uav1"], place)
    try:
        endpoint.declare(lambda opened: queryable.declare(opened, {"uav1": faulted}))
        with zenoh.open(configuration("client", place, connect=True)) as client:
            assert ask(client, {"do": "inject", "kind": "silence"}) == ({"number": 1}, True)
        endpoint.go_down()
        endpoint.go_down()
        endpoint.send("uav1", "onboard", [b"frame"])
        assert endpoint.dropped == 1
        with (
            socket.create_server(("127.0.0.1", int(place.rsplit(":", 1)[1]))),
            pytest.raises(TransportError),
        ):
            endpoint.come_up()
        endpoint.come_up()
        with zenoh.open(configuration("client", place, connect=True)) as client:
            assert [each["kind"] for each in ask(client, {"do": "list"})[0]] == ["silence"]
            assert not ask(client, {"do": "nothing"})[1]
    finally:
        endpoint.close()
