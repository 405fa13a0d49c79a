"""PX4 v1.17's DO_ORBIT and follow-me.

DO_ORBIT flies to the nearest point of the circle, then along it. Follow-me keeps the position relative to a
FOLLOW_TARGET that the parameters FLW_TGT_* define.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.vector import ZERO, Vector
from sitl_mock.vehicle.state import VehicleState
from sitl_mock.world import wrap_pi

LEAST_RADIUS_M: Final = 1.0
_ACCELERATION_M_S2: Final = 2.0
_ON_CIRCLE_M: Final = 2.0


class Facing(IntEnum):
    """ORBIT_YAW_BEHAVIOUR."""

    CENTRE = 0
    INITIAL = 1
    UNCONTROLLED = 2
    TANGENT = 3
    PILOT = 4
    UNCHANGED = 5


@dataclass(slots=True)
class Orbit:
    """A circle and the progress of its approach.

    Attributes:
        centre_m: Centre of the circle at the height of the flight.
        radius_m: Positive.
        speed_m_s: Positive is clockwise, seen from above.
        facing: Where the nose points.
        initial_yaw_rad: Heading at the time of the command.
    """

    centre_m: Vector
    initial_yaw_rad: float
    radius_m: float = LEAST_RADIUS_M
    speed_m_s: float = 1.0
    facing: Facing = Facing.CENTRE
    _approaching: bool = True
    _around_m_s: float = 0.0

    def change(
        self,
        state: VehicleState,
        radius_m: float,
        speed_m_s: float,
        facing: float,
        centre: tuple[float, float, float],
    ) -> bool:
        """Take DO_ORBIT; NaN keeps the present value. False if the radius exceeds MC_ORBIT_RAD_MAX.

        Args:
            state: The vehicle.
            radius_m: Negative is counter-clockwise.
            speed_m_s: Along the circle.
            facing: ORBIT_YAW_BEHAVIOUR.
            centre: Latitude, longitude (degrees), height above sea level (metres).
        """
        clockwise = self.speed_m_s > 0.0
        radius = self.radius_m
        speed = abs(self.speed_m_s)
        if math.isfinite(radius_m):
            clockwise = radius_m > 0.0
            radius = abs(radius_m)
        if math.isfinite(speed_m_s):
            speed = speed_m_s
        if not LEAST_RADIUS_M <= radius <= float(state.parameters["MC_ORBIT_RAD_MAX"]):
            return False
        speed = min(
            abs(speed),
            float(state.parameters["MPC_XY_VEL_MAX"]),
            math.sqrt(_ACCELERATION_M_S2 * radius),
        )
        self.radius_m = radius
        self.speed_m_s = speed if clockwise else -speed
        if math.isfinite(facing) and 0 <= int(facing + 0.5) < Facing.UNCHANGED:
            self.facing = Facing(int(facing + 0.5))
        self.initial_yaw_rad = state.yaw_rad
        lat, lon, alt = centre
        north, east, down = self.centre_m
        if math.isfinite(lat + lon):
            north, east, _ = state.frame.to_local(lat, lon, 0.0)
        if math.isfinite(alt):
            down = state.frame.origin.alt_amsl_m - alt
        self.centre_m = Vector((north, east, down))
        if not self._approaching:
            self._approaching = not self._on_circle(state)
        return True

    def fly(self, state: VehicleState, dt_s: float) -> Setpoint:
        """Return the present setpoint."""
        if self._approaching and self._on_circle(state):
            self._approaching = False
            self._around_m_s = 0.0
        north, east, away_m = self._from_centre(state)
        n, e = (north / away_m, east / away_m) if away_m > 1e-6 else (1.0, 0.0)
        if self._approaching:
            point = self.centre_m + Vector((n * self.radius_m, e * self.radius_m, 0.0))
            return Setpoint(
                Kind.TRAVEL,
                point,
                yaw_rad=math.atan2(-e, -n),
                speed_m_s=float(state.parameters["MPC_XY_CRUISE"]),
            )
        step = float(state.parameters["MPC_ACC_HOR"]) * dt_s
        self._around_m_s += min(max(self.speed_m_s - self._around_m_s, -step), step)
        outward = self.radius_m - away_m
        inward_m_s2 = self._around_m_s**2 / self.radius_m
        # The heading and its rate.
        rate = self._around_m_s / self.radius_m
        if self.facing is Facing.INITIAL:
            yaw = self.initial_yaw_rad
            rate = math.nan
        elif self.facing is Facing.TANGENT:
            sign = math.copysign(1.0, self.speed_m_s)
            yaw = math.atan2(sign * n, -sign * e)
        elif self.facing is Facing.CENTRE:
            yaw = math.atan2(-e, -n)
        else:
            yaw = math.nan
            rate = 0.0
        return Setpoint(
            Kind.STREAM,
            Vector((math.nan, math.nan, self.centre_m[2])),
            Vector(
                (-e * self._around_m_s + n * outward, n * self._around_m_s + e * outward, math.nan)
            ),
            Vector((-n * inward_m_s2, -e * inward_m_s2, math.nan)),
            yaw_rad=yaw,
            yaw_rate_rad_s=rate,
        )

    def _from_centre(self, state: VehicleState) -> tuple[float, float, float]:
        north = state.position_m[0] - self.centre_m[0]
        east = state.position_m[1] - self.centre_m[1]
        return north, east, math.hypot(north, east)

    def _on_circle(self, state: VehicleState) -> bool:
        off_m = abs(self._from_centre(state)[2] - self.radius_m)
        high_m = abs(state.position_m[2] - self.centre_m[2])
        return off_m < _ON_CIRCLE_M and high_m < float(state.parameters["NAV_MC_ALT_RAD"])


_STALE_S: Final = 3.0
"""After this long without a report the target is assumed to stand at its last position."""
_FILTER_RAD_S: Final = 1.0
_DAMPING: Final = 0.7071
_COURSE_M_S: Final = 1.0
"""Slower than this a target has no course."""
_LEVEL_M: Final = 3.0
"""Nearer than this to its height the vehicle moves sideways."""
_FACING_M: Final = 1.0
_SAFE_M: Final = 1.0
"""MINIMUM_SAFETY_ALTITUDE: PX4 climbs below it and descends above it, many times a second, and so follows at it."""
_CLEAR_M: Final = 0.5
"""Nearer than this to the ground the vehicle only climbs."""
_ASCENT_M_S: Final = 0.5
_TRACKED: Final = 2
"""FLW_TGT_ALT_M: height above the target itself."""


@dataclass(slots=True)
class Follow:
    """State of follow-me.

    Attributes:
        home_down_m: Zero of FLW_TGT_HT: the height of home when the mode began.
        course_rad: The target's last course while moving.
        angle_rad: Bearing of the vehicle from the target, turned no faster than FLW_TGT_MAX_VEL.
    """

    home_down_m: float
    course_rad: float = 0.0
    angle_rad: float = math.nan
    _position_m: Vector | None = None
    _velocity_m_s: Vector = ZERO

    def fly(self, state: VehicleState, dt_s: float) -> Setpoint:
        """Return the present setpoint; without a target the vehicle holds its position."""
        seen = state.target
        if seen is None:
            return Setpoint(Kind.BRAKE)
        age_s = state.now_s - seen.at_s
        if age_s < _STALE_S:
            velocity = seen.velocity_m_s
        else:
            velocity = ZERO
        here = seen.position_m.after(seen.velocity_m_s, min(age_s, _STALE_S))
        # A filter of second order, so that reports do not make the vehicle jump.
        if self._position_m is None:
            self._position_m = here
            self._velocity_m_s = velocity
        pull = _FILTER_RAD_S**2 * (here - self._position_m)
        pull += 2.0 * _DAMPING * _FILTER_RAD_S * (velocity - self._velocity_m_s)
        moving = self._velocity_m_s.after(pull, dt_s)
        target = self._position_m.after(moving, dt_s)
        self._velocity_m_s = moving
        self._position_m = target
        if min(math.hypot(*velocity[:2]), math.hypot(*moving[:2])) >= _COURSE_M_S:
            self.course_rad = math.atan2(moving[1], moving[0])
        parameters = state.parameters
        distance_m = float(parameters["FLW_TGT_DST"])
        wanted = wrap_pi(self.course_rad + math.radians(float(parameters["FLW_TGT_FA"])))
        if math.isnan(self.angle_rad):
            self.angle_rad = 0.0
        max_rate = float(parameters["FLW_TGT_MAX_VEL"]) / distance_m
        rate = min(max(wrap_pi(wanted - self.angle_rad) / dt_s, -max_rate), max_rate)
        self.angle_rad = wrap_pi(self.angle_rad + rate * dt_s)
        n = math.cos(self.angle_rad)
        e = math.sin(self.angle_rad)
        base = target[2] if int(parameters["FLW_TGT_ALT_M"]) == _TRACKED else self.home_down_m
        down = base - float(parameters["FLW_TGT_HT"])
        to_n = target[0] - state.position_m[0]
        to_e = target[1] - state.position_m[1]
        yaw = math.atan2(to_e, to_n) if math.hypot(to_n, to_e) > _FACING_M else state.yaw_rad
        down = min(down, state.ground_m - _SAFE_M)
        if state.ground_m - state.position_m[2] < _CLEAR_M:
            return Setpoint(
                Kind.STREAM, velocity_ned_m_s=Vector((0.0, 0.0, -_ASCENT_M_S)), yaw_rad=yaw
            )
        if abs(down - state.position_m[2]) >= _LEVEL_M:
            return Setpoint(Kind.TRAVEL, state.position_m.level_with(down), yaw_rad=yaw)
        around = rate * distance_m
        return Setpoint(
            Kind.STREAM,
            Vector((target[0] + n * distance_m, target[1] + e * distance_m, down)),
            Vector((moving[0] - e * around, moving[1] + n * around, math.nan)),
            yaw_rad=yaw,
        )
