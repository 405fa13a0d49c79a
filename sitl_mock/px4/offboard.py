"""Which setpoints PX4 takes, as measured on v1.17 and read in `mavlink_receiver.cpp`.

A message with at least one finite axis is proof of life, in every mode. It is followed only in OFFBOARD. An axis that
nothing controls, or half of a horizontal pair, makes the controller stand still while OFFBOARD is kept. The bit for a
force (0x200) refuses a message only if it gives an acceleration: older clients set it beside velocities.
"""

import math
from typing import Any, Final

from sitl_mock.dynamics import IGNORED, Kind, Setpoint
from sitl_mock.px4.attitude import in_ned
from sitl_mock.setpoints import (
    BODY_NED,
    FORCE,
    GLOBAL_FRAMES,
    IGNORE_ACCELERATION,
    IGNORE_VELOCITY,
    LOCAL_NED,
    Target,
    any_finite,
    read_global,
    read_local,
    turned,
)
from sitl_mock.vehicle_state import VehicleState
from sitl_mock.world import Vector

STAND: Final = Setpoint(Kind.BRAKE)


def read(state: VehicleState, message: Any) -> Setpoint | str:  # noqa: ANN401 - pymavlink has no types
    """Return the setpoint in a message, or why it is none."""
    if message.get_type() == "SET_POSITION_TARGET_GLOBAL_INT":
        target = read_global(message, state.frame, state.home_m)
        return _judged(state, target, "SET_POSITION_TARGET_GLOBAL_INT", target.frame in GLOBAL_FRAMES)
    target = read_local(message)
    return _judged(state, target, "SET_POSITION_TARGET_LOCAL_NED", target.frame in {LOCAL_NED, BODY_NED})


def _judged(state: VehicleState, target: Target, name: str, frame_known: bool) -> Setpoint | str:
    if not frame_known:
        return f"{name} coordinate frame {target.frame} unsupported"
    position, velocity, acceleration = target.position_m, target.velocity_m_s, target.acceleration_m_s2
    if target.type_mask & FORCE and any_finite(acceleration):
        return f"{name} force not supported"
    if not (any_finite(velocity) or any_finite(position) or any_finite(acceleration)):
        return f"{name} invalid"
    if target.frame == BODY_NED:
        position = IGNORED
        velocity = turned(velocity, state.yaw_rad) if not target.type_mask & IGNORE_VELOCITY else IGNORED
        acceleration = in_ned(acceleration, state) if not target.type_mask & IGNORE_ACCELERATION else IGNORED
    if not _followable(position, velocity, acceleration):
        return STAND
    return Setpoint(
        Kind.STREAM,
        _finite(position),
        _finite(velocity),
        _finite(acceleration),
        yaw_rad=target.yaw_rad,
        yaw_rate_rad_s=target.yaw_rate_rad_s,
    )


def _finite(vector: Vector) -> Vector:
    n, e, d = vector
    if not math.isinf(n + e + d):
        return vector
    return (
        n if math.isfinite(n) else math.nan,
        e if math.isfinite(e) else math.nan,
        d if math.isfinite(d) else math.nan,
    )


def _followable(position: Vector, velocity: Vector, acceleration: Vector) -> bool:
    """Whether every axis is controlled by something and the horizontal axes come in pairs."""
    finite = math.isfinite
    if not (_paired(position) and _paired(velocity) and _paired(acceleration)):
        return False
    if math.isfinite(velocity[0] + velocity[2]):
        return True
    level = finite(position[0]) or finite(velocity[0]) or finite(acceleration[0])
    return level and (finite(position[2]) or finite(velocity[2]) or finite(acceleration[2]))


def _paired(vector: Vector) -> bool:
    return math.isfinite(vector[0]) == math.isfinite(vector[1])
