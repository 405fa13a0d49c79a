"""Every kind of link, opened against a living peer over its own wire, behind one handle."""

import contextlib
import itertools
import json
import os
import pty
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import zenoh

from guidance.autopilots import PX4, Mode
from guidance.links import MemoryWire
from guidance.links.kinds import LinkOrder
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.links.opening import open_link, open_wire, wait_until_heard
from guidance.links.port import VehicleLink
from guidance.links.px4.link import Px4Link
from guidance.links.section import Vehicle
from guidance.messages import Heartbeat, SystemStatus, Timesync
from tests.links.peer import Peer, living, until
from tests.links.px4.peer import Px4Peer, beating

SPEED = 10.0  # the injected clock runs fast, so that half-second repeats take a twentieth
_namespaces = itertools.count()
_domains = itertools.count(100)


def clock() -> float:
    return time.monotonic() * SPEED


class Rig:
    """A link and its peer. `hear` polls until a condition on all that was received holds.

    Attributes:
        clock: The link's.
        every_position: Whether `receive` returns all positions, or the newest of those that wait.
    """

    clock = staticmethod(clock)
    every_position = True
    beats: tuple[type, ...] = (Heartbeat, Timesync)
    """Messages that arrive though nothing happens."""

    def __init__(self, link: VehicleLink, peer: Any) -> None:
        self.link = link
        self.peer = peer
        self.received: list = []
        self.before: dict[str, int] = {}

    def hear(self, condition: Callable[[list], bool], *, timeout_s: float = 3.0) -> bool:
        def heard() -> bool:
            self.received += self.link.receive()
            return condition(self.received)

        return until(heard, timeout_s=timeout_s)

    def fresh(self) -> "Rig":
        """Forget the last test; wait until only heartbeats arrive."""
        self.peer.answers = True
        self.peer.parameters = {}
        quiet_since_s = time.monotonic()
        while time.monotonic() - quiet_since_s < 0.03:
            if any(not isinstance(message, self.beats) for message in self.link.receive()):
                quiet_since_s = time.monotonic()
            time.sleep(0.002)
        self.received.clear()
        self.peer.heard.clear()
        self.before = dict(self.link.counters())
        return self

    def setpoints(self) -> list[tuple[Sequence[float], float]]:
        """Return the velocities and yaw angles that the peer was sent."""
        heard = self.peer.of("SET_POSITION_TARGET_LOCAL_NED")
        return [([one.vx, one.vy, one.vz], one.yaw) for one in heard]

    def commands(self, number: int) -> int:
        """Return how often the peer was sent a command."""
        return sum(one.command == number for one in self.peer.of("COMMAND_LONG"))

    def counted(self, name: str) -> int:
        """Return the increase of a counter in this test."""
        return self.link.counters()[name] - self.before.get(name, 0)

    def of(self, kind: type) -> list:
        return [message for message in self.received if isinstance(message, kind)]


class Px4Rig(Rig):
    """PX4 over its own Zenoh, flying in our mode: outside it nothing is sent."""

    clock = staticmethod(time.monotonic)
    every_position = False
    beats = (Heartbeat, Timesync, SystemStatus)

    def setpoints(self) -> list[tuple[Sequence[float], float]]:
        return [([*one.velocity], one.yaw) for one in self.peer.of("trajectory_setpoint")]

    def commands(self, number: int) -> int:
        topics = ("vehicle_command", "vehicle_command_mode_executor")
        return sum(one.command == number for topic in topics for one in self.peer.of(topic))


