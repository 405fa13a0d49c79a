"""PX4's topics, as its log, its shell's `listener` and Zenoh have them: one builder per topic.

`topics.csv` has each topic's message, the interval of PX4's default log profile, and its rate over Zenoh as measured.
Builders return the values in the order of the log. Fields that the mock has no value for are 0 or NaN, as in PX4.
"""

from __future__ import annotations

import csv
import math
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Final, NamedTuple, cast

from sitl_mock.dynamics import Kind
from sitl_mock.dynamics.values import GRAVITY_M_S2, quaternion_of
from sitl_mock.logs.ulog import Topic
from sitl_mock.px4.external_modes import NAME_OF
from sitl_mock.px4.messages import MessageType, message_type
from sitl_mock.px4.modes import BY_NAME, NAV_STATES
from sitl_mock.telemetry.px4 import RESETS_AT_START, trajectory
from sitl_mock.vector import Vector
from sitl_mock.vehicle.modes import Need

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sitl_mock.px4.commander import Px4
    from sitl_mock.telemetry import Report

Values = tuple[Any, ...]

_HOLD: Final = NAV_STATES["HOLD"][0]
_STATE_OF_NUMBER: Final = {BY_NAME[name].number: state for name, (state, _) in NAV_STATES.items()}
_ARMED: Final = 2
_DISARMED: Final = 1
_QUADROTOR: Final = 2
_ROTARY_WING: Final = 1
_VALID_MODES: Final = 2147411327
_MODES_TO_SET: Final = 8308095
_NAN: Final = math.nan
_INF: Final = math.inf
_NO_CHANGE: Final = (1.0, 0.0, 0.0, 0.0)


def state_of(custom_mode: int) -> int:
    """Return the number of a mode in PX4's messages, from the one in HEARTBEAT."""
    return _STATE_OF_NUMBER.get(custom_mode, _HOLD)


def vehicle_attitude(report: Report) -> Values:
    """Attitude as a quaternion."""
    roll, pitch, yaw, _, _, _ = report.state.attitude
    quaternion = quaternion_of(roll, pitch, yaw)
    return (report.boot_us, report.boot_us, *quaternion, *_NO_CHANGE, 1)


def vehicle_local_position(report: Report) -> Values:
    """Estimated position and velocity in the local frame."""
    state = report.state
    estimator = state.estimator
    body = state.body
    now_us = report.boot_us
    lat, lon, alt = state.frame.origin
    yaw = state.attitude.yaw_rad
    v_down = state.velocity_m_s[2]
    above_m = state.ground_m - state.position_m[2]
    level = estimator.position_valid
    high = estimator.altitude_valid
    return (
        *(now_us, now_us, 0, lat, lon),
        *(*state.position_m, 0.0, 0.0, 0.0),
        *(*state.velocity_m_s, v_down, 0.0, 0.0, 0.0),
        *body.acceleration_ned_m_s2,
        *(yaw, 0.01, yaw, 0.0, 0.001, alt),
        *(above_m, 0.004, 0.0),
        *(estimator.eph_m, 0.07, 0.14, 0.03, _INF, _INF, _INF, _INF, _INF),
        *(level, high, level, high, 4, 2, 3, 1, 1, not body.on_ground),
        *(estimator.global_valid, high, high, 2, 1, not estimator.gps_ok),
    )


def vehicle_global_position(report: Report) -> Values:
    """Estimated place on Earth."""
    state = report.state
    estimator = state.estimator
    lat, lon, alt = report.place
    ground_m = state.frame.origin.alt_amsl_m - state.ground_m
    valid = estimator.global_valid
    return (
        *(report.boot_us, report.boot_us, lat, lon, alt, alt, 0.0, 0.0),
        *(estimator.eph_m, 0.07, ground_m, valid, estimator.altitude_valid, 4, 2, 2, True),
        not estimator.gps_ok,
    )


def vehicle_local_position_setpoint(report: Report) -> Values:
    """Present setpoint of the position controller."""
    setpoint = report.setpoint
    thrust = (_NAN, _NAN, _NAN)
    return (
        report.boot_us,
        *trajectory(report),
        *thrust,
        setpoint.yaw_rad,
        setpoint.yaw_rate_rad_s,
    )


def trajectory_setpoint(report: Report) -> Values:
    """The setpoint of the mode or of the stream; NaN marks axes that it leaves free."""
    setpoint = report.setpoint
    return (
        report.boot_us,
        *setpoint.position_ned_m,
        *setpoint.velocity_ned_m_s,
        *setpoint.acceleration_ned_m_s2,
        *(_NAN, _NAN, _NAN),
        setpoint.yaw_rad,
        setpoint.yaw_rate_rad_s,
    )


