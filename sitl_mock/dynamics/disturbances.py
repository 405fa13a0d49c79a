"""Disturbances: the estimator's slowly varying error, as measured on PX4 against its simulator's truth, and wind.

The velocity error is first-order coloured noise. The position error is its integral, corrected by GPS and barometer:
position error' = velocity error - correction x position error. So one is not the derivative of the other. A vehicle
that holds an estimated vz = 0 drifts in height, both true and reported (measured: -20 to -13.5 m in 75 s), and the
reported height departs from the integral of the reported vz (measured: 0.1 to 0.25 m/s over 8 s).

Gusts are first-order coloured noise from a seeded source.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from random import Random
from typing import Final, NamedTuple

from sitl_mock.vector import ZERO, Vector


class Errors(NamedTuple):
    """Estimator errors of position and velocity; fields of `Surroundings`."""

    position_ned_m: Vector = ZERO
    velocity_ned_m_s: Vector = ZERO


@dataclass(frozen=True)
class Wander:
    """Size and time scale of the error.

    Attributes:
        velocity_sd_ned_m_s: Standard deviation of the velocity error.
        position_sd_ned_m: Standard deviation of the position error.
        time_s: Correlation time of the velocity error.
    """

    velocity_sd_ned_m_s: Vector
    position_sd_ned_m: Vector
    time_s: float = 8.0

    @cached_property
    def correction_1_s(self) -> Vector:
        """Correction rate of the position error per axis, from the two standard deviations.

        Stationary: var(p) = var(v) T / (k (1 + k T)), solved for k.
        """
        north, east, down = (
            (math.sqrt(1.0 + 4.0 * (velocity_sd / position_sd * self.time_s) ** 2) - 1.0)
            / (2.0 * self.time_s)
            for velocity_sd, position_sd in zip(
                self.velocity_sd_ned_m_s, self.position_sd_ned_m, strict=True
            )
        )
        return Vector((north, east, down))

    def after(self, errors: Errors, random: Random, dt_s: float) -> Errors:
        """Advance the errors by `dt_s`; equal seeds and steps give equal errors."""
        keep = math.exp(-dt_s / self.time_s)
        spread = math.sqrt(1.0 - keep * keep)
        corrections = self.correction_1_s
        position = [0.0, 0.0, 0.0]
        velocity = [0.0, 0.0, 0.0]
        for axis in range(3):
            v = errors.velocity_ned_m_s[axis] * keep
            v += self.velocity_sd_ned_m_s[axis] * spread * random.gauss(0.0, 1.0)
            drawn = math.exp(-corrections[axis] * dt_s)
            settled = v / corrections[axis]
            velocity[axis] = v
            position[axis] = settled + (errors.position_ned_m[axis] - settled) * drawn
        return Errors(
            Vector((position[0], position[1], position[2])),
            Vector((velocity[0], velocity[1], velocity[2])),
        )


PX4_WANDER = Wander(Vector((0.17, 0.30, 0.16)), Vector((0.13, 0.21, 0.31)))
"""PX4 1.17 against its simulator's truth."""
PX4_GROUND_WANDER = Wander(Vector((0.03, 0.04, 0.008)), Vector((0.15, 0.15, 0.05)), time_s=2.0)
"""Before take-off: velocities of a few cm/s and position drift of about 0.3 m."""


GUST_TIME_S: Final = 3.0
"""Correlation time of gusts."""


def gust_after(
    gust_ned_m_s: Vector, sd_m_s: float, random: Random, dt_s: float, *, time_s: float = GUST_TIME_S
) -> Vector:
    """Advance the gust by `dt_s` (exact for any step); equal seeds and steps give equal gusts.

    Args:
        gust_ned_m_s: Present gust.
        sd_m_s: Standard deviation along north and east; a third of it is vertical.
        random: Seeded source.
        dt_s: Length of the step.
        time_s: Correlation time.
    """
    keep = math.exp(-dt_s / time_s)
    kick = sd_m_s * math.sqrt(1.0 - keep * keep)
    n, e, d = gust_ned_m_s
    gauss = random.gauss
    return Vector(
        (
            n * keep + kick * gauss(0.0, 1.0),
            e * keep + kick * gauss(0.0, 1.0),
            d * keep + kick / 3.0 * gauss(0.0, 1.0),
        )
    )
