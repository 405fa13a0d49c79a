"""What a vehicle may do: heights, fence, stand-off, speeds, accelerations and turn rate, checked when it is built."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields

from guidance.errors import ConfigError
from guidance.frames import Vector
from guidance.limits.polygon import Polygon

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Envelope:
    """The envelope, heights above home and fences about home in metres.

    `braking_m_s2` and `vertical_braking_m_s2` are what the vehicle surely achieves once it brakes, and `reaction_s`
    the time until it does (measured velocity lag, telemetry age and one cycle): together they make the stopping
    distance v·reaction + v²/(2·braking). `height_gain_per_s` is the autopilot's own gain from height error to vertical
    speed (PX4's MPC_Z_P, ArduCopter's PSC_POSZ_P), needed where z is commanded beside the velocity.

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
    height_gain_per_s: float = 1.0
    home_ned_m: Vector = (0.0, 0.0, 0.0)
    fence_radius_m: float | None = None
    fence_polygon: Polygon | None = None
    fence_margin_m: float = 0.0
    stand_off: StandOffLimit | None = None

    def __post_init__(self) -> None:
        optional = {"fence_radius_m"} if self.fence_radius_m is None else set()
        free = {"floor_m", "ceiling_m", "fence_margin_m", "home_ned_m", "fence_polygon", "stand_off"}
        _require_in_range("", self, (f.name for f in fields(self) if f.name not in free | optional))
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
