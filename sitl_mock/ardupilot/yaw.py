"""CONDITION_YAW: the nose turns to a heading at a rate, and stays there (ArduCopter's ``autoyaw.cpp``)."""

import math
from dataclasses import dataclass

_FULL: float = 360.0


@dataclass(slots=True)
class Turn:
    """A turn under way.

    Attributes:
        heading_rad: Where the nose shall point now.
        left_rad: What is still to be turned, clockwise positive.
        rate_rad_s: How fast.
    """

    heading_rad: float
    left_rad: float
    rate_rad_s: float

    def advance(self, dt_s: float) -> float:
        """Turn on for dt_s; return the heading wanted."""
        step = math.copysign(min(abs(self.left_rad), self.rate_rad_s * dt_s), self.left_rad)
        self.left_rad -= step
        self.heading_rad = math.remainder(self.heading_rad + step, math.tau)
        return self.heading_rad


def turn_from(
    yaw_rad: float, angle_deg: float, rate_deg_s: float, direction: float, *, relative: bool, slew_deg_s: float
) -> Turn:
    """Return the turn that CONDITION_YAW asks for.

    Args:
        yaw_rad: Heading now.
        angle_deg: param1, a heading or (relative) an angle.
        rate_deg_s: param2; 0 for `slew_deg_s`.
        direction: param3: -1 counter-clockwise, 1 clockwise, 0 the shorter way.
        relative: param4.
        slew_deg_s: ATC_SLEW_YAW in degrees a second.
    """
    if relative:
        left = -angle_deg if direction < 0 else angle_deg
    else:
        left = math.remainder(angle_deg - math.degrees(yaw_rad), _FULL)
        if direction < 0 < left:
            left -= _FULL
        elif left < 0 < direction:
            left += _FULL
    rate = min(rate_deg_s, slew_deg_s) if rate_deg_s > 0.0 else slew_deg_s
    return Turn(yaw_rad, math.radians(left), math.radians(rate))
