"""Zenoh: sessions, MAVLink over Zenoh, and a router for computers without zenohd.

MAVLink goes one frame per sample over `mavlink_raw/in` (to the vehicle) and `mavlink_raw/out` (from it). Keys and
encoding are those of mavlink-server's raw driver. A prefix distinguishes vehicles; on the wire it is the same as a
session's `namespace`. Frames are sent at real-time priority, unbatched, and dropped rather than delayed.
"""

import contextlib
import json
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, TypeVar

import zenoh

from guidance.errors import ConfigError, LinkError
from guidance.links.port import Clock, Endpoint
from guidance.links.wires import FROM_VEHICLE, TO_VEHICLE, Arrivals, QueuedWire
from guidance.links.zenoh_access import AUTHORITY, NO_CREDENTIALS, ROUTER, Credentials

_REFUSED: Final = (
    "is the router running, is its certificate for this host and signed by zenoh.tls_ca_file, and does it accept our "
    "certificate or user? With RUST_LOG=warn the router logs whom it refuses"
)

MOST_QUERY_BYTES: Final = 65536
"""A larger query is dropped unread."""

MOST_MESSAGE_BYTES: Final = 1_048_576
"""A router of ours ends the link of a party that sends a larger message, before it holds the whole in memory."""

_MOST_PIECE_BYTES: Final = 65536

T = TypeVar("T")

Session = zenoh.Session


def is_over(stop: threading.Event, wait_s: float = 0.0) -> bool:
    """Return whether a thread that calls Zenoh should end: `stop` is set, or the interpreter is ending.

    Such threads must not be daemon threads: one that returns from Zenoh while the interpreter ends aborts the process
    ("FATAL: exception not rethrown").

    Args:
        stop: Set to end the thread.
        wait_s: How long to wait for it.
    """
    return stop.wait(wait_s) or not threading.main_thread().is_alive()


def direct_session(
    mode: str,
    endpoints: Mapping[str, Mapping[str, Any]],
    **transport: Any,  # noqa: ANN401 - JSON
) -> Session:
    """Open a session that neither searches the network nor shares memory.

    Args:
        mode: "client" or "router".
        endpoints: Zenoh's keys of "listen" or "connect"; without endpoints there, it does not.
        transport: More keys of Zenoh's "transport".

    Raises:
        ZError: If there is no session.
    """
    if mode == "router":
        sizes = {"max_message_size": MOST_MESSAGE_BYTES}
        transport["link"] = {"rx": sizes, **transport.get("link", {})}
    document = {
        "mode": mode,
        **{key: endpoints.get(key, {"endpoints": []}) for key in ("listen", "connect")},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {"shared_memory": {"enabled": False}, **transport},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(document)))


def open_session(
    endpoint: str, *, timeout_s: float = 3.0, credentials: Credentials = NO_CREDENTIALS
) -> Session:
    """Open a client session to one endpoint (`tcp/127.0.0.1:7447`). It neither listens nor searches the network.

    Raises:
        LinkError: If the endpoint does not answer within `timeout_s`, or refuses us.
    """
    sending = {"queue": {"size": {"real_time": 16}}}  # room for bursts; sending never waits
    there = {"endpoints": [endpoint], "timeout_ms": round(timeout_s * 1e3), "exit_on_failure": True}
    link = {"tx": sending, "tls": credentials.tls or {}}
    try:
        return direct_session("client", {"connect": there}, link=link, auth=credentials.auth or {})
    except zenoh.ZError as error:
        ask = "is the vehicle (or the mock) running?" if credentials == NO_CREDENTIALS else _REFUSED
        raise LinkError(
            f"zenoh {endpoint}: no session within {timeout_s:g} s ({_short(error)}); {ask}"
        ) from error


def session_to(endpoint: Endpoint, credentials: Credentials, timeout_s: float) -> Session:
    """Open a client session to the router of a URL, by TLS if an authority is configured.

    Raises:
        LinkError: As `open_session`.
    """
    router = f"{'tcp' if credentials.tls is None else 'tls'}/{endpoint.host}:{endpoint.port}"
    return open_session(router, timeout_s=timeout_s, credentials=credentials)


def close_all(*closes: Callable[[], object]) -> None:
    """End subscriptions, tokens and sessions. A session left open would keep the interpreter from ending."""
    for close in closes:
        with contextlib.suppress(zenoh.ZError):
            close()


