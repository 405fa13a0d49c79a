"""Messages about motion: each builder returns the message's fields in the order of declaration."""

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Final

from sitl_mock.dynamics import Kind
from sitl_mock.dynamics.values import GRAVITY_M_S2, quaternion_of
from sitl_mock.telemetry.wire import Fields, heading_cdeg, int16
from sitl_mock.vehicle.flavour import Report

_NAN = math.nan
_EMPTY_Q: Final = bytes(16)
_LOCAL_NED = 1
_IDLING: Final = int(Kind.IDLING)
_HOVER_THRUST: Final = 0.5
_RATE_SHARE: Final = 3.5
"""Noise of ArduCopter's body rates on the ground (rad/s) over that of its attitude (rad)."""
_FIELD_GAUSS: Final = (0.21, 0.01, 0.43)


def attitude(report: Report) -> Fields:
    """ATTITUDE; on the ground with the estimate's noise."""
    state = report.state
    lean = state.sensors.noise.attitude_sd_rad
    if not (lean and state.body.on_ground):
        return (report.boot_ms, *state.attitude)
    scatter = state.sensors.scatter()
    still = (
        value + sd * deviate
        for value, sd, deviate in zip(
            state.attitude, (*(lean,) * 3, *(_RATE_SHARE * lean,) * 3), scatter, strict=False
        )
    )
    return (report.boot_ms, *still)


def attitude_quaternion(report: Report) -> Fields:
    """ATTITUDE_QUATERNION."""
    roll, pitch, yaw, roll_rate, pitch_rate, yaw_rate = report.state.attitude
    return (
        report.boot_ms,
        *quaternion_of(roll, pitch, yaw),
        roll_rate,
        pitch_rate,
        yaw_rate,
        _EMPTY_Q,
    )


def local_position_ned(report: Report) -> Fields:
    """LOCAL_POSITION_NED; on the ground with the estimate's noise."""
    state = report.state
    sd = state.sensors.noise.still_sd
    if not (sd and state.body.on_ground):
        return (report.boot_ms, *state.position_m, *state.velocity_m_s)
    motion = (*state.position_m, *state.velocity_m_s)
    scatter = state.sensors.scatter()
    still = (value + sd * deviate for value, deviate in zip(motion, scatter, strict=False))
    return (report.boot_ms, *still)


def global_position_int(report: Report) -> Fields:
    """GLOBAL_POSITION_INT."""
    state = report.state
    north, east, down = state.position_m
    lat, lon, alt = state.frame.to_geodetic(north, east, down)
    home = state.home_m
    v_n, v_e, v_d = state.velocity_m_s
    above_m = -down if home is None else home[2] - down
    return (
        report.boot_ms,
        round(lat * 1e7),
        round(lon * 1e7),
        round(alt * 1e3),
        round(above_m * 1e3),
        int16(v_n * 100.0),
        int16(v_e * 100.0),
        int16(v_d * 100.0),
        heading_cdeg(state.attitude[2]),
    )


