"""The ArduPilot flavours, put together."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from sitl_mock.ardupilot.commander import ArduPilot
from sitl_mock.ardupilot.copter import COPTER
from sitl_mock.ardupilot.files import files_of
from sitl_mock.ardupilot.modes import COPTER_MODES, ROVER_MODES
from sitl_mock.ardupilot.rover import ROVER
from sitl_mock.dynamics import ARDUCOPTER_TRAVEL, ArduGains, Rover, Vehicle, arducopter_quadrotor
from sitl_mock.estimator import ARDUPILOT_WANDER
from sitl_mock.flavour import Flavour
from sitl_mock.parameters import parameters_of
from sitl_mock.protocols import (
    ARDUPILOT_HZ,
    ARDUPILOT_MISSION_RULES,
    ARDUPILOT_PARAMETER_RULES,
    ARDUPILOT_STREAM_RULES,
    PlanStore,
    ardupilot_identity,
)
from sitl_mock.vehicle_state import VehicleState

_GAINS: Final = {
    "xy_p_1_s": "PSC_POSXY_P",
    "z_p_1_s": "PSC_POSZ_P",
    "xy_vel_p_1_s": "PSC_VELXY_P",
    "xy_vel_i_1_s2": "PSC_VELXY_I",
    "xy_vel_d": "PSC_VELXY_D",
    "z_vel_p_1_s": "PSC_VELZ_P",
    "jerk_m_s3": "PSC_JERK_XY",
    "jerk_z_m_s3": "PSC_JERK_Z",
}


def copter_plant(parameters: Mapping[str, float]) -> Vehicle:
    """The quadrotor; its own motions obey the speeds of WPNAV_*, GUIDED only the accelerations (measured)."""
    travel = replace(
        ARDUCOPTER_TRAVEL,
        speed_m_s=float(parameters["WPNAV_SPEED"]) * 0.01,
        climb_m_s=float(parameters["WPNAV_SPEED_UP"]) * 0.01,
        sink_m_s=float(parameters["WPNAV_SPEED_DN"]) * 0.01,
        accel_m_s2=float(parameters["WPNAV_ACCEL"]) * 0.01,
        accel_z_m_s2=float(parameters["WPNAV_ACCEL_Z"]) * 0.01,
    )
    lean_deg = float(parameters["PSC_ANGLE_MAX"]) or float(parameters["ANGLE_MAX"]) * 0.01
    gains = ArduGains(
        accel_m_s2=travel.accel_m_s2,
        accel_z_m_s2=travel.accel_z_m_s2,
        lean_max_rad=math.radians(lean_deg),
        yaw_rate_max_rad_s=math.radians(float(parameters["ATC_SLEW_YAW"]) * 0.01),
        **{name: float(parameters[parameter]) for name, parameter in _GAINS.items()},
    )
    return arducopter_quadrotor(gains, travel)


def rover_plant(parameters: Mapping[str, float]) -> Vehicle:
    """The rover; GUIDED velocities may exceed CRUISE_SPEED."""
    return Rover(
        accel_m_s2=float(parameters["ATC_ACCEL_MAX"]) or 2.0,
        turn_rate_max_rad_s=math.radians(float(parameters["ATC_STR_RAT_MAX"])) or math.radians(90.0),
    )


def copter_commander(state: VehicleState, plans: PlanStore) -> ArduPilot:
    """An ArduCopter."""
    return ArduPilot(state, plans, COPTER)


def rover_commander(state: VehicleState, plans: PlanStore) -> ArduPilot:
    """A Rover."""
    return ArduPilot(state, plans, ROVER)


_RATES: Final = {"onboard": ARDUPILOT_HZ, "gcs": ARDUPILOT_HZ}

ARDUCOPTER: Final = Flavour(
    name="arducopter",
    title="ArduCopter 4.5 quadrotor",
    autopilot=3,
    vehicle_type=2,
    modes=COPTER_MODES,
    parameters=parameters_of("arducopter"),
    parameter_rules=ARDUPILOT_PARAMETER_RULES,
    stream_rules=ARDUPILOT_STREAM_RULES,
    mission_rules=ARDUPILOT_MISSION_RULES,
    rates_hz=_RATES,
    identity=ardupilot_identity,
    plant=copter_plant,
    commander=copter_commander,
    wander=ARDUPILOT_WANDER,
    ready_s=39.0,
    texts=True,
    fix_type=6,
    files=files_of,
)

ROVER_FLAVOUR: Final = Flavour(
    name="rover",
    title="ArduPilot Rover 4.5",
    autopilot=3,
    vehicle_type=10,
    modes=ROVER_MODES,
    parameters=parameters_of("rover"),
    parameter_rules=ARDUPILOT_PARAMETER_RULES,
    stream_rules=ARDUPILOT_STREAM_RULES,
    mission_rules=ARDUPILOT_MISSION_RULES,
    rates_hz=_RATES,
    identity=ardupilot_identity,
    plant=rover_plant,
    commander=rover_commander,
    wander=ARDUPILOT_WANDER,
    ready_s=20.0,
    texts=True,
    fix_type=6,
    files=files_of,
    ground_vehicle=True,
)
