"""PX4's modes and automatic mode changes as one table (`px4_custom_mode.h`, measured on v1.17).

`requested_mode` decodes the mode in DO_SET_MODE and SET_MODE as PX4 v1.17 does.
"""

from collections.abc import Mapping
from enum import Enum
from typing import Final

from sitl_mock.vehicle.modes import Available, Mode, ModeTable, Need, Transition

_ANY = "any"
_POSITION = frozenset({Need.ALTITUDE, Need.LOCAL_POSITION})
_GLOBAL = _POSITION | {Need.GLOBAL_POSITION}
_STICKS = frozenset({Need.PILOT})
_EXTERNAL = frozenset({Need.REGISTRATION})
_AUTO_MODE = 1 | 4 | 8 | 16  # MAV_MODE_FLAG: custom, auto, guided, stabilize
_MANUAL_MODE = 1 | 16 | 64
_RATES = 1 | 64
_LEVELLED = 1 | 16


def _custom_mode(main: int, sub: int = 0) -> int:
    return main << 16 | sub << 24


_ADVANCED = 1
NOT_FOR_USERS: Final = 2

AVAILABLE: Final = (
    Available(_custom_mode(1), 0, _ADVANCED, "Manual"),
    Available(_custom_mode(2), 4, 0, ""),  # altitude hold
    Available(_custom_mode(3), 1, 0, ""),  # position hold
    Available(_custom_mode(4, 4), 6, _ADVANCED, ""),  # mission
    Available(_custom_mode(4, 3), 0, _ADVANCED, "Hold"),
    Available(_custom_mode(4, 5), 5, _ADVANCED, ""),  # safe recovery: return
    Available(_custom_mode(3, 2), 0, _ADVANCED, "Position Slow"),
    Available(_custom_mode(11), 0, 0, "Altitude Cruise"),
    Available(_custom_mode(5), 0, _ADVANCED, "Acro"),
    Available(_custom_mode(10), 0, _ADVANCED | NOT_FOR_USERS, "Termination"),
    Available(_custom_mode(6), 0, _ADVANCED, "Offboard"),
    Available(_custom_mode(7), 0, _ADVANCED, "Stabilized"),
    Available(_custom_mode(4, 2), 8, _ADVANCED, ""),  # take-off
    Available(_custom_mode(4, 6), 7, _ADVANCED, ""),  # land
    Available(_custom_mode(4, 8), 0, _ADVANCED, "Follow Target"),
    Available(_custom_mode(4, 9), 0, _ADVANCED, "Precision Landing"),
    Available(_custom_mode(3, 1), 2, _ADVANCED, ""),  # orbit
    Available(_custom_mode(4, 10), 0, _ADVANCED, "VTOL Takeoff"),
    *(
        Available(_custom_mode(4, 10 + index), 0, NOT_FOR_USERS, "(Mode not available)")
        for index in range(1, 9)
    ),
)
"""Read from PX4 v1.17.0 (SIH quadrotor); a standard mode has no name."""

