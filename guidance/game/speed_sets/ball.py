"""The paper's speed set: the same speed in every direction."""
# ruff: noqa: ARG002, ARG003 - every speed set takes the arguments of `SpeedSet`

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from guidance.game.arrays import NUMPY, Array, Library, Plane, Real, Space, Truth, dot2
from guidance.game.meeting_times import catch_in_ball, climb
from guidance.game.records import exchanged, is_zero
from guidance.game.speed_sets.speed_set import Planar, Short, SpeedSet, bounded


@dataclass(frozen=True, slots=True, eq=False)
class Ball(SpeedSet):
    """The paper's speed set, eq. (2): the pursuer flies in any direction at up to `speed_m_s`.

    Raises:
        ConfigError: the speed is not a positive, finite number.
    """

    name: ClassVar[str] = "ball"
    isotropic: ClassVar[bool] = True

    speed_m_s: Real

    @property
    def horizontal_m_s(self) -> Real:
        """The largest horizontal speed, m/s."""
        return self.speed_m_s

    @property
    def climb_m_s(self) -> Real:
        """The largest climb rate, m/s."""
        return self.speed_m_s

    @property
    def descent_m_s(self) -> Real:
        """The largest descent rate, m/s."""
        return self.speed_m_s

    @classmethod
    def of(cls, horizontal_m_s: Real, climb_m_s: Real, descent_m_s: Real) -> Self:
        """See `SpeedSet`; it has the first speed only."""
        return cls(horizontal_m_s)

    def at(self, horizontal_m_s: Real) -> Self:
        """See `SpeedSet`."""
        return exchanged(self, speed_m_s=horizontal_m_s)

    def words(self) -> str:
        """See `SpeedSet`."""
        return f"{self.speed_m_s:g} m/s ({self.name})"

    def cover_time(
        self, xp: Library, radius: Real, capture: Real, gap: Real, spare: Real, z: Real
    ) -> Real:
        """See `SpeedSet`; the circle is R + √((u t + l)² − z²)."""
        u = self.speed_m_s
        run = u - spare
        hand = spare * (u + run)
        if is_zero(capture) and is_zero(radius):
            cross = u * gap
            return (
                run * gap + xp.sqrt(hand * (z * z) + cross * cross)
            ) / hand  # V, eq. (19), of both speeds
        above = (abs(z) - capture) / u
        half = run * gap - u * capture
        cross = u * gap - run * capture
        delta = xp.sqrt(hand * (z * z) + cross * cross)
        beyond = gap * gap + z * z - capture * capture
        # The positive root of hand·t² − 2 half·t − beyond = 0, by the form that does not cancel.
        receding = half >= 0
        t = xp.select(
            receding, (half + delta) / hand, beyond / xp.select(receding, 1.0, delta - half)
        )
        return xp.maximum(xp.select(gap + run * above > 0, t, above), 0.0)

    def catch_time(
        self, xp: Library, radius: Real, capture: Real, y: Plane, m: Plane, z: Real
    ) -> Real:
        """See `SpeedSet`."""
        u = self.speed_m_s
        if is_zero(radius):
            return catch_in_ball(xp, u, capture, y, m, z)

        def cover(n: Plane) -> Real:
            return self.cover_time(xp, radius, capture, dot2(n, y) - radius, u - dot2(n, m), z)

        return climb(xp, y, m, cover)[0]

    def captured(self, xp: Library, capture: Real, z: Real, beside: Callable[[], Real]) -> Truth:
        """See `SpeedSet`."""
        level = abs(z) <= capture
        if level is False or (xp is NUMPY and not level.any()):
            return False
        return xp.norm2((xp.maximum(beside(), 0.0), z)) <= capture

    def shortfall(self, xp: Library, capture: Real, beside: Real, z: Real, t: Real) -> Short:
        """See `SpeedSet`."""
        return Short(beside, z, self.speed_m_s * t + capture)

    def aim(self, xp: Library, radius: Real, y: Plane, z: Real) -> Space:
        """See `SpeedSet`."""
        square = dot2(y, y)
        share = 1.0
        if not is_zero(radius):
            length = xp.norm2(y)
            reach = xp.maximum(length - radius, 0.0)
            square = reach * reach
            share = reach / xp.select(length > 0, length, 1.0)
        distance = xp.sqrt(square + z * z)
        rate = self.speed_m_s / xp.select(distance > 0, distance, 1.0)
        level = rate if is_zero(radius) else rate * share
        return level * y[0], level * y[1], -z * rate

    def underway(
        self, xp: Library, capture: Real, gap: Real, t: Real, z: Real
    ) -> tuple[Truth, Truth]:
        """See `SpeedSet`; both parts end with the capture."""
        flies = (t <= 0) == 0
        return flies, flies

    def vertical(self, xp: Library, level: Plane, z: Real) -> Real:
        """See `SpeedSet`; zero at the height of the disc."""
        spare = xp.sqrt(self.speed_m_s * self.speed_m_s - dot2(level, level))
        return xp.select(z > 0, -spare, xp.select(z < 0, spare, 0.0))

    def ground_pace(self, xp: Library, course: Space, wind: Plane) -> Real:
        """See `SpeedSet`."""
        headwind = dot2(course[:2], wind)
        square = self.speed_m_s * self.speed_m_s - dot2(wind, wind) + headwind * headwind
        return headwind + xp.sqrt(square)

    def pace(self, velocity: Space) -> float:
        """See `SpeedSet`."""
        return math.hypot(*velocity)

    def planar(self, xp: Library, radius: Real, capture: Real, z: Real) -> Planar:
        """See `SpeedSet`; it is the game itself."""
        return Planar(radius, capture, z)

    def guaranteed_age_s(self, radius: Real, capture: Real, evader_speed_m_s: Real) -> Real:
        """See `SpeedSet`."""
        return radius / evader_speed_m_s + capture / self.speed_m_s

    def soonest(
        self, xp: Library, capture: Real, beside: Real, z: Real, closing: Real
    ) -> tuple[Real, Real]:
        """See `SpeedSet`."""
        apart = xp.norm2((xp.maximum(beside, 0.0), z)) - capture
        return xp.maximum(apart, 0.0) / closing, math.inf

    def distances(
        self, xp: Library, capture: Real, beside: Plane, height: Plane
    ) -> tuple[Plane, ...]:
        """See `SpeedSet`; one distance."""
        outside, rate = beside
        z, climbing = height
        reach = xp.maximum(outside, 0.0)
        far = xp.norm2((reach, z))
        return ((far - capture, (reach * rate + z * climbing) / far),)

    def top_speed_m_s(self, xp: Library, level_m_s: Real) -> Real:
        """See `SpeedSet`; the whole speed may be horizontal."""
        return level_m_s

    def support(self, direction: Array) -> Array:
        """See `SpeedSet`."""
        return np.asarray(self.speed_m_s * np.linalg.norm(direction, axis=-1))

    def flyable(self, velocity_m_s: Array) -> Array:
        """See `SpeedSet`."""
        return bounded(velocity_m_s, self.speed_m_s)

    def duration_s(self, level_m: Array, rise_m: Array) -> Array:
        """See `SpeedSet`."""
        return np.asarray(np.hypot(level_m, rise_m) / np.asarray(self.speed_m_s))
