"""PX4's builders, which replace the common ones; field by field as recorded on v1.17 (SIH)."""

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType
from typing import Final

from sitl_mock.dynamics import IGNORED, Kind
from sitl_mock.dynamics.values import GRAVITY_M_S2, quaternion_of
from sitl_mock.parameters.calibrated_sensors import uncalibrated
from sitl_mock.telemetry.motion import pressure_hpa
from sitl_mock.telemetry.wire import Fields, int16
from sitl_mock.vehicle.flavour import Report
from sitl_mock.vehicle.state import VehicleState

_NAN: Final = math.nan
_LOCAL_NED = 1
_GLOBAL_INT = 5
_EMPTY_Q: Final = bytes(16)
_NOBODY: Final = bytes(20)
_PRESENT: Final = 0x0200402F
_LOGGING = 0x1000000
_RADIO = 0x10000
_GPS = 0x20
_POSITION = 0x4000
_AHRS = 0x200000
_PREARM = 0x10000000
_HEALTHY: Final = 0x0300881F
_IDLING: Final = int(Kind.IDLING)
_NEVER: Final = -1
_FROM_ARMING: Final = 0
_FROM_BOOT: Final = 1
_UNTIL_SHUTDOWN: Final = 2
_OWN: Final = (Kind.TRAVEL, Kind.BRAKE)
_STILL: Final = (_NAN,) * 6 + (0.0, 0.0, 100.0)
"""Setpoint of an idling PX4: a large downward acceleration."""
_BITS: Final = tuple(1 << index for index in range(9))
_FIELD_GAUSS: Final = (0.21, 0.006, 0.43)
_PULSE_OFF = 900
_PULSE_IDLE = 1000
_PULSE_FULL = 2000
_FULL_M_S2: Final = 20.0
_LIDAR_CM: Final = 10000
_NO_TIME_2019_S: Final = 2748666496
"""OPEN_DRONE_ID's clock without a date, as SIH sends it."""
_AUTOMATIC: Final = frozenset({"HOLD", "TAKEOFF", "MISSION", "RTL", "LAND", "PRECLAND"})


def px4_attitude(report: Report) -> Fields:
    """ATTITUDE; on the ground with the sensors' noise."""
    state = report.state
    sensors = state.sensors
    lean_rad = sensors.noise.attitude_sd_rad
    if not (lean_rad and state.body.on_ground):
        return (report.boot_ms, *state.attitude)
    normals = sensors.normals(6)
    roll, pitch, yaw, *rates = state.attitude
    return (
        report.boot_ms,
        roll + lean_rad * normals[0],
        pitch + lean_rad * normals[1],
        yaw + 3.0 * lean_rad * normals[2],
        *_scattered(rates, sensors.noise.gyro_sd_rad_s, normals[3:]),
    )


def _scattered(
    values: Sequence[float], sd: float, normals: Sequence[float]
) -> tuple[float, float, float]:
    """Add noise of one standard deviation to three values."""
    (x, y, z) = values
    (by_x, by_y, by_z) = normals
    return (x + sd * by_x, y + sd * by_y, z + sd * by_z)


def odometry(report: Report) -> Fields:
    """ODOMETRY: everything in the local frame, variances on the diagonals, quality never filled."""
    state = report.state
    roll, pitch, yaw, roll_rate, pitch_rate, yaw_rate = state.attitude
    level = state.estimator.eph_m**2 * 0.27
    high = 0.0052 if state.body.on_ground else 0.1
    return (
        report.boot_us,
        _LOCAL_NED,
        _LOCAL_NED,
        *state.position_m,
        quaternion_of(roll, pitch, yaw),
        *state.velocity_m_s,
        roll_rate,
        pitch_rate,
        yaw_rate,
        _diagonal(level, level, high, 1e-4, 1e-4, 4e-3),
        _VELOCITY_COVARIANCE,
        (state.estimator.reset_counter + RESETS_AT_START) & 0xFF,
        3,
        0,
    )


RESETS_AT_START: Final = 9
"""Resets of the estimator during the start."""


_TRIANGLE: Final = struct.Struct("<21f").pack


@lru_cache(maxsize=8)
def _diagonal(x: float, y: float, z: float, roll: float, pitch: float, yaw: float) -> bytes:
    """Pack the upper triangle of a covariance whose off-diagonal elements are unknown."""
    row = [_NAN] * 21
    for index, value in zip((0, 6, 11, 15, 18, 20), (x, y, z, roll, pitch, yaw), strict=True):
        row[index] = value
    return _TRIANGLE(*row)