MODES: Final = ModeTable(
    listed=AVAILABLE,
    title="PX4 (multicopter)",
    modes=(
        Mode("MANUAL", _custom_mode(1), _STICKS, True, _MANUAL_MODE, "sticks are tilt and thrust"),
        Mode(
            "ALTCTL",
            _custom_mode(2),
            _STICKS | {Need.ALTITUDE},
            True,
            _MANUAL_MODE,
            "height is held",
        ),
        Mode(
            "POSCTL",
            _custom_mode(3),
            _POSITION | _STICKS,
            True,
            _MANUAL_MODE,
            "sticks are velocities",
        ),
        Mode(
            "ORBIT", _custom_mode(3, 1), _POSITION, False, _LEVELLED, "circles a place (DO_ORBIT)"
        ),
        Mode(
            "POSITION_SLOW",
            _custom_mode(3, 2),
            _POSITION | _STICKS,
            True,
            _MANUAL_MODE,
            "sticks are slow velocities",
        ),
        Mode("HOLD", _custom_mode(4, 3), _GLOBAL, True, _AUTO_MODE, "stops and stays"),
        Mode(
            "TAKEOFF",
            _custom_mode(4, 2),
            _POSITION,
            True,
            _AUTO_MODE,
            "climbs to the requested height",
        ),
        Mode(
            "MISSION",
            _custom_mode(4, 4),
            _GLOBAL | {Need.MISSION},
            True,
            _AUTO_MODE,
            "flies the uploaded mission",
        ),
        Mode(
            "RTL",
            _custom_mode(4, 5),
            _GLOBAL | {Need.HOME},
            False,
            _AUTO_MODE,
            "climbs, returns home, lands",
        ),
        Mode("LAND", _custom_mode(4, 6), _POSITION, False, _AUTO_MODE, "lands here"),
        Mode(
            "DESCEND",
            _custom_mode(4, 6),
            frozenset({Need.ALTITUDE}),
            False,
            _AUTO_MODE,
            "descends without a position",
        ),
        Mode("FOLLOW", _custom_mode(4, 8), _POSITION, False, _LEVELLED, "follows FOLLOW_TARGET"),
        Mode(
            "PRECLAND",
            _custom_mode(4, 9),
            _POSITION,
            False,
            _AUTO_MODE,
            "lands on a beacon; there is none, so it lands here",
        ),
        *(
            Mode(
                f"EXTERNAL{index}",
                _custom_mode(4, 10 + index),
                _EXTERNAL,
                True,
                _LEVELLED,
                "a companion's own mode",
            )
            for index in range(1, 9)
        ),
        Mode("ACRO", _custom_mode(5), _STICKS, True, _RATES, "sticks are body rates"),
        Mode(
            "OFFBOARD",
            _custom_mode(6),
            frozenset({Need.STREAM}),
            True,
            _LEVELLED,
            "follows SET_POSITION_TARGET and the like",
        ),
        Mode(
            "STABILIZED",
            _custom_mode(7),
            _STICKS,
            True,
            _MANUAL_MODE,
            "sticks are tilt and thrust, level when free",
        ),
        Mode("TERMINATION", _custom_mode(10), frozenset(), False, 1, "motors off, for good"),
        Mode(
            "ALTITUDE_CRUISE",
            _custom_mode(11),
            _STICKS | {Need.ALTITUDE},
            True,
            _MANUAL_MODE,
            "height is held, speed is kept",
        ),
    ),
    transitions=(
        Transition("TAKEOFF", "height reached", "HOLD"),
        Transition("MISSION", "mission finished", "HOLD"),
        Transition("MISSION", "mission finished on the ground", "HOLD"),
        Transition("OFFBOARD", "stream lost, COM_OBL_RC_ACT = 0", "POSCTL"),
        Transition("OFFBOARD", "stream lost, COM_OBL_RC_ACT = 1", "ALTCTL"),
        Transition("OFFBOARD", "stream lost, COM_OBL_RC_ACT = 2", "STABILIZED"),
        Transition("OFFBOARD", "stream lost, COM_OBL_RC_ACT = 3", "RTL"),
        Transition("OFFBOARD", "stream lost, COM_OBL_RC_ACT = 4", "LAND"),
        Transition("OFFBOARD", "stream lost, COM_OBL_RC_ACT = 5", "HOLD"),
        Transition("OFFBOARD", "stream lost, COM_OBL_RC_ACT = 6", "TERMINATION"),
        Transition("OFFBOARD", "stream lost, COM_OBL_RC_ACT = 7", "disarmed"),
        Transition("POSCTL", "cannot run", "ALTCTL"),
        Transition("ALTCTL", "cannot run", "STABILIZED"),
        Transition("STABILIZED", "cannot run", "RTL"),
        Transition("MANUAL", "cannot run", "RTL"),
        Transition("ACRO", "cannot run", "RTL"),
        Transition("POSITION_SLOW", "cannot run", "ALTCTL"),
        Transition("ALTITUDE_CRUISE", "cannot run", "STABILIZED"),
        *(
            Transition(name, "cannot run", "RTL")
            for name in (
                "ORBIT",
                "FOLLOW",
                "PRECLAND",
                *(f"EXTERNAL{index}" for index in range(1, 9)),
            )
        ),
        Transition("HOLD", "cannot run", "LAND"),
        Transition("TAKEOFF", "cannot run", "LAND"),
        Transition("MISSION", "cannot run", "RTL"),
        Transition("RTL", "cannot run", "LAND"),
        Transition("LAND", "cannot run", "DESCEND"),
        Transition("DESCEND", "cannot run", "TERMINATION"),
        Transition(_ANY, "stick moved, COM_RC_OVERRIDE", "POSCTL"),
    ),
    rules=(
        "Disarmed, every mode is accepted as the intention. Armed, a mode that cannot run is refused "
        "(TEMPORARILY_REJECTED) and the old one stays.",
        "DO_SET_MODE and SET_MODE are answered twice: ACCEPTED at once, then the real result. Believe HEARTBEAT.",
        "An unknown mode and TERMINATION are ACCEPTED twice and change nothing; an unknown sub-mode of AUTO is "
        "TEMPORARILY_REJECTED.",
        "MISSION_START arms. If the first position of a mission is higher, the vehicle climbs to its height first.",
        "TAKEOFF ends `NAV_MC_ALT_RAD` below its height. Up to `MPC_LAND_ALT1` it climbs at `MPC_TKO_SPEED`, and "
        "its trajectory is never ahead of the vehicle: ordered to land, it rises about a metre more, as "
        "measured on the real one.",
        "Armed on the ground, every command to climb takes off: a stream, DO_REPOSITION, the throttle stick.",
        "HOLD interrupts LAND and RTL in the air. HOLD before the touchdown is detected (2.8 s) keeps it armed "
        "and hovering at the height of the ground.",
        "The intention survives a failsafe: when setpoints return, PX4 returns to OFFBOARD.",
        "A mode change by the pilot or a client ends a failsafe action.",
        "DO_FLIGHTTERMINATION or a failsafe enters TERMINATION; only a reboot leaves it.",
    ),
)

