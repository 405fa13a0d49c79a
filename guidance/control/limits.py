"""The limits of a flight: the `[limits]` section of a file, and the envelope that it makes with the vehicle's dynamics.

Heights are above home, distances are from home. Speeds bound every command; the game plays with speeds of its own.
"""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Final, NamedTuple, Self

from pydantic import Field

from guidance.config import Latitude, Longitude, Section, faults_of
from guidance.control.polygon import Polygon, corners_about_home
from guidance.errors import ConfigError
from guidance.frames import STILL, Amsl, LocalFrame, Ned
from guidance.game import StandOff

CATCH_UP_RATIO: Final = 1.1
"""Default of the speed limits over the game's speeds. The excess lets the vehicle recover a late start."""

FARTHEST_FENCE_M: Final = 20_000.0
_STANDOFF_MARGIN_M: Final = 1.0
"""The stand-off limit lies this far inside the game's disc, so it binds only when something is wrong."""

_FLOOR_MARGIN_M: Final = 1.0
"""Largest margin above the floor. It is smaller where the game's disc is nearer to the floor."""

_DEFAULT = f"; default: {CATCH_UP_RATIO - 1.0:.0%} above the game's speed"
_SMALLEST = 1e-3
_LARGEST = 1e6


class Limiter(StrEnum):
    """Names of the limits that changed a command, in the order of `guidance.control.setpoint_limiter`."""

    SITUATION = "situation"
    COMMAND = "command"
    CLOCK = "clock"
    SPEED = "speed"
    VERTICAL_SPEED = "vertical speed"
    ACCELERATION = "acceleration"
    VERTICAL_ACCELERATION = "vertical acceleration"
    STAND_OFF = "stand-off"
    SEPARATION = "separation"
    FENCE_POLYGON = "fence polygon"
    FENCE_RADIUS = "fence radius"
    FLOOR = "floor"
    CEILING = "ceiling"
    FEED_FORWARD = "feed-forward"
    YAW = "yaw"


class Speeds(NamedTuple):
    """Horizontal speed, climb rate and descent rate, m/s."""

    speed_m_s: float
    climb_m_s: float
    descent_m_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Agility:
    """Largest horizontal acceleration, vertical acceleration, and change of the acceleration, of a command."""

    acceleration_m_s2: float
    vertical_acceleration_m_s2: float
    jerk_m_s3: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Dynamics(Agility):
    """Acceleration, braking and delay of a vehicle.

    Attributes:
        braking_m_s2: Guaranteed horizontal deceleration.
        vertical_braking_m_s2: Guaranteed vertical deceleration.
        reaction_s: Time until it brakes: velocity lag, telemetry age and one cycle. The stopping distance is
            v·reaction + v²/(2·braking).
        easing_m_s3: Jerk while an acceleration is released.
    """

    braking_m_s2: float = 2.0
    vertical_braking_m_s2: float = 1.0
    reaction_s: float = 0.6
    easing_m_s3: float = 30.0


@dataclass(frozen=True, slots=True)
class Acceleration:
    """Guaranteed acceleration of a vehicle, m/s²: over the ground, and vertically.

    Attributes:
        descent_share: Share of the commanded descent rate that it keeps during a chase.
    """

    ground_m_s2: float
    vertical_m_s2: float
    descent_share: float = 0.92


def farthest_evader_m(
    reach_m: float, *, evader_speed_m_s: float, speed_m_s: float, standoff_radius_m: float
) -> float:
    """Return the distance from home beyond which no evader can be met inside the fence as the game begins.

    From anywhere in the fence the vehicle is at any point of it within 2 reach / speed. An evader that flies straight
    at the fence comes nearer by evader speed * 2 reach / speed meanwhile. If it is still farther from the fence than
    the radius of the disc then, the vehicle waits at its fence whatever the evader does.

    Args:
        reach_m: Greatest distance from home inside the fence.
        evader_speed_m_s: The evader's declared speed.
        speed_m_s: The vehicle's horizontal speed in the game.
        standoff_radius_m: Of the game's disc.
    """
    return reach_m + standoff_radius_m + 2.0 * reach_m * evader_speed_m_s / speed_m_s


