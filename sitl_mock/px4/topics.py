"""PX4's topics, as its log, its shell's `listener` and Zenoh have them: one builder per topic.

`topics.csv` has each topic's message, the interval of PX4's default log profile, and its rate over Zenoh as measured.
Builders return the values in the order of the log. Fields that the mock has no value for are 0 or NaN, as in PX4.
"""

from __future__ import annotations

import csv
import math
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Final, NamedTuple, cast

from sitl_mock.dynamics.values import quaternion_of
from sitl_mock.logs.ulog import Topic
from sitl_mock.modes import Need
from sitl_mock.px4.external_modes import EXTERNAL, NAME_OF
from sitl_mock.px4.messages import MessageType, message_type
from sitl_mock.px4.modes import BY_NAME, NAV_STATES
from sitl_mock.telemetry.px4 import RESETS_AT_START, trajectory

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
    """What the position controller follows at this moment."""
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
        *(failsafe, False, 0, False, 0, False, False, False, False, False),
        *(_QUADROTOR, state.system_id, 1, True, True, True, False, False, False, False, False),
        *(False, False, commander.ready_to_arm),
    )


def vehicle_land_detected(report: Report) -> Values:
    """Whether it stands on the ground."""
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
"""What PX4 controls in each mode (``control_mode.cpp``); OFFBOARD with velocities."""
_BY_DEFAULT: Final = _PLACE | {"acceleration"}
"""In an external mode that has not said what it controls."""
_CONTROLS: Final = (
    *("manual", "auto", "offboard", "position", "velocity", "altitude", "climb"),
    *("acceleration", "attitude", "rates", "allocation", "termination"),
)
_BY_POSITION: Final = frozenset({"altitude", "climb", "position", "velocity", "acceleration"})


def vehicle_control_mode(report: Report) -> Values:
    """What PX4 controls now; in an external mode what that has asked for."""
    px4 = _px4(report)
    asked = px4.external.control_of(px4.mode) if px4.mode in EXTERNAL else None
    if asked is not None:
        flags = tuple(asked[3:15])
        source = asked.source_id
    else:
        controlled = _CONTROLLED.get(px4.mode, _BY_DEFAULT)
        flags = tuple(name in controlled for name in _CONTROLS)
        source = 0
    by_position = any(
        flag for name, flag in zip(_CONTROLS, flags, strict=True) if name in _BY_POSITION
    )
    return (report.boot_us, report.state.armed, by_position, *flags, source)


def failsafe_flags(report: Report) -> Values:
    """What each mode needs, as bits by the mode's number, and what is missing."""
    px4 = _px4(report)
    state = report.state
    met = px4.met_needs
    missing = {need: need not in met for need in Need}
    required = dict.fromkeys(Need, 0)
    no_arming = 0
    for name, (number, _) in NAV_STATES.items():
        entry = BY_NAME[name]
        for need in px4.needs_of(name):
            required[need] |= 1 << number
        if not entry.may_arm:
            no_arming |= 1 << number
    level = required[Need.LOCAL_POSITION]
    place = required[Need.GLOBAL_POSITION]
    warning = _warning(state.battery.remaining)
    no_place = missing[Need.GLOBAL_POSITION]
    no_level = missing[Need.LOCAL_POSITION]
    return (
        report.boot_us,
        *(_FLOWN, _FLOWN, required[Need.ALTITUDE], level, 0, place, 0, required[Need.MISSION]),
        *(required[Need.STREAM], required[Need.HOME], 0, no_arming, required[Need.PILOT]),
        required[Need.REGISTRATION],
        *(False, False, missing[Need.ALTITUDE], no_level, no_level, no_level, no_place, no_place),
        *(missing[Need.MISSION], missing[Need.STREAM], missing[Need.HOME], missing[Need.PILOT]),
        *("ground station lost" in px4.lost_peers, warning, False, False),
        *("geofence violated" in px4.failsafes.since_s, *((False,) * 10)),
    )


_FLOWN: Final = 0x7FFFFFFF ^ 1 << 13
"""Every mode but termination."""


def manual_control_setpoint(report: Report) -> Values:
    """The pilot's sticks."""
    sticks = report.state.pilot.sticks
    return (
        *(report.boot_us, report.boot_us, sticks.roll, sticks.pitch, sticks.yaw, sticks.throttle),
        *((_NAN,) * 7),
        *(0, True, _BY_MAVLINK, False),
    )


_BY_MAVLINK: Final = 2


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
        manual_control_setpoint,
    )
}


def _sources() -> dict[str, Source]:
    text = files("sitl_mock.px4").joinpath("topics.csv").read_text(encoding="utf-8")
    sources = {}
    for number, row in enumerate(csv.DictReader(text.splitlines())):
        name = row["name"]
        message = message_type(row["message"])
        sources[name] = Source(
            Topic(name, message.log_format, number),
            int(row["log_ms"] or 0) // STEP_MS,
            _BUILDERS[name],
            message,
            float(row["zenoh_hz"] or 0.0),
        )
    return sources


SOURCES: Final[Mapping[str, Source]] = _sources()
"""The topics by name."""
LOGGED: Final[Mapping[str, Source]] = {
    name: source for name, source in SOURCES.items() if source.every
}
"""Those of the log."""
