"""Attacks on orders over Zenoh: replayed bytes, wrong and revoked certificates, a router restarted in flight."""

import socket
import threading
from contextlib import ExitStack, closing, contextmanager

import pytest

from guidance.errors import LinkError
from guidance.links.evaders.zenoh import open_source
from guidance.links.opening import open_wire
from guidance.links.zenoh.credentials import Credentials
from guidance.links.zenoh.keys import make_keys
from guidance.links.zenoh.session import open_router, open_session
from guidance.session.orders.control_bus import owner_token
from guidance.session.orders.mailbox import Mailbox
from guidance.session.orders_section import Control
from tests.harness.bus import ControlBus, ask
from tests.links.peer import until
from tests.links.rigs import clock, free_port
from tests.links.zenoh.parties import CENTURY, FRAME, ROUTER, SAID, folder_of_keys, of


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    return folder_of_keys(tmp_path_factory)


@pytest.fixture
def endpoint():
    return f"tls/127.0.0.1:{free_port(socket.SOCK_STREAM)}"


class Orders:
    """A mailbox that accepts everything and counts the orders."""

    def __init__(self):
        self.taken = []
        self.mailbox = Mailbox()
        self.mailbox.meanwhile = self._answer

    def _answer(self, order):
        self.taken.append(order)
        return {"accepted": True, "order": order, "name": "uav1"}


@contextmanager
def daemon(keys, endpoint, name="uav1-guidance"):
    """The daemon's control bus at a router, or that of another party; its orders."""
    orders = Orders()
    credentials = of(keys, name)
    with closing(
        ControlBus(
            "uav1", orders.mailbox, Control(endpoint=endpoint, host=False), credentials=credentials
        )
    ):
        yield orders


def is_answered(keys, endpoint, name, order="hold"):
    """Return whether an order of this party is answered."""
    try:
        ask(order, endpoint=endpoint, name="uav1", timeout_s=0.5, credentials=of(keys, name))
    except LinkError:
        return False
    return True


@contextmanager
def recording_proxy(port):
    """Forward one TCP connection to a port; yields the proxy's port and the client's bytes."""
    sent = bytearray()
    with closing(socket.create_server(("127.0.0.1", 0))) as listener:

        def carry(source, sink, kept):
            while data := source.recv(65536):
                kept += data
                sink.sendall(data)
            sink.shutdown(socket.SHUT_WR)

        def serve():
            client, _ = listener.accept()
            with client, socket.create_connection(("127.0.0.1", port)) as server:
                back = threading.Thread(target=carry, args=(server, client, bytearray()))
                back.start()
                carry(client, server, sent)
                back.join()

        thread = threading.Thread(target=serve)
        thread.start()
        yield listener.getsockname()[1], sent
        thread.join()


def replay(port, recorded):
    """Send recorded bytes on a new connection, and read until the other side is silent."""
    with socket.create_connection(("127.0.0.1", port), timeout=0.5) as there:
        try:
            for start in range(0, len(recorded), 200):
                there.sendall(recorded[start : start + 200])
            while there.recv(65536):
                pass
        except OSError:
            return


def test_a_recorded_order_to_a_loopback_port_is_worthless(tmp_path):
    """The password answers a new challenge at each connection."""
    port = free_port(socket.SOCK_STREAM)
    orders = Orders()
    token = tmp_path / "run" / "uav1.token"
    with closing(
        ControlBus(
            "uav1",
            orders.mailbox,
            Control(endpoint=f"tcp/127.0.0.1:{port}", host=True, token_file=token),
        )
    ):
        with recording_proxy(port) as (proxy, sent):
            ask("hold", endpoint=f"tcp/127.0.0.1:{proxy}", name="uav1", token_file=token)
        assert orders.taken == ["hold"]
        assert len(sent) > 100
        for _ in range(3):
            replay(port, bytes(sent))
        assert orders.taken == ["hold"]


def test_a_recorded_order_to_a_router_is_worthless(keys, endpoint):
    port = int(endpoint.rpartition(":")[2])
    with open_router(ROUTER, keys, endpoint), daemon(keys, endpoint) as orders:
        with recording_proxy(port) as (proxy, sent):
            assert until(lambda: is_answered(keys, endpoint, "operator", "status"))
            before = len(orders.taken)
            ask(
                "hold",
                endpoint=f"tls/127.0.0.1:{proxy}",
                name="uav1",
                credentials=of(keys, "operator"),
            )
        assert orders.taken[before:] == ["hold"]
        for _ in range(3):
            replay(port, bytes(sent))
        assert orders.taken[before:] == ["hold"]