@dataclass(frozen=True, slots=True, kw_only=True)
class Envelope(Dynamics):
    """Bounds of every setpoint. Heights are above home, fences about home, in metres.

    Commands stop above the floor by the estimator's standard deviation of the height, at most by `floor_margin_m`.
    The vehicle never enters the upright cylinder about the evader from the ground to the height of `stand_off`. It is
    slightly smaller than the game's disc; a limit that binds on every arrival costs capture time.

    Raises:
        ConfigError: If a value is not finite, is out of range or contradicts another one.
    """

    floor_m: float
    ceiling_m: float
    speed_m_s: float
    climb_m_s: float
    descent_m_s: float
    yaw_rate_rad_s: float
    home_ned_m: Ned = STILL
    fence_radius_m: float | None = None
    fence_polygon: Polygon | None = None
    fence_margin_m: float = 0.0
    floor_margin_m: float = 0.0
    stand_off: StandOff | None = None

    def __post_init__(self) -> None:
        for name in (
            *(entry.name for entry in fields(Dynamics)),
            *Speeds._fields,
            "yaw_rate_rad_s",
            "fence_radius_m",
        ):
            value = getattr(self, name)
            if value is not None and not _SMALLEST <= value <= _LARGEST:
                raise ConfigError(f"{name} = {value}: allowed is {_SMALLEST} to {_LARGEST}")
        if not -_LARGEST <= self.floor_m < self.ceiling_m <= _LARGEST:
            raise ConfigError(
                f"floor_m = {self.floor_m}: must be below ceiling_m = {self.ceiling_m}, both finite"
            )
        if not 0.0 <= self.fence_margin_m < (self.fence_radius_m or math.inf):
            raise ConfigError(
                f"fence_margin_m = {self.fence_margin_m}: allowed is 0 to less than fence_radius_m"
            )

    @property
    def reach_m(self) -> float:
        """Greatest distance from home inside the fence; infinite without one."""
        reach_m = math.inf if self.fence_radius_m is None else self.fence_radius_m
        if self.fence_polygon is not None:
            reach_m = min(
                reach_m, max(math.hypot(*corner) for corner in self.fence_polygon.corners_ne_m)
            )
        return reach_m


AtLeast = Annotated[float, max]
AtMost = Annotated[float, min]
AtMostIfAny = Annotated[float | None, min]
"""Limits, with the function that returns the tightest of several values."""


