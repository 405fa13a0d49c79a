"""Converts MAVLink messages of pymavlink to typed values of `guidance.messages`, and setpoints and requests back."""

import math
import struct
from collections.abc import Callable, Mapping
from typing import Final

from pymavlink.dialects.v20 import common as mavlink

from guidance import messages
from guidance.frames import Ned
from guidance.links.mavlink.frames import MAGIC_V1, Fields, Frame
from guidance.vehicle import is_plausible

INT32_MAX: Final = 2**31 - 1
FLOAT32_MAX: Final = 3.4028234663852886e38
_MAX_BYTEWISE: Final = 0x7F7FFFFF
"""Largest integer whose bytes form a finite float. Those of a negative integer form a NaN, which JSON cannot carry."""

# POSITION_TARGET_TYPEMASK: a set bit tells the autopilot to ignore that field.
_VELOCITY_ALONE: Final = 0b1101_1100_0111
_ACCELERATION: Final = 0b0001_1100_0000
_YAW: Final = 0b0100_0000_0000

VALID_MOTION: Final = 4 | 8 | 128
"""Flags of ADSB_VEHICLE: heading, velocity and vertical velocity are valid."""

ADSB_ERROR_M: Final = 30.0
"""Largest error of an aircraft's reported place, and of its pressure altitude."""

_UNKNOWN_U8 = 0xFF
_UNKNOWN_U16 = 0xFFFF
_ZERO: Final = (0.0, 0.0, 0.0)


def degrees(latitude_e7: int, longitude_e7: int) -> tuple[float, float]:
    """Convert units of 1e-7 degrees to WGS-84 degrees.

    Raises:
        ValueError: If the position is unknown (INT32_MAX, or 0/0 before the first fix) or not on Earth.
    """
    latitude = latitude_e7 / 1e7
    longitude = longitude_e7 / 1e7
    if latitude_e7 == 0 and longitude_e7 == 0:
        raise ValueError("latitude and longitude are both 0: no fix yet")
    if abs(latitude) > 90.0 or abs(longitude) > 180.0:
        raise ValueError(f"latitude {latitude}, longitude {longitude}: not on Earth")
    return latitude, longitude


def _system_status(m: Fields, received_s: float) -> messages.Message:
    # -1: not sent
    remaining = m.battery_remaining / 100.0 if 0 <= m.battery_remaining <= 100 else math.nan
    present = m.onboard_control_sensors_present
    health = m.onboard_control_sensors_health
    voltage_v = math.nan if m.voltage_battery in {0, _UNKNOWN_U16} else m.voltage_battery / 1e3
    return messages.SystemStatus(received_s, present, health, remaining, voltage_v)


def velocity_in_cm_s(m: Fields) -> Ned:
    """Return the velocity of a GLOBAL_POSITION_INT: north, east, down in m/s."""
    return Ned((m.vx / 1e2, m.vy / 1e2, m.vz / 1e2))


def _fence_item(m: Fields, received_s: float) -> messages.Message:
    if not math.isfinite(m.param1):
        raise ValueError(f"param1 = {m.param1}: not a number of corners, not a radius")
    return messages.FenceItem(received_s, m.seq, m.command, m.param1, *degrees(m.x, m.y))


def _autopilot_version(m: Fields, received_s: float) -> messages.Message:
    """The flight software's number has one byte each for major, minor and patch, and one for the kind of release."""
    major, minor, patch, _ = m.flight_sw_version.to_bytes(4)
    return messages.AutopilotVersion(received_s, major, minor, patch)


def velocity_over_ground(course_cdeg: float, speed_cm_s: float, climb_cm_s: float) -> Ned:
    """Return north, east, down in m/s from the course (1/100 degree clockwise from north), ground speed and climb."""
    course_rad = math.radians(course_cdeg / 100.0)
    speed_m_s = speed_cm_s / 100.0
    north_m_s = speed_m_s * math.cos(course_rad)
    east_m_s = speed_m_s * math.sin(course_rad)
    return Ned((north_m_s, east_m_s, -climb_cm_s / 100.0))


def _adsb_vehicle(m: Fields, received_s: float) -> messages.Message:
    """An ellipsoidal altitude counts as unknown: the undulation is not known here."""
    if not m.flags & mavlink.ADSB_FLAGS_VALID_COORDS:
        raise ValueError("an aircraft without a place")
    known = (
        m.flags & mavlink.ADSB_FLAGS_VALID_ALTITUDE
        and m.altitude_type != mavlink.ADSB_ALTITUDE_TYPE_GEOMETRIC
    )
    moves = m.flags & VALID_MOTION == VALID_MOTION
    return messages.Aircraft(
        received_s,
        f"ICAO {m.ICAO_address:06X}",
        *degrees(m.lat, m.lon),
        m.altitude / 1e3 if known else math.nan,
        velocity_over_ground(m.heading, m.hor_velocity, m.ver_velocity)
        if moves
        else messages.UNKNOWN_VELOCITY,
        float(m.tslc),
        ADSB_ERROR_M,
    )


