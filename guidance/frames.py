"""Frames and datums: WGS-84, local NED, the game frame and the body frame. All conversions are here.

* WGS-84: degrees, and an altitude whose type is its datum. `Amsl`, `Ellipsoid` and `Relative` never compare equal and
  never convert silently: a wrong datum is an error of tens of metres (geoid) or hundreds (terrain).
* NED: metres north, east and down of the estimator's origin, which may differ from home. Down is a difference of
  altitudes, as autopilots report it and as height limits mean it, and not the tangent plane's z.
* Game: metres, x east, y north, z up, about the game's origin, which lies on the evader's plane.
* Body: forward, right, down, rotated from NED by yaw only.

`Ned` and `Enu` are vectors in NED and game axes: mypy rejects a sum of the two, or one where the other belongs.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple, Self

import pymap3d

from guidance.errors import ConfigError


class _Numbers(NamedTuple):
    """Three numbers. The vectors borrow these accessors, which read any tuple and are faster than a property."""

    first: float
    second: float
    third: float


class _Vector(tuple[float, float, float]):
    """Three numbers along the axes of one frame, the third vertical. A frame is a subclass.

    It is a tuple, so a record keeps it as three numbers, and it equals a plain tuple of the same numbers. The products
    and sums of `dot` are added in the order of the axes.
    """

    __slots__ = ()

    # Indexed, because a subclass of tuple is unpacked slowly.

    def __add__(self, other: Self) -> Self:  # type: ignore[override] # tuples would be joined
        return type(self)((self[0] + other[0], self[1] + other[1], self[2] + other[2]))

    def __sub__(self, other: Self) -> Self:
        return type(self)((self[0] - other[0], self[1] - other[1], self[2] - other[2]))

    def __mul__(self, factor: float) -> Self:  # type: ignore[override] # a tuple would be repeated
        return type(self)((self[0] * factor, self[1] * factor, self[2] * factor))

    __rmul__ = __mul__  # type: ignore[assignment]

    def __truediv__(self, divisor: float) -> Self:
        return type(self)((self[0] / divisor, self[1] / divisor, self[2] / divisor))

    def dot(self, other: Self) -> float:
        """Return the scalar product."""
        return self[0] * other[0] + self[1] * other[1] + self[2] * other[2]

    def level_dot(self, other: Self) -> float:
        """Return the scalar product of the two level parts."""
        return self[0] * other[0] + self[1] * other[1]

    def length(self) -> float:
        """Return the length."""
        return math.hypot(*self)

    def level_length(self) -> float:
        """Return the length of the level part."""
        return math.hypot(self[0], self[1])

    def level(self) -> Self:
        """Return the level part: the same vector without its vertical number."""
        return type(self)((self[0], self[1], 0.0))

    def level_with(self, vertical: float) -> Self:
        """Return the vector with the same level part and another vertical number."""
        return type(self)((self[0], self[1], vertical))


class Ned(_Vector):
    """North, east and down: `Ned((north, east, down))`."""

    __slots__ = ()

    north = _Numbers.first
    east = _Numbers.second
    down = _Numbers.third

    def clamped(self, ground: float, up: float, down: float) -> "Ned":
        """Bound the vector; one within the bounds is returned itself.

        The ground part is scaled, which keeps its direction; the vertical part is cut.

        They are bounded apart, since the game's speed set is a cylinder: a climb costs no ground speed.

        Args:
            ground: Largest size of the ground part, in the vector's unit; positive like the others.
            up: Largest size of the upward part.
            down: Largest size of the downward part.
        """
        north, east, vertical = self
        size = math.hypot(north, east)
        if size <= ground and -up <= vertical <= down:
            return self
        bounded = min(down, max(-up, vertical))
        if size <= ground:
            return Ned((north, east, bounded))
        share = ground / size
        return Ned((north * share, east * share, bounded))


class Enu(_Vector):
    """East, north and up: `Enu((east, north, up))`. These are the game's x, y and z."""

    __slots__ = ()

    east = _Numbers.first
    north = _Numbers.second
    up = _Numbers.third


STILL: Final = Ned((0.0, 0.0, 0.0))
"""No motion, no way and no acceleration."""


@dataclass(frozen=True)
class _AboveDatum:
    """Altitude above the datum of its type, metres."""

    metres: float


class Amsl(_AboveDatum):
    """Altitude above mean sea level, metres."""


class Ellipsoid(_AboveDatum):
    """Altitude above the WGS-84 ellipsoid, metres."""


class Relative(_AboveDatum):
    """Altitude above home, metres."""


Altitude = Amsl | Ellipsoid | Relative
Place = tuple[float, float, Amsl]
"""Latitude and longitude in degrees, and altitude."""


class Projection(NamedTuple):
    """Conversion of latitude and longitude to metres and back. An autopilot's local position needs its own projection.

    Autopilots treat the Earth as a sphere; their metres differ from WGS-84's by up to 0.5 %.

    Attributes:
        to_metres: From a frame, latitude and longitude in degrees to metres north and east of the frame's zero.
        to_degrees: The inverse. The longitude need not be wrapped.
    """

    to_metres: Callable[["LocalFrame", float, float], tuple[float, float]]
    to_degrees: Callable[["LocalFrame", float, float], tuple[float, float]]


