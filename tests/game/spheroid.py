"""A speed set from outside the package, in one module: level and vertical speed share one bound.

A velocity with the horizontal part h and the vertical part w is flown if (h/u)² + (w/c)² ≤ 1, c the climb or the
descent rate. In heights times u/c this is a ball, and so is its game; capture radius and shortfall count in these
heights.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from guidance.game.arrays import dot2, dot3
from guidance.game.records import exchanged
from guidance.game.speed_sets import Ball, Planar, SpeedSet


@dataclass(frozen=True, slots=True, eq=False)
class Spheroid(SpeedSet):
    """The set of an aircraft whose power is shared between level flight and climb."""

    name = "spheroid"

    horizontal_m_s: float = field()
    climb_m_s: float = field()
    descent_m_s: float = field()

    @classmethod
    def of(cls, horizontal_m_s, climb_m_s, descent_m_s):
        return cls(horizontal_m_s, climb_m_s, descent_m_s)

    def at(self, horizontal_m_s):
        share = horizontal_m_s / self.horizontal_m_s
        vertical = {"climb_m_s": share * self.climb_m_s, "descent_m_s": share * self.descent_m_s}
        return exchanged(self, horizontal_m_s=horizontal_m_s, **vertical)

    def cover_time(self, xp, radius, capture, gap, spare, z):
        return self._ball().cover_time(xp, radius, capture, gap, spare, self._tall(xp, z))

    def catch_time(self, xp, radius, capture, y, m, z):
        return self._ball().catch_time(xp, radius, capture, y, m, self._tall(xp, z))

    def captured(self, xp, capture, z, beside):
        return self._ball().captured(xp, capture, self._tall(xp, z), beside)

    def shortfall(self, xp, capture, beside, z, t):
        return self._ball().shortfall(xp, capture, beside, self._tall(xp, z), t)

    def aim(self, xp, radius, y, z):
        east, north, up = self._ball().aim(xp, radius, y, self._tall(xp, z))
        return east, north, up / self._stretch(xp, z)

    def underway(self, xp, capture, gap, t, z):
        return self._ball().underway(xp, capture, gap, t, z)

    def vertical(self, xp, level, z):
        return self._ball().vertical(xp, level, z) / self._stretch(xp, z)

    def ground_pace(self, xp, course, wind):
        east, north, up = course
        tall = (east, north, up * self._stretch(xp, -up))
        square = dot3(tall, tall)
        headwind = dot2((east, north), wind)
        room = self.horizontal_m_s * self.horizontal_m_s - dot2(wind, wind)
        return (headwind + xp.sqrt(headwind * headwind + square * room)) / square

    def pace(self, velocity):
        x, y, up = velocity
        return math.hypot(x, y, up * self.horizontal_m_s / self._rate(up))

    def planar(self, xp, radius, capture, z):
        return Planar(radius, capture, self._tall(xp, z))

    def guaranteed_age_s(self, radius, capture, evader_speed_m_s):
        return self._ball().guaranteed_age_s(radius, capture, evader_speed_m_s)

    def soonest(self, xp, capture, beside, z, closing):
        return self._ball().soonest(xp, capture, beside, self._tall(xp, z), closing)

    def distances(self, xp, capture, beside, height):
        z, climbing = height
        stretch = self._stretch(xp, z)
        return self._ball().distances(xp, capture, beside, (stretch * z, stretch * climbing))

    def support(self, direction):
        level = self.horizontal_m_s * np.hypot(direction[..., 0], direction[..., 1])
        return np.hypot(level, self._rate(direction[..., 2]) * direction[..., 2])

    def flyable(self, velocity_m_s):
        level = np.hypot(velocity_m_s[..., 0], velocity_m_s[..., 1])
        share = self.duration_s(level, velocity_m_s[..., 2])
        return velocity_m_s / np.maximum(share, 1.0)[..., None]

    def duration_s(self, level_m, rise_m):
        return np.hypot(level_m / self.horizontal_m_s, rise_m / self._rate(rise_m))

    def _ball(self):
        return Ball(self.horizontal_m_s)

    def _rate(self, up):
        """Return the largest vertical speed in the direction of a vertical distance or velocity."""
        return np.where(np.asarray(up) > 0, self.climb_m_s, self.descent_m_s)

    def _stretch(self, xp, z):
        """Return the ball's height over the true one."""
        return self.horizontal_m_s / xp.select(z > 0, self.descent_m_s, self.climb_m_s)

    def _tall(self, xp, z):
        return z * self._stretch(xp, z)
