"""A vehicle through pymavlink, over any wire."""

from typing import Final

from guidance.links.arrivals import Clock
from guidance.links.conversation import Address, Conversation
from guidance.links.encode import Station
from guidance.links.port import Wire
from guidance.links.signing import SigningKey

OWN_HEARTBEAT: Final = {
    "type": 18,  # MAV_TYPE_ONBOARD_CONTROLLER
    "autopilot": 8,  # MAV_AUTOPILOT_INVALID: we are none
    "base_mode": 0,
    "custom_mode": 0,
    "system_status": 4,  # MAV_STATE_ACTIVE
    "mavlink_version": 3,
}


class PymavlinkLink(Conversation):
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
        station = Station(*own, signing_key=signing_key, clock=clock, unix_s=unix_s)
        admit = None if signing_key is None else station.doubts
        super().__init__(wire, clock, station, admit, vehicle=Address(system_id, component_id), own=own)

    def send_heartbeat(self) -> None:
        """Send our own HEARTBEAT, once."""
        if not self._closed:
            self._send("HEARTBEAT", OWN_HEARTBEAT)
