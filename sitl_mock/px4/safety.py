"""PX4's periodic checks: needs of the modes, arming checks and failsafes.

Each failsafe has a parameter that chooses its action (`failsafe.cpp`).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cache
from typing import Final, NamedTuple

from sitl_mock.missions.fence import violated
from sitl_mock.parameters.calibrated_sensors import uncalibrated
from sitl_mock.protocols import PlanStore
from sitl_mock.vehicle.modes import Mode, Need
from sitl_mock.vehicle.reception import NO_STICKS
from sitl_mock.vehicle.state import Severity, VehicleState


class Action(IntEnum):
    """Failsafe actions in rising severity; the most severe active one is executed."""

    NONE = 0
    WARN = 1
    HOLD = 2
    RTL = 3
    LAND = 4
    DISARM = 5
    TERMINATE = 6


MODE_OF: Final[Mapping[Action, str]] = {
    Action.HOLD: "HOLD",
    Action.RTL: "RTL",
    Action.LAND: "LAND",
    Action.TERMINATE: "TERMINATION",
}


class Trigger(NamedTuple):
    """The trigger of a failsafe.

    Attributes:
        name: The fault.
        parameter: The parameter that chooses the action; empty for a fixed one.
        actions: Parameter value to action.
        deferred: Hold first, for COM_FAIL_ACT_T.
        sticky: The action continues after the cause has gone, until a mode change or disarming.
    """

    name: str
    parameter: str
    actions: Mapping[int, Action]
    deferred: bool
    sticky: bool


_LINK_ACTIONS: Final = {
    0: Action.NONE,
    1: Action.HOLD,
    2: Action.RTL,
    3: Action.LAND,
    5: Action.TERMINATE,
    6: Action.DISARM,
}

TRIGGERS: Final = (
    Trigger("manual control lost", "NAV_RCL_ACT", _LINK_ACTIONS, deferred=True, sticky=True),
    Trigger("ground station lost", "NAV_DLL_ACT", _LINK_ACTIONS, deferred=True, sticky=True),
    Trigger(
        "geofence violated",
        "GF_ACTION",
        {
            0: Action.NONE,
            1: Action.WARN,
            2: Action.HOLD,
            3: Action.RTL,
            4: Action.TERMINATE,
            5: Action.LAND,
        },
        deferred=False,
        sticky=False,
    ),
    Trigger("onboard computer lost", "", {0: Action.WARN}, deferred=False, sticky=False),
    Trigger("battery low", "", {0: Action.WARN}, deferred=False, sticky=True),
    Trigger(
        "battery critical",
        "COM_LOW_BAT_ACT",
        {0: Action.WARN, 2: Action.LAND, 3: Action.RTL},
        deferred=True,
        sticky=True,
    ),
    Trigger(
        "battery emergency",
        "COM_LOW_BAT_ACT",
        {0: Action.WARN, 2: Action.LAND, 3: Action.LAND},
        deferred=True,
        sticky=True,
    ),
)


TEXTS: Final[Mapping[str, tuple[Severity, str]]] = {
    "geofence violated": (Severity.CRITICAL, "Geofence: approaching or outside geofence"),
    "battery low": (Severity.CRITICAL, "Low battery"),
    "battery critical": (Severity.CRITICAL, "Critical battery"),
    "battery emergency": (Severity.EMERGENCY, "Emergency battery level"),
}
"""PX4's texts for triggers; a lost radio has none, and lost peers have theirs, armed or not."""
_PEER_TEXTS: Final[Mapping[str, tuple[tuple[Severity, str], tuple[Severity, str]]]] = {
    "ground station lost": (
        (Severity.INFO, "Connection to ground station lost"),
        (Severity.INFO, "GCS connection regained"),
    ),
    "onboard computer lost": (
        (Severity.CRITICAL, "Connection to mission computer lost"),
        (Severity.INFO, "Onboard controller regained"),
    ),
}
"""What PX4 says when a peer is lost and when it is back."""


