"""ArduPilot's vehicles as data: modes, automatic mode changes (measured on 4.5.7) and other differences."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Generic, TypeVar

from sitl_mock.vehicle.modes import Mode, ModeTable, Need, Transition

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from sitl_mock.dynamics import Setpoint
    from sitl_mock.protocols import Command, CommandAnswer, Result


_NONE: frozenset[Need] = frozenset()
_POSITION = frozenset({Need.LOCAL_POSITION})
_HOME = _POSITION | {Need.HOME}
_MANUAL = 1 | 16 | 64
_GUIDED = 1 | 8 | 16 | 64  # MAV_MODE_FLAG: custom, guided, stabilize, manual input

COPTER_MODES: Final = ModeTable(
    title="ArduCopter",
    modes=(
        Mode("STABILIZE", 0, _NONE, True, _MANUAL, "sticks are tilt and thrust, level when free"),
        Mode("ACRO", 1, _NONE, True, _MANUAL, "sticks are body rates"),
        Mode("ALT_HOLD", 2, _NONE, True, _MANUAL, "throttle stick is climb rate"),
        Mode("AUTO", 3, _POSITION | {Need.MISSION}, False, _GUIDED, "flies the uploaded mission"),
        Mode(
            "GUIDED",
            4,
            _POSITION,
            True,
            _GUIDED,
            "follows SET_POSITION_TARGET and SET_ATTITUDE_TARGET; stops when the stream does, and stays GUIDED",
        ),
        Mode("LOITER", 5, _POSITION, True, _GUIDED, "sticks are velocities"),
        Mode("RTL", 6, _HOME, False, _GUIDED, "climbs, returns home, lands"),
        Mode(
            "CIRCLE",
            7,
            _POSITION,
            False,
            _GUIDED,
            "circles about a point ahead; throttle is climb rate",
        ),
        Mode("LAND", 9, _NONE, False, _MANUAL, "lands here"),
        Mode(
            "DRIFT",
            11,
            _POSITION,
            True,
            _MANUAL,
            "sticks as in an aeroplane; flown as STABILIZE here",
        ),
        Mode("POSHOLD", 16, _POSITION, True, _GUIDED, "sticks are tilt, holds when free"),
        Mode("BRAKE", 17, _POSITION, False, _GUIDED, "stops and stays"),
        Mode(
            "THROW",
            18,
            _POSITION | {Need.DISARMED},
            True,
            _MANUAL,
            "waits to be thrown; here it brakes",
        ),
        Mode("AVOID_ADSB", 19, _POSITION, False, _GUIDED, "stops and stays"),
        Mode("GUIDED_NOGPS", 20, _NONE, True, _MANUAL, "follows SET_ATTITUDE_TARGET alone"),
        Mode("SMART_RTL", 21, _HOME, False, _GUIDED, "returns; flown as RTL here"),
        Mode("ZIGZAG", 24, _POSITION, True, _MANUAL, "sticks are velocities"),
    ),
    transitions=(
        Transition("any", "radio lost, FS_THR_ENABLE = 1", "RTL"),
        Transition("any", "radio lost, FS_THR_ENABLE = 2", "RTL"),
        Transition("any", "radio lost, FS_THR_ENABLE = 3", "LAND"),
        Transition("any", "ground station lost, FS_GCS_ENABLE = 1", "RTL"),
        Transition("any", "ground station lost, FS_GCS_ENABLE = 2", "RTL"),
        Transition("any", "ground station lost, FS_GCS_ENABLE = 5", "LAND"),
        Transition("any", "estimator lost, FS_EKF_ACTION = 1", "LAND"),
        Transition("any", "estimator lost, FS_EKF_ACTION = 2", "ALT_HOLD"),
        Transition("any", "estimator lost, FS_EKF_ACTION = 3", "LAND"),
        Transition("any", "battery low, BATT_FS_LOW_ACT = 1", "LAND"),
        Transition("any", "battery low, BATT_FS_LOW_ACT = 2", "RTL"),
        Transition("any", "battery critical, BATT_FS_CRT_ACT = 1", "LAND"),
        Transition("any", "battery critical, BATT_FS_CRT_ACT = 2", "RTL"),
        Transition("any", "fence breached, FENCE_ACTION = 1", "RTL"),
        Transition("any", "fence breached, FENCE_ACTION = 2", "LAND"),
        Transition("any", "fence breached, FENCE_ACTION = 4", "BRAKE"),
        Transition("RTL", "cannot run", "LAND"),
        Transition("BRAKE", "cannot run", "LAND"),
    ),
    rules=(
        "One reliable answer to DO_SET_MODE: ACCEPTED or FAILED; an unknown mode is FAILED.",
        "A disarmed copter accepts any mode, an armed one if the needs are met. AUTO on the ground needs a mission "
        "that starts with a take-off. GUIDED needs no stream. Armed in GUIDED, NAV_TAKEOFF takes off, and so does an "
        "attitude target that climbs; a velocity does not.",
        "After GUID_TIMEOUT without a setpoint the velocity becomes zero; the mode stays GUIDED, without a text.",
        "BRAKE and other modes interrupt LAND and RTL in the air; a landed copter stays down and disarms.",
        "AUTO on the ground takes off when the throttle stick is raised, or with MISSION_START. A mission that returns "
        "stays in AUTO. RTL leads to the nearest rally point, or to home if that is nearer.",
        "A mode change by a failsafe is permanent.",
    ),
)

ROVER_MODES: Final = ModeTable(
    title="ArduPilot Rover",
    modes=(
        Mode("MANUAL", 0, _NONE, True, 1 | 64, "sticks are speed and steering"),
        Mode("HOLD", 4, _NONE, True, 1, "stands"),
        Mode("LOITER", 5, _POSITION, True, 1 | 8, "stays here"),
        Mode("AUTO", 10, _POSITION | {Need.MISSION}, True, 1 | 8, "drives the uploaded mission"),
        Mode("RTL", 11, _HOME, True, 1 | 8, "drives home"),
        Mode(
            "GUIDED",
            15,
            _POSITION,
            True,
            1 | 8,
            "follows SET_POSITION_TARGET; stops when the stream does",
        ),
    ),
    transitions=(
        Transition("AUTO", "mission finished in the air", "HOLD"),
        Transition("AUTO", "mission asks to return", "RTL"),
        Transition("any", "radio lost, FS_THR_ENABLE = 1", "RTL"),
        Transition("any", "ground station lost, FS_GCS_ENABLE = 1", "RTL"),
        Transition("any", "estimator lost, FS_EKF_ACTION = 1", "HOLD"),
        Transition("any", "battery low, BATT_FS_LOW_ACT = 1", "RTL"),
        Transition("any", "battery low, BATT_FS_LOW_ACT = 2", "HOLD"),
        Transition("any", "battery critical, BATT_FS_CRT_ACT = 1", "RTL"),
        Transition("any", "battery critical, BATT_FS_CRT_ACT = 2", "HOLD"),
        Transition("any", "fence breached, FENCE_ACTION = 1", "RTL"),
        Transition("any", "fence breached, FENCE_ACTION = 2", "HOLD"),
        Transition("RTL", "cannot run", "HOLD"),
        Transition("LOITER", "cannot run", "HOLD"),
    ),
    rules=(
        "One reliable answer to DO_SET_MODE: ACCEPTED or FAILED.",
        "GUIDED needs a position. The rover turns its nose to follow a velocity. After 3 s without a setpoint it stops "
        "and stays in GUIDED.",
    ),
)


CommanderT = TypeVar("CommanderT")


@dataclass(frozen=True)
class Firmware(Generic[CommanderT]):
    """One kind of ArduPilot vehicle.

    Attributes:
        modes: Table of modes.
        first_mode: Mode after boot.
        hold_mode: Replaces a mode that cannot run and has no other replacement.
        flights: Setpoint function of each mode.
        execute: Handles commands.
        flies: It can leave the ground.
        guided_timeout: Parameter with the stream's timeout; "" if the timeout is fixed.
        guided_timeout_s: The fixed timeout.
        banner: Name and version as in texts.
        answers: Answers of a later version to commands without effect in the mock.
    """

    modes: ModeTable
    first_mode: str
    hold_mode: str
    flights: Mapping[str, Callable[[CommanderT], Setpoint]]
    execute: Callable[[CommanderT, Command], Sequence[CommandAnswer]]
    flies: bool
    guided_timeout: str = ""
    guided_timeout_s: float = 3.0
    banner: str = ""
    answers: Mapping[int, Result] = field(default_factory=dict)