def free_port(kind: int = socket.SOCK_DGRAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def _drain(read: Callable[[], bytes]) -> list[bytes]:
    got = []
    with contextlib.suppress(BlockingIOError, OSError):
        while data := read():
            got.append(data)
    return got


def opened_link(
    kind: str, url: str, *, timeout_s: float = 10.0, clock: Callable[[], float], **more: Any
) -> VehicleLink:
    """Open a wire for system 1, or the one given, and a link over it."""
    ids = {"system_id": more.pop("system_id", 1)}
    wire = open_wire(url, clock=clock, systems=ids.values(), timeout_s=timeout_s)
    return open_link(wire, kind, clock=clock, who=url, timeout_s=timeout_s, **ids, **more)


def opened_as_by_a_file(
    kind: str, url: str, *, clock: Callable[[], float], timeout_s: float
) -> VehicleLink:
    """Open a link as a flight opens that of a vehicle file: by the registry of kinds."""
    keys = {"autopilot": "px4", "link": kind, "url": url, "connect_timeout_s": timeout_s}
    vehicle = Vehicle.model_validate(keys)
    wire = open_wire(url, clock=clock, systems=(1,)) if vehicle.kind.by_mavlink else None
    order = LinkOrder(section=vehicle, clock=clock, autopilot=vehicle.profile, wire=wire)
    return vehicle.kind.open(order)


@contextmanager
def opened(
    kind: str, url: str, send: Callable[[bytes], object], receive: Callable[[], list[bytes]]
) -> Iterator[Rig]:
    peer = Peer(send)
    with living(peer, receive, heartbeat_every_s=0.05):
        link = opened_as_by_a_file(kind, url, clock=clock, timeout_s=5.0 * SPEED)
        try:
            yield Rig(link, peer)
        finally:
            link.close()


@contextmanager
def udp(kind: str, _router: object) -> Iterator[Rig]:
    port = free_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as theirs:
        theirs.setblocking(False)
        to = ("127.0.0.1", port)
        with opened(
            kind,
            f"udpin://127.0.0.1:{port}",
            lambda d: theirs.sendto(d, to),
            lambda: _drain(lambda: theirs.recv(2048)),
        ) as rig:
            yield rig


@contextmanager
def tcp(kind: str, _router: object) -> Iterator[Rig]:
    with socket.create_server(("127.0.0.1", 0)) as server, contextlib.ExitStack() as stack:
        server.setblocking(False)
        caller: list[socket.socket] = []

        def receive() -> list[bytes]:
            if not caller:
                with contextlib.suppress(BlockingIOError):
                    caller.append(stack.enter_context(server.accept()[0]))
                    caller[0].setblocking(False)
                return []
            return _drain(lambda: caller[0].recv(4096))

        def send(data: bytes) -> None:
            if caller:
                with contextlib.suppress(OSError):
                    caller[0].sendall(data)

        with opened(kind, f"tcpout://127.0.0.1:{server.getsockname()[1]}", send, receive) as rig:
            yield rig


@contextmanager
def serial(kind: str, _router: object) -> Iterator[Rig]:
    ours, theirs = pty.openpty()
    os.set_blocking(ours, False)

    def send(data: bytes) -> None:
        rest = data
        while rest:
            try:
                rest = rest[os.write(ours, rest) :]
            except BlockingIOError:
                time.sleep(0.001)

    try:
        with opened(
            kind,
            f"serial://{os.ttyname(theirs)}:921600",
            send,
            lambda: _drain(lambda: os.read(ours, 4096)),
        ) as rig:
            yield rig
    finally:
        os.close(ours)
        os.close(theirs)


def router_config(port: int) -> "zenoh.Config":
    closed = {"multicast": {"enabled": False}, "gossip": {"enabled": False}, "delay": 0}
    listen = {"endpoints": [f"tcp/127.0.0.1:{port}"]}
    shared = {"shared_memory": {"enabled": False}}
    return zenoh.Config.from_json5(
        json.dumps({"mode": "router", "listen": listen, "scouting": closed, "transport": shared})
    )


class Router:
    """A Zenoh router on loopback."""

    def __init__(self, port: int, session: "zenoh.Session") -> None:
        self.port = port
        self.session = session


@contextmanager
def router() -> Iterator[Router]:
    port = free_port(socket.SOCK_STREAM)
    with zenoh.open(router_config(port)) as session:
        yield Router(port, session)


@contextmanager
def over_zenoh(kind: str, router: Router) -> Iterator[Rig]:
    namespace = f"uav{next(_namespaces)}"
    # BLOCK, as mavlink-server: a DROP publisher could lose some of the bursts in these tests
    out = router.session.declare_publisher(
        f"{namespace}/mavlink_raw/out",
        express=True,
        congestion_control=zenoh.CongestionControl.BLOCK,
    )
    into = router.session.declare_subscriber(
        f"{namespace}/mavlink_raw/in", zenoh.handlers.FifoChannel(4096)
    )

    def receive() -> list[bytes]:
        return [sample.payload.to_bytes() for sample in iter(into.try_recv, None)]

    with opened(kind, f"zenoh://127.0.0.1:{router.port}/{namespace}", out.put, receive) as rig:
        yield rig
    into.undeclare()
    out.undeclare()


@contextmanager
def memory(_kind: str, _router: object) -> Iterator[Rig]:
    ours, theirs = MemoryWire.pair(clock)
    peer = Peer(theirs.send)
    with living(peer, lambda: [data for _, data in theirs.receive()], heartbeat_every_s=0.05):
        link = PymavlinkLink(ours, clock, system_id=1)
        wait_until_heard(link, clock=clock, timeout_s=5.0 * SPEED, sleep=time.sleep, who="memory")
        try:
            yield Rig(link, peer)
        finally:
            link.close()


@contextmanager
def px4_topics(kind: str, router: Router) -> Iterator[Rig]:
    peer = Px4Peer(router.session, next(_domains))
    with contextlib.closing(peer), beating(peer):
        url = f"zenoh+tcp://127.0.0.1:{router.port}/{peer.domain_id}"
        link = opened_as_by_a_file(kind, url, clock=time.monotonic, timeout_s=5.0)
        assert isinstance(link, Px4Link)
        try:
            link.request(PX4.as_mode.set_mode(Mode.GUIDED))
            assert until(lambda: link.mode.entered)
            yield Px4Rig(link, peer)
        finally:
            link.close()


RIGS = {
    "pymavlink-memory": ("pymavlink", memory),
    "pymavlink-udp": ("pymavlink", udp),
    "pymavlink-tcp": ("pymavlink", tcp),
    "pymavlink-serial": ("pymavlink", serial),
    "pymavlink-zenoh": ("pymavlink", over_zenoh),
    "mavsdk-udp": ("mavsdk", udp),
    "mavsdk-tcp": ("mavsdk", tcp),
    "mavsdk-serial": ("mavsdk", serial),
    "mavsdk-zenoh": ("mavsdk", over_zenoh),
}
"""Over MAVLink."""

EVERY = {**RIGS, "px4-topics": ("zenoh", px4_topics)}