def battery_status(report: Report) -> Values:
    """The pack of SIH: four cells, of which only the sum is measured."""
    battery = report.state.battery
    voltage_v = battery.voltage_v
    return (
        *(report.boot_us, voltage_v, -1.0, 15.0, -1.0, battery.remaining, 1.0, _NAN, _NAN),
        *((0.0,) * 14),
        *(0.0, 0.0, 0.0, 0.0, 0.005, voltage_v, voltage_v, battery.remaining, 0.0, 0.0, 0.0),
        *((0,) * 9),
        *(True, battery.pack.cells, 0, 0, 1, False, False, _warning(battery.remaining)),
    )


def _warning(share: float) -> int:
    if share > 0.15:
        return 0
    if share > 0.07:
        return 1
    return 2 if share > 0.05 else 3


def vehicle_status(report: Report) -> Values:
    """Arming, modes and failsafe."""
    state = report.state
    commander = report.commander
    armed_us = 0
    if state.armed:
        armed_us = max(0, report.boot_us - int((state.now_s - state.armed_s) * 1e6))
    px4 = _px4(report)
    selectable = _MODES_TO_SET
    for number in px4.external.modes:
        selectable |= 1 << number
        replaced = px4.external.internal(NAME_OF[number])
        if replaced != NAME_OF[number]:
            selectable &= ~(1 << NAV_STATES[replaced][0])
    failsafe = commander.system_status == 5
    return (
        *(report.boot_us, armed_us, armed_us if state.flew else 0, 0),
        *(_VALID_MODES, selectable, 0, _ARMED if state.armed else _DISARMED, 0, 0),
        *(state_of(commander.intended_mode), NAV_STATES[commander.mode][0]),
        *(px4.external.in_charge, 0, _ROTARY_WING),
        *(failsafe, False, 0, _no_station(report), 0, False, False, False, False, False),
        *(_QUADROTOR, state.system_id, 1, True, True, True, False, False, False, False, False),
        *(False, False, commander.ready_to_arm),
    )


def vehicle_land_detected(report: Report) -> Values:
    """True if it stands on the ground."""
    down = report.commander.landed_state == 1
    moving = not report.state.on_ground
    return (
        report.boot_us,
        *(False, down, down, down, False, False, not report.state.armed),
        *(moving, moving, moving, not moving, not moving),
    )


_VELOCITY_VARIANCE: Final = (0.02, 0.02, 0.01)
_NED: Final = 1


def vehicle_odometry(report: Report) -> Values:
    """Position, attitude, velocities and their variances, in the local frame."""
    state = report.state
    roll, pitch, yaw, *rates = state.attitude
    level = state.estimator.eph_m**2 * 0.27
    high = 0.0052 if state.body.on_ground else 0.1
    return (
        *(report.boot_us, report.boot_us),
        *(*state.position_m, *quaternion_of(roll, pitch, yaw), *state.velocity_m_s, *rates),
        *(level, level, high, 1e-4, 1e-4, 4e-3, *_VELOCITY_VARIANCE),
        *(_NED, _NED, (state.estimator.reset_counter + RESETS_AT_START) & 0xFF, 0),
    )


_MANUAL: Final = "manual"
_AUTO: Final = "auto"
_RATES: Final = frozenset({"rates", "allocation"})
_LEVELLED: Final = _RATES | {"attitude"}
_CLIMBING: Final = _LEVELLED | {"climb"}
_HEIGHT: Final = _CLIMBING | {"altitude"}
_PLACE: Final = _HEIGHT | {"position", "velocity"}
_CONTROLLED: Final[Mapping[str, frozenset[str]]] = {
    **dict.fromkeys(("MANUAL", "STABILIZED"), _LEVELLED | {_MANUAL}),
    **dict.fromkeys(("ALTCTL", "ALTITUDE_CRUISE"), _HEIGHT | {_MANUAL}),
    **dict.fromkeys(("POSCTL", "POSITION_SLOW"), _PLACE | {_MANUAL}),
    **dict.fromkeys(("RTL", "LAND", "PRECLAND", "MISSION", "HOLD", "TAKEOFF"), _PLACE | {_AUTO}),
    **dict.fromkeys(("FOLLOW", "ORBIT"), _PLACE),
    "ACRO": _RATES | {_MANUAL},
    "DESCEND": _CLIMBING | {_AUTO},
    "TERMINATION": frozenset({"termination"}),
    "OFFBOARD": _HEIGHT | {"velocity", "acceleration", "offboard"},
}
"""Controlled quantities in each mode (``control_mode.cpp``); OFFBOARD with velocities."""
_BY_DEFAULT: Final = _PLACE | {"acceleration"}
"""Of an external mode that has not declared any."""
_CONTROLS: Final = (
    *("manual", "auto", "offboard", "position", "velocity", "altitude", "climb"),
    *("acceleration", "attitude", "rates", "allocation", "termination"),
)
_BY_POSITION: Final = frozenset({"altitude", "climb", "position", "velocity", "acceleration"})


