"""Setpoints of ArduCopter's modes (default parameters)."""

import math
from typing import Final

from sitl_mock.ardupilot import guided
from sitl_mock.ardupilot.commander import ArduPilot
from sitl_mock.ardupilot.commands import execute
from sitl_mock.ardupilot.flight import DECIDE_S, IDLING
from sitl_mock.ardupilot.legs import Legs
from sitl_mock.ardupilot.maneuvers import circle_from, turns_edge, turns_from, turns_radius_m
from sitl_mock.ardupilot.mission_orders import obey_orders, tell_delay
from sitl_mock.ardupilot.modes import COPTER_MODES, Firmware
from sitl_mock.ardupilot.plans import return_target
from sitl_mock.ardupilot.safety import just_down
from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.dynamics.shaping import sqrt_controller
from sitl_mock.missions.flight import Leg
from sitl_mock.vector import Vector
from sitl_mock.vehicle.setpoints import turned

_NAN = math.nan
_REACHED_M: Final = 0.5
_THROTTLE_DOWN: Final = -0.95
"""AUTO takes off when the throttle stick is above this."""
_ARMING_DELAY_S: Final = 2.0
"""ARMING_DELAY_SEC: delay of a take-off after arming."""
_THRUST_RISES_S: Final = 0.8
"""Time from NAV_TAKEOFF until it lifts off; a second NAV_TAKEOFF restarts it (measured)."""
_CLIMB_LEAST_S: Final = 0.65
"""Least duration of RTL's climb, even without height to gain (measured)."""
_NOT_IN_RTL: Final = 2  # WP_YAW_BEHAVIOR: the nose follows the flight, but not in RTL
_DEAD_BAND: Final = 0.2
"""THR_DZ: 100 µs on either side of the throttle stick's centre."""
_SLOWING_M_S2: Final = 1.0
"""Deceleration of a landing towards LAND_ALT_LOW."""
_STICK_SPEED_M_S: Final = 12.5  # LOIT_SPEED
_AT_EDGE_M: Final = 3.0
"""LOITER_TURNS begins to circle at once this close to its circle."""


def _guided(commander: ArduPilot) -> Setpoint:
    """Fly a take-off, then the stream; a velocity alone does not take off."""
    state = commander.state
    flight = commander.flight
    lifts_s = max(state.armed_s + _ARMING_DELAY_S, flight.takeoff_s) + _THRUST_RISES_S
    if flight.taking_off and state.on_ground and state.now_s < lifts_s:
        return IDLING
    if flight.taking_off:
        north, east, _ = flight.entered_m
        if state.flew and abs(state.position_m[2] - flight.takeoff_m) < _REACHED_M:
            flight.guided = Setpoint(
                Kind.TRAVEL, Vector((north, east, flight.takeoff_m)), yaw_rad=flight.entered_yaw_rad
            )
            flight.takeoff_m = _NAN
            flight.just_taken_off = True
        else:
            return Setpoint(
                Kind.TRAVEL, Vector((north, east, flight.takeoff_m)), yaw_rad=flight.entered_yaw_rad
            )
    if not state.on_ground:
        return commander.guided_setpoint()
    return _on_ground(commander)


def _on_ground(commander: ArduPilot) -> Setpoint:
    """An attitude target with a climb, or a thrust, takes off; with any other setpoint the motors idle."""
    target = commander.flight.guided
    if target is None or target.kind is not Kind.ATTITUDE:
        return IDLING
    if target.velocity_ned_m_s[2] < 0.0 or target.thrust > 0.0:
        return commander.guided_setpoint()
    return IDLING


def _attitude_only(commander: ArduPilot) -> Setpoint:
    """GUIDED_NOGPS: level until the first setpoint."""
    if commander.state.on_ground:
        return _on_ground(commander)
    return guided.LEVEL if commander.flight.guided is None else commander.guided_setpoint()


