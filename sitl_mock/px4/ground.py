"""What PX4 believes of the ground: when it leaves it and is back, and where on it home is; as recorded on v1.17.

The land detector tells leaving and landing later than the legs do.

Home is the estimated place at arming, and again at leaving the ground. During the first 120 s of a flight its height is
then corrected: whenever barometer and integrated climb rate of the receiver agree with each other better than either
does with the receiver's height, and by more than a metre. As the receiver scatters by half a metre, home jumps about by
up to two metres, and what is reported relative to it (GLOBAL_POSITION_INT.relative_alt) jumps along. The local frame
(GPS_GLOBAL_ORIGIN) stays. A home that was set by command is kept at arming.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.vehicle_state import Severity, VehicleState

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


CORRECTED_FOR_S: Final = 120.0
_LEAST_CORRECTION_M: Final = 1.0
_MOVED_M: Final = 1.0
"""On the ground home follows a vehicle that is this far from it, or this much above or below."""
_MOVED_UP_M: Final = 1.5


@dataclass(slots=True)
class HomeKeeper:
    """Keeps one vehicle's home.

    Attributes:
        took_off_s: When it last left the ground.
        applied_m: Barometer minus receiver, as of the last correction.
    """

    took_off_s: float = -math.inf
    applied_m: float = 0.0
    _climbed_to_m: float = math.nan
    _offset_m: float = 0.0
    _fix_s: float = -math.inf
    _stood: bool = True

    def update(self, state: VehicleState, *, in_mission: bool) -> None:
        """Look at the vehicle; called at every decision."""
        self._see_take_off(state, in_mission=in_mission)
        if state.sensors.fix.at_s != self._fix_s:
            since_s, self._fix_s = state.sensors.fix.at_s - self._fix_s, state.sensors.fix.at_s
            if state.now_s < self.took_off_s + CORRECTED_FOR_S and state.estimator.gps_ok:
                self._correct(state, since_s)
            else:
                self._climbed_to_m = math.nan

    def arm(self, state: VehicleState, *, in_mission: bool) -> None:
        """The vehicle has been armed."""
        if not (state.home_given or in_mission):
            state.set_home(state.position_m)

    def follow(self, state: VehicleState) -> None:
        """Disarmed on the ground: home is found, and follows a vehicle that is carried away."""
        if state.home_m is None:
            if state.estimator.global_valid:
                state.set_home(state.position_m)
            return
        north, east, down = (here - home for here, home in zip(state.position_m, state.home_m, strict=True))
        moved = math.hypot(north, east) > _MOVED_M or abs(down) > _MOVED_UP_M
        if moved and state.on_ground and state.estimator.global_valid and not state.home_given:
            state.set_home(state.position_m)

    def _see_take_off(self, state: VehicleState, *, in_mission: bool) -> None:
        stood, self._stood = self._stood, state.on_ground
        if stood and not state.on_ground and state.armed:
            self.took_off_s = state.now_s
            self.arm(state, in_mission=in_mission)

    def _correct(self, state: VehicleState, since_s: float) -> None:
        """Heights are above the local frame's origin, up."""
        fix = state.sensors.fix
        receiver_m, barometer_m = -fix.position_m[2], -state.sensors.barometer_down_m
        if math.isnan(self._climbed_to_m):
            self._climbed_to_m = receiver_m
            self._offset_m = receiver_m - barometer_m
        self._climbed_to_m -= fix.velocity_m_s[2] * since_s
        barometer_m += self._offset_m
        seen_m = receiver_m + self.applied_m
        agree_m = abs(barometer_m - self._climbed_to_m)
        if agree_m >= abs(barometer_m - seen_m) or agree_m >= abs(self._climbed_to_m - seen_m):
            return
        correction_m = barometer_m - receiver_m - self.applied_m
        if abs(correction_m) > _LEAST_CORRECTION_M and state.home_m is not None:
            north, east, down = state.home_m
            state.set_home((north, east, down + correction_m), attitude=state.home_attitude)
            self.applied_m = barometer_m - receiver_m
