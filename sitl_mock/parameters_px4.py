"""PX4's parameters that the mock has: PX4 v1.17 defaults of a SIH quadrotor.

Commander, navigator, gains, limits, take-off and landing were checked value by value against PX4's definitions
(``*_params.yaml``). The limits are the documented ones; PX4 itself does not enforce them.
"""

from __future__ import annotations

from typing import Final

from sitl_mock.protocols.parameter import Parameter, ParamKind

_I, _F = ParamKind.INT32, ParamKind.REAL32

_COMMANDER: Final = (
    Parameter("COM_OF_LOSS_T", _F, 1.0, "s", 0, 60, "offboard signal is lost when the last setpoint is older"),
    Parameter(
        "COM_OBL_RC_ACT", _I, 0, "", 0, 7, "mode after offboard loss: 0 Position … 3 Return 4 Land 5 Hold 7 Disarm"
    ),
    Parameter("COM_FAIL_ACT_T", _F, 5.0, "s", 0, 25, "Hold before a failsafe action of RC, GCS or battery"),
    Parameter("COM_RC_OVERRIDE", _I, 1, "", 0, 3, "stick override: bit 0 auto modes, bit 1 offboard"),
    Parameter("COM_RC_STICK_OV", _F, 30.0, "%", 5, 80, "stick deflection that overrides"),
    Parameter("COM_RC_LOSS_T", _F, 0.5, "s", 0, 35, "manual control is lost when it is older"),
    Parameter("COM_RC_IN_MODE", _I, 3, "", 0, 8, "manual control: 0 RC 1 joystick 2 both 3 first valid 4 none"),
    Parameter("COM_RCL_EXCEPT", _I, 0, "", 0, 31, "modes that ignore RC loss: bit 0 Mission 1 auto modes 2 Offboard"),
    Parameter("NAV_RCL_ACT", _I, 2, "", 1, 6, "RC loss: 1 Hold 2 Return 3 Land 5 Terminate 6 Disarm"),
    Parameter("COM_DL_LOSS_T", _I, 10, "s", 5, 300, "ground station is lost when its heartbeat is older"),
    Parameter(
        "NAV_DLL_ACT", _I, 0, "", 0, 6, "ground station loss: 0 none 1 Hold 2 Return 3 Land 5 Terminate 6 Disarm"
    ),
    Parameter("COM_DLL_EXCEPT", _I, 0, "", 0, 31, "modes that ignore ground station loss: bits as COM_RCL_EXCEPT"),
    Parameter("COM_OBC_LOSS_T", _F, 5.0, "s", 0, 60, "companion's heartbeat is lost: warning only"),
    Parameter("COM_LOW_BAT_ACT", _I, 0, "", 0, 3, "low battery: 0 warning 2 Land 3 Return, then Land"),
    Parameter("COM_DISARM_PRFLT", _F, 10.0, "s", -1, 60, "disarms if not taken off; -1 off"),
    Parameter("COM_DISARM_LAND", _F, 2.0, "s", -1, 60, "disarms after landing; -1 off"),
    Parameter("COM_SPOOLUP_TIME", _F, 1.0, "s", 0, 30, "no take-off for this long after arming"),
    Parameter("COM_ARM_WO_GPS", _I, 1, "", 0, 2, "arming without GPS: 0 refused 1 warning 2 allowed"),
    Parameter("COM_ARM_MAG_STR", _I, 2, "", 0, 2, "magnetic field check"),
    Parameter("COM_ARM_BAT_MIN", _F, -1.0, "norm", -1, 0.9, "least charge for arming; -1 takes BAT_CRIT_THR"),
    Parameter("COM_ARMABLE", _I, 1, "", 0, 1, "arming is possible at all"),
    Parameter("COM_PREARM_MODE", _I, 0, "", 0, 2, "actuators before arming"),
    Parameter("COM_POS_FS_EPH", _F, 5.0, "m", -1, 400, "horizontal position error that fails the position"),
    Parameter("COM_VEL_FS_EVH", _F, 1.0, "m/s", 0, 100, "horizontal velocity error that fails the velocity"),
    Parameter("COM_TAKEOFF_ACT", _I, 0, "", 0, 1, "after take-off: 0 Hold 1 Mission"),
    Parameter("COM_HOME_EN", _I, 1, "", 0, 1, "home position is set by itself"),
    Parameter("COM_MODE_ARM_CHK", _I, 0, "", 0, 1, "external modes may register while armed"),
    Parameter("CBRK_SUPPLY_CHK", _I, 0, "", 0, 894281, "894281 switches the supply check off"),
    Parameter("CBRK_IO_SAFETY", _I, 22027, "", 0, 22027, "22027 switches the safety switch off"),
    Parameter("CBRK_FLIGHTTERM", _I, 121212, "", 0, 121212, "121212 switches flight termination off"),
)

