"""Where RTL leads: home, or the rally point that is nearer (measured on ArduCopter 4.5.7)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sitl_mock.protocols import PlanStore
    from sitl_mock.vehicle_state import VehicleState
    from sitl_mock.world import Vector

_GLOBAL_RELATIVE: Final = 3


def refuge(state: VehicleState, plans: PlanStore) -> Vector:
    """Return north and east of the place to land at, and the down coordinate to fly there at.

    The height is RTL_ALT above home, or that of the rally point where it is higher. Rally points beyond
    RALLY_LIMIT_KM do not count; home counts with RALLY_INCL_HOME, and where there is no rally point.
    """
    home = state.home_m or state.position_m
    height_m = float(state.parameters["RTL_ALT"]) * 0.01
    places = list(_rally_points(state, plans, home))
    if not places or int(state.parameters["RALLY_INCL_HOME"]):
        places.append((home[0], home[1], height_m))
    north, east, above_m = min(places, key=lambda place: _away_m(state, place))
    return north, east, home[2] - max(height_m, above_m)


def _rally_points(state: VehicleState, plans: PlanStore, home: Vector) -> Iterator[Vector]:
    """Yield north, east and height above home of the points in reach."""
    for item in plans.rally.items:
        north, east, down = state.frame.to_local(item.latitude_deg, item.longitude_deg, item.z)
        above_m = item.z if item.frame == _GLOBAL_RELATIVE else home[2] - down
        if _away_m(state, (north, east, above_m)) < float(state.parameters["RALLY_LIMIT_KM"]) * 1e3:
            yield north, east, above_m


def _away_m(state: VehicleState, place: Vector) -> float:
    return math.hypot(place[0] - state.position_m[0], place[1] - state.position_m[1])
