"""ArduCopter's parameters that the mock has: ArduCopter 4.5.7 defaults, ``copter.parm`` where it differs."""

from __future__ import annotations

from typing import Final

from sitl_mock.parameters_ardupilot import COMMON, I8, I16, I32, F
from sitl_mock.protocols.parameter import Parameter

_MODES: Final = tuple(
    Parameter(f"FLTMODE{slot}", I8, mode, "", 0, 28, f"mode of switch position {slot}")
    for slot, mode in ((1, 7), (2, 9), (3, 6), (4, 3), (5, 5), (6, 0))
)

PARAMETERS: Final[tuple[Parameter, ...]] = (
    *COMMON,
    *_MODES,
    Parameter("FRAME_CLASS", I8, 1, "", 0, 17, "1 quadrotor"),
    Parameter("FRAME_TYPE", I8, 0, "", 0, 19, "0 plus 1 X"),
    Parameter("GUID_TIMEOUT", F, 3.0, "s", 0.1, 5, "a velocity without renewal is braked after this long"),
    Parameter("GUID_OPTIONS", I32, 0, "", 0, 255, "bit 0 arming from TX, 3 thrust, 6 waypoint navigation"),
    Parameter("WPNAV_SPEED", F, 1000.0, "cm/s", 20, 2000, "horizontal speed of missions"),
    Parameter("WPNAV_SPEED_UP", F, 250.0, "cm/s", 10, 1000, "climb of missions"),
    Parameter("WPNAV_SPEED_DN", F, 150.0, "cm/s", 10, 500, "descent of missions"),
    Parameter("WPNAV_ACCEL", F, 250.0, "cm/s^2", 50, 500, "horizontal acceleration"),
    Parameter("WPNAV_ACCEL_Z", F, 100.0, "cm/s^2", 50, 500, "vertical acceleration"),
    Parameter("WPNAV_JERK", F, 1.0, "m/s^3", 1, 20, "horizontal jerk"),
    Parameter("WPNAV_RADIUS", F, 200.0, "cm", 5, 1000, "acceptance radius"),
    Parameter("WP_YAW_BEHAVIOR", I8, 2, "", 0, 3, "heading in auto modes"),
    Parameter("LOIT_SPEED", F, 1250.0, "cm/s", 20, 3500, "speed in Loiter"),
    Parameter("LOIT_ACC_MAX", F, 500.0, "cm/s^2", 100, 981, "acceleration in Loiter"),
    Parameter("LOIT_BRK_ACCEL", F, 250.0, "cm/s^2", 25, 250, "braking in Loiter"),
    Parameter("LOIT_BRK_DELAY", F, 1.0, "s", 0, 2, "delay of braking in Loiter"),
    Parameter("LOIT_BRK_JERK", F, 500.0, "cm/s^3", 500, 5000, "jerk of braking in Loiter"),
    Parameter("PSC_POSXY_P", F, 1.0, "", 0.5, 2, "horizontal position gain"),
    Parameter("PSC_VELXY_P", F, 2.0, "", 0.1, 6, "horizontal velocity gain"),
    Parameter("PSC_VELXY_I", F, 1.0, "", 0.02, 1, "horizontal velocity integrator"),
    Parameter("PSC_VELXY_D", F, 0.5, "", 0, 1, "horizontal velocity derivative"),
    Parameter("PSC_POSZ_P", F, 1.0, "", 0.5, 4, "vertical position gain"),
    Parameter("PSC_VELZ_P", F, 5.0, "", 1, 8, "vertical velocity gain"),
    Parameter("PSC_JERK_XY", F, 5.0, "m/s^3", 1, 20, "horizontal jerk of the position controller"),
    Parameter("PSC_JERK_Z", F, 5.0, "m/s^3", 5, 50, "vertical jerk of the position controller"),
    Parameter("PSC_ANGLE_MAX", F, 0.0, "deg", 0, 45, "lean limit of the position controller; 0 ANGLE_MAX"),
    Parameter("ANGLE_MAX", I16, 3000, "cdeg", 1000, 8000, "greatest lean"),
    Parameter("ATC_ANG_RLL_P", F, 4.5, "", 3, 12, "roll gain"),
    Parameter("ATC_ANG_PIT_P", F, 4.5, "", 3, 12, "pitch gain"),
    Parameter("ATC_ANG_YAW_P", F, 4.5, "", 3, 12, "yaw gain"),
    Parameter("ATC_SLEW_YAW", F, 6000.0, "cdeg/s", 500, 18000, "yaw rate in auto modes"),
    Parameter("ATC_INPUT_TC", F, 0.15, "s", 0, 1, "time constant of attitude inputs"),
    Parameter("PILOT_SPEED_UP", I16, 250, "cm/s", 50, 500, "climb at full stick"),
    Parameter("PILOT_SPEED_DN", I16, 0, "cm/s", 0, 500, "descent at full stick; 0 as PILOT_SPEED_UP"),
    Parameter("PILOT_ACCEL_Z", I16, 250, "cm/s^2", 50, 500, "vertical acceleration of the pilot"),
    Parameter("PILOT_TKOFF_ALT", F, 0.0, "cm", 0, 1000, "height of a pilot's take-off"),
    Parameter("PILOT_THR_FILT", F, 0.0, "Hz", 0, 10, "throttle filter"),
    Parameter("LAND_SPEED", I16, 50, "cm/s", 30, 200, "descent at the end of a landing"),
    Parameter("LAND_SPEED_HIGH", I16, 0, "cm/s", 0, 500, "descent before that; 0 WPNAV_SPEED_DN"),
    Parameter("LAND_ALT_LOW", I16, 1000, "cm", 100, 10000, "height at which a landing slows"),
    Parameter("LAND_REPOSITION", I8, 1, "", 0, 1, "pilot may move a landing"),
    Parameter("RTL_ALT", I32, 1500, "cm", 30, 300000, "least height of the return"),
    Parameter("RTL_ALT_FINAL", I16, 0, "cm", 0, 1000, "height above home at the end; 0 lands"),
    Parameter("RTL_CONE_SLOPE", F, 3.0, "", 0.5, 10, "slope of the return cone"),
    Parameter("RTL_SPEED", I16, 0, "cm/s", 0, 2000, "speed of the return; 0 WPNAV_SPEED"),
    Parameter("RTL_LOIT_TIME", I32, 5000, "ms", 0, 60000, "wait above home"),
    Parameter("RTL_CLIMB_MIN", I16, 0, "cm", 0, 3000, "least climb of the return"),
    Parameter("FS_THR_ENABLE", I8, 1, "", 0, 7, "radio loss: 0 none 1 RTL 3 Land"),
    Parameter("FS_THR_VALUE", I16, 975, "us", 910, 1100, "throttle below this is radio loss"),
    Parameter("FS_GCS_ENABLE", I8, 0, "", 0, 7, "ground station loss: 0 none 1 RTL 5 Land"),
    Parameter("FS_EKF_ACTION", I8, 1, "", 0, 3, "estimator failure: 1 Land 2 AltHold 3 Land always"),
    Parameter("FS_CRASH_CHECK", I8, 1, "", 0, 1, "disarms after a crash"),
    Parameter("FS_OPTIONS", I32, 16, "", 0, 63, "exceptions from failsafes"),
    Parameter("DISARM_DELAY", I8, 10, "s", 0, 127, "disarms on the ground after this long"),
    Parameter("FENCE_TYPE", I8, 7, "", 0, 15, "fence: bit 0 height 1 circle 2 polygon 3 floor"),
    Parameter("FENCE_ACTION", I8, 1, "", 0, 5, "fence: 0 report 1 RTL or Land 2 Land 4 Brake"),
    Parameter("FENCE_ALT_MAX", F, 100.0, "m", 10, 1000, "fence: height"),
    Parameter("FENCE_ALT_MIN", F, -10.0, "m", -100, 100, "fence: floor"),
    Parameter("AVOID_ENABLE", I8, 3, "", 0, 7, "avoidance"),
    Parameter("CIRCLE_RADIUS", F, 1000.0, "cm", 0, 200000, "radius of Circle"),
    Parameter("CIRCLE_RATE", F, 20.0, "deg/s", -90, 90, "rate of Circle"),
    Parameter("SUPER_SIMPLE", I8, 0, "", 0, 63, "super simple modes"),
    Parameter("SIMPLE", I8, 0, "", 0, 63, "simple modes"),
    Parameter("MOT_SPIN_ARM", F, 0.1, "", 0, 1, "motors when armed"),
    Parameter("MOT_SPIN_MIN", F, 0.15, "", 0, 0.3, "motors at least"),
    Parameter("MOT_THST_HOVER", F, 0.39, "", 0.125, 0.6875, "thrust in hover"),
    Parameter("TKOFF_SLEW_TIME", F, 2.0, "s", 0.25, 5, "thrust ramp at take-off"),
)
"""All of them; the index on the wire is the place in the order of names."""
