"""The port of a speed set: every answer of a game that depends on the pursuer's speed in each direction.

A speed set has the same level speed in every direction. With its disc, the stand-off disc of radius R and the capture
radius l about it, it decides when an evader is captured, and how distances to a capture are measured. A set is one of
two kinds:

* The height is part of the way (`Ball`): level and vertical velocity share one bound. The pursuer flies straight to
  where it captures the evader, and both parts end at the same time.
* The height is apart (`Cylinder`, `separate`): each has a bound of its own, and the pursuer holds the part that it has
  reached. Its region is that of its level game, with the disc around the evader that this reaches before the pursuer
  is at its height.

All kernels take components of the leading shape and an array library, as everywhere in `guidance.game`; R, l and the
set's own speeds may be arrays, too. Heights z are above the stand-off disc.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from guidance.errors import ConfigError
from guidance.game.arrays import Array, Library, Plane, Real, Space, Truth
from guidance.game.records import Numbers


class Planar(NamedTuple):
    """The game of a ball with the same level speed that has the same region, of a separate set the same level region.

    Attributes:
        radius: of its stand-off disc, m.
        capture: its capture radius, m.
        z: height of the ball above the disc, m.
    """

    radius: Real
    capture: Real
    z: Real


class Short(NamedTuple):
    """Distance of a pursuer from a capture, m: ‖(level, vertical)‖ − reach.

    `level` may be negative, where the pursuer is inside.
    """

    level: Real
    vertical: Real
    reach: Real


@dataclass(frozen=True, slots=True, eq=False)
class SpeedSet(Numbers, ABC):
    """The velocities through the air that a pursuer can have; derive a frozen dataclass of its speeds, and `register`.

    A subclass that has a field in place of a property gives it a value: `horizontal_m_s: Real = field()`.

    Attributes:
        name: its name in files.
        separate: whether level and vertical speed have bounds of their own.
        isotropic: whether it has the same speed in every direction, so that the evader may move in space.
    """

    name: ClassVar[str]
    separate: ClassVar[bool] = False
    isotropic: ClassVar[bool] = False

    @property
    @abstractmethod
    def horizontal_m_s(self) -> Real:
        """The largest horizontal speed u; δ compares it with the evader's."""

    @property
    @abstractmethod
    def climb_m_s(self) -> Real:
        """The largest climb rate."""

    @property
    @abstractmethod
    def descent_m_s(self) -> Real:
        """The largest descent rate."""

    @classmethod
    @abstractmethod
    def of(cls, horizontal_m_s: Real, climb_m_s: Real, descent_m_s: Real) -> Self:
        """Return the set with the speeds of a scenario, a vehicle file or a mate; one that has fewer ignores some."""

    @abstractmethod
    def at(self, horizontal_m_s: Real) -> Self:
        """Return the set with another horizontal speed, without checking it.

        A vehicle that is slower than configured plays with it. If the height is part of the way, the set shrinks as a
        whole.
        """

    def words(self) -> str:
        """Describe it for people."""
        vertical = f"{self.climb_m_s:g} up, {self.descent_m_s:g} down"
        return f"{self.horizontal_m_s:g} m/s level, {vertical} ({self.name})"

    # Time to reach

    @abstractmethod
    def cover_time(
        self, xp: Library, radius: Real, capture: Real, gap: Real, spare: Real, z: Real
    ) -> Real:
        """Return the time, s, until the capture circle spans `gap + (u − spare) t`; zero if it does now.

        Args:
            xp: array library.
            radius: of the stand-off disc, m.
            capture: capture radius, m.
            gap: horizontal distance to the disc now, m; negative inside.
            spare: u less the growth rate of that distance, m/s.
            z: height of the pursuer, m.
        """

    @abstractmethod
    def catch_time(
        self, xp: Library, radius: Real, capture: Real, y: Plane, m: Plane, z: Real
    ) -> Real:
        """Return the time, s, until an evader is captured that keeps its velocity.

        Args:
            xp: array library.
            radius: of the stand-off disc, m.
            capture: capture radius, m.
            y: horizontal vector from the pursuer to the evader, m.
            m: the evader's velocity less the wind, m/s.
            z: height of the pursuer, m.
        """

    def level_time(self, xp: Library, capture: Real, z: Real) -> Real:
        """Return the time, s, until a separate set is at the height of the disc; not positive if it is.

        Zero where the height is part of the way.
        """
        del xp, capture, z
        return 0.0

    @abstractmethod
    def captured(self, xp: Library, capture: Real, z: Real, beside: Callable[[], Real]) -> Truth:
        """Return whether an evader is captured now.

        Args:
            xp: array library.
            capture: capture radius, m.
            z: height of the pursuer, m.
            beside: returns the horizontal distance to the disc, m; called only if the height allows a capture.
        """

    @abstractmethod
    def shortfall(self, xp: Library, capture: Real, beside: Real, z: Real, t: Real) -> Short:
        """Return how far the pursuer is from a capture after flying for `t` seconds.

        Args:
            xp: array library.
            capture: capture radius, m.
            beside: horizontal distance to the disc now, m.
            z: height of the pursuer now, m.
            t: time of the flight, s.
        """

    # Steering

    @abstractmethod
    def aim(self, xp: Library, radius: Real, y: Plane, z: Real) -> Space:
        """Return the velocity through the air, m/s, to the disc of this radius around the horizontal vector y, m."""

    @abstractmethod
    def underway(
        self, xp: Library, capture: Real, gap: Real, t: Real, z: Real
    ) -> tuple[Truth, Truth]:
        """Return whether the pursuer still flies there, horizontally and vertically; else it holds that part.

        Args:
            xp: array library.
            capture: capture radius, m.
            gap: horizontal distance to the disc, m; used by separate sets only.
            t: time to the capture, s.
            z: height of the pursuer, m.
        """

    @abstractmethod
    def vertical(self, xp: Library, level: Plane, z: Real) -> Real:
        """Return the vertical velocity towards the disc, m/s, that is left beside a horizontal one."""

    def ground_pace(self, xp: Library, course: Space, wind: Plane) -> Real:
        """Return the largest speed over the ground along a course of length 1, m/s.

        Raises:
            ConfigError: the set does not have it.
        """
        del xp, course, wind
        raise ConfigError(
            f"pursuer = {self!r}: the speed set {self.name!r} has no speed along a course, which proportional "
            "navigation needs; choose another policy"
        )

    @abstractmethod
    def pace(self, velocity: Space) -> float:
        """Return the horizontal speed, m/s, of the smallest set of this kind that has a velocity.

        A separate set counts the horizontal velocity alone.
        """

    # Bounds

    def planar(self, xp: Library, radius: Real, capture: Real, z: Real) -> Planar:
        """Return the ball's game that has the same region, for games with a target and of teams.

        Raises:
            ConfigError: no ball's game has.
        """
        del xp, radius, capture, z
        raise ConfigError(
            f"pursuer = {self!r}: the speed set {self.name!r} has no closed form of the evader's region, which games "
            'with a target and of teams need; play PE (game = "pe"), or use the speed set "ball" or "cylinder"'
        )

    @abstractmethod
    def guaranteed_age_s(self, radius: Real, capture: Real, evader_speed_m_s: Real) -> Real:
        """Return `guidance.game.guaranteed_age_s` of an evader in the plane."""

    @abstractmethod
    def soonest(
        self, xp: Library, capture: Real, beside: Real, z: Real, closing: Real
    ) -> tuple[Real, Real]:
        """Return the least times, s, until a capture, and until a separate set reaches its height and holds it.

        Args:
            xp: array library.
            capture: capture radius, m.
            beside: horizontal distance to the disc, m.
            z: height of the pursuer, m.
            closing: the largest closing rate of the horizontal distance, m/s.
        """

    @abstractmethod
    def distances(
        self, xp: Library, capture: Real, beside: Plane, height: Plane
    ) -> tuple[Plane, ...]:
        """Return the distances, m, that all are zero or less at a capture, each with its rate of change, m/s.

        Args:
            xp: array library.
            capture: capture radius, m.
            beside: horizontal distance to the disc, m, and its rate, m/s.
            height: height of the pursuer, m, and its rate, m/s.
        """

    def top_speed_m_s(self, xp: Library, level_m_s: Real) -> Real:
        """Return a bound of the speed over the ground whose horizontal part is at most `level_m_s`."""
        vertical_m_s = xp.maximum(self.climb_m_s, self.descent_m_s)
        return xp.sqrt(level_m_s**2 + vertical_m_s**2)

    @abstractmethod
    def support(self, direction: Array) -> Array:
        """Return the largest product of a direction (..., 3) and a velocity of the set."""

    @abstractmethod
    def flyable(self, velocity_m_s: Array) -> Array:
        """Return velocities (..., 3), each shortened so that it is in the set."""

    @abstractmethod
    def duration_s(self, level_m: Array, rise_m: Array) -> Array:
        """Return the least time to fly straight for a horizontal and a vertical distance, up positive."""


def bounded(velocity_m_s: Array, speed_m_s: ArrayLike) -> Array:
    """Return velocities (..., 3), shortened to a speed (...) where they are longer, in the same direction."""
    limit = np.asarray(speed_m_s, dtype=np.float64)
    squares = velocity_m_s * velocity_m_s
    # Not np.sum: over an axis of three it takes longer than all the rest
    speed = np.sqrt(squares[..., 0] + squares[..., 1] + squares[..., 2])
    scale = np.where(speed > limit, limit / np.where(speed > 0.0, speed, 1.0), 1.0)
    return np.asarray(velocity_m_s * scale[..., None])
