"""Messages that the autopilots send only on request: fields by message, as seen of PX4 1.17 (SIH) and ArduCopter 4.5.7.

Many belong to parts that the simulated vehicles do not have. SET_MESSAGE_INTERVAL accepts these too, and none comes.
"""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from sitl_mock.dynamics import attitude_of
from sitl_mock.dynamics.values import GRAVITY_M_S2, quaternion_of
from sitl_mock.telemetry import px4
from sitl_mock.telemetry.motion import (
    position_target_global_int,
    position_target_local_ned,
    raw_imu,
    scaled_pressure,
)
from sitl_mock.telemetry.status import (
    ekf_status_report,
    fence_status,
    gps_raw_int,
    rc_channels,
)
from sitl_mock.telemetry.wire import Fields, int16
from sitl_mock.vehicle.flavour import Report

Build = Callable[[Report], Fields | None]

_GUIDED_FLAG: Final = 8
_NOT_GIVEN: Final = -128
_NO_ITEM: Final = 0xFFFF
_ESC_START_S: Final = 6.0
_ESC_HZ: Final = 400.0
_GRID_M: Final = 100
_GRID_NORTH_M: Final = 2400.0
_GRID_EAST_M: Final = 2800.0
_DEGREE_M: Final = 111_318.845
_WHOLE_GRID: Final = (1 << 56) - 1


def nothing(_report: Report) -> None:
    """A message of a part that the vehicle does not have."""


def autopilot_version(report: Report) -> Fields:
    """AUTOPILOT_VERSION."""
    return report.flavour.identity(report.state.system_id).autopilot_version()[1:]


def _gimbal_state(report: Report, estimator_flags: int, landed_state: int, system: int) -> Fields:
    """AUTOPILOT_STATE_FOR_GIMBAL_DEVICE."""
    state = report.state
    return (
        *(system, 0, report.boot_us, quaternion_of(*state.attitude[:3]), 0),
        *(*state.velocity_m_s, 0, 0.0, estimator_flags, landed_state, 0.0),
    )


def _high_latency(report: Report, custom_mode: int, rest: Fields) -> Fields:
    """HIGH_LATENCY2 up to the ground speed; `rest` begins with the wind."""
    state = report.state
    lat, lon, alt = report.place
    heading = int(math.degrees(state.yaw_rad) % 360.0) // 2
    goal = -report.setpoint.position_ned_m[2] + state.frame.origin.alt_amsl_m
    target_m = goal if math.isfinite(goal) and state.armed else alt
    north_m_s, east_m_s, _ = state.velocity_m_s
    speed = min(int(math.hypot(north_m_s, east_m_s) * 5.0), 255)
    return (
        *(report.boot_ms, report.flavour.vehicle_type, report.flavour.autopilot, custom_mode),
        *(round(lat * 1e7), round(lon * 1e7), int16(alt), int16(target_m), heading, heading, 0),
        *(px4.throttle_percent(report), 0, 0, speed, *rest),
    )


# -- PX4 ---------------------------------------------------------------------------------------------------------------


def _px4_high_latency(report: Report) -> Fields:
    battery = math.ceil(report.state.battery.remaining * 100.0)
    climb = max(-127, min(127, int(-report.state.velocity_m_s[2] * 10.0)))
    rest = (0, 0, 9, 18, 15, climb, battery, _NO_ITEM, 0, *(_NOT_GIVEN,) * 3)
    return _high_latency(report, report.commander.custom_mode >> 16, rest)


def _px4_scaled_imu(report: Report) -> Fields:
    felt = px4.px4_highres_imu(report)[1:10]
    units = (1e3 / GRAVITY_M_S2,) * 3 + (1e3,) * 6
    milli = (int16(value * unit) for value, unit in zip(felt, units, strict=True))
    return (report.boot_ms, *milli, 1500)


def _px4_motor_controls(report: Report) -> Fields:
    share = px4.throttle_percent(report) * 0.01
    mode = report.commander.base_mode & ~_GUIDED_FLAG
    return (report.boot_us, (*(share,) * 4, *(0.0,) * 12), mode, 0)


