"""A program beside PX4: it hears and sends PX4's topics over Zenoh, and answers arming checks from a thread."""

import contextlib
import json
import math
import queue
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, Self

import zenoh

from sitl_mock.px4.messages import message_type
from sitl_mock.px4.topic_link import PUBLISHED, SUBSCRIBED
from sitl_mock.transports.px4_zenoh import key_of

NAN = math.nan
FREE = (NAN, NAN, NAN)
SET_NAV_STATE = 100001
ANSWER_S = 2.0


class Heard(NamedTuple):
    """A sample: when it came, its message, the payload's size, and its attachment."""

    at_s: float
    message: Any
    size: int
    attachment: bytes


class Topics:
    """PX4's topics at a router; use it as a context manager.

    Args:
        endpoint: Where the router listens.
        mode: client, or router to be one.
    """

    def __init__(self, endpoint: str, mode: str = "client") -> None:
        place = {"listen" if mode == "router" else "connect": {"endpoints": [endpoint]}}
        closed = {"multicast": {"enabled": False}, "gossip": {"enabled": False}}
        config = {"mode": mode, "scouting": closed, **place}
        self._session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
        self._lock = threading.Lock()
        self._heard: dict[str, list[Heard]] = defaultdict(list)
        self.checks: dict[int, dict[str, Any]] = {}
        """What each arming check answers, by its number; a check that is not here is silent."""
        self._requests: queue.Queue[Any] = queue.Queue()
        self._publishers = {
            topic: self._session.declare_publisher(
                key_of(0, "in", topic, message),
                # Once a router's queue to PX4 was full, it drops for ever what may be dropped
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
            for topic, message in SUBSCRIBED.items()
        }
        self._answering = threading.Thread(target=self._answer, daemon=True)
        self._answering.start()
        # One subscriber, so that samples stay in their order.
        self._subscriber = self._session.declare_subscriber("0/fmu/out/**", self._hear)
        self._request_ids = 1000

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._requests.put(None)
        self._answering.join()
        self._subscriber.undeclare()
        self._session.close()

    def _hear(self, sample: Any) -> None:
        topic = str(sample.key_expr).split("/")[3]
        if str(sample.key_expr) != key_of(0, "out", topic, PUBLISHED[topic]):
            return
        payload = bytes(sample.payload)
        message = message_type(PUBLISHED[topic]).read(payload)
        attachment = b"" if sample.attachment is None else bytes(sample.attachment)
        with self._lock:
            kept = self._heard[topic]
            kept.append(Heard(time.monotonic(), message, len(payload), attachment))
            del kept[:-6000]
        if topic == "arming_check_request":
            self._requests.put(message)

    def _answer(self) -> None:
        while (request := self._requests.get()) is not None:
            for number, fields in list(self.checks.items()):
                self.send(
                    "arming_check_reply",
                    request_id=request.request_id,
                    registration_id=number,
                    **fields,
                )

    # Sending

    def send(self, topic: str, **fields: Any) -> None:
        """Send a message."""
        message = message_type(SUBSCRIBED[topic])
        self._publishers[topic].put(message.encoded(**fields)[: 4 + message.size])

    def send_bytes(self, topic: str, payload: bytes) -> None:
        """Send any bytes."""
        self._publishers[topic].put(payload)

    # Hearing

    def heard(self, topic: str, since_s: float = 0.0) -> list[Heard]:
        """Return the samples of a topic since a time."""
        with self._lock:
            return [heard for heard in self._heard[topic] if heard.at_s >= since_s]

    def topics(self) -> list[str]:
        """Return the topics that were heard."""
        with self._lock:
            return sorted(topic for topic, heard in self._heard.items() if heard)

    def last(self, topic: str) -> Any:
        """Return the last message of a topic.

        Raises:
            LookupError: There was none.
        """
        heard = self.heard(topic)
        if not heard:
            raise LookupError(f"{topic} was never heard")
        return heard[-1].message

    def wait(
        self,
        topic: str,
        condition: Callable[[Any], bool] = lambda _: True,
        *,
        since_s: float | None = None,
        seconds: float = ANSWER_S,
    ) -> Heard | None:
        """Return the first sample since a time (default: now) that meets a condition, or None after some seconds."""
        begun_s = time.monotonic()
        since_s = begun_s if since_s is None else since_s
        while True:
            for heard in self.heard(topic, since_s):
                if condition(heard.message):
                    return heard
            if time.monotonic() > begun_s + seconds:
                return None
            time.sleep(0.002)

    # PX4

    @property
    def state(self) -> int:
        """Number of the flown mode."""
        return int(self.last("vehicle_status").nav_state)

    def until_state(self, wanted: Callable[[int], bool], seconds: float = 5.0) -> float:
        """Wait until the flown mode is one of the wanted; return how long that took, NaN if it never was."""
        begun_s = time.monotonic()
        while time.monotonic() < begun_s + seconds:
            if wanted(self.state):
                return time.monotonic() - begun_s
            time.sleep(0.002)
        return NAN

    def ask(self, name: str, **fields: Any) -> Heard | None:
        """Ask for a registration; return the reply."""
        self._request_ids += 1
        number = self._request_ids
        begun_s = time.monotonic()
        wanted = {"register_arming_check": True, "register_mode": True, **fields}
        self.send(
            "register_ext_component_request",
            request_id=number,
            name=as_field(name),
            px4_ros2_api_version=1,
            **wanted,
        )
        return self.wait(
            "register_ext_component_reply",
            lambda reply: reply.request_id == number,
            since_s=begun_s,
        )

    @contextlib.contextmanager
    def registered(
        self, name: str, *, answers: dict[str, Any] | None = None, **fields: Any
    ) -> Iterator[Any]:
        """Register a mode that may run, and unregister it at the end.

        Raises:
            RuntimeError: It was refused.
        """
        heard = self.ask(name, **fields)
        if heard is None or not heard.message.success:
            raise RuntimeError(f"PX4 did not register {name}: {heard}")
        reply = heard.message
        self.checks[reply.arming_check_id] = {"can_arm_and_run": True, **(answers or {})}
        time.sleep(0.5)
        try:
            yield reply
        finally:
            self.unregister(name, reply)

    def unregister(self, name: str, reply: Any) -> None:
        """Unregister what a reply has registered."""
        self.checks.pop(reply.arming_check_id, None)
        self.send(
            "unregister_ext_component",
            name=as_field(name),
            arming_check_id=reply.arming_check_id,
            mode_id=reply.mode_id,
            mode_executor_id=reply.mode_executor_id,
        )
        time.sleep(0.1)

    def command(
        self, number: int, *params: float, topic: str = "vehicle_command", **fields: Any
    ) -> list[int]:
        """Send a command; return the results of its answers."""
        values = {f"param{index}": value for index, value in enumerate(params, start=1)}
        sender = {"source_system": 1, "source_component": 1, "from_external": True}
        addressee = {"target_system": 1, "target_component": 1}
        begun_s = time.monotonic()
        self.send(topic, command=number, **{**values, **sender, **addressee, **fields})
        self.wait("vehicle_command_ack", lambda ack: ack.command == number, since_s=begun_s)
        time.sleep(0.05)
        answers = self.heard("vehicle_command_ack", begun_s)
        return [answer.message.result for answer in answers if answer.message.command == number]

    def choose(self, state: int, **fields: Any) -> list[int]:
        """Ask for a mode by its number; return the results."""
        return self.command(SET_NAV_STATE, float(state), **fields)

    def fly(self, seconds: float, north_m_s: float = 0.0, down_m_s: float = 0.0) -> None:
        """Send velocities at 50 Hz."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            self.send(
                "trajectory_setpoint",
                position=FREE,
                velocity=(north_m_s, 0.0, down_m_s),
                acceleration=FREE,
                jerk=FREE,
                yaw=NAN,
                yawspeed=NAN,
            )
            time.sleep(0.02)

    def take_off(self) -> None:
        """Choose TAKEOFF, arm, and wait until PX4 holds.

        Raises:
            RuntimeError: It does not take off.
        """
        ground = self.last("vehicle_local_position").z
        self.command(22, NAN, NAN, NAN, NAN, NAN, NAN, NAN)
        end_s = time.monotonic() + 60.0
        while self.command(400, 1.0) != [0] and time.monotonic() < end_s:
            time.sleep(1.0)
        self.until_state(lambda state: state == 17)
        self.until_state(lambda state: state == 4, 60.0)
        if self.last("vehicle_local_position").z > ground - 1.0:
            self.come_down()
            raise RuntimeError("PX4 does not take off")

    @contextlib.contextmanager
    def flying(self, name: str, *, enters: bool = True, **fields: Any) -> Iterator[Any]:
        """Register a mode, take off and enter it; land and unregister it at the end.

        Raises:
            RuntimeError: PX4 refuses one of it.
        """
        with self.registered(name, **fields) as reply:
            self.take_off()
            try:
                if enters:
                    answers = self.choose(reply.mode_id)
                    if math.isnan(self.until_state(lambda state: state == reply.mode_id)):
                        raise RuntimeError(f"PX4 does not enter the mode: {answers}")
                yield reply
            finally:
                self.come_down()

    def come_down(self) -> None:
        """Land, wait until the vehicle is disarmed, and choose Hold."""
        end_s = time.monotonic() + 90.0
        while self.last("vehicle_status").arming_state == 2 and time.monotonic() < end_s:
            self.command(21)
            self.wait("vehicle_status", lambda status: status.arming_state == 1, seconds=20.0)
        self.choose(4)


def as_field(name: str) -> tuple[int, ...]:
    """Return a name in a field of 25 bytes."""
    return tuple(name.encode().ljust(25, b"\0"))
