"""ArduPilot's periodic checks: arming checks with their texts, and failsafes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Final

from sitl_mock.ardupilot import fence
from sitl_mock.missions.flight import flyable
from sitl_mock.vehicle.modes import Mode, Need
from sitl_mock.vehicle.pilot import override_time_s
from sitl_mock.vehicle.state import Severity

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sitl_mock.protocols import PlanStore
    from sitl_mock.vehicle.state import VehicleState

_LOW_CELL_SHARE = 0.15
_CRITICAL_SHARE = 0.07
_TEXTS: Final = {"fence breached": (Severity.NOTICE, "Fence Breached")}
_LANDING_MODES: Final = frozenset({"LAND", "RTL", "SMART_RTL", "AUTO"})
_LANDED_S: Final = 1.1
_CHECK_PARAMETERS: Final = 1 | 1 << 5  # bits of ARMING_CHECK: all checks, and those of parameters
_PULSE_NONE_US = 910
_PULSE_MARGIN_US = 10
_GCS_CONTINUE = 2
_LEAST_LEAN_CDEG = 1000
_MOST_LEAN_CDEG = 8000
_ACRO_BALANCES: Final = (("ACRO_BAL_ROLL", "ATC_ANG_RLL_P"), ("ACRO_BAL_PITCH", "ATC_ANG_PIT_P"))


@dataclass(slots=True)
class FailsafeLatch:
    """Failsafes that have acted; each acts again only after its trigger has gone.

    Attributes:
        handled: Names of present triggers that have acted.
        acting: At least one of them has changed the mode.
    """

    handled: set[str] = field(default_factory=set)
    acting: bool = False

    def new(
        self, state: VehicleState, plans: PlanStore, *, flies: bool
    ) -> Iterator[tuple[str, str]]:
        """Yield each new trigger with its event in the table of modes."""
        present = dict(wrong(state, plans, flies=flies))
        state.fence_breached = "fence breached" in present
        self.handled &= present.keys()
        self.acting = bool(self.handled)
        for name, parameter in present.items():
            choice = int(state.parameters[parameter])
            if choice and name not in self.handled:
                self.handled.add(name)
                yield name, f"{name}, {parameter} = {choice}"

    def act(self, state: VehicleState, name: str) -> None:
        """Note and report that a trigger acts."""
        self.acting = True
        state.say(*_TEXTS.get(name, (Severity.CRITICAL, f"Failsafe: {name}")))

    def clear(self) -> None:
        """Disarmed: forget all triggers."""
        self.handled.clear()
        self.acting = False


def just_down(state: VehicleState) -> bool:
    """True if touchdown was too recent to count as a landing."""
    return state.armed and state.flew and state.standing_s < _LANDED_S


class DisarmMethod(IntEnum):
    """How a vehicle was disarmed, in ArduPilot's numbers, which its log has."""

    BY_CLIENT = 1
    BATTERY_FAILSAFE = 7
    BUTTON = 8
    TERMINATION = 9
    LANDED = 13
    FENCE_BREACH = 15
    RADIO_FAILSAFE = 16
    DISARM_DELAY = 17
    STATION_FAILSAFE = 18
    ESTIMATOR_FAILSAFE = 24


BY_FAILSAFE: Final = {
    "radio lost": DisarmMethod.RADIO_FAILSAFE,
    "ground station lost": DisarmMethod.STATION_FAILSAFE,
    "estimator lost": DisarmMethod.ESTIMATOR_FAILSAFE,
    "battery critical": DisarmMethod.BATTERY_FAILSAFE,
    "battery low": DisarmMethod.BATTERY_FAILSAFE,
    "fence breached": DisarmMethod.FENCE_BREACH,
}
"""How a failsafe disarms on the ground, by the name of its trigger."""


def disarms_by_itself(state: VehicleState, mode: str, *, taking_off: bool) -> DisarmMethod | None:
    """Return how a copter on the ground disarms by itself: after a commanded landing, or after DISARM_DELAY."""
    if not state.on_ground:
        return None
    if state.flew and mode in _LANDING_MODES and state.standing_s > _LANDED_S:
        return DisarmMethod.LANDED
    delay_s = float(state.parameters["DISARM_DELAY"])
    idle_s = state.now_s - max(state.armed_s, state.landed_s)
    return DisarmMethod.DISARM_DELAY if 0.0 < delay_s < idle_s and not taking_off else None


def available(state: VehicleState, plans: PlanStore) -> frozenset[Need]:
    """Return the needs that are met now."""
    estimator = state.estimator
    met = {
        Need.PILOT: True,
        Need.ALTITUDE: estimator.altitude_valid,
        Need.LOCAL_POSITION: estimator.position_valid,
        Need.GLOBAL_POSITION: estimator.global_valid,
        Need.HOME: state.home_m is not None,
        Need.MISSION: flyable(plans.mission.items),
        Need.DISARMED: not state.armed,
    }
    return frozenset(need for need, is_met in met.items() if is_met)


