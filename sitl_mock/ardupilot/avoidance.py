"""GUIDED velocities slow down before an uploaded fence, slide along it, and lead back from its margin (AVOID_ENABLE).

Fitted to flights of ArduCopter 4.5.7 into a square of 50 m: towards each side a vehicle is as fast as it can stop from
with 1 m/s² at FENCE_MARGIN; beyond that by more than AVOID_BACKUP_DZ it does nothing but go back. The real one, asked
to go on for half a minute, swings about the margin (0.7 m before to 1.8 m beyond it); here it comes to rest there.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from sitl_mock.dynamics.shaping import root_law
from sitl_mock.missions import inclusion_polygons

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sitl_mock.dynamics import Setpoint
    from sitl_mock.protocols import PlanStore
    from sitl_mock.vehicle_state import VehicleState

_STOP_AT_FENCE: Final = 1
_POLYGONS: Final = 4
_SLOWING_M_S2: Final = 1.0


def avoiding(state: VehicleState, plans: PlanStore, setpoint: Setpoint) -> Setpoint:
    """The setpoint with its velocity as the fence allows it here."""
    parameters = state.parameters
    if not (int(parameters["FENCE_ENABLE"]) and int(parameters["AVOID_ENABLE"]) & _STOP_AT_FENCE):
        return setpoint
    north, east, down = setpoint.velocity_ned_m_s
    if not int(parameters["FENCE_TYPE"]) & _POLYGONS or math.isnan(north + east):
        return setpoint
    gain, margin_m = float(parameters["PSC_POSXY_P"]), float(parameters["FENCE_MARGIN"])
    fastest_back, bearable_m = float(parameters["AVOID_BACKUP_SPD"]), float(parameters["AVOID_BACKUP_DZ"])
    for distance_m, (to_n, to_e) in _sides(state, plans):
        room_m = distance_m - margin_m
        if room_m < -bearable_m:
            back = min(root_law(-room_m, gain, _SLOWING_M_S2), fastest_back)
            north, east = -back * to_n, -back * to_e
            break
        over = north * to_n + east * to_e - root_law(max(room_m, 0.0), gain, _SLOWING_M_S2)
        if over > 0.0:
            north, east = north - over * to_n, east - over * to_e
    return setpoint._replace(velocity_ned_m_s=(north, east, down))


def _sides(state: VehicleState, plans: PlanStore) -> Iterator[tuple[float, tuple[float, float]]]:
    """How far each side of the areas around the vehicle is, and in which direction."""
    here_n, here_e, _ = state.position_m
    for corners in inclusion_polygons(plans.fence.items, state.frame, state.position_m):
        for (a_n, a_e), (b_n, b_e) in zip(corners, (*corners[1:], corners[0]), strict=True):
            side_n, side_e = b_n - a_n, b_e - a_e
            square = side_n * side_n + side_e * side_e
            share = ((here_n - a_n) * side_n + (here_e - a_e) * side_e) / square if square > 0.0 else 0.0
            share = min(max(share, 0.0), 1.0)
            to_n, to_e = a_n + share * side_n - here_n, a_e + share * side_e - here_e
            distance_m = math.hypot(to_n, to_e)
            if distance_m > 0.0:
                yield distance_m, (to_n / distance_m, to_e / distance_m)
