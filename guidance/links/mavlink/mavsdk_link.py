"""A vehicle through the MAVSDK client, which sends our HEARTBEAT, commands, parameter and mission requests.

MAVSDK gets its bytes through its `raw://` connection, over the same wires as the other link, so both directions can be
recorded. MAVSDK's own UDP, TCP and serial connections show no bytes, and two of them share a port without an error.
Telemetry is decoded here, as in the other link. MAVSDK gets only the frames that it needs to know the vehicle, and the
answers to its requests.

Setpoints and TIMESYNC are sent from here directly: through MAVSDK's threads a frame takes 0.2 ms longer, and more
while the loop is busy. MAVSDK's Offboard plugin is not used because it repeats the last velocity at 20 Hz by itself:
the vehicle would fly on if the guidance loop hung. Its `send_command` is not used because it repeats a mode change
even after a pilot has taken over. All frames are numbered as those of one sender. Calling a destroyed MAVSDK object
would crash the process, so none is called after `close`.
"""

import contextlib
import ctypes
import json
import logging
import math
import threading
from typing import Final

from mavsdk import Configuration, ConnectionResult, Mavsdk
from mavsdk.cmavsdk_loader import _cmavsdk_lib
from mavsdk.logging import LogCallback
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectError, MavlinkMessage
from pymavlink.dialects.v20 import common as mavlink

from guidance.errors import LinkError
from guidance.links.mavlink.frames import Fields, Frame, FrameReader
from guidance.links.mavlink.pymavlink_link import USED, PymavlinkLink

_ANSWERS: Final = frozenset(
    {"COMMAND_ACK", "PARAM_VALUE", "MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ACK"}
)
_SHOWN: Final = _ANSWERS | {"HEARTBEAT", "AUTOPILOT_VERSION"}
"""Messages that are passed on to MAVSDK."""

_DIRECT: Final = frozenset({"SET_POSITION_TARGET_LOCAL_NED", "TIMESYNC"})
"""Messages that do not go through MAVSDK."""

LOGGER: Final = logging.getLogger("guidance.links.mavsdk")
# One lower: MAVSDK's INFO is chatter
_LEVELS: Final = (
    logging.DEBUG,
    logging.DEBUG,
    logging.INFO,
    logging.WARNING,
)
_EXPECTED: Final = b"No raw connection available."
"""Begins what MAVSDK says to a subscription before the connection, see `MavsdkLink`."""


def _log(
    level: int, message: bytes | None, _file: bytes | None, _line: int, _user: ctypes.c_void_p
) -> bool:
    said = message or b""
    severity = logging.DEBUG if said.startswith(_EXPECTED) else _LEVELS[min(max(level, 0), 3)]
    LOGGER.log(severity, "MAVSDK: %s", said.decode(errors="replace"))
    return True  # handled: MAVSDK prints nothing


# MAVSDK's log goes to `logging`, for the whole process. The library's own `log_subscribe` prints an error when a
# vehicle sends text that is not UTF-8.
LOGGER.addHandler(logging.NullHandler())  # silent unless the program sets up logging
_callback = LogCallback(_log)  # a name, as the library keeps only its address
_cmavsdk_lib.mavsdk_log_subscribe(_callback, None)


class MavsdkLink(PymavlinkLink):
    """`VehicleLink` over MAVSDK 4.1 and a wire."""

    _reads = USED | _SHOWN

    def _start(self) -> None:
        """Start MAVSDK.

        Raises:
            LinkError: If MAVSDK refuses its connection.
        """
        self._numbering = threading.Lock()
        self._direct: MavlinkDirect | None = None
        self._own_frames = FrameReader()
        self._decoder = mavlink.MAVLink(None)
        configuration = Configuration.create_manual(*self._own, True)
        self._mavsdk = Mavsdk(configuration)
        configuration.destroy()
        # In this order: MAVSDK sends a HEARTBEAT as soon as there is a connection, and warns if there is no subscriber.
        self._mavsdk.subscribe_raw_bytes_to_be_sent(self._pass_on)
        result = self._mavsdk.add_any_connection("raw://")
        if result != ConnectionResult.SUCCESS:
            self.close()
            raise LinkError(
                f"raw://: MAVSDK {result.name}; is another program of this process using it?"
            )

    def _pass_on(self, data: bytes) -> None:
        """Send one frame of MAVSDK's, numbered as our next; called on MAVSDK's thread."""
        frame = self._own_frames.first(data)
        if frame is not None:
            message = self._decoder.decode(bytearray(frame.data))
            with self._numbering:
                self._station.send(message)

    def hear(self, frame: Frame, received_s: float) -> None:
        """Take one message of the vehicle, and pass it on to MAVSDK if needed; raises as the other link's."""
        # MAVSDK would believe a HEARTBEAT that another program sent with the vehicle's ids.
        is_anothers = (
            frame.name == "HEARTBEAT"
            and self.autopilot is not None
            and frame.fields.autopilot != self.autopilot
        )
        if frame.name in _SHOWN and not is_anothers:
            self._mavsdk.pass_received_raw_bytes(frame.data)
        if frame.name in USED:
            super().hear(frame, received_s)

    @property
    def heard(self) -> bool:
        """True once both we and MAVSDK have received a HEARTBEAT of the vehicle."""
        return self.heartbeats > 0 and self._direct is not None

    def _tend(self, now_s: float) -> None:
        """As the other link; first, find the vehicle in MAVSDK, which knows it some time after its first HEARTBEAT."""
        if self._direct is None and self.heartbeats:
            system_id, component_id = self._vehicle
            for one in self._mavsdk.get_systems():
                if one.get_system_id() == system_id and component_id in one.component_ids():
                    self._direct = MavlinkDirect(one)
        super()._tend(now_s)

    def _send(self, message: Fields) -> None:
        name = message.msgname
        if name in _DIRECT:
            with self._numbering:
                super()._send(message)
            return
        if self._direct is None:
            return
        fields = {name: message.format_attr(name) for name in message.fieldnames}
        plain = {
            key: None if isinstance(v, float) and math.isnan(v) else v for key, v in fields.items()
        }
        try:
            self._direct.send_message(MavlinkMessage(name, fields_json=json.dumps(plain)))
        except MavlinkDirectError:
            self.counts["unsent"] += 1

    def send_heartbeat(self) -> None:
        """Do nothing: MAVSDK sends ours once a second."""

    def close(self) -> None:
        """Close the wire, then destroy MAVSDK. May be called twice."""
        if self._closed:
            return
        super().close()
        with contextlib.ExitStack() as stack:
            stack.callback(self._mavsdk.destroy)
            if self._direct is not None:
                stack.callback(self._direct.destroy)
