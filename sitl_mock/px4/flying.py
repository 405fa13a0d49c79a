"""What each PX4 mode flies, as a setpoint for the dynamics (navigator and flight tasks, default parameters)."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from sitl_mock.craft import Craft
from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.missions import MissionFlight
from sitl_mock.setpoints import turned
from sitl_mock.world import Vector

_NAN = math.nan
_HEIGHT_REACHED_M = 0.5
_PLACE_REACHED_M = 1.0


@dataclass(slots=True)
class Plan:
    """What the present mode works towards; set anew whenever a mode begins.

    Attributes:
        entered_m: Where the mode began.
        height_m: Down coordinate to climb to (TAKEOFF, RTL).
        goal_m: Where to hold or return to; NaN for "where it stops".
        yaw_rad: Heading to keep.
        stage: Part of RTL: climb, return, descend, land.
        speed_m_s: Cruise speed set by DO_CHANGE_SPEED, NaN for the default.
    """

    entered_m: Vector
    height_m: float = _NAN
    goal_m: Vector = (_NAN, _NAN, _NAN)
    yaw_rad: float = _NAN
    stage: str = ""
    speed_m_s: float = _NAN


def hold(craft: Craft, plan: Plan) -> Setpoint:
    """Stop and stay, or go where DO_REPOSITION said."""
    if math.isnan(plan.goal_m[0]):
        return Setpoint(Kind.BRAKE, yaw_rad=plan.yaw_rad)
    speed = plan.speed_m_s if plan.speed_m_s > 0.0 else float(craft.parameters["MPC_XY_CRUISE"])
    return Setpoint(Kind.TRAVEL, plan.goal_m, yaw_rad=plan.yaw_rad, speed_m_s=speed)


def takeoff(craft: Craft, plan: Plan) -> Setpoint:
    """Climb straight up."""
    north, east, _ = plan.entered_m
    climb = float(craft.parameters["MPC_TKO_SPEED"])
    return Setpoint(Kind.TRAVEL, (north, east, plan.height_m), yaw_rad=plan.yaw_rad, climb_m_s=climb)


def takeoff_done(craft: Craft, plan: Plan) -> bool:
    """Whether the height is reached."""
    return craft.flew and craft.position_m[2] - plan.height_m < _HEIGHT_REACHED_M


def land(craft: Craft, plan: Plan) -> Setpoint:
    """Come down over one place: fast, then slow near the ground (MPC_LAND_ALT1, ALT2, SPEED)."""
    north, east, _ = plan.goal_m if math.isfinite(plan.goal_m[0]) else plan.entered_m
    return Setpoint(
        Kind.TRAVEL,
        (north, east, _NAN),
        (_NAN, _NAN, _descent_m_s(craft)),
        yaw_rad=plan.yaw_rad,
    )


def descend(craft: Craft, plan: Plan) -> Setpoint:
    """Come down without a position."""
    speed = float(craft.parameters["MPC_LAND_SPEED"])
    return Setpoint(Kind.TRAVEL, velocity_ned_m_s=(0.0, 0.0, speed), yaw_rad=plan.yaw_rad)


def _descent_m_s(craft: Craft) -> float:
    parameters = craft.parameters
    height = craft.ground_m - craft.position_m[2]
    fast, slow = float(parameters["MPC_Z_V_AUTO_DN"]), float(parameters["MPC_LAND_SPEED"])
    upper, lower = float(parameters["MPC_LAND_ALT1"]), float(parameters["MPC_LAND_ALT2"])
    share = min(max((height - lower) / max(upper - lower, 1e-6), 0.0), 1.0)
    return slow + (fast - slow) * share


def return_home(craft: Craft, plan: Plan) -> Setpoint:
    """Climb, fly home, descend, land; `plan.stage` remembers how far it has come."""
    home = craft.home_m or plan.entered_m
    if not plan.stage:
        plan.stage = "climb"
        plan.height_m = _return_height(craft, home, plan)
        plan.goal_m = home
    north, east, down = craft.position_m
    away_m = math.hypot(north - home[0], east - home[1])
    low_m = home[2] - float(craft.parameters["RTL_DESCEND_ALT"])
    if plan.stage == "climb" and down - plan.height_m < _HEIGHT_REACHED_M:
        plan.stage = "return"
    if plan.stage == "return" and away_m < _PLACE_REACHED_M:
        plan.stage = "descend"
    if plan.stage == "descend" and down > low_m - _HEIGHT_REACHED_M:
        plan.stage = "land"
    return _RETURN[plan.stage](craft, plan)


def _return_height(craft: Craft, home: Vector, plan: Plan) -> float:
    """RTL_RETURN_ALT, lower near home by the cone (RTL_CONE_ANG), never below where it is."""
    parameters = craft.parameters
    north, east, down = plan.entered_m
    away_m = math.hypot(north - home[0], east - home[1])
    high_m, low_m = float(parameters["RTL_RETURN_ALT"]), float(parameters["RTL_DESCEND_ALT"])
    cone_deg = float(parameters["RTL_CONE_ANG"])
    if away_m < float(parameters["RTL_MIN_DIST"]):
        high_m = min(high_m, low_m)
    elif 0.0 < cone_deg < 90.0:
        high_m = min(high_m, max(low_m, away_m / math.tan(math.radians(cone_deg))))
    return min(home[2] - high_m, down)


def _climb(_craft: Craft, plan: Plan) -> Setpoint:
    return Setpoint(Kind.TRAVEL, (plan.entered_m[0], plan.entered_m[1], plan.height_m), yaw_rad=plan.yaw_rad)


def _cross(craft: Craft, plan: Plan) -> Setpoint:
    goal = (plan.goal_m[0], plan.goal_m[1], plan.height_m)
    return Setpoint(Kind.TRAVEL, goal, yaw_rad=plan.yaw_rad, speed_m_s=float(craft.parameters["MPC_XY_CRUISE"]))


def _sink(craft: Craft, plan: Plan) -> Setpoint:
    low_m = plan.goal_m[2] - float(craft.parameters["RTL_DESCEND_ALT"])
    return Setpoint(Kind.TRAVEL, (plan.goal_m[0], plan.goal_m[1], low_m), yaw_rad=plan.yaw_rad)


_RETURN: Mapping[str, Callable[[Craft, Plan], Setpoint]] = MappingProxyType(
    {"climb": _climb, "return": _cross, "descend": _sink, "land": land}
)


def by_stick(craft: Craft, _plan: Plan) -> Setpoint:
    """POSCTL and the other manual modes: sticks are velocities, and without sticks it stops."""
    sticks, parameters = craft.pilot.sticks, craft.parameters
    fast = float(parameters["MPC_VEL_MANUAL"])
    up, down = float(parameters["MPC_Z_VEL_MAX_UP"]), float(parameters["MPC_Z_VEL_MAX_DN"])
    level = turned((sticks.pitch * fast, sticks.roll * fast, 0.0), craft.yaw_rad)
    vertical = -sticks.throttle * (up if sticks.throttle > 0.0 else down)
    turn = sticks.yaw * math.radians(float(parameters["MPC_MAN_Y_MAX"]))
    if not any(sticks[:3]):
        return Setpoint(Kind.BRAKE, yaw_rate_rad_s=turn)
    return Setpoint(Kind.TRAVEL, velocity_ned_m_s=(level[0], level[1], vertical), yaw_rate_rad_s=turn)


def mission(craft: Craft, flight: MissionFlight, plan: Plan) -> Setpoint:
    """Follow the mission's present leg; land where it says so."""
    leg = flight.leg(craft, plan.entered_m)
    if leg.landing:
        plan.goal_m = leg.position_m
        return land(craft, plan)
    speed = leg.speed_m_s if leg.speed_m_s > 0.0 else float(craft.parameters["MPC_XY_CRUISE"])
    climb = float(craft.parameters["MPC_TKO_SPEED"]) if leg.taking_off else _NAN
    return Setpoint(Kind.TRAVEL, leg.position_m, yaw_rad=leg.yaw_rad, speed_m_s=speed, climb_m_s=climb)
