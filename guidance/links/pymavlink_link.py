"""A vehicle through pymavlink, over any wire."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from guidance.links.arrivals import Clock
from guidance.links.conversation import Address, Conversation
from guidance.links.encode import Station
from guidance.links.port import Wire
from guidance.links.signing import SigningKey
from guidance.messages import Message, Request, Setpoint

OWN_HEARTBEAT: Final = {
    "type": 18,  # MAV_TYPE_ONBOARD_CONTROLLER
    "autopilot": 8,  # MAV_AUTOPILOT_INVALID: we are none
    "base_mode": 0,
    "custom_mode": 0,
    "system_status": 4,  # MAV_STATE_ACTIVE
    "mavlink_version": 3,
}


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
        own = Address(own_system_id or system_id, own_component_id)
        self._wire = wire
        self._clock = clock
        self._station = Station(*own, signing_key=signing_key, clock=clock, unix_s=unix_s)
        vehicle, admit = Address(system_id, component_id), None if signing_key is None else self._station.doubts
        self._conversation = Conversation(wire, self._send, admit, vehicle=vehicle, own=own)
        self._closed = False

    @property
    def heard(self) -> bool:
        """Whether a HEARTBEAT of the vehicle was heard."""
        return self._conversation.heartbeats > 0

    @property
    def others(self) -> frozenset[int]:
        """System ids of whoever else speaks on the wire."""
        return frozenset(self._conversation.others)

    def poll(self) -> None:
        """Read the wire and keep what comes for the next `receive`; send what is due."""
        self._conversation.poll(self._clock())

    def receive(self) -> Sequence[Message]:
        """All messages of the vehicle since the last call, oldest first."""
        return self._conversation.receive(self._clock())

    def _send(self, name: str, fields: dict[str, Any]) -> None:
        self._wire.send(self._station.pack(name, fields))

    def send_setpoint(self, setpoint: Setpoint) -> None:
        """Put one setpoint frame on the wire, now.

        Raises:
            ValueError: If it is not finite; nothing is sent then.
        """
        self._conversation.setpoint(setpoint, self._clock())

    def request(self, request: Request) -> None:
        """Send a command, once, or a question, which is repeated from `receive` until it is answered."""
        self._conversation.request(request, self._clock())

    def send_heartbeat(self) -> None:
        """Send our own HEARTBEAT, once."""
        if not self._closed:
            self._send("HEARTBEAT", OWN_HEARTBEAT)

    def counters(self) -> Mapping[str, int]:
        """What was received, sent and dropped, and why."""
        return self._conversation.counters()

    def close(self) -> None:
        """Close the wire; may be called twice."""
        self._closed = True
        self._conversation.close()
