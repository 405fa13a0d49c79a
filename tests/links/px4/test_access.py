"""The link to PX4 by TLS, on a router with the access control that comes along. PX4 itself speaks plain TCP."""

import socket
import time

import pytest

from guidance.autopilots import PX4, Mode
from guidance.errors import LinkError
from guidance.frames import Ned
from guidance.links.port import parse
from guidance.links.px4.link import open_px4_link
from guidance.links.px4.messages import TYPES
from guidance.links.zenoh.credentials import NO_CREDENTIALS
from guidance.links.zenoh.session import open_router, open_session
from guidance.messages import LocalPosition, Setpoint
from guidance.session.orders.control_bus import owner_token
from tests.links.peer import until
from tests.links.px4.peer import PURSUIT, Px4Peer, beating
from tests.links.rigs import free_port
from tests.links.zenoh.parties import ROUTERS, folder_of_keys, of

STREAM = socket.SOCK_STREAM


class Network:
    def __init__(self, keys, plain: int, secure: int) -> None:
        self.keys = keys
        self.plain = f"tcp/127.0.0.1:{plain}"
        self.secure = f"tls/127.0.0.1:{secure}"
        self.url = f"zenoh+tls://127.0.0.1:{secure}"

    def of(self, name: str):
        return of(self.keys, name)


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    keys = folder_of_keys(tmp_path_factory)
    opened = Network(keys, free_port(STREAM), free_port(STREAM))
    text = (ROUTERS / "px4.json5").read_text(encoding="utf-8")
    for endpoint, own in (
        ("tcp/127.0.0.1:7447", opened.plain),
        ("tls/0.0.0.0:7448", opened.secure),
    ):
        assert endpoint in text
        text = text.replace(endpoint, own)
    (keys / "px4.json5").write_text(text, encoding="utf-8")
    with open_router(keys / "px4.json5", keys):
        yield opened


@pytest.fixture
def peer(network):
    with open_session(network.plain) as session:
        peer = Px4Peer(session)
        with beating(peer):
            yield peer
        peer.close()


def opened(network, credentials, timeout_s: float = 5.0):
    return open_px4_link(
        parse(network.url),
        mode_name="Pursuit",
        beside=None,
        clock=time.monotonic,
        credentials=credentials,
        timeout_s=timeout_s,
    )


def test_by_tls_the_mode_is_registered_entered_flown_and_left(network, peer):
    link = opened(network, network.of("uav1-guidance"))
    try:
        assert link.mode.registration == (PURSUIT, 0, 1)
        link.request(PX4.as_mode.set_mode(Mode.GUIDED))
        assert until(lambda: link.mode.entered)
        link.send_setpoint(Setpoint(Ned((1.5, -2.25, 0.5))))
        assert until(lambda: bool(peer.of("trajectory_setpoint")))
        assert [*peer.of("trajectory_setpoint")[0].velocity] == [1.5, -2.25, 0.5]
        received = []

        def heard() -> bool:
            peer.local_position(7)
            received.extend(link.receive())
            return any(isinstance(one, LocalPosition) for one in received)

        assert until(heard)
        link.request(PX4.set_mode(Mode.HOLD))
        assert until(lambda: bool(peer.of("vehicle_command_mode_executor")))
    finally:
        link.close()
    assert until(lambda: bool(peer.of("unregister_ext_component")))


def test_only_guidance_commands_px4(network, peer):
    arm = TYPES["VehicleCommand"].encode(command=400, param1=1.0)
    key = TYPES["VehicleCommand"].key(0, "fmu/in/vehicle_command")
    forgers = [
        open_session(network.plain),
        open_session(network.secure, credentials=network.of("viewer")),
        open_session(network.secure, credentials=network.of("evader1")),
    ]
    with open_session(network.secure, credentials=network.of("uav1-guidance")) as guidance:

        def arrived() -> bool:
            for session in forgers:
                session.put(key, arm)
            guidance.put(key, TYPES["VehicleCommand"].encode(command=16))
            return len(peer.of("vehicle_command")) >= 3

        assert until(arrived)
    for session in forgers:
        session.close()
    assert {one.command for one in peer.of("vehicle_command")} == {16}


def test_the_vehicle_has_one_owner(network, peer):
    owner = open_session(network.secure, credentials=network.of("uav1-guidance"))
    other = open_session(network.secure, credentials=network.of("uav1-guidance"))
    claim = owner_token(owner, "0/guidance")
    try:
        with pytest.raises(LinkError, match="another daemon owns this vehicle"):
            owner_token(other, "0/guidance")
    finally:
        claim.undeclare()
        owner.close()
        other.close()


def test_without_a_certificate_there_is_no_link(network, peer):
    with pytest.raises(LinkError, match="no session"):
        opened(network, NO_CREDENTIALS, timeout_s=1.0)
