"""ArduPilot's fence: a height and a circle around home, a floor, and the uploaded areas.

Source: ``AC_Fence.cpp`` of ArduCopter 4.5.7. A vehicle that leaves it is in breach (`breached`). A copter also refuses
targets of GUIDED beyond it (`contains`) and keeps its last target; take-offs and missions are not checked.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from sitl_mock.missions.fence import violated

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sitl_mock.protocols import PlanStore
    from sitl_mock.vector import Vector
    from sitl_mock.vehicle.state import VehicleState

_HEIGHT: Final = 1
_CIRCLE: Final = 2
_AREAS: Final = 4
_FLOOR: Final = 8  # bits of FENCE_TYPE


def breached(state: VehicleState, plans: PlanStore, *, flies: bool) -> bool:
    """True if the fence is on and the vehicle is beyond it; the floor, which needs a take-off, does not count."""
    return _is_on(state) and _beyond(state, plans, state.position_m, flies=flies)


def contains(state: VehicleState, plans: PlanStore, position_m: Vector) -> bool:
    """True if a copter may fly to a position; always with the fence off."""
    if not _is_on(state):
        return True
    parameters = state.parameters
    if state.home_m is not None and int(parameters["FENCE_TYPE"]) & _FLOOR:
        height_m = state.home_m[2] - position_m[2]
        if height_m < parameters["FENCE_ALT_MIN"]:
            return False
    return not _beyond(state, plans, position_m, flies=True)


def needs_position(state: VehicleState) -> bool:
    """True if the fence is on and has a circle or areas."""
    return _is_on(state) and bool(int(state.parameters["FENCE_TYPE"]) & (_CIRCLE | _AREAS))


def objections(state: VehicleState, plans: PlanStore) -> Iterator[str]:
    """Yield the text of the pre-arm check of a fence that cannot work (measured on ArduCopter 4.5.7)."""
    if not _is_on(state):
        return
    if int(state.parameters["FENCE_TYPE"]) == _AREAS and not plans.fence.items:
        yield "Fences enabled, but none selected"
    elif needs_position(state) and not state.estimator.position_valid:
        yield "Fence requires position"


def _is_on(state: VehicleState) -> bool:
    return bool(int(state.parameters["FENCE_ENABLE"]))


def _beyond(state: VehicleState, plans: PlanStore, position_m: Vector, *, flies: bool) -> bool:
    parameters = state.parameters
    if state.home_m is None:
        return False
    (n, e, d) = position_m
    (home_n, home_e, home_d) = state.home_m
    kinds = int(parameters["FENCE_TYPE"])
    too_high = flies and kinds & _HEIGHT and home_d - d > parameters["FENCE_ALT_MAX"]
    too_far = kinds & _CIRCLE and math.hypot(n - home_n, e - home_e) > parameters["FENCE_RADIUS"]
    return bool(
        too_high
        or too_far
        or (kinds & _AREAS and violated(plans.fence.items, state.frame, position_m))
    )
