"""ROS 2 clients that are not ours: zenoh-ros2-sdk, on a router of the tests. Definitions of messages go in as text."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from zenoh_ros2_sdk import ROS2Publisher, ROS2ServiceClient, ROS2Subscriber
from zenoh_ros2_sdk.session import ZenohSession
from zenoh_ros2_sdk.utils import compute_service_type_hash, get_type_hash

TRIGGER = "std_srvs/srv/Trigger"
EMPTY = "uint8 structure_needs_at_least_one_member\n"
TRIGGERED = "bool success\nstring message\n"

_RULE = "=" * 80 + "\nMSG: "


def definitions(type_name: str) -> dict[str, str]:
    """Return the texts of a type and of all that it needs, the type first."""
    text, _ = get_typestore(Stores.ROS2_JAZZY).generate_msgdef(type_name, ros_version=2)
    first, *others = text.split(_RULE)
    texts = {type_name: first}
    for other in others:
        name, body = other.split("\n", 1)
        texts[name if name.count("/") == 2 else name.replace("/", "/msg/")] = body
    return texts


def hash_of(type_name: str) -> str:
    """Return the hash of a message's type, as the SDK computes it."""
    own, *others = definitions(type_name).items()
    return get_type_hash(type_name, msg_definition=own[1], dependencies=dict(others))


def service_hash(type_name: str, request: str, response: str) -> str:
    """Return the hash of a service's type, as the SDK computes it."""
    return compute_service_type_hash(
        type_name, request_definition=request, response_definition=response, dependencies={}
    )


class RosClient:
    """A session of the SDK. It has one at a time in a process.

    Attributes:
        at: Where its functions find the router.
    """

    def __init__(self, port: int, domain_id: int) -> None:
        self.at = {"router_ip": "127.0.0.1", "router_port": port, "domain_id": domain_id}
        self._session = ZenohSession.get_instance("127.0.0.1", port)
        self._open = []

    def _known(self, type_name: str) -> dict[str, str]:
        for name, text in definitions(type_name).items():
            if name not in self._session.store.types:
                self._session.store.register(get_types_from_msg(text, name))
        self._session._registered_types[type_name] = type_name
        return {"type_hash": hash_of(type_name), **self.at}

    def subscribe(self, topic: str, type_name: str, heard) -> None:
        """Call `heard` with each message of a topic."""
        known = self._known(type_name)
        self._open.append(ROS2Subscriber(topic, type_name, heard, **known))

    def publisher(self, topic: str, type_name: str) -> ROS2Publisher:
        """Return a publisher."""
        known = self._known(type_name)
        self._open.append(ROS2Publisher(topic, type_name, **known))
        return self._open[-1]

    def type_of(self, type_name: str) -> type:
        """Return the class of a message."""
        return self._session.store.types[type_name]

    def call(self, service: str, timeout_s: float = 5.0):
        """Call a std_srvs/Trigger; None if nobody answers."""
        client = ROS2ServiceClient(
            service,
            TRIGGER,
            request_definition=EMPTY,
            response_definition=TRIGGERED,
            type_hash=service_hash(TRIGGER, EMPTY, TRIGGERED),
            timeout=timeout_s,
            **self.at,
        )
        try:
            return client.call(structure_needs_at_least_one_member=0)
        finally:
            client.close()

    def close(self) -> None:
        """Leave the graph."""
        for one in self._open:
            one.close()
        self._session.close()


@contextmanager
def ros_client(port: int, domain_id: int = 0) -> Iterator[RosClient]:
    """Join the ROS graph of a router as a client, not as a peer that listens."""
    before = os.environ.get("ZENOH_CONFIG_OVERRIDE")
    os.environ["ZENOH_CONFIG_OVERRIDE"] = 'mode="client";listen/endpoints=[]'
    client = RosClient(port, domain_id)
    try:
        yield client
    finally:
        client.close()
        del os.environ["ZENOH_CONFIG_OVERRIDE"]
        if before is not None:
            os.environ["ZENOH_CONFIG_OVERRIDE"] = before