def other_aircraft(frame: Frame, received_s: float) -> messages.Aircraft:
    """Convert a GLOBAL_POSITION_INT of another system.

    Raises:
        ValueError: If its place is unknown or implausible.
    """
    m = frame.fields
    place = *degrees(m.lat, m.lon), m.alt / 1e3
    value = messages.Aircraft(
        received_s, f"system {frame.system_id}", *place, velocity_in_cm_s(m), 0.0, 0.0
    )
    if not is_plausible(value):
        raise ValueError(f"{value}: implausible")
    return value


DECODERS: Final[Mapping[str, Callable[[Fields, float], messages.Message]]] = {
    "HEARTBEAT": lambda m, at_s: messages.Heartbeat(
        at_s,
        m.custom_mode,
        bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
        m.system_status,
        m.autopilot,
        m.type,
    ),
    "SYS_STATUS": _system_status,
    "GPS_RAW_INT": lambda m, at_s: messages.GpsFix(
        at_s, m.fix_type, None if m.satellites_visible == _UNKNOWN_U8 else m.satellites_visible
    ),
    "ATTITUDE": lambda m, at_s: messages.Attitude(at_s, m.time_boot_ms / 1e3, m.yaw),
    "LOCAL_POSITION_NED": lambda m, at_s: messages.LocalPosition(
        at_s, m.time_boot_ms / 1e3, Ned((m.x, m.y, m.z)), Ned((m.vx, m.vy, m.vz))
    ),
    "GLOBAL_POSITION_INT": lambda m, at_s: messages.GlobalPosition(
        at_s,
        m.time_boot_ms / 1e3,
        *degrees(m.lat, m.lon),
        m.alt / 1e3,
        m.relative_alt / 1e3,
        velocity_in_cm_s(m),
    ),
    "GPS_GLOBAL_ORIGIN": lambda m, at_s: messages.Origin(
        at_s, *degrees(m.latitude, m.longitude), m.altitude / 1e3
    ),
    "COMMAND_ACK": lambda m, at_s: messages.CommandAck(at_s, m.command, m.result),
    "POSITION_TARGET_LOCAL_NED": lambda m, at_s: messages.PositionTarget(
        at_s, m.time_boot_ms / 1e3, m.type_mask, Ned((m.vx, m.vy, m.vz))
    ),
    "HOME_POSITION": lambda m, at_s: messages.Home(
        at_s, *degrees(m.latitude, m.longitude), m.altitude / 1e3, Ned((m.x, m.y, m.z))
    ),
    "EXTENDED_SYS_STATE": lambda m, at_s: messages.LandedState(at_s, m.landed_state),
    "ODOMETRY": lambda m, at_s: messages.Odometry(at_s, m.reset_counter),
    "ESTIMATOR_STATUS": lambda m, at_s: messages.EstimatorStatus(at_s, m.pos_vert_accuracy),
    "AUTOPILOT_VERSION": _autopilot_version,
    "MISSION_COUNT": lambda m, at_s: messages.FenceCount(at_s, m.count),
    "MISSION_ITEM_INT": _fence_item,
    "MISSION_ACK": lambda m, at_s: messages.FenceRefused(at_s, m.type),
    "ADSB_VEHICLE": _adsb_vehicle,
}
"""Messages that can be converted alone; STATUSTEXT, TIMESYNC and PARAM_VALUE need more."""


def decode(
    frame: Frame, fields: Fields, received_s: float, autopilot: int | None = None
) -> messages.Message:
    """Convert one message of an autopilot, by its MAV_AUTOPILOT, to a typed value.

    Raises:
        KeyError: If the message is neither PARAM_VALUE nor in `DECODERS`.
        ValueError: If a value is unknown, or implausible by `guidance.vehicle.is_plausible`.
    """
    name = frame.name
    if name.startswith("MISSION_") and fields.mission_type != mavlink.MAV_MISSION_TYPE_FENCE:
        fence = mavlink.MAV_MISSION_TYPE_FENCE
        raise ValueError(f"mission_type {fields.mission_type}: only the fence ({fence}) is read")
    value: messages.Message
    if name == "PARAM_VALUE":
        # PX4 carries integers as bytes in the float, other autopilots as a number.
        number = fields.param_value
        kind = fields.param_type
        if is_bytewise(kind, autopilot=autopilot):
            # The float would not do: the bytes of a negative integer are a NaN, which loses bits.
            data = frame.data
            start = 6 if data[0] == MAGIC_V1 else 10
            (number,) = struct.unpack("<i", data[start : start + min(4, data[1])].ljust(4, b"\0"))
        value = messages.Parameter(received_s, fields.param_id, float(number), kind)
    else:
        value = DECODERS[name](fields, received_s)
    if not is_plausible(value):
        raise ValueError(f"{value}: implausible")
    return value


