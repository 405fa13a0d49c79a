"""ArduCopter 4.7: what its sources and pull requests change of 4.5.7. Nothing is recorded; dynamics are 4.5.7's."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from sitl_mock.ardupilot.commander import ArduPilot
from sitl_mock.ardupilot.copter import COPTER
from sitl_mock.parameters import parameters_of
from sitl_mock.protocols import Result, ardupilot_identity

if TYPE_CHECKING:
    from sitl_mock.vehicle.flavour import Flavour

_MORE_COMMANDS: Final = {188: Result.FAILED, 5300: Result.ACCEPTED}
"""DO_RETURN_PATH_START, which fails without such a path, and DO_SET_SAFETY_SWITCH_STATE."""
_MORE_ITEMS: Final = frozenset({188, 195, 197})
"""DO_RETURN_PATH_START, DO_SET_ROI_LOCATION and DO_SET_ROI_NONE in missions."""
_FIRMWARE: Final = replace(COPTER, answers=_MORE_COMMANDS, banner="ArduCopter V4.7.0")
_MORE_MESSAGES: Final = frozenset({"AVAILABLE_MODES", "FLIGHT_INFORMATION", "HIGHRES_IMU"})


def arducopter_4_7(recorded: Flavour, version: str) -> Flavour:
    """Return 4.7 made from 4.5.7."""
    rules = recorded.mission_rules
    return replace(
        recorded,
        version=version,
        title="ArduCopter 4.7 quadrotor",
        parameters=parameters_of("arducopter", version),
        mission_rules=replace(rules, commands=rules.commands | _MORE_ITEMS),
        identity=lambda uid: replace(ardupilot_identity(uid), version=(4, 7, 0)),
        commander=lambda state, plans: ArduPilot(state, plans, _FIRMWARE),
        more_commands=frozenset(_MORE_COMMANDS),
        withheld=recorded.withheld - _MORE_MESSAGES,
    )
