"""A vehicle through pymavlink, over any wire: only the frames of the one vehicle that we understand are decoded."""

import struct
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import common as dialect

from guidance.links import signing
from guidance.links.arrivals import Clock
from guidance.links.conversation import HEARD, Conversation
from guidance.links.decode import is_bytewise
from guidance.links.dialect import CRC_EXTRA, IDS, NAMES
from guidance.links.framing import Frame, Framer
from guidance.links.port import Wire
from guidance.links.signing import SigningKey
from guidance.messages import Message, Request, Setpoint

MAV_TYPE_ONBOARD_CONTROLLER: Final = 18
MAV_AUTOPILOT_INVALID: Final = 8
MAV_STATE_ACTIVE: Final = 4


class PymavlinkLink:
    """`VehicleLink` over a `Wire`. Nothing blocks, and time is only ever the given clock's."""

    def __init__(
        self,
        wire: Wire,
        clock: Clock,
        *,
        system_id: int,
        component_id: int = 1,
        own_system_id: int | None = None,
        own_component_id: int = 195,
        signing_key: SigningKey | None = None,
        unix_s: float = 0.0,
    ) -> None:
        """Take over a wire, which is closed with the link. `unix_s` is needed for signing only."""
        own = own_system_id or system_id, own_component_id
        self._wire = wire
        self._clock = clock
        self._from = (system_id, component_id)
        self._mavlink = dialect.MAVLink(None, *own)
        self._signed = signing_key is not None
        if signing_key is not None:
            signing.arm(self._mavlink, signing_key, unix_s)
        self._unix_offset_s = unix_s - clock()
        self._framer = Framer(CRC_EXTRA)
        self._dropped: Counter[str] = Counter()
        self._conversation = Conversation(self._send, system_id=system_id, component_id=component_id, own=own)
        self._closed = False

    @property
    def heartbeats(self) -> int:
        """How many HEARTBEATs of the vehicle were heard so far."""
        return self._conversation.heartbeats

    def poll(self) -> None:
        """Read the wire and keep what comes for the next `receive`; send what is due."""
        if self._closed:
            return
        for received_s, data in self._wire.receive():
            for frame in self._framer.feed(data, stream=self._wire.stream):
                self._hear(frame, received_s)
        self._conversation.tend(self._clock())

    def receive(self) -> Sequence[Message]:
        """All messages of the vehicle since the last call, oldest first."""
        self.poll()
        return self._conversation.take()

    def _hear(self, frame: Frame, received_s: float) -> None:
        if (frame.system_id, frame.component_id) != self._from:
            self._dropped["foreign"] += 1
            return
        name = NAMES[frame.message_id]
        if name not in HEARD:
            self._dropped["unused"] += 1
            return
        if self._signed and not frame.signed:
            self._dropped["unsigned"] += 1
            return
        try:
            message = self._mavlink.decode(bytearray(frame.data))
        except dialect.MAVError:
            self._dropped["refused"] += 1
            return
        fields = message.to_dict()
        if name == "PARAM_VALUE":
            fields = self._exact_integer(fields, frame)
        self._conversation.hear(name, fields, received_s)

    def _exact_integer(self, fields: dict[str, Any], frame: Frame) -> dict[str, Any]:
        """PX4's bytewise integers, read from the bytes: as a float, a negative one is a NaN that loses bits."""
        if not is_bytewise(fields, autopilot=self._conversation.autopilot):
            return fields
        start = 10 if frame.data[0] == dialect.PROTOCOL_MARKER_V2 else 6
        payload = frame.data[start : start + frame.data[1]].ljust(4, b"\0")  # trailing zeros are not sent
        (value,) = struct.unpack_from("<i", payload)
        return {**fields, "param_integer": value}

    def _send(self, name: str, fields: dict[str, Any]) -> None:
        message_class = dialect.mavlink_map[IDS[name]]
        packed = {key: value.encode() if isinstance(value, str) else value for key, value in fields.items()}
        if self._signed:
            now_ticks = signing.ticks(self._unix_offset_s + self._clock())
            self._mavlink.signing.timestamp = max(self._mavlink.signing.timestamp, now_ticks)
        frame = message_class(**packed).pack(self._mavlink)
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        self._wire.send(bytes(frame))

    def send_setpoint(self, setpoint: Setpoint) -> None:
        """Put one setpoint frame on the wire, now.

        Raises:
            ValueError: If it is not finite; nothing is sent then.
        """
        if not self._closed:
            self._conversation.setpoint(setpoint, self._clock())

    def request(self, request: Request) -> None:
        """Send a command, once, or a question, which is repeated from `receive` until it is answered."""
        if not self._closed:
            self._conversation.request(request, self._clock())

    def send_heartbeat(self) -> None:
        """Send our own HEARTBEAT, once."""
        if not self._closed:
            self._send(
                "HEARTBEAT",
                {
                    "type": MAV_TYPE_ONBOARD_CONTROLLER,
                    "autopilot": MAV_AUTOPILOT_INVALID,
                    "base_mode": 0,
                    "custom_mode": 0,
                    "system_status": MAV_STATE_ACTIVE,
                    "mavlink_version": 3,
                },
            )

    def counters(self) -> Mapping[str, int]:
        """What was received, sent and dropped, and why."""
        return {
            "foreign": 0,
            "unused": 0,
            "unsigned": 0,
            "refused": 0,
            **self._dropped,
            "garbage_bytes": self._framer.garbage_bytes,
            "unknown": self._framer.unknown,
            **self._conversation.counters(),
            **self._wire.counters(),
        }

    def close(self) -> None:
        """Close the wire; may be called twice."""
        self._closed = True
        self._wire.close()
