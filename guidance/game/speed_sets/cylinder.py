"""A multicopter's speed set: level and vertical speed apart."""
# ruff: noqa: ARG002 - every speed set takes the arguments of `SpeedSet`

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np

from guidance.game.arrays import NUMPY, Array, Library, Plane, Real, Space, Truth
from guidance.game.meeting_times import TOUCH_M, catch_in_ball
from guidance.game.records import exchanged
from guidance.game.speed_sets.speed_set import Planar, Short, SpeedSet, bounded


@dataclass(frozen=True, slots=True, eq=False)
class Cylinder(SpeedSet):
    """A multicopter's speed set: horizontal and vertical speed bounded each by itself, climb and descent apart.

    PX4 calls the bounds MPC_XY_VEL_MAX (12 m/s), MPC_Z_VEL_MAX_UP (3 m/s) and MPC_Z_VEL_MAX_DN (1.5 m/s). The capture
    radius of a game on this set is measured in the same way: horizontal and vertical distance each by itself.

    Raises:
        ConfigError: a speed is not a positive, finite number.
    """

    name: ClassVar[str] = "cylinder"
    separate: ClassVar[bool] = True

    horizontal_m_s: Real = field()
    climb_m_s: Real = field()
    descent_m_s: Real = field()

    @classmethod
    def of(cls, horizontal_m_s: Real, climb_m_s: Real, descent_m_s: Real) -> Self:
        """See `SpeedSet`."""
        return cls(horizontal_m_s, climb_m_s, descent_m_s)

    def at(self, horizontal_m_s: Real) -> Self:
        """See `SpeedSet`; the vertical speeds stay."""
        return exchanged(self, horizontal_m_s=horizontal_m_s)

    def cover_time(
        self, xp: Library, radius: Real, capture: Real, gap: Real, spare: Real, z: Real
    ) -> Real:
        """See `SpeedSet`; the circle is R + l + u t once the height is within l."""
        level = (gap - capture) / spare
        return xp.maximum(xp.maximum(level, self.level_time(xp, capture, z)), 0.0)

    def catch_time(
        self, xp: Library, radius: Real, capture: Real, y: Plane, m: Plane, z: Real
    ) -> Real:
        """See `SpeedSet`."""
        level = catch_in_ball(xp, self.horizontal_m_s, radius + capture, y, m, 0.0)
        return xp.maximum(level, self.level_time(xp, capture, z))

    def level_time(self, xp: Library, capture: Real, z: Real) -> Real:
        """See `SpeedSet`."""
        return xp.maximum((z - capture) / self.descent_m_s, (-z - capture) / self.climb_m_s)

    def captured(self, xp: Library, capture: Real, z: Real, beside: Callable[[], Real]) -> Truth:
        """See `SpeedSet`."""
        level = abs(z) <= capture
        if level is False or (xp is NUMPY and not level.any()):
            return False
        return (beside() <= capture) & level

    def shortfall(self, xp: Library, capture: Real, beside: Real, z: Real, t: Real) -> Short:
        """See `SpeedSet`; each part by itself."""
        level = beside - capture - self.horizontal_m_s * t
        vertical = abs(z) - capture - self._rate(xp, z) * t
        return Short(level, xp.maximum(vertical, 0.0), 0.0)

    def aim(self, xp: Library, radius: Real, y: Plane, z: Real) -> Space:
        """See `SpeedSet`."""
        ahead = xp.unit2(y, xp.sqrt(y[0] * y[0] + y[1] * y[1]))
        pace = self.horizontal_m_s
        vertical = xp.select(z > 0, -self.descent_m_s, self.climb_m_s)
        return pace * ahead[0], pace * ahead[1], vertical

    def underway(
        self, xp: Library, capture: Real, gap: Real, t: Real, z: Real
    ) -> tuple[Truth, Truth]:
        """See `SpeedSet`."""
        return gap - capture > TOUCH_M, abs(z) - capture > TOUCH_M

    def vertical(self, xp: Library, level: Plane, z: Real) -> Real:
        """See `SpeedSet`; the whole vertical speed."""
        return xp.select(z > 0, -self.descent_m_s, self.climb_m_s)

    def pace(self, velocity: Space) -> float:
        """See `SpeedSet`."""
        return math.hypot(velocity[0], velocity[1])

    def planar(self, xp: Library, radius: Real, capture: Real, z: Real) -> Planar:
        """See `SpeedSet`; the disc is captured level, so R is in l."""
        return Planar(0.0, radius + capture, 0.0)

    def guaranteed_age_s(self, radius: Real, capture: Real, evader_speed_m_s: Real) -> Real:
        """See `SpeedSet`."""
        return (radius + capture) / evader_speed_m_s

    def soonest(
        self, xp: Library, capture: Real, beside: Real, z: Real, closing: Real
    ) -> tuple[Real, Real]:
        """See `SpeedSet`.

        The capture counts slightly farther out than the pursuer holds, so that it gets there.
        """
        rate = self._rate(xp, z)
        met = capture + 2.0 * TOUCH_M
        above_s = (abs(z) - met) / rate
        capture_s = xp.maximum(xp.maximum((beside - met) / closing, above_s), 0.0)
        above_m = abs(z) - capture
        turn_s = xp.select(above_m > TOUCH_M, (above_m - 0.5 * TOUCH_M) / rate, math.inf)
        return capture_s, turn_s

    def distances(
        self, xp: Library, capture: Real, beside: Plane, height: Plane
    ) -> tuple[Plane, ...]:
        """See `SpeedSet`; one for each part, slightly outside, as for `soonest`."""
        outside, rate = beside
        z, climbing = height
        met = capture + 2.0 * TOUCH_M
        return (outside - met, rate), (abs(z) - met, xp.sign(z) * climbing)

    def support(self, direction: Array) -> Array:
        """See `SpeedSet`."""
        rise = direction[..., 2]
        vertical = np.where(rise > 0.0, self.climb_m_s * rise, -self.descent_m_s * rise)
        level = np.hypot(direction[..., 0], direction[..., 1])
        return np.asarray(self.horizontal_m_s * level + vertical)

    def flyable(self, velocity_m_s: Array) -> Array:
        """See `SpeedSet`."""
        level = bounded(velocity_m_s * np.array([1.0, 1.0, 0.0]), self.horizontal_m_s)
        climb = np.clip(velocity_m_s[..., 2], -np.asarray(self.descent_m_s), self.climb_m_s)
        return np.concatenate([level[..., :2], climb[..., None]], axis=-1)

    def duration_s(self, level_m: Array, rise_m: Array) -> Array:
        """See `SpeedSet`."""
        up = rise_m / np.asarray(self.climb_m_s)
        down = -rise_m / np.asarray(self.descent_m_s)
        level = level_m / np.asarray(self.horizontal_m_s)
        return np.asarray(np.maximum(level, np.maximum(up, down)))

    def _rate(self, xp: Library, z: Real) -> Real:
        """Return the vertical speed towards the disc: descent from above, climb from below."""
        return xp.select(z > 0, self.descent_m_s, self.climb_m_s)
