"""Endpoints and the loop: input, output, peers, refusals."""

import json
import select
import socket

import pytest
import zenoh

from sitl_mock import MockVehicle, TransportError
from sitl_mock.mavlink import Decoder, Encoder
from sitl_mock.transports import Arrival, run
from sitl_mock.transports.loop import Loop
from sitl_mock.transports.udp import DATAGRAM_FULL, MAX_PEERS, PEER_FORGOTTEN_S, UdpEndpoint
from sitl_mock.transports.zenoh_session import ZenohEndpoint, free_port, with_port


def udp_socket(port=0):
    each = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    each.bind(("127.0.0.1", port))
    each.settimeout(2.0)
    return each


class Clock:
    def __init__(self):
        self.now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def client():
    with udp_socket() as each:
        yield each


def endpoint_port(endpoint, name="uav1"):
    return int(endpoint.describe()[name].rsplit(":", 1)[1])


def wait_readable(endpoint):
    select.select(endpoint.filenos(), [], [], 2.0)
    return endpoint.receive()


class TestUdp:
    def test_frames_go_to_the_fixed_port_before_anybody_has_spoken(self, client, clock):
        endpoint = UdpEndpoint("onboard", {"uav1": (0, client.getsockname()[1])}, clock)
        endpoint.send("uav1", "onboard", [b"one", b"two"])
        endpoint.send("uav1", "onboard", [b"three"])
        assert [client.recv(100), client.recv(100)] == [b"onetwo", b"three"]
        endpoint.close()

    def test_a_datagram_holds_whole_frames_and_no_more_than_any_network_takes(self, client, clock):
        endpoint = UdpEndpoint("onboard", {"uav1": (0, client.getsockname()[1])}, clock)
        frames = [bytes([number]) * 280 for number in range(1, 8)]
        endpoint.send("uav1", "onboard", frames)
        held = [client.recv(2048), client.recv(2048)]
        assert max(map(len, held)) <= DATAGRAM_FULL
        assert held == [b"".join(frames[:5]), b"".join(frames[5:])]
        endpoint.close()

    def test_another_links_frames_are_not_carried(self, client, clock):
        endpoint = UdpEndpoint("onboard", {"uav1": (0, client.getsockname()[1])}, clock)
        endpoint.send("uav1", "gcs", [b"other"])
        endpoint.send("uav1", "onboard", [b"own"])
        assert client.recv(100) == b"own"
        endpoint.close()

    def test_who_sends_is_a_peer_until_silent_for_a_minute(self, client, clock):
        endpoint = UdpEndpoint("onboard", {"uav1": (0, 0)}, clock)
        client.sendto(b"hello", ("127.0.0.1", endpoint_port(endpoint)))
        assert wait_readable(endpoint) == [Arrival("uav1", "onboard", b"hello")]
        endpoint.send("uav1", "onboard", [b"answer"])
        assert client.recv(100) == b"answer"
        clock.now_s += PEER_FORGOTTEN_S + 1.0
        endpoint.send("uav1", "onboard", [b"late"])
        client.setblocking(False)
        with pytest.raises(BlockingIOError):
            client.recv(100)
        endpoint.close()

    def test_the_number_of_peers_is_bounded(self, clock):
        endpoint = UdpEndpoint("onboard", {"uav1": (0, 0)}, clock)
        clients = [udp_socket() for _ in range(MAX_PEERS + 3)]
        for number, each in enumerate(clients):
            clock.now_s += 1.0
            each.sendto(bytes([number]), ("127.0.0.1", endpoint_port(endpoint)))
            wait_readable(endpoint)
        endpoint.send("uav1", "onboard", [b"news"])
        heard = 0
        for each in clients:
            each.setblocking(False)
            heard += bool(select.select([each], [], [], 0.05)[0])
            each.close()
        assert heard == MAX_PEERS
        endpoint.close()

    def test_a_taken_port_is_named(self, client, clock):
        port = client.getsockname()[1]
        with pytest.raises(TransportError, match=str(port)):
            UdpEndpoint("onboard", {"uav1": (0, 0), "uav2": (port, 0)}, clock)

    def test_a_taken_port_may_be_replaced_by_a_free_one(self, client, clock):
        port = client.getsockname()[1]
        endpoint = UdpEndpoint("gcs", {"uav1": (port, 0)}, clock, any_if_taken=True)
        assert endpoint_port(endpoint) not in {0, port}
        endpoint.close()

    def test_closing_twice_is_allowed(self, clock):
        endpoint = UdpEndpoint("onboard", {"uav1": (0, 0)}, clock)
        endpoint.close()
        endpoint.close()
        assert endpoint.receive() == []


def client_session(endpoint, namespace):
    return zenoh.open(
        zenoh.Config.from_json5(
            json.dumps(
                {
                    "mode": "client",
                    "namespace": namespace,
                    "connect": {"endpoints": [endpoint], "timeout_ms": 3000},
                    "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
                    "transport": {"shared_memory": {"enabled": False}},
                }
            )
        )
    )


