"""Typed requests and setpoints to MAVLink fields, with the exact type masks; fields to frames, numbered and signed."""

import math
import struct
from collections.abc import Mapping
from typing import Any, Final

from guidance.links.arrivals import Clock
from guidance.links.decode import INT32_MAX, MAV_MISSION_TYPE_FENCE, is_bytewise
from guidance.links.framing import CRC_EXTRA, IDS, LAYOUTS, MAGIC_V2, SIGNED, Frame, Layout, checksum
from guidance.links.signing import Signatures, SigningKey, ticks
from guidance.messages import Command, FenceReceived, FenceRequest, ParameterRequest, ParameterSet, Request, Setpoint

Packed = tuple[str, dict[str, Any]]

MAV_FRAME_LOCAL_NED: Final = 1
FLOAT32_MAX: Final = 3.4028234663852886e38
_MOST_BYTEWISE: Final = 0x7F7FFFFF
"""The largest integer whose bytes are a finite float; those of a negative one are a NaN, which JSON cannot carry."""

_HEADER: Final = struct.Struct("<BBBBBBBHB")

# POSITION_TARGET_TYPEMASK: a set bit tells the autopilot to ignore that field.
IGNORE_POSITION: Final = 1 | 2 | 4
IGNORE_ACCELERATION: Final = 64 | 128 | 256
IGNORE_YAW: Final = 1024
IGNORE_YAW_RATE: Final = 2048


def setpoint_type_mask(setpoint: Setpoint) -> int:
    """Which fields the autopilot is to ignore.

    Velocity alone 3527, with yaw 2503, with acceleration feed-forward 3079 (yaw 2055). PX4 and ArduCopter take all of
    these. No height goes beside a velocity: ArduCopter reads a part ignored as the whole ignored, and stops.
    """
    mask = IGNORE_POSITION | IGNORE_YAW_RATE
    if setpoint.acceleration_ned_m_s2 is None:
        mask |= IGNORE_ACCELERATION
    return mask | (IGNORE_YAW if setpoint.yaw_rad is None else 0)


def _require_sendable(setpoint: Setpoint) -> None:
    for name, value in zip(Setpoint._fields, setpoint, strict=True):
        for number in value if isinstance(value, tuple) else () if value is None else (value,):
            if not abs(number) <= FLOAT32_MAX:
                raise ValueError(f"{name} = {value}: a setpoint must be finite, nothing was sent")


def boot_ms(now_s: float) -> int:
    """Our clock as MAVLink's time_boot_ms, which wraps at 2^32."""
    return int(now_s * 1e3) % 2**32


def setpoint(setpoint: Setpoint, *, now_s: float, system_id: int, component_id: int) -> Packed:
    """SET_POSITION_TARGET_LOCAL_NED in frame LOCAL_NED. Ignored fields are zero on the wire.

    Args:
        setpoint: NED, m/s and m/s².
        now_s: By our clock; becomes time_boot_ms.
        system_id: The vehicle's.
        component_id: Its autopilot's.

    Raises:
        ValueError: If a value is not finite (as a 32 bit float).
    """
    _require_sendable(setpoint)
    (vx, vy, vz), (ax, ay, az) = setpoint.velocity_ned_m_s, setpoint.acceleration_ned_m_s2 or (0.0, 0.0, 0.0)
    return "SET_POSITION_TARGET_LOCAL_NED", {
        "time_boot_ms": boot_ms(now_s),
        "target_system": system_id,
        "target_component": component_id,
        "coordinate_frame": MAV_FRAME_LOCAL_NED,
        "type_mask": setpoint_type_mask(setpoint),
        "x": 0.0,
        "y": 0.0,
        "z": 0.0,
        "vx": vx,
        "vy": vy,
        "vz": vz,
        "afx": ax,
        "afy": ay,
        "afz": az,
        "yaw": 0.0 if setpoint.yaw_rad is None else setpoint.yaw_rad,
        "yaw_rate": 0.0,
    }


def request(request: Request, *, attempt: int, system_id: int, component_id: int, autopilot: int = 0) -> Packed:
    """COMMAND_LONG, COMMAND_INT, PARAM_* or MISSION_*.

    Args:
        request: What is asked for.
        attempt: Counts from 0; becomes `confirmation`.
        system_id: The vehicle's.
        component_id: Its autopilot's.
        autopilot: MAV_AUTOPILOT, by which integers are carried in a parameter's float.

    Raises:
        ValueError: If a parameter is infinite, a coordinate does not fit, or a parameter's name is too long.
    """
    target = {"target_system": system_id, "target_component": component_id}
    if isinstance(request, ParameterRequest | ParameterSet):
        return _parameter(request, target, autopilot)
    if isinstance(request, FenceRequest):
        if request.sequence is None:
            return "MISSION_REQUEST_LIST", {**target, "mission_type": MAV_MISSION_TYPE_FENCE}
        return "MISSION_REQUEST_INT", {**target, "seq": request.sequence, "mission_type": MAV_MISSION_TYPE_FENCE}
    if isinstance(request, FenceReceived):
        return "MISSION_ACK", {**target, "type": 0, "mission_type": MAV_MISSION_TYPE_FENCE}
    if any(math.isinf(value) for value in request.params):
        raise ValueError(f"command {request.command}: infinite parameter in {request.params}")
    if request.frame is not None:
        return "COMMAND_INT", {**target, **_command_int(request, request.frame)}
    numbered = {f"param{index}": value for index, value in enumerate(request.params, start=1)}
    return "COMMAND_LONG", {**target, "command": request.command, "confirmation": attempt, **numbered}


