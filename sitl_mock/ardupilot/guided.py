"""Setpoint messages in ArduPilot's GUIDED (measured on ArduCopter 4.5.7).

A field is ignored as a whole when any of its three mask bits is set. An invalid setpoint means "stop", without a text.

SET_ATTITUDE_TARGET gives lean and heading, with a climb rate or a thrust.
"""

import math
from collections.abc import Mapping
from typing import Any, Final

from sitl_mock.dynamics import IGNORED, ZERO, Kind, Setpoint
from sitl_mock.protocols import PlanItem
from sitl_mock.protocols.command import GLOBAL_FRAMES
from sitl_mock.vector import Vector
from sitl_mock.vehicle.setpoints import (
    BODY_NED,
    BODY_OFFSET_NED,
    FORCE,
    GLOBAL_RELATIVE,
    GLOBAL_TERRAIN,
    IGNORE_ACCELERATION,
    IGNORE_POSITION,
    IGNORE_VELOCITY,
    LOCAL_NED,
    LOCAL_OFFSET_NED,
    Target,
    read_global,
    read_local,
    turned,
)
from sitl_mock.vehicle.state import VehicleState

STOP: Final = Setpoint(Kind.STREAM, velocity_ned_m_s=ZERO)
LEVEL: Final = Setpoint(Kind.ATTITUDE)
_FASTEST_M_S: Final = 1000.0
_WAYPOINT: Final = 16
_BODY: Final = frozenset({BODY_NED, BODY_OFFSET_NED})
_FROM_HERE: Final = frozenset({LOCAL_OFFSET_NED, BODY_NED, BODY_OFFSET_NED})
_LOCAL: Final = frozenset({LOCAL_NED}) | _FROM_HERE


def read_position_target(state: VehicleState, message: Any) -> Setpoint | None:  # noqa: ANN401 - pymavlink has no types
    """Return the setpoint in a message, STOP if it is invalid, or None if ArduPilot ignores it."""
    kind = message.get_type()
    if kind == "SET_POSITION_TARGET_LOCAL_NED":
        target = read_local(message)
        return _setpoint_of(state, target) if target.frame in _LOCAL else None
    if kind == "SET_POSITION_TARGET_GLOBAL_INT":
        target = read_global(message, state.frame, state.home_m)
        return _setpoint_of(state, target) if target.frame in GLOBAL_FRAMES else None
    return None


def _setpoint_of(state: VehicleState, target: Target) -> Setpoint | None:
    mask = target.type_mask
    has_position = not mask & IGNORE_POSITION
    has_velocity = not mask & IGNORE_VELOCITY
    has_acceleration = not mask & IGNORE_ACCELERATION
    if mask & FORCE and has_acceleration:
        return None
    position = IGNORED
    if has_position:
        position = target.position_m
        if target.frame in _BODY:
            position = turned(position, state.yaw_rad)
        if target.frame in _FROM_HERE:
            position += state.position_m
    velocity = _axes(state, target, target.velocity_m_s, mask & IGNORE_VELOCITY)
    acceleration = _axes(state, target, target.acceleration_m_s2, mask & IGNORE_ACCELERATION)
    values: list[float] = []
    if not mask & IGNORE_POSITION:
        values += position
    if not mask & IGNORE_VELOCITY:
        values += velocity
    if not mask & IGNORE_ACCELERATION:
        values += acceleration
    lacks_terrain = has_position and target.frame in GLOBAL_TERRAIN
    if lacks_terrain or not values or not math.isfinite(sum(values)):
        return STOP
    if has_velocity and math.hypot(*velocity) > _FASTEST_M_S:
        return STOP
    if has_position and has_acceleration and not has_velocity:
        return STOP
    body_yaw_rad = state.yaw_rad if target.frame in _BODY else 0.0
    yaw_rad = _finite(target.yaw_rad) + body_yaw_rad
    yaw_rate_rad_s = _finite(target.yaw_rate_rad_s)
    if has_position and not has_velocity:
        return Setpoint(Kind.TRAVEL, position, yaw_rad=yaw_rad, yaw_rate_rad_s=yaw_rate_rad_s)
    return Setpoint(
        Kind.STREAM,
        position,
        velocity,
        acceleration,
        yaw_rad=yaw_rad,
        yaw_rate_rad_s=yaw_rate_rad_s,
    )