def vehicle_control_mode(report: Report) -> Values:
    """Quantities that PX4 controls now."""
    controlled = _CONTROLLED.get(report.commander.mode, _BY_DEFAULT)
    flags = tuple(name in controlled for name in _CONTROLS)
    return (report.boot_us, report.state.armed, bool(controlled & _BY_POSITION), *flags, 0)


_REQUIRED: Final[Mapping[str, int]] = {
    "mode_req_angular_velocity": 8312190,
    "mode_req_attitude": 8311166,
    "mode_req_local_alt": 8257918,
    "mode_req_local_position": 7995448,
    "mode_req_local_position_relaxed": 262212,
    "mode_req_global_position": 56,
    "mode_req_global_position_relaxed": 0,
    "mode_req_mission": 8,
    "mode_req_offboard_signal": 16384,
    "mode_req_home_position": 32,
    "mode_req_wind_and_flight_time_compliance": 2621464,
    "mode_req_prevent_arming": 3944480,
    "mode_req_manual_control": 34119,
    "mode_req_other": 0,
}
"""Requirements of a multicopter's own modes, as bits by the mode's number (read from PX4 v1.17.0)."""


def failsafe_flags(report: Report) -> Values:
    """Requirements of each mode, and those not met."""
    px4 = _px4(report)
    state = report.state
    missing = {need: need not in px4.met_needs for need in Need}
    no_level = missing[Need.LOCAL_POSITION]
    no_place = missing[Need.GLOBAL_POSITION]
    return (
        report.boot_us,
        *px4.external.required(_REQUIRED),
        *(False, False, missing[Need.ALTITUDE], no_level, no_level, no_level, no_place, no_place),
        *(missing[Need.MISSION], missing[Need.STREAM], missing[Need.HOME], missing[Need.PILOT]),
        *(_no_station(report), _warning(state.battery.remaining), False, False),
        *("geofence violated" in px4.failsafes.since_s, *((False,) * 10)),
    )


def _no_station(report: Report) -> bool:
    """True if no ground station is heard."""
    never = math.isinf(report.state.peers.ground_s)
    return never or "ground station lost" in _px4(report).lost_peers


def manual_control_setpoint(report: Report) -> Values:
    """The pilot's sticks."""
    sticks = report.state.pilot.sticks
    return (
        *(report.boot_us, report.boot_us, sticks.roll, sticks.pitch, sticks.yaw, sticks.throttle),
        *((_NAN,) * 7),
        *(0, True, _BY_MAVLINK, False),
    )


_BY_MAVLINK: Final = 2


def sensor_combined(report: Report) -> Values:
    """Body rates and specific force with the sensors' noise."""
    state = report.state
    noise = state.sensors.noise
    scatter = state.sensors.scatter()
    push = -(GRAVITY_M_S2 if state.body.on_ground else state.body.thrust_m_s2)
    rates = (
        rate + noise.gyro_sd_rad_s * by
        for rate, by in zip(state.attitude[3:], scatter[3:6], strict=True)
    )
    force = (
        along + noise.accelerometer_sd_m_s2 * by
        for along, by in zip((0.0, 0.0, push), scatter[:3], strict=True)
    )
    return (report.boot_us, *rates, _IMU_US, 0, *force, _IMU_US, 0, 0, 0, 1)


_IMU_US: Final = 4000


def vehicle_gps_position(report: Report) -> Values:
    """The last reading of SIH's receiver."""
    state = report.state
    fix = state.sensors.fix
    lat, lon, alt = state.frame.to_geodetic(*fix.position_m)
    north, east, down = fix.velocity_m_s
    speed = math.hypot(north, east, down)
    kind = 3 if state.estimator.gps_ok else 0
    return (
        *(report.boot_us, report.boot_us, lat, lon, alt, alt, 0),
        *(_RECEIVER, 0.4, 0.1, 0.9, 1.78, 0.7, 1.1, 0, 0),
        *(speed, north, east, down, math.atan2(east, north), 0, 0, _NAN, _NAN, 0.0, 0.0),
        *(0, kind, 0, 0, 0, True, 10, 0, False, 0),
    )


