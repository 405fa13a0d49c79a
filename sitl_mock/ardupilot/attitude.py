"""SET_ATTITUDE_TARGET to a setpoint (ArduCopter ``GCS_Mavlink.cpp``): lean and heading, and a climb or a thrust."""

import math
from collections.abc import Mapping
from typing import Any, Final

from sitl_mock.dynamics import Kind, Setpoint

_NAN: Final = math.nan
_IGNORE_YAW_RATE, _IGNORE_THRUST, _IGNORE_ATTITUDE = 4, 64, 128
_THRUST_IS_THRUST: Final = 8
_UNIT: Final = 1e-3


def read_attitude(parameters: Mapping[str, float], message: Any) -> Setpoint | None:  # noqa: ANN401 - pymavlink
    """Return the setpoint in a SET_ATTITUDE_TARGET, or None where ArduCopter ignores it.

    The thrust field is a climb rate about 0.5 unless GUID_OPTIONS has bit 3. Without an attitude the copter stays level
    and turns at the yaw rate; body roll and pitch rates alone are not flown.
    """
    mask = message.type_mask
    if mask & _IGNORE_THRUST or not math.isfinite(message.thrust):
        return None
    lean, yaw_rad = (0.0, 0.0), _NAN
    if not mask & _IGNORE_ATTITUDE:
        w, x, y, z = message.q
        if not abs(math.hypot(w, x, y, z) - 1.0) < _UNIT:
            return None
        lean = _lean(w, x, y, z)
        yaw_rad = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    rate = 0.0 if mask & _IGNORE_YAW_RATE else message.body_yaw_rate
    if not math.isfinite(rate):
        return None
    climb_m_s, thrust = _vertical(parameters, message.thrust)
    return Setpoint(
        Kind.ATTITUDE,
        velocity_ned_m_s=(_NAN, _NAN, -climb_m_s),
        yaw_rad=yaw_rad if rate == 0.0 else _NAN,
        yaw_rate_rad_s=rate if rate != 0.0 or math.isnan(yaw_rad) else _NAN,
        lean_ne_rad=lean,
        thrust=thrust,
    )


def _lean(w: float, x: float, y: float, z: float) -> tuple[float, float]:
    """Tilt of the thrust axis: the body's up, seen in north and east, as an angle."""
    north, east = -2.0 * (x * z + w * y), -2.0 * (y * z - w * x)
    up = 1.0 - 2.0 * (x * x + y * y)
    level = math.hypot(north, east)
    angle = math.atan2(level, up)
    return (north * angle / level, east * angle / level) if level > 1e-9 else (0.0, 0.0)


def _vertical(parameters: Mapping[str, float], thrust: float) -> tuple[float, float]:
    """Climb rate and thrust; NaN thrust where the climb counts."""
    if int(parameters["GUID_OPTIONS"]) & _THRUST_IS_THRUST:
        return 0.0, min(max(thrust, 0.0), 1.0)
    share = 2.0 * (min(max(thrust, 0.0), 1.0) - 0.5)
    fastest = parameters["WPNAV_SPEED_UP" if share > 0.0 else "WPNAV_SPEED_DN"] * 0.01
    return share * fastest, _NAN