_VELOCITY_COVARIANCE: Final = _diagonal(0.02, 0.02, 0.01, _NAN, _NAN, _NAN)


_ROUNDING: Final = 1e-9


def px4_sys_status(report: Report) -> Fields:
    """SYS_STATUS: PREARM is healthy when it may arm, and never present; LOGGING is present while a log is written.

    The charge is rounded up.
    """
    state = report.state
    battery = state.battery
    estimator = state.estimator
    pilot = state.pilot
    present = _PRESENT | (_RADIO if pilot.known else 0) | (_LOGGING if is_logged(state) else 0)
    health = _HEALTHY
    health |= _GPS if estimator.gps_ok else 0
    health |= _POSITION | _AHRS if estimator.position_valid else 0
    health |= _RADIO if pilot.fresh(state.now_s, 0.5) else 0
    for sensor in uncalibrated(state.parameters):
        health &= ~sensor.bit
    health |= _PREARM if state.armed or report.commander.ready_to_arm else 0
    millivolts = int(battery.voltage_v * 1000.0)
    percent = math.ceil(battery.remaining * 100.0 - _ROUNDING)
    return (present, present | _RADIO, health, 120, millivolts, -100, percent, *(0,) * 8, 1)


def is_logged(state: VehicleState) -> bool:
    """True if SDLOG_MODE wants a log now."""
    mode = int(state.parameters["SDLOG_MODE"])
    if mode == _NEVER:
        return False
    if mode == _FROM_ARMING:
        return state.armed
    if mode == _FROM_BOOT:
        return state.armed or not state.was_armed
    return mode == _UNTIL_SHUTDOWN or state.was_armed


def px4_position_target_local_ned(report: Report) -> Fields:
    """POSITION_TARGET_LOCAL_NED: the moving trajectory, or the setpoint of a stream."""
    setpoint = report.setpoint
    yaw = setpoint.yaw_rad
    if setpoint.kind <= _IDLING:
        return (report.boot_ms, _LOCAL_NED, _mask(_STILL), *_STILL, report.state.yaw_rad, 0.0)
    moving = trajectory(report)
    return (report.boot_ms, _LOCAL_NED, _mask(moving), *moving, yaw, setpoint.yaw_rate_rad_s)


def trajectory(report: Report) -> tuple[float, ...]:
    """Position, velocity and acceleration that the controller follows; NaN marks axes that are left free."""
    setpoint = report.setpoint
    if setpoint.kind in _OWN and (reference := report.reference()) is not None:
        return (
            *reference.position_ned_m,
            *reference.velocity_ned_m_s,
            *reference.acceleration_ned_m_s2,
        )
    asked = report.state.body.acceleration_ned_m_s2
    push: tuple[float, ...] = setpoint.acceleration_ned_m_s2
    if push is IGNORED:
        push = asked
    elif math.isnan(sum(push)):
        push = tuple(
            real if math.isnan(given) else given for given, real in zip(push, asked, strict=True)
        )
    return (*setpoint.position_ned_m, *setpoint.velocity_ned_m_s, *push)


def _mask(values: tuple[float, ...]) -> int:
    """Return the POSITION_TARGET_TYPEMASK bits of NaN values."""
    bits = 0
    for bit, value in zip(_BITS, values, strict=False):
        if math.isnan(value):
            bits |= bit
    return bits


def px4_position_target_global_int(report: Report) -> Fields | None:
    """POSITION_TARGET_GLOBAL_INT: the goal of an automatic mode while armed, otherwise None."""
    state = report.state
    setpoint = report.setpoint
    if not state.armed or report.commander.mode not in _AUTOMATIC:
        return None
    goal = (
        here if math.isnan(there) else there
        for there, here in zip(setpoint.position_ned_m, state.position_m, strict=True)
    )
    lat, lon, alt = state.frame.to_geodetic(*goal)
    still = setpoint.kind is Kind.IDLING
    moving = _STILL[3:] if still else trajectory(report)[3:]
    position = (round(lat * 1e7), round(lon * 1e7), alt)
    return (report.boot_ms, _GLOBAL_INT, 0, *position, *moving, setpoint.yaw_rad, 0.0)


