"""Parameters that ArduPilot's copter and rover share: ArduPilot 4.5 defaults, ``copter.parm`` where it differs.

Source: the parameter reference of ArduPilot (ardupilot.org). ArduPilot does not enforce the documented limits.
"""

from __future__ import annotations

from typing import Final

from sitl_mock.protocols.parameter import Parameter, ParamKind

I8, I16, I32, F = ParamKind.INT8, ParamKind.INT16, ParamKind.INT32, ParamKind.REAL32

_STREAMS: Final = tuple(
    Parameter(f"SR{port}_{group}", I16, 0, "Hz", 0, 50, f"rate of stream {group} on link {port} until asked")
    for port in (0, 1)
    for group in ("EXT_STAT", "EXTRA1", "EXTRA2", "EXTRA3", "PARAMS", "POSITION", "RAW_CTRL", "RAW_SENS", "RC_CHAN")
)

COMMON: Final[tuple[Parameter, ...]] = (
    *_STREAMS,
    Parameter("FORMAT_VERSION", I16, 120, "", 0, 32767, "layout of the stored parameters"),
    Parameter("SYSID_THISMAV", I16, 1, "", 1, 255, "system id"),
    Parameter("SYSID_MYGCS", I16, 255, "", 1, 255, "system id of the ground station"),
    Parameter("TELEM_DELAY", I8, 0, "s", 0, 30, "silence after start"),
    Parameter("SERIAL0_PROTOCOL", I8, 2, "", -1, 50, "protocol of the first link: 2 MAVLink 2"),
    Parameter("SERIAL1_PROTOCOL", I8, 2, "", -1, 50, "protocol of the second link: 2 MAVLink 2"),
    Parameter("ARMING_REQUIRE", I8, 1, "", 0, 2, "arming is needed"),
    Parameter("ARMING_CHECK", I32, 1, "", 0, 2147483647, "checks before arming: bit 0 all"),
    Parameter("FS_GCS_TIMEOUT", F, 5.0, "s", 2, 120, "ground station is lost when its heartbeat is older"),
    Parameter("FS_EKF_THRESH", F, 0.8, "", 0, 1, "variance that fails the estimator"),
    Parameter("FENCE_ENABLE", I8, 0, "", 0, 1, "fence is on"),
    Parameter("FENCE_RADIUS", F, 300.0, "m", 30, 10000, "fence: circle around home"),
    Parameter("FENCE_MARGIN", F, 2.0, "m", 1, 10, "fence: margin"),
    Parameter("FENCE_TOTAL", I8, 0, "", 0, 127, "fence: number of points"),
    Parameter("RALLY_TOTAL", I16, 0, "", 0, 12, "rally points"),
    Parameter("RALLY_LIMIT_KM", F, 0.3, "km", 0, 100, "farthest rally point"),
    Parameter("MIS_TOTAL", I16, 0, "", 0, 32766, "mission items"),
    Parameter("MIS_RESTART", I8, 0, "", 0, 1, "mission starts anew when it is entered"),
    Parameter("BATT_MONITOR", I8, 4, "", 0, 25, "battery monitor"),
    Parameter("BATT_CAPACITY", I32, 3300, "mAh", 0, 1000000, "capacity"),
    Parameter("BATT_LOW_VOLT", F, 10.5, "V", 0, 120, "battery low"),
    Parameter("BATT_CRT_VOLT", F, 0.0, "V", 0, 120, "battery critical; 0 off"),
    Parameter("BATT_LOW_MAH", F, 0.0, "mAh", 0, 100000, "battery low by charge; 0 off"),
    Parameter("BATT_CRT_MAH", F, 0.0, "mAh", 0, 100000, "battery critical by charge; 0 off"),
    Parameter("BATT_LOW_TIMER", I8, 10, "s", 0, 120, "low for this long"),
    Parameter("BATT_FS_LOW_ACT", I8, 0, "", 0, 7, "action at low battery: 0 none 1 Land 2 RTL"),
    Parameter("BATT_FS_CRT_ACT", I8, 0, "", 0, 7, "action at critical battery: 0 none 1 Land 2 RTL"),
    Parameter("EK3_ENABLE", I8, 1, "", 0, 1, "estimator EKF3"),
    Parameter("EK2_ENABLE", I8, 0, "", 0, 1, "estimator EKF2"),
    Parameter("AHRS_EKF_TYPE", I8, 3, "", 0, 11, "estimator in use"),
    Parameter("GPS_TYPE", I8, 1, "", 0, 25, "first GPS"),
    Parameter("COMPASS_USE", I8, 1, "", 0, 1, "compass is used"),
    Parameter("COMPASS_OFS_X", F, 5.0, "mGauss", -400, 400, "compass is calibrated"),
    Parameter("COMPASS_OFS_Y", F, 13.0, "mGauss", -400, 400, "compass is calibrated"),
    Parameter("COMPASS_OFS_Z", F, -18.0, "mGauss", -400, 400, "compass is calibrated"),
    Parameter("INS_ACCOFFS_X", F, 0.001, "m/s^2", -3.5, 3.5, "accelerometer is calibrated"),
    Parameter("INS_ACCOFFS_Y", F, 0.001, "m/s^2", -3.5, 3.5, "accelerometer is calibrated"),
    Parameter("INS_ACCOFFS_Z", F, 0.001, "m/s^2", -3.5, 3.5, "accelerometer is calibrated"),
    Parameter("INS_GYROFFS_X", F, 0.0, "rad/s", -1, 1, "gyro is calibrated"),
    Parameter("LOG_BACKEND_TYPE", I8, 1, "", 0, 7, "logging"),
    Parameter("LOG_BITMASK", I32, 176126, "", 0, 2147483647, "what is logged"),
    Parameter("SCHED_LOOP_RATE", I16, 400, "Hz", 50, 400, "main loop"),
    Parameter("STAT_BOOTCNT", I16, 1, "", 0, 32767, "number of starts"),
    Parameter("FOLL_ENABLE", I8, 0, "", 0, 1, "follow is on"),
)
"""The shared ones."""
