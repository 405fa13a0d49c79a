"""Setpoints of PX4's automatic modes (navigator and flight tasks, default parameters)."""

import math
from dataclasses import dataclass

from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.missions.flight import MissionFlight
from sitl_mock.px4.maneuvers import Follow, Orbit
from sitl_mock.vector import UNSET, Vector
from sitl_mock.vehicle.state import Severity, VehicleState

_NAN = math.nan
_HEIGHT_REACHED_M = 0.5
_PLACE_REACHED_M = 1.0


@dataclass(slots=True)
class ModePlan:
    """State of the present mode; reset when a mode begins.

    Attributes:
        entered_m: Where the mode began.
        height_m: Down coordinate to climb to (TAKEOFF, RTL).
        goal_m: Position to hold or return to; NaN means the stopping point.
        yaw_rad: Heading to keep.
        heading_kept: Keep the heading during the flight instead of facing the goal.
        stage: Part of RTL: climb, return, land.
        speed_m_s: Cruise speed set by DO_CHANGE_SPEED, NaN for the default.
        orbit: The circle of DO_ORBIT.
        follow: State of follow-me.
        stick_m_s: Velocity (north, east) reached by the sticks, None while they are centred.
        stick_place_m: Position (north, east) held while only the throttle stick is moved, otherwise None.
        completed: The navigator has reported that the mode is finished.
    """

    entered_m: Vector
    height_m: float = _NAN
    goal_m: Vector = UNSET
    yaw_rad: float = _NAN
    heading_kept: bool = False
    stage: str = ""
    speed_m_s: float = _NAN
    orbit: Orbit | None = None
    follow: Follow | None = None
    stick_m_s: tuple[float, float] | None = None
    stick_place_m: tuple[float, float] | None = None
    completed: bool = False


def hold(state: VehicleState, plan: ModePlan) -> Setpoint:
    """Stop and stay, or fly to the goal of DO_REPOSITION."""
    if math.isnan(plan.goal_m[0]):
        return Setpoint(Kind.BRAKE, yaw_rad=plan.yaw_rad)
    if not plan.heading_kept:
        plan.yaw_rad = facing(state, plan.goal_m, plan.yaw_rad)
    return Setpoint(
        Kind.TRAVEL, plan.goal_m, yaw_rad=plan.yaw_rad, speed_m_s=cruise_m_s(state, plan.speed_m_s)
    )


def cruise_m_s(state: VehicleState, asked_m_s: float) -> float:
    """The requested speed if it is positive, else MPC_XY_CRUISE."""
    return asked_m_s if asked_m_s > 0.0 else float(state.parameters["MPC_XY_CRUISE"])


def facing(state: VehicleState, goal_m: Vector, kept_rad: float) -> float:
    """Heading towards the goal if MPC_YAW_MODE is 0; the given one close to the goal."""
    north, east, _ = to_go = goal_m - state.position_m
    far = to_go.level_length() > float(state.parameters["NAV_ACC_RAD"])
    return (
        math.atan2(east, north) if far and int(state.parameters["MPC_YAW_MODE"]) == 0 else kept_rad
    )


def takeoff(state: VehicleState, plan: ModePlan) -> Setpoint:
    """Climb straight up."""
    return Setpoint(
        Kind.TRAVEL,
        plan.entered_m.level_with(plan.height_m),
        yaw_rad=plan.yaw_rad,
        climb_m_s=_lift_off_m_s(state),
    )


def _lift_off_m_s(state: VehicleState) -> float:
    """Climb rate: MPC_TKO_SPEED up to MPC_LAND_ALT1, unlimited (NaN) above it (measured)."""
    low = state.ground_m - state.position_m[2] < float(state.parameters["MPC_LAND_ALT1"])
    return float(state.parameters["MPC_TKO_SPEED"]) if low else _NAN


def takeoff_done(state: VehicleState, plan: ModePlan) -> bool:
    """True if the take-off height is reached within NAV_MC_ALT_RAD, a low one within half of it."""
    climb_m = plan.entered_m[2] - plan.height_m
    near_m = float(state.parameters["NAV_MC_ALT_RAD"])
    if climb_m < near_m:
        near_m = 0.5 * climb_m
    return state.flew and state.position_m[2] - plan.height_m < near_m


