"""What carriers of an evader's report share: refusals by reason, clocks that wrap, axes.

Sources count refusals by reason; nothing is raised to the loop.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from guidance.frames import Vector

UNKNOWN_VELOCITY: Final[Vector] = (math.nan, math.nan, math.nan)


class Refused(ValueError):  # noqa: N818 -- a verdict on a report, counted and never shown as an error
    """This report cannot be meant; `reason` is a short word for the counters."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


def finite_altitude(altitude_m: float) -> float:
    """An altitude that can be one.

    Raises:
        Refused: If it is not finite, or 100 km from sea level.
    """
    if not abs(altitude_m) < 1e5:
        raise Refused("altitude")
    return altitude_m


def standard_deviation(*variances: float) -> float:
    """The largest standard deviation of those given; NaN if none of them is known (positive and finite)."""
    known = [variance for variance in variances if math.isfinite(variance) and variance > 0.0]
    return math.sqrt(max(known)) if known else math.nan


@dataclass(slots=True)
class SenderClock:
    """Unwraps readings of a clock with a period, in its own unit.

    Each reading is taken as the nearest one to the last: a late report from before the wrap stays before it. So gaps
    must be shorter than half a period. A sender that restarts is seen as a step back, which the estimator judges.
    """

    period: float
    last: float = math.nan

    def unwrap(self, reading: float) -> float:
        """The reading plus as many periods as have gone by."""
        if math.isnan(self.last):
            self.last = reading
            return reading
        half = self.period / 2.0
        self.last += (reading - self.last + half) % self.period - half
        return self.last


def boot_ms_clock() -> SenderClock:
    """For `time_boot_ms`."""
    return SenderClock(period=2.0**32)


def velocity_over_ground(*, course_cdeg: float, speed_cm_s: float, climb_cm_s: float) -> Vector:
    """North, east, down in m/s, from the course in 1/100 degree clockwise from north, ground speed, and climb up."""
    course_rad = math.radians(course_cdeg / 100.0)
    speed_m_s = speed_cm_s / 100.0
    return speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad), -climb_cm_s / 100.0


def rotate(quaternion_wxyz: Sequence[float], vector: Vector) -> Vector:
    """Rotate a vector by q v q*, for a quaternion of length 1 within 5 %; unknown (NaN) for any other."""
    w, x, y, z = quaternion_wxyz
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not abs(length - 1.0) < 0.05:
        return UNKNOWN_VELOCITY
    w, x, y, z = w / length, x / length, y / length, z / length
    vx, vy, vz = vector
    tx, ty, tz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )
