"""MAVLink over Zenoh, one frame per sample.

Frames go over `mavlink_raw/in` (to the vehicle) and `mavlink_raw/out` (from it). Keys and encoding are those of
mavlink-server's raw driver. A prefix distinguishes vehicles; on the wire it is the same as a session's `namespace`.
Frames are sent at real-time priority, unbatched, and dropped rather than delayed.
"""

from collections.abc import Callable, Mapping
from typing import Final, TypeVar

import zenoh

from guidance.links.port import Clock, Endpoint
from guidance.links.wires.base import FROM_VEHICLE, TO_VEHICLE, Arrivals, QueuedWire
from guidance.links.zenoh.credentials import Credentials
from guidance.links.zenoh.session import Session, close_all, open_session

_MOST_PIECE_BYTES: Final = 65536

_Opened = TypeVar("_Opened")


def session_to(endpoint: Endpoint, credentials: Credentials, timeout_s: float) -> Session:
    """Open a client session to the router of a URL, by TLS if an authority is configured.

    Raises:
        LinkError: As `open_session`.
    """
    router = f"{'tcp' if credentials.tls is None else 'tls'}/{endpoint.host}:{endpoint.port}"
    return open_session(router, timeout_s=timeout_s, credentials=credentials)


class Subscription(Arrivals[_Opened]):
    """Items that other sessions publish on a key expression.

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
        read: Callable[["zenoh.Sample"], _Opened],
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
