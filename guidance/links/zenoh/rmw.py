"""A ROS 2 node on a Zenoh session, by the conventions of rmw_zenoh: ROS 2 sees it as one of its own.

The versions 0.2.4 (Jazzy), 0.6.0 (Kilted) and later have these attachments.

* Key of a topic or service: `<domain>/<name>/<type in DDS>/<hash of the type>`.
* Liveliness tokens below `@ros2_lv` tell the ROS graph of the node, its publishers and its services.
* Attachment of 33 bytes: sequence number and time of the source, each 8 bytes little-endian, then the length 16 and the
  sender's identity, which is the XXH3-128 hash of its token.
* Quality of service in the token: reliable, volatile, and the last messages kept; defaults are left out.

A message that cannot be sent at once is dropped, as rmw_zenoh does for publishers that keep the last messages.

Source: https://github.com/ros2/rmw_zenoh/blob/rolling/docs/design.md.
"""

import contextlib
import struct
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import xxhash
import zenoh

from guidance.links.zenoh import ros_types
from guidance.links.zenoh.session import Session, close_all, is_small

_NODE: Final = "NN"
PUBLISHER: Final = "MP"
SERVICE: Final = "SS"

DEPTH: Final = 10
"""Messages that a publisher or service keeps, as in `rclcpp::QoS(10)`."""

_ADMIN_SPACE: Final = "@ros2_lv"
_ATTACHMENT: Final = struct.Struct("<qqB16s")
_GID_BYTES: Final = 16

Respond = Callable[["ServiceRequest"], None]
"""Answers a request; called on Zenoh's thread, where it must not wait: it may keep the request."""


class Attachment(NamedTuple):
    """Metadata of every message, request and response."""

    sequence: int
    source_ns: int
    gid: bytes

    def encode(self) -> bytes:
        """Return it as bytes."""
        return _ATTACHMENT.pack(self.sequence, self.source_ns, _GID_BYTES, self.gid)


def attachment_of(data: bytes) -> Attachment:
    """Read an attachment.

    Raises:
        ValueError: If the bytes are not one.
    """
    if len(data) != _ATTACHMENT.size:
        raise ValueError(f"an attachment of {len(data)} bytes")
    sequence, source_ns, length, gid = _ATTACHMENT.unpack(data)
    if length != _GID_BYTES:
        raise ValueError(f"an identity of {length} bytes")
    return Attachment(sequence, source_ns, gid)


def key_of(domain_id: int, name: str, type_name: str) -> str:
    """Return the key of a topic or service."""
    type_part = f"{ros_types.dds_name(type_name)}/{ros_types.hash_of(type_name)}"
    return f"{domain_id}/{name.strip('/')}/{type_part}"


def mangled(name: str) -> str:
    """Return a name as one part of a token."""
    return name.replace("/", "%")


def quality(depth: int) -> str:
    """Return the quality of service: reliable, volatile, the last `depth` messages kept, no deadlines."""
    return f"::,{depth}:,:,:,,"


def gid_of(token: str) -> bytes:
    """Return the identity of the entity with this token."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(_GID_BYTES, "little")


class RosNode:
    """A node and what belongs to it. The session stays open when it is closed.

    Args:
        session: On the router of the ROS graph.
        domain_id: ROS_DOMAIN_ID.
        namespace: Of the node, with a slash first.
        name: Of the node.

    Raises:
        ZError: Here and from `publisher` and `service`, if the session was closed.
    """

    def __init__(self, session: Session, domain_id: int, namespace: str, name: str) -> None:
        self._session = session
        self._domain_id = domain_id
        self._place = f"%/{mangled(namespace)}/{mangled(name)}"
        self._entities = 0
        self._ends: list[Callable[[], object]] = []
        self._declare(self.token(0, _NODE))

    def token(self, entity: int, kind: str, *parts: str) -> str:
        """Return the token of an entity; `parts` describe its topic or service."""
        zenoh_id = self._session.zid()
        head = f"{_ADMIN_SPACE}/{self._domain_id}/{zenoh_id}/0/{entity}/{kind}/{self._place}"
        return "/".join((head, *parts))

    def publisher(self, topic: str, type_name: str, depth: int = DEPTH) -> "RosPublisher":
        """Return a publisher of a topic."""
        token = self._endpoint(PUBLISHER, topic, type_name, depth)
        publisher = self._session.declare_publisher(
            key_of(self._domain_id, topic, type_name),
            encoding=zenoh.Encoding.APPLICATION_CDR,
            congestion_control=zenoh.CongestionControl.DROP,
        )
        self._ends.append(publisher.undeclare)
        self._declare(token)
        return RosPublisher(publisher, gid_of(token))

    def service(self, name: str, answer: Respond) -> None:
        """Serve std_srvs/Trigger under a name."""
        key = key_of(self._domain_id, name, ros_types.TRIGGER)

        def hear(query: "zenoh.Query") -> None:
            request = None
            if query.attachment is not None and is_small(query):
                with contextlib.suppress(ValueError):
                    request = ServiceRequest(query, key, attachment_of(query.attachment.to_bytes()))
            if request is None:
                query.drop()  # type: ignore[no-untyped-call]
            else:
                answer(request)

        queries = self._session.declare_queryable(key, hear, complete=True)
        self._ends.append(queries.undeclare)
        self._declare(self._endpoint(SERVICE, name, ros_types.TRIGGER, DEPTH))

    def close(self) -> None:
        """Leave the ROS graph; may be called twice."""
        close_all(*reversed(self._ends))
        self._ends.clear()

    def _endpoint(self, kind: str, name: str, type_name: str, depth: int) -> str:
        self._entities += 1
        dds_name = ros_types.dds_name(type_name)
        parts = (mangled(name), dds_name, ros_types.hash_of(type_name), quality(depth))
        return self.token(self._entities, kind, *parts)

    def _declare(self, token: str) -> None:
        liveliness: Any = self._session.liveliness()
        self._ends.append(liveliness.declare_token(token).undeclare)


class RosPublisher:
    """A publisher of one topic."""

    def __init__(self, publisher: "zenoh.Publisher", gid: bytes) -> None:
        self._publisher = publisher
        self._gid = gid
        self._sequence = 0

    @property
    def watched(self) -> bool:
        """True if there is a subscriber."""
        status: Any = self._publisher.matching_status  # an object; its stub says bool
        return bool(status.matching)

    def put(self, data: bytes, source_ns: int) -> None:
        """Publish a message in CDR.

        Raises:
            ZError: If the session was closed.
        """
        self._sequence += 1
        attachment = Attachment(self._sequence, source_ns, self._gid)
        self._publisher.put(data, attachment=attachment.encode())


class ServiceRequest:
    """A request of a service.

    Attributes:
        sender: The client's identity.
    """

    def __init__(self, query: "zenoh.Query", key: str, attachment: Attachment) -> None:
        self._query = query
        self._key = key
        self._attachment = attachment
        self.sender = attachment.gid.hex()

    def reply(self, source_ns: int, *, success: bool, message: str) -> None:
        """Respond to the client, once. It may be gone."""
        response = ros_types.types().types[ros_types.TRIGGER_RESPONSE](success, message)
        attachment = self._attachment._replace(source_ns=source_ns)
        data = ros_types.encode_cdr(response)
        close_all(
            lambda: self._query.reply(self._key, data, attachment=attachment.encode()),
            self._query.drop,
        )
