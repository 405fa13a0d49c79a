"""MAVLink fields to typed values: one literal table, for every link and every wire.

Fields are those of `guidance.links.framing.fields_of`, by the names of MAVLink's definition. A STATUSTEXT longer than
50 bytes comes in chunks; they are joined here.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

from guidance.frames import Vector
from guidance.messages import (
    Attitude,
    CommandAck,
    FenceCount,
    FenceItem,
    FenceRefused,
    GlobalPosition,
    Heartbeat,
    Home,
    LandedState,
    LocalPosition,
    Message,
    Odometry,
    Origin,
    Parameter,
    PositionTarget,
    StatusText,
    SystemStatus,
)
from guidance.vehicle import is_plausible

Fields = Mapping[str, Any]

MAV_AUTOPILOT_PX4: Final = 12
MAV_MODE_FLAG_SAFETY_ARMED: Final = 128
INT32_MAX: Final = 2**31 - 1
MAV_PARAM_TYPE_INT32: Final = 6
MAV_MISSION_TYPE_FENCE: Final = 1
_TEXT_CHUNK_BYTES: Final = 50
_TEXT_PATIENCE_S: Final = 1.0
_MOST_TEXT_CHUNKS: Final = 16


def finite(x: float, y: float, z: float) -> Vector:
    """Three fields that make no sense unless they are all finite.

    Raises:
        ValueError: If one of them is not.
    """
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        raise ValueError(f"not finite: {x}, {y}, {z}")
    return x, y, z


def degrees(latitude_e7: int, longitude_e7: int) -> tuple[float, float]:
    """WGS-84 degrees from 1e7 degrees.

    Raises:
        ValueError: If they are the sentinels of "unknown" (INT32_MAX, or 0/0 before the first fix) or off the globe.
    """
    latitude, longitude = latitude_e7 / 1e7, longitude_e7 / 1e7
    if latitude_e7 == 0 and longitude_e7 == 0:
        raise ValueError("latitude and longitude are both 0: no fix yet")
    if abs(latitude) > 90.0 or abs(longitude) > 180.0:
        raise ValueError(f"off the globe: {latitude}, {longitude}")
    return latitude, longitude


def _heartbeat(f: Fields, received_s: float) -> Message:
    armed = bool(f["base_mode"] & MAV_MODE_FLAG_SAFETY_ARMED)
    return Heartbeat(received_s, f["custom_mode"], armed, f["system_status"], f["autopilot"])


def _local_position(f: Fields, received_s: float) -> Message:
    position, velocity = (f["x"], f["y"], f["z"]), (f["vx"], f["vy"], f["vz"])
    return LocalPosition(received_s, f["time_boot_ms"] / 1e3, position, velocity)


def _global_position(f: Fields, received_s: float) -> Message:
    latitude, longitude = degrees(f["lat"], f["lon"])
    velocity = (f["vx"] / 1e2, f["vy"] / 1e2, f["vz"] / 1e2)
    above_sea, above_home = f["alt"] / 1e3, f["relative_alt"] / 1e3
    return GlobalPosition(received_s, f["time_boot_ms"] / 1e3, latitude, longitude, above_sea, above_home, velocity)


def _attitude(f: Fields, received_s: float) -> Message:
    return Attitude(received_s, f["time_boot_ms"] / 1e3, f["yaw"])


def _odometry(f: Fields, received_s: float) -> Message:
    return Odometry(received_s, f["reset_counter"])


def _extended_state(f: Fields, received_s: float) -> Message:
    return LandedState(received_s, f["landed_state"])


def _system_status(f: Fields, received_s: float) -> Message:
    percent = f["battery_remaining"]
    remaining = percent / 100.0 if 0 <= percent <= 100 else math.nan  # -1: not sent
    present, health = f["onboard_control_sensors_present"], f["onboard_control_sensors_health"]
    return SystemStatus(received_s, present, health, remaining)


def _home(f: Fields, received_s: float) -> Message:
    latitude, longitude = degrees(f["latitude"], f["longitude"])
    position = (f["x"], f["y"], f["z"])
    return Home(received_s, latitude, longitude, f["altitude"] / 1e3, position)


def _origin(f: Fields, received_s: float) -> Message:
    latitude, longitude = degrees(f["latitude"], f["longitude"])
    return Origin(received_s, latitude, longitude, f["altitude"] / 1e3)


def _command_ack(f: Fields, received_s: float) -> Message:
    return CommandAck(received_s, f["command"], f["result"])


def _position_target(f: Fields, received_s: float) -> Message:
    velocity = (f["vx"], f["vy"], f["vz"])
    return PositionTarget(received_s, f["time_boot_ms"] / 1e3, f["type_mask"], velocity)


def _of_the_fence(f: Fields) -> None:
    if f["mission_type"] != MAV_MISSION_TYPE_FENCE:
        raise ValueError(f"mission_type {f['mission_type']}: only the fence is read")


def _fence_count(f: Fields, received_s: float) -> Message:
    _of_the_fence(f)
    return FenceCount(received_s, f["count"])


def _fence_item(f: Fields, received_s: float) -> Message:
    _of_the_fence(f)
    size = f["param1"]
    if not math.isfinite(size):
        raise ValueError(f"param1 = {size}: neither a number of corners nor a radius")
    latitude, longitude = degrees(f["x"], f["y"])
    return FenceItem(received_s, f["seq"], f["command"], size, latitude, longitude)


def _fence_refused(f: Fields, received_s: float) -> Message:
    _of_the_fence(f)
    return FenceRefused(received_s, f["type"])


DECODERS: Final[Mapping[str, Callable[[Fields, float], Message]]] = {
    "HEARTBEAT": _heartbeat,
    "SYS_STATUS": _system_status,
    "ATTITUDE": _attitude,
    "LOCAL_POSITION_NED": _local_position,
    "GLOBAL_POSITION_INT": _global_position,
    "GPS_GLOBAL_ORIGIN": _origin,
    "COMMAND_ACK": _command_ack,
    "POSITION_TARGET_LOCAL_NED": _position_target,
    "HOME_POSITION": _home,
    "EXTENDED_SYS_STATE": _extended_state,
    "ODOMETRY": _odometry,
    "MISSION_COUNT": _fence_count,
    "MISSION_ITEM_INT": _fence_item,
    "MISSION_ACK": _fence_refused,
}
"""Messages that mean something by themselves; STATUSTEXT, TIMESYNC and PARAM_VALUE need the conversation."""


def decode(name: str, fields: Fields, received_s: float) -> Message:
    """Turn one message's fields into a typed value.

    Raises:
        KeyError: If the message is not in `DECODERS`, or lacks a field.
        ValueError: If its values cannot be meant.
    """
    message = DECODERS[name](fields, received_s)
    if not is_plausible(message):
        raise ValueError(f"{message}: cannot be meant")
    return message


def parameter(fields: Fields, received_s: float, *, autopilot: int) -> Parameter:
    """PARAM_VALUE as a number. PX4 carries integers bytewise in the float, everyone else as the number itself."""
    value = fields["param_integer" if is_bytewise(fields, autopilot=autopilot) else "param_value"]
    return Parameter(received_s, fields["param_id"], float(value), fields["param_type"])


def is_bytewise(fields: Fields, *, autopilot: int) -> bool:
    """Whether this PARAM_VALUE carries an integer's bytes in its float (PX4: MAV_PARAM_TYPE_INT32 only)."""
    return autopilot == MAV_AUTOPILOT_PX4 and fields["param_type"] == MAV_PARAM_TYPE_INT32


