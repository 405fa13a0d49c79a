"""SET_ATTITUDE_TARGET: an attitude, or body rates, and a thrust, which go past PX4's position control."""

import math
from dataclasses import dataclass
from typing import Any, Final

from sitl_mock.dynamics import IGNORED, PX4_AIRFRAME, Kind, Setpoint
from sitl_mock.dynamics.values import GRAVITY_M_S2, quaternion_of, rotated
from sitl_mock.vehicle_state import VehicleState
from sitl_mock.world import Vector

_NO_ROLL_RATE, _NO_PITCH_RATE, _NO_YAW_RATE = 1, 2, 4  # ATTITUDE_TARGET_TYPEMASK
_NO_THROTTLE, _NO_ATTITUDE = 64, 128
_NO_RATES: Final = _NO_ROLL_RATE | _NO_PITCH_RATE
_INVALID: Final = "SET_ATTITUDE_TARGET invalid"

Quaternion = tuple[float, float, float, float]


@dataclass(slots=True)
class BodyRates:
    """Body rates in force: the attitude they lead to is integrated from the one at their first message.

    Attributes:
        rates_rad_s: Roll, pitch, yaw.
        thrust: Of full thrust.
        attitude: Attitude reached so far.
    """

    rates_rad_s: Vector
    thrust: float
    attitude: Quaternion

    def advance(self, dt_s: float) -> Setpoint:
        """The setpoint `dt_s` later."""
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


def read_attitude(state: VehicleState, message: Any, before: BodyRates | None) -> Setpoint | BodyRates | str:  # noqa: ANN401 - pymavlink has no types
    """Return the setpoint in a SET_ATTITUDE_TARGET, or why it is none.

    Args:
        state: Whose attitude body rates begin at.
        message: The message.
        before: Body rates in force so far.
    """
    mask = message.type_mask
    thrust = _thrust(message)
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
    rates = (message.body_roll_rate, message.body_pitch_rate, yaw_rate)
    if not all(map(math.isfinite, rates)):
        return _INVALID
    attitude = quaternion_of(*state.attitude[:3]) if before is None else before.attitude
    return BodyRates(rates, thrust, attitude)


def in_ned(vector: Vector, state: VehicleState) -> Vector:
    """Turn forward, right, down of the body into north, east, down."""
    return rotated(quaternion_of(*state.attitude[:3]), vector)


def _thrust(message: Any) -> float:  # noqa: ANN401 - as above
    return 0.0 if message.type_mask & _NO_THROTTLE else float(message.thrust)


def _pushed(attitude: Quaternion, thrust: float) -> Setpoint:
    """An attitude and a thrust in [0, 1] as the acceleration that they make in still air."""
    lift = min(max(thrust, 0.0), 1.0) * PX4_AIRFRAME.thrust_max_m_s2
    n, e, d = rotated(attitude, (0.0, 0.0, -lift))
    w, x, y, z = attitude
    yaw = math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return Setpoint(Kind.DIRECT, IGNORED, IGNORED, (n, e, d + GRAVITY_M_S2), yaw_rad=yaw)
