"""Frames and datums: WGS-84, local NED, the game frame and the body frame. All conversions are here.

* WGS-84: degrees, and an altitude whose type is its datum. `Amsl`, `Ellipsoid` and `Relative` never compare equal and
  never convert silently: a wrong datum is an error of tens of metres (geoid) or hundreds (terrain).
* NED: metres north, east and down of the estimator's origin, which may differ from home. Down is a difference of
  altitudes, as autopilots report it and as height limits mean it, and not the tangent plane's z.
* Game: metres, x east, y north, z up, about the game's origin, which lies on the evader's plane.
* Body: forward, right, down, rotated from NED by yaw only.

Sums, differences and bounds of vectors are here too.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import pymap3d

from guidance.errors import ConfigError

Vector = tuple[float, float, float]


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
    """How latitude and longitude become metres. An autopilot's local position needs the autopilot's own projection.

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
            ConfigError: If what the conversion needs (home, undulation) is not known.
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

    def ned_from_wgs84(
        self, latitude_deg: float, longitude_deg: float, altitude: Altitude
    ) -> Vector:
        """Position in metres, north-east-down about the origin; NaN in gives NaN out."""
        down_m = self.altitude.metres - self.amsl(altitude).metres
        north_m, east_m = self.projection.to_metres(self, latitude_deg, longitude_deg)
        return (north_m, east_m, down_m)

    def wgs84_from_ned(self, position_ned_m: Vector) -> Place:
        """Latitude and longitude in degrees and the altitude of a position; the inverse of `ned_from_wgs84`."""
        north_m, east_m, down_m = position_ned_m
        latitude, longitude = self.projection.to_degrees(self, north_m, east_m)
        return latitude, wrap_deg(longitude), Amsl(self.altitude.metres - down_m)

    def ned_in(self, other: "LocalFrame", position_ned_m: Vector) -> Vector:
        """Position in another local frame of a place that is given in this one, metres."""
        return other.ned_from_wgs84(*self.wgs84_from_ned(position_ned_m))


@dataclass(frozen=True, slots=True)
class GameFrame:
    """East-north-up about a point of the evader's plane, given in NED metres."""

    origin_ned_m: Vector

    def position_from_ned(self, position_ned_m: Vector) -> Vector:
        """Position (x, y, z) in the game frame, metres."""
        (north, east, down) = position_ned_m
        (north0, east0, down0) = self.origin_ned_m
        return (east - east0, north - north0, down0 - down)

    def motion_from_ned(
        self, position_ned_m: Vector, velocity_ned_m_s: Vector
    ) -> tuple[Vector, Vector]:
        """Position and velocity in the game frame, metres and m/s."""
        (north, east, down) = position_ned_m
        (north0, east0, down0) = self.origin_ned_m
        (v_north, v_east, v_down) = velocity_ned_m_s
        return (east - east0, north - north0, down0 - down), (v_east, v_north, -v_down)

    def position_to_ned(self, position_game_m: Vector) -> Vector:
        """Position in NED metres of a point of the game frame."""
        return total(self.origin_ned_m, ned_from_game(position_game_m))


def difference(one: Vector, other: Vector) -> Vector:
    """Return `one` - `other`, in whichever axes both are."""
    (x, y, z) = one
    (other_x, other_y, other_z) = other
    return (x - other_x, y - other_y, z - other_z)


def total(one: Vector, other: Vector) -> Vector:
    """Return `one` + `other`, in whichever axes both are."""
    (x, y, z) = one
    (other_x, other_y, other_z) = other
    return (x + other_x, y + other_y, z + other_z)


_MEANINGLESS: Final = 1e8


def usable(*numbers: float) -> bool:
    """Whether all numbers are finite and, as one vector, not larger than anything in flight can be."""
    return math.hypot(*numbers) <= _MEANINGLESS


def clamp(vector_ned: Vector, ground: float, up: float, down: float) -> Vector:
    """Bound a vector. The ground part is scaled, which keeps its direction; the vertical part is cut.

    They are bounded apart, since the game's speed set is a cylinder: a climb costs no ground speed.

    Args:
        vector_ned: A velocity (m/s), an acceleration (m/s²), or a change of one.
        ground: Largest size of its ground part, in the same unit; positive like the others.
        up: Largest size of its upward part.
        down: Largest size of its downward part.
    """
    north, east, vertical = vector_ned
    size = math.hypot(north, east)
    vertical = min(down, max(-up, vertical))
    if size <= ground:
        return (north, east, vertical)
    share = ground / size
    return (north * share, east * share, vertical)


def game_from_ned(vector_ned: Vector) -> Vector:
    """Turn a free vector (velocity, acceleration) from NED into the game frame; its own inverse."""
    north, east, down = vector_ned
    return (east, north, -down)


ned_from_game = game_from_ned
"""Turns a free vector from the game frame into NED."""


def wrap_deg(angle_deg: float) -> float:
    """The same angle in [-180, 180]."""
    return math.remainder(angle_deg, 360.0)
