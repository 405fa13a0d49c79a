"""What each ArduCopter mode flies, as a setpoint for the dynamics (default parameters, `mode_*.cpp`)."""

import math
from typing import Final

from sitl_mock.ardupilot import guided
from sitl_mock.ardupilot.brain import DECIDE_S, ArduPilot
from sitl_mock.ardupilot.circle import circle_from
from sitl_mock.ardupilot.modes import COPTER_MODES
from sitl_mock.ardupilot.rig import Rig
from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.setpoints import turned

_NAN = math.nan
_REACHED_M: Final = 0.5
_CLIMB_LEAST_S: Final = 2.0
"""RTL sets out after so long also where there is nothing to climb (measured)."""
_NOT_IN_RTL: Final = 2  # WP_YAW_BEHAVIOR: the nose follows the flight, but not in RTL
_DEAD_BAND: Final = 0.2
"""THR_DZ of 100 µs about the middle of the throttle stick."""
_STICK_SPEED_M_S: Final = 12.5  # LOIT_SPEED


def _guided(brain: ArduPilot) -> Setpoint:
    """A take-off first, then the stream; a velocity alone does not leave the ground."""
    craft = brain.craft
    if math.isfinite(brain.takeoff_m):
        north, east, _ = brain.entered_m
        if craft.flew and abs(craft.position_m[2] - brain.takeoff_m) < _REACHED_M:
            brain.guided = Setpoint(Kind.TRAVEL, (north, east, brain.takeoff_m), yaw_rad=brain.entered_yaw_rad)
            brain.takeoff_m = _NAN
            brain.just_taken_off = True
        else:
            return Setpoint(Kind.TRAVEL, (north, east, brain.takeoff_m), yaw_rad=brain.entered_yaw_rad)
    if not craft.on_ground:
        return brain.guided_setpoint()
    return _lifting(brain) or brain.idling


def _lifting(brain: ArduPilot) -> Setpoint | None:
    """An attitude target with a climb, or a thrust, takes off; no other setpoint does."""
    wanted = brain.guided
    if wanted is None or wanted.kind is not Kind.ATTITUDE:
        return None
    lifts = wanted.velocity_ned_m_s[2] < 0.0 or wanted.thrust > 0.0
    return brain.guided_setpoint() if lifts else None


def _attitude_only(brain: ArduPilot) -> Setpoint:
    """GUIDED_NOGPS: level until something is asked for."""
    if brain.craft.on_ground:
        return _lifting(brain) or brain.idling
    return guided.LEVEL if brain.guided is None else brain.guided_setpoint()


def _circle(brain: ArduPilot) -> Setpoint:
    craft = brain.craft
    if craft.on_ground:
        return brain.idling
    if brain.circle is None:
        brain.circle = circle_from(craft.position_m, craft.yaw_rad, craft.parameters)
    return brain.circle.setpoint(_stick_climb(brain), DECIDE_S)


def _stick_climb(brain: ArduPilot) -> float:
    """Climb rate of the throttle stick: none within the dead band, PILOT_SPEED_UP or _DN at its ends."""
    parameters, stick = brain.craft.parameters, brain.sticks.throttle
    if abs(stick) <= _DEAD_BAND:
        return 0.0
    fastest = (
        parameters["PILOT_SPEED_UP"] if stick > 0.0 else parameters["PILOT_SPEED_DN"] or parameters["PILOT_SPEED_UP"]
    )
    return math.copysign((abs(stick) - _DEAD_BAND) / (1.0 - _DEAD_BAND), stick) * float(fastest) * 0.01


def _land_over(brain: ArduPilot, north_m: float, east_m: float) -> Setpoint:
    craft = brain.craft
    height = craft.ground_m - craft.position_m[2]
    parameters = craft.parameters
    fast = float(parameters["LAND_SPEED_HIGH"] or parameters["WPNAV_SPEED_DN"]) * 0.01
    speed = fast if height > float(parameters["LAND_ALT_LOW"]) * 0.01 else float(parameters["LAND_SPEED"]) * 0.01
    return Setpoint(Kind.TRAVEL, (north_m, east_m, _NAN), (_NAN, _NAN, speed), yaw_rad=brain.entered_yaw_rad)


