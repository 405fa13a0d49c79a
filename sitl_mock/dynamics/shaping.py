"""Smooth references that follow velocity and position targets within limits of speed, acceleration and jerk.

The law is time-optimal with a linear end (a square-root controller): from distance to speed, then from speed to
acceleration. The jerk limits the change of the acceleration.

`travel` makes the reference of the autopilot's own motions: TRAVEL (to a position or at a velocity) and BRAKE.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from sitl_mock.dynamics.values import (
    Kind,
    Setpoint,
    maker_of,
    within,
    zero_where_ignored,
)
from sitl_mock.vector import ZERO, Vector

CORNER_SHARE: Final = math.sqrt(0.5)


class Reference(NamedTuple):
    """The motion that a controller follows and feeds forward."""

    position_ned_m: Vector
    velocity_ned_m_s: Vector
    acceleration_ned_m_s2: Vector = ZERO


_reference = maker_of(Reference)


def sqrt_controller(error: float, gain: float, second_max: float) -> float:
    """Rate of correction for a non-negative error with a second derivative of at most `second_max`.

    Linear with `gain` near zero, along the braking parabola farther out, with equal slope where they meet.
    """
    corner = second_max / (gain * gain)
    if error <= corner:
        return gain * error
    return math.sqrt(second_max * (2.0 * error - corner))


def shape_pair(
    wanted: tuple[float, float],
    velocity: tuple[float, float],
    acceleration: tuple[float, float],
    forward: tuple[float, float],
    accel_m_s2: float,
    jerk_m_s3: float,
    settle_1_s: float,
    dt_s: float,
) -> tuple[float, float]:
    """Next acceleration of a horizontal reference that approaches the `wanted` velocity.

    Args:
        wanted: Velocity, m/s, north and east.
        velocity: Of the reference, m/s.
        acceleration: Of the reference, m/s².
        forward: The acceleration that the wanted velocity itself has, m/s².
        accel_m_s2: At most.
        jerk_m_s3: At most.
        settle_1_s: Gain of the linear end, 1/s.
        dt_s: The step.
    """
    err_n = wanted[0] - velocity[0]
    err_e = wanted[1] - velocity[1]
    err = math.hypot(err_n, err_e)
    size = min(sqrt_controller(err, settle_1_s, jerk_m_s3), accel_m_s2, err / dt_s)
    scale = size / err if err > 1e-12 else 0.0
    d_n = err_n * scale + forward[0] - acceleration[0]
    d_e = err_e * scale + forward[1] - acceleration[1]
    change = math.hypot(d_n, d_e)
    max_change = jerk_m_s3 * dt_s
    if change > max_change:
        d_n *= max_change / change
        d_e *= max_change / change
    return acceleration[0] + d_n, acceleration[1] + d_e


def shape_turn(
    wanted: tuple[float, float],
    velocity: tuple[float, float],
    acceleration: tuple[float, float],
    forward: tuple[float, float],
    accel_m_s2: float,
    jerk_m_s3: float,
    dt_s: float,
) -> tuple[float, float]:
    """`shape_pair` as ArduPilot does it: the component across the wanted velocity is corrected first.

    It gets at least 1/sqrt(2) of the acceleration, and the component along the velocity the rest (measured).

    Args:
        wanted: Velocity, m/s, north and east.
        velocity: Of the reference, m/s.
        acceleration: Of the reference, m/s².
        forward: The acceleration that the wanted velocity itself has, m/s².
        accel_m_s2: At most.
        jerk_m_s3: At most.
        dt_s: The step.
    """
    settle_1_s = jerk_m_s3 / accel_m_s2
    err_n = wanted[0] - velocity[0]
    err_e = wanted[1] - velocity[1]
    err = math.hypot(err_n, err_e)
    if err > 1e-12:
        size = min(sqrt_controller(err, settle_1_s, jerk_m_s3), err / dt_s)
        a_n, a_e = _cornered((err_n * size / err, err_e * size / err), wanted, accel_m_s2)
    else:
        a_n = a_e = 0.0
    d_n = a_n + forward[0] - acceleration[0]
    d_e = a_e + forward[1] - acceleration[1]
    change = math.hypot(d_n, d_e)
    max_change = jerk_m_s3 * dt_s
    if change > max_change:
        d_n *= max_change / change
        d_e *= max_change / change
    return acceleration[0] + d_n, acceleration[1] + d_e


def _cornered(
    accel: tuple[float, float], wanted: tuple[float, float], accel_m_s2: float
) -> tuple[float, float]:
    """Limit an acceleration to `accel_m_s2`; the component across the velocity has priority."""
    a_n, a_e = accel
    w_n, w_e = wanted
    size = math.hypot(a_n, a_e)
    speed = math.hypot(w_n, w_e)
    along = (a_n * w_n + a_e * w_e) / speed if speed > 0.0 else 0.0
    across = math.sqrt(max(size * size - along * along, 0.0))
    if speed == 0.0 or abs(along) <= across:
        keep = min(1.0, accel_m_s2 / size)
        return a_n * keep, a_e * keep
    w_n = w_n / speed
    w_e = w_e / speed
    c_n = a_n - w_n * along
    c_e = a_e - w_e * along
    cross = min(across, CORNER_SHARE * accel_m_s2)
    if across > cross:
        c_n = c_n * cross / across
        c_e = c_e * cross / across
    max_along = math.sqrt(accel_m_s2 * accel_m_s2 - cross * cross)
    along = within(along, -max_along, max_along)
    return c_n + w_n * along, c_e + w_e * along


def turning_first(
    accel: tuple[float, float], velocity: tuple[float, float], most: float
) -> tuple[float, float]:
    """Limit an acceleration to `most`; the component across the velocity has priority."""
    (a_n, a_e) = accel
    speed = math.hypot(*velocity)
    if speed == 0.0:
        keep = min(1.0, most / math.hypot(a_n, a_e))
        return a_n * keep, a_e * keep
    u_n = velocity[0] / speed
    u_e = velocity[1] / speed
    along = a_n * u_n + a_e * u_e
    c_n = a_n - u_n * along
    c_e = a_e - u_e * along
    across = math.hypot(c_n, c_e)
    if across > most:
        return c_n * most / across, c_e * most / across
    rest = math.sqrt(most * most - across * across)
    along = within(along, -rest, rest)
    return c_n + u_n * along, c_e + u_e * along


def shape_one(
    wanted: float,
    velocity: float,
    acceleration: float,
    forward: float,
    accel_m_s2: float,
    jerk_m_s3: float,
    settle_1_s: float,
    dt_s: float,
) -> float:
    """Next acceleration of a vertical reference that approaches the `wanted` velocity.

    Args:
        wanted: Velocity, m/s, down positive.
        velocity: Of the reference, m/s.
        acceleration: Of the reference, m/s².
        forward: The acceleration that the wanted velocity itself has, m/s².
        accel_m_s2: At most.
        jerk_m_s3: At most.
        settle_1_s: Gain of the linear end, 1/s.
        dt_s: The step.
    """
    err = wanted - velocity
    size = min(sqrt_controller(abs(err), settle_1_s, jerk_m_s3), accel_m_s2, abs(err) / dt_s)
    change = math.copysign(size, err) + forward - acceleration
    max_change = jerk_m_s3 * dt_s
    return acceleration + within(change, -max_change, max_change)


def approach_gain_1_s(accel_m_s2: float, jerk_m_s3: float, settle_1_s: float) -> float:
    """Gain from distance to speed that avoids overshoot from the speed loop and the jerk limit."""
    return min(0.25 * settle_1_s, 0.4 * jerk_m_s3 / accel_m_s2)


def approach_pair(
    to_go: tuple[float, float], speed_max: float, accel_m_s2: float, gain_1_s: float
) -> tuple[float, float]:
    """Velocity towards a position `to_go` away, with enough room to brake.

    It plans with half of the acceleration so that jerk-limited braking does not overshoot.

    Args:
        to_go: Vector to the position, m, north and east.
        speed_max: m/s.
        accel_m_s2: At most.
        gain_1_s: Of the linear end, 1/s.
    """
    distance = math.hypot(*to_go)
    if distance < 1e-9:
        return 0.0, 0.0
    speed = min(sqrt_controller(distance, gain_1_s, 0.5 * accel_m_s2), speed_max)
    return to_go[0] * speed / distance, to_go[1] * speed / distance


def approach_one(
    to_go: float, up_max: float, down_max: float, accel_m_s2: float, gain_1_s: float
) -> float:
    """Vertical velocity (down positive) towards a height `to_go` away, with enough room to brake.

    Args:
        to_go: Distance to the height, m, down positive.
        up_max: m/s.
        down_max: m/s.
        accel_m_s2: At most.
        gain_1_s: Of the linear end, 1/s.
    """
    speed = sqrt_controller(abs(to_go), gain_1_s, 0.5 * accel_m_s2)
    return min(speed, down_max) if to_go > 0.0 else -min(speed, up_max)


def advance(reference: Reference, acceleration: Vector, dt_s: float) -> Reference:
    """Advance the reference by one step under a new acceleration."""
    # Written out for each axis: every step of every vehicle comes through here.
    (p_n, p_e, p_d), (v_n, v_e, v_d), _ = reference
    a_n, a_e, a_d = acceleration
    n = v_n + a_n * dt_s
    e = v_e + a_e * dt_s
    d = v_d + a_d * dt_s
    half = 0.5 * dt_s
    middle = Vector((p_n + (v_n + n) * half, p_e + (v_e + e) * half, p_d + (v_d + d) * half))
    return _reference((middle, Vector((n, e, d)), acceleration))


_ALIGNED_M: Final = 0.05
"""If one direction has less than this to go, the other is flown alone."""


@dataclass(frozen=True)
class TravelLimits:
    """Limits of the autopilot's own motions.

    Attributes:
        speed_m_s: Horizontal cruise (MPC_XY_CRUISE, WPNAV_SPEED).
        climb_m_s: Up (MPC_Z_V_AUTO_UP, WPNAV_SPEED_UP).
        sink_m_s: Down (MPC_Z_V_AUTO_DN, WPNAV_SPEED_DN).
        accel_m_s2: Horizontal (MPC_ACC_HOR, WPNAV_ACCEL).
        accel_z_m_s2: Vertical (MPC_ACC_UP_MAX, WPNAV_ACCEL_Z).
        brake_m_s2: Horizontal while braking.
        jerk_m_s3: Horizontal (MPC_JERK_AUTO, PSC_JERK_XY).
        jerk_z_m_s3: Vertical (MPC_JERK_AUTO, PSC_JERK_Z).
        settle_1_s: Gain from the speed still wanted to acceleration at the end of a change.
        straight: Fly straight lines: the slower of the horizontal and vertical motions sets the pace.
    """

    speed_m_s: float
    climb_m_s: float
    sink_m_s: float
    accel_m_s2: float
    accel_z_m_s2: float
    brake_m_s2: float
    jerk_m_s3: float
    jerk_z_m_s3: float
    settle_1_s: float
    straight: bool = False


def _or(value: float, default: float) -> float:
    return default if math.isnan(value) else value


def travel(
    limits: TravelLimits, reference: Reference, setpoint: Setpoint, dt_s: float
) -> Reference:
    """Advance the reference by `dt_s` under a TRAVEL or BRAKE setpoint.

    Args:
        limits: Speeds, accelerations and jerks.
        reference: Position, velocity and acceleration, NED.
        setpoint: Of kind TRAVEL or BRAKE.
        dt_s: Length of the step.
    """
    position, (v_n, v_e, v_d), (a_n, a_e, a_d) = reference
    accel = limits.accel_m_s2
    wanted = (0.0, 0.0)
    wanted_d = 0.0
    if setpoint.kind is Kind.BRAKE:
        accel = limits.brake_m_s2
    else:
        wanted, wanted_d = _towards(limits, position, setpoint)
    pair = shape_pair(
        wanted, (v_n, v_e), (a_n, a_e), (0.0, 0.0), accel, limits.jerk_m_s3, limits.settle_1_s, dt_s
    )
    down = shape_one(
        wanted_d, v_d, a_d, 0.0, limits.accel_z_m_s2, limits.jerk_z_m_s3, limits.settle_1_s, dt_s
    )
    return advance(reference, Vector((*pair, down)), dt_s)


def _towards(
    limits: TravelLimits, position: Vector, setpoint: Setpoint
) -> tuple[tuple[float, float], float]:
    """Return the velocity, level and down, towards a TRAVEL setpoint's position; its own where that is ignored."""
    along_n, along_e, along_d = zero_where_ignored(setpoint.velocity_ned_m_s)
    to_n, to_e, to_d = setpoint.position_ned_m - position
    if math.isnan(to_n) or math.isnan(to_e):
        wanted = (along_n, along_e)
    else:
        cruise = _or(setpoint.speed_m_s, limits.speed_m_s)
        gain_1_s = approach_gain_1_s(limits.accel_m_s2, limits.jerk_m_s3, limits.settle_1_s)
        wanted = approach_pair((to_n, to_e), cruise, limits.accel_m_s2, gain_1_s)
    if math.isnan(to_d):
        wanted_d = along_d
    else:
        climb = _or(setpoint.climb_m_s, limits.climb_m_s)
        sink = _or(setpoint.sink_m_s, limits.sink_m_s)
        gain_1_s = approach_gain_1_s(limits.accel_z_m_s2, limits.jerk_z_m_s3, limits.settle_1_s)
        wanted_d = approach_one(to_d, climb, sink, limits.accel_z_m_s2, gain_1_s)
    if limits.straight:
        # Slow one direction down so that the velocity points at the goal.
        level_m = math.hypot(to_n, to_e)
        high_m = abs(to_d)
        if not math.isnan(level_m + high_m) and min(level_m, high_m) >= _ALIGNED_M:
            level = math.hypot(*wanted)
            pace_1_s = min(level / level_m, abs(wanted_d) / high_m)
            shrink = pace_1_s * level_m / level if level > 0.0 else 0.0
            wanted = (wanted[0] * shrink, wanted[1] * shrink)
            wanted_d = math.copysign(pace_1_s * high_m, wanted_d)
    return wanted, wanted_d
