"""Setpoints of Rover's modes."""

import math
from typing import Final

from sitl_mock.ardupilot.commander import ArduPilot
from sitl_mock.ardupilot.commands import execute
from sitl_mock.ardupilot.modes import ROVER_MODES, Firmware
from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.vector import Vector
from sitl_mock.vehicle.setpoints import turned


def _manual(commander: ArduPilot) -> Setpoint:
    sticks = commander.sticks
    fast = float(commander.state.parameters["CRUISE_SPEED"])
    velocity = turned(Vector((sticks.throttle * fast, 0.0, 0.0)), commander.state.yaw_rad)
    if not any(sticks):
        return Setpoint(Kind.BRAKE)
    turn = sticks.roll * math.radians(float(commander.state.parameters["ATC_STR_RAT_MAX"]))
    return Setpoint(Kind.TRAVEL, velocity_ned_m_s=velocity, yaw_rate_rad_s=turn)


def _speed(commander: ArduPilot) -> float:
    set_m_s = commander.flight.speeds.level_m_s
    if set_m_s > 0.0:
        return set_m_s
    parameters = commander.state.parameters
    plan_m_s = float(parameters["WP_SPEED"])
    if plan_m_s == 0.0:
        return float(parameters["CRUISE_SPEED"])
    return plan_m_s


def _return(commander: ArduPilot) -> Setpoint:
    home = commander.flight.entered_m if commander.state.home_m is None else commander.state.home_m
    return Setpoint(Kind.TRAVEL, home.level_with(math.nan), speed_m_s=_speed(commander))


def _auto(commander: ArduPilot) -> Setpoint:
    commander.state.flew = True
    leg = commander.mission.leg(commander.state, commander.flight.entered_m)
    if commander.mission.over:
        commander.mission_over()
        return Setpoint(Kind.BRAKE)
    speed = leg.speed_m_s if leg.speed_m_s > 0.0 else _speed(commander)
    return Setpoint(Kind.TRAVEL, leg.position_m.level_with(math.nan), speed_m_s=speed)


ROVER: Final = Firmware[ArduPilot](
    modes=ROVER_MODES,
    first_mode="MANUAL",
    hold_mode="HOLD",
    execute=execute,
    flights={
        "MANUAL": _manual,
        "HOLD": lambda _rover: Setpoint(Kind.BRAKE),
        "LOITER": lambda rover: Setpoint(Kind.TRAVEL, rover.flight.entered_m.level_with(math.nan)),
        "AUTO": _auto,
        "RTL": _return,
        "GUIDED": lambda rover: rover.guided_setpoint(),
    },
    flies=False,
    banner="ArduRover V4.5.7",
)