_LIMITS_AND_FENCE: Final = (
    Parameter("GF_ACTION", _I, 2, "", 0, 5, "fence: 0 none 1 warning 2 Hold 3 Return 4 Terminate 5 Land"),
    Parameter("GF_MAX_HOR_DIST", _F, 0.0, "m", 0, 10000, "fence: distance from home; 0 off"),
    Parameter("GF_MAX_VER_DIST", _F, 0.0, "m", 0, 10000, "fence: height above home; 0 off"),
    Parameter("GF_PREDICT", _I, 0, "", 0, 1, "fence is tested ahead"),
    Parameter("GF_SOURCE", _I, 0, "", 0, 1, "fence is tested on 0 the estimate 1 GPS"),
    Parameter("LNDMC_XY_VEL_MAX", _F, 1.5, "m/s", 0, 100, "landed below this horizontal speed"),
    Parameter("LNDMC_Z_VEL_MAX", _F, 0.25, "m/s", 0, 100, "landed below this vertical speed"),
    Parameter("BAT_LOW_THR", _F, 0.15, "norm", 0.12, 0.5, "battery low"),
    Parameter("BAT_CRIT_THR", _F, 0.07, "norm", 0.05, 0.5, "battery critical"),
    Parameter("BAT_EMERGEN_THR", _F, 0.05, "norm", 0.03, 0.5, "battery emergency"),
    Parameter("BAT1_N_CELLS", _I, 4, "", 0, 16, "cells of the battery"),
    Parameter("BAT1_V_CHARGED", _F, 4.05, "V", 0, 5, "full cell"),
    Parameter("BAT1_V_EMPTY", _F, 3.6, "V", 0, 5, "empty cell"),
    Parameter("BAT1_CAPACITY", _F, -1.0, "mAh", -1, 100000, "capacity; -1 unknown"),
    Parameter("FD_FAIL_R", _I, 60, "deg", 0, 180, "roll that fails the attitude"),
    Parameter("FD_FAIL_P", _I, 60, "deg", 0, 180, "pitch that fails the attitude"),
    Parameter("EKF2_NOAID_TOUT", _I, 5000000, "us", 500000, 10000000, "position is invalid without aid for this long"),
    Parameter("EKF2_GPS_CTRL", _I, 7, "", 0, 15, "GPS aiding: bit 0 position 1 altitude 2 velocity 3 heading"),
    Parameter("EKF2_HGT_REF", _I, 1, "", 0, 3, "height: 0 baro 1 GPS 2 range 3 vision"),
)

