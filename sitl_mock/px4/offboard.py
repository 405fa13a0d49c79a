"""Setpoint messages as PX4 v1.17 treats them (measured, and read in `mavlink_receiver.cpp`).

A message with at least one finite axis is proof of life in every mode; it is flown only in OFFBOARD. If an axis is
uncontrolled, or only one of a horizontal pair is given, PX4 hovers and stays in OFFBOARD. The force bit (0x200) makes
PX4 refuse a message only if that message has an acceleration: older clients set the bit with velocities.

SET_ATTITUDE_TARGET (attitude or body rates, and thrust) bypasses the position control.
"""

import math
from dataclasses import dataclass
from typing import Any, Final

from sitl_mock.dynamics import IGNORED, PX4_AIRFRAME, Kind, Setpoint
from sitl_mock.dynamics.values import GRAVITY_M_S2, maker_of, quaternion_of, rotated
from sitl_mock.vector import Vector
from sitl_mock.vehicle.setpoints import (
    BODY_NED,
    FORCE,
    IGNORE_ACCELERATION,
    IGNORE_POSITION,
    IGNORE_VELOCITY,
    LOCAL_NED,
    Target,
    any_finite,
    read_global,
    read_local,
    turned,
)
from sitl_mock.vehicle.state import VehicleState

_STREAM: Final = Kind.STREAM
_ABOVE_TERRAIN: Final = 11
_GLOBAL_FRAMES: Final = frozenset({5, 6, _ABOVE_TERRAIN})
STAND: Final = Setpoint(Kind.BRAKE)
_UNSET: Final = STAND[6:]
_setpoint = maker_of(Setpoint)


def read_position_target(state: VehicleState, message: Any) -> Setpoint | str:  # noqa: ANN401 - pymavlink has no types
    """Return the setpoint in a message, or the text that refuses it."""
    if message.get_type() == "SET_POSITION_TARGET_GLOBAL_INT":
        name = "SET_POSITION_TARGET_GLOBAL_INT"
        # A relative height has the sign of home's height above the local frame's origin wrong: 12 m above a home that
        # is 4 m above the origin is flown as 8 m above the origin, not 16 m (measured).
        home_m = state.home_m
        if home_m is not None:
            home_m = home_m.level_with(-home_m[2])
        target = read_global(message, state.frame, home_m)
        # A position needs all its axes, and only with one does the frame matter.
        if target.type_mask & IGNORE_POSITION:
            return _judged(state, target._replace(position_m=IGNORED), name)
        if target.frame not in _GLOBAL_FRAMES:
            return f"{name} invalid coordinate frame {target.frame}"
        if target.frame == _ABOVE_TERRAIN:
            above_m = target.position_m.level_with(state.ground_m - message.alt)
            target = target._replace(position_m=above_m)
        return _judged(state, target, name)
    target = read_local(message)
    if target.frame not in {LOCAL_NED, BODY_NED}:
        return f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {target.frame} unsupported"
    return _judged(state, target, "SET_POSITION_TARGET_LOCAL_NED")


def read_trajectory(message: Any) -> Setpoint:  # noqa: ANN401 - a record
    """Return the setpoint in a TrajectorySetpoint; NaN marks free axes. What cannot be followed stops the vehicle."""
    position, velocity, acceleration = (
        _finite(Vector(axes)) for axes in (message.position, message.velocity, message.acceleration)
    )
    if not _followable(position, velocity, acceleration):
        return STAND
    yaw_rad = message.yaw if math.isfinite(message.yaw) else math.nan
    yaw_rate = message.yawspeed if math.isfinite(message.yawspeed) else math.nan
    return Setpoint(_STREAM, position, velocity, acceleration, yaw_rad, yaw_rate)


def _judged(state: VehicleState, target: Target, name: str) -> Setpoint | str:
    frame, mask, position, velocity, acceleration, yaw_rad, yaw_rate_rad_s = target
    alone = position is IGNORED and acceleration is IGNORED and frame != BODY_NED
    if alone and math.isfinite(velocity[0] + velocity[1] + velocity[2]):  # the usual case
        return _setpoint((_STREAM, IGNORED, velocity, IGNORED, yaw_rad, yaw_rate_rad_s, *_UNSET))
    if mask & FORCE and any_finite(acceleration):
        return f"{name} force not supported"
    if not (any_finite(velocity) or any_finite(position) or any_finite(acceleration)):
        return f"{name} invalid"
    if frame == BODY_NED:
        position = IGNORED
        velocity = turned(velocity, state.yaw_rad) if not mask & IGNORE_VELOCITY else IGNORED
        acceleration = in_ned(acceleration, state) if not mask & IGNORE_ACCELERATION else IGNORED
    if not _followable(position, velocity, acceleration):
        return STAND
    return Setpoint(
        _STREAM,
        _finite(position),
        _finite(velocity),
        _finite(acceleration),
        yaw_rad,
        yaw_rate_rad_s,
    )


