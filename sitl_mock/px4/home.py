"""Where PX4 believes home to be, and why that moves in flight, as recorded on v1.17 and read in its commander.

Home is the estimated place at arming, and again at leaving the ground. During the first 120 s of a flight its height is
then corrected: whenever barometer and integrated climb rate of the receiver agree with each other better than either
does with the receiver's height, and by more than a metre. As the receiver scatters by half a metre, home jumps about by
up to two metres, and what is reported relative to it (GLOBAL_POSITION_INT.relative_alt) jumps along. The local frame
(GPS_GLOBAL_ORIGIN) stays. A home that was set by command is kept at arming.
"""

import math
from dataclasses import dataclass
from typing import Final

from sitl_mock.vehicle_state import VehicleState

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