class OpenText(NamedTuple):
    """A text whose last chunk has not come yet."""

    first_received_s: float
    message_id: int
    severity: int
    chunks: tuple[str, ...]
    next_sequence: int

    def close(self) -> StatusText:
        """Take the text as it stands."""
        return StatusText(self.first_received_s, self.severity, "".join(self.chunks))


def join_text(
    open_text: OpenText | None, fields: Fields, received_s: float
) -> tuple[OpenText | None, list[StatusText]]:
    """Add one STATUSTEXT: what is open afterwards, and which texts are complete.

    `id` 0 is a text of one chunk. A chunk that is not full is the last one. A gap is shown as an ellipsis.
    """
    done: list[StatusText] = []
    message_id, sequence, text = fields.get("id", 0), fields.get("chunk_seq", 0), fields["text"]
    continues = open_text is not None and message_id == open_text.message_id != 0
    if open_text is not None and not continues:
        done.append(open_text.close())
        open_text = None
    if message_id == 0:
        return None, [*done, StatusText(received_s, fields["severity"], text)]
    if open_text is None:
        open_text = OpenText(received_s, message_id, fields["severity"], (), 0)
    gap = ("…",) if sequence != open_text.next_sequence else ()
    open_text = open_text._replace(chunks=(*open_text.chunks, *gap, text), next_sequence=sequence + 1)
    if len(text.encode()) < _TEXT_CHUNK_BYTES or len(open_text.chunks) >= _MOST_TEXT_CHUNKS:
        return None, [*done, open_text.close()]
    return open_text, done


def expire_text(open_text: OpenText | None, now_s: float) -> tuple[OpenText | None, list[StatusText]]:
    """Give up waiting for the rest after a second."""
    if open_text is not None and now_s - open_text.first_received_s > _TEXT_PATIENCE_S:
        return None, [open_text.close()]
    return open_text, []
