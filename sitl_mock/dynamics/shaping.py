"""Smooth references: velocity and position targets followed under limits of speed, acceleration and jerk.

The law is the time-optimal one with a linear end (a square-root controller), first from distance to speed, then from
speed to acceleration; the acceleration itself moves by no more than the jerk allows.
"""

import math
from typing import Final, NamedTuple

from sitl_mock.dynamics.values import ZERO, Ned

CORNER_SHARE: Final = math.sqrt(0.5)


class Reference(NamedTuple):
    """The motion a controller follows, and feeds forward."""

    position_ned_m: Ned
    velocity_ned_m_s: Ned
    acceleration_ned_m_s2: Ned = ZERO


def root_law(error: float, gain: float, second_max: float) -> float:
    """Rate at which an error is worked off with a second derivative of at most `second_max`; none is negative.

    Linear with `gain` near zero and along the braking parabola further out, with equal slope where they meet.
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
    accel_max: float,
    jerk_max: float,
    settle_1_s: float,
    dt_s: float,
) -> tuple[float, float]:
    """The next acceleration of a horizontal reference on its way to the `wanted` velocity.

    `forward` is the acceleration the wanted velocity itself has, `settle_1_s` the gain of the linear end.
    """
    err_n, err_e = wanted[0] - velocity[0], wanted[1] - velocity[1]
    err = math.hypot(err_n, err_e)
    size = min(root_law(err, settle_1_s, jerk_max), accel_max, err / dt_s)
    scale = size / err if err > 1e-12 else 0.0
    d_n = err_n * scale + forward[0] - acceleration[0]
    d_e = err_e * scale + forward[1] - acceleration[1]
    change = math.hypot(d_n, d_e)
    most = jerk_max * dt_s
    if change > most:
        d_n *= most / change
        d_e *= most / change
    return acceleration[0] + d_n, acceleration[1] + d_e


def shape_turn(
    wanted: tuple[float, float],
    velocity: tuple[float, float],
    acceleration: tuple[float, float],
    forward: tuple[float, float],
    accel_max: float,
    jerk_max: float,
    dt_s: float,
) -> tuple[float, float]:
    """`shape_pair` as ArduPilot does it: of the correction, what lies across the wanted velocity is worked off first.

    Across it at least 1/sqrt(2) of the acceleration is had, along it what is left of it (`shape_vel_accel_xy`).
    """
    settle_1_s = jerk_max / accel_max
    err_n, err_e = wanted[0] - velocity[0], wanted[1] - velocity[1]
    err = math.hypot(err_n, err_e)
    if err > 1e-12:
        size = min(root_law(err, settle_1_s, jerk_max), err / dt_s)
        a_n, a_e = _cornered((err_n * size / err, err_e * size / err), wanted, accel_max)
    else:
        a_n = a_e = 0.0
    d_n, d_e = a_n + forward[0] - acceleration[0], a_e + forward[1] - acceleration[1]
    change = math.hypot(d_n, d_e)
    most = jerk_max * dt_s
    if change > most:
        d_n *= most / change
        d_e *= most / change
    return acceleration[0] + d_n, acceleration[1] + d_e


def _cornered(accel: tuple[float, float], wanted: tuple[float, float], accel_max: float) -> tuple[float, float]:
    """Limit an acceleration to `accel_max`, keeping what turns the velocity before what speeds it up."""
    a_n, a_e = accel
    size, speed = math.hypot(a_n, a_e), math.hypot(*wanted)
    along = (a_n * wanted[0] + a_e * wanted[1]) / speed if speed > 0.0 else 0.0
    across = math.sqrt(max(size * size - along * along, 0.0))
    if speed == 0.0 or abs(along) <= across:
        keep = min(1.0, accel_max / size)
        return a_n * keep, a_e * keep
    w_n, w_e = wanted[0] / speed, wanted[1] / speed
    c_n, c_e = a_n - w_n * along, a_e - w_e * along
    cross = min(across, CORNER_SHARE * accel_max)
    if across > cross:
        c_n, c_e = c_n * cross / across, c_e * cross / across
    most = math.sqrt(accel_max * accel_max - cross * cross)
    along = min(max(along, -most), most)
    return c_n + w_n * along, c_e + w_e * along


def turning_first(accel: tuple[float, float], velocity: tuple[float, float], most: float) -> tuple[float, float]:
    """Limit an acceleration to `most`: what lies across the velocity first, then what lies along it."""
    (a_n, a_e), speed = accel, math.hypot(*velocity)
    if speed == 0.0:
        keep = min(1.0, most / math.hypot(a_n, a_e))
        return a_n * keep, a_e * keep
    u_n, u_e = velocity[0] / speed, velocity[1] / speed
    along = a_n * u_n + a_e * u_e
    c_n, c_e = a_n - u_n * along, a_e - u_e * along
    across = math.hypot(c_n, c_e)
    if across > most:
        return c_n * most / across, c_e * most / across
    rest = math.sqrt(most * most - across * across)
    along = min(max(along, -rest), rest)
    return c_n + u_n * along, c_e + u_e * along


def shape_one(
    wanted: float,
    velocity: float,
    acceleration: float,
    forward: float,
    accel_max: float,
    jerk_max: float,
    settle_1_s: float,
    dt_s: float,
) -> float:
    """The next acceleration of a vertical reference on its way to the `wanted` velocity."""
    err = wanted - velocity
    size = min(root_law(abs(err), settle_1_s, jerk_max), accel_max, abs(err) / dt_s)
    change = math.copysign(size, err) + forward - acceleration
    most = jerk_max * dt_s
    return acceleration + min(max(change, -most), most)


def approach_gain_1_s(accel_max: float, jerk_max: float, settle_1_s: float) -> float:
    """Gain from distance to speed that neither the settling of the speed nor the jerk turns into an overrun."""
    return min(0.25 * settle_1_s, 0.4 * jerk_max / accel_max)


def approach_pair(
    to_go: tuple[float, float], speed_max: float, accel_max: float, gain_1_s: float
) -> tuple[float, float]:
    """Velocity towards a place `to_go` away, braking in time.

    Half of the acceleration is planned with, so that jerk-limited braking does not overrun the place.
    """
    distance = math.hypot(*to_go)
    if distance < 1e-9:
        return 0.0, 0.0
    speed = min(root_law(distance, gain_1_s, 0.5 * accel_max), speed_max)
    return to_go[0] * speed / distance, to_go[1] * speed / distance


def approach_one(to_go: float, up_max: float, down_max: float, accel_max: float, gain_1_s: float) -> float:
    """Vertical velocity (down positive) towards a height `to_go` away, braking in time."""
    speed = root_law(abs(to_go), gain_1_s, 0.5 * accel_max)
    return min(speed, down_max) if to_go > 0.0 else -min(speed, up_max)


def advance(reference: Reference, acceleration: Ned, dt_s: float) -> Reference:
    """The reference one step later under a new acceleration."""
    (p_n, p_e, p_d), (v_n, v_e, v_d), _ = reference
    a_n, a_e, a_d = acceleration
    n, e, d = v_n + a_n * dt_s, v_e + a_e * dt_s, v_d + a_d * dt_s
    half = 0.5 * dt_s
    return Reference((p_n + (v_n + n) * half, p_e + (v_e + e) * half, p_d + (v_d + d) * half), (n, e, d), acceleration)
