"""Inputs and outputs of a dynamics step: immutable values in NED and SI units."""

import math
from collections.abc import Callable
from enum import IntEnum
from functools import partial
from typing import Any, Final, NamedTuple, TypeVar

from sitl_mock.vector import UNSET, ZERO, Vector

IGNORED: Final = UNSET
"""NaN marks an ignored axis of a setpoint, as on the wire."""

GRAVITY_M_S2 = 9.80665


class Kind(IntEnum):
    """Control mode of the motors."""

    STOPPED = 0
    """Disarmed: zero thrust (a vehicle in the air falls)."""
    IDLING = 1
    """Armed on the ground: motors turn without lift. Spool-up time starts here."""
    STREAM = 2
    """A streamed setpoint in OFFBOARD or GUIDED; PX4 truncates it, ArduCopter shapes it."""
    TRAVEL = 3
    """The autopilot's own smooth motion (take-off, mission, return, land): see `Setpoint`."""
    BRAKE = 4
    """Stop as the flavour does and hold that position (PX4 Hold, ArduCopter BRAKE)."""
    ATTITUDE = 6
    """Given lean, with a given thrust or, without one, a down velocity (ArduPilot)."""
    TRACK = 7
    """A planned motion, followed exactly (ArduPilot's AUTO)."""
    DIRECT = 5
    """Attitude and thrust, given as the acceleration they cause in still air; bypasses position control (PX4)."""


class Setpoint(NamedTuple):
    """A command to the vehicle; NaN marks ignored axes.

    `TRAVEL` moves to the given axes of `position_ned_m` at no more than `speed_m_s` (horizontal), `climb_m_s` and
    `sink_m_s` (NaN: the flavour's defaults). An axis without a position follows `velocity_ned_m_s` (0 if ignored too).
    Landing is a north and east position with a down velocity.
    """

    kind: Kind
    position_ned_m: Vector = IGNORED
    velocity_ned_m_s: Vector = IGNORED
    acceleration_ned_m_s2: Vector = IGNORED
    yaw_rad: float = math.nan
    yaw_rate_rad_s: float = math.nan
    speed_m_s: float = math.nan
    climb_m_s: float = math.nan
    sink_m_s: float = math.nan
    lean_ne_rad: tuple[float, float] = (0.0, 0.0)
    """`ATTITUDE`: tilt of the thrust axis towards north and east, as in `Body`."""
    thrust: float = math.nan
    """`ATTITUDE`: share of full throttle in [0, 1], NaN if not given."""


class Surroundings(NamedTuple):
    """Effects on the vehicle and its estimator during a step.

    The estimator errors affect both the control loop and the telemetry: estimate = truth + error.
    """

    wind_ned_m_s: Vector = ZERO
    position_error_ned_m: Vector = ZERO
    velocity_error_ned_m_s: Vector = ZERO
    ground_down_m: float = 0.0
    thrust_share: float = 1.0
    """Produced over demanded thrust."""


CALM = Surroundings()


class Body(NamedTuple):
    """The true motion of the vehicle.

    `lean_ned_rad` is the tilt of the thrust axis as a vector (north, east) whose length is the angle from the vertical:
    leaning north means accelerating north.
    """

    position_ned_m: Vector
    velocity_ned_m_s: Vector
    acceleration_ned_m_s2: Vector
    lean_n_rad: float
    lean_e_rad: float
    lean_rate_n_rad_s: float
    lean_rate_e_rad_s: float
    yaw_rad: float
    yaw_rate_rad_s: float
    thrust_m_s2: float
    """Specific thrust along the body's axis, not negative."""
    on_ground: bool


class Estimate(NamedTuple):
    """The autopilot's estimate, as reported in LOCAL_POSITION_NED."""

    position_ned_m: Vector
    velocity_ned_m_s: Vector


class Motion(NamedTuple):
    """A vehicle between two steps: its body and its controller's state (opaque)."""

    body: Body
    memory: object


class Demand(NamedTuple):
    """A controller's demand on the airframe."""

    lean_n_rad: float
    lean_e_rad: float
    thrust_m_s2: float
    yaw_rate_rad_s: float


