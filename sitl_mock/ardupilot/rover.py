"""What each mode of ArduPilot's Rover drives, as a setpoint for the dynamics."""

import math
from typing import Final

from sitl_mock.ardupilot.brain import ArduPilot
from sitl_mock.ardupilot.modes import ROVER_MODES
from sitl_mock.ardupilot.rig import Rig
from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.setpoints import turned


def _stand(_brain: ArduPilot) -> Setpoint:
    return Setpoint(Kind.BRAKE)


def _stay(brain: ArduPilot) -> Setpoint:
    north, east, _ = brain.entered_m
    return Setpoint(Kind.TRAVEL, (north, east, math.nan))


def _manual(brain: ArduPilot) -> Setpoint:
    sticks, fast = brain.craft.pilot.sticks, float(brain.craft.parameters["CRUISE_SPEED"])
    velocity = turned((sticks.throttle * fast, 0.0, 0.0), brain.craft.yaw_rad)
    if not any(sticks):
        return Setpoint(Kind.BRAKE)
    turn = sticks.roll * math.radians(float(brain.craft.parameters["ATC_STR_RAT_MAX"]))
    return Setpoint(Kind.TRAVEL, velocity_ned_m_s=velocity, yaw_rate_rad_s=turn)


def _speed(brain: ArduPilot) -> float:
    set_m_s = brain.speeds.level_m_s
    return (
        set_m_s
        if set_m_s > 0.0
        else float(brain.craft.parameters["WP_SPEED"] or brain.craft.parameters["CRUISE_SPEED"])
    )


def _return(brain: ArduPilot) -> Setpoint:
    home = brain.craft.home_m or brain.entered_m
    return Setpoint(Kind.TRAVEL, (home[0], home[1], math.nan), speed_m_s=_speed(brain))


def _auto(brain: ArduPilot) -> Setpoint:
    brain.craft.flew = True
    leg = brain.mission.leg(brain.craft, brain.entered_m)
    if brain.mission.over:
        brain.mission_over()
        return Setpoint(Kind.BRAKE)
    speed = leg.speed_m_s if leg.speed_m_s > 0.0 else _speed(brain)
    return Setpoint(Kind.TRAVEL, (leg.position_m[0], leg.position_m[1], math.nan), speed_m_s=speed)


def _guided(brain: ArduPilot) -> Setpoint:
    return brain.guided_setpoint()


ROVER: Final = Rig(
    modes=ROVER_MODES,
    first_mode="MANUAL",
    hold_mode="HOLD",
    flights={
        "MANUAL": _manual,
        "HOLD": _stand,
        "LOITER": _stay,
        "AUTO": _auto,
        "RTL": _return,
        "GUIDED": _guided,
    },
    flies=False,
)
