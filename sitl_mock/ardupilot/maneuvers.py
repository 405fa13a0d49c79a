"""CIRCLE, CONDITION_YAW and DO_CHANGE_SPEED.

CIRCLE flies around a point ahead of its start at CIRCLE_RATE. CONDITION_YAW turns the nose to a heading and keeps it.
DO_CHANGE_SPEED replaces speeds of the parameters.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.vector import Vector

_LAG_MADE_UP = 1.4
"""Compensates the tracking lag, which would widen the circle; the real one flies 9.8 m at 3.4 m/s for 10 m."""


@dataclass(slots=True)
class Circle:
    """A circle and the progress along it.

    Attributes:
        centre_m: North and east of its centre.
        radius_m: Its radius.
        angle_rad: Desired bearing of the vehicle from the centre.
        rate_rad_s: Present angular rate, clockwise positive.
        rate_max_rad_s: Final angular rate.
        change_rad_s2: Angular acceleration.
    """

    centre_m: tuple[float, float]
    radius_m: float
    angle_rad: float
    rate_max_rad_s: float
    change_rad_s2: float
    rate_rad_s: float = 0.0

    def setpoint(self, climb_m_s: float, dt_s: float) -> Setpoint:
        """Advance by dt_s; return position and velocity on the circle with the nose towards the centre."""
        change = self.change_rad_s2 * dt_s
        self.rate_rad_s += min(max(self.rate_max_rad_s - self.rate_rad_s, -change), change)
        self.angle_rad = math.remainder(self.angle_rad + self.rate_rad_s * dt_s, math.tau)
        cosine = math.cos(self.angle_rad)
        sine = math.sin(self.angle_rad)
        radius = self.radius_m
        along = self.radius_m * self.rate_rad_s
        inwards = _LAG_MADE_UP * along * self.rate_rad_s
        return Setpoint(
            Kind.STREAM,
            Vector(
                (self.centre_m[0] + radius * cosine, self.centre_m[1] + radius * sine, math.nan)
            ),
            Vector((-along * sine, along * cosine, -climb_m_s)),
            Vector((-inwards * cosine, -inwards * sine, 0.0)),
            yaw_rad=math.remainder(self.angle_rad + math.pi, math.tau),
        )


def circle_from(position_m: Vector, yaw_rad: float, parameters: Mapping[str, float]) -> Circle:
    """Return the circle that begins here: its centre lies CIRCLE_RADIUS ahead; WPNAV_ACCEL bounds its rate."""
    radius = float(parameters["CIRCLE_RADIUS"]) * 0.01
    north, east, _ = position_m
    rate = math.radians(float(parameters["CIRCLE_RATE"]))
    centre = (north + radius * math.cos(yaw_rad), east + radius * math.sin(yaw_rad))
    return _circle(centre, radius, math.remainder(yaw_rad + math.pi, math.tau), rate, parameters)


def _circle(
    centre: tuple[float, float],
    radius: float,
    angle_rad: float,
    rate: float,
    parameters: Mapping[str, float],
) -> Circle:
    """Return a circle whose rate keeps WPNAV_SPEED and WPNAV_ACCEL."""
    accel = float(parameters["WPNAV_ACCEL"]) * 0.01
    speed = float(parameters["WPNAV_SPEED"]) * 0.01
    change = max(abs(rate), math.radians(2.0))
    if radius > 0.0:
        change = min(change, 0.5 * accel / radius)
        max_rate = min(speed, math.sqrt(0.5 * accel * radius)) / radius
        rate = min(max(rate, -max_rate), max_rate)
    return Circle(centre, radius, angle_rad, rate, change)


_STORED_M: Final = 255.0
"""Radii up to this are stored in whole metres, larger ones in tens of metres."""


def turns_radius_m(radius_m: float, parameters: Mapping[str, float]) -> float:
    """Radius that LOITER_TURNS flies: as stored, or CIRCLE_RADIUS for 0."""
    size_m = abs(radius_m)
    if size_m < 1.0:
        return float(parameters["CIRCLE_RADIUS"]) * 0.01
    return float(int(size_m)) if size_m <= _STORED_M else min(int(size_m * 0.1), 255) * 10.0


def turns_edge(position_m: Vector, yaw_rad: float, centre_m: Vector, radius_m: float) -> Vector:
    """Return the point of a circle nearest to a position; behind the vehicle from its centre."""
    north = position_m[0] - centre_m[0]
    east = position_m[1] - centre_m[1]
    away_m = math.hypot(north, east)
    angle_rad = math.atan2(east, north) if away_m > 0.0 else yaw_rad + math.pi
    return Vector(
        (
            centre_m[0] + radius_m * math.cos(angle_rad),
            centre_m[1] + radius_m * math.sin(angle_rad),
            centre_m[2],
        )
    )


def turns_from(
    position_m: Vector,
    centre_m: Vector,
    radius_m: float,
    *,
    clockwise: bool,
    parameters: Mapping[str, float],
) -> Circle:
    """Return the circle of LOITER_TURNS, which begins at the vehicle's bearing from the centre.

    Args:
        position_m: The vehicle.
        centre_m: Centre of the circle.
        radius_m: Its radius.
        clockwise: Its direction, seen from above.
        parameters: The vehicle's parameters; CIRCLE_RATE gives the rate.
    """
    angle_rad = math.atan2(position_m[1] - centre_m[1], position_m[0] - centre_m[0])
    rate = math.radians(abs(float(parameters["CIRCLE_RATE"])))
    return _circle(centre_m[:2], radius_m, angle_rad, rate if clockwise else -rate, parameters)


_FULL: float = 360.0


@dataclass(slots=True)
class Turn:
    """A turn in progress.

    Attributes:
        heading_rad: Present desired heading.
        left_rad: Remaining angle, clockwise positive.
        rate_rad_s: Turn rate.
    """

    heading_rad: float
    left_rad: float
    rate_rad_s: float

    def advance(self, dt_s: float) -> float:
        """Advance by dt_s; return the desired heading."""
        step = math.copysign(min(abs(self.left_rad), self.rate_rad_s * dt_s), self.left_rad)
        self.left_rad -= step
        self.heading_rad = math.remainder(self.heading_rad + step, math.tau)
        return self.heading_rad


def turn_from(
    yaw_rad: float,
    angle_deg: float,
    rate_deg_s: float,
    direction: float,
    *,
    relative: bool,
    slew_deg_s: float,
) -> Turn:
    """Return the turn of a CONDITION_YAW command.

    Args:
        yaw_rad: Heading now.
        angle_deg: param1, a heading or (relative) an angle.
        rate_deg_s: param2; 0 for `slew_deg_s`.
        direction: param3: -1 counter-clockwise, 1 clockwise, 0 the shorter way.
        relative: param4.
        slew_deg_s: ATC_SLEW_YAW in degrees a second.
    """
    if relative:
        turn_deg = -angle_deg if direction < 0 else angle_deg
    else:
        turn_deg = math.remainder(angle_deg - math.degrees(yaw_rad), _FULL)
        if direction < 0 < turn_deg:
            turn_deg -= _FULL
        elif turn_deg < 0 < direction:
            turn_deg += _FULL
    rate = min(rate_deg_s, slew_deg_s) if rate_deg_s > 0.0 else slew_deg_s
    return Turn(yaw_rad, math.radians(turn_deg), math.radians(rate))


@dataclass(slots=True)
class Speeds:
    """Speeds that replace those of the parameters; NaN keeps the parameter."""

    level_m_s: float = math.nan
    climb_m_s: float = math.nan
    sink_m_s: float = math.nan

    def change(self, kind: float, speed_m_s: float) -> None:
        """Take DO_CHANGE_SPEED: kind 3 is the descent, 2 the climb, lower values the ground speed."""
        if kind > 2.9:
            self.sink_m_s = speed_m_s
        elif kind > 1.9:
            self.climb_m_s = speed_m_s
        else:
            self.level_m_s = speed_m_s

    def applied(self, setpoint: Setpoint) -> Setpoint:
        """Return a position setpoint with these speeds."""
        return setpoint._replace(
            speed_m_s=self.level_m_s, climb_m_s=self.climb_m_s, sink_m_s=self.sink_m_s
        )