def px4_highres_imu(report: Report) -> Fields:
    """HIGHRES_IMU: specific force, rates, field and pressure with the sensors' noise."""
    state = report.state
    sensors = state.sensors
    noise = sensors.noise
    scatter = sensors.scatter()
    push = -(GRAVITY_M_S2 if state.body.on_ground else state.body.thrust_m_s2)
    force_sd = noise.accelerometer_sd_m_s2
    height = state.frame.origin[2] - sensors.barometer_down_m
    return (
        report.boot_us,
        force_sd * scatter[0],
        force_sd * scatter[1],
        push + force_sd * scatter[2],
        *_scattered(state.attitude[3:], noise.gyro_sd_rad_s, scatter[3:6]),
        *_scattered(_FIELD_GAUSS, noise.magnetometer_sd_gauss, scatter[6:]),
        pressure_hpa(height),
        0.0,
        height,
        15.0,
        0x3F,
        0,
    )


def px4_scaled_pressure(report: Report) -> Fields:
    """SCALED_PRESSURE."""
    state = report.state
    return (
        report.boot_ms,
        pressure_hpa(state.frame.origin.alt_amsl_m - state.sensors.barometer_down_m),
        0.0,
        1182,
        0,
    )


def hil_state_quaternion(report: Report) -> Fields:
    """HIL_STATE_QUATERNION: the simulator's truth, without a time; accelerations in whole m/s²."""
    state = report.state
    body = state.body
    roll, pitch, yaw, *rates = state.attitude
    lat, lon, alt = state.frame.to_geodetic(*body.position_ned_m)
    velocity = (int16(value * 100.0) for value in body.velocity_ned_m_s)
    acceleration = (int16(math.trunc(value)) for value in body.acceleration_ned_m_s2)
    return (
        0,
        quaternion_of(roll, pitch, yaw),
        *rates,
        round(lat * 1e7),
        round(lon * 1e7),
        round(alt * 1e3),
        *velocity,
        0,
        0,
        *acceleration,
    )


def altitude(report: Report) -> Fields:
    """ALTITUDE: barometer, estimate above sea level, above the origin, above home, of the terrain, above ground."""
    state = report.state
    origin_m = state.frame.origin.alt_amsl_m
    up = -state.position_m[2]
    ground = -state.ground_m
    return (
        report.boot_us,
        origin_m - state.sensors.barometer_down_m,
        origin_m + up,
        up,
        report.relative_m,
        ground,
        state.ground_m - state.body.position_ned_m[2],
    )


def px4_distance_sensor(report: Report) -> Fields:
    """DISTANCE_SENSOR: SIH's laser that looks down."""
    state = report.state
    height_cm = int(
        min(max((state.ground_m - state.body.position_ned_m[2]) * 100.0, 0.0), _LIDAR_CM)
    )
    return (report.boot_ms, 0, _LIDAR_CM, height_cm, 0, 0, 25, 0, 0.0, 0.0, _EMPTY_Q, 0)


def px4_vfr_hud(report: Report) -> Fields:
    """VFR_HUD: without an airspeed."""
    state = report.state
    v_n, v_e, v_d = state.velocity_m_s
    heading = int(math.degrees(state.yaw_rad) % 360.0)
    height = state.frame.origin.alt_amsl_m - state.position_m[2]
    return (_NAN, math.hypot(v_n, v_e), heading, throttle_percent(report), height, -v_d)


def throttle_percent(report: Report) -> int:
    """Thrust as a whole percentage of the most."""
    return int(100.0 * _throttle(report))


def _throttle(report: Report) -> float:
    return min(1.0, report.state.body.thrust_m_s2 / _FULL_M_S2) if report.state.armed else 0.0


def px4_servo_output_raw(report: Report) -> Fields:
    """SERVO_OUTPUT_RAW: four motors, and 900 on every channel that is off."""
    state = report.state
    pulse = (
        int(_PULSE_IDLE + (_PULSE_FULL - _PULSE_IDLE) * _throttle(report))
        if state.armed
        else _PULSE_OFF
    )
    return (report.boot_us & 0xFFFFFFFF, 0, *(pulse,) * 4, *(_PULSE_OFF,) * 12)


def px4_battery_status(report: Report) -> Fields:
    """BATTERY_STATUS: SIH's pack reports its voltage as one cell, and no current."""
    battery = report.state.battery
    share = battery.remaining
    charge_state = 1 if share > 0.15 else 2 if share > 0.07 else 3 if share > 0.05 else 4
    cells = (int(battery.voltage_v * 1000.0), *(0xFFFF,) * 9)
    return (
        0,
        1,
        1,
        32767,
        cells,
        -100,
        -1,
        -1,
        round(share * 100.0),
        0,
        charge_state,
        (0,) * 4,
        0,
        0,
    )


