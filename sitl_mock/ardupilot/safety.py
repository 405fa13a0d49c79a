"""What ArduPilot looks at ten times a second: arming checks with their texts, and failsafes (`events.cpp`)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sitl_mock.missions import flyable, violated
from sitl_mock.modes import Mode, Need

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sitl_mock.protocols import PlanStore
    from sitl_mock.vehicle_state import VehicleState

_LOW_CELL_SHARE, _CRITICAL_SHARE = 0.15, 0.07


def available(state: VehicleState, plans: PlanStore) -> frozenset[Need]:
    """Return what is there now."""
    estimator = state.estimator
    there = {
        Need.PILOT: True,
        Need.ALTITUDE: estimator.altitude_valid,
        Need.LOCAL_POSITION: estimator.position_valid,
        Need.GLOBAL_POSITION: estimator.global_valid,
        Need.HOME: state.home_m is not None,
        Need.MISSION: flyable(plans.mission.items),
        Need.DISARMED: not state.armed,
    }
    return frozenset(need for need, met in there.items() if met)


def refusals(state: VehicleState, mode: Mode) -> list[str]:
    """Return why ArduPilot would not arm in a mode, in its own words; empty if it would."""
    reasons = failing(state)
    if not mode.may_arm:
        reasons.append(f"{mode.name} mode not armable")
    return reasons


def failing(state: VehicleState) -> list[str]:
    """Return the checks before arming that fail; the mode is looked at only when arming (arm_checks)."""
    reasons = []
    if state.conditions.arm_refused:
        reasons.append(state.conditions.arm_refused)
    if not state.estimator.position_valid:
        reasons.append("Need Position Estimate")
    if state.battery.remaining < _LOW_CELL_SHARE and int(state.parameters["BATT_FS_LOW_ACT"]):
        reasons.append("Battery 1 low voltage failsafe")
    return reasons


def wrong(state: VehicleState, plans: PlanStore, *, flies: bool) -> Iterator[tuple[str, str]]:
    """Yield the failsafe triggers that are present, each with the parameter that chooses the action."""
    parameters, conditions, now_s = state.parameters, state.conditions, state.now_s
    if state.pilot.radio_lost(now_s) or state.pilot.throttle_below(now_s, parameters["FS_THR_VALUE"]):
        yield "radio lost", "FS_THR_ENABLE"
    ground_age_s = now_s - state.peers.ground_s
    if conditions.gcs_lost or (math.isfinite(ground_age_s) and ground_age_s > parameters["FS_GCS_TIMEOUT"]):
        yield "ground station lost", "FS_GCS_ENABLE"
    if not state.estimator.position_valid:
        yield "estimator lost", "FS_EKF_ACTION"
    if state.battery.remaining < _CRITICAL_SHARE:
        yield "battery critical", "BATT_FS_CRT_ACT"
    if state.battery.remaining < _LOW_CELL_SHARE:
        yield "battery low", "BATT_FS_LOW_ACT"
    if conditions.fence_breach or (int(parameters["FENCE_ENABLE"]) and _outside(state, plans, flies=flies)):
        yield "fence breached", "FENCE_ACTION"


def _outside(state: VehicleState, plans: PlanStore, *, flies: bool) -> bool:
    parameters = state.parameters
    if state.home_m is None:
        return False
    (n, e, d), (home_n, home_e, home_d) = state.position_m, state.home_m
    kinds = int(parameters["FENCE_TYPE"])
    too_high = flies and kinds & 1 and home_d - d > parameters["FENCE_ALT_MAX"]
    too_far = kinds & 2 and math.hypot(n - home_n, e - home_e) > parameters["FENCE_RADIUS"]
    return bool(too_high or too_far or (kinds & 4 and violated(plans.fence.items, state.frame, state.position_m)))
