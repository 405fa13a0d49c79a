"""PX4's topics, as its log and its shell's `listener` have them: one builder per topic, the fields in PX4's order.

`topics.csv` has each topic's fields and the interval of PX4's default log profile. Fields that the mock has no value
for are 0 or NaN, as in PX4.
"""

from __future__ import annotations

import csv
import math
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sitl_mock.dynamics.values import quaternion_of
from sitl_mock.logs.ulog import Topic
from sitl_mock.px4.modes import BY_NAME
from sitl_mock.telemetry.px4 import trajectory

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sitl_mock.telemetry import Report

Values = tuple[Any, ...]

NAV_STATES: Final[Mapping[str, tuple[int, str]]] = {
    "MANUAL": (0, "Manual"),
    "ALTCTL": (1, "Altitude"),
    "POSCTL": (2, "Position"),
    "MISSION": (3, "Mission"),
    "HOLD": (4, "Hold"),
    "RTL": (5, "Return"),
    "POSITION_SLOW": (6, "Position Slow"),
    "ALTITUDE_CRUISE": (8, "Altitude Cruise"),
    "ACRO": (10, "Acro"),
    "DESCEND": (12, "Descend"),
    "TERMINATION": (13, "Termination"),
    "OFFBOARD": (14, "Offboard"),
    "STABILIZED": (15, "Stabilized"),
    "TAKEOFF": (17, "Takeoff"),
    "LAND": (18, "Land"),
    "FOLLOW": (19, "Follow Target"),
    "PRECLAND": (20, "Precision Landing"),
    "ORBIT": (21, "Orbit"),
    **{f"EXTERNAL{index}": (22 + index, f"External {index}") for index in range(1, 9)},
}
"""Number and name of each mode (``VehicleStatus.msg``, ``mode_util``)."""
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
    failsafe = commander.system_status == 5
    return (
        *(report.boot_us, armed_us, armed_us if state.flew else 0, 0),
        *(_VALID_MODES, _MODES_TO_SET, 0, _ARMED if state.armed else _DISARMED, 0, 0),
        *(state_of(commander.intended_mode), NAV_STATES[commander.mode][0]),
        *(0, 0, _ROTARY_WING),
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


class Source(NamedTuple):
    """A topic, the intervals of its log in steps of 50 ms, and its builder."""

    topic: Topic
    every: int
    build: Callable[[Report], Values]


STEP_MS: Final = 50
"""The log's shortest interval."""
_BUILDERS: Final[Mapping[str, Callable[[Report], Values]]] = {
    "vehicle_attitude": vehicle_attitude,
    "vehicle_local_position": vehicle_local_position,
    "vehicle_local_position_setpoint": vehicle_local_position_setpoint,
    "trajectory_setpoint": trajectory_setpoint,
    "vehicle_global_position": vehicle_global_position,
    "battery_status": battery_status,
    "vehicle_status": vehicle_status,
    "vehicle_land_detected": vehicle_land_detected,
}


def _sources() -> dict[str, Source]:
    text = files("sitl_mock.px4").joinpath("topics.csv").read_text(encoding="utf-8")
    sources = {}
    for number, row in enumerate(csv.DictReader(text.splitlines())):
        name = row["name"]
        topic = Topic(name, row["fields"], number)
        sources[name] = Source(topic, int(row["interval_ms"]) // STEP_MS, _BUILDERS[name])
    return sources


SOURCES: Final[Mapping[str, Source]] = _sources()
"""The topics by name."""
