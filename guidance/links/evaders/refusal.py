"""A report that must not be used, and why. Sources count refusals by reason; nothing is raised to the loop."""

import math
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
