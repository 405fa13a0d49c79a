"""The reference of the autopilot's own motions: TRAVEL (to a place, or at a velocity) and BRAKE."""

import math
from dataclasses import dataclass
from typing import Final

from sitl_mock.dynamics.shaping import (
    Reference,
    advance,
    approach_gain_1_s,
    approach_one,
    approach_pair,
    shape_one,
    shape_pair,
)
from sitl_mock.dynamics.values import ZERO, Kind, Setpoint, zero_where_ignored

_ALIGNED_M: Final = 0.05
"""Nearer than this in one direction, the other is flown by itself."""


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
        straight: Places are flown to along the straight line, as slowly as the slower of both directions wants.
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


def _aligned(
    wanted: tuple[float, float], wanted_d: float, to_go: tuple[float, float, float]
) -> tuple[tuple[float, float], float]:
    """The same velocity, slowed in one direction so that it points at the place."""
    level_m, high_m = math.hypot(to_go[0], to_go[1]), abs(to_go[2])
    if math.isnan(level_m + high_m) or min(level_m, high_m) < _ALIGNED_M:
        return wanted, wanted_d
    level, high = math.hypot(*wanted), abs(wanted_d)
    pace_1_s = min(level / level_m, high / high_m)
    shrink = pace_1_s * level_m / level if level > 0.0 else 0.0
    return (wanted[0] * shrink, wanted[1] * shrink), math.copysign(pace_1_s * high_m, wanted_d)


def travel(limits: TravelLimits, reference: Reference, setpoint: Setpoint, dt_s: float) -> Reference:
    """The reference one step of `dt_s` further along a TRAVEL or BRAKE setpoint."""
    braking = setpoint.kind is Kind.BRAKE
    accel = limits.brake_m_s2 if braking else limits.accel_m_s2
    (p_n, p_e, p_d), (v_n, v_e, v_d), (a_n, a_e, a_d) = reference
    to_n, to_e, to_d = setpoint.position_ned_m
    along_n, along_e, along_d = ZERO if braking else zero_where_ignored(setpoint.velocity_ned_m_s)

    if braking or math.isnan(to_n) or math.isnan(to_e):
        wanted = (along_n, along_e)
    else:
        cruise = _or(setpoint.speed_m_s, limits.speed_m_s)
        wanted = approach_pair(
            (to_n - p_n, to_e - p_e), cruise, accel, approach_gain_1_s(accel, limits.jerk_m_s3, limits.settle_1_s)
        )
    if braking or math.isnan(to_d):
        wanted_d = along_d
    else:
        climb, sink = _or(setpoint.climb_m_s, limits.climb_m_s), _or(setpoint.sink_m_s, limits.sink_m_s)
        gain_1_s = approach_gain_1_s(limits.accel_z_m_s2, limits.jerk_z_m_s3, limits.settle_1_s)
        wanted_d = approach_one(to_d - p_d, climb, sink, limits.accel_z_m_s2, gain_1_s)

    if limits.straight and not braking:
        wanted, wanted_d = _aligned(wanted, wanted_d, (to_n - p_n, to_e - p_e, to_d - p_d))
    pair = shape_pair(wanted, (v_n, v_e), (a_n, a_e), (0.0, 0.0), accel, limits.jerk_m_s3, limits.settle_1_s, dt_s)
    down = shape_one(wanted_d, v_d, a_d, 0.0, limits.accel_z_m_s2, limits.jerk_z_m_s3, limits.settle_1_s, dt_s)
    return advance(reference, (*pair, down), dt_s)
