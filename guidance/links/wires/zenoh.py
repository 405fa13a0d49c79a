"""MAVLink over Zenoh: one frame per sample on `mavlink_raw/in` (to the vehicle) and `mavlink_raw/out` (from it).

Keys and encoding are those of mavlink-server's raw driver; vehicles are told apart by a prefix, which on the wire is
the same as a session's `namespace`. Frames are dropped rather than waited for, at real-time priority, unbatched.
"""

import contextlib
import json
import threading
from collections.abc import Mapping, Sequence
from typing import Final

import zenoh

from guidance.errors import LinkError
from guidance.links.arrivals import Arrivals, Clock
from guidance.links.wires.zenoh_access import NO_CREDENTIALS, Credentials

TO_VEHICLE: Final = "mavlink_raw/in"
FROM_VEHICLE: Final = "mavlink_raw/out"

_REFUSED: Final = (
    "is the router running, is its certificate for this host and of zenoh.tls_ca_file, and does it know our "
    "certificate's authority and our user? RUST_LOG=warn on the router says whom it refused"
)


def is_over(stop: threading.Event, wait_s: float = 0.0) -> bool:
    """Whether a thread that calls Zenoh shall end: it was told to, or the interpreter is ending.

    No such thread is a daemon thread: one that comes back from Zenoh while the interpreter ends is cancelled there,
    through frames that do not let it, and the process aborts ("FATAL: exception not rethrown").

    Args:
        stop: Tells it to end.
        wait_s: How long that is waited for.
    """
    return stop.wait(wait_s) or not threading.main_thread().is_alive()


def encoding() -> "zenoh.Encoding":
    """`application/octet-stream;mavlink`."""
    return zenoh.Encoding.APPLICATION_OCTET_STREAM.with_schema("mavlink")


class ZenohWire:
    """The vehicle's end of a namespace, seen from us. Opens its own session unless it is given one."""

    stream = True

    def __init__(
        self,
        clock: Clock,
        *,
        namespace: str = "",
        endpoint: str | None = None,
        session: "zenoh.Session | None" = None,
        credentials: Credentials = NO_CREDENTIALS,
        timeout_s: float = 3.0,
    ) -> None:
        """Subscribe and get ready to publish.

        Raises:
            LinkError: If there is no session to be had within `timeout_s`.
            ValueError: If neither or both of `endpoint` and `session` are given.
        """
        if (endpoint is None) == (session is None):
            raise ValueError(f"endpoint = {endpoint!r}, session = {session!r}: give exactly one")
        self._arrivals = Arrivals[bytes](clock)
        self._lock = threading.Lock()
        self._closed = False
        self._sent = self._unsent = 0
        self._own = None if endpoint is None else open_session(endpoint, timeout_s=timeout_s, credentials=credentials)
        used = session if session is not None else self._own
        assert used is not None
        prefix = f"{namespace}/" if namespace else ""
        self._subscriber = used.declare_subscriber(
            prefix + FROM_VEHICLE,
            lambda sample: self._arrivals.put(sample.payload.to_bytes()),
            allowed_origin=zenoh.Locality.REMOTE,
        )
        self._publisher = used.declare_publisher(
            prefix + TO_VEHICLE,
            encoding=encoding(),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )

    def receive(self) -> Sequence[tuple[float, bytes]]:
        """Samples since the last call."""
        return self._arrivals.take()

    def wait(self, timeout_s: float) -> None:
        """Until something has arrived, at most this long."""
        self._arrivals.wait(timeout_s)

    def send(self, frame: bytes) -> None:
        """Publish one frame; a failure (session gone) is counted. May be called from any thread."""
        with self._lock:
            if self._closed:
                return
            try:
                self._publisher.put(frame)
                self._sent += 1
            except zenoh.ZError:
                self._unsent += 1

    def counters(self) -> Mapping[str, int]:
        """Frames sent and not sent, and samples dropped for want of room."""
        return {"wire_sent": self._sent, "wire_unsent": self._unsent, "wire_dropped": self._arrivals.dropped}

    def close(self) -> None:
        """Undeclare, and close the session if it is ours. A session left open keeps the interpreter from ending."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
        with contextlib.suppress(zenoh.ZError):
            self._subscriber.undeclare()  # type: ignore[no-untyped-call]
            self._publisher.undeclare()  # type: ignore[no-untyped-call]
        if self._own is not None:
            with contextlib.suppress(zenoh.ZError):
                self._own.close()  # type: ignore[no-untyped-call]


def closed_config(endpoint: str, *, timeout_s: float = 3.0, credentials: Credentials = NO_CREDENTIALS) -> zenoh.Config:
    """A client that connects to one endpoint (`tcp/127.0.0.1:7447`), and neither listens nor looks around.

    Without `credentials` only an endpoint that asks nobody lets us in.
    """
    return zenoh.Config.from_json5(
        json.dumps(
            {
                "mode": "client",
                "listen": {"endpoints": []},
                "connect": {"endpoints": [endpoint], "timeout_ms": round(timeout_s * 1e3), "exit_on_failure": True},
                "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
                # More room for bursts at real-time priority, and no longer wait: the loop never waits for a peer.
                "transport": {
                    "shared_memory": {"enabled": False},
                    **({} if credentials.auth is None else {"auth": credentials.auth}),
                    "link": {
                        "tx": {"queue": {"size": {"real_time": 16}}},
                        **({} if credentials.tls is None else {"tls": credentials.tls}),
                    },
                },
            }
        )
    )


def open_session(
    endpoint: str, *, timeout_s: float = 3.0, credentials: Credentials = NO_CREDENTIALS
) -> "zenoh.Session":
    """Open a session, or say within `timeout_s` that nobody is there.

    Raises:
        LinkError: If nobody listens at the endpoint, or it refuses us.
    """
    try:
        return zenoh.open(closed_config(endpoint, timeout_s=timeout_s, credentials=credentials))
    except zenoh.ZError as error:
        reason = str(error).split(" at /")[0].strip()
        raise LinkError(
            f"zenoh {endpoint}: no session within {timeout_s:g} s ({reason}); "
            + ("is the vehicle (or the mock) running?" if credentials == NO_CREDENTIALS else _REFUSED)
        ) from error
