"""Follow-me: behind, beside or before a FOLLOW_TARGET, with the distances of FLW_TGT_*, as PX4 v1.17 flies it."""

import math
from dataclasses import dataclass
from typing import Final

from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.vehicle_state import VehicleState
from sitl_mock.world import Vector, wrap_pi

_STALE_S: Final = 3.0
"""After this long without a report the target is taken to stand where it was last seen."""
_FILTER_RAD_S: Final = 1.0
_DAMPING: Final = 0.7071
_COURSE_M_S: Final = 1.0
"""Slower than this a target has no course."""
_LEVEL_M: Final = 3.0
"""Nearer than this to its height the vehicle moves sideways."""
_FACING_M: Final = 1.0
_TRACKED: Final = 2
"""FLW_TGT_ALT_M: height above the target itself."""


@dataclass(slots=True)
class Follow:
    """What following remembers.

    Attributes:
        home_down_m: Height 0 of FLW_TGT_HT, taken when the mode began.
        course_rad: The target's, as last seen moving.
        angle_rad: Bearing of the vehicle from the target, turned no faster than FLW_TGT_MAX_VEL.
    """

    home_down_m: float
    course_rad: float = 0.0
    angle_rad: float = math.nan
    _position_m: Vector | None = None
    _velocity_m_s: Vector = (0.0, 0.0, 0.0)

    def fly(self, state: VehicleState, dt_s: float) -> Setpoint:
        """The setpoint now; without a target it stands."""
        seen = state.target
        if seen is None:
            return Setpoint(Kind.BRAKE)
        age_s = state.now_s - seen.at_s
        velocity = seen.velocity_m_s if age_s < _STALE_S else (0.0, 0.0, 0.0)
        carried_s = min(age_s, _STALE_S)
        here = (
            seen.position_m[0] + seen.velocity_m_s[0] * carried_s,
            seen.position_m[1] + seen.velocity_m_s[1] * carried_s,
            seen.position_m[2] + seen.velocity_m_s[2] * carried_s,
        )
        target, moving = self._smooth(here, velocity, dt_s)
        if min(math.hypot(*velocity[:2]), math.hypot(*moving[:2])) >= _COURSE_M_S:
            self.course_rad = math.atan2(moving[1], moving[0])
        return self._beside(state, target, moving, dt_s)

    def _smooth(self, position: Vector, velocity: Vector, dt_s: float) -> tuple[Vector, Vector]:
        """A second-order filter, so that a report does not make the vehicle jump."""
        if self._position_m is None:
            self._position_m, self._velocity_m_s = position, velocity
        p, v = list(self._position_m), list(self._velocity_m_s)
        for axis in range(3):
            pull = _FILTER_RAD_S**2 * (position[axis] - p[axis])
            pull += 2.0 * _DAMPING * _FILTER_RAD_S * (velocity[axis] - v[axis])
            v[axis] += pull * dt_s
            p[axis] += v[axis] * dt_s
        self._position_m, self._velocity_m_s = (p[0], p[1], p[2]), (v[0], v[1], v[2])
        return self._position_m, self._velocity_m_s

    def _beside(self, state: VehicleState, target: Vector, moving: Vector, dt_s: float) -> Setpoint:
        parameters = state.parameters
        distance_m = float(parameters["FLW_TGT_DST"])
        wanted = wrap_pi(self.course_rad + math.radians(float(parameters["FLW_TGT_FA"])))
        if math.isnan(self.angle_rad):
            self.angle_rad = 0.0
        most = float(parameters["FLW_TGT_MAX_VEL"]) / distance_m
        rate = min(max(wrap_pi(wanted - self.angle_rad) / dt_s, -most), most)
        self.angle_rad = wrap_pi(self.angle_rad + rate * dt_s)
        n, e = math.cos(self.angle_rad), math.sin(self.angle_rad)
        base = target[2] if int(parameters["FLW_TGT_ALT_M"]) == _TRACKED else self.home_down_m
        down = base - float(parameters["FLW_TGT_HT"])
        to_n, to_e = target[0] - state.position_m[0], target[1] - state.position_m[1]
        yaw = math.atan2(to_e, to_n) if math.hypot(to_n, to_e) > _FACING_M else state.yaw_rad
        if abs(down - state.position_m[2]) >= _LEVEL_M:
            return Setpoint(Kind.TRAVEL, (state.position_m[0], state.position_m[1], down), yaw_rad=yaw)
        around = rate * distance_m
        return Setpoint(
            Kind.STREAM,
            (target[0] + n * distance_m, target[1] + e * distance_m, down),
            (moving[0] - e * around, moving[1] + n * around, math.nan),
            yaw_rad=yaw,
        )