def item_setpoint(state: VehicleState, item: PlanItem) -> Setpoint | None:
    """Return the setpoint for a mission item with current 2, None if it is not a waypoint."""
    if item.command != _WAYPOINT:
        return None
    altitude = item.z
    if item.frame in GLOBAL_TERRAIN:
        return STOP
    if item.frame in GLOBAL_RELATIVE:
        altitude += state.frame.origin.alt_amsl_m - (
            state.home_m[2] if state.home_m is not None else 0.0
        )
    position_m = state.frame.to_local(item.latitude_deg, item.longitude_deg, altitude)
    return Setpoint(Kind.TRAVEL, position_m) if all(map(math.isfinite, position_m)) else None


def _finite(value: float) -> float:
    return value if math.isfinite(value) else math.nan


def _axes(state: VehicleState, target: Target, vector: Vector, ignored_bits: int) -> Vector:
    """Return a vector north, east and down; without values if bits of the mask ignore it."""
    if ignored_bits:
        return IGNORED
    if target.frame in _BODY:
        return turned(vector, state.yaw_rad)
    return vector


_NAN: Final = math.nan
_IGNORE_YAW_RATE = 4
_IGNORE_THRUST = 64
_IGNORE_ATTITUDE = 128
_THRUST_IS_THRUST: Final = 8
_UNIT: Final = 1e-3


def read_attitude(parameters: Mapping[str, float], message: Any) -> Setpoint | None:  # noqa: ANN401 - pymavlink
    """Return the setpoint in a SET_ATTITUDE_TARGET, or None if ArduCopter ignores it.

    The thrust field is a climb rate (0.5 is zero) unless GUID_OPTIONS has bit 3. Without an attitude the copter stays
    level and turns at the yaw rate; body roll and pitch rates alone have no effect.
    """
    mask = message.type_mask
    if mask & _IGNORE_THRUST or not math.isfinite(message.thrust):
        return None
    lean = (0.0, 0.0)
    yaw_rad = _NAN
    if not mask & _IGNORE_ATTITUDE:
        w, x, y, z = message.q
        if not abs(math.hypot(w, x, y, z) - 1.0) < _UNIT:
            return None
        # The tilt of the thrust axis towards north and east.
        north = -2.0 * (x * z + w * y)
        east = -2.0 * (y * z - w * x)
        level = math.hypot(north, east)
        angle = math.atan2(level, 1.0 - 2.0 * (x * x + y * y))
        if level > 1e-9:
            lean = (north * angle / level, east * angle / level)
        yaw_rad = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    rate = 0.0 if mask & _IGNORE_YAW_RATE else message.body_yaw_rate
    if not math.isfinite(rate):
        return None
    # By thrust or, with a thrust of NaN, by climb rate.
    share = min(max(message.thrust, 0.0), 1.0)
    if int(parameters["GUID_OPTIONS"]) & _THRUST_IS_THRUST:
        climb_m_s = 0.0
        thrust = share
    else:
        climb_share = 2.0 * (share - 0.5)
        fastest = parameters["WPNAV_SPEED_UP" if climb_share > 0.0 else "WPNAV_SPEED_DN"] * 0.01
        climb_m_s = climb_share * fastest
        thrust = _NAN
    return Setpoint(
        Kind.ATTITUDE,
        velocity_ned_m_s=Vector((_NAN, _NAN, -climb_m_s)),
        yaw_rad=yaw_rad if rate == 0.0 else _NAN,
        yaw_rate_rad_s=rate if rate != 0.0 or math.isnan(yaw_rad) else _NAN,
        lean_ne_rad=lean,
        thrust=thrust,
    )