def _circle(commander: ArduPilot) -> Setpoint:
    state = commander.state
    flight = commander.flight
    if state.on_ground:
        return IDLING
    if flight.circle is None:
        flight.circle = circle_from(state.position_m, state.yaw_rad, state.parameters)
    return flight.circle.setpoint(_stick_climb(commander), DECIDE_S)


def _stick_climb(commander: ArduPilot) -> float:
    """Climb rate of the throttle stick: none within the dead band, PILOT_SPEED_UP or _DN at its ends."""
    parameters = commander.state.parameters
    stick = commander.sticks.throttle
    if abs(stick) <= _DEAD_BAND:
        return 0.0
    fastest_cm_s = float(parameters["PILOT_SPEED_UP"])
    descent_cm_s = float(parameters["PILOT_SPEED_DN"])
    if stick < 0.0 and descent_cm_s != 0.0:
        fastest_cm_s = descent_cm_s
    share = math.copysign((abs(stick) - _DEAD_BAND) / (1.0 - _DEAD_BAND), stick)
    return share * fastest_cm_s * 0.01


def _land_at(commander: ArduPilot, place_m: Vector) -> Setpoint:
    state = commander.state
    if state.on_ground:
        return IDLING
    height = state.ground_m - state.position_m[2]
    parameters = state.parameters
    fast_cm_s = float(parameters["LAND_SPEED_HIGH"])
    if fast_cm_s == 0.0:
        fast_cm_s = float(parameters["WPNAV_SPEED_DN"])
    fast = fast_cm_s * 0.01
    above_m = max(height - float(parameters["LAND_ALT_LOW"]) * 0.01, 0.0)
    speed = min(
        max(sqrt_controller(above_m, 1.0, _SLOWING_M_S2), float(parameters["LAND_SPEED"]) * 0.01),
        fast,
    )
    return Setpoint(
        Kind.TRAVEL,
        place_m.level_with(_NAN),
        Vector((_NAN, _NAN, speed)),
        yaw_rad=commander.flight.entered_yaw_rad,
    )


def _return(commander: ArduPilot) -> Setpoint:
    """Climb, fly home or to a rally point, wait RTL_LOIT_TIME, land. Just after touchdown it climbs again."""
    state = commander.state
    flight = commander.flight
    climbs = flight.stage == "climb" or (not flight.stage and just_down(state))
    if state.on_ground and not climbs:
        return IDLING
    if not flight.stage:
        flight.stage = "climb"
        flight.stage_s = state.now_s
        flight.goal_m = return_target(state, commander.plans)
        flight.legs = Legs()
        flight.entered_m = flight.legs.begin(state)
    home = flight.goal_m
    height_m = min(home[2], flight.entered_m[2])
    near_m = float(state.parameters["WPNAV_RADIUS"]) * 0.01
    left_m = flight.legs.left_m(state.now_s)
    since_s = state.now_s - flight.stage_s
    if flight.stage == "climb" and left_m < near_m and since_s > _CLIMB_LEAST_S:
        flight.stage = "return"
    elif flight.stage == "return" and left_m <= 0.0:
        flight.stage = "wait"
        flight.stage_s = state.now_s
    if (
        flight.stage == "wait"
        and state.now_s - flight.stage_s > float(state.parameters["RTL_LOIT_TIME"]) * 1e-3
    ):
        flight.stage = "land"
    if flight.stage == "land":
        return _land_at(commander, home)
    target_m = flight.entered_m if flight.stage == "climb" else home
    yaw_rad = (
        flight.entered_yaw_rad if int(state.parameters["WP_YAW_BEHAVIOR"]) == _NOT_IN_RTL else _NAN
    )
    speed = float(state.parameters["RTL_SPEED"]) * 0.01
    if speed == 0.0:
        speed = _NAN  # the speed of every travel
    goal = target_m.level_with(height_m)
    return flight.legs.onwards(state, goal, speed)._replace(yaw_rad=yaw_rad)


def _brake(commander: ArduPilot) -> Setpoint:
    return IDLING if commander.state.on_ground else Setpoint(Kind.BRAKE)