def test_with_a_certificate_of_another_role_nobody_owns_the_vehicle_or_takes_orders(keys, endpoint):
    roles = ("uav1", "evader1", "operator", "viewer")
    with open_router(ROUTER, keys, endpoint), ExitStack() as strangers:
        forged = [strangers.enter_context(daemon(keys, endpoint, name)) for name in roles]
        with daemon(keys, endpoint) as orders:
            assert until(lambda: is_answered(keys, endpoint, "operator"))
        assert orders.taken
        assert [one.taken for one in forged] == [[]] * len(roles)


def test_the_routers_certificate_is_not_accepted_from_a_client(keys, endpoint):
    tls = {**of(keys, "operator").tls}
    tls |= {
        "connect_certificate": str(keys / "router.pem"),
        "connect_private_key": str(keys / "router.key"),
    }
    with open_router(ROUTER, keys, endpoint), pytest.raises(LinkError, match="no session within"):
        open_session(endpoint, timeout_s=0.7, credentials=Credentials(tls=tls))


@pytest.mark.slow
def test_a_revoked_certificate_is_worthless_after_the_routers_restart(keys, endpoint, tmp_path):
    """As docs/zenoh.md revokes one: the name in the router's configuration is replaced. An open session ends too."""
    make_keys(keys, ["operator-2"], ["127.0.0.1"], CENTURY)
    without = tmp_path / "router.json5"
    without.write_text(
        ROUTER.read_text().replace(
            'cert_common_names: ["operator"]', 'cert_common_names: ["operator-2"]'
        )
    )
    router = open_router(ROUTER, keys, endpoint)
    with (
        daemon(keys, endpoint) as orders,
        open_session(endpoint, credentials=of(keys, "operator")) as stolen,
    ):
        assert until(lambda: is_answered(keys, endpoint, "operator"))
        router.close()
        with open_router(without, keys, endpoint):
            assert until(lambda: is_answered(keys, endpoint, "operator-2"), timeout_s=20.0)
            before = len(orders.taken)
            assert not is_answered(keys, endpoint, "operator")
            assert [
                one
                for one in stolen.get("guidance/uav1/ctl/land", timeout=0.5)
                if one.ok is not None
            ] == []
            assert len(orders.taken) == before


@pytest.mark.slow
def test_after_a_routers_restart_frames_reports_orders_and_the_claim_are_back(keys, endpoint):
    mine = of(keys, "uav1-guidance")
    url = endpoint.replace("tls/", "zenoh://")
    router = open_router(ROUTER, keys, endpoint)
    wire = open_wire(f"{url}/uav1", clock=clock, credentials=mine)
    reports = open_source(
        "json", f"{url}/evader1/report", clock=clock, frame=FRAME, credentials=mine
    )
    with (
        closing(wire),
        closing(reports),
        daemon(keys, endpoint),
        open_session(endpoint, credentials=of(keys, "uav1")) as vehicle,
        open_session(endpoint, credentials=of(keys, "evader1")) as evader,
    ):
        setpoints = []
        vehicle.declare_subscriber(
            "uav1/mavlink_raw/in", lambda sample: setpoints.append(sample.payload.to_bytes())
        )

        def all_pass():
            vehicle.put("uav1/mavlink_raw/out", b"telemetry")
            evader.put("evader1/report", SAID)
            wire.send(b"setpoint")
            answered = is_answered(keys, endpoint, "operator")  # meanwhile the others arrive
            arrived = [bool(wire.receive()), bool(reports.receive()), bool(setpoints)]
            setpoints.clear()
            return answered and all(arrived)

        assert until(all_pass)
        router.close()
        with open_router(ROUTER, keys, endpoint):
            assert until(all_pass, timeout_s=20.0)
            with (
                open_session(endpoint, credentials=mine) as second,
                pytest.raises(LinkError, match="another daemon owns this vehicle"),
            ):
                owner_token(second, "guidance/uav1")
