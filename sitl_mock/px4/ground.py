"""PX4's land detector and home position, as recorded on v1.17.

The land detector reports take-off and landing later than they happen.

Home is the estimated position at arming, and again at take-off. In the first 120 s of a flight PX4 corrects the height
of home when barometer and integrated GPS climb rate agree better with each other than with the GPS height, and the
correction exceeds a metre. GPS height has a scatter of half a metre, so home and with it
GLOBAL_POSITION_INT.relative_alt jump by up to two metres. The local frame (GPS_GLOBAL_ORIGIN) stays. Arming does not
replace a home that a command has set.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.vector import Vector
from sitl_mock.vehicle.state import Severity, VehicleState

LIFTING_S: Final = 0.8
"""Time from take-off thrust until "Takeoff detected" (measured)."""
LANDED_S: Final = 2.8
"""Time from touchdown until "Landing detected" (measured)."""


@dataclass(slots=True)
class LandDetector:
    """The land detector of one vehicle.

    Attributes:
        left: Take-off has been detected.
    """

    left: bool = False
    _lift_s: float = math.inf
    _reported_s: float = math.nan

    def on_ground(self, state: VehicleState) -> bool:
        """True if the vehicle counts as landed."""
        return not self.left and state.on_ground and not self.just_down(state)

    def notice_lifting(self, state: VehicleState, now_s: float, setpoint: Setpoint) -> None:
        """Detect a take-off, from thrust or from leaving the ground."""
        if not state.on_ground:
            self._lift_s = math.inf
        elif setpoint.kind <= Kind.IDLING:
            self._lift_s = math.inf
            if self.left:
                self.left = self.just_down(state)
        else:
            # The thrust of Hold: the landing is not detected, and the vehicle stays armed
            if self.just_down(state):
                state.landed_s = now_s
            spooled_s = state.armed_s + float(state.parameters["COM_SPOOLUP_TIME"])
            self._lift_s = min(self._lift_s, max(now_s, spooled_s))
        if not self.left and (not state.on_ground or now_s > self._lift_s + LIFTING_S):
            self.left = True
            state.say(Severity.INFO, "Takeoff detected")

    def just_down(self, state: VehicleState) -> bool:
        """True if touchdown was too recent to count as a landing."""
        return state.armed and state.flew and state.standing_s < LANDED_S

    def notice_landing(self, state: VehicleState) -> None:
        """Report a landing once."""
        if self._reported_s != state.landed_s and state.standing_s >= LANDED_S:
            self._reported_s = state.landed_s
            state.say(Severity.INFO, "Landing detected")


CORRECTED_FOR_S: Final = 120.0
_LEAST_CORRECTION_M: Final = 1.0
_MOVED_M: Final = 1.0
"""While disarmed, home follows a vehicle that has moved more than this horizontally."""
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
        """Update home; called at every commander tick."""
        stood = self._stood
        self._stood = state.on_ground
        if stood and not state.on_ground and state.armed:
            self.took_off_s = state.now_s
            self.arm(state, in_mission=in_mission)
        if state.sensors.fix.at_s != self._fix_s:
            since_s = state.sensors.fix.at_s - self._fix_s
            self._fix_s = state.sensors.fix.at_s
            if state.now_s < self.took_off_s + CORRECTED_FOR_S and state.estimator.gps_ok:
                self._correct(state, since_s)
            else:
                self._climbed_to_m = math.nan

    def arm(self, state: VehicleState, *, in_mission: bool) -> None:
        """Set home at arming, unless a command or a mission has set it."""
        if not (state.home_given or in_mission):
            state.set_home(state.position_m)

    def follow(self, state: VehicleState) -> None:
        """Disarmed on the ground: set home once there is a position, and follow a vehicle that is carried away."""
        if state.home_m is None:
            if state.estimator.global_valid:
                state.set_home(state.position_m)
            return
        north, east, down = (
            here - home for here, home in zip(state.position_m, state.home_m, strict=True)
        )
        moved = math.hypot(north, east) > _MOVED_M or abs(down) > _MOVED_UP_M
        if moved and state.on_ground and state.estimator.global_valid and not state.home_given:
            state.set_home(state.position_m)

    def _correct(self, state: VehicleState, since_s: float) -> None:
        """Correct the height of home; heights are above the local frame's origin."""
        fix = state.sensors.fix
        receiver_m = -fix.position_m[2]
        barometer_m = -state.sensors.barometer_down_m
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
            state.set_home(Vector((north, east, down + correction_m)), attitude=state.home_attitude)
            self.applied_m = barometer_m - receiver_m
