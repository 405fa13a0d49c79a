"""Setpoints of the flown mode: one function per mode, in one table.

On the ground the motors idle until the mode commands a climb: an upward setpoint of a stream, a goal of an automatic
mode at least 0.3 m higher, a throttle stick above 65 %.

Sticks in POSCTL and the other manual modes, as measured (MPC_POS_MODE 4): pitch and roll command an acceleration
against a virtual drag that limits the speed to MPC_VEL_MANUAL. Throttle commands a climb rate, reduced near the ground.
Centred sticks brake. Stick curves have a dead zone and are partly cubic.
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.px4 import flying
from sitl_mock.px4.external_modes import EXTERNAL
from sitl_mock.px4.modes import AFTER, MANUAL_MODES
from sitl_mock.vector import Vector
from sitl_mock.vehicle.setpoints import turned
from sitl_mock.vehicle.state import Severity, VehicleState

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sitl_mock.px4.commander import Px4
    from sitl_mock.px4.flying import ModePlan


_IDLING: Final = Setpoint(Kind.IDLING)
_STEP_S: Final = 0.02
_WISH_M: Final = 0.3
_WISH_M_S: Final = 0.3
_THROTTLE_WISH: Final = 0.3


def fly(px4: Px4) -> Setpoint:
    """The flown mode's setpoint."""
    task = _TASKS.get(px4.mode)
    if task is not None:
        return task(px4)
    if px4.mode not in MANUAL_MODES:
        return Setpoint(Kind.BRAKE)
    state = px4.state
    if state.on_ground and state.pilot.sticks.throttle <= _THROTTLE_WISH:
        return _IDLING
    return by_stick(state, px4.plan, _STEP_S, slow=px4.mode == "POSITION_SLOW")


def _streamed(px4: Px4) -> Setpoint:
    """The last setpoint of a stream; one of body rates turns the vehicle on."""
    if px4.rates is not None:
        px4.setpoint = px4.rates.advance(_STEP_S)
    return px4.setpoint


def _offboard(px4: Px4) -> Setpoint:
    setpoint = _streamed(px4)
    return setpoint if not px4.state.on_ground or px4.wants_to_climb() else _IDLING


def _takeoff(px4: Px4) -> Setpoint:
    if flying.takeoff_done(px4.state, px4.plan):
        px4.complete()
        if not px4.external.in_charge:  # an executor goes on by itself
            _go_on(px4, "height reached")
    return flying.takeoff(px4.state, px4.plan)


def _mission(px4: Px4) -> Setpoint:
    state = px4.state
    flight = px4.mission
    if not flight.begun and not px4.begin_mission():
        _go_on(px4, "mission finished")
        return _IDLING if state.on_ground else Setpoint(Kind.BRAKE)
    setpoint = flying.mission(state, flight, px4.plan)
    if flight.over == "return":
        px4.intention = "RTL"
    elif flight.over == "finished":
        px4.complete()
        if not state.on_ground:
            state.say(Severity.INFO, "Mission finished, loitering")
        _go_on(px4, "mission finished")
    elif flight.over == "landed" and not flight.landing_reported:
        flight.landing_reported = True
        state.say(Severity.INFO, "Mission finished, landed")
    down_again = state.on_ground and state.flew and (flight.over or flight.landing)
    return _IDLING if down_again else setpoint


def _in_the_air(task: Callable[[Px4], Setpoint]) -> Callable[[Px4], Setpoint]:
    def guarded(px4: Px4) -> Setpoint:
        return _IDLING if px4.state.on_ground else task(px4)

    return guarded


def _or_from_the_ground(task: Callable[[Px4], Setpoint]) -> Callable[[Px4], Setpoint]:
    """Idle on the ground unless the goal is higher or the touchdown has not been detected yet."""

    def guarded(px4: Px4) -> Setpoint:
        setpoint = task(px4)
        state = px4.state
        climbs = (
            setpoint.position_ned_m[2] < state.position_m[2] - _WISH_M
            or setpoint.velocity_ned_m_s[2] < -_WISH_M_S
        )
        return setpoint if climbs or not state.on_ground or px4.ground.just_down(state) else _IDLING

    return guarded


def _go_on(px4: Px4, event: str) -> None:
    """End a finished mode: change to the next one in the table and intend it."""
    after = AFTER[px4.mode, event]
    done = px4.plan
    if px4.intention == px4.mode:
        px4.intention = after
    px4.enter(after)
    if event == "height reached":
        px4.plan.goal_m = done.entered_m.level_with(done.height_m)
        px4.plan.heading_kept = True


def _land(px4: Px4) -> Setpoint:
    return flying.land(px4.state, px4.plan)


