"""PX4's topics over Zenoh: a client of a router, with the keys and attachments that PX4 v1.17's module `zenoh` uses.

A key is ``DOMAIN/fmu/out/TOPIC/px4_msgs::msg::dds_::TYPE_/HASH``, as rmw_zenoh of ROS 2 has it. Each sample has an
attachment of 33 bytes: a counter, PX4's time (µs), and an id.

Like PX4, the endpoint tries every five seconds until there is a router.
"""

from __future__ import annotations

import struct
import sys
import threading
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import zenoh

from sitl_mock.px4.messages import message_type
from sitl_mock.px4.topic_link import PUBLISHED, SUBSCRIBED, frame_of, sample_of
from sitl_mock.transports.zenoh_session import Inbox, configuration

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sitl_mock.transports.loop import Arrival

_RETRY_S: Final = 5.0
LINK: Final = "px4_zenoh"
_ATTACHMENT: Final = struct.Struct("<qqB16s").pack
_GUID: Final = bytes.fromhex("aabbcc").ljust(16, b"\0")
"""The id of every simulated PX4."""
_STAMP: Final = struct.Struct("<Q").unpack_from


def key_of(domain: int, direction: str, topic: str, message: str) -> str:
    """Return the key of a topic.

    Args:
        domain: ZENOH_DOMAIN_ID.
        direction: in or out, as PX4 sees it.
        topic: Its name.
        message: The name of its message.
    """
    kind = f"px4_msgs::msg::dds_::{message}_"
    return f"{domain}/fmu/{direction}/{topic}/{kind}/{message_type(message).hash}"


class Px4ZenohEndpoint:
    """The topics of all PX4 vehicles on one session.

    Args:
        domains: ZENOH_DOMAIN_ID of each vehicle by name.
        endpoint: The router, for example tcp/127.0.0.1:7447.
        keys: Who we are to the router (`zenoh_session.read_keys`).
    """

    def __init__(
        self, domains: Mapping[str, int], endpoint: str, keys: Mapping[str, Any] | None = None
    ) -> None:
        self._inbox = Inbox()
        self._domains = dict(domains)
        self._endpoint = endpoint
        self._keys = {} if keys is None else keys
        self._publishers: dict[tuple[str, str], _Publisher] = {}
        self._session: zenoh.Session | None = None
        self._subscribers: list[Any] = []
        self._closing = threading.Event()
        self._opening = threading.Thread(target=self._open, name="px4-zenoh", daemon=True)
        self._opening.start()

    @property
    def dropped(self) -> int:
        """Number of samples dropped in both directions."""
        return self._inbox.dropped

    def filenos(self) -> Sequence[int]:
        """Readable when a sample has come."""
        return self._inbox.filenos()

    def receive(self) -> Sequence[Arrival]:
        """Everything that has come."""
        return self._inbox.receive()

    def send(self, vehicle: str, link: str, frames: Sequence[bytes]) -> None:
        """Publish one sample a frame; what is no sample of a topic is dropped and counted."""
        if link != LINK:
            return
        for frame in frames:
            topic, payload = sample_of(frame)
            publisher = self._publishers.get((vehicle, topic))
            if publisher is None:
                self._inbox.dropped += 1
            else:
                publisher.put(payload)

    def describe(self) -> dict[str, str]:
        """Vehicle name to its keys."""
        return {
            name: f"{self._endpoint} {domain}/fmu/out" for name, domain in self._domains.items()
        }

    def close(self) -> None:
        """Undeclare and close; without this the interpreter would hang at exit."""
        self._closing.set()
        self._opening.join()
        self._publishers = {}
        if self._session is not None and not self._session.is_closed():
            for subscriber in self._subscribers:
                subscriber.undeclare()
            self._session.close()  # type: ignore[no-untyped-call]  # zenoh leaves it untyped
        self._subscribers = []
        self._inbox.close()

    def _open(self) -> None:
        """Connect to the router, in a thread of its own, and declare everything."""
        is_reported = False
        while not self._closing.is_set():
            try:
                session = zenoh.open(
                    configuration("client", self._endpoint, connect=True, keys=self._keys)
                )
            except zenoh.ZError:
                if not is_reported:
                    is_reported = True
                    sys.stderr.write(
                        f"no Zenoh router at {self._endpoint}; PX4's topics wait and try again "
                        f"every {_RETRY_S:g} s\n"
                    )
                self._closing.wait(_RETRY_S)
                continue
            for vehicle, domain in self._domains.items():
                for topic, message in SUBSCRIBED.items():
                    key = key_of(domain, "in", topic, message)
                    # Without a Python thread for each, which would abort the process if it woke while that ends
                    take = self._inbox.taker(vehicle, LINK, partial(frame_of, topic))
                    hear = zenoh.handlers.Callback(take, indirect=False)
                    self._subscribers.append(session.declare_subscriber(key, hear))
                for topic, message in PUBLISHED.items():
                    key = key_of(domain, "out", topic, message)
                    publisher = session.declare_publisher(
                        key, congestion_control=zenoh.CongestionControl.DROP
                    )
                    self._publishers[vehicle, topic] = _Publisher(publisher)
            self._session = session
            return


class _Publisher:
    """A topic's publisher, which numbers its samples."""

    def __init__(self, publisher: Any) -> None:  # noqa: ANN401 - zenoh.Publisher
        self._publisher = publisher
        self._count = 0

    def put(self, payload: bytes) -> None:
        self._count += 1
        (stamp_us,) = _STAMP(payload, 4)  # every message begins with its time
        attachment = _ATTACHMENT(self._count, stamp_us, len(_GUID), _GUID)
        self._publisher.put(payload, attachment=attachment)