@dataclass(slots=True)
class Failsafes:
    """Active failsafe triggers.

    Attributes:
        delays: A more severe action than Hold waits for COM_FAIL_ACT_T, which counts from the first one.
        since_s: Active triggers and when they became active.
        overridden: Triggers that a mode change has cancelled until they occur again.
    """

    delays: bool = False
    since_s: dict[str, float] = field(default_factory=dict)
    overridden: set[str] = field(default_factory=set)
    _delayed_s: float = math.inf

    def update(
        self, now_s: float, wrong: frozenset[str], parameters: Mapping[str, int | float]
    ) -> tuple[Action, tuple[str, ...]]:
        """Take the present faults; return the action and the names of new triggers."""
        if not (wrong or self.since_s):
            self.clear()
            self.delays = False
            self._delayed_s = math.inf
            return Action.NONE, ()
        self.overridden &= wrong
        if not self.since_s:
            self._delayed_s = math.inf
        new = []
        self.delays = False
        worst = Action.NONE
        for trigger in TRIGGERS:
            name = trigger.name
            if name in wrong:
                if name not in self.since_s and name not in self.overridden:
                    self.since_s[name] = now_s
                    new.append(name)
            elif name in self.since_s and not trigger.sticky:
                del self.since_s[name]
            if name not in self.since_s:
                continue
            choice = int(parameters[trigger.parameter]) if trigger.parameter else 0
            action = trigger.actions.get(choice, Action.WARN)
            if trigger.deferred and action > Action.HOLD:
                self._delayed_s = min(self._delayed_s, now_s)
                if now_s - self._delayed_s < parameters["COM_FAIL_ACT_T"]:
                    self.delays = True
                    action = Action.HOLD
            worst = max(worst, action)
        return worst, tuple(new)

    def answer(self) -> None:
        """Cancel active triggers after a mode change by a pilot or client, until they occur again."""
        self.overridden.update(self.since_s)
        self.since_s.clear()

    def clear(self) -> None:
        """Disarmed: forget all triggers."""
        self.since_s.clear()
        self.overridden.clear()


EXCEPTION_BITS: Final = {"MISSION": 1, "HOLD": 2, "TAKEOFF": 2, "OFFBOARD": 4}
"""Bits of COM_RCL_EXCEPT and COM_DLL_EXCEPT: modes in which a lost link has no effect."""


_ONBOARD_LOST_S: Final = 5.0
"""v1.18 has this time fixed, without COM_OBC_LOSS_T."""
_HEARD_FOR_S: Final = 2.25
"""A HEARTBEAT counts for this long: v1.17 lost its ground station 12.3 s after the last one, with 10 s allowed."""
_NEEDS: Final = (
    Need.PILOT,
    Need.ALTITUDE,
    Need.LOCAL_POSITION,
    Need.GLOBAL_POSITION,
    Need.HOME,
    Need.MISSION,
    Need.STREAM,
)


@cache
def _met(met: tuple[bool, ...]) -> frozenset[Need]:
    return frozenset(need for need, is_met in zip(_NEEDS, met, strict=True) if is_met)


def available(state: VehicleState, stream_s: float, *, has_mission: bool) -> frozenset[Need]:
    """Return the needs that are met now.

    Args:
        state: The vehicle.
        stream_s: Time of the last accepted setpoint.
        has_mission: Whether there is a mission that passed the checks.
    """
    estimator = state.estimator
    parameters = state.parameters
    now_s = state.now_s
    streaming = (
        now_s - stream_s <= parameters["COM_OF_LOSS_T"] + 1e-9
        and not state.conditions.offboard_refused
    )
    met = (
        state.pilot.fresh(now_s, parameters["COM_RC_LOSS_T"]),
        estimator.altitude_valid,
        estimator.position_valid,
        estimator.global_valid,
        state.home_m is not None,
        has_mission,
        streaming and estimator.position_valid,
    )
    return _met(met)


def lost_peers(state: VehicleState) -> frozenset[str]:
    """Return the names of the triggers of those peers that were heard and are not heard any more."""
    parameters = state.parameters
    now_s = state.now_s
    lost = set()
    ground_age_s = now_s - state.peers.ground_s
    if state.conditions.gcs_lost or _silent(ground_age_s, parameters["COM_DL_LOSS_T"]):
        lost.add("ground station lost")
    onboard_limit_s = parameters.get("COM_OBC_LOSS_T", _ONBOARD_LOST_S)
    if _silent(now_s - state.peers.onboard_s, onboard_limit_s):
        lost.add("onboard computer lost")
    return frozenset(lost)