def _finite(vector: Vector) -> Vector:
    n, e, d = vector
    if vector is IGNORED or not math.isinf(n + e + d):
        return vector
    return Vector(
        (
            n if math.isfinite(n) else math.nan,
            e if math.isfinite(e) else math.nan,
            d if math.isfinite(d) else math.nan,
        )
    )


def _followable(position: Vector, velocity: Vector, acceleration: Vector) -> bool:
    """True if every axis is controlled and horizontal axes come in pairs."""
    finite = math.isfinite
    if not (_paired(position) and _paired(velocity) and _paired(acceleration)):
        return False
    if finite(velocity[0] + velocity[2]):
        return True
    vectors = (position, velocity, acceleration)
    level = any(finite(vector[0]) for vector in vectors)
    vertical = any(finite(vector[2]) for vector in vectors)
    return level and vertical


def _paired(vector: Vector) -> bool:
    return math.isfinite(vector[0]) == math.isfinite(vector[1])


_NO_ROLL_RATE = 1
_NO_PITCH_RATE = 2
_NO_YAW_RATE = 4  # ATTITUDE_TARGET_TYPEMASK
_NO_THROTTLE = 64
_NO_ATTITUDE = 128
_NO_RATES: Final = _NO_ROLL_RATE | _NO_PITCH_RATE
_INVALID: Final = "SET_ATTITUDE_TARGET invalid"

Quaternion = tuple[float, float, float, float]


@dataclass(slots=True)
class BodyRates:
    """Body rates in force; the attitude is integrated from that at their first message.

    Attributes:
        rates_rad_s: Roll, pitch, yaw.
        thrust: Share of full thrust.
        attitude: Present integrated attitude.
    """

    rates_rad_s: Vector
    thrust: float
    attitude: Quaternion

    def advance(self, dt_s: float) -> Setpoint:
        """Integrate the rates over `dt_s` and return the setpoint."""
        w, x, y, z = self.attitude
        p, q, r = (0.5 * rate * dt_s for rate in self.rates_rad_s)
        turned = (
            w - x * p - y * q - z * r,
            x + w * p + y * r - z * q,
            y + w * q + z * p - x * r,
            z + w * r + x * q - y * p,
        )
        norm = math.sqrt(sum(part * part for part in turned))
        w, x, y, z = (part / norm for part in turned)
        self.attitude = (w, x, y, z)
        return _pushed(self.attitude, self.thrust)


def read_attitude(
    state: VehicleState,
    message: Any,  # noqa: ANN401 - pymavlink has no types
    before: BodyRates | None,
) -> Setpoint | BodyRates | str:
    """Return the setpoint in a SET_ATTITUDE_TARGET, or the text that refuses it.

    Args:
        state: The vehicle; its attitude is where new body rates begin.
        message: The message.
        before: Body rates in force until now.
    """
    mask = message.type_mask
    thrust = 0.0 if message.type_mask & _NO_THROTTLE else float(message.thrust)
    if not math.isfinite(thrust):
        return _INVALID
    if not mask & _NO_ATTITUDE:
        w, x, y, z = message.q
        norm = math.sqrt(w * w + x * x + y * y + z * z)
        if not (math.isfinite(norm) and norm > 1e-3):
            return _INVALID
        return _pushed((w / norm, x / norm, y / norm, z / norm), thrust)
    if mask & _NO_RATES:
        return _INVALID
    yaw_rate = 0.0 if mask & _NO_YAW_RATE else message.body_yaw_rate
    rates = Vector((message.body_roll_rate, message.body_pitch_rate, yaw_rate))
    if not all(map(math.isfinite, rates)):
        return _INVALID
    attitude = quaternion_of(*state.attitude[:3]) if before is None else before.attitude
    return BodyRates(rates, thrust, attitude)


def in_ned(vector: Vector, state: VehicleState) -> Vector:
    """Rotate a vector from body axes (forward, right, down) to NED."""
    return rotated(quaternion_of(*state.attitude[:3]), vector)


def _pushed(attitude: Quaternion, thrust: float) -> Setpoint:
    """Setpoint for an attitude and a thrust in [0, 1]: the acceleration they cause in still air."""
    lift = min(max(thrust, 0.0), 1.0) * PX4_AIRFRAME.thrust_max_m_s2
    n, e, d = rotated(attitude, Vector((0.0, 0.0, -lift)))
    w, x, y, z = attitude
    yaw = math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return Setpoint(Kind.DIRECT, IGNORED, IGNORED, Vector((n, e, d + GRAVITY_M_S2)), yaw_rad=yaw)
