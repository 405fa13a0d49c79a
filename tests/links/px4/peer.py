"""PX4 on a Zenoh router, as far as these tests need it. Its bytes are laid out by `rosbags`, an independent witness."""

import re
import threading
import time
from collections.abc import Callable
from contextlib import contextmanager
from typing import Any

import numpy as np
import zenoh
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from guidance.links.px4.messages import FROM_PX4, TO_PX4, TYPES

HOLD = 4
PURSUIT = 23


def _typestore():
    store = get_typestore(Stores.EMPTY)
    for name, kind in TYPES.items():
        text = re.sub(r"\bEvent\[", "px4_msgs/msg/Event[", kind.fields.replace(", ", "\n"))
        store.register(get_types_from_msg(text, f"px4_msgs/msg/{name}"))
    return store


STORE = _typestore()
"""The types as `rosbags` knows them."""


def message(name: str, /, **values):
    """Return a message of PX4; fields that are not given are 0."""
    given: dict[str, Any] = {}
    for field in TYPES[name].fields.split(", "):
        kind, key = field.split(" ")
        base, _, count = kind.rstrip("]").partition("[")
        if base in TYPES:
            given[key] = [message(base) for _ in range(int(count))]
        elif count:
            given[key] = np.zeros(int(count), dtype=base.replace("uint8", "u1"))
        else:
            given[key] = 0.0 if base.startswith("float") else 0
    for key, value in values.items():
        before = given[key]
        is_array = isinstance(before, np.ndarray)
        given[key] = np.array(value, dtype=before.dtype) if is_array else value
    return STORE.types[f"px4_msgs/msg/{name}"](**given)


def encoded(name: str, /, **values) -> bytes:
    """Return the bytes of a message as PX4 sends it, with its padding."""
    kind = f"px4_msgs/msg/{name}"
    data = bytes(STORE.serialize_cdr(message(name, **values), kind, little_endian=True))
    return data.ljust(TYPES[name].most_bytes, b"\0")


def text(name: str) -> list[int]:
    return list(name.encode().ljust(25, b"\0"))


class Px4Peer:
    """An autopilot on a session. `heard` keeps what it was sent, as (topic, message)."""

    def __init__(self, session: zenoh.Session, domain_id: int = 0) -> None:
        self.heard: list[tuple[str, object]] = []
        self.domain_id = domain_id
        self.answers = True
        self.free_modes = 8
        self.mode_id = PURSUIT
        self.nav_state = HOLD
        self.armed = False
        self.system_id = 1
        self.executor_in_charge = 0
        self.refuses_modes = False
        self._checks = 0
        self._began_s = time.monotonic()
        self._out = {
            topic: session.declare_publisher(
                TYPES[name].key(domain_id, f"fmu/out/{topic}"),
                congestion_control=zenoh.CongestionControl.BLOCK,
                express=True,
            )
            for topic, name in FROM_PX4.items()
        }
        self._ins = [
            session.declare_subscriber(
                TYPES[name].key(domain_id, f"fmu/in/{topic}"), self._hearer(topic, name)
            )
            for topic, name in TO_PX4.items()
        ]

    def _hearer(self, topic: str, name: str) -> Callable[[zenoh.Sample], None]:
        def hear(sample: zenoh.Sample) -> None:
            data = sample.payload.to_bytes()
            most = TYPES[name].most_bytes - 24
            if len(data) > most:  # PX4 drops it without a word
                self.heard.append(("too long", data))
                return
            got = STORE.deserialize_cdr(data, f"px4_msgs/msg/{name}")
            self.heard.append((topic, got))
            if self.answers:
                self._answer(topic, got)

        return hear

    def _answer(self, topic: str, got) -> None:
        if topic == "register_ext_component_request":
            success = bool(got.register_mode) and self.free_modes > 0 and not self.armed
            ids = {"arming_check_id": -1, "mode_id": -1, "mode_executor_id": -1}
            if success:
                ids = {"arming_check_id": 0, "mode_id": self.mode_id, "mode_executor_id": 1}
            self.say(
                "register_ext_component_reply",
                request_id=got.request_id,
                name=got.name,
                px4_ros2_api_version=1,
                success=success,
                **ids,
            )
        elif topic in {"vehicle_command", "vehicle_command_mode_executor"}:
            if got.command == 100001:
                self.nav_state = round(got.param1)
                self.executor_in_charge = int(self.nav_state == self.mode_id)
                self.status()
            self.say("vehicle_command_ack", command=got.command, result=0)

    @property
    def now_us(self) -> int:
        return 10_000_000 + round((time.monotonic() - self._began_s) * 1e6)

    def say(self, topic: str, /, **values) -> None:
        """Publish a message, stamped now."""
        self.send(topic, encoded(FROM_PX4[topic], **{"timestamp": self.now_us, **values}))

    def send(self, topic: str, data: bytes) -> None:
        """Publish any bytes, unless it is closed."""
        publisher = self._out.get(topic)
        if publisher is not None:
            publisher.put(data)

    def status(self, **values) -> None:
        self.say(
            "vehicle_status",
            **{
                "nav_state": self.nav_state,
                "nav_state_user_intention": self.nav_state,
                "arming_state": 2 if self.armed else 1,
                "executor_in_charge": self.executor_in_charge,
                "system_type": 2,
                "system_id": self.system_id,
                "component_id": 1,
                "pre_flight_checks_pass": True,
                **values,
            },
        )

    def local_position(self, n: int, **values) -> None:
        """Publish a position whose stamp is n milliseconds."""
        self.say(
            "vehicle_local_position",
            **{
                "timestamp": n * 1000,
                "xy_valid": True,
                "z_valid": True,
                "v_xy_valid": True,
                "v_z_valid": True,
                "x": n + 0.5,
                "y": 2.0,
                "z": -3.0,
                "vx": 0.25,
                "vy": 0.5,
                "vz": -0.75,
                "xy_global": True,
                "z_global": True,
                "ref_lat": 47.0,
                "ref_lon": 8.0,
                "ref_alt": 500.0,
                **values,
            },
        )

    def global_position(self, **values) -> None:
        self.say(
            "vehicle_global_position",
            **{"lat": 47.0, "lon": 8.0, "alt": 500.0, "lat_lon_valid": True, "alt_valid": True}
            | values,
        )

    def ask(self, mask: int = 1) -> int:
        """Ask for an arming check; return its number."""
        self._checks = (self._checks + 1) % 256
        self.say("arming_check_request", request_id=self._checks, valid_registrations_mask=mask)
        return self._checks

    def of(self, topic: str) -> list:
        """Return what was sent on a topic."""
        return [got for name, got in self.heard if name == topic]

    def close(self) -> None:
        for subscriber in self._ins:
            subscriber.undeclare()
        # A thread of Zenoh may be publishing; Zenoh undeclares a publisher once nobody holds it.
        self._out = {}


@contextmanager
def beating(peer: Px4Peer, every_s: float = 0.05):
    """Let a peer say its status again and again."""
    stop = threading.Event()

    def beat() -> None:
        while not stop.wait(every_s):
            peer.status()

    thread = threading.Thread(target=beat)
    thread.start()
    try:
        yield peer
    finally:
        stop.set()
        thread.join()
