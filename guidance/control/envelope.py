"""What a vehicle may do: heights, fence, stand-off, speeds, accelerations and turn rate, checked when it is built.

Here are also the situation in which that is asked, the limits by name, as records, metrics and the certificate of a
cycle show them, and the speed limits as files give them: keys of their own, the same for vehicles and scenarios.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from enum import StrEnum
from itertools import combinations, pairwise
from typing import NamedTuple

from pydantic import Field

from guidance.config import Section
from guidance.errors import ConfigError
from guidance.frames import Vector


class Limiter(StrEnum):
    """What changed a command, in the order of the page (`guidance.control.setpoint_limiter`)."""

    SITUATION = "situation"
    COMMAND = "command"
    CLOCK = "clock"
    SPEED = "speed"
    VERTICAL_SPEED = "vertical speed"
    ACCELERATION = "acceleration"
    VERTICAL_ACCELERATION = "vertical acceleration"
    STAND_OFF = "stand-off"
    FENCE_POLYGON = "fence polygon"
    FENCE_RADIUS = "fence radius"
    FLOOR = "floor"
    CEILING = "ceiling"
    FEED_FORWARD = "feed-forward"
    YAW = "yaw"


_SMALLEST, _LARGEST = 1e-3, 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class StandOffLimit:
    """The space about the evader that is never entered: an upright cylinder from the ground to a height above it.

    Give it a little less than the disc that the game is played to (radius and height), so that it binds only when
    something is wrong: a limit that binds on every arrival costs capture time.
    """

    radius_m: float
    height_m: float

    def __post_init__(self) -> None:
        _require_in_range("stand_off.", self, ("radius_m", "height_m"))


Point = tuple[float, float]

_SHORTEST_EDGE_M = 0.01


@dataclass(frozen=True, slots=True)
class Polygon:
    """A simple polygon on the ground, convex or not.

    Its corners (north, east) are in metres about home, in either sense, the last one joined to the first.

    Raises:
        ConfigError: With fewer than three corners, one that is not finite, an edge of no length, or edges that cross.
    """

    corners_ne_m: tuple[Point, ...]

    def __post_init__(self) -> None:
        corners = self.corners_ne_m
        if len(corners) < 3:
            raise ConfigError(f"fence_polygon has {len(corners)} corners: at least 3 are wanted")
        for corner in corners:
            if not all(math.isfinite(value) for value in corner):
                raise ConfigError(f"fence_polygon corner {corner}: two finite numbers are wanted")
        for index, edge in enumerate(self.edges()):
            if math.dist(*edge) < _SHORTEST_EDGE_M:
                raise ConfigError(
                    f"fence_polygon edge {index} {edge} is shorter than {_SHORTEST_EDGE_M} m: leave it out"
                )
        for (i, one), (j, other) in combinations(enumerate(self.edges()), 2):
            neighbours = j - i in (1, len(corners) - 1)
            if _overlap(one, other) if neighbours else _meet(one, other):
                raise ConfigError(f"fence_polygon: edges {i} and {j} cross or touch; give the corners in order")

    def edges(self) -> tuple[tuple[Point, Point], ...]:
        """The edges as pairs of corners."""
        return tuple(pairwise((*self.corners_ne_m, self.corners_ne_m[0])))

    def contains(self, point: Point) -> bool:
        """Whether a point is inside, by counting the edges that a ray towards the east crosses."""
        north, east = point
        inside = False
        for (north1, east1), (north2, east2) in self.edges():
            if (north1 > north) != (north2 > north):
                crossing_east = east1 + (north - north1) / (north2 - north1) * (east2 - east1)
                inside ^= east < crossing_east
        return inside

    def outward(self, index: int) -> Point:
        """Unit normal (north, east) of an edge, away from the inside."""
        (north1, east1), (north2, east2) = self.edges()[index]
        doubled_area = sum(n1 * e2 - n2 * e1 for (n1, e1), (n2, e2) in self.edges())
        scale = math.copysign(math.hypot(north2 - north1, east2 - east1), doubled_area)
        return ((east2 - east1) / scale, (north1 - north2) / scale)

    def nearest_points(self, point: Point) -> tuple[Point, ...]:
        """The point of every edge that is nearest to the given one."""
        return tuple(_nearest(point, edge) for edge in self.edges())


def _nearest(point: Point, edge: tuple[Point, Point]) -> Point:
    (north1, east1), (north2, east2) = edge
    along_north, along_east = north2 - north1, east2 - east1
    share = ((point[0] - north1) * along_north + (point[1] - east1) * along_east) / (along_north**2 + along_east**2)
    share = min(1.0, max(0.0, share))
    return (north1 + share * along_north, east1 + share * along_east)


def _turn(a: Point, b: Point, c: Point) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _on(edge: tuple[Point, Point], point: Point) -> bool:
    a, b = edge
    within = min(a[0], b[0]) <= point[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= point[1] <= max(a[1], b[1])
    return within and _turn(a, b, point) == 0.0


def _meet(one: tuple[Point, Point], other: tuple[Point, Point]) -> bool:
    (a, b), (c, d) = one, other
    if (_turn(a, b, c) > 0.0) != (_turn(a, b, d) > 0.0) and (_turn(c, d, a) > 0.0) != (_turn(c, d, b) > 0.0):
        return True
    return _on(one, c) or _on(one, d) or _on(other, a) or _on(other, b)


def _overlap(one: tuple[Point, Point], other: tuple[Point, Point]) -> bool:
    """Whether two edges with a common corner fold back on one another."""
    shared = one[1] if one[1] in other else one[0]
    a = one[0] if shared == one[1] else one[1]
    b = other[0] if shared == other[1] else other[1]
    folded = (a[0] - shared[0]) * (b[0] - shared[0]) + (a[1] - shared[1]) * (b[1] - shared[1]) > 0.0
    return folded and _turn(shared, a, b) == 0.0


class Bounds(NamedTuple):
    """The largest size of a vector over the ground, and its largest parts upwards and downwards; all positive."""

    ground: float
    up: float
    down: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Envelope:
    """The envelope, heights above home and fences about home in metres.

    `easing_m_s3` is the jerk by which it lets go of an acceleration.
    `braking_m_s2` and `vertical_braking_m_s2` are what the vehicle surely achieves once it brakes, and `reaction_s`
    the time until it does (measured velocity lag, telemetry age and one cycle): together they make the stopping
    distance v·reaction + v²/(2·braking). `speeds` and `accelerations` are the limits of both once more, as bounds of a
    vector.

    Raises:
        ConfigError: If a value is not finite, out of its range or contradicts another one.
    """

    floor_m: float
    ceiling_m: float
    speed_m_s: float
    climb_m_s: float
    descent_m_s: float
    acceleration_m_s2: float
    vertical_acceleration_m_s2: float
    jerk_m_s3: float
    yaw_rate_rad_s: float
    braking_m_s2: float = 2.0
    vertical_braking_m_s2: float = 1.0
    reaction_s: float = 0.6
    easing_m_s3: float = 30.0
    home_ned_m: Vector = (0.0, 0.0, 0.0)
    fence_radius_m: float | None = None
    fence_polygon: Polygon | None = None
    fence_margin_m: float = 0.0
    stand_off: StandOffLimit | None = None
    speeds: Bounds = field(init=False, repr=False)
    accelerations: Bounds = field(init=False, repr=False)

    def __post_init__(self) -> None:
        vertical_m_s2 = self.vertical_acceleration_m_s2
        object.__setattr__(self, "speeds", Bounds(self.speed_m_s, self.climb_m_s, self.descent_m_s))
        object.__setattr__(self, "accelerations", Bounds(self.acceleration_m_s2, vertical_m_s2, vertical_m_s2))
        optional = {"fence_radius_m"} if self.fence_radius_m is None else set()
        free = {"floor_m", "ceiling_m", "fence_margin_m", "home_ned_m", "fence_polygon", "stand_off"}
        _require_in_range("", self, (f.name for f in fields(self) if f.init and f.name not in free | optional))
        if not -_LARGEST <= self.floor_m < self.ceiling_m <= _LARGEST:
            raise ConfigError(
                f"floor_m = {self.floor_m}: allowed is less than ceiling_m = {self.ceiling_m}, both finite"
            )
        if not all(abs(value) <= _LARGEST for value in self.home_ned_m):
            raise ConfigError(f"home_ned_m = {self.home_ned_m}: three finite numbers are wanted")
        if not 0.0 <= self.fence_margin_m < (self.fence_radius_m or math.inf):
            raise ConfigError(f"fence_margin_m = {self.fence_margin_m}: allowed is 0 to less than fence_radius_m")


def _require_in_range(prefix: str, holder: object, names: Iterable[str]) -> None:
    for name in names:
        value = getattr(holder, name)
        if not _SMALLEST <= value <= _LARGEST:
            raise ConfigError(f"{prefix}{name} = {value}: allowed is {_SMALLEST} to {_LARGEST}")


class Situation(NamedTuple):
    """Own position (metres), velocity (m/s), yaw (radians) and acceleration, and the evader's place where known. NED.

    None for an evader that is not known: then there is no stand-off to keep. An unknown velocity of a known evader is
    None too (or NaN), and is taken for rest, which is the strict side here.
    """

    position_ned_m: Vector
    velocity_ned_m_s: Vector
    yaw_rad: float = 0.0
    evader_position_ned_m: Vector | None = None
    evader_velocity_ned_m_s: Vector | None = None
    acceleration_ned_m_s2: Vector = (0.0, 0.0, 0.0)


ABOVE_THE_GAME = 1.1
"""Speed limits that no file gives are this much of the game's speeds; what lies between is for catching up."""