class Euler(NamedTuple):
    """Attitude as ATTITUDE reports it."""

    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    roll_rate_rad_s: float
    pitch_rate_rad_s: float
    yaw_rate_rad_s: float


ValueT = TypeVar("ValueT", bound=tuple[Any, ...])


def maker_of(kind: type[ValueT]) -> Callable[[tuple[Any, ...]], ValueT]:
    """Return a function that makes a named tuple from an iterable of its values, unchecked and three times as fast.

    For values that are made at every step; elsewhere call the type with field names.
    """
    return partial(tuple.__new__, kind)


def within(value: float, least: float, most: float) -> float:
    """Clip a value to a range; NaN stays NaN."""
    return least if value < least else most if value > most else value


def wrap_rad(angle_rad: float) -> float:
    """The same angle in [-pi, pi]."""
    return math.remainder(angle_rad, math.tau)


def lean_per_acceleration(lean_tan: float) -> float:
    """Lean (rad) per horizontal acceleration (m/s²) at a lean whose tangent is the acceleration over gravity."""
    if lean_tan <= 1e-9:
        return 1.0 / GRAVITY_M_S2
    return math.atan(lean_tan) / (lean_tan * GRAVITY_M_S2)


_euler = maker_of(Euler)


def attitude_of(body: Body) -> Euler:
    """Roll, pitch, yaw (rad, aerospace order) and their rates from the lean vector and the heading.

    The rates are those of the lean vector seen along the body's axes: exact at small tilt, within cos(tilt) otherwise.
    """
    _, _, _, lean_n, lean_e, rate_n, rate_e, yaw_rad, yaw_rate, _, _ = body
    lean_rad = math.hypot(lean_n, lean_e)
    scale = math.sin(lean_rad) / lean_rad if lean_rad > 1e-9 else 1.0
    cos_yaw = math.cos(yaw_rad)
    sin_yaw = math.sin(yaw_rad)
    forward = scale * (lean_n * cos_yaw + lean_e * sin_yaw)
    right = scale * (lean_e * cos_yaw - lean_n * sin_yaw)
    up = math.cos(lean_rad)
    return _euler(
        (
            math.asin(within(right, -1.0, 1.0)),
            math.atan2(-forward, up),
            yaw_rad,
            rate_e * cos_yaw - rate_n * sin_yaw,
            -(rate_n * cos_yaw + rate_e * sin_yaw),
            yaw_rate,
        )
    )


def quaternion_of(
    roll_rad: float, pitch_rad: float, yaw_rad: float
) -> tuple[float, float, float, float]:
    """Attitude as a unit quaternion w, x, y, z (aerospace order)."""
    c_r = math.cos(0.5 * roll_rad)
    s_r = math.sin(0.5 * roll_rad)
    c_p = math.cos(0.5 * pitch_rad)
    s_p = math.sin(0.5 * pitch_rad)
    c_y = math.cos(0.5 * yaw_rad)
    s_y = math.sin(0.5 * yaw_rad)
    cc = c_r * c_p
    cs = c_r * s_p
    sc = s_r * c_p
    ss = s_r * s_p
    return (
        cc * c_y + ss * s_y,
        sc * c_y - cs * s_y,
        cs * c_y + sc * s_y,
        cc * s_y - ss * c_y,
    )


def rotated(quaternion: tuple[float, float, float, float], vector: Vector) -> Vector:
    """Rotate a vector from body axes (forward, right, down) to NED by a unit attitude quaternion."""
    w, x, y, z = quaternion
    f, r, d = vector
    return Vector(
        (
            (w * w + x * x - y * y - z * z) * f
            + 2.0 * (x * y - w * z) * r
            + 2.0 * (x * z + w * y) * d,
            2.0 * (x * y + w * z) * f
            + (w * w - x * x + y * y - z * z) * r
            + 2.0 * (y * z - w * x) * d,
            2.0 * (x * z - w * y) * f
            + 2.0 * (y * z + w * x) * r
            + (w * w - x * x - y * y + z * z) * d,
        )
    )


def zero_where_ignored(axes: Vector) -> Vector:
    """Replace ignored axes (NaN) by 0."""
    n, e, d = axes
    return Vector(
        (0.0 if math.isnan(n) else n, 0.0 if math.isnan(e) else e, 0.0 if math.isnan(d) else d)
    )
