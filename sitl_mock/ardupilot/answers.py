"""ArduCopter 4.5.7's answers to commands without effect in the mock, measured on the ground with all parameters 0.

Commands neither here nor in `commands` are UNSUPPORTED.

Calibrations give the results and texts of ArduCopter 4.5.7's simulator, which calibrates nothing.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sitl_mock.protocols import Command, CommandAnswer, Result
from sitl_mock.vehicle.state import Severity

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sitl_mock.ardupilot.commander import ArduPilot
    from sitl_mock.protocols.command import Answers

_ACCEPTED: Final = (
    181,
    182,
    198,
    202,
    203,
    206,
    208,
    209,
    216,
    2001,
    2520,
    2600,
    32000,
    42001,
    42651,
)
_FAILED: Final = (
    184,
    204,
    205,
    211,
    218,
    500,
    601,
    1000,
    1001,
    2000,
    2500,
    2501,
    10001,
    42600,
)
_DENIED: Final = (32, 532, 534, 42007, 42700)

ANSWERED: Mapping[int, Result] = MappingProxyType(
    {
        **dict.fromkeys(_ACCEPTED, Result.ACCEPTED),
        **dict.fromkeys(_FAILED, Result.FAILED),
        **dict.fromkeys(_DENIED, Result.DENIED),
    }
)
"""MAV_RESULT by number of MAV_CMD."""


PREFLIGHT = 241
MAG_YAW = 42006
MAG_START = 42424
MAG_ACCEPT = 42425
MAG_CANCEL = 42426
ACCEL_POSITION = 42429
CALIBRATIONS: Final = frozenset(
    {PREFLIGHT, MAG_YAW, MAG_START, MAG_ACCEPT, MAG_CANCEL, ACCEL_POSITION}
)
_ACCEL = 1
_LEVEL = 2
_SIMPLE = 4
_ANSWERED: Mapping[int, Result] = MappingProxyType(
    {
        MAG_YAW: Result.ACCEPTED,
        MAG_START: Result.ACCEPTED,
        MAG_ACCEPT: Result.FAILED,
        MAG_CANCEL: Result.ACCEPTED,
        ACCEL_POSITION: Result.FAILED,
    }
)
"""MAV_RESULT of the calibration commands; MAG_ACCEPT fails because no calibration ever finishes."""


def answer_calibration(commander: ArduPilot, command: Command) -> Answers:
    """Answer a calibration command; refused while armed."""
    if commander.state.armed:
        compass = command.number != PREFLIGHT
        commander.state.say(
            Severity.NOTICE, f"Disarm to allow {'compass ' if compass else ''}calibration"
        )
        return (CommandAnswer(Result.FAILED),)
    if command.number != PREFLIGHT:
        return (CommandAnswer(_ANSWERED[command.number]),)
    gyro, _, baro, _, accel, motors, _ = (
        int(value) if abs(value) < 1e6 else 0 for value in command.params
    )
    # The first sensor that the command names is calibrated.
    answers: Answers = (CommandAnswer(Result.ACCEPTED),)
    texts: Sequence[str] = ()
    if gyro == 1:
        texts = ("Initialising ArduPilot",)
    elif baro == 1:
        texts = ("Updating barometer calibration", "Barometer calibration complete")
        answers = (CommandAnswer(Result.IN_PROGRESS), CommandAnswer(Result.ACCEPTED, delay_s=1.0))
    elif accel == _ACCEL:
        texts = ("Initialising ArduPilot", "Place vehicle level and press any key.")
    elif accel == _LEVEL:
        texts = ("Initialising ArduPilot", "Trim OK: roll=0.01 pitch=-0.00 yaw=0.00")
    elif accel == _SIMPLE:
        answers = (CommandAnswer(Result.TEMPORARILY_REJECTED),)
    elif not accel and motors == 1:
        texts = ("Starting calibration", "Current")
    else:
        answers = (CommandAnswer(Result.UNSUPPORTED),)
    for text in texts:
        commander.state.say(Severity.INFO, text)
    return answers


ANSWERED_WITH_ONE: Mapping[int, Result] = MappingProxyType(
    {
        **dict.fromkeys((32, 42007, 42701), Result.ACCEPTED),
        **dict.fromkeys((181, 182, 526, 532, 32000), Result.FAILED),
        2001: Result.UNSUPPORTED,
    }
)
"""Answers that differ when all parameters are 1."""