_DEFAULT = f"; {ABOVE_THE_GAME - 1.0:.0%} above the game's if not given"


class Speeds(NamedTuple):
    """What a vehicle flies over ground, upwards and downwards, m/s."""

    speed_m_s: float
    climb_m_s: float
    descent_m_s: float


class SpeedLimits(Section):
    """Part of a file's `[limits]`: what no command ever exceeds. The game plays with speeds of its own."""

    speed_m_s: float | None = Field(None, gt=0.0, le=33.0, description=f"over ground, of every command{_DEFAULT}")
    climb_m_s: float | None = Field(None, gt=0.0, le=11.0, description=f"of every command{_DEFAULT}")
    descent_m_s: float | None = Field(None, gt=0.0, le=11.0, description=f"of every command{_DEFAULT}")

    def speeds(self, game: Speeds, *, section: str) -> Speeds:
        """Return the limits of a flight that plays with these speeds.

        Args:
            game: The game's speeds.
            section: Of the file in which those stand.

        Raises:
            ValueError: If a limit is below the game's speed; the message names both keys.
        """
        return Speeds(*(self._limit(name, played, section) for name, played in game._asdict().items()))

    def _limit(self, name: str, played_m_s: float, section: str) -> float:
        limit_m_s: float | None = getattr(self, name)
        if limit_m_s is None:
            return ABOVE_THE_GAME * played_m_s
        if limit_m_s < played_m_s:
            raise ValueError(
                f"limits.{name} = {limit_m_s:g}: must be at least {section}.{name} = {played_m_s:g}, with which the "
                "game is played; raise the one or play with less"
            )
        return limit_m_s
