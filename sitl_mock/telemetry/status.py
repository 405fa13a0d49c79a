"""Messages about everything but motion: each builder returns the message's fields in the order of declaration."""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from sitl_mock.dynamics.values import GRAVITY_M_S2, quaternion_of
from sitl_mock.telemetry.wire import Fields, heading_cdeg
from sitl_mock.vehicle.estimator import EPH_M
from sitl_mock.vehicle.flavour import Report
from sitl_mock.vehicle.pilot import override_time_s

_GYRO = 0x1
_ACCEL = 0x2
_MAG = 0x4
_BARO = 0x8
_GPS = 0x20
_RC = 0x10000
_GEOFENCE = 0x100000
_AHRS = 0x200000
_BATTERY = 0x2000000
_PREARM = 0x10000000
_SENSORS: Final = _GYRO | _ACCEL | _MAG | _BARO
_RATES: Final = 0x400
_LEVEL: Final = 0x800
_YAW: Final = 0x1000
_HEIGHT: Final = 0x2000
_PLACE: Final = 0x4000
_MOTORS: Final = 0x8000
_TERRAIN: Final = 0x400000
_LOGGING: Final = 0x1000000
_PROXIMITY: Final = 0x4000000
_PROPULSION: Final = 0x40000000
_ALWAYS: Final = (
    _SENSORS | _RATES | _LEVEL | _YAW | _MOTORS | _RC | _TERRAIN | _BATTERY | _PROPULSION
)
_PRESENT: Final = _ALWAYS | _HEIGHT | _PLACE | _GPS | _GEOFENCE | _AHRS | _LOGGING | _PREARM
_CONTROLLED: Final[Mapping[str, int]] = {
    **dict.fromkeys(("ALT_HOLD", "GUIDED_NOGPS", "SPORT", "AUTOTUNE", "FLOWHOLD"), _HEIGHT),
    **dict.fromkeys(
        (
            *("AUTO", "AUTO_RTL", "AVOID_ADSB", "GUIDED", "LOITER", "RTL", "CIRCLE", "LAND"),
            *("POSHOLD", "BRAKE", "THROW", "SMART_RTL"),
        ),
        _HEIGHT | _PLACE,
    ),
}
"""Position control bits of SYS_STATUS by ArduCopter's mode."""
_NO_TEMPERATURE: Final = 32767
_HECTOJOULES: Final = 0.036
"""In a milliampere hour at one volt."""
_NO_CELL: Final = 0xFFFF
_PWM_LOW = 1000
_PWM_HIGH = 2000
_HDOP_CENTI = 70
_VDOP_CENTI = 110
_H_ACC_MM = 900
_V_ACC_MM = 1780
_SPEED_ACC_MM_S = 400
_SATELLITES = 10
_NAVIGATED: Final = frozenset({"TAKEOFF", "LAND"})
"""Other modes in which PX4 calls the mission active (measured)."""


def heartbeat(report: Report) -> Fields:
    """HEARTBEAT."""
    commander = report.commander
    flavour = report.flavour
    return (
        flavour.vehicle_type,
        flavour.autopilot,
        commander.base_mode,
        commander.custom_mode,
        commander.system_status,
        3,
    )


def sys_status(report: Report) -> Fields:
    """SYS_STATUS as ArduCopter 4.5.7 sends it.

    The position bits follow the mode, the logging bit arming, the geofence bit FENCE_ENABLE and the breach.
    """
    state = report.state
    battery = state.battery
    estimator = state.estimator
    controlled = _CONTROLLED.get(report.commander.mode, 0)
    enabled = _ALWAYS | _GPS | _AHRS | _PREARM | controlled
    enabled |= _LOGGING if state.armed else 0
    parameters = state.parameters
    has_fence = parameters.get("FENCE_ENABLE", 0) and parameters.get("FENCE_ACTION", 0)
    enabled |= _GEOFENCE if has_fence else 0
    health = _ALWAYS | _LOGGING | _PROXIMITY | controlled
    health |= _GPS if estimator.gps_ok else 0
    health |= _AHRS if estimator.position_valid else 0
    health &= ~_RC if state.pilot.radio_lost(state.now_s) else -1
    health |= 0 if state.fence_breached or state.conditions.fence_breach else _GEOFENCE
    health |= _PREARM if report.commander.ready_to_arm else 0
    return (
        _PRESENT,
        enabled,
        health,
        0,
        int(battery.voltage_v * 1000.0),
        int(battery.current_a * 100.0),
        round(battery.remaining * 100.0),
        *(0,) * 9,
    )


def extended_sys_state(report: Report) -> Fields:
    """EXTENDED_SYS_STATE."""
    return (0, report.commander.landed_state)


