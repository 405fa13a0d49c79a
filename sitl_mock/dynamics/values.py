"""What goes into a step of the dynamics and what comes out: plain immutable values, NED, SI units."""

import math
from collections.abc import Callable
from enum import IntEnum
from functools import partial
from typing import Any, NamedTuple, TypeVar

Ned = tuple[float, float, float]
"""North, east, down."""

ZERO: Ned = (0.0, 0.0, 0.0)
IGNORED: Ned = (math.nan, math.nan, math.nan)
"""A setpoint's axis is ignored by NaN, as on the wire."""

GRAVITY_M_S2 = 9.80665


class Kind(IntEnum):
    """What the autopilot is doing with its motors."""

    STOPPED = 0
    """Disarmed: no thrust at all (a vehicle in the air falls)."""
    IDLING = 1
    """Armed on the ground: motors turn, no lift. Spool-up is counted from here."""
    STREAM = 2
    """A setpoint of OFFBOARD or GUIDED, treated as the flavour treats it (PX4 truncates, ArduCopter shapes)."""
    TRAVEL = 3
    """The autopilot's own smooth motion (take-off, mission, return, land): see `Setpoint`."""
    BRAKE = 4
    """Stop as fast as the flavour does and hold the place where it stopped (PX4 Hold, ArduCopter BRAKE)."""
    ATTITUDE = 6
    """Lean as asked; the height by a thrust, or by the down velocity where no thrust is given (ArduPilot)."""
    TRACK = 7
    """A motion of the autopilot's own making, followed as it is (ArduPilot's AUTO)."""
    DIRECT = 5
    """Attitude and thrust as the acceleration they make in still air, past the position control (PX4)."""


class Setpoint(NamedTuple):
    """What the vehicle is asked to do. NaN is "ignored", axis by axis.

    `TRAVEL` moves to the axes of `position_ned_m` that are given, at no more than `speed_m_s` (horizontal),
    `climb_m_s` and `sink_m_s` (NaN: the flavour's defaults), and on an axis without a position follows
    `velocity_ned_m_s` (0 where that is ignored too). Landing is a position in north and east and a velocity down.
    """

    kind: Kind
    position_ned_m: Ned = IGNORED
    velocity_ned_m_s: Ned = IGNORED
    acceleration_ned_m_s2: Ned = IGNORED
    yaw_rad: float = math.nan
    yaw_rate_rad_s: float = math.nan
    speed_m_s: float = math.nan
    climb_m_s: float = math.nan
    sink_m_s: float = math.nan
    lean_ne_rad: tuple[float, float] = (0.0, 0.0)
    """`ATTITUDE`: tilt of the thrust axis towards north and east, as `Body` has it."""
    thrust: float = math.nan
    """`ATTITUDE`: share of full throttle in [0, 1], NaN for none."""


class Surroundings(NamedTuple):
    """What the world does to the vehicle and to its estimator during a step.

    The estimator errors act on the control loop as well as on what is reported: estimate = truth + error.
    """

    wind_ned_m_s: Ned = ZERO
    position_error_ned_m: Ned = ZERO
    velocity_error_ned_m_s: Ned = ZERO
    ground_down_m: float = 0.0
    thrust_share: float = 1.0
    """What the rotors give of what is asked."""


CALM = Surroundings()


class Body(NamedTuple):
    """The true motion of the vehicle.

    `lean_ned_rad` is the tilt of the thrust axis as a vector (north, east) whose length is the angle from the vertical:
    leaning north means accelerating north.
    """

    position_ned_m: Ned
    velocity_ned_m_s: Ned
    acceleration_ned_m_s2: Ned
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
    """What the autopilot believes, and reports in LOCAL_POSITION_NED."""

    position_ned_m: Ned
    velocity_ned_m_s: Ned


class Motion(NamedTuple):
    """A vehicle between two steps: its body, and its controller's memory (opaque: pass it back as it came)."""

    body: Body
    memory: object


class Demand(NamedTuple):
    """What a controller asks of the airframe."""

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
    """What makes a named tuple of all its values in their order, unchecked, at a third of the price of calling it.

    For what is made anew at every step; elsewhere the names are worth more.
    """
    return partial(tuple.__new__, kind)


def within(value: float, least: float, most: float) -> float:
    """The value, or the nearer of both limits; NaN stays."""
    return least if value < least else most if value > most else value


def wrap_rad(angle_rad: float) -> float:
    """The same angle in [-pi, pi]."""
    return math.remainder(angle_rad, math.tau)


_euler = maker_of(Euler)


def attitude_of(body: Body) -> Euler:
    """Roll, pitch, yaw (rad, aerospace order) and their rates from the lean vector and the heading.

    The rates are those of the lean vector seen along the body's axes: exact at small tilt, within cos(tilt) otherwise.
    """
    _, _, _, lean_n, lean_e, rate_n, rate_e, yaw_rad, yaw_rate, _, _ = body
    lean_rad = math.hypot(lean_n, lean_e)
    scale = math.sin(lean_rad) / lean_rad if lean_rad > 1e-9 else 1.0
    cos_yaw, sin_yaw = math.cos(yaw_rad), math.sin(yaw_rad)
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


def quaternion_of(roll_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[float, float, float, float]:
    """Attitude as a unit quaternion w, x, y, z (aerospace order)."""
    c_r, s_r = math.cos(0.5 * roll_rad), math.sin(0.5 * roll_rad)
    c_p, s_p = math.cos(0.5 * pitch_rad), math.sin(0.5 * pitch_rad)
    c_y, s_y = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    return (
        c_r * c_p * c_y + s_r * s_p * s_y,
        s_r * c_p * c_y - c_r * s_p * s_y,
        c_r * s_p * c_y + s_r * c_p * s_y,
        c_r * c_p * s_y - s_r * s_p * c_y,
    )


def rotated(quaternion: tuple[float, float, float, float], vector: Ned) -> Ned:
    """A vector of the body's axes (forward, right, down) in north, east, down, by its unit attitude quaternion."""
    w, x, y, z = quaternion
    f, r, d = vector
    return (
        (w * w + x * x - y * y - z * z) * f + 2.0 * (x * y - w * z) * r + 2.0 * (x * z + w * y) * d,
        2.0 * (x * y + w * z) * f + (w * w - x * x + y * y - z * z) * r + 2.0 * (y * z - w * x) * d,
        2.0 * (x * z - w * y) * f + 2.0 * (y * z + w * x) * r + (w * w - x * x - y * y + z * z) * d,
    )


def zero_where_ignored(axes: Ned) -> Ned:
    """The same axes with 0 for those that are ignored (NaN)."""
    n, e, d = axes
    return 0.0 if math.isnan(n) else n, 0.0 if math.isnan(e) else e, 0.0 if math.isnan(d) else d
