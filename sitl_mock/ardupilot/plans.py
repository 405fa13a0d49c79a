"""Effects of uploaded plans on an ArduPilot: RTL's destination, avoidance of the fence, and item counts.

All as measured on ArduCopter 4.5.7. RTL leads home, or to a nearer rally point.

Fence: GUIDED velocities slow down before it, slide along it, and lead back from its margin (AVOID_ENABLE). Fitted to
flights into a square of 50 m: towards each side the speed is limited so that 1 m/s² stops the vehicle at FENCE_MARGIN.
More than AVOID_BACKUP_DZ beyond the margin it only flies back. The real one, pushed against the margin for half a
minute, oscillates about it (0.7 m before to 1.8 m beyond); the mock settles there.

Item counts are parameters that ArduPilot changes. PARAM_VALUE reports the counts of missions and rally points when they
change, and that of the fence after every upload. FENCE_TOTAL is vertices plus circles plus 2 (return point and closing
vertex) with a polygon, and 0 without one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from sitl_mock.ardupilot.fence import contains
from sitl_mock.dynamics.shaping import sqrt_controller
from sitl_mock.missions.fence import inclusion_polygons
from sitl_mock.protocols import PlanItem, PlanKind, PlanStore
from sitl_mock.protocols.plan import CIRCLES, POLYGONS
from sitl_mock.vector import Vector
from sitl_mock.vehicle.state import Severity, VehicleState

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sitl_mock.dynamics import Setpoint


_GLOBAL_RELATIVE: Final = 3
_LEAST_RETURN_M = 2.0
_LEAST_SLOPE = 0.5


def return_target(state: VehicleState, plans: PlanStore) -> Vector:
    """Return RTL's destination (north, east) and the down coordinate of the flight there.

    The height is RTL_ALT above home, or that of the rally point if it is higher. Close to the destination it is limited
    by a cone (RTL_CONE_SLOPE), but not below the vehicle, nor below 2 m. Rally points beyond RALLY_LIMIT_KM or the
    fence do not count; home counts with RALLY_INCL_HOME, or without rally points.
    """
    parameters = state.parameters
    home = state.position_m if state.home_m is None else state.home_m
    # Places to return to: north, east and height above home of the rally points within reach.
    places = []
    for item in plans.rally.items:
        place_m = state.frame.to_local(item.latitude_deg, item.longitude_deg, item.z)
        above_m = item.z if item.frame == _GLOBAL_RELATIVE else home[2] - place_m[2]
        if not contains(state, plans, place_m.level_with(home[2] - above_m)):
            continue
        if _away_m(state, place_m) < float(parameters["RALLY_LIMIT_KM"]) * 1e3:
            places.append(place_m.level_with(above_m))
    if not places or int(parameters["RALLY_INCL_HOME"]):
        places.append(home.level_with(0.0))
    nearest = min(places, key=lambda rally_point: _away_m(state, rally_point))
    climb_m = max(0.0, float(parameters["RTL_CLIMB_MIN"]) * 0.01)
    least_m = max(_LEAST_RETURN_M, home[2] - state.position_m[2] + climb_m)
    height_m = max(nearest[2], float(parameters["RTL_ALT"]) * 0.01, least_m)
    slope = float(parameters["RTL_CONE_SLOPE"])
    if slope >= _LEAST_SLOPE:
        height_m = min(height_m, max(_away_m(state, nearest) * slope, least_m))
    return nearest.level_with(home[2] - height_m)


def _away_m(state: VehicleState, place: Vector) -> float:
    return (place - state.position_m).level_length()


_STOP_AT_FENCE: Final = 1
_POLYGONS: Final = 4
_SLOWING_M_S2: Final = 1.0


def avoiding(state: VehicleState, plans: PlanStore, setpoint: Setpoint) -> Setpoint:
    """Return the setpoint with its velocity limited by the fence."""
    parameters = state.parameters
    if not (int(parameters["FENCE_ENABLE"]) and int(parameters["AVOID_ENABLE"]) & _STOP_AT_FENCE):
        return setpoint
    north, east, down = setpoint.velocity_ned_m_s
    if not int(parameters["FENCE_TYPE"]) & _POLYGONS or math.isnan(north + east):
        return setpoint
    gain = float(parameters["PSC_POSXY_P"])
    margin_m = float(parameters["FENCE_MARGIN"])
    fastest_back = float(parameters["AVOID_BACKUP_SPD"])
    bearable_m = float(parameters["AVOID_BACKUP_DZ"])
    for distance_m, (to_n, to_e) in _sides(state, plans):
        room_m = distance_m - margin_m
        if room_m < -bearable_m:
            back = min(sqrt_controller(-room_m, gain, _SLOWING_M_S2), fastest_back)
            north = -back * to_n
            east = -back * to_e
            break
        excess_m_s = (
            north * to_n + east * to_e - sqrt_controller(max(room_m, 0.0), gain, _SLOWING_M_S2)
        )
        if excess_m_s > 0.0:
            north = north - excess_m_s * to_n
            east = east - excess_m_s * to_e
    return setpoint._replace(velocity_ned_m_s=Vector((north, east, down)))


def _sides(state: VehicleState, plans: PlanStore) -> Iterator[tuple[float, tuple[float, float]]]:
    """Yield distance and direction (unit vector) of each side of the areas that contain the vehicle."""
    here_n, here_e, _ = state.position_m
    for corners in inclusion_polygons(plans.fence.items, state.frame, state.position_m):
        for (a_n, a_e), (b_n, b_e) in zip(corners, (*corners[1:], corners[0]), strict=True):
            side_n = b_n - a_n
            side_e = b_e - a_e
            square = side_n * side_n + side_e * side_e
            share = (
                ((here_n - a_n) * side_n + (here_e - a_e) * side_e) / square
                if square > 0.0
                else 0.0
            )
            share = min(max(share, 0.0), 1.0)
            to_n = a_n + share * side_n - here_n
            to_e = a_e + share * side_e - here_e
            distance_m = math.hypot(to_n, to_e)
            if distance_m > 0.0:
                yield distance_m, (to_n / distance_m, to_e / distance_m)


def report_totals(state: VehicleState, plans: PlanStore) -> None:
    """Update the item counts of plans that were uploaded or cleared since the last call."""
    for kind in sorted(plans.news):
        items = plans.plans[kind].items
        name = _NAMES[kind]
        total = fence_total(items) if kind is PlanKind.FENCE else len(items)
        if kind is PlanKind.MISSION and items:
            state.say(Severity.INFO, "Flight plan received")
        if kind is PlanKind.FENCE:
            state.say(Severity.DEBUG, "Fence Indexed OK")
        if kind is PlanKind.FENCE or state.parameters[name] != total:
            state.parameters.set(name, total)
            state.parameter_news.append(name)
    plans.news.clear()


def warn_of_old_messages(
    state: VehicleState, plans: PlanStore, warned: set[tuple[str, PlanKind]]
) -> None:
    """Warn once of each message without integer coordinates; `warned` has those of before, by kind of plan."""
    for use in sorted(plans.old_messages - warned):
        state.say(Severity.WARNING, _OLD_MESSAGES[use[0]])
        warned.add(use)
    plans.old_messages.clear()


_OLD_MESSAGES: Final = {
    "MISSION_ITEM": "got MISSION_ITEM; GCS should send MISSION_ITEM_INT",
    "MISSION_REQUEST": "got MISSION_REQUEST; use MISSION_REQUEST_INT!",
}


def fence_total(items: Sequence[PlanItem]) -> int:
    """FENCE_TOTAL for the items of a fence."""
    vertices = sum(item.command in POLYGONS for item in items)
    return vertices + sum(item.command in CIRCLES for item in items) + 2 if vertices else 0


_NAMES = {
    PlanKind.MISSION: "MIS_TOTAL",
    PlanKind.FENCE: "FENCE_TOTAL",
    PlanKind.RALLY: "RALLY_TOTAL",
}
