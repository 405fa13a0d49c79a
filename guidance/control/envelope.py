"""What a vehicle may do: heights, fence, stand-off, speeds, accelerations and turn rate, checked when it is built.

Here are also the situation in which that is asked, the limits by name, as records, metrics and the certificate of a
cycle show them, and the speed limits as files give them: keys of their own, the same for vehicles and scenarios.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from enum import StrEnum
from typing import NamedTuple

from pydantic import Field

from guidance.config import Section
from guidance.control.polygon import Polygon
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
