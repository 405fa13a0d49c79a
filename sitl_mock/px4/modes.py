"""PX4's modes and what it changes by itself, as one table (`px4_custom_mode.h`, measured on v1.17)."""

from typing import Final

from sitl_mock.modes import Mode, ModeTable, Need, Transition

_ANY = "any"
_POSITION = frozenset({Need.ALTITUDE, Need.LOCAL_POSITION})
_GLOBAL = _POSITION | {Need.GLOBAL_POSITION}
_AUTO = 1 | 4 | 8 | 16  # MAV_MODE_FLAG: custom, auto, guided, stabilize


def _number(main: int, sub: int = 0) -> int:
    return main << 16 | sub << 24


MODES: Final = ModeTable(
    title="PX4 (multicopter)",
    modes=(
        Mode("MANUAL", _number(1), frozenset({Need.PILOT}), True, 81, "sticks are tilt and thrust"),
        Mode("ALTCTL", _number(2), frozenset({Need.PILOT, Need.ALTITUDE}), True, 81, "height is held"),
        Mode("POSCTL", _number(3), _POSITION | {Need.PILOT}, True, 89, "sticks are velocities"),
        Mode("HOLD", _number(4, 3), _GLOBAL, True, _AUTO, "stops and stays"),
        Mode("TAKEOFF", _number(4, 2), _POSITION, True, _AUTO, "climbs to the height asked for"),
        Mode("MISSION", _number(4, 4), _GLOBAL | {Need.MISSION}, True, _AUTO, "flies the uploaded mission"),
        Mode("RTL", _number(4, 5), _GLOBAL | {Need.HOME}, False, _AUTO, "climbs, returns home, lands"),
        Mode("LAND", _number(4, 6), _POSITION, False, _AUTO, "lands here"),
        Mode("DESCEND", _number(4, 6), frozenset({Need.ALTITUDE}), False, _AUTO, "comes down without a position"),
        Mode("ACRO", _number(5), frozenset({Need.PILOT}), True, 65, "sticks are body rates"),
        Mode("OFFBOARD", _number(6), frozenset({Need.STREAM}), True, _AUTO, "follows SET_POSITION_TARGET and the like"),
        Mode(
            "STABILIZED", _number(7), frozenset({Need.PILOT}), True, 81, "sticks are tilt and thrust, level when free"
        ),
        Mode("TERMINATION", _number(10), frozenset(), False, 65, "motors off, for good"),
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
        "The intention survives a failsafe: when what was lost comes back, PX4 returns to OFFBOARD by itself.",
        "A failsafe action that the pilot or a client answers with a mode change is over.",
        "TERMINATION is entered by DO_FLIGHTTERMINATION or a failsafe, and left by a reboot only.",
    ),
)

BY_NAME: Final = MODES.by_name()
BY_NUMBER: Final = MODES.by_number()
AFTER: Final = MODES.after()