_MULTICOPTER: Final = (
    Parameter("MPC_XY_VEL_MAX", _F, 12.0, "m/s", 0, 20, "greatest horizontal speed; cuts offboard setpoints"),
    Parameter("MPC_Z_VEL_MAX_UP", _F, 3.0, "m/s", 0.5, 8, "greatest climb; cuts offboard setpoints"),
    Parameter("MPC_Z_VEL_MAX_DN", _F, 1.5, "m/s", 0.5, 4, "greatest descent; cuts offboard setpoints"),
    Parameter("MPC_XY_CRUISE", _F, 5.0, "m/s", 3, 20, "speed in missions"),
    Parameter("MPC_Z_V_AUTO_UP", _F, 3.0, "m/s", 0.5, 8, "climb in auto modes"),
    Parameter("MPC_Z_V_AUTO_DN", _F, 1.5, "m/s", 0.5, 4, "descent in auto modes"),
    Parameter("MPC_VEL_MANUAL", _F, 10.0, "m/s", 3, 20, "speed at full stick"),
    Parameter("MPC_ACC_HOR", _F, 3.0, "m/s^2", 2, 15, "horizontal acceleration in auto modes"),
    Parameter("MPC_ACC_HOR_MAX", _F, 5.0, "m/s^2", 2, 15, "horizontal acceleration in Position mode"),
    Parameter("MPC_ACC_UP_MAX", _F, 4.0, "m/s^2", 2, 15, "upward acceleration in auto modes"),
    Parameter("MPC_ACC_DOWN_MAX", _F, 3.0, "m/s^2", 2, 15, "downward acceleration in auto modes"),
    Parameter("MPC_JERK_AUTO", _F, 4.0, "m/s^3", 1, 80, "jerk in auto modes"),
    Parameter("MPC_JERK_MAX", _F, 8.0, "m/s^3", 0.5, 500, "jerk in Position mode"),
    Parameter("MPC_XY_P", _F, 0.95, "", 0, 2, "horizontal position gain"),
    Parameter("MPC_Z_P", _F, 1.0, "", 0.1, 1.5, "vertical position gain"),
    Parameter("MPC_XY_VEL_P_ACC", _F, 1.8, "", 1.2, 5, "horizontal velocity gain"),
    Parameter("MPC_XY_VEL_I_ACC", _F, 0.4, "", 0, 60, "horizontal velocity integrator"),
    Parameter("MPC_XY_VEL_D_ACC", _F, 0.2, "", 0.1, 2, "horizontal velocity derivative"),
    Parameter("MPC_Z_VEL_P_ACC", _F, 4.0, "", 2, 15, "vertical velocity gain"),
    Parameter("MPC_Z_VEL_I_ACC", _F, 2.0, "", 0.2, 3, "vertical velocity integrator"),
    Parameter("MPC_Z_VEL_D_ACC", _F, 0.0, "", 0, 2, "vertical velocity derivative"),
    Parameter("MPC_TILTMAX_AIR", _F, 45.0, "deg", 20, 89, "greatest tilt in flight"),
    Parameter("MPC_TILTMAX_LND", _F, 12.0, "deg", 5, 89, "greatest tilt while thrust ramps up at take-off"),
    Parameter("MPC_THR_HOVER", _F, 0.5, "norm", 0.1, 0.8, "thrust in hover"),
    Parameter("MPC_THR_MIN", _F, 0.12, "norm", 0.05, 0.5, "least thrust"),
    Parameter("MPC_THR_MAX", _F, 1.0, "norm", 0, 1, "greatest thrust"),
    Parameter("MPC_USE_HTE", _I, 1, "", 0, 1, "hover thrust is estimated"),
    Parameter("MPC_POS_MODE", _I, 4, "", 0, 4, "sticks in Position mode"),
    Parameter("MPC_MAN_Y_MAX", _F, 150.0, "deg/s", 0, 400, "yaw rate at full stick"),
    Parameter("MPC_YAWRAUTO_MAX", _F, 60.0, "deg/s", 5, 360, "yaw rate in auto modes"),
    Parameter("MPC_YAW_MODE", _I, 0, "", 0, 5, "heading in auto modes"),
    Parameter("MPC_TKO_SPEED", _F, 1.5, "m/s", 1, 5, "climb at take-off"),
    Parameter("MPC_TKO_RAMP_T", _F, 3.0, "s", 0, 5, "thrust ramp at take-off"),
    Parameter("MPC_LAND_SPEED", _F, 0.7, "m/s", 0.6, 10, "descent below MPC_LAND_ALT2"),
    Parameter("MPC_LAND_CRWL", _F, 0.3, "m/s", 0.1, 10, "descent near the ground with a range finder"),
    Parameter("MPC_LAND_ALT1", _F, 10.0, "m", 0, 122, "below this the descent slows"),
    Parameter("MPC_LAND_ALT2", _F, 5.0, "m", 0, 122, "below this it is MPC_LAND_SPEED"),
    Parameter("MC_ROLL_P", _F, 6.5, "", 0, 12, "roll gain"),
    Parameter("MC_PITCH_P", _F, 6.5, "", 0, 12, "pitch gain"),
    Parameter("MC_YAW_P", _F, 2.8, "", 0, 5, "yaw gain"),
)