def _parameter(request: ParameterRequest | ParameterSet, target: dict[str, Any], autopilot: int) -> Packed:
    if not 0 < len(request.name.encode()) <= 16:
        raise ValueError(f"parameter {request.name!r}: 1 to 16 bytes are allowed")
    if isinstance(request, ParameterRequest):
        return "PARAM_REQUEST_READ", {**target, "param_id": request.name, "param_index": -1}
    value = request.value
    fields = {"param_id": request.name, "param_type": request.param_type}
    if not math.isfinite(value):
        raise ValueError(f"parameter {request.name} = {value}: only finite values can be set")
    if is_bytewise(fields, autopilot=autopilot):
        if not (value.is_integer() and 0 <= value <= _MOST_BYTEWISE):
            raise ValueError(f"parameter {request.name} = {value:g}: it is an integer of 0 to {_MOST_BYTEWISE}")
        (value,) = struct.unpack("<f", struct.pack("<i", int(value)))
    return "PARAM_SET", {**target, **fields, "param_value": value}


def _command_int(command: Command, frame: int) -> dict[str, Any]:
    p1, p2, p3, p4, latitude_deg, longitude_deg, z = command.params
    return {
        "frame": frame,
        "command": command.command,
        "current": 0,
        "autocontinue": 0,
        "param1": p1,
        "param2": p2,
        "param3": p3,
        "param4": p4,
        "x": _e7(latitude_deg),
        "y": _e7(longitude_deg),
        "z": z,
    }


def _e7(angle_deg: float) -> int:
    if math.isnan(angle_deg):
        return INT32_MAX  # "not used" of MAVLink's COMMAND_INT
    if abs(angle_deg) > 180.0:
        raise ValueError(f"{angle_deg} is no latitude or longitude in degrees")
    return round(angle_deg * 1e7)


def _payload(layout: Layout, fields: Mapping[str, Any]) -> bytes:
    given = {**layout.extensions, **fields}
    for text in layout.texts:
        given[text] = given[text].encode()
    values = [given[name] for name in layout.names]
    if len(given) > len(values):
        raise TypeError(f"{sorted(given.keys() - set(layout.names))}: not fields of this message")
    if layout.counts is not None:
        values = [
            one
            for value, count in zip(values, layout.counts, strict=True)
            for one in (value if count > 1 else (value,))
        ]
    packed = layout.struct.pack(*values)
    return packed.rstrip(b"\0") or packed[:1]  # MAVLink 2 leaves out zeros at the end, but not the first byte


class Station:
    """One sender of frames: they are numbered and, with a key, signed; then what others say is believed only signed."""

    def __init__(
        self,
        system_id: int,
        component_id: int,
        *,
        signing_key: SigningKey | None = None,
        clock: Clock = lambda: 0.0,
        unix_s: float = 0.0,
    ) -> None:
        """Start at sequence number 0. `clock` and `unix_s`, the calendar's time now, are needed for signing only."""
        self._system_id, self._component_id, self._sequence = system_id, component_id, 0
        self._signatures = None if signing_key is None else Signatures(signing_key, unix_s)
        self._clock = clock
        self._unix_offset_s = unix_s - clock()

    def pack(self, name: str, fields: Mapping[str, Any]) -> bytes:
        """The next frame.

        Raises:
            KeyError, TypeError, struct.error: If the fields are not those of the message, or do not fit.
        """
        message_id = IDS[name]
        payload = _payload(LAYOUTS[message_id], fields)
        flags = 0 if self._signatures is None else SIGNED
        own = self._sequence, self._system_id, self._component_id
        header = _HEADER.pack(MAGIC_V2, len(payload), flags, 0, *own, message_id & 0xFFFF, message_id >> 16)
        self._sequence = (self._sequence + 1) % 256
        frame = header + payload + checksum(header[1:] + payload, CRC_EXTRA[message_id])
        if self._signatures is None:
            return frame
        return frame + self._signatures.sign(frame, ticks(self._unix_offset_s + self._clock()))

    def renumber(self, frame: Frame) -> bytes:
        """Another sender's frame of the same address, numbered as our next: who hears both counts none as lost."""
        data = bytearray(frame.data)
        data[4 if data[0] == MAGIC_V2 else 2] = self._sequence
        self._sequence = (self._sequence + 1) % 256
        data[-2:] = checksum(data[1:-2], CRC_EXTRA[frame.message_id])
        return bytes(data)

    def doubts(self, frame: Frame) -> str | None:
        """Why a frame is not believed: "unsigned", or "refused" for a wrong or an old signature; None if it is."""
        if self._signatures is None:
            return None
        if not frame.signed:
            return "unsigned"
        return None if self._signatures.believes(frame) else "refused"