def battery_status(report: Report) -> Fields:
    """BATTERY_STATUS."""
    battery = report.state.battery
    voltage_v = battery.voltage_v
    voltages = (int(voltage_v * 1000.0 + 0.5), *(_NO_CELL,) * 9)
    share = battery.remaining
    charge_state = 1 if share > 0.15 else 2 if share > 0.07 else 3 if share > 0.05 else 4
    return (
        0,
        0,
        0,
        _NO_TEMPERATURE,
        voltages,
        int(battery.current_a * 100.0),
        int(battery.consumed_mah),
        int(battery.consumed_mah * voltage_v * _HECTOJOULES),
        round(share * 100.0),
        0,
        charge_state,
        (0, 0, 0, 0),
        0,
        0,
    )


def home_position(report: Report) -> Fields | None:
    """HOME_POSITION, or nothing while there is no home."""
    state = report.state
    if state.home_m is None:
        return None
    lat, lon, alt = state.frame.to_geodetic(*state.home_m)
    return (
        round(lat * 1e7),
        round(lon * 1e7),
        round(alt * 1e3),
        *state.home_m,
        quaternion_of(*state.home_attitude[:3]),
        0.0,
        0.0,
        0.0,
        max(0, int((state.home_s - state.booted_s) * 1e6)),
    )


def gps_global_origin(report: Report) -> Fields | None:
    """GPS_GLOBAL_ORIGIN, or nothing while there is no position."""
    state = report.state
    if not state.estimator.global_valid and state.home_m is None:
        return None
    lat, lon, alt = state.frame.origin
    return (round(lat * 1e7), round(lon * 1e7), round(alt * 1e3), report.boot_us)


def gps_raw_int(report: Report) -> Fields:
    """GPS_RAW_INT: the receiver's last reading with the accuracies of PX4's simulation."""
    state = report.state
    if not state.estimator.gps_ok:
        return (report.boot_us, 0, 0, 0, 0, 0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF, 0, 0, 0, 0, 0, 0, 0)
    fix = state.sensors.fix
    lat, lon, alt = state.frame.to_geodetic(*fix.position_m)
    v_n, v_e, _ = fix.velocity_m_s
    worse = min(state.estimator.eph_m / EPH_M, 500.0)
    return (
        max(0, report.boot_us - int((state.now_s - fix.at_s) * 1e6)),
        report.flavour.fix_type,
        round(lat * 1e7),
        round(lon * 1e7),
        round(alt * 1e3),
        int(_HDOP_CENTI * worse),
        int(_VDOP_CENTI * worse),
        min(int(math.hypot(v_n, v_e) * 100.0), 0xFFFE),
        heading_cdeg(math.atan2(v_e, v_n)),
        _SATELLITES,
        round(alt * 1e3),
        int(_H_ACC_MM * worse),
        int(_V_ACC_MM * worse),
        _SPEED_ACC_MM_S,
        0,
        0,
    )


def ekf_status_report(report: Report) -> Fields:
    """EKF_STATUS_REPORT; EKF3 reports each predicted position (256, 512) with the position itself (8, 16)."""
    estimator = report.state.estimator
    flags = 1 | (32 if estimator.altitude_valid else 0)
    flags |= 2 | 4 | 8 | 256 if estimator.position_valid else 128
    flags |= 16 | 512 if estimator.global_valid else 0
    bad = 0.0 if estimator.position_valid else 1.0
    return (flags, 0.05 + bad, 0.02 + bad, 0.02, 0.02, 0.0, 0.0)


def system_time(report: Report) -> Fields:
    """SYSTEM_TIME."""
    return (report.unix_us if report.state.estimator.gps_ok else 0, report.boot_ms)


def ping(report: Report) -> Fields:
    """PING, a broadcast request."""
    report.sequence = (report.sequence + 1) & 0xFFFFFFFF
    return (report.boot_us, report.sequence, 0, 0)


def timesync(report: Report) -> Fields:
    """TIMESYNC, a request."""
    return (0, report.boot_us * 1000)


def mission_current(report: Report) -> Fields:
    """MISSION_CURRENT."""
    if not report.commander.mission.ends_for_good:
        # The number stays when another mission is uploaded, and home does not count.
        mission = report.commander.mission
        in_auto = report.commander.mode == "AUTO"
        number = mission.current
        if mission.over == "finished":
            number = max(number - 1, 0)
        if mission.count < 2:
            stage = 1
        elif mission.over:
            stage = 5
        else:
            stage = 3 if in_auto and report.state.armed else 2
        return number, max(mission.count - 1, 0), stage, int(in_auto)
    mission = report.commander.mission
    count = mission.count
    mode = report.commander.mode
    navigates = mode in _NAVIGATED
    active = mode == "MISSION" or navigates
    if not count or not mission.valid:
        stage = 1
    elif mission.over and not navigates:
        stage = 5
    elif active:
        stage = 3
    else:
        stage = 4 if mission.current > 0 else 2
    return (
        min(mission.current, max(count - 1, 0)),
        count if count else 0xFFFF,
        stage,
        1 if active else 2,
    )


def current_mode(report: Report) -> Fields:
    """CURRENT_MODE, with the standard mode of the present one and the intended mode."""
    number = report.commander.custom_mode
    return (report.standard_modes.get(number, 0), number, report.commander.intended_mode)


