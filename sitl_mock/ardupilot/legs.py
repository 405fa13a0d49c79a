"""Straight legs of AUTO: each from rest to rest with limited jerk, corners cut within WPNAV_RADIUS.

Fitted to the speeds and switching times of ArduCopter 4.5.7. The effective jerk is 0.8 of WPNAV_JERK, because the real
one changes gradually. The next leg begins when, half the remaining time later, the sum of both legs passes within
WPNAV_RADIUS of the corner; then the corner counts as reached.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.vector import ZERO, Vector

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sitl_mock.missions.flight import Leg, MissionFlight
    from sitl_mock.vehicle.state import VehicleState

_JERK_SHARE: Final = 0.8
_LEAST_M: Final = 1e-3


class Along(NamedTuple):
    """Distance along a leg, speed and acceleration."""

    distance_m: float
    speed_m_s: float
    accel_m_s2: float


@dataclass(frozen=True, slots=True)
class Rise:
    """Acceleration from rest to a speed with constant jerk: rising, constant at the limit, falling.

    Attributes:
        speed_m_s: Final speed.
        accel_m_s2: Limit of the acceleration.
        jerk_m_s3: Magnitude of the jerk.
    """

    speed_m_s: float
    accel_m_s2: float
    jerk_m_s3: float

    @property
    def peak_m_s2(self) -> float:
        """Greatest acceleration reached."""
        return min(self.accel_m_s2, math.sqrt(self.speed_m_s * self.jerk_m_s3))

    @property
    def lasts_s(self) -> float:
        """Duration."""
        peak = self.peak_m_s2
        return self.speed_m_s / peak + peak / self.jerk_m_s3 if peak > 0.0 else 0.0

    def at(self, after_s: float) -> Along:
        """Return the motion after some time."""
        jerk = self.jerk_m_s3
        peak = self.peak_m_s2
        left_s = self.lasts_s - after_s
        bend_s = peak / jerk
        if after_s <= bend_s:
            return Along(jerk * after_s**3 / 6.0, jerk * after_s**2 / 2.0, jerk * after_s)
        if left_s <= bend_s:
            distance_m = self.speed_m_s * (self.lasts_s / 2.0 - left_s) + jerk * left_s**3 / 6.0
            return Along(distance_m, self.speed_m_s - jerk * left_s**2 / 2.0, jerk * left_s)
        even_s = after_s - bend_s
        start = jerk * bend_s**2 / 2.0
        distance_m = jerk * bend_s**3 / 6.0 + start * even_s + peak * even_s**2 / 2.0
        return Along(distance_m, start + peak * even_s, peak)


@dataclass(frozen=True, slots=True)
class Curve:
    """One leg from rest to rest.

    Attributes:
        start_m: Start.
        goal_m: End.
        begun_s: Time of the start.
        length_m: Length.
        rise: Acceleration at the start; mirrored, the braking at the end.
    """

    start_m: Vector
    goal_m: Vector
    begun_s: float
    length_m: float
    rise: Rise

    @property
    def end_s(self) -> float:
        """Time of the end."""
        even_m = self.length_m - self.rise.speed_m_s * self.rise.lasts_s
        return self.begun_s + 2.0 * self.rise.lasts_s + even_m / self.rise.speed_m_s

    def along(self, now_s: float) -> Along:
        """Return the motion at a time."""
        rise = self.rise
        after_s = max(now_s - self.begun_s, 0.0)
        left_s = max(self.end_s - now_s, 0.0)
        if left_s < rise.lasts_s:
            distance_m, speed, accel = rise.at(left_s)
            return Along(self.length_m - distance_m, speed, -accel)
        if after_s < rise.lasts_s:
            return rise.at(after_s)
        half_m = rise.speed_m_s * rise.lasts_s / 2.0
        return Along(half_m + rise.speed_m_s * (after_s - rise.lasts_s), rise.speed_m_s, 0.0)

    @property
    def direction(self) -> Vector:
        """Unit vector from start to end."""
        return (self.goal_m - self.start_m) / self.length_m


def curve(
    start_m: Vector,
    goal_m: Vector,
    begun_s: float,
    speed_m_s: float,
    parameters: Mapping[str, float],
) -> Curve:
    """Return the leg between two positions within the WPNAV_* limits, horizontal and vertical separately.

    Args:
        start_m: Start, m NED.
        goal_m: End, m NED.
        begun_s: Time of the start.
        speed_m_s: Requested speed; NaN for WPNAV_SPEED.
        parameters: The vehicle's parameters.
    """
    length_m = max(math.dist(start_m, goal_m), _LEAST_M)
    level = math.dist(start_m[:2], goal_m[:2]) / length_m
    high = abs(goal_m[2] - start_m[2]) / length_m
    level = max(level, _LEAST_M)
    high = max(high, _LEAST_M)
    climbs = "WPNAV_SPEED_UP" if goal_m[2] < start_m[2] else "WPNAV_SPEED_DN"
    cruise = speed_m_s if speed_m_s > 0.0 else float(parameters["WPNAV_SPEED"]) * 0.01
    speed = min(cruise / level, float(parameters[climbs]) * 0.01 / high)
    accel = min(
        float(parameters["WPNAV_ACCEL"]) * 0.01 / level,
        float(parameters["WPNAV_ACCEL_Z"]) * 0.01 / high,
    )
    jerk = _JERK_SHARE * float(parameters["WPNAV_JERK"])
    reached = (length_m * math.sqrt(jerk) / 2.0) ** (2.0 / 3.0)
    if reached > accel * accel / jerk:
        reached = (
            accel / 2.0 * (math.sqrt((accel / jerk) ** 2 + 4.0 * length_m / accel) - accel / jerk)
        )
    return Curve(start_m, goal_m, begun_s, length_m, Rise(min(speed, reached), accel, jerk))


@dataclass(slots=True)
class Legs:
    """The legs being flown: the present one, the rest of the last one and the start of the next one."""

    _before: Curve | None = None
    _present: Curve | None = None
    _following: Curve | None = None
    _speed_m_s: float = math.nan

    def setpoint(self, state: VehicleState, mission: MissionFlight, leg: Leg) -> Setpoint:
        """Continue towards a leg's end; sets the time when the mission counts it as reached."""
        now_s = state.now_s
        present = self._towards(leg.position_m, state, leg.speed_m_s)
        following = mission.following(state)
        if self._following is None and following is not None:
            ahead = curve(
                present.goal_m, following.position_m, now_s, following.speed_m_s, state.parameters
            )
            # It begins if the sum of both legs passes the corner within the radius at half of the time left.
            left_s = present.end_s - now_s
            if left_s <= min(present.rise.lasts_s, ahead.rise.lasts_s):
                to_go = present.rise.at(left_s / 2.0).distance_m
                gone = ahead.rise.at(left_s / 2.0).distance_m
                directions = zip(present.direction, ahead.direction, strict=True)
                corner = [b * gone - a * to_go for a, b in directions]
                if math.hypot(*corner) < float(state.parameters["WPNAV_RADIUS"]) * 0.01:
                    self._following = ahead
        lead_s = 0.0 if self._following is None else (present.end_s - self._following.begun_s) / 2.0
        mission.due_s = present.end_s - lead_s
        return self._sum(now_s)

    def begin(self, state: VehicleState) -> Vector:
        """Drop all legs and brake; returns the stopping point, where the next leg begins."""
        # A leg whose second half brakes from the present position and velocity.
        speed_m_s = max(math.hypot(*state.velocity_m_s), _LEAST_M)
        parameters = state.parameters
        rise = Rise(
            speed_m_s, float(parameters["WPNAV_ACCEL"]) * 0.01, float(parameters["PSC_JERK_XY"])
        )
        half_s = rise.lasts_s / 2.0
        start_m = state.position_m.after(state.velocity_m_s, -half_s)
        goal_m = state.position_m.after(state.velocity_m_s, half_s)
        self._before = Curve(
            start_m, goal_m, state.now_s - rise.lasts_s, 2.0 * speed_m_s * half_s, rise
        )
        self._present = self._following = None
        return self._before.goal_m

    def onwards(self, state: VehicleState, goal_m: Vector, speed_m_s: float) -> Setpoint:
        """Continue towards a position outside a mission; a leg that is braking already is completed in parallel."""
        self._towards(goal_m, state, speed_m_s)
        return self._sum(state.now_s)

    def left_m(self, now_s: float) -> float:
        """Remaining length of the present leg."""
        present = self._present
        return math.inf if present is None else present.length_m - present.along(now_s).distance_m

    def _towards(self, goal_m: Vector, state: VehicleState, speed_m_s: float) -> Curve:
        present = self._present
        following = self._following
        if present is not None and math.dist(present.goal_m, goal_m) < _LEAST_M:
            return self._at_speed(present, state, speed_m_s)
        self._speed_m_s = speed_m_s
        if following is not None and math.dist(following.goal_m, goal_m) < _LEAST_M:
            self._before = present
            self._following = None
            self._present = following
            return following
        if present is not None and state.now_s >= present.end_s - present.rise.lasts_s:
            self._before = present
            start_m = present.goal_m
        elif self._before is not None and present is None:
            start_m = self._before.goal_m
        else:
            start_m = self.begin(state)
        self._following = None
        self._present = curve(start_m, goal_m, state.now_s, speed_m_s, state.parameters)
        return self._present

    def _at_speed(self, present: Curve, state: VehicleState, speed_m_s: float) -> Curve:
        """Return the present leg; after a change of speed a new one, if the vehicle could still stop before its end."""
        unchanged = speed_m_s == self._speed_m_s or not speed_m_s > 0.0
        braking_s = present.end_s - present.rise.lasts_s
        if unchanged or self._following is not None or state.now_s >= braking_s:
            return present
        self._speed_m_s = speed_m_s
        before = self._before
        start_m = self.begin(state)
        if math.dist(start_m, state.position_m) >= math.dist(present.goal_m, state.position_m):
            self._before = before
            self._present = present
            return present
        self._present = curve(start_m, present.goal_m, state.now_s, speed_m_s, state.parameters)
        return self._present

    def _sum(self, now_s: float) -> Setpoint:
        curves = [
            curve for curve in (self._before, self._present, self._following) if curve is not None
        ]
        position_m = curves[0].start_m
        velocity_m_s = ZERO
        acceleration_m_s2 = ZERO
        for curve in curves:
            along = curve.along(now_s)
            direction = curve.direction
            position_m = position_m.after(direction, along.distance_m)
            velocity_m_s = velocity_m_s.after(direction, along.speed_m_s)
            acceleration_m_s2 = acceleration_m_s2.after(direction, along.accel_m_s2)
        return Setpoint(Kind.TRACK, position_m, velocity_m_s, acceleration_m_s2)
