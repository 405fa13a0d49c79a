"""Motion of the mock vehicles: pure functions of state and setpoint, without clock or I/O."""

from sitl_mock.dynamics.ardupilot_control import ArduGains
from sitl_mock.dynamics.catalogue import (
    ARDUCOPTER_AIRFRAME,
    ARDUCOPTER_TRAVEL,
    PX4_AIRFRAME,
    PX4_TRAVEL,
    Vehicle,
    arducopter_quadrotor,
    px4_quadrotor,
    rover,
)
from sitl_mock.dynamics.disturbances import (
    PX4_GROUND_WANDER,
    PX4_WANDER,
    Errors,
    Wander,
    gust_after,
)
from sitl_mock.dynamics.multicopter import Airframe
from sitl_mock.dynamics.px4_gains import Px4Gains
from sitl_mock.dynamics.rover import Rover
from sitl_mock.dynamics.shaping import TravelLimits
from sitl_mock.dynamics.values import (
    CALM,
    IGNORED,
    Body,
    Estimate,
    Euler,
    Kind,
    Motion,
    Setpoint,
    Surroundings,
    attitude_of,
)
from sitl_mock.vector import ZERO

__all__ = [
    "ARDUCOPTER_AIRFRAME",
    "ARDUCOPTER_TRAVEL",
    "CALM",
    "IGNORED",
    "PX4_AIRFRAME",
    "PX4_GROUND_WANDER",
    "PX4_TRAVEL",
    "PX4_WANDER",
    "ZERO",
    "Airframe",
    "ArduGains",
    "Body",
    "Errors",
    "Estimate",
    "Euler",
    "Kind",
    "Motion",
    "Px4Gains",
    "Rover",
    "Setpoint",
    "Surroundings",
    "TravelLimits",
    "Vehicle",
    "Wander",
    "arducopter_quadrotor",
    "attitude_of",
    "gust_after",
    "px4_quadrotor",
    "rover",
]