def _silent(age_s: float, limit_s: float) -> bool:
    return limit_s + _HEARD_FOR_S < age_s < math.inf


def peer_texts(before: frozenset[str], lost: frozenset[str]) -> list[tuple[Severity, str]]:
    """Return the texts for peers that are newly lost or back."""
    texts = [gone for name, (gone, _) in _PEER_TEXTS.items() if name in lost - before]
    return texts + [back for name, (_, back) in _PEER_TEXTS.items() if name in before - lost]


def wrong(
    state: VehicleState,
    plans: PlanStore,
    intention: str,
    lost: frozenset[str],
    *,
    pilot_counts: bool,
) -> frozenset[str]:
    """Return the names of the failsafe triggers that are present.

    Args:
        state: The vehicle.
        plans: Its plans, with the fence.
        intention: The intended mode; a lost link may have no effect in it (COM_RCL_EXCEPT, COM_DLL_EXCEPT).
        lost: The lost peers (`lost_peers`).
        pilot_counts: There has been a radio since arming.
    """
    now_s = state.now_s
    parameters = state.parameters
    charge = state.battery.remaining
    excepted = EXCEPTION_BITS.get(intention, 0)
    pilot_lost = pilot_counts and not state.pilot.fresh(now_s, parameters["COM_RC_LOSS_T"])
    if parameters["COM_RC_IN_MODE"] == NO_STICKS:
        pilot_lost = False
    ground_lost = "ground station lost" in lost
    # Outside of the fence around home, or of the uploaded one.
    violates = state.conditions.fence_breach
    if not violates and state.home_m is not None and state.estimator.global_valid:
        north, east, down = state.position_m
        home_n, home_e, home_d = state.home_m
        far_m = math.hypot(north - home_n, east - home_e)
        violates = (
            0.0 < parameters["GF_MAX_HOR_DIST"] < far_m
            or 0.0 < parameters["GF_MAX_VER_DIST"] < home_d - down
            or violated(plans.fence.items, state.frame, state.position_m)
        )
    present = {
        "manual control lost": pilot_lost and not int(parameters["COM_RCL_EXCEPT"]) & excepted,
        "ground station lost": ground_lost and not int(parameters["COM_DLL_EXCEPT"]) & excepted,
        "onboard computer lost": "onboard computer lost" in lost,
        "geofence violated": violates,
        "battery low": charge < parameters["BAT_LOW_THR"],
        "battery critical": charge < parameters["BAT_CRIT_THR"],
        "battery emergency": charge < parameters["BAT_EMERGEN_THR"],
    }
    return frozenset(name for name, is_present in present.items() if is_present)


def refusals(state: VehicleState, mode: Mode, met: frozenset[Need]) -> list[str]:
    """Return PX4's reasons for not arming in a mode; empty if it may arm."""
    reasons = [
        f"Preflight Fail: {sensor.title} 0 uncalibrated"
        for sensor in uncalibrated(state.parameters)
    ]
    if state.conditions.arm_refused:
        reasons.append(state.conditions.arm_refused)
    if Need.ALTITUDE not in met:
        reasons.append("Preflight Fail: ekf2 missing data")
    elif Need.LOCAL_POSITION not in met and state.parameters["COM_ARM_WO_GPS"] == 0:
        reasons.append("Preflight Fail: GNSS data missing")
    if state.battery.remaining < state.parameters["BAT_CRIT_THR"]:
        reasons.append("Preflight Fail: low battery")
    if not mode.may_arm:
        reasons.append(f"Mode {mode.name} prevents arming")
    needs = mode.needs
    if state.parameters["COM_ARM_MIS_REQ"]:
        needs = needs | {Need.MISSION}
    missing = needs - met
    if missing:
        reasons.append(f"Mode {mode.name} is not available: no {', '.join(sorted(missing))}")
    return reasons
