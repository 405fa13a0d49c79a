"""CIRCLE: around a point ahead of where it began, at CIRCLE_RATE (ArduPilot's ``AC_Circle``)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.world import Vector

_LAG_MADE_UP = 1.4
"""The tracking's lag would widen the circle; the real one flies 9.8 m at 3.4 m/s for a radius of 10 m."""


@dataclass(slots=True)
class Circle:
    """One circle.

    Attributes:
        centre_m: North and east of its centre.
        radius_m: Its radius.
        angle_rad: Where on it the vehicle shall be, as seen from the centre.
        rate_rad_s: How fast now, clockwise positive.
        rate_max_rad_s: How fast in the end.
        change_rad_s2: How fast that changes.
    """

    centre_m: tuple[float, float]
    radius_m: float
    angle_rad: float
    rate_max_rad_s: float
    change_rad_s2: float
    rate_rad_s: float = 0.0

    def setpoint(self, climb_m_s: float, dt_s: float) -> Setpoint:
        """Go on for dt_s: the place on the circle, the speed along it, and the nose to the centre."""
        change = self.change_rad_s2 * dt_s
        self.rate_rad_s += min(max(self.rate_max_rad_s - self.rate_rad_s, -change), change)
        self.angle_rad = math.remainder(self.angle_rad + self.rate_rad_s * dt_s, math.tau)
        cosine, sine = math.cos(self.angle_rad), math.sin(self.angle_rad)
        radius, along = self.radius_m, self.radius_m * self.rate_rad_s
        inwards = _LAG_MADE_UP * along * self.rate_rad_s
        return Setpoint(
            Kind.STREAM,
            (self.centre_m[0] + radius * cosine, self.centre_m[1] + radius * sine, math.nan),
            (-along * sine, along * cosine, -climb_m_s),
            (-inwards * cosine, -inwards * sine, 0.0),
            yaw_rad=math.remainder(self.angle_rad + math.pi, math.tau),
        )


def circle_from(position_m: Vector, yaw_rad: float, parameters: Mapping[str, float]) -> Circle:
    """Return the circle that begins here: its centre lies CIRCLE_RADIUS ahead; WPNAV_ACCEL bounds its rate."""
    radius = float(parameters["CIRCLE_RADIUS"]) * 0.01
    north, east, _ = position_m
    accel, speed = float(parameters["WPNAV_ACCEL"]) * 0.01, float(parameters["WPNAV_SPEED"]) * 0.01
    rate = math.radians(float(parameters["CIRCLE_RATE"]))
    change = max(abs(rate), math.radians(2.0))
    if radius > 0.0:
        change = min(change, 0.5 * accel / radius)
        most = min(speed, math.sqrt(0.5 * accel * radius)) / radius
        rate = min(max(rate, -most), most)
    centre = (north + radius * math.cos(yaw_rad), east + radius * math.sin(yaw_rad))
    return Circle(centre, radius, math.remainder(yaw_rad + math.pi, math.tau), rate, change)