_NAVIGATION: Final = (
    Parameter("MIS_TAKEOFF_ALT", _F, 2.5, "m", 0, 80, "height of a take-off that names none"),
    Parameter("MIS_DIST_1WP", _F, 10000.0, "m", -1, 100000, "greatest distance to the first item"),
    Parameter("MIS_YAW_TMT", _F, -1.0, "s", -1, 20, "time to reach a yaw"),
    Parameter("NAV_ACC_RAD", _F, 10.0, "m", 0.05, 200, "acceptance radius"),
    Parameter("NAV_MC_ALT_RAD", _F, 0.8, "m", 0.05, 200, "vertical acceptance radius"),
    Parameter("RTL_RETURN_ALT", _F, 60.0, "m", 0, 10000, "height of the return"),
    Parameter("RTL_DESCEND_ALT", _F, 30.0, "m", 0, 10000, "height to descend to above home"),
    Parameter("RTL_LAND_DELAY", _F, 0.0, "s", -1, 10000, "wait above home; -1 for ever"),
    Parameter("RTL_CONE_ANG", _I, 45, "deg", 0, 90, "half angle of the return cone"),
    Parameter("RTL_MIN_DIST", _F, 10.0, "m", 0.5, 100, "nearer than this returns without climbing"),
    Parameter("RTL_TYPE", _I, 0, "", 0, 5, "kind of return"),
    Parameter("FLW_TGT_RS", _F, 0.1, "", 0, 1, "follow: responsiveness"),
    Parameter("FLW_TGT_HT", _F, 8.0, "m", 8, 1000, "follow: height"),
    Parameter("FLW_TGT_DST", _F, 8.0, "m", 1, 1000, "follow: distance"),
    Parameter("FLW_TGT_FA", _F, 180.0, "deg", -180, 180, "follow: angle"),
    Parameter("FLW_TGT_ALT_M", _I, 0, "", 0, 2, "follow: altitude mode"),
    Parameter("FLW_TGT_MAX_VEL", _F, 5.0, "m/s", 0, 20, "follow: greatest speed"),
)

_SYSTEM: Final = (
    Parameter("MAV_SYS_ID", _I, 1, "", 1, 250, "system id"),
    Parameter("MAV_COMP_ID", _I, 1, "", 1, 250, "component id"),
    Parameter("MAV_TYPE", _I, 2, "", 0, 22, "MAV_TYPE"),
    Parameter("MAV_PROTO_VER", _I, 0, "", 0, 2, "MAVLink version: 0 follows the peer"),
    Parameter("MAV_0_MODE", _I, 0, "", 0, 13, "streams of the first link"),
    Parameter("MAV_0_RATE", _I, 1200, "B/s", 0, 1000000, "bandwidth of the first link"),
    Parameter("MAV_HASH_CHK_EN", _I, 1, "", 0, 1, "parameter hash is sent"),
    Parameter("MAV_USEHILGPS", _I, 0, "", 0, 1, "HIL GPS is used"),
    Parameter("SYS_AUTOSTART", _I, 10040, "", 0, 9999999, "airframe; 10040 is the SIH quadrotor"),
    Parameter("SYS_AUTOCONFIG", _I, 0, "", 0, 1, "reset to the airframe's defaults"),
    Parameter("SYS_HAS_GPS", _I, 1, "", 0, 1, "has a GPS"),
    Parameter("SYS_HAS_MAG", _I, 1, "", 0, 10, "number of compasses"),
    Parameter("SYS_HAS_BARO", _I, 1, "", 0, 1, "has a barometer"),
    Parameter("SDLOG_MODE", _I, 0, "", -1, 4, "logging"),
    Parameter("CAL_ACC0_ID", _I, 1310988, "", 0, 2147483647, "accelerometer is calibrated"),
    Parameter("CAL_GYRO0_ID", _I, 1310988, "", 0, 2147483647, "gyro is calibrated"),
    Parameter("CAL_MAG0_ID", _I, 197388, "", 0, 2147483647, "compass is calibrated"),
    Parameter("CAL_MAG0_ROT", _I, 0, "", -1, 40, "compass rotation"),
    Parameter("SENS_BOARD_ROT", _I, 0, "", -1, 40, "board rotation"),
    Parameter("SIH_MASS", _F, 1.0, "kg", 0, 100, "simulated mass"),
    Parameter("SIH_KDV", _F, 1.0, "N/(m/s)", 0, 10, "simulated drag"),
    Parameter("SIH_T_MAX", _F, 5.0, "N", 0, 100, "simulated thrust of one rotor"),
)

PARAMETERS: Final[tuple[Parameter, ...]] = (*_COMMANDER, *_LIMITS_AND_FENCE, *_MULTICOPTER, *_NAVIGATION, *_SYSTEM)
"""All of them; the index on the wire is the place in the order of names."""
