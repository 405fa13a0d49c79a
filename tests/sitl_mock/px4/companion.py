"""A program beside PX4, in virtual time: it sends and hears topics of a mock, step by step."""

import math
from typing import Any

from sitl_mock import MockVehicle
from sitl_mock.mavlink import Decoder, Encoder
from sitl_mock.mavlink.dialect import spec_of
from sitl_mock.px4.messages import message_type
from sitl_mock.px4.topic_link import PUBLISHED, SUBSCRIBED, frame_of, sample_of
from sitl_mock.vehicle.link import TOPICS

NAN = math.nan
NOTHING = (NAN, NAN, NAN)
SET_NAV_STATE = 100001


class Companion:
    """A mock PX4 with a program beside it.

    Attributes:
        vehicle: The mock.
        now_s: Present time.
        answers: Answers arming checks with these fields, by registration; None: stays silent.
    """

    def __init__(self, vehicle: MockVehicle | None = None, **parameters: float) -> None:
        self.vehicle = vehicle or MockVehicle(
            "px4",
            ready_after_s=0.5,
            noise=False,
            parameters=parameters,
            links={"onboard": "onboard", "topics": TOPICS},
            log_bytes=0,
        )
        self.now_s = 0.0
        self.answers: dict[int, dict[str, Any] | None] = {}
        self._samples: dict[str, list[tuple[float, bytes]]] = {}
        self._sent: list[bytes] = []
        self._waiting: list[bytes] = []
        self._frames: list[bytes] = []
        self._encoder = Encoder(255, 190)
        self._requests = 0

    # Time

    def step(self, seconds: float = 0.02) -> None:
        """Let time pass; requests for arming checks are answered in the step after them."""
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-9:
            self.now_s += 0.02
            taken = {"onboard": self._frames, "topics": self._waiting}
            self._frames = []
            self._waiting = []
            out = self.vehicle.step_links(self.now_s, taken)
            for frame in out["topics"]:
                self._hear(frame)
            self._sent += out["onboard"]

    def until(self, condition, seconds: float = 60.0) -> float:
        """Let time pass until a condition holds; return how long that took."""
        begun_s = self.now_s
        while not condition():
            assert self.now_s < begun_s + seconds, "it never happened"
            self.step()
        return self.now_s - begun_s

    def _hear(self, frame: bytes) -> None:
        topic, payload = sample_of(frame)
        self._samples.setdefault(topic, []).append((self.now_s, payload))
        if topic == "arming_check_request":
            message = message_type(PUBLISHED[topic]).read(payload)
            for registration, fields in self.answers.items():
                if fields is not None:
                    self.send(
                        "arming_check_reply",
                        request_id=message.request_id,
                        registration_id=registration,
                        **fields,
                    )

    # Topics

    def send(self, topic: str, **fields: Any) -> None:
        """Send a message with the next step."""
        message = message_type(SUBSCRIBED[topic])
        payload = message.encoded(**fields)[: 4 + message.size]
        self._waiting.append(frame_of(topic, payload))

    def send_bytes(self, frame: bytes) -> None:
        """Send any bytes with the next step."""
        self._waiting.append(frame)

    def heard(self, topic: str, since: int = 0) -> list[tuple[float, Any]]:
        """Return the messages of a topic with their times, from the given one on."""
        read = message_type(PUBLISHED[topic]).read
        return [(at_s, read(payload)) for at_s, payload in self._samples.get(topic, [])[since:]]

    def last(self, topic: str) -> Any:
        """Return the last message of a topic, None if there was none."""
        newest = self.heard(topic, since=-1)
        return newest[0][1] if newest else None

    def register(self, name: str, *, answers: dict[str, Any] | None = None, **fields: Any) -> Any:
        """Register a mode with its arming check; return the reply."""
        self._requests += 1
        wanted = {"register_arming_check": True, "register_mode": True, **fields}
        self.send(
            "register_ext_component_request",
            request_id=self._requests,
            name=as_field(name),
            px4_ros2_api_version=1,
            **wanted,
        )
        self.step(0.04)
        reply = self.last("register_ext_component_reply")
        if reply.success and wanted["register_arming_check"]:
            self.answers[reply.arming_check_id] = {"can_arm_and_run": True, **(answers or {})}
            self.step(0.4)
        return reply

    def command(
        self, number: int, *params: float, topic: str = "vehicle_command", **fields: Any
    ) -> int:
        """Send a command; return the result of its answer."""
        values = {f"param{index}": value for index, value in enumerate(params, start=1)}
        known = len(self._samples.get("vehicle_command_ack", []))
        sender = {"source_system": 1, "source_component": 1, "from_external": True}
        self.send(
            topic,
            command=number,
            target_system=1,
            target_component=1,
            **values,
            **{**sender, **fields},
        )
        self.step()
        answers = self.heard("vehicle_command_ack", since=known)
        assert [answer.command for _, answer in answers] == [number]
        return int(answers[0][1].result)

    def choose(self, state: int) -> int:
        """Ask for a mode by its number; return the result."""
        return self.command(SET_NAV_STATE, float(state))

    def fly(self, north_m_s: float, east_m_s: float = 0.0, down_m_s: float = 0.0) -> None:
        """Send a velocity."""
        self.send(
            "trajectory_setpoint",
            position=NOTHING,
            velocity=(north_m_s, east_m_s, down_m_s),
            acceleration=NOTHING,
            jerk=NOTHING,
            yaw=NAN,
            yawspeed=NAN,
        )

    def take_off(self) -> None:
        """Arm and climb to the default height, then hold."""
        self.until(lambda: self.last("vehicle_status").pre_flight_checks_pass)
        assert self.command(22, NAN, NAN, NAN, NAN, NAN, NAN, NAN) == 0
        assert self.command(400, 1.0) == 0
        self.until(lambda: self.state == 4 and self.height_m > 2.0)

    # MAVLink

    def tell(self, name: str, *fields: Any) -> None:
        """Send a MAVLink message with the next step."""
        self._frames.append(self._encoder.pack(name, *fields))

    def mavlink_messages(self, name: str) -> list[Any]:
        """Return the MAVLink messages of one kind so far."""
        number = spec_of(name).id_bytes
        frames = [frame for frame in self._sent if frame[7:10] == number]
        return [message for frame in frames for message in Decoder().feed(frame, whole=True)]

    # State

    @property
    def state(self) -> int:
        """Number of the flown mode."""
        return int(self.last("vehicle_status").nav_state)

    @property
    def height_m(self) -> float:
        """Height above the local frame's origin."""
        return -float(self.last("vehicle_local_position").z)


def as_field(name: str) -> tuple[int, ...]:
    """Return a name in a field of 25 bytes."""
    return tuple(name.encode().ljust(25, b"\0"))
