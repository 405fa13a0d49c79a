"""What ArduPilot looks at ten times a second: arming checks with their texts, and failsafes (`events.cpp`)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from sitl_mock.craft import Craft, Severity
from sitl_mock.fence import violated
from sitl_mock.missions import flyable
from sitl_mock.modes import Need

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sitl_mock.ardupilot.brain import ArduPilot
    from sitl_mock.protocols import PlanStore

WARNING: Final = Severity.WARNING
_LOW_PARAMETERS: Final = {"battery low": "BATT_FS_LOW_ACT", "battery critical": "BATT_FS_CRT_ACT"}
_LOW_CELL_SHARE, _CRITICAL_SHARE = 0.15, 0.07


def available(craft: Craft, plans: PlanStore) -> frozenset[Need]:
    """Return what is there now."""
    estimator = craft.estimator
    there = {
        Need.PILOT: True,
        Need.ALTITUDE: estimator.altitude_valid,
        Need.LOCAL_POSITION: estimator.position_valid,
        Need.GLOBAL_POSITION: estimator.global_valid,
        Need.HOME: craft.home_m is not None,
        Need.MISSION: flyable(plans.mission.items),
        Need.DISARMED: not craft.armed,
    }
    return frozenset(need for need, met in there.items() if met)


def refusals(brain: ArduPilot) -> list[str]:
    """Return why ArduPilot would not arm, in its own words; empty if it would."""
    reasons = failing(brain)
    if not brain.by_name[brain.mode].may_arm:
        reasons.append(f"{brain.mode} mode not armable")
    return reasons


def failing(brain: ArduPilot) -> list[str]:
    """Return the checks before arming that fail; the mode is looked at only when arming (arm_checks)."""
    craft = brain.craft
    reasons = []
    if craft.conditions.arm_refused:
        reasons.append(craft.conditions.arm_refused)
    if not craft.estimator.position_valid:
        reasons.append("Need Position Estimate")
    if craft.battery.remaining < _LOW_CELL_SHARE and int(craft.parameters["BATT_FS_LOW_ACT"]):
        reasons.append("Battery 1 low voltage failsafe")
    return reasons


def _wrong(brain: ArduPilot) -> Iterator[tuple[str, str]]:
    """Yield the triggers that are present, each with the parameter that chooses the action."""
    craft = brain.craft
    parameters, conditions, now_s = craft.parameters, craft.conditions, craft.now_s
    if craft.pilot.radio_lost(now_s) or craft.pilot.throttle_below(now_s, parameters["FS_THR_VALUE"]):
        yield "radio lost", "FS_THR_ENABLE"
    ground_age_s = now_s - craft.peers.ground_s
    if conditions.gcs_lost or (math.isfinite(ground_age_s) and ground_age_s > parameters["FS_GCS_TIMEOUT"]):
        yield "ground station lost", "FS_GCS_ENABLE"
    if not craft.estimator.position_valid:
        yield "estimator lost", "FS_EKF_ACTION"
    if craft.battery.remaining < _CRITICAL_SHARE:
        yield "battery critical", "BATT_FS_CRT_ACT"
    if craft.battery.remaining < _LOW_CELL_SHARE:
        yield "battery low", "BATT_FS_LOW_ACT"
    if conditions.fence_breach or (int(parameters["FENCE_ENABLE"]) and _outside(brain)):
        yield "fence breached", "FENCE_ACTION"


def _outside(brain: ArduPilot) -> bool:
    craft = brain.craft
    parameters = craft.parameters
    if craft.home_m is None:
        return False
    (n, e, d), (home_n, home_e, home_d) = craft.position_m, craft.home_m
    kinds = int(parameters["FENCE_TYPE"])
    too_high = brain.rig.flies and kinds & 1 and home_d - d > parameters["FENCE_ALT_MAX"]
    too_far = kinds & 2 and math.hypot(n - home_n, e - home_e) > parameters["FENCE_RADIUS"]
    return bool(too_high or too_far or (kinds & 4 and violated(brain.plans.fence.items, craft.frame, craft.position_m)))


def act(brain: ArduPilot) -> None:
    """Let new triggers change the mode, once each until they have gone."""
    craft = brain.craft
    present = dict(_wrong(brain))
    brain.handled &= present.keys()
    brain.in_failsafe = bool(brain.handled)
    for name, parameter in present.items():
        choice = int(craft.parameters[parameter])
        if name in brain.handled or choice == 0:
            continue
        brain.handled.add(name)
        after = brain.after.get(("any", f"{name}, {parameter} = {choice}"))
        if after is None:
            continue
        brain.in_failsafe = True
        craft.say(Severity.CRITICAL, f"Failsafe: {name}")
        if craft.on_ground and brain.rig.flies:
            brain.disarm()
            return
        if brain.mode != "LAND":
            brain.enter(_runnable(brain, after))


def _runnable(brain: ArduPilot, mode: str) -> str:
    while not brain.by_name[mode].needs <= brain.there:
        mode = brain.after.get((mode, "cannot run"), brain.rig.hold_mode)
    return mode
