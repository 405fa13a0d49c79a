"""Read SET_POSITION_TARGET_LOCAL_NED and _GLOBAL_INT as setpoints in the local frame; ignored axes are NaN.

Each flavour decides which frames it accepts and which masks mean "stop".
"""

import math
from typing import Any, Final, NamedTuple

from sitl_mock.dynamics import IGNORED
from sitl_mock.dynamics.values import maker_of
from sitl_mock.vector import Vector
from sitl_mock.world import LocalFrame

LOCAL_NED: Final = 1
LOCAL_OFFSET_NED: Final = 7
BODY_NED: Final = 8
BODY_OFFSET_NED: Final = 9
GLOBAL_AMSL: Final = frozenset({0, 5})
GLOBAL_RELATIVE: Final = frozenset({3, 6})
GLOBAL_TERRAIN: Final = frozenset({10, 11})

IGNORE_POSITION: Final = 0x007
IGNORE_VELOCITY: Final = 0x038
IGNORE_ACCELERATION: Final = 0x1C0
FORCE: Final = 0x200
IGNORE_YAW: Final = 0x400
IGNORE_YAW_RATE: Final = 0x800


class Target(NamedTuple):
    """A received setpoint in the axes of its frame; ignored values are NaN."""

    frame: int
    type_mask: int
    position_m: Vector
    velocity_m_s: Vector
    acceleration_m_s2: Vector
    yaw_rad: float
    yaw_rate_rad_s: float


_target = maker_of(Target)


def _kept(values: Vector, mask: int) -> Vector:
    """Replace the axes ignored by the lowest three bits by NaN."""
    bits = mask & 7
    if not bits:
        return values
    if bits == 7:
        return IGNORED
    x, y, z = values
    return Vector(
        (
            math.nan if bits & 1 else x,
            math.nan if bits & 2 else y,
            math.nan if bits & 4 else z,
        )
    )


def read_local(message: Any) -> Target:  # noqa: ANN401 - pymavlink has no types
    """Read a SET_POSITION_TARGET_LOCAL_NED."""
    if message.type_mask & IGNORE_POSITION == IGNORE_POSITION:
        return _read(message, IGNORED)
    return _read(message, Vector((message.x, message.y, message.z)))


def read_global(message: Any, frame: LocalFrame, home_m: Vector | None) -> Target:  # noqa: ANN401 - as above
    """Read a SET_POSITION_TARGET_GLOBAL_INT; relative heights count from home."""
    alt_m = message.alt
    if message.coordinate_frame in GLOBAL_RELATIVE:
        alt_m += frame.origin.alt_amsl_m - (home_m[2] if home_m is not None else 0.0)
    return _read(message, frame.to_local(message.lat_int * 1e-7, message.lon_int * 1e-7, alt_m))


def _read(message: Any, position_m: Vector) -> Target:  # noqa: ANN401 - as above
    mask = message.type_mask
    return _target(
        (
            message.coordinate_frame,
            mask,
            IGNORED if mask & IGNORE_POSITION == IGNORE_POSITION else _kept(position_m, mask),
            _kept(Vector((message.vx, message.vy, message.vz)), mask >> 3),
            IGNORED
            if mask & IGNORE_ACCELERATION == IGNORE_ACCELERATION
            else _kept(Vector((message.afx, message.afy, message.afz)), mask >> 6),
            math.nan if mask & IGNORE_YAW else message.yaw,
            math.nan if mask & IGNORE_YAW_RATE else message.yaw_rate,
        )
    )


def turned(vector: Vector, yaw_rad: float) -> Vector:
    """Rotate forward, right, down into north, east, down by the heading."""
    forward, right, down = vector
    cosine = math.cos(yaw_rad)
    sine = math.sin(yaw_rad)
    return Vector((forward * cosine - right * sine, forward * sine + right * cosine, down))


def any_finite(vector: Vector) -> bool:
    """True if a component is finite."""
    return any(math.isfinite(value) for value in vector)