def _by_stick(commander: ArduPilot) -> Setpoint:
    """Sticks as velocities. The simulator's radio has the throttle stick down, so the copter descends."""
    state = commander.state
    sticks = commander.sticks
    climb = _stick_climb(commander)
    if state.on_ground and climb <= 0.0:
        return IDLING
    level = turned(
        Vector((sticks.pitch * _STICK_SPEED_M_S, sticks.roll * _STICK_SPEED_M_S, 0.0)),
        state.yaw_rad,
    )
    return Setpoint(
        Kind.TRAVEL,
        velocity_ned_m_s=level.level_with(-climb),
        yaw_rate_rad_s=sticks.yaw * math.radians(202.5),
    )


def _auto(commander: ArduPilot) -> Setpoint:
    state = commander.state
    flight = commander.flight
    if state.on_ground and not (
        state.flew or flight.may_lift or commander.sticks.throttle > _THROTTLE_DOWN
    ):
        return IDLING
    mission = commander.mission
    before = mission.current
    leg = mission.leg(state, flight.entered_m)
    tell_delay(commander, before)
    obey_orders(commander)
    if mission.over:
        # A mission that ended with RETURN_TO_LAUNCH is followed by a return from here; any other by a hover.
        if mission.over != "return":
            return _brake(commander)
        if not flight.stage:
            flight.entered_m = state.position_m
            flight.entered_yaw_rad = state.yaw_rad
        return _return(commander)
    if leg.landing:
        return _land_at(commander, leg.position_m)
    if state.on_ground and not leg.taking_off:
        return IDLING
    if flight.paused:
        flight.legs = Legs()
        setpoint = guided.STOP
    elif leg.taking_off:
        setpoint = Setpoint(Kind.TRAVEL, leg.position_m, speed_m_s=leg.speed_m_s)
    elif leg.circling:
        setpoint = _around(commander, leg)
    else:
        flight.edge_m = None
        flight.circle = None
        setpoint = flight.legs.setpoint(state, mission, leg)
    return setpoint


def _around(commander: ArduPilot, leg: Leg) -> Setpoint:
    """Fly LOITER_TURNS: to the nearest point of the circle, then around the centre with the nose towards it."""
    state = commander.state
    flight = commander.flight
    mission = commander.mission
    centre_m = leg.position_m
    radius_m = turns_radius_m(leg.radius_m, state.parameters)
    if flight.edge_m is None:
        flight.edge_m = turns_edge(state.position_m, state.yaw_rad, centre_m, radius_m)
        if math.dist(flight.edge_m, state.position_m) <= _AT_EDGE_M:
            mission.turned_rad = 0.0
    if math.isnan(mission.turned_rad):
        setpoint = flight.legs.onwards(state, flight.edge_m, leg.speed_m_s)
        if flight.legs.left_m(state.now_s) <= 0.0:
            mission.turned_rad = 0.0
        return setpoint
    if flight.circle is None:
        flight.legs = Legs()
        flight.circle = turns_from(
            state.position_m,
            centre_m,
            radius_m,
            clockwise=leg.radius_m >= 0.0,
            parameters=state.parameters,
        )
    setpoint = flight.circle.setpoint(0.0, DECIDE_S)
    mission.turned_rad += abs(flight.circle.rate_rad_s) * DECIDE_S
    return setpoint._replace(position_ned_m=setpoint.position_ned_m.level_with(centre_m[2]))


COPTER: Final = Firmware[ArduPilot](
    modes=COPTER_MODES,
    first_mode="STABILIZE",
    hold_mode="LAND",
    execute=execute,
    flights={
        "STABILIZE": _by_stick,
        "ACRO": _by_stick,
        "ALT_HOLD": _by_stick,
        "AUTO": _auto,
        "GUIDED": _guided,
        "LOITER": _by_stick,
        "RTL": _return,
        "CIRCLE": _circle,
        "LAND": lambda commander: _land_at(commander, commander.flight.entered_m),
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
    banner="ArduCopter V4.5.7 (8125b5f9)",
)
