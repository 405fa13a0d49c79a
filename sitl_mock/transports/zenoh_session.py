"""Raw MAVLink over one Zenoh session: `<vehicle>/mavlink_raw/in` towards the vehicle, `.../out` from it.

One packet per sample. By default the session is private: one endpoint, no multicast, no gossip, no shared memory. A
client opens its own session with `namespace: "<vehicle>"` and the same endpoint.

Credentials for a router (TLS, mutual TLS, user and password) come from a TOML file:

    tls_ca_file = "ca.pem"               # authority that signed the router's certificate
    tls_certificate_file = "uav1.pem"    # own certificate
    tls_key_file = "uav1.key"
    user = "uav1"
    password_file = "uav1.password"      # one line

File names are relative to the TOML file. Keys that are missing are not used.
"""

import contextlib
import json
import socket
import ssl
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import zenoh

from sitl_mock.errors import ConfigError, TransportError
from sitl_mock.tables import read_toml
from sitl_mock.transports.loop import Arrival

QUEUE_MAX: Final = 4096
CONNECT_S: Final = 3.0
"""How long a session that connects waits for its endpoint."""

_LINK: Final = "onboard"

# A vehicle's messages come in bursts of dozens; on a busy machine Zenoh's two batches of real-time traffic and its wait
# of 1 ms lost the HEARTBEAT among them. Sixteen batches is the most it allows.
_TRANSMISSION: Final = {
    "queue": {
        "size": {"real_time": 16},
        "congestion_control": {"drop": {"wait_before_drop": 10_000}},
    }
}


def configuration(
    mode: str, endpoint: str, *, connect: bool, keys: Mapping[str, Any] = MappingProxyType({})
) -> zenoh.Config:
    """A closed session: listens on one endpoint, or connects to it.

    Args:
        mode: Of Zenoh: "peer", "client" or "router".
        endpoint: Such as tcp/127.0.0.1:7447.
        connect: Whether it connects there instead of listening.
        keys: Who we are (`read_keys`).
    """
    if connect:
        listens = []
        connects = [endpoint]
    else:
        listens = [endpoint]
        connects = []
    return zenoh.Config.from_json5(
        json.dumps(
            {
                "mode": mode,
                "listen": {"endpoints": listens},
                "connect": {
                    "endpoints": connects,
                    "timeout_ms": round(CONNECT_S * 1e3),
                    "exit_on_failure": True,
                },
                # A router waits for this delay when it opens, also if it searches for nobody
                "scouting": {
                    "multicast": {"enabled": False},
                    "gossip": {"enabled": False},
                    "delay": 0,
                },
                "transport": {
                    "shared_memory": {"enabled": False},
                    **keys,
                    "link": {"tx": _TRANSMISSION, **keys.get("link", {})},
                },
            }
        )
    )


class Inbox:
    """A bounded queue from the threads of a session to the loop, with a socket to wake the loop.

    Attributes:
        dropped: Number of samples dropped while the queue was full; endpoints add the frames dropped by `send`.
    """

    def __init__(self) -> None:
        self.dropped = 0
        self._queue: deque[Arrival] = deque()
        self._wake_from, self._wake_to = socket.socketpair()
        self._wake_from.setblocking(False)
        self._wake_to.setblocking(False)

    def taker(
        self, vehicle: str, link: str, frame_of: Callable[[bytes], bytes] = bytes
    ) -> Callable[[Any], None]:
        """Return the callback of a subscriber; it runs in a thread of the session.

        Args:
            vehicle: Name of the vehicle.
            link: Name of its link.
            frame_of: Converts a payload to the vehicle's frame.
        """
        queue = self._queue

        def take(sample: Any) -> None:  # noqa: ANN401 - zenoh.Sample
            if len(queue) >= QUEUE_MAX:
                self.dropped += 1
                return
            queue.append(Arrival(vehicle, link, frame_of(bytes(sample.payload))))
            # Full: the loop is already awake; closed: it has ended.
            with contextlib.suppress(OSError):
                self._wake_to.send(b"\0")

        return take

    def filenos(self) -> Sequence[int]:
        """Return the file descriptor to wait on."""
        return [self._wake_from.fileno()]

    def receive(self) -> Sequence[Arrival]:
        """Return all samples, oldest first."""
        with contextlib.suppress(BlockingIOError):
            while self._wake_from.recv(4096):
                pass
        queue = self._queue
        return [queue.popleft() for _ in range(len(queue))]

    def close(self) -> None:
        """Close the socket; may be called twice."""
        self._wake_from.close()
        self._wake_to.close()