def _land(brain: ArduPilot) -> Setpoint:
    if brain.craft.on_ground:
        return brain.idling
    return _land_over(brain, brain.entered_m[0], brain.entered_m[1])


def _return(brain: ArduPilot) -> Setpoint:
    """Climb to RTL_ALT, fly home, wait RTL_LOIT_TIME, land."""
    craft = brain.craft
    if craft.on_ground:
        return brain.idling
    home = craft.home_m or brain.entered_m
    north, east, down = craft.position_m
    height_m = min(home[2] - float(craft.parameters["RTL_ALT"]) * 0.01, brain.entered_m[2])
    if not brain.stage:
        brain.stage, brain.stage_s = "climb", craft.now_s
    climbed = down - height_m < _REACHED_M and craft.now_s - brain.stage_s > _CLIMB_LEAST_S
    if brain.stage == "climb" and climbed:
        brain.stage = "return"
    if brain.stage == "return" and math.hypot(north - home[0], east - home[1]) < 1.0:
        brain.stage, brain.stage_s = "wait", craft.now_s
    if brain.stage == "wait" and craft.now_s - brain.stage_s > float(craft.parameters["RTL_LOIT_TIME"]) * 1e-3:
        brain.stage = "land"
    if brain.stage == "land":
        return _land_over(brain, home[0], home[1])
    place = brain.entered_m if brain.stage == "climb" else home
    yaw_rad = brain.entered_yaw_rad if int(craft.parameters["WP_YAW_BEHAVIOR"]) == _NOT_IN_RTL else _NAN
    speed = float(craft.parameters["RTL_SPEED"]) * 0.01 or _NAN
    return Setpoint(Kind.TRAVEL, (place[0], place[1], height_m), yaw_rad=yaw_rad, speed_m_s=speed)


def _brake(brain: ArduPilot) -> Setpoint:
    return brain.idling if brain.craft.on_ground else Setpoint(Kind.BRAKE)


def _by_stick(brain: ArduPilot) -> Setpoint:
    """Sticks as velocities. The simulator's radio rests with the throttle stick down, so the copter sinks."""
    craft = brain.craft
    sticks, climb = brain.sticks, _stick_climb(brain)
    if craft.on_ground and climb <= 0.0:
        return brain.idling
    level = turned((sticks.pitch * _STICK_SPEED_M_S, sticks.roll * _STICK_SPEED_M_S, 0.0), craft.yaw_rad)
    return Setpoint(
        Kind.TRAVEL,
        velocity_ned_m_s=(level[0], level[1], -climb),
        yaw_rate_rad_s=sticks.yaw * math.radians(202.5),
    )


def _auto(brain: ArduPilot) -> Setpoint:
    craft = brain.craft
    leg = brain.mission.leg(craft, brain.entered_m)
    if brain.mission.over:
        brain.mission_over()
        return _brake(brain)
    if leg.landing:
        return brain.idling if craft.on_ground else _land_over(brain, leg.position_m[0], leg.position_m[1])
    if craft.on_ground and not leg.taking_off:
        return brain.idling
    if brain.paused:
        return guided.STOP
    return Setpoint(Kind.TRAVEL, leg.position_m, speed_m_s=leg.speed_m_s)


COPTER: Final = Rig(
    modes=COPTER_MODES,
    first_mode="STABILIZE",
    hold_mode="LAND",
    flights={
        "STABILIZE": _by_stick,
        "ACRO": _by_stick,
        "ALT_HOLD": _by_stick,
        "AUTO": _auto,
        "GUIDED": _guided,
        "LOITER": _by_stick,
        "RTL": _return,
        "CIRCLE": _circle,
        "LAND": _land,
        "DRIFT": _by_stick,
        "POSHOLD": _by_stick,
        "BRAKE": _brake,
        "THROW": _brake,
        "AVOID_ADSB": _brake,
        "GUIDED_NOGPS": _attitude_only,
        "SMART_RTL": _return,
        "ZIGZAG": _by_stick,
    },
    flies=True,
    guided_timeout="GUID_TIMEOUT",
)