class TestZenoh:
    @pytest.fixture
    def address(self):
        return with_port("tcp/127.0.0.1:0")

    @pytest.fixture
    def endpoint(self, address):
        endpoint = ZenohEndpoint(["uav1", "evader"], address)
        yield endpoint
        endpoint.close()

    def test_one_sample_in_is_one_arrival_for_its_vehicle(self, endpoint, address):
        with client_session(address, "evader") as session:
            session.put("mavlink_raw/in", b"frame")
            assert wait_readable(endpoint) == [Arrival("evader", "onboard", b"frame")]

    def test_one_frame_out_is_one_sample_with_the_mavlink_encoding(self, endpoint, address):
        with client_session(address, "uav1") as session:
            samples = zenoh.handlers.FifoChannel(16)
            subscriber = session.declare_subscriber("mavlink_raw/out", samples)
            while not endpoint.session.declare_publisher(
                "uav1/mavlink_raw/out"
            ).matching_status.matching:
                continue
            endpoint.send("uav1", "onboard", [b"one", b"two"])
            endpoint.send("evader", "onboard", [b"for others"])
            heard = [subscriber.recv(), subscriber.recv()]
            assert [bytes(each.payload) for each in heard] == [b"one", b"two"]
            assert str(heard[0].encoding) == "application/octet-stream;mavlink"
            assert heard[0].priority == zenoh.Priority.REAL_TIME
            subscriber.undeclare()

    def test_a_taken_port_is_named(self, endpoint, address):
        with pytest.raises(TransportError, match=f"{address} is in use"):
            ZenohEndpoint(["uav1"], address)

    def test_an_endpoint_that_is_none_is_named(self):
        with pytest.raises(TransportError, match="tcp/nowhere"):
            ZenohEndpoint(["uav1"], "tcp/nowhere")

    def test_a_router_that_is_not_there_is_named(self, monkeypatch):
        monkeypatch.setattr("sitl_mock.transports.zenoh_session.CONNECT_S", 0.1)
        address = f"tcp/127.0.0.1:{free_port()}"
        with pytest.raises(TransportError, match="cannot be reached"):
            ZenohEndpoint(["uav1"], address, mode="client", connect=True)

    def test_closing_twice_is_allowed(self, address):
        endpoint = ZenohEndpoint(["uav1"], address)
        endpoint.close()
        endpoint.close()

    def test_the_queue_is_bounded_and_what_is_dropped_is_counted(
        self, endpoint, address, monkeypatch
    ):
        monkeypatch.setattr("sitl_mock.transports.zenoh_session.QUEUE_MAX", 5)
        with client_session(address, "uav1") as session:
            for _ in range(50):
                session.put("mavlink_raw/in", b"x")
            while endpoint.dropped < 45:
                continue
        assert len(endpoint.receive()) == 5


class Memory:
    """An endpoint in memory."""

    def __init__(self, arrivals):
        self.dropped = 0
        self.arrivals = arrivals
        self.sent = []

    def filenos(self):
        return []

    def receive(self):
        arrivals = self.arrivals
        self.arrivals = []
        return arrivals

    def send(self, vehicle, link, frames):
        self.sent += [(vehicle, link, frame) for frame in frames]

    def describe(self):
        return {}

    def close(self):
        pass


class TestLoop:
    def test_what_comes_is_answered_in_the_same_cycle(self, clock):
        frame = Encoder(255, 190).pack("COMMAND_LONG", 2, 1, 512, 0, 148.0, *[0.0] * 6)
        endpoint = Memory([Arrival("b", "onboard", frame)])
        vehicles = {"a": MockVehicle("px4", system_id=1), "b": MockVehicle("px4", system_id=2)}
        Loop(vehicles, [endpoint], clock).cycle()
        decoder = Decoder()
        answers = [m for name, _, sent in endpoint.sent for m in decoder.feed(sent) if name == "b"]
        assert {"COMMAND_ACK", "AUTOPILOT_VERSION"} <= {m.get_type() for m in answers}
        assert all(name == "b" for name, _, sent in endpoint.sent if sent[7:8] == b"\x94")

    def test_time_in_which_the_process_was_suspended_is_left_out(self, clock):
        vehicle = MockVehicle("px4")
        loop = Loop({"a": vehicle}, [Memory([])], clock)
        loop.cycle()
        clock.now_s += 0.5
        loop.cycle()
        assert vehicle.autopilot.state.now_s == pytest.approx(100.5)
        clock.now_s += 30.0
        loop.cycle()
        assert vehicle.autopilot.state.now_s == pytest.approx(100.51)
        clock.now_s += 0.5
        loop.cycle()
        assert vehicle.autopilot.state.now_s == pytest.approx(101.01)

    def test_it_runs_until_told_to_stop(self, clock):
        endpoint = Memory([])
        cycles = []

        def stop(_ready):
            clock.now_s += 0.01
            cycles.append(1)
            return len(cycles) > 30

        run({"a": MockVehicle("px4")}, [endpoint], clock, stop)
        assert len(endpoint.sent) > 50
