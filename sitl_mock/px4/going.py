"""DO_REPOSITION, DO_CHANGE_ALTITUDE and DO_ORBIT: commands that name a place, as PX4 v1.17 obeys them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sitl_mock.fence import violated
from sitl_mock.protocols import Command, Place, on_earth
from sitl_mock.px4.answers import ACCEPTED, DENIED, REFUSED, UNSUPPORTED, Answers
from sitl_mock.px4.orbit import Orbit
from sitl_mock.vehicle_state import Severity

if TYPE_CHECKING:
    from sitl_mock.px4.commander import Px4
    from sitl_mock.world import Vector


def reposition(px4: Px4, now_s: float, command: Command) -> Answers:
    """DO_REPOSITION: Hold, and there to a place; NaN keeps what is, and heights are above sea level in every frame."""
    _, flags, _, _, lat, lon, alt = command.params
    if not math.isfinite(flags) or int(flags) != 1:
        return UNSUPPORTED
    given = Place(*(0.0 if math.isnan(value) else value for value in (lat, lon, alt)))
    if not on_earth(given):
        return DENIED
    if px4.mode != "HOLD" and not px4.request(now_s, "HOLD"):
        return REFUSED
    px4.intention = "HOLD"
    if px4.state.armed:
        _go(px4, command)
    return ACCEPTED


def _go(px4: Px4, command: Command) -> None:
    speed, _, _, yaw, _, _, _ = command.params
    state, plan = px4.state, px4.plan
    goal = _goal(px4, command)
    if violated(px4.plans.fence.items, state.frame, goal):
        state.say(Severity.CRITICAL, "Reposition is outside geofence")
        return
    plan.goal_m = goal
    plan.heading_kept = math.isfinite(yaw)
    if speed > 0.0:
        plan.speed_m_s = speed
    if math.isfinite(yaw):
        plan.yaw_rad = yaw if abs(yaw) <= 2.0 * math.pi else math.radians(yaw)


def _goal(px4: Px4, command: Command) -> Vector:
    """The place asked for: a height alone keeps the place, and a place alone the height."""
    lat, lon, alt = command.params[4:]
    state = px4.state
    north, east, down = state.position_m
    if math.isfinite(lat + lon):
        north, east, _ = state.frame.to_local(lat, lon, 0.0)
    elif math.isfinite(alt) and math.isfinite(px4.plan.goal_m[0]):
        north, east, _ = px4.plan.goal_m
    if math.isfinite(alt):
        down = state.frame.origin.alt_amsl_m - alt
    return north, east, down


def change_altitude(px4: Px4, now_s: float, command: Command) -> Answers:
    """DO_CHANGE_ALTITUDE: as DO_REPOSITION with a height above sea level only."""
    nan = math.nan
    return reposition(px4, now_s, command._replace(params=(nan, 1.0, nan, nan, nan, nan, command.params[0])))


def orbit(px4: Px4, now_s: float, command: Command) -> Answers:
    """DO_ORBIT: about a place, or about where it is; the radius' sign is the direction."""
    radius, speed, facing, _, lat, lon, alt = command.params
    if px4.mode != "ORBIT" and not px4.request(now_s, "ORBIT"):
        px4.state.say(Severity.CRITICAL, "Orbit command rejected")
        return REFUSED
    state, plan = px4.state, px4.plan
    plan.orbit = plan.orbit or Orbit(state.position_m, state.yaw_rad)
    if not plan.orbit.change(state, radius, speed, facing, (lat, lon, alt)):
        state.say(Severity.CRITICAL, "Orbit radius limit exceeded")
    return ACCEPTED