_RECEIVER: Final = 11468804
"""SIH's device id."""


def estimator_status_flags(report: Report) -> Values:
    """Sources of the estimator, on the ground and in the air."""
    on_ground = report.state.body.on_ground
    used = _USED | (_USED_ON_GROUND if on_ground else _USED_IN_THE_AIR)
    names = [field.name for field in message_type("EstimatorStatusFlags").in_log_order[5:]]
    flags = (name in used for name in names)
    return (report.boot_us, report.boot_us, 14 if on_ground else 20, 0, 2, *flags)


_GOAL_TYPES: Final = {"TAKEOFF": 3, "LAND": 4, "PRECLAND": 4, "HOLD": 2}
_POSITION: Final = 0
_IDLE: Final = 5
_NO_GOAL: Final = (False, _IDLE, 0.0, 0.0, 0.0, _NAN, _NAN, 0.0, _NAN)


def position_setpoint_triplet(report: Report) -> Values:
    """The navigator's last, present and next goal, in the order of the wire."""
    stamp = report.boot_us
    goal = _NO_GOAL
    if report.state.armed and report.setpoint.kind is Kind.TRAVEL:
        to = Vector(
            here if math.isnan(there) else there
            for there, here in zip(
                report.setpoint.position_ned_m, report.state.position_m, strict=True
            )
        )
        lat, lon, alt = report.state.frame.to_geodetic(*to)
        kind = _GOAL_TYPES.get(report.commander.mode, _POSITION)
        goal = (True, kind, 0.0, 0.0, 0.0, lat, lon, alt, report.setpoint.yaw_rad)
    rest = (80.0, 0.0, False, 0.0, 0, 2.0, 0.0, -1.0, False, _NAN)
    return (
        stamp,
        *(stamp, *_NO_GOAL, *rest),
        *(stamp, *goal, *rest),
        *(stamp, *_NO_GOAL, *rest),
    )


_USED: Final = frozenset(
    f"cs_{name}"
    for name in (
        *("tilt_align", "yaw_align", "gnss_pos", "baro_hgt", "gps_hgt", "rng_kin_consistent"),
        *("mag", "mag_heading_consistent", "rng_terrain", "gnss_vel"),
    )
)
_USED_ON_GROUND: Final = frozenset({"cs_mag_hdg", "cs_mag_dec", "cs_rng_hgt", "cs_vehicle_at_rest"})
_USED_IN_THE_AIR: Final = frozenset({"cs_mag_3d", "cs_in_air", "cs_mag_aligned_in_flight"})


def _px4(report: Report) -> Px4:
    """Return the commander of a PX4."""
    return cast("Px4", report.commander)


class Source(NamedTuple):
    """A topic and its builder.

    Attributes:
        topic: Its format in the log.
        every: Interval in the log in steps of 50 ms; 0 if it is not logged.
        build: Returns its values in the order of the log.
        message: Its message.
        hz: Its rate over Zenoh; 0 if it is not sent there.
    """

    topic: Topic
    every: int
    build: Callable[[Report], Values]
    message: MessageType
    hz: float


STEP_MS: Final = 50
"""The log's shortest interval."""
_BUILDERS: Final[Mapping[str, Callable[[Report], Values]]] = {
    build.__name__: build
    for build in (
        *(vehicle_attitude, vehicle_local_position, vehicle_local_position_setpoint),
        *(trajectory_setpoint, vehicle_global_position, battery_status, vehicle_status),
        *(vehicle_land_detected, vehicle_control_mode, vehicle_odometry, failsafe_flags),
        *(manual_control_setpoint, sensor_combined, vehicle_gps_position, estimator_status_flags),
    )
}


_ROWS: Final = files("sitl_mock.px4").joinpath("topics.csv").read_text(encoding="utf-8")
SOURCES: Final[Mapping[str, Source]] = {
    row["name"]: Source(
        Topic(row["name"], message_type(row["message"]).log_format, number),
        int(row["log_ms"] or 0) // STEP_MS,
        _BUILDERS[row["name"]],
        message_type(row["message"]),
        float(row["zenoh_hz"] or 0.0),
    )
    for number, row in enumerate(csv.DictReader(_ROWS.splitlines()))
}
"""The topics by name."""
LOGGED: Final[Mapping[str, Source]] = {
    name: source for name, source in SOURCES.items() if source.every
}
"""Those of the log."""
