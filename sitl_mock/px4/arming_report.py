"""PX4's report of arming checks: events that tell a ground station in which modes it may arm and fly, and why not.

A report is a summary of the modes, one event per failed check, and a summary of health, all of which stations show in
words by PX4's metadata. It is sent when something changes, at most every two seconds, and on RUN_PREARM_CHECKS.
Recorded on v1.17 (SIH); of its checks the mock has those of the modes and of external modes.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol

from sitl_mock.px4.events import Event, event_id
from sitl_mock.px4.modes import BY_NAME, NAV_STATES
from sitl_mock.vehicle.modes import Need

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sitl_mock.px4.external_modes import ArmingVerdict
    from sitl_mock.vehicle.state import VehicleState

REPORTED_EVERY_S: Final = 2.0
EVERY_MODE: Final = 0xFFFFFFFF
_PROTOCOL: Final = 0x88
_ERROR: Final = 0x33
_CRITICAL: Final = 0x22
_WARNING: Final = 0x44
_INFO: Final = 0x66
_SYSTEM: Final = 20
_RADIO: Final = 7
_LOCAL_POSITION: Final = 17
_GLOBAL_POSITION: Final = 24
_HEALTHY: Final = 0x3802180A
"""Parts that SIH has: sensors, estimates, battery."""
_ARGUMENTS: Final = 40
_SUMMARY: Final = struct.Struct("<BIIII").pack
_HEALTH: Final = struct.Struct("<BIII").pack
_FAILURE: Final = struct.Struct("<IB").pack


class Checked(Protocol):
    """What a report asks of the commander."""

    state: VehicleState
    mode: str
    met_needs: frozenset[Need]
    verdict: ArmingVerdict

    def needs_of(self, mode: str) -> frozenset[Need]:
        """Return what a mode needs."""
        ...

    def can_run(self, mode: str) -> bool:
        """True if a mode's needs are met."""
        ...

    def refusals(self) -> list[str]:
        """Return the reasons for not arming in the intended mode."""
        ...


class _Check(NamedTuple):
    """A check of the modes: its need, its event, its level, its component, and its text."""

    need: Need
    event: str
    level: int
    component: int
    text: str


_CHECKS: Final = (
    _Check(
        Need.LOCAL_POSITION,
        "check_modes_local_pos",
        _ERROR,
        _LOCAL_POSITION,
        "Navigation error: No valid position estimate",
    ),
    _Check(
        Need.GLOBAL_POSITION,
        "check_modes_global_pos",
        _ERROR,
        _GLOBAL_POSITION,
        "Navigation error: No valid global position estimate",
    ),
    _Check(
        Need.ALTITUDE,
        "check_modes_local_alt",
        _CRITICAL,
        _SYSTEM,
        "Navigation error: No valid altitude estimate",
    ),
    _Check(Need.MISSION, "check_modes_mission", _INFO, _SYSTEM, "No valid mission available"),
    _Check(Need.STREAM, "check_modes_offboard_signal", _ERROR, _SYSTEM, "No offboard signal"),
    _Check(Need.HOME, "check_modes_home_position", _INFO, _SYSTEM, "Home position not set"),
    _Check(Need.PILOT, "check_modes_manual_control", _WARNING, _RADIO, "No manual control input"),
)
"""In PX4's order. Without sticks it names every mode."""
CHECK_TEXTS: Final = {
    **{check.event: check.text for check in _CHECKS},
    "check_modes_cannot_takeoff": "Mode not suitable for arming",
    "check_external_modes_unavailable": "Mode is not registered",
    "check_external_modes_unresponsive": "Mode is unresponsive",
}
"""Text of each event that names modes and why they cannot arm or run."""


class Results(NamedTuple):
    """What the checks found: modes as bits by their number, health components as bits, and the events."""

    can_arm: int
    can_run: int
    errors: int
    warnings: int
    events: tuple[Event, ...]


@dataclass(slots=True)
class ArmingReport:
    """The reports of one vehicle."""

    _reported: Results | None = None
    _reported_s: float = -math.inf

    def update(self, now_s: float, px4: Checked, *, force: bool = False) -> list[Event]:
        """Return the events of a report if one is due.

        Args:
            now_s: Present time.
            px4: Whose checks.
            force: Report even if nothing has changed.
        """
        if now_s < self._reported_s + REPORTED_EVERY_S and not force:
            return []
        results = arming_results(px4)
        if results == self._reported and not force:
            return []
        self._reported = results
        self._reported_s = now_s
        summary = _SUMMARY(0, results.errors, results.warnings, results.can_arm, results.can_run)
        health = _HEALTH(0, _HEALTHY, 0, 0)
        return [
            _event("commander_arming_check_summary", _PROTOCOL, summary),
            *results.events,
            _event("commander_health_summary", _PROTOCOL, health),
        ]


def arming_results(px4: Checked) -> Results:
    """Return the results of the checks now."""
    events = list(px4.verdict.reasons)
    errors = 0
    warnings = 0
    missing = [check for check in _CHECKS if check.need not in px4.met_needs]
    for check in missing:
        modes = EVERY_MODE
        if check.need is not Need.PILOT:
            modes = _bits(name for name in NAV_STATES if check.need in px4.needs_of(name))
        events.append(_event(check.event, check.level, _FAILURE(modes, check.component)))
    for event in events:
        component = 1 << event.arguments[4] if event.arguments[4] < 32 else 0
        level = event.levels & 0xF
        errors |= component if level <= _ERROR & 0xF else 0
        warnings |= component if level == _WARNING & 0xF else 0
    can_run = EVERY_MODE & ~_bits(name for name in NAV_STATES if not px4.can_run(name))
    can_arm = can_run & ~_bits(px4.verdict.unarmable)
    if px4.verdict.holds_all or any(not reason.startswith("Mode ") for reason in px4.refusals()):
        can_arm = 0
    if not (px4.state.armed or BY_NAME[px4.mode].may_arm):
        unfit = _bits(mode.name for mode in BY_NAME.values() if not mode.may_arm)
        can_arm &= ~unfit
        events.append(_event("check_modes_cannot_takeoff", _INFO, _FAILURE(unfit, _SYSTEM)))
    return Results(can_arm, can_run, errors, warnings, tuple(events))


def _bits(names: Iterable[str]) -> int:
    return sum(1 << NAV_STATES[name][0] for name in names)


def _event(name: str, levels: int, arguments: bytes) -> Event:
    return Event(event_id(name), levels, arguments.ljust(_ARGUMENTS, b"\0"))