def rc_channels(report: Report) -> Fields:
    """RC_CHANNELS; without channels while there is no radio."""
    pilot = report.state.pilot
    if not pilot.fresh(report.state.now_s, 0.5):
        return (report.boot_ms, 0, *(0xFFFF,) * 18, 255)
    sticks = pilot.overriding(
        pilot.sticks, report.state.now_s, override_time_s(report.state.parameters)
    )
    raw = tuple(
        round(1500.0 + 500.0 * value)
        for value in (sticks.roll, sticks.pitch, sticks.throttle, sticks.yaw)
    )
    return (report.boot_ms, 8, *raw, *(1500,) * 4, *(0xFFFF,) * 10, 200)


def servo_output_raw(report: Report) -> Fields:
    """SERVO_OUTPUT_RAW: the mean throttle on four motors, and the outputs that DO_SET_SERVO has set."""
    state = report.state
    throttle = 0.0
    if state.armed:
        throttle = min(1.0, 0.5 * state.body.thrust_m_s2 / GRAVITY_M_S2)  # half hovers
    pulse_us = int(_PWM_LOW + (_PWM_HIGH - _PWM_LOW) * throttle)
    time_usec = report.boot_us & 0xFFFFFFFF
    port = 0
    motors = (pulse_us,) * 4
    others = (state.servos.get(channel, 0) for channel in range(5, 17))
    return (time_usec, port, *motors, *others)


def wind(report: Report) -> Fields:
    """WIND (ArduPilot), with the direction of its source."""
    north, east, down = report.state.conditions.wind_m_s
    return (math.degrees(math.atan2(-east, -north)) % 360.0, math.hypot(north, east), down)


def fence_status(report: Report) -> Fields:
    """FENCE_STATUS."""
    state = report.state
    breached = state.fence_breached or state.conditions.fence_breach
    return (
        int(breached),
        int(breached),
        3 if breached else 0,
        report.boot_ms if breached else 0,
        0,
    )


def power_status(_report: Report) -> Fields:
    """POWER_STATUS."""
    return (5000, 0, 0)


def nav_controller_output(report: Report) -> Fields:
    """NAV_CONTROLLER_OUTPUT."""
    state = report.state
    roll, pitch, yaw = (math.degrees(value) for value in state.attitude[:3])
    goal = report.setpoint.position_ned_m
    north = goal[0] - state.position_m[0]
    east = goal[1] - state.position_m[1]
    away = int(min(math.hypot(north, east), 65535.0)) if math.isfinite(north + east) else 0
    bearing = int(math.degrees(math.atan2(east, north))) if away else int(yaw)
    error = state.position_m[2] - goal[2]
    return (roll, pitch, int(yaw), bearing, away, error if math.isfinite(error) else 0.0, 0.0, 0.0)


def vibration(report: Report) -> Fields:
    """VIBRATION."""
    level = 0.02 if report.state.armed else 0.0
    return (report.boot_us, level, level, level, 0, 0, 0)


def protocol_version(_report: Report) -> Fields:
    """PROTOCOL_VERSION: MAVLink 2, 1 understood."""
    return (200, 100, 200, (0,) * 8, (0,) * 8)


def flight_information(report: Report) -> Fields:
    """FLIGHT_INFORMATION: time of arming."""
    state = report.state
    armed_us = report.unix_us - int((state.now_s - state.armed_s) * 1e6) if state.armed else 0
    return (report.boot_ms, armed_us, armed_us if state.flew and state.armed else 0, 0, 0)


def storage_information(report: Report) -> Fields:
    """STORAGE_INFORMATION: there is no card."""
    return (report.boot_ms, 0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, b"", 0)


STATUS: Mapping[str, Callable[[Report], Fields | None]] = MappingProxyType(
    {
        "HEARTBEAT": heartbeat,
        "SYS_STATUS": sys_status,
        "EXTENDED_SYS_STATE": extended_sys_state,
        "BATTERY_STATUS": battery_status,
        "HOME_POSITION": home_position,
        "GPS_GLOBAL_ORIGIN": gps_global_origin,
        "GPS_RAW_INT": gps_raw_int,
        "EKF_STATUS_REPORT": ekf_status_report,
        "SYSTEM_TIME": system_time,
        "PING": ping,
        "TIMESYNC": timesync,
        "MISSION_CURRENT": mission_current,
        "CURRENT_MODE": current_mode,
        "RC_CHANNELS": rc_channels,
        "SERVO_OUTPUT_RAW": servo_output_raw,
        "WIND": wind,
        "FENCE_STATUS": fence_status,
        "POWER_STATUS": power_status,
        "NAV_CONTROLLER_OUTPUT": nav_controller_output,
        "VIBRATION": vibration,
        "PROTOCOL_VERSION": protocol_version,
        "FLIGHT_INFORMATION": flight_information,
        "STORAGE_INFORMATION": storage_information,
    }
)
