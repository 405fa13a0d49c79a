"""Who is there? The first autopilot that is heard on a wire, before anything is said to it but that we are here."""

from typing import Final, NamedTuple

from pymavlink.dialects.v20 import common

from guidance.errors import LinkError
from guidance.links.arrivals import Clock
from guidance.links.codec import MAV_MODE_FLAG_SAFETY_ARMED
from guidance.links.dialect import CRC_EXTRA
from guidance.links.framing import Frame, Framer
from guidance.links.opening import Sleep
from guidance.links.port import Wire

MAV_AUTOPILOT_INVALID: Final = 8
"""What a ground station, a companion computer or a camera calls itself."""

MAV_TYPE_GCS: Final = 6
_OWN: Final = (255, 191)
_HEARTBEAT: Final = 0
_HEARTBEAT_EVERY_S: Final = 1.0
_LOOK_EVERY_S: Final = 0.02


class Found(NamedTuple):
    """An autopilot by its HEARTBEAT: MAV_AUTOPILOT, MAV_TYPE, and whether it is armed."""

    system_id: int
    component_id: int
    autopilot: int
    vehicle_type: int
    armed: bool


def find_autopilot(wire: Wire, *, clock: Clock, timeout_s: float, sleep: Sleep, who: str) -> Found:
    """Wait for the first HEARTBEAT of an autopilot. The wire stays open; what else arrived meanwhile is gone.

    Our own HEARTBEAT (a companion computer's) goes out once a second, since a vehicle that is called by UDP answers
    only then.

    Raises:
        LinkError: If none came within `timeout_s`.
    """
    framer, mavlink = Framer(CRC_EXTRA), common.MAVLink(None, *_OWN)
    deadline_s, beat_s, others = clock() + timeout_s, clock(), 0
    while True:
        if clock() >= beat_s:
            beat_s += _HEARTBEAT_EVERY_S
            wire.send(_beat(mavlink))
        for _, data in wire.receive():
            for frame in framer.feed(data, stream=wire.stream):
                found = _found(mavlink, frame)
                if found is not None:
                    return found
                others += 1
        if clock() >= deadline_s:
            raise LinkError(
                f"{who}: no autopilot's HEARTBEAT within {timeout_s:g} s ({others} other frames heard); is it running, "
                "and does it send here?"
            )
        sleep(_LOOK_EVERY_S)


def _found(mavlink: common.MAVLink, frame: Frame) -> Found | None:
    if frame.message_id != _HEARTBEAT:
        return None
    try:
        beat = mavlink.decode(bytearray(frame.data))
    except common.MAVError:
        return None
    if beat.autopilot == MAV_AUTOPILOT_INVALID or beat.type == MAV_TYPE_GCS:
        return None
    armed = bool(beat.base_mode & MAV_MODE_FLAG_SAFETY_ARMED)
    return Found(frame.system_id, frame.component_id, int(beat.autopilot), int(beat.type), armed)


def _beat(mavlink: common.MAVLink) -> bytes:
    beat = common.MAVLink_heartbeat_message(common.MAV_TYPE_ONBOARD_CONTROLLER, MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    frame = bytes(beat.pack(mavlink))
    mavlink.seq = (mavlink.seq + 1) % 256
    return frame