_TASKS: Final[Mapping[str, Callable[[Px4], Setpoint]]] = MappingProxyType(
    {
        "OFFBOARD": _offboard,
        "TAKEOFF": _takeoff,
        "MISSION": _mission,
        "HOLD": _or_from_the_ground(lambda px4: flying.hold(px4.state, px4.plan)),
        "FOLLOW": _or_from_the_ground(
            lambda px4: (
                Setpoint(Kind.BRAKE)
                if px4.plan.follow is None
                else px4.plan.follow.fly(px4.state, _STEP_S)
            )
        ),
        "ORBIT": _in_the_air(
            lambda px4: (
                Setpoint(Kind.BRAKE, yaw_rad=px4.plan.yaw_rad)
                if px4.plan.orbit is None
                else px4.plan.orbit.fly(px4.state, _STEP_S)
            )
        ),
        "RTL": _in_the_air(lambda px4: flying.return_home(px4.state, px4.plan)),
        "LAND": _in_the_air(_land),
        "PRECLAND": _in_the_air(_land),
        "DESCEND": _in_the_air(lambda px4: flying.descend(px4.state, px4.plan)),
        **dict.fromkeys(EXTERNAL, _in_the_air(_streamed)),
    }
)


_DEAD: Final = 0.1  # MPC_HOLD_DZ
_CUBIC: Final = 0.6  # MPC_XY_MAN_EXPO, MPC_Z_MAN_EXPO, MPC_YAW_EXPO


def by_stick(state: VehicleState, plan: ModePlan, dt_s: float, *, slow: bool = False) -> Setpoint:
    """Return the setpoint of a manual mode.

    Args:
        state: The vehicle.
        plan: State of the mode; keeps the velocity reached by the sticks.
        dt_s: Length of the step.
        slow: Whether the mode is POSITION_SLOW.
    """
    sticks = state.pilot.sticks
    turn = _curved(sticks.yaw) * math.radians(float(state.parameters["MPC_MAN_Y_MAX"]))
    ahead = _curved(sticks.pitch)
    right = _curved(sticks.roll)
    climb = _climb_m_s(state, sticks.throttle, slow=slow)
    if ahead or right:
        plan.stick_place_m = None
        # The commanded velocity, north and east, follows the sticks.
        fast = float(state.parameters["MC_SLOW_DEF_HVEL" if slow else "MPC_VEL_MANUAL"])
        accel = float(state.parameters["MPC_ACC_HOR_MAX"])
        size = max(math.hypot(ahead, right), 1.0)
        push_n, push_e, _ = turned(
            Vector((ahead / size * accel, right / size * accel, 0.0)), state.yaw_rad
        )
        if plan.stick_m_s is None:
            n, e, _ = state.velocity_m_s
        else:
            n, e = plan.stick_m_s
        a_n = push_n - accel / fast * n
        a_e = push_e - accel / fast * e
        plan.stick_m_s = (n + a_n * dt_s, e + a_e * dt_s)
        return Setpoint(
            Kind.STREAM,
            velocity_ned_m_s=Vector((*plan.stick_m_s, -climb)),
            acceleration_ned_m_s2=Vector((a_n, a_e, math.nan)),
            yaw_rate_rad_s=turn,
        )
    plan.stick_m_s = None
    if not climb:
        plan.stick_place_m = None
        return Setpoint(Kind.BRAKE, yaw_rate_rad_s=turn)
    if plan.stick_place_m is None:
        plan.stick_place_m = state.position_m[:2]
    return Setpoint(
        Kind.STREAM,
        Vector((*plan.stick_place_m, math.nan)),
        Vector((0.0, 0.0, -climb)),
        yaw_rate_rad_s=turn,
    )


def _curved(stick: float) -> float:
    beyond = max(abs(stick) - _DEAD, 0.0) / (1.0 - _DEAD)
    return math.copysign((1.0 - _CUBIC) * beyond + _CUBIC * beyond**3, stick) if beyond else 0.0


def _climb_m_s(state: VehicleState, throttle: float, *, slow: bool) -> float:
    """Climb rate of the throttle stick, reduced below MPC_LAND_ALT1 to that of take-off and landing."""
    parameters = state.parameters
    up = float(parameters["MPC_Z_VEL_MAX_UP"])
    down = float(parameters["MPC_Z_VEL_MAX_DN"])
    if slow:
        up = down = float(parameters["MC_SLOW_DEF_VVEL"])
    wanted = _curved(throttle)
    upper = float(parameters["MPC_LAND_ALT1"])
    lower = float(parameters["MPC_LAND_ALT2"])
    share = min(
        max((state.ground_m - state.position_m[2] - lower) / max(upper - lower, 1e-6), 0.0), 1.0
    )
    near_up = float(parameters["MPC_TKO_SPEED"])
    near_down = float(parameters["MPC_LAND_SPEED"])
    if wanted > 0.0:
        return min(wanted * up, near_up + (up - near_up) * share)
    return -min(-wanted * down, near_down + (down - near_down) * share)
