"""What PX4 looks at ten times a second: what each mode needs, what is wrong, and whether it may arm."""

import math
from collections.abc import Mapping
from typing import Final

from sitl_mock.fence import violated
from sitl_mock.missions import flyable
from sitl_mock.modes import Mode, Need
from sitl_mock.protocols import PlanStore
from sitl_mock.vehicle_state import VehicleState

EXCEPTION_BITS: Final = {"MISSION": 1, "HOLD": 2, "TAKEOFF": 2, "OFFBOARD": 4}
"""COM_RCL_EXCEPT and COM_DLL_EXCEPT: in which modes a lost link is borne."""


def available(state: VehicleState, plans: PlanStore, stream_s: float) -> frozenset[Need]:
    """Return what is there now. `stream_s` is when the last accepted setpoint came."""
    estimator, parameters, now_s = state.estimator, state.parameters, state.now_s
    streaming = now_s - stream_s <= parameters["COM_OF_LOSS_T"] and not state.conditions.offboard_refused
    there = {
        Need.PILOT: state.pilot.fresh(now_s, parameters["COM_RC_LOSS_T"]),
        Need.ALTITUDE: estimator.altitude_valid,
        Need.LOCAL_POSITION: estimator.position_valid,
        Need.GLOBAL_POSITION: estimator.global_valid,
        Need.HOME: state.home_m is not None,
        Need.MISSION: flyable(plans.mission.items),
        Need.STREAM: streaming and estimator.position_valid,
    }
    return frozenset(need for need, met in there.items() if met)


def wrong(state: VehicleState, plans: PlanStore, intention: str, *, pilot_counts: bool) -> frozenset[str]:
    """Return the names of the failsafe triggers that are present.

    Args:
        state: The vehicle.
        plans: Its fence among them.
        intention: The mode asked for, which may be excepted from a lost link (COM_RCL_EXCEPT, COM_DLL_EXCEPT).
        pilot_counts: A radio was there at arming or since.
    """
    now_s, parameters = state.now_s, state.parameters
    charge = state.battery.remaining
    ground_age_s, onboard_age_s = now_s - state.peers.ground_s, now_s - state.peers.onboard_s
    excepted = EXCEPTION_BITS.get(intention, 0)
    pilot_lost = pilot_counts and not state.pilot.fresh(now_s, parameters["COM_RC_LOSS_T"])
    ground_lost = state.conditions.gcs_lost or parameters["COM_DL_LOSS_T"] < ground_age_s < math.inf
    present = {
        "manual control lost": pilot_lost and not int(parameters["COM_RCL_EXCEPT"]) & excepted,
        "ground station lost": ground_lost and not int(parameters["COM_DLL_EXCEPT"]) & excepted,
        "onboard computer lost": parameters["COM_OBC_LOSS_T"] < onboard_age_s < math.inf,
        "geofence violated": state.conditions.fence_breach or _fence(state, plans, parameters),
        "battery low": charge < parameters["BAT_LOW_THR"],
        "battery critical": charge < parameters["BAT_CRIT_THR"],
        "battery emergency": charge < parameters["BAT_EMERGEN_THR"],
    }
    return frozenset(name for name, is_present in present.items() if is_present)


def _fence(state: VehicleState, plans: PlanStore, parameters: Mapping[str, int | float]) -> bool:
    if state.home_m is None or not state.estimator.global_valid:
        return False
    far_m, high_m = parameters["GF_MAX_HOR_DIST"], parameters["GF_MAX_VER_DIST"]
    (n, e, d), (home_n, home_e, home_d) = state.position_m, state.home_m
    if 0.0 < far_m < math.hypot(n - home_n, e - home_e) or 0.0 < high_m < home_d - d:
        return True
    return violated(plans.fence.items, state.frame, state.position_m)


def refusals(state: VehicleState, mode: Mode, there: frozenset[Need]) -> list[str]:
    """Return why PX4 would not arm in a mode, in its own words; empty if it would."""
    reasons = []
    if state.conditions.arm_refused:
        reasons.append(state.conditions.arm_refused)
    if Need.ALTITUDE not in there:
        reasons.append("Preflight Fail: ekf2 missing data")
    elif Need.LOCAL_POSITION not in there and state.parameters["COM_ARM_WO_GPS"] == 0:
        reasons.append("Preflight Fail: GNSS data missing")
    if state.battery.remaining < state.parameters["BAT_CRIT_THR"]:
        reasons.append("Preflight Fail: low battery")
    if not mode.may_arm:
        reasons.append(f"Mode {mode.name} prevents arming")
    missing = mode.needs - there
    if missing:
        reasons.append(f"Mode {mode.name} is not available: no {', '.join(sorted(missing))}")
    return reasons