def vfr_hud(report: Report) -> Fields:
    """VFR_HUD."""
    state = report.state
    v_n, v_e, v_d = state.velocity_m_s
    speed = math.hypot(v_n, v_e)
    height = state.frame.origin.alt_amsl_m - state.position_m[2]
    throttle = min(100, int(100.0 * _throttle(report)))
    return (speed, speed, heading_cdeg(state.yaw_rad) // 100, throttle, height, -v_d)


def _throttle(report: Report) -> float:
    return (
        report.state.body.thrust_m_s2 * _HOVER_THRUST / GRAVITY_M_S2 if report.state.armed else 0.0
    )


def attitude_target(report: Report) -> Fields:
    """ATTITUDE_TARGET; the attitude loop's lag is left out."""
    roll, pitch, yaw, roll_rate, pitch_rate, yaw_rate = report.state.attitude
    return (
        report.boot_ms,
        0,
        quaternion_of(roll, pitch, yaw),
        roll_rate,
        pitch_rate,
        yaw_rate,
        min(1.0, _throttle(report)),
    )


def position_target_local_ned(report: Report) -> Fields:
    """POSITION_TARGET_LOCAL_NED: the setpoint in force; PX4 puts NaN where there is none."""
    setpoint = report.setpoint
    if setpoint.kind <= _IDLING:
        return (report.boot_ms, _LOCAL_NED, 0, *(_NAN,) * 11)
    return (
        report.boot_ms,
        _LOCAL_NED,
        0,
        *setpoint.position_ned_m,
        *setpoint.velocity_ned_m_s,
        *setpoint.acceleration_ned_m_s2,
        setpoint.yaw_rad,
        setpoint.yaw_rate_rad_s,
    )


def position_target_global_int(report: Report) -> Fields:
    """POSITION_TARGET_GLOBAL_INT."""
    setpoint = report.setpoint
    north, east, down = (
        here if math.isnan(there) else there
        for there, here in zip(setpoint.position_ned_m, report.state.position_m, strict=True)
    )
    lat, lon, alt = report.state.frame.to_geodetic(north, east, down)
    return (
        report.boot_ms,
        0,
        0,
        round(lat * 1e7),
        round(lon * 1e7),
        alt,
        *setpoint.velocity_ned_m_s,
        *setpoint.acceleration_ned_m_s2,
        setpoint.yaw_rad,
        setpoint.yaw_rate_rad_s,
    )


def _felt(report: Report) -> tuple[float, float, float]:
    """Specific force along the body's axes, with the thrust along -z and the ground's push while standing."""
    state = report.state
    return (0.0, 0.0, -(GRAVITY_M_S2 if state.on_ground else state.body.thrust_m_s2))


def highres_imu(report: Report) -> Fields:
    """HIGHRES_IMU."""
    state = report.state
    pressure = _pressure_hpa(report)
    height = state.frame.origin.alt_amsl_m - state.position_m[2]
    rates = state.attitude[3:]
    return (
        report.boot_us,
        *_felt(report),
        *rates,
        *_FIELD_GAUSS,
        pressure,
        0.0,
        height,
        25.0,
        0xFFF,
        0,
    )


def _pressure_hpa(report: Report) -> float:
    return pressure_hpa(report.state.frame.origin.alt_amsl_m - report.state.position_m[2])


@lru_cache(maxsize=512)
def pressure_hpa(height_m: float) -> float:
    """Pressure of the standard atmosphere at a height above sea level."""
    return float(1013.25 * max(0.0, 1.0 - 2.25577e-5 * height_m) ** 5.25588)


def raw_imu(report: Report) -> Fields:
    """RAW_IMU: milli-g, milliradian a second, milligauss."""
    sensors = report.state.sensors
    accelerometer_sd = sensors.noise.accelerometer_sd_m_s2
    gyro_sd = sensors.noise.gyro_sd_rad_s
    scatter = sensors.scatter()
    felt = (
        int16(round((value + accelerometer_sd * deviate) * 1000.0 / GRAVITY_M_S2))
        for value, deviate in zip(_felt(report), scatter[:3], strict=True)
    )
    rates = (
        int16(round((value + gyro_sd * deviate) * 1000.0))
        for value, deviate in zip(report.state.attitude[3:], scatter[3:6], strict=True)
    )
    return (
        report.boot_us,
        *felt,
        *rates,
        *(int(value * 1000) for value in _FIELD_GAUSS),
        0,
        2500,
    )


def scaled_imu2(report: Report) -> Fields:
    """SCALED_IMU2."""
    return (report.boot_ms, *raw_imu(report)[1:10], 2500)


def scaled_pressure(report: Report) -> Fields:
    """SCALED_PRESSURE."""
    return (report.boot_ms, _pressure_hpa(report), 0.0, 2500, 0)


def ahrs2(report: Report) -> Fields:
    """AHRS2: the second estimator agrees."""
    roll, pitch, yaw = report.state.attitude[:3]
    lat, lon, alt = report.place
    return (roll, pitch, yaw, alt, round(lat * 1e7), round(lon * 1e7))


def ahrs(_report: Report) -> Fields:
    """AHRS."""
    return (0.0, 0.0, 0.0, 0.0, 0.0, 0.003, 0.003)


def distance_sensor(report: Report) -> Fields:
    """DISTANCE_SENSOR: a lidar that looks down."""
    state = report.state
    height_cm = int(min(max((state.ground_m - state.body.position_ned_m[2]) * 100.0, 0.0), 65535.0))
    return (report.boot_ms, 10, 5000, height_cm, 0, 0, 25, 255, 0.0, 0.0, _EMPTY_Q, 0)


MOTION: Mapping[str, Callable[[Report], Fields]] = MappingProxyType(
    {
        "ATTITUDE": attitude,
        "ATTITUDE_QUATERNION": attitude_quaternion,
        "LOCAL_POSITION_NED": local_position_ned,
        "GLOBAL_POSITION_INT": global_position_int,
        "VFR_HUD": vfr_hud,
        "ATTITUDE_TARGET": attitude_target,
        "POSITION_TARGET_LOCAL_NED": position_target_local_ned,
        "POSITION_TARGET_GLOBAL_INT": position_target_global_int,
        "HIGHRES_IMU": highres_imu,
        "RAW_IMU": raw_imu,
        "SCALED_IMU2": scaled_imu2,
        "SCALED_PRESSURE": scaled_pressure,
        "AHRS": ahrs,
        "AHRS2": ahrs2,
        "DISTANCE_SENSOR": distance_sensor,
    }
)
