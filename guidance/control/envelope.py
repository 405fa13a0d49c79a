"""The envelope: what no setpoint leaves. Heights, fences, stand-off, speeds, accelerations and turn rate.

`guidance.control.limits` makes it from a file's `[limits]` and the vehicle's dynamics.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from enum import StrEnum
from typing import NamedTuple

from guidance.control.polygon import Polygon
from guidance.errors import ConfigError
from guidance.frames import Vector


class Limiter(StrEnum):
    """What changed a command, in the order of `guidance.control.setpoint_limiter`."""

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
    """The space about the evader that the vehicle never enters: an upright cylinder from the ground to `height_m`.

    It should be slightly smaller than the game's disc, so that it binds only when something is wrong. A limit that
    binds on every arrival costs capture time.
    """

    radius_m: float
    height_m: float

    def __post_init__(self) -> None:
        _require_in_range("stand_off.", self, ("radius_m", "height_m"))


class Bounds(NamedTuple):
    """Largest horizontal size of a vector, and its largest upward and downward parts; all positive."""

    ground: float
    up: float
    down: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Dynamics:
    """How fast a vehicle changes its velocity.

    Attributes:
        acceleration_m_s2: Greatest horizontal acceleration of a command.
        vertical_acceleration_m_s2: Greatest vertical acceleration of a command.
        jerk_m_s3: Greatest change of the acceleration.
        braking_m_s2: Horizontal deceleration that the vehicle surely achieves.
        vertical_braking_m_s2: Vertical deceleration that the vehicle surely achieves.
        reaction_s: Time until it brakes: velocity lag, telemetry age and one cycle. The stopping distance is
            v·reaction + v²/(2·braking).
        easing_m_s3: Jerk with which an acceleration is released.
    """

    acceleration_m_s2: float
    vertical_acceleration_m_s2: float
    jerk_m_s3: float
    braking_m_s2: float = 2.0
    vertical_braking_m_s2: float = 1.0
    reaction_s: float = 0.6
    easing_m_s3: float = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Envelope(Dynamics):
    """Limits of every setpoint. Heights are above home, fences about home, in metres.

    `speeds` and `accelerations` repeat the limits as bounds of a vector.

    Raises:
        ConfigError: If a value is not finite, is out of range or contradicts another one.
    """

    floor_m: float
    ceiling_m: float
    speed_m_s: float
    climb_m_s: float
    descent_m_s: float
    yaw_rate_rad_s: float
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
            raise ConfigError(f"floor_m = {self.floor_m}: must be below ceiling_m = {self.ceiling_m}, both finite")
        if not all(abs(value) <= _LARGEST for value in self.home_ned_m):
            raise ConfigError(f"home_ned_m = {self.home_ned_m}: must be three finite numbers")
        if not 0.0 <= self.fence_margin_m < (self.fence_radius_m or math.inf):
            raise ConfigError(f"fence_margin_m = {self.fence_margin_m}: allowed is 0 to less than fence_radius_m")


def _require_in_range(prefix: str, holder: object, names: Iterable[str]) -> None:
    for name in names:
        value = getattr(holder, name)
        if not _SMALLEST <= value <= _LARGEST:
            raise ConfigError(f"{prefix}{name} = {value}: allowed is {_SMALLEST} to {_LARGEST}")


class Situation(NamedTuple):
    """The vehicle's state and the evader's, in NED metres, m/s, m/s² and radians.

    Without an evader position there is no stand-off to keep. An evader whose velocity is None or NaN is treated as
    standing still, which is the stricter case.
    """

    position_ned_m: Vector
    velocity_ned_m_s: Vector
    yaw_rad: float = 0.0
    evader_position_ned_m: Vector | None = None
    evader_velocity_ned_m_s: Vector | None = None
    acceleration_ned_m_s2: Vector = (0.0, 0.0, 0.0)