def refusals(state: VehicleState, plans: PlanStore, mode: Mode) -> list[str]:
    """Return ArduPilot's reasons for not arming in a mode; empty if it may arm."""
    reasons = failing(state, plans, mode)
    if not mode.may_arm:
        reasons.append(f"{mode.name} mode not armable")
    return reasons


def failing(state: VehicleState, plans: PlanStore, mode: Mode) -> list[str]:
    """Return the failing pre-arm checks; whether the mode may arm is checked only when arming."""
    reasons = []
    if state.conditions.arm_refused:
        reasons.append(state.conditions.arm_refused)
    # A flight without a position is possible if neither mode nor fence needs one. Measured on ArduCopter 4.5.7 in
    # STABILIZE, ALT_HOLD and GUIDED before its home was set, and with its GPS off.
    by_mode = bool(mode.needs & {Need.LOCAL_POSITION, Need.GLOBAL_POSITION})
    by_fence = fence.needs_position(state)
    has_home = state.home_m is not None
    if by_mode or by_fence or not has_home:
        if has_home and state.conditions.gps_lost:
            reasons.append("GPS 1: Bad fix")
        elif not state.estimator.position_valid:
            home_only = by_fence and not by_mode
            reasons.append("AHRS: waiting for home" if home_only else "Need Position Estimate")
    reasons += fence.objections(state, plans)
    parameters = state.parameters
    if state.battery.remaining < _LOW_CELL_SHARE and int(parameters["BATT_FS_LOW_ACT"]):
        reasons.append("Battery 1 low voltage failsafe")
    # The first parameter that ArduCopter's checks refuse.
    if _checks_parameters(parameters):
        least_us = _PULSE_NONE_US
        most_us = parameters["RC3_MIN"] - _PULSE_MARGIN_US
        watches_throttle = bool(int(parameters["FS_THR_ENABLE"]))
        if watches_throttle and not least_us <= parameters["FS_THR_VALUE"] < most_us:
            reasons.append("Check FS_THR_VALUE")
        elif not _LEAST_LEAN_CDEG <= parameters["ANGLE_MAX"] <= _MOST_LEAN_CDEG:
            reasons.append("Check ANGLE_MAX")
        elif any(parameters[balance] > parameters[gain] for balance, gain in _ACRO_BALANCES):
            reasons.append("Check ACRO_BAL_ROLL/PITCH")
        elif parameters["PILOT_SPEED_UP"] <= 0:
            reasons.append("Check PILOT_SPEED_UP")
    return reasons


def _checks_parameters(parameters: Mapping[str, float]) -> bool:
    if "ANGLE_MAX" not in parameters:  # a rover
        return False
    if "ARMING_SKIPCHK" in parameters:  # 4.7
        return not int(parameters["ARMING_SKIPCHK"]) & _CHECK_PARAMETERS
    return bool(int(parameters["ARMING_CHECK"]) & _CHECK_PARAMETERS)


def warnings(parameters: Mapping[str, float]) -> list[str]:
    """Return texts of the pre-arm checks that do not refuse arming."""
    removed = _checks_parameters(parameters) and int(parameters["FS_GCS_ENABLE"]) == _GCS_CONTINUE
    if removed:
        return ["FS_GCS_ENABLE=2 removed, see FS_OPTIONS"]
    return []


def wrong(state: VehicleState, plans: PlanStore, *, flies: bool) -> Iterator[tuple[str, str]]:
    """Yield the failsafe triggers that are present, each with the parameter that chooses the action."""
    parameters = state.parameters
    conditions = state.conditions
    now_s = state.now_s
    if state.pilot.radio_lost(now_s) or state.pilot.throttle_below(
        now_s, override_time_s(parameters), parameters["FS_THR_VALUE"]
    ):
        yield "radio lost", "FS_THR_ENABLE"
    ground_age_s = now_s - state.peers.ground_s
    if conditions.gcs_lost or (
        math.isfinite(ground_age_s) and ground_age_s > parameters["FS_GCS_TIMEOUT"]
    ):
        yield "ground station lost", "FS_GCS_ENABLE"
    if not state.estimator.position_valid:
        yield "estimator lost", "FS_EKF_ACTION"
    if state.battery.remaining < _CRITICAL_SHARE:
        yield "battery critical", "BATT_FS_CRT_ACT"
    if state.battery.remaining < _LOW_CELL_SHARE:
        yield "battery low", "BATT_FS_LOW_ACT"
    if conditions.fence_breach or fence.breached(state, plans, flies=flies):
        yield "fence breached", "FENCE_ACTION"
