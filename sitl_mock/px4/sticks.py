"""POSCTL and the other manual modes: what PX4 v1.17 makes of the sticks (MPC_POS_MODE 4, as measured).

A stick gives an acceleration, against a drag that ends it at MPC_VEL_MANUAL; the climb is a velocity that is held back
near the ground; resting sticks brake. Curves have a dead zone and are cubic in part.
"""

import math
from typing import Final

from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.px4.flying import ModePlan
from sitl_mock.setpoints import turned
from sitl_mock.vehicle_state import VehicleState

_DEAD: Final = 0.1  # MPC_HOLD_DZ
_CUBIC: Final = 0.6  # MPC_XY_MAN_EXPO, MPC_Z_MAN_EXPO, MPC_YAW_EXPO


def by_stick(state: VehicleState, plan: ModePlan, dt_s: float, *, slow: bool = False) -> Setpoint:
    """The setpoint of a manual mode; `plan` keeps the velocity that the sticks have led to.

    Args:
        state: The vehicle's.
        plan: Keeps the velocity that the sticks have led to.
        dt_s: The step.
        slow: Whether the mode is the slow one of its kind.
    """
    sticks = state.pilot.sticks
    turn = _curved(sticks.yaw) * math.radians(float(state.parameters["MPC_MAN_Y_MAX"]))
    ahead, right, climb = _curved(sticks.pitch), _curved(sticks.roll), _climb_m_s(state, sticks.throttle, slow=slow)
    if ahead or right:
        plan.stick_place_m = None
        velocity, push = _level(state, plan, (ahead, right), dt_s, slow=slow)
        return Setpoint(
            Kind.STREAM,
            velocity_ned_m_s=(*velocity, -climb),
            acceleration_ned_m_s2=(*push, math.nan),
            yaw_rate_rad_s=turn,
        )
    plan.stick_m_s = None
    if not climb:
        plan.stick_place_m = None
        return Setpoint(Kind.BRAKE, yaw_rate_rad_s=turn)
    plan.stick_place_m = plan.stick_place_m or state.position_m[:2]
    return Setpoint(Kind.STREAM, (*plan.stick_place_m, math.nan), (0.0, 0.0, -climb), yaw_rate_rad_s=turn)


def _curved(stick: float) -> float:
    beyond = max(abs(stick) - _DEAD, 0.0) / (1.0 - _DEAD)
    return math.copysign((1.0 - _CUBIC) * beyond + _CUBIC * beyond**3, stick) if beyond else 0.0


def _level(
    state: VehicleState, plan: ModePlan, stick: tuple[float, float], dt_s: float, *, slow: bool
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Velocity north and east one step on, and the acceleration it is changed by."""
    fast = float(state.parameters["MC_SLOW_DEF_HVEL" if slow else "MPC_VEL_MANUAL"])
    accel = float(state.parameters["MPC_ACC_HOR_MAX"])
    size = max(math.hypot(*stick), 1.0)
    push_n, push_e, _ = turned((stick[0] / size * accel, stick[1] / size * accel, 0.0), state.yaw_rad)
    n, e = plan.stick_m_s or state.velocity_m_s[:2]
    a_n, a_e = push_n - accel / fast * n, push_e - accel / fast * e
    plan.stick_m_s = (n + a_n * dt_s, e + a_e * dt_s)
    return plan.stick_m_s, (a_n, a_e)


def _climb_m_s(state: VehicleState, throttle: float, *, slow: bool) -> float:
    """Climb rate of the throttle stick; below MPC_LAND_ALT2 no faster than a take-off or a landing."""
    parameters = state.parameters
    up, down = float(parameters["MPC_Z_VEL_MAX_UP"]), float(parameters["MPC_Z_VEL_MAX_DN"])
    if slow:
        up = down = float(parameters["MC_SLOW_DEF_VVEL"])
    wanted = _curved(throttle)
    upper, lower = float(parameters["MPC_LAND_ALT1"]), float(parameters["MPC_LAND_ALT2"])
    share = min(max((state.ground_m - state.position_m[2] - lower) / max(upper - lower, 1e-6), 0.0), 1.0)
    near_up, near_down = float(parameters["MPC_TKO_SPEED"]), float(parameters["MPC_LAND_SPEED"])
    if wanted > 0.0:
        return min(wanted * up, near_up + (up - near_up) * share)
    return -min(-wanted * down, near_down + (down - near_down) * share)
