"""The PX4 flavour: all its parts, and its files over FTP (PX4's folders with its component metadata)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from sitl_mock.dynamics import (
    PX4_GROUND_WANDER,
    PX4_TRAVEL,
    PX4_WANDER,
    Px4Gains,
    Vehicle,
    px4_quadrotor,
)
from sitl_mock.parameters import parameters_of
from sitl_mock.protocols import (
    PX4_BROADCAST,
    PX4_GCS_HZ,
    PX4_LOG_RULES,
    PX4_MISSION_RULES,
    PX4_ONBOARD_HZ,
    PX4_OWN_ID_ONLY,
    PX4_PARAMETER_RULES,
    PX4_STREAM_RULES,
    QUIET_HZ,
    FileTree,
    PlanStore,
    Storage,
    px4_identity,
)
from sitl_mock.px4 import metadata
from sitl_mock.px4.commander import Px4
from sitl_mock.px4.commands import execute
from sitl_mock.px4.events import event_of, with_tab
from sitl_mock.px4.flight_log import Px4FlightLog
from sitl_mock.px4.modes import MODES
from sitl_mock.px4.shell import answer_to
from sitl_mock.px4.tasks import fly
from sitl_mock.px4.topic_link import TopicLink
from sitl_mock.vehicle.flavour import Flavour
from sitl_mock.vehicle.sensors import PX4_SENSORS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sitl_mock.protocols import ParameterStore
    from sitl_mock.vehicle.state import VehicleState


def px4_files(parameters: ParameterStore, _plans: PlanStore, storage: Storage) -> FileTree:
    """Return the files of one vehicle."""
    return FileTree(
        metadata.metadata_files(parameters),
        frozenset({"/etc", "/etc/init.d", "/log", "/tmp", "/eeprom"}),
        storage=storage,
    )


_GAINS: Final = {
    "xy_p_1_s": "MPC_XY_P",
    "z_p_1_s": "MPC_Z_P",
    "xy_vel_p_1_s": "MPC_XY_VEL_P_ACC",
    "xy_vel_i_1_s2": "MPC_XY_VEL_I_ACC",
    "xy_vel_d": "MPC_XY_VEL_D_ACC",
    "z_vel_p_1_s": "MPC_Z_VEL_P_ACC",
    "z_vel_i_1_s2": "MPC_Z_VEL_I_ACC",
    "xy_vel_max_m_s": "MPC_XY_VEL_MAX",
    "up_max_m_s": "MPC_Z_VEL_MAX_UP",
    "down_max_m_s": "MPC_Z_VEL_MAX_DN",
    "thrust_min": "MPC_THR_MIN",
    "spool_s": "COM_SPOOLUP_TIME",
    "ramp_s": "MPC_TKO_RAMP_T",
    "xy_error_max_m": "MPC_XY_ERR_MAX",
}
_TRAVEL: Final = {
    "speed_m_s": "MPC_XY_CRUISE",
    "climb_m_s": "MPC_Z_V_AUTO_UP",
    "sink_m_s": "MPC_Z_V_AUTO_DN",
    "accel_m_s2": "MPC_ACC_HOR",
    "brake_m_s2": "MPC_ACC_HOR_MAX",
    "accel_z_m_s2": "MPC_ACC_UP_MAX",
    "jerk_m_s3": "MPC_JERK_AUTO",
    "jerk_z_m_s3": "MPC_JERK_AUTO",
}


def px4_commander(state: VehicleState, plans: PlanStore) -> Px4:
    """Make PX4's commander with its commands and modes."""
    return Px4(state, plans, execute, fly)


def plant(parameters: Mapping[str, float]) -> Vehicle:
    """Make the quadrotor's dynamics for these parameters."""
    gains = {name: float(parameters[parameter]) for name, parameter in _GAINS.items()}
    limits: dict[str, Any] = {
        name: float(parameters[parameter]) for name, parameter in _TRAVEL.items()
    }
    return px4_quadrotor(
        Px4Gains(
            tilt_max_rad=math.radians(float(parameters["MPC_TILTMAX_AIR"])),
            tilt_ground_rad=math.radians(float(parameters["MPC_TILTMAX_LND"])),
            **gains,
        ),
        replace(PX4_TRAVEL, **limits),
    )


_WITHHELD: Final = frozenset(
    {"AHRS", "AHRS2", "EKF_STATUS_REPORT", "FENCE_STATUS", "POWER_STATUS", "RAW_IMU", "WIND"}
)
"""Messages that PX4 v1.17 does not know."""

PX4: Final = Flavour(
    name="px4",
    title="PX4 1.17 quadrotor",
    autopilot=12,
    vehicle_type=2,
    modes=MODES,
    parameters=parameters_of("px4"),
    parameter_rules=PX4_PARAMETER_RULES,
    stream_rules=PX4_STREAM_RULES,
    withheld=_WITHHELD,
    mission_rules=PX4_MISSION_RULES,
    log_rules=PX4_LOG_RULES,
    rates_hz={"onboard": PX4_ONBOARD_HZ, "gcs": PX4_GCS_HZ, "quiet": QUIET_HZ},
    identity=px4_identity,
    plant=plant,
    commander=px4_commander,
    recorder=Px4FlightLog,
    wander=PX4_WANDER,
    ready_s=5.0,
    texts=None,
    text_as_sent=with_tab,
    event_of=event_of,
    files=px4_files,
    metadata=lambda parameters: (f"mftp://{metadata.GENERAL}", metadata.general_crc(parameters)),
    own_id_only=PX4_OWN_ID_ONLY,
    broadcast=PX4_BROADCAST,
    sensors=PX4_SENSORS,
    ground_wander=PX4_GROUND_WANDER,
    streams_log=True,
    shell=answer_to,
    takes_keys=False,
    topics=TopicLink,
)