def is_small(query: "zenoh.Query") -> bool:
    """Return whether a query may be read; judged before its bytes are copied."""
    parts = (query.payload, query.attachment)
    sizes = [0 if part is None else len(part) for part in parts]
    return sum(sizes) + len(str(query.parameters)) <= MOST_QUERY_BYTES


class Subscription(Arrivals[T]):
    """What other sessions publish on a key expression.

    Args:
        session: Where to subscribe.
        key: The key expression.
        read: Makes an item of a sample, on Zenoh's thread.
        ends: Ends more, after the subscription.
        most_bytes: Larger samples are dropped unread, and counted in `oversized`.

    Raises:
        ZError: If the key is not a key expression.
    """

    def __init__(
        self,
        session: Session,
        key: str,
        read: Callable[["zenoh.Sample"], T],
        *ends: Callable[[], object],
        most_bytes: float,
    ) -> None:
        super().__init__()
        self.oversized = 0
        self._read = read
        self._most_bytes = most_bytes
        subscriber = session.declare_subscriber(
            key, self._hear, allowed_origin=zenoh.Locality.REMOTE
        )
        self._ends = subscriber.undeclare, *ends

    def _hear(self, sample: "zenoh.Sample") -> None:
        attached = 0 if sample.attachment is None else len(sample.attachment)
        if len(sample.payload) + attached > self._most_bytes:
            self.oversized += 1
        else:
            self.put(self._read(sample))

    def close(self) -> None:
        """End the subscription; may be called twice."""
        if not self.closed:
            super().close()
            close_all(*self._ends)


class ZenohWire(QueuedWire):
    """Our side of a vehicle's namespace."""

    stream = True

    def __init__(self, clock: Clock, session: Session, namespace: str) -> None:
        """Subscribe and prepare to publish; the session is closed with the wire."""
        super().__init__(clock)
        prefix = f"{namespace}/" if namespace else ""
        self._publisher = session.declare_publisher(
            prefix + TO_VEHICLE,
            encoding=zenoh.Encoding.APPLICATION_OCTET_STREAM.with_schema("mavlink"),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )
        key = prefix + FROM_VEHICLE
        self._session = session
        self._pieces = Subscription(
            session,
            key,
            lambda sample: (clock(), sample.payload.to_bytes()),
            most_bytes=_MOST_PIECE_BYTES,
        )
        self._arrivals = self._pieces

    def counters(self) -> Mapping[str, int]:
        """Return the counts of all wires, and how many pieces were too large for frames."""
        return {**super().counters(), "wire_oversized": self._pieces.oversized}

    def _write(self, frame: bytes) -> bool:
        try:
            self._publisher.put(frame)
        except zenoh.ZError:
            return False
        return True

    def _release(self) -> None:
        close_all(self._session.close)


def open_router(path: Path, keys: Path | None = None, listen: str | None = None) -> Session:
    """Open a router, which routes until it is closed. It is the same code as zenohd, without plugins (REST, storage).

    Args:
        path: zenohd's configuration, JSON5.
        keys: A folder made by `guidance zenoh keys`; replaces the certificates that the file names.
        listen: Replaces the file's endpoint: tls/0.0.0.0:7447.

    Raises:
        ConfigError: If the file or a certificate is wrong or cannot be read.
        LinkError: If it cannot listen at the endpoint.
    """
    if not path.is_file():
        raise ConfigError(
            f"{path}: no such file; config/zenoh/router.json5 is included in the installation"
        )
    try:
        config = zenoh.Config.from_file(str(path))
        if listen is not None:
            config.insert_json5("listen/endpoints", json.dumps([listen]))
        if keys is not None:
            _use_keys(config, keys.absolute())
    except zenoh.ZError as error:
        raise ConfigError(f"{path}: not a Zenoh configuration ({_short(error)})") from error
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        ask = "is its port in use, and do its certificates exist? Name their folder with --keys"
        raise LinkError(f"{path}: the router cannot listen ({_short(error)}); {ask}") from error


def _use_keys(config: "zenoh.Config", keys: Path) -> None:
    for key, name in (
        ("root_ca_certificate", f"{AUTHORITY}.pem"),
        ("listen_certificate", f"{ROUTER}.pem"),
        ("listen_private_key", f"{ROUTER}.key"),
    ):
        if not (keys / name).is_file():
            raise ConfigError(
                f"--keys {keys}: {name} is missing; create it with guidance zenoh keys"
            )
        config.insert_json5(f"transport/link/tls/{key}", json.dumps(str(keys / name)))


def _short(error: Exception) -> str:
    return str(error).split(" at /")[0].strip()
