"""Leaving the ground and coming back to it, as PX4's land detector tells it: later than the legs do."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.vehicle_state import Severity

if TYPE_CHECKING:
    from sitl_mock.vehicle_state import VehicleState

LIFTING_S: Final = 0.8
"""From the beginning of a take-off's thrust until it counts as one (measured)."""
LANDED_S: Final = 2.8
"""From touching the ground until that counts as a landing (measured)."""


@dataclass(slots=True)
class LandDetector:
    """What the detector of one vehicle believes.

    Attributes:
        left: It counts as having left the ground.
    """

    left: bool = False
    _lift_s: float = math.inf
    _told_s: float = math.nan

    def on_ground(self, state: VehicleState) -> bool:
        """Whether it counts as standing."""
        return not self.left and state.on_ground and not just_down(state)

    def notice_lifting(self, state: VehicleState, now_s: float, setpoint: Setpoint) -> None:
        """The thrust of a take-off counts as having left the ground before the legs do."""
        if not state.on_ground:
            self._lift_s = math.inf
        elif setpoint.kind <= Kind.IDLING:
            self._lift_s, self.left = math.inf, self.left and just_down(state)
        else:
            spooled_s = state.armed_s + float(state.parameters["COM_SPOOLUP_TIME"])
            self._lift_s = min(self._lift_s, max(now_s, spooled_s))
        if not self.left and (not state.on_ground or now_s > self._lift_s + LIFTING_S):
            self.left = True
            state.say(Severity.INFO, "Takeoff detected")

    def notice_landing(self, state: VehicleState) -> None:
        """Say once that it has landed."""
        if self._told_s != state.landed_s and state.standing_s >= LANDED_S:
            self._told_s = state.landed_s
            state.say(Severity.INFO, "Landing detected")


def just_down(state: VehicleState) -> bool:
    """Whether it stands for too short a time for that to count as a landing."""
    return state.armed and state.flew and state.standing_s < LANDED_S
