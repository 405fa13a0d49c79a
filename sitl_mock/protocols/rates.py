"""Stream rates of the real links, in hertz, and each flavour's rules.

Measured on PX4 v1.17.0 (SIH), on its onboard link (14540) and its ground station's (14550), and on ArduCopter 4.5.7.
"""

from __future__ import annotations

from typing import Final

from sitl_mock.protocols.command import Result
from sitl_mock.protocols.streams import StreamRules

PX4_ONBOARD_HZ: Final[dict[str, float]] = {
    "HEARTBEAT": 1.0,
    "ATTITUDE": 100.0,
    "ATTITUDE_QUATERNION": 50.0,
    "GLOBAL_POSITION_INT": 50.0,
    "HIGHRES_IMU": 50.0,
    "LOCAL_POSITION_NED": 30.0,
    "ODOMETRY": 30.0,
    "ALTITUDE": 10.0,
    "ATTITUDE_TARGET": 10.0,
    "POSITION_TARGET_LOCAL_NED": 10.0,
    "SERVO_OUTPUT_RAW": 10.0,
    "VFR_HUD": 10.0,
    "TIMESYNC": 10.0,
    "DISTANCE_SENSOR": 10.0,
    "GPS_RAW_INT": 8.0,
    "SYS_STATUS": 5.0,
    "EXTENDED_SYS_STATE": 5.0,
    "POSITION_TARGET_GLOBAL_INT": 10.0,
    "ESTIMATOR_STATUS": 1.0,
    "PING": 1.0,
    "SYSTEM_TIME": 1.0,
    "MISSION_CURRENT": 1.0,
    "SCALED_PRESSURE": 1.0,
    "OPEN_DRONE_ID_LOCATION": 1.0,
    "OPEN_DRONE_ID_SYSTEM": 1.0,
    "GNSS_INTEGRITY": 1.0,
    "LINK_NODE_STATUS": 1.0,
    "HOME_POSITION": 0.5,
    "BATTERY_STATUS": 0.5,
    "CURRENT_MODE": 0.5,
    "VIBRATION": 0.5,
    "TIME_ESTIMATE_TO_TARGET": 0.5,
    "CURRENT_EVENT_SEQUENCE": 1.0 / 3.0,
}

PX4_GCS_HZ: Final[dict[str, float]] = {
    "HEARTBEAT": 1.0,
    "ATTITUDE": 50.0,
    "ATTITUDE_QUATERNION": 50.0,
    "ATTITUDE_TARGET": 50.0,
    "GLOBAL_POSITION_INT": 50.0,
    "LOCAL_POSITION_NED": 50.0,
    "POSITION_TARGET_LOCAL_NED": 50.0,
    "SERVO_OUTPUT_RAW": 50.0,
    "GPS_RAW_INT": 5.0,
    "POSITION_TARGET_GLOBAL_INT": 5.0,
    "VFR_HUD": 4.0,
    "ALTITUDE": 1.0,
    "SYS_STATUS": 1.0,
    "EXTENDED_SYS_STATE": 1.0,
    "MISSION_CURRENT": 1.0,
    "SCALED_PRESSURE": 1.0,
    "OPEN_DRONE_ID_LOCATION": 1.0,
    "OPEN_DRONE_ID_SYSTEM": 1.0,
    "GNSS_INTEGRITY": 1.0,
    "LINK_NODE_STATUS": 1.0,
    "HOME_POSITION": 0.5,
    "BATTERY_STATUS": 0.5,
    "CURRENT_MODE": 0.5,
    "ESTIMATOR_STATUS": 0.5,
    "DISTANCE_SENSOR": 0.5,
    "PING": 0.1,
    "VIBRATION": 0.1,
    "TIME_ESTIMATE_TO_TARGET": 0.5,
    "CURRENT_EVENT_SEQUENCE": 1.0 / 3.0,
}

ARDUPILOT_HZ: Final[dict[str, float]] = {"HEARTBEAT": 1.0, "TIMESYNC": 0.1}
"""Nothing else until it is asked for (SR0_* are 0); TIMESYNC comes now and then."""

PX4_STREAM_RULES: Final = StreamRules(
    fixed=frozenset({"HEARTBEAT"}),
    unknown_interval=Result.FAILED,
    unknown_request=Result.DENIED,
    old_requests={410: 242, 519: 300, 525: 261, 528: 264},
)
"""Old requests: home, PROTOCOL_VERSION, STORAGE_INFORMATION, FLIGHT_INFORMATION."""

ARDUPILOT_STREAM_RULES: Final = StreamRules(
    unknown_interval=Result.FAILED,
    unknown_request=Result.FAILED,
    longest_s=60.0,
    groups={
        1: ("RAW_IMU", "SCALED_IMU2", "SCALED_PRESSURE"),
        2: (
            "SYS_STATUS",
            "POWER_STATUS",
            "MISSION_CURRENT",
            "GPS_RAW_INT",
            "NAV_CONTROLLER_OUTPUT",
            "FENCE_STATUS",
            "POSITION_TARGET_GLOBAL_INT",
        ),
        3: ("SERVO_OUTPUT_RAW", "RC_CHANNELS"),
        6: ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"),
        10: ("ATTITUDE", "AHRS2"),
        11: ("VFR_HUD",),
        12: (
            "AHRS",
            "SYSTEM_TIME",
            "WIND",
            "DISTANCE_SENSOR",
            "BATTERY_STATUS",
            "EKF_STATUS_REPORT",
            "VIBRATION",
        ),
    },
)
"""Groups: MAV_DATA_STREAM as ArduCopter's ``GCS_Mavlink.cpp`` fills them."""