def _to_plane(zero: "LocalFrame", latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    """Project; the point is taken at the zero's altitude, so the evader's height does not change the metres."""
    height = zero.altitude.metres
    north, east, _ = pymap3d.geodetic2ned(
        latitude_deg, longitude_deg, height, zero.latitude_deg, zero.longitude_deg, height
    )
    return float(north), float(east)


def _from_plane(zero: "LocalFrame", north_m: float, east_m: float) -> tuple[float, float]:
    """Find the place below a point of the plane. The plane rises above the ellipsoid by s²/2R: a fixed point."""
    height = zero.altitude.metres
    down_m = 0.0
    for _ in range(4):
        latitude, longitude, reached = pymap3d.ned2geodetic(
            north_m, east_m, down_m, zero.latitude_deg, zero.longitude_deg, height
        )
        down_m += float(reached) - height
    return float(latitude), float(longitude)


WGS84: Final = Projection(_to_plane, _from_plane)
"""The plane that touches the WGS-84 ellipsoid at the frame's zero."""


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """A local NED frame about a given origin (GPS_GLOBAL_ORIGIN).

    `home` is needed for `Relative` altitudes, and `undulation_m` (ellipsoid minus mean sea level at this place) for
    `Ellipsoid` ones.

    Raises:
        ConfigError: If the origin is not a place on Earth, or a pole.
    """

    latitude_deg: float
    longitude_deg: float
    altitude: Amsl
    home: Amsl | None = None
    undulation_m: float | None = None
    projection: Projection = WGS84

    def __post_init__(self) -> None:
        if not abs(self.latitude_deg) < 90.0:  # at a pole north has no direction
            raise ConfigError(
                f"latitude_deg = {self.latitude_deg}: allowed is between -90 and 90, both excluded"
            )
        if not abs(self.longitude_deg) <= 180.0:
            raise ConfigError(f"longitude_deg = {self.longitude_deg}: allowed is -180 to 180")
        for name, value in (("altitude", self.altitude), ("home", self.home)):
            if value is not None and not (isinstance(value, Amsl) and math.isfinite(value.metres)):
                raise ConfigError(
                    f"{name} = {value}: allowed is a finite altitude above mean sea level (Amsl)"
                )

    def amsl(self, altitude: Altitude) -> Amsl:
        """Turn any altitude into one above mean sea level.

        Raises:
            ConfigError: If home or undulation is needed, and is not known.
        """
        match altitude:
            case Amsl():
                return altitude
            case Relative(metres):
                if self.home is None:
                    raise ConfigError(
                        f"altitude = {altitude}: home's altitude is not known; wait for HOME_POSITION"
                    )
                return Amsl(self.home.metres + metres)
            case Ellipsoid(metres):
                if self.undulation_m is None:
                    raise ConfigError(
                        f"altitude = {altitude}: undulation_m is not set; give the geoid's height here"
                    )
                return Amsl(metres - self.undulation_m)

    def ned_from_wgs84(self, latitude_deg: float, longitude_deg: float, altitude: Altitude) -> Ned:
        """Position in metres, north-east-down about the origin; NaN in gives NaN out."""
        down_m = self.altitude.metres - self.amsl(altitude).metres
        north_m, east_m = self.projection.to_metres(self, latitude_deg, longitude_deg)
        return Ned((north_m, east_m, down_m))

    def wgs84_from_ned(self, position_ned_m: Ned) -> Place:
        """Latitude and longitude in degrees and the altitude of a position; the inverse of `ned_from_wgs84`."""
        north_m, east_m, down_m = position_ned_m
        latitude, longitude = self.projection.to_degrees(self, north_m, east_m)
        return latitude, wrap_deg(longitude), Amsl(self.altitude.metres - down_m)

    def ned_in(self, other: "LocalFrame", position_ned_m: Ned) -> Ned:
        """Position in another local frame of a place that is given in this one, metres."""
        return other.ned_from_wgs84(*self.wgs84_from_ned(position_ned_m))


@dataclass(frozen=True, slots=True)
class GameFrame:
    """East-north-up about a point of the evader's plane, given in NED metres."""

    origin_ned_m: Ned

    def position_from_ned(self, position_ned_m: Ned) -> Enu:
        """Position (x, y, z) in the game frame, metres."""
        (north, east, down) = position_ned_m
        (north0, east0, down0) = self.origin_ned_m
        return Enu((east - east0, north - north0, down0 - down))

    def motion_from_ned(self, position_ned_m: Ned, velocity_ned_m_s: Ned) -> tuple[Enu, Enu]:
        """Position and velocity in the game frame, metres and m/s."""
        (north, east, down) = position_ned_m
        (north0, east0, down0) = self.origin_ned_m
        position_m = Enu((east - east0, north - north0, down0 - down))
        (north_m_s, east_m_s, down_m_s) = velocity_ned_m_s
        return position_m, Enu((east_m_s, north_m_s, -down_m_s))

    def position_to_ned(self, position_game_m: Enu) -> Ned:
        """Position in NED metres of a point of the game frame."""
        return self.origin_ned_m + ned_from_game(position_game_m)


_MEANINGLESS: Final = 1e8


def usable(*numbers: float) -> bool:
    """True if all numbers are finite and, as one vector, not larger than anything in flight can be."""
    return math.hypot(*numbers) <= _MEANINGLESS


def game_from_ned(vector: Ned) -> Enu:
    """Turn a free vector (velocity, acceleration) into the game's axes."""
    north, east, down = vector
    return Enu((east, north, -down))


def ned_from_game(vector: Enu) -> Ned:
    """Turn a free vector (velocity, acceleration) into NED."""
    east, north, up = vector
    return Ned((north, east, -up))


def wrap_deg(angle_deg: float) -> float:
    """The same angle in [-180, 180]."""
    return math.remainder(angle_deg, 360.0)
