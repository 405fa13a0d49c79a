"""A vehicle through the MAVSDK client, which sends our HEARTBEAT, commands, parameters and questions for the mission.

MAVSDK is given its bytes through its `raw://` connection, over the same wires as the other link, so that the record
sees both directions. Its own UDP, TCP and serial connections show no bytes to anybody, and
two of them may share a port without a word. Telemetry is read from the wire, as the other link reads it; MAVSDK sees of
the vehicle's frames those that it needs to know the vehicle, and the answers to what it sends.

Setpoints and TIMESYNC go on the wire from here, at once: through MAVSDK's threads a frame takes 0.2 ms longer, and more
while the loop is busy. The Offboard plugin would not do in any case, since it resends the last velocity at 20 Hz by
itself: a guidance loop that hangs would fly on. Its `send_command` would not do either: it repeats a mode change
blindly, whatever a pilot does meanwhile. All frames are numbered as one sender's. Nothing is called on MAVSDK
after it was destroyed, which would be a segmentation fault.
"""

import contextlib
import ctypes
import json
import logging
import math
import threading
from typing import Any, Final

from mavsdk import Configuration, ConnectionResult, Mavsdk
from mavsdk.cmavsdk_loader import _cmavsdk_lib
from mavsdk.logging import LogCallback
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectError, MavlinkMessage

from guidance.errors import LinkError
from guidance.links.arrivals import Clock
from guidance.links.conversation import Address, Conversation
from guidance.links.encode import Station
from guidance.links.framing import CRC_EXTRA, IDS, Frame, first_frame
from guidance.links.port import Wire

_SHOWN: Final = frozenset(
    IDS[name]
    for name in (
        "HEARTBEAT",
        "AUTOPILOT_VERSION",
        "COMMAND_ACK",
        "PARAM_VALUE",
        "MISSION_COUNT",
        "MISSION_ITEM_INT",
        "MISSION_ACK",
    )
)
"""What MAVSDK gets to see."""

_AT_ONCE: Final = frozenset({"SET_POSITION_TARGET_LOCAL_NED", "TIMESYNC"})

LOGGER: Final = logging.getLogger("guidance.links.mavsdk")
_LEVELS: Final = (logging.DEBUG, logging.DEBUG, logging.INFO, logging.WARNING)  # one lower: MAVSDK's INFO is chatter


def _log(level: int, message: bytes | None, _file: bytes | None, _line: int, _user: ctypes.c_void_p) -> bool:
    LOGGER.log(_LEVELS[min(max(level, 0), 3)], "%s", (message or b"").decode(errors="replace"))
    return True  # handled: nothing is printed


_callback = LogCallback(_log)


def route_to_logging() -> None:
    """Take over MAVSDK's log, for the whole process; calling it again changes nothing.

    The library's own `log_subscribe` is not used since it prints an error when a vehicle sends text that is not UTF-8.
    """
    if not any(isinstance(handler, logging.NullHandler) for handler in LOGGER.handlers):
        LOGGER.addHandler(logging.NullHandler())  # silent unless the program sets logging up
        _cmavsdk_lib.mavsdk_log_subscribe(_callback, None)


class MavsdkLink(Conversation):
    """`VehicleLink` over MAVSDK 4.1 and a wire."""

    def __init__(
        self,
        wire: Wire,
        clock: Clock,
        *,
        system_id: int,
        component_id: int = 1,
        own_system_id: int | None = None,
        own_component_id: int = 195,
    ) -> None:
        """Take over a wire, which is closed with the link.

        Raises:
            LinkError: If MAVSDK does not take its connection.
        """
        route_to_logging()
        own = Address(own_system_id or system_id, own_component_id)
        vehicle = Address(system_id, component_id)
        super().__init__(wire, clock, Station(*own), self._show, vehicle=vehicle, own=own)
        self._numbering = threading.Lock()
        self._direct: MavlinkDirect | None = None
        configuration = Configuration.create_manual(*own, True)
        self._mavsdk = Mavsdk(configuration)
        configuration.destroy()
        # In this order: subscribed before there is a connection, MAVSDK complains of having none.
        result = self._mavsdk.add_any_connection("raw://")
        self._mavsdk.subscribe_raw_bytes_to_be_sent(self._pass_on)
        if result != ConnectionResult.SUCCESS:
            self.close()
            raise LinkError(f"raw://: MAVSDK {result.name}; is another program of this process using it?")

    def _pass_on(self, data: bytes) -> None:
        """On MAVSDK's thread: one frame of its own."""
        frame = first_frame(data, CRC_EXTRA)
        if frame is not None:
            with self._numbering:
                self._wire.send(self._station.renumber(frame))

    def _show(self, frame: Frame) -> None:
        if frame.message_id in _SHOWN:
            self._mavsdk.pass_received_raw_bytes(frame.data)

    @property
    def heard(self) -> bool:
        """Whether a HEARTBEAT of the vehicle was heard, by us and by MAVSDK."""
        return self.heartbeats > 0 and self._direct is not None

    def poll(self) -> None:
        """Read the wire and keep what comes for the next `receive`; send what is due."""
        super().poll()
        self._meet()

    def _meet(self) -> None:
        """MAVSDK knows a system some time after it saw its first HEARTBEAT."""
        if self._direct is not None or self._closed or not self.heartbeats:
            return
        for system in self._mavsdk.get_systems():
            known = self._vehicle.component_id in system.component_ids()
            if known and system.get_system_id() == self._vehicle.system_id:
                self._direct = MavlinkDirect(system)
                return

    def _send(self, name: str, fields: dict[str, Any]) -> None:
        if name in _AT_ONCE:
            with self._numbering:
                super()._send(name, fields)
            return
        if self._direct is None:
            return
        plain = {key: None if isinstance(v, float) and math.isnan(v) else v for key, v in fields.items()}
        try:
            self._direct.send_message(MavlinkMessage(name, fields_json=json.dumps(plain)))
        except MavlinkDirectError:
            self.counts["unsent"] += 1

    def send_heartbeat(self) -> None:
        """Nothing: MAVSDK sends ours once a second by itself."""

    def close(self) -> None:
        """First nothing comes in any more and nothing is asked, then MAVSDK goes. May be called twice."""
        if self._closed:
            return
        super().close()
        with contextlib.ExitStack() as stack:
            stack.callback(self._mavsdk.destroy)
            if self._direct is not None:
                stack.callback(self._direct.destroy)