def _px4_adsb_out(report: Report) -> Fields:
    fix = gps_raw_int(report)
    state = report.state
    north, east, down = (int16(value * 100.0) for value in state.sensors.fix.velocity_m_s)
    flying = 8 if state.on_ground else 0xFFFF
    pressure = int(px4.px4_scaled_pressure(report)[1])  # PX4 puts hPa into a field of millimetres
    return (
        *(0, fix[2], fix[3], fix[4], fix[1], fix[9], pressure, fix[11], fix[12] // 10, fix[13]),
        *(-down, north, east, 0, flying, 1200),
    )


def _px4_drone_id(report: Report) -> Fields:
    uid = report.flavour.identity(report.state.system_id).uid
    return (0, 0, bytes(20), 1, 2, f"1006{uid & 0xFFFF_FFFF_FFFF:015x}".encode().ljust(20, b"\0"))


def _px4_metadata(report: Report) -> Fields | None:
    """COMPONENT_METADATA: where the file about the autopilot is."""
    named = report.flavour.metadata
    if named is None:
        return None
    uri, crc = named(report.state.parameters)
    return (report.boot_ms, crc, uri)


PX4_ON_REQUEST: Mapping[str, Build] = MappingProxyType(
    {
        "AUTOPILOT_VERSION": autopilot_version,
        "COMPONENT_METADATA": _px4_metadata,
        # Only after a radio or RC_CHANNELS_OVERRIDE was heard; MANUAL_CONTROL does not count.
        "RC_CHANNELS": lambda report: (
            rc_channels(report)
            if report.state.pilot.channels or report.state.pilot.radio_s > -math.inf
            else None
        ),
        "SCALED_IMU": _px4_scaled_imu,
        "HIL_ACTUATOR_CONTROLS": _px4_motor_controls,
        "HIGH_LATENCY2": _px4_high_latency,
        "AUTOPILOT_STATE_FOR_GIMBAL_DEVICE": lambda report: _gimbal_state(
            report, px4.estimator_status(report)[1], report.commander.landed_state, 0
        ),
        "ACTUATOR_OUTPUT_STATUS": lambda report: (
            *(report.boot_us, 16),
            (*map(float, px4.px4_servo_output_raw(report)[2:]), *(0.0,) * 16),
        ),
        "UAVIONIX_ADSB_OUT_CFG": lambda _report: (1194684, b"", 14, 1, 0, 0, 700, 2),
        "UAVIONIX_ADSB_OUT_DYNAMIC": _px4_adsb_out,
        "OPEN_DRONE_ID_BASIC_ID": _px4_drone_id,
        **dict.fromkeys(
            (
                *("GPS_STATUS", "MANUAL_CONTROL", "OPTICAL_FLOW_RAD", "CAMERA_TRIGGER"),
                *("GPS2_RAW", "SCALED_IMU2", "SCALED_IMU3", "SCALED_PRESSURE2"),
                *("SCALED_PRESSURE3", "LANDING_TARGET", "MAG_CAL_REPORT", "EFI_STATUS"),
                *("GPS_RTCM_DATA", "ADSB_VEHICLE", "DEBUG_VECT", "NAMED_VALUE_FLOAT"),
                *("STATUSTEXT", "DEBUG", "CAMERA_IMAGE_CAPTURED", "MOUNT_ORIENTATION"),
                *("GIMBAL_MANAGER_INFORMATION", "GIMBAL_MANAGER_STATUS"),
                *("GIMBAL_DEVICE_INFORMATION", "GIMBAL_DEVICE_SET_ATTITUDE"),
                *("GIMBAL_DEVICE_ATTITUDE_STATUS", "GLOBAL_POSITION_SENSOR"),
                *("OBSTACLE_DISTANCE", "RAW_RPM", "DEBUG_FLOAT_ARRAY", "HYGROMETER_SENSOR"),
                *("ORBIT_EXECUTION_STATUS", "OPEN_DRONE_ID_ARM_STATUS"),
                *("NAV_CONTROLLER_OUTPUT", "WIND_COV", "COMMAND_LONG", "AVAILABLE_MODES"),
            ),
            nothing,
        ),
    }
)


# -- ArduPilot ---------------------------------------------------------------------------------------------------------


def _ardupilot_high_latency(report: Report) -> Fields:
    battery = round(report.state.battery.remaining * 100.0)
    climb = max(-127, min(127, int(-report.state.velocity_m_s[2] * 10.0)))
    signed_mode = (report.commander.base_mode ^ 0x80) - 0x80
    number = report.commander.mission.current
    rest = (0, 90, 0, 0, _NOT_GIVEN, climb, battery, number, 2, signed_mode, 0, 0)
    return _high_latency(report, report.commander.custom_mode, rest)


def _ardupilot_gimbal_state(report: Report) -> Fields:
    """Its estimator's flags, and those of a used receiver, a good receiver, and flight."""
    state = report.state
    flags = ekf_status_report(report)[0]
    if state.estimator.gps_ok:
        flags |= 0x2000 | 0x8000
    if not state.on_ground:
        flags |= 0x1000
    return _gimbal_state(report, flags, 0, state.system_id)


def _truth(report: Report) -> tuple[Fields, Fields, Fields]:
    """Attitude, specific force and body rates, and place of the simulated body."""
    state = report.state
    attitude = attitude_of(state.body)
    push = -(GRAVITY_M_S2 if state.on_ground else state.body.thrust_m_s2)
    place = state.frame.to_geodetic(*state.body.position_ned_m)
    return attitude[:3], (0.0, 0.0, push, *attitude[3:]), place


def _simstate(report: Report) -> Fields:
    attitude, felt, (lat, lon, _) = _truth(report)
    return (*attitude, *felt, round(lat * 1e7), round(lon * 1e7))


def _sim_state(report: Report) -> Fields:
    attitude, felt, (lat, lon, alt) = _truth(report)
    degrees = (round(lat * 1e7), round(lon * 1e7))
    return (
        *(*quaternion_of(*attitude), *attitude, *felt, *map(float, degrees), alt, 0.0, 0.0),
        *(*report.state.body.velocity_ned_m_s, *degrees),
    )


def _terrain_request(report: Report) -> Fields | None:
    """TERRAIN_REQUEST for the block of the grid about the vehicle, counted from its degree's south-west corner."""
    if not report.state.estimator.global_valid:
        return None
    lat, lon, _ = report.place
    south = math.floor(lat)
    west = math.floor(lon)
    lat_corner = (
        south + math.floor((lat - south) * _DEGREE_M / _GRID_NORTH_M) * _GRID_NORTH_M / _DEGREE_M
    )
    degree_east_m = _DEGREE_M * math.cos(math.radians((lat_corner + south) / 2.0))
    blocks = math.floor((lon - west) * degree_east_m / _GRID_EAST_M)
    lon_corner = west + blocks * _GRID_EAST_M / degree_east_m
    return (round(lat_corner * 1e7), round(lon_corner * 1e7), _GRID_M, _WHOLE_GRID)


def _esc_telemetry(report: Report) -> Fields:
    """ESC_TELEMETRY_1_TO_4: the simulated controllers report constants and count their reports."""
    count = int(max(0.0, report.boot_us * 1e-6 - _ESC_START_S) * _ESC_HZ) & 0xFFFF
    four = ((value,) * 4 for value in (1679, 80, 1, 0, count))
    return (bytes((32,) * 4), *four)


ARDUPILOT_ON_REQUEST: Mapping[str, Build] = MappingProxyType(
    {
        "AUTOPILOT_VERSION": autopilot_version,
        "SCALED_IMU": lambda report: (report.boot_ms, *raw_imu(report)[1:10], 2500),
        "SCALED_IMU3": lambda report: (report.boot_ms, *(0,) * 6, *raw_imu(report)[7:10], 0),
        "SCALED_PRESSURE2": scaled_pressure,
        "AUTOPILOT_STATE_FOR_GIMBAL_DEVICE": _ardupilot_gimbal_state,
        "HIGH_LATENCY2": _ardupilot_high_latency,
        "SIMSTATE": _simstate,
        "SIM_STATE": _sim_state,
        "TERRAIN_REQUEST": _terrain_request,
        "ESC_TELEMETRY_1_TO_4": _esc_telemetry,
        "HWSTATUS": lambda _report: (5000, 0),
        "MEMINFO": lambda _report: (0, 65535, 131072),
        "RELAY_STATUS": lambda report: (report.boot_ms, 0, 1),
        "MISSION_ITEM_REACHED": lambda report: (
            report.commander.mission.current - 1
            if report.commander.mission.current > 1
            else _NO_ITEM,
        ),
        "FENCE_STATUS": lambda report: (
            fence_status(report) if report.state.parameters["FENCE_ENABLE"] else None
        ),
        "POSITION_TARGET_GLOBAL_INT": lambda report: (
            position_target_global_int(report)
            if report.state.armed and math.isfinite(report.setpoint.position_ned_m[0])
            else None
        ),
        "POSITION_TARGET_LOCAL_NED": lambda report: (
            position_target_local_ned(report) if report.commander.mode == "GUIDED" else None
        ),
        **dict.fromkeys(
            (
                *("PARAM_VALUE", "RC_CHANNELS_SCALED", "RC_CHANNELS_RAW", "OPTICAL_FLOW"),
                *("GPS2_RAW", "GPS_RTK", "GPS2_RTK", "SCALED_PRESSURE3", "RANGEFINDER"),
                *("CAMERA_FEEDBACK", "BATTERY2", "MAG_CAL_PROGRESS", "MAG_CAL_REPORT"),
                *("PID_TUNING", "DEEPSTALL", "EFI_STATUS", "RPM", "ADSB_VEHICLE"),
                *("CAMERA_INFORMATION", "CAMERA_SETTINGS", "CAMERA_CAPTURE_STATUS"),
                *("CAMERA_FOV_STATUS", "GIMBAL_MANAGER_INFORMATION", "GIMBAL_MANAGER_STATUS"),
                *("GIMBAL_DEVICE_ATTITUDE_STATUS", "AIS_VESSEL", "GENERATOR_STATUS"),
                *("WINCH_STATUS", "UAVIONIX_ADSB_OUT_STATUS", "AOA_SSA", "DISTANCE_SENSOR"),
            ),
            nothing,
        ),
    }
)