def px4_vibration(report: Report) -> Fields:
    """VIBRATION."""
    shaken = not report.state.on_ground
    return (
        report.boot_us,
        5e-9 if shaken else 1e-10,
        0.095 if shaken else 0.011,
        1.4 if shaken else 0.11,
        0,
        0,
        0,
    )


def estimator_status(report: Report) -> Fields:
    """ESTIMATOR_STATUS."""
    estimator = report.state.estimator
    flags = 1 | (2 | 4 | 8 | 256 | 512 if estimator.position_valid else 128)
    flags |= 16 if estimator.global_valid else 0
    flags |= 32 | 64 if estimator.altitude_valid else 0
    flags |= 128 if report.state.on_ground else 0
    high_m = 0.07 if report.state.on_ground else 0.32
    return (
        report.boot_us,
        flags,
        0.05,
        0.04,
        0.02,
        0.07,
        0.005,
        _NAN,
        estimator.eph_m * 0.73,
        high_m,
    )


def open_drone_id_location(report: Report) -> Fields:
    """OPEN_DRONE_ID_LOCATION: on the ground or in the air, and how it moves; there is no date."""
    state = report.state
    v_n, v_e, v_d = state.velocity_m_s
    lat, lon, alt = report.place
    barometer = state.frame.origin.alt_amsl_m - state.sensors.barometer_down_m
    course = int(math.degrees(math.atan2(v_e, v_n)) % 360.0) * 100
    moving = (course, int(math.hypot(v_n, v_e) * 100.0) & 0xFFFF, int(-v_d * 100.0))
    position = (round(lat * 1e7), round(lon * 1e7), barometer, round(alt), 0, report.relative_m)
    return (0, 0, _NOBODY, 1 if state.on_ground else 2, *moving, *position, 12, 5, 0, 3, 65535.0, 0)


def open_drone_id_system(report: Report) -> Fields | None:
    """OPEN_DRONE_ID_SYSTEM: the operator is at home."""
    state = report.state
    if state.home_m is None:
        return None
    lat, lon, alt = state.frame.to_geodetic(*state.home_m)
    operator = (round(lat * 1e7), round(lon * 1e7))
    return (0, 0, _NOBODY, 0, 0, *operator, 1, 0, -1000.0, -1000.0, 0, 0, alt, _NO_TIME_2019_S)


def gnss_integrity(_report: Report) -> Fields:
    """GNSS_INTEGRITY: unknown for the simulated receiver."""
    return (4, 0, 0, 0, 0, 0, 65535, 65535, 255, 255, 255, 255)


def time_estimate_to_target(_report: Report) -> Fields:
    """TIME_ESTIMATE_TO_TARGET: none."""
    return (-1,) * 5


def link_node_status(report: Report) -> Fields:
    """LINK_NODE_STATUS."""
    return (report.boot_us // 1000, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)


def current_event_sequence(report: Report) -> Fields:
    """CURRENT_EVENT_SEQUENCE; the flag means no event since the start."""
    return (report.events.latest, 0 if len(report.events) else 1)


PX4_BUILDERS: Mapping[str, Callable[[Report], Fields | None]] = MappingProxyType(
    {
        "ATTITUDE": px4_attitude,
        "ODOMETRY": odometry,
        "SYS_STATUS": px4_sys_status,
        "POSITION_TARGET_LOCAL_NED": px4_position_target_local_ned,
        "POSITION_TARGET_GLOBAL_INT": px4_position_target_global_int,
        "HIGHRES_IMU": px4_highres_imu,
        "SCALED_PRESSURE": px4_scaled_pressure,
        "ALTITUDE": altitude,
        "HIL_STATE_QUATERNION": hil_state_quaternion,
        "DISTANCE_SENSOR": px4_distance_sensor,
        "VFR_HUD": px4_vfr_hud,
        "SERVO_OUTPUT_RAW": px4_servo_output_raw,
        "BATTERY_STATUS": px4_battery_status,
        "VIBRATION": px4_vibration,
        "ESTIMATOR_STATUS": estimator_status,
        "OPEN_DRONE_ID_LOCATION": open_drone_id_location,
        "OPEN_DRONE_ID_SYSTEM": open_drone_id_system,
        "GNSS_INTEGRITY": gnss_integrity,
        "TIME_ESTIMATE_TO_TARGET": time_estimate_to_target,
        "LINK_NODE_STATUS": link_node_status,
        "CURRENT_EVENT_SEQUENCE": current_event_sequence,
    }
)