class Limits(Section):
    """Limits of the flight."""

    floor_m: AtLeast = Field(5.0, ge=1.0, description="lowest height")
    ceiling_m: AtMost = Field(60.0, gt=5.0, le=500.0, description="greatest height")
    fence_radius_m: AtMostIfAny = Field(
        200.0, gt=10.0, le=10_000.0, description="greatest distance from home"
    )
    fence_polygon_ne_m: tuple[tuple[float, float], ...] | None = Field(
        None, description="corners north, east of home"
    )
    fence_polygon_deg: tuple[tuple[Latitude, Longitude], ...] | None = Field(
        None, description="corners by latitude, longitude"
    )
    fence_plan_file: Path | None = Field(
        None,
        description="a QGroundControl plan (.plan) with one inclusion polygon, which becomes the fence",
    )
    fence_margin_m: AtLeast = Field(
        2.0, ge=0.0, description="how far inside the fence commands stay"
    )
    yaw_rate_deg_s: AtMost = Field(45.0, gt=0.0, le=180.0, description="fastest turn of the nose")
    speed_m_s: AtMostIfAny = Field(
        None, gt=0.0, le=33.0, description=f"horizontal speed of every command{_DEFAULT}"
    )
    climb_m_s: AtMostIfAny = Field(
        None, gt=0.0, le=11.0, description=f"climb rate of every command{_DEFAULT}"
    )
    descent_m_s: AtMostIfAny = Field(
        None, gt=0.0, le=11.0, description=f"descent rate of every command{_DEFAULT}"
    )

    def _faults(self) -> Iterator[str]:
        if self.floor_m >= self.ceiling_m:
            yield f"limits.floor_m = {self.floor_m:g}: must be below limits.ceiling_m = {self.ceiling_m:g}"
        keys = ("fence_polygon_ne_m", "fence_polygon_deg", "fence_plan_file")
        polygons = {f"limits.{key}": getattr(self, key) for key in keys}
        present = [key for key, value in polygons.items() if value is not None]
        if len(present) > 1:
            yield f"{' and '.join(present)}: only one polygon is allowed; remove the others"
        if self.fence_radius_m is None and not present:
            others = ", ".join(polygons)
            yield f"limits.fence_radius_m: missing; give it or one of {others}: every flight needs a fence"
        if self.fence_polygon_deg is not None:
            yield from _corner_faults(self.fence_polygon_deg)

    @property
    def reach_m(self) -> float:
        """Greatest distance from home inside the fence; infinite for corners in degrees, until home is known."""
        reach_m = math.inf
        if self.fence_polygon_ne_m:
            reach_m = max(math.hypot(*corner) for corner in self.fence_polygon_ne_m)
        if self.fence_radius_m is not None:
            reach_m = min(reach_m, self.fence_radius_m)
        return reach_m

    def speeds(self, game: Speeds, *, section: str) -> Speeds:
        """Return the speed limits of a flight that plays the game with these speeds.

        Args:
            game: The game's speeds.
            section: The section of the file that gives them, for the message.

        Raises:
            ValueError: If a limit is below the game's speed. The message names both keys.
        """
        limits = []
        for name, played_m_s in game._asdict().items():
            limit_m_s: float | None = getattr(self, name)
            if limit_m_s is not None and limit_m_s < played_m_s:
                game_speed = f"{section}.{name} = {played_m_s:g}, the game's own speed"
                remedy = f"raise limits.{name} or lower {section}.{name}"
                raise ValueError(
                    f"limits.{name} = {limit_m_s:g}: must be at least {game_speed}; {remedy}"
                )
            limits.append(CATCH_UP_RATIO * played_m_s if limit_m_s is None else limit_m_s)
        return Speeds(*limits)

    def tighter(self, other: "Limits") -> Self:
        """Return these limits, each replaced by the other's value where that one is tighter. Polygons stay."""
        changed = {}
        for name, declared in type(self).model_fields.items():
            values = [
                value for value in (getattr(self, name), getattr(other, name)) if value is not None
            ]
            for tightest in declared.metadata:
                if tightest in (min, max) and values:
                    changed[name] = tightest(values)
        return self.model_copy(update=changed)

    def envelope(self, speeds: Speeds, dynamics: Dynamics, standoff: StandOff) -> Envelope:
        """Return the envelope of a vehicle, about a home that is not known yet.

        Args:
            speeds: The speed limits, see `speeds`.
            dynamics: Of the vehicle.
            standoff: The game's disc, its height above the evader's plane.

        Raises:
            ConfigError: If the limits contradict each other.
        """
        zone_m = (
            max(0.5, float(size) - _STANDOFF_MARGIN_M)
            for size in (standoff.radius_m, standoff.height_m)
        )
        return Envelope(
            **asdict(dynamics),
            **speeds._asdict(),
            **{
                name: getattr(self, name)
                for name in ("floor_m", "ceiling_m", "fence_radius_m", "fence_margin_m")
            },
            yaw_rate_rad_s=math.radians(self.yaw_rate_deg_s),
            floor_margin_m=min(_FLOOR_MARGIN_M, max(0.0, float(standoff.height_m) - self.floor_m)),
            fence_polygon=None
            if self.fence_polygon_ne_m is None
            else Polygon(self.fence_polygon_ne_m),
            stand_off=StandOff(*zone_m),
        )

    def about_home(self, envelope: Envelope, home_ned_m: Ned, frame: LocalFrame) -> Envelope:
        """Return an envelope with the polygon fence in metres, if it is given in degrees."""
        if self.fence_polygon_deg is None:
            return envelope
        return replace(
            envelope,
            fence_polygon=Polygon(
                corners_about_home(self.fence_polygon_deg, home_ned_m, frame), unchecked=True
            ),
        )


def _corner_faults(corners_deg: tuple[tuple[float, float], ...]) -> Iterator[str]:
    """Check the polygon in metres about its first corner; about home it has the same shape."""
    if not corners_deg:
        yield "limits.fence_polygon_deg has 0 corners: needs at least 3"
        return
    corners_m = corners_about_home(corners_deg, STILL, LocalFrame(*corners_deg[0], Amsl(0.0)))
    yield from faults_of(
        "limits.fence_polygon_deg, in metres about its first corner", lambda: Polygon(corners_m)
    )
    widest_m = max(math.hypot(*corner) for corner in corners_m)
    if widest_m > FARTHEST_FENCE_M:
        reach = f"limits.fence_polygon_deg reaches {widest_m:.0f} m from its first corner"
        yield f"{reach}: at most {FARTHEST_FENCE_M:g} m are allowed; are latitude and longitude exchanged?"
