"""ArduPilot Rover's parameters that the mock has: Rover 4.5 defaults."""

from __future__ import annotations

from typing import Final

from sitl_mock.parameters_ardupilot import COMMON, I8, I16, F
from sitl_mock.protocols.parameter import Parameter

_MODES: Final = tuple(
    Parameter(f"MODE{slot}", I8, mode, "", 0, 15, f"mode of switch position {slot}")
    for slot, mode in ((1, 10), (2, 11), (3, 12), (4, 0), (5, 4), (6, 0))
)

PARAMETERS: Final[tuple[Parameter, ...]] = (
    *COMMON,
    *_MODES,
    Parameter("FRAME_CLASS", I8, 1, "", 0, 3, "1 rover 2 boat 3 balance bot"),
    Parameter("INITIAL_MODE", I8, 0, "", 0, 15, "mode after start"),
    Parameter("CRUISE_SPEED", F, 2.0, "m/s", 0, 100, "speed of auto modes"),
    Parameter("CRUISE_THROTTLE", I8, 30, "%", 0, 100, "throttle at CRUISE_SPEED"),
    Parameter("WP_SPEED", F, 2.0, "m/s", 0, 100, "speed of missions"),
    Parameter("WP_RADIUS", F, 2.0, "m", 0, 100, "acceptance radius"),
    Parameter("WP_ACCEL", F, 0.0, "m/s^2", 0, 100, "acceleration of missions; 0 ATC_ACCEL_MAX"),
    Parameter("WP_PIVOT_ANGLE", F, 60.0, "deg", 0, 360, "turns on the spot above this angle"),
    Parameter("TURN_RADIUS", F, 0.9, "m", 0, 10, "smallest turn"),
    Parameter("RTL_SPEED", F, 0.0, "m/s", 0, 100, "speed of the return; 0 WP_SPEED"),
    Parameter("LOIT_TYPE", I8, 0, "", 0, 2, "heading in Loiter"),
    Parameter("LOIT_RADIUS", F, 2.0, "m", 0, 20, "drift allowed in Loiter"),
    Parameter("ATC_ACCEL_MAX", F, 1.0, "m/s^2", 0, 10, "greatest acceleration"),
    Parameter("ATC_DECEL_MAX", F, 0.0, "m/s^2", 0, 10, "greatest braking; 0 ATC_ACCEL_MAX"),
    Parameter("ATC_BRAKE", I8, 1, "", 0, 1, "brakes actively"),
    Parameter("ATC_STOP_SPEED", F, 0.1, "m/s", 0, 0.5, "stopped below this speed"),
    Parameter("ATC_SPEED_P", F, 0.2, "", 0.01, 2, "speed gain"),
    Parameter("ATC_SPEED_I", F, 0.2, "", 0, 2, "speed integrator"),
    Parameter("ATC_STR_ANG_P", F, 2.0, "", 1, 10, "heading gain"),
    Parameter("ATC_STR_RAT_MAX", F, 120.0, "deg/s", 0, 1000, "greatest turn rate"),
    Parameter("ATC_STR_RAT_P", F, 0.2, "", 0, 2, "turn rate gain"),
    Parameter("ATC_STR_ACC_MAX", F, 120.0, "deg/s^2", 0, 1000, "greatest turn acceleration"),
    Parameter("ATC_TURN_MAX_G", F, 0.6, "g", 0.1, 10, "greatest sideways acceleration"),
    Parameter("MOT_THR_MAX", I8, 100, "%", 5, 100, "greatest throttle"),
    Parameter("MOT_SLEWRATE", I16, 100, "%/s", 0, 1000, "throttle slew"),
    Parameter("FS_ACTION", I8, 2, "", 0, 6, "failsafe: 0 none 1 RTL 2 Hold"),
    Parameter("FS_TIMEOUT", F, 1.5, "s", 1, 100, "failsafe after this long"),
    Parameter("FS_THR_ENABLE", I8, 1, "", 0, 2, "radio loss"),
    Parameter("FS_THR_VALUE", I16, 910, "us", 910, 1100, "throttle below this is radio loss"),
    Parameter("FS_GCS_ENABLE", I8, 0, "", 0, 2, "ground station loss"),
    Parameter("FS_EKF_ACTION", I8, 1, "", 0, 2, "estimator failure: 1 Hold"),
    Parameter("FS_CRASH_CHECK", I8, 0, "", 0, 2, "after a crash: 0 none 1 Hold 2 disarm"),
    Parameter("FENCE_TYPE", I8, 6, "", 0, 15, "fence: bit 1 circle 2 polygon"),
    Parameter("FENCE_ACTION", I8, 1, "", 0, 4, "fence: 0 report 1 RTL or Hold 2 Hold"),
)
"""All of them; the index on the wire is the place in the order of names."""