class ZenohEndpoint:
    """All vehicles on one session.

    Args:
        vehicles: Their names, which are the namespaces of their keys.
        endpoint: Where to listen or connect, for example tcp/127.0.0.1:7447.
        mode: router, peer or client.
        connect: Connect to the endpoint instead of listening on it.
        link: Name of the vehicles' link that is carried.
        keys: Who we are to a router, as `read_keys` has it.

    Raises:
        TransportError: The endpoint cannot be opened.
    """

    def __init__(
        self,
        vehicles: Sequence[str],
        endpoint: str,
        *,
        mode: str = "router",
        connect: bool = False,
        link: str = _LINK,
        keys: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        self._inbox = Inbox()
        self._link = link
        self._endpoint = endpoint
        self._vehicles = tuple(vehicles)
        self._mode = mode
        self._connect = connect
        self._keys = keys
        self._declarations: list[Callable[[zenoh.Session], None]] = []
        self._publishers: dict[str, Any] = {}
        self._subscribers: list[Any] = []
        try:
            self.come_up()
        except TransportError:
            self._inbox.close()
            raise

    @property
    def dropped(self) -> int:
        """Number of frames dropped in both directions."""
        return self._inbox.dropped

    @property
    def session(self) -> zenoh.Session:
        """The session that is open now; see `declare` for what shall live as long as the endpoint."""
        return self._session

    def declare(self, declaration: Callable[[zenoh.Session], None]) -> None:
        """Declare something on the session, now and on each one that follows it."""
        self._declarations.append(declaration)
        declaration(self._session)

    def come_up(self) -> None:
        """Open the session.

        Raises:
            TransportError: The endpoint cannot be opened.
        """
        try:
            self._session = zenoh.open(
                configuration(self._mode, self._endpoint, connect=self._connect, keys=self._keys)
            )
        except zenoh.ZError as error:
            if "Address already in use" in str(error):
                reason = "is in use: end the program that listens there, or choose another port"
            elif self._connect:
                reason = (
                    "cannot be reached: start a router there, or listen instead of connecting; a "
                    "router by tls/ wants --zenoh-keys"
                )
            else:
                short = str(error).split(" at ", maxsplit=1)[0]
                reason = f"cannot be opened: {short}; give one such as tcp/127.0.0.1:7447"
            raise TransportError(f"zenoh endpoint {self._endpoint} {reason}") from None
        raw = zenoh.Encoding.APPLICATION_OCTET_STREAM.with_schema("mavlink")
        self._publishers = {
            name: self._session.declare_publisher(
                f"{name}/mavlink_raw/out",
                encoding=raw,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.REAL_TIME,
                express=True,
            )
            for name in self._vehicles
        }
        self._subscribers = [
            self._session.declare_subscriber(
                f"{name}/mavlink_raw/in",
                self._inbox.taker(name, self._link),
                allowed_origin=zenoh.Locality.REMOTE,
            )
            for name in self._vehicles
        ]
        for declaration in self._declarations:
            declaration(self._session)

    def go_down(self) -> None:
        """Close the session and its declarations; frames sent meanwhile are dropped."""
        self._publishers = {}
        if not self._session.is_closed():
            for subscriber in self._subscribers:
                subscriber.undeclare()
            self._session.close()  # type: ignore[no-untyped-call]  # zenoh leaves it untyped
        self._subscribers = []

    def filenos(self) -> Sequence[int]:
        """Readable when a sample has come."""
        return self._inbox.filenos()

    def receive(self) -> Sequence[Arrival]:
        """Everything that has come."""
        return self._inbox.receive()

    def send(self, vehicle: str, link: str, frames: Sequence[bytes]) -> None:
        """One sample a frame."""
        if link != self._link:
            return
        publisher = self._publishers.get(vehicle)
        if publisher is None:
            self._inbox.dropped += len(frames)
            return
        put = publisher.put
        for frame in frames:
            put(frame)

    def describe(self) -> dict[str, str]:
        """Vehicle name to its keys."""
        return {name: f"{self._endpoint} {name}/mavlink_raw" for name in self._vehicles}

    def close(self) -> None:
        """Undeclare and close; without this the interpreter would hang at exit."""
        self.go_down()
        self._inbox.close()


def free_port() -> int:
    """A TCP port on loopback that is free now."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def with_port(endpoint: str) -> str:
    """The endpoint with a free port where it says port 0."""
    return f"{endpoint[:-1]}{free_port()}" if endpoint.endswith(":0") else endpoint


_FILES: Final = ("tls_ca_file", "tls_certificate_file", "tls_key_file", "password_file")
_KEYS: Final = (*_FILES, "user")
_NEEDS: Final = {
    "tls_certificate_file": ("tls_key_file", "tls_ca_file"),
    "tls_key_file": ("tls_certificate_file",),
    "user": ("password_file",),
    "password_file": ("user",),
}


def read_keys(path: Path) -> dict[str, Any]:
    """Return Zenoh's `transport` settings: `auth` and `link.tls`, for calling a router.

    Raises:
        ConfigError: The file, or one that it names, is missing or wrong; the message names both and the key.
    """
    document = read_toml(path, "--zenoh-keys")
    for key, value in document.items():
        if key not in _KEYS or not isinstance(value, str):
            raise ConfigError(
                f"{path}: {key} = {value!r}: allowed are {', '.join(_KEYS)}, each a text"
            )
        missing = [partner for partner in _NEEDS.get(key, ()) if partner not in document]
        if missing:
            raise ConfigError(f"{path}: {missing[0]} is missing: {key} = {value!r} needs it")
    for key in _FILES:
        if key in document:
            document[key] = str((path.parent / document[key]).absolute())
            value = document[key]
            try:
                Path(value).read_text(encoding="utf-8")
            except (OSError, UnicodeDecodeError) as error:
                raise ConfigError(f"{path}: {key} = {value!r}: cannot be read ({error})") from None
    settings: dict[str, Any] = {}
    if "user" in document:
        password = Path(document["password_file"]).read_text(encoding="utf-8").rstrip("\n")
        settings["auth"] = {"usrpwd": {"user": document["user"], "password": password}}
    if "tls_ca_file" in document:
        authority = document["tls_ca_file"]
        tls = {"root_ca_certificate": authority, "close_link_on_expiration": True}
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        try:
            context.load_verify_locations(authority)
            if "tls_certificate_file" in document:
                certificate = document["tls_certificate_file"]
                private_key = document["tls_key_file"]
                context.load_cert_chain(certificate, private_key, password=str)
                tls |= {
                    "enable_mtls": True,
                    "connect_certificate": certificate,
                    "connect_private_key": private_key,
                }
        except ssl.SSLError as error:
            raise ConfigError(
                f"{path}: its certificates or its key are wrong ({error.reason or error})"
            ) from None
        settings["link"] = {"tls": tls}
    return settings