NAV_STATES: Final[Mapping[str, tuple[int, str]]] = {
    "MANUAL": (0, "Manual"),
    "ALTCTL": (1, "Altitude"),
    "POSCTL": (2, "Position"),
    "MISSION": (3, "Mission"),
    "HOLD": (4, "Hold"),
    "RTL": (5, "Return"),
    "POSITION_SLOW": (6, "Position Slow"),
    "ALTITUDE_CRUISE": (8, "Altitude Cruise"),
    "ACRO": (10, "Acro"),
    "DESCEND": (12, "Descend"),
    "TERMINATION": (13, "Termination"),
    "OFFBOARD": (14, "Offboard"),
    "STABILIZED": (15, "Stabilized"),
    "TAKEOFF": (17, "Takeoff"),
    "LAND": (18, "Land"),
    "FOLLOW": (19, "Follow Target"),
    "PRECLAND": (20, "Precision Landing"),
    "ORBIT": (21, "Orbit"),
    **{f"EXTERNAL{index}": (22 + index, f"External {index}") for index in range(1, 9)},
}
"""Number and name of each mode (``VehicleStatus.msg``, ``mode_util``)."""

BY_NAME: Final = MODES.by_name()
BY_NUMBER: Final = MODES.by_number()
AFTER: Final = MODES.after()
MANUAL_MODES: Final = frozenset(mode.name for mode in MODES.modes if mode.base_mode & 64)
"""Modes flown by the pilot's sticks."""


_CUSTOM = 1
_AUTO = 4
_GUIDED = 8
_STABILIZE = 16
_MANUAL = 64  # MAV_MODE_FLAG
_POSCTL_MAIN = 3
_AUTO_MAIN = 4
_TERMINATION_MAIN = 10
_SLOW_SUB = 2
_MISSION_SUB = 4
_WITHOUT_SUB: Final = frozenset({1, 2, 5, 6, 7, 11})
"""Main modes without sub-modes."""


TITLES: Final = {
    "ALTCTL": "Altitude",
    "POSCTL": "Position",
    "RTL": "Return",
    "FOLLOW": "Follow Target",
    "PRECLAND": "Precision Landing",
}
"""Names in PX4's texts, where they are not those of the table."""


class NotAMode(Enum):
    """Mode requests that name no mode."""

    IGNORED = "changes nothing"
    """PX4 answers ACCEPTED and keeps its mode."""
    REFUSED = "no such sub-mode"


def requested_mode(base_mode: int, main: int, sub: int) -> str | NotAMode:
    """Return the name of the requested mode, or why there is none."""
    mode: str | NotAMode = NotAMode.IGNORED
    if base_mode & _CUSTOM:
        if main in _WITHOUT_SUB:
            mode = BY_NUMBER[main << 16].name
        elif main == _POSCTL_MAIN:
            mode = "POSITION_SLOW" if sub == _SLOW_SUB else "POSCTL"
        elif main == _AUTO_MAIN:
            if sub == 0:
                sub = _MISSION_SUB
            known = BY_NUMBER.get(main << 16 | sub << 24)
            mode = NotAMode.REFUSED if known is None else known.name
    elif base_mode & _AUTO:
        mode = "MISSION"
    elif base_mode & _MANUAL:
        if base_mode & _GUIDED:
            mode = "POSCTL"
        else:
            mode = "STABILIZED" if base_mode & _STABILIZE else "MANUAL"
    return mode