def land(state: VehicleState, plan: ModePlan) -> Setpoint:
    """Descend at one position, slower near the ground (MPC_LAND_ALT1, ALT2, SPEED)."""
    goal = plan.goal_m if math.isfinite(plan.goal_m[0]) else plan.entered_m
    parameters = state.parameters
    height_m = state.ground_m - state.position_m[2]
    if height_m <= float(parameters["MPC_LAND_ALT3"]):  # SIH has a range finder
        down_m_s = float(parameters["MPC_LAND_CRWL"])
    else:
        fast_m_s = float(parameters["MPC_Z_V_AUTO_DN"])
        slow_m_s = float(parameters["MPC_LAND_SPEED"])
        upper_m = float(parameters["MPC_LAND_ALT1"])
        lower_m = float(parameters["MPC_LAND_ALT2"])
        share = min(max((height_m - lower_m) / max(upper_m - lower_m, 1e-6), 0.0), 1.0)
        down_m_s = slow_m_s + (fast_m_s - slow_m_s) * share
    return Setpoint(
        Kind.TRAVEL,
        goal.level_with(_NAN),
        Vector((_NAN, _NAN, down_m_s)),
        yaw_rad=plan.yaw_rad,
    )


def descend(state: VehicleState, plan: ModePlan) -> Setpoint:
    """Descend without a position estimate."""
    speed = float(state.parameters["MPC_LAND_SPEED"])
    return Setpoint(Kind.TRAVEL, velocity_ned_m_s=Vector((0.0, 0.0, speed)), yaw_rad=plan.yaw_rad)


def return_home(state: VehicleState, plan: ModePlan) -> Setpoint:
    """Climb, fly home and land; `plan.stage` is the progress."""
    if not plan.stage:
        home = plan.entered_m if state.home_m is None else state.home_m
        plan.stage = "climb"
        plan.height_m = _return_height(state, home, plan)
        plan.goal_m = home
        amsl_m = math.ceil(state.frame.origin.alt_amsl_m - plan.height_m)
        above_m = math.ceil(home[2] - plan.height_m)
        text = f"RTL: start return at {amsl_m} m ({above_m} m above destination)"
        state.say(Severity.INFO, text)
    home = plan.goal_m
    away_m = (state.position_m - home).level_length()
    if plan.stage == "climb" and state.position_m[2] - plan.height_m < _HEIGHT_REACHED_M:
        plan.stage = "return"
    if plan.stage == "return" and away_m < _PLACE_REACHED_M:
        state.say(Severity.INFO, "RTL: land at destination")
        plan.stage = "land"  # RTL_LAND_DELAY 0: without a stop at RTL_DESCEND_ALT
        plan.yaw_rad = state.home_attitude.yaw_rad
    if plan.stage == "land":
        return land(state, plan)
    if plan.stage == "climb":
        high_m = plan.entered_m.level_with(plan.height_m)
        return Setpoint(Kind.TRAVEL, high_m, yaw_rad=plan.yaw_rad)
    goal = home.level_with(plan.height_m)
    plan.yaw_rad = facing(state, goal, plan.yaw_rad)
    return Setpoint(
        Kind.TRAVEL, goal, yaw_rad=plan.yaw_rad, speed_m_s=cruise_m_s(state, plan.speed_m_s)
    )


def _return_height(state: VehicleState, home: Vector, plan: ModePlan) -> float:
    """Return height (down): RTL_RETURN_ALT, less within RTL_MIN_DIST (RTL_CONE_ANG), never below the vehicle."""
    parameters = state.parameters
    away_m = (plan.entered_m - home).level_length()
    at_home_m = float(parameters["NAV_ACC_RAD"])
    most_m = high_m = float(parameters["RTL_RETURN_ALT"])
    if away_m <= at_home_m:
        high_m = 2.0 * away_m
    elif away_m <= float(parameters["RTL_MIN_DIST"]):
        cone_rad = math.radians(min(max(float(parameters["RTL_CONE_ANG"]), 1.0), 89.0))
        high_m = max(min(high_m, away_m / math.tan(cone_rad)), 2.0 * at_home_m)
    return min(home[2] - min(high_m, most_m), plan.entered_m[2])


def mission(state: VehicleState, flight: MissionFlight, plan: ModePlan) -> Setpoint:
    """Follow the mission's present leg, or land at a landing item."""
    leg = flight.leg(state, plan.entered_m)
    if leg.waiting and state.on_ground:
        return Setpoint(Kind.IDLING)
    if leg.landing:
        plan.goal_m = leg.position_m
        return land(state, plan)
    climb = _lift_off_m_s(state) if leg.taking_off else _NAN
    plan.yaw_rad = (
        leg.yaw_rad if math.isfinite(leg.yaw_rad) else facing(state, leg.position_m, plan.yaw_rad)
    )
    speed = cruise_m_s(state, leg.speed_m_s)
    return Setpoint(
        Kind.TRAVEL, leg.position_m, yaw_rad=plan.yaw_rad, speed_m_s=speed, climb_m_s=climb
    )