def is_bytewise(param_type: int, *, autopilot: int | None) -> bool:
    """Return whether a parameter's float carries the bytes of an integer (PX4: MAV_PARAM_TYPE_INT32 only)."""
    return (autopilot, param_type) == (mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_PARAM_TYPE_INT32)


def setpoint(setpoint: messages.Setpoint, *, now_s: float, to: tuple[int, int]) -> Fields:
    """Return a SET_POSITION_TARGET_LOCAL_NED in frame LOCAL_NED. Ignored fields are zero.

    Its type mask is 3527 for velocity alone, 2503 with yaw, 3079 with acceleration and 2055 with both. PX4 and
    ArduCopter accept all four. No height is sent beside a velocity: ArduCopter then ignores the whole and stops.

    Args:
        setpoint: NED, m/s and m/s².
        now_s: Our clock; becomes time_boot_ms, which wraps at 2^32.
        to: System id and component id of the vehicle's autopilot.

    Raises:
        ValueError: If a value is not finite as a 32 bit float.
    """
    velocity, acceleration, yaw_rad = setpoint
    fed = _ZERO if acceleration is None else acceleration
    numbers = (*velocity, *fed, yaw_rad or 0.0)
    if not math.hypot(*numbers) <= FLOAT32_MAX:
        raise ValueError(f"{setpoint}: a setpoint must be finite; it was not sent")
    mask = (
        _VELOCITY_ALONE
        - (0 if acceleration is None else _ACCELERATION)
        - (0 if yaw_rad is None else _YAW)
    )
    target = int(now_s * 1e3) % 2**32, *to, mavlink.MAV_FRAME_LOCAL_NED, mask
    return mavlink.MAVLink_set_position_target_local_ned_message(*target, *_ZERO, *numbers, 0.0)


def request(
    request: messages.Request, *, attempt: int, to: tuple[int, int], autopilot: int | None = None
) -> Fields:
    """Return a COMMAND_LONG, COMMAND_INT, PARAM_* or MISSION_* message.

    Args:
        request: The request.
        attempt: Counts from 0; becomes `confirmation`.
        to: System id and component id of the vehicle's autopilot.
        autopilot: MAV_AUTOPILOT; determines how the float of a parameter carries an integer.

    Raises:
        ValueError: If a parameter is infinite, a coordinate does not fit, or a parameter's name is too long.
    """
    match request:
        case messages.ParameterRequest():
            return mavlink.MAVLink_param_request_read_message(
                *to, _parameter_name(request.name), -1
            )
        case messages.ParameterSet():
            name = request.name
            value = request.value
            if not math.isfinite(value):
                raise ValueError(f"parameter {name} = {value}: only finite values can be set")
            if is_bytewise(request.param_type, autopilot=autopilot):
                if not (value.is_integer() and 0 <= value <= _MAX_BYTEWISE):
                    raise ValueError(
                        f"parameter {name} = {value:g}: it must be an integer from 0 to {_MAX_BYTEWISE}"
                    )
                value = float(struct.unpack("<f", struct.pack("<i", int(value)))[0])
            return mavlink.MAVLink_param_set_message(
                *to, _parameter_name(request.name), value, request.param_type
            )
        case messages.FenceRequest(None):
            return mavlink.MAVLink_mission_request_list_message(*to, mavlink.MAV_MISSION_TYPE_FENCE)
        case messages.FenceRequest(int(sequence)):
            return mavlink.MAVLink_mission_request_int_message(
                *to, sequence, mavlink.MAV_MISSION_TYPE_FENCE
            )
        case messages.FenceReceived():
            return mavlink.MAVLink_mission_ack_message(*to, 0, mavlink.MAV_MISSION_TYPE_FENCE)
        case messages.Command():
            return _command(request, to, attempt)


def _command(request: messages.Command, to: tuple[int, int], attempt: int) -> Fields:
    if any(math.isinf(value) for value in request.params):
        raise ValueError(
            f"command {request.command}: params = {request.params}: infinite values are not allowed"
        )
    if request.frame is None:
        return mavlink.MAVLink_command_long_message(*to, request.command, attempt, *request.params)
    *numbers, latitude_deg, longitude_deg, z = request.params
    place = _e7(latitude_deg), _e7(longitude_deg), z
    return mavlink.MAVLink_command_int_message(
        *to, request.frame, request.command, 0, 0, *numbers, *place
    )


def _parameter_name(name: str) -> bytes:
    encoded = name.encode()
    if not 0 < len(encoded) <= 16:
        raise ValueError(f"parameter {name!r}: a name has 1 to 16 bytes")
    return encoded


def _e7(angle_deg: float) -> int:
    if math.isnan(angle_deg):
        return INT32_MAX  # COMMAND_INT's "not used"
    if abs(angle_deg) > 180.0:
        raise ValueError(f"{angle_deg}: a latitude or longitude in degrees is -180 to 180")
    return round(angle_deg * 1e7)
