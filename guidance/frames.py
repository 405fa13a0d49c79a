"""The only place where axes turn and altitudes change their datum: WGS-84 ◂▸ local NED ◂▸ game frame, body ◂▸ NED.

* wgs84: degrees, and an altitude whose datum is its type. `Amsl`, `Ellipsoid` and `Relative` are never equal and
  never convert silently: a number taken for another datum flies into the ground (tens of metres of geoid undulation,
  hundreds of terrain).
* ned: metres, north-east-down about the estimator's origin, which need not be home. Down is the difference of
  altitudes, not the tangent plane's z: that is what autopilots report, and what a height limit means.
* game: metres, x east, y north, z up, about a game origin whose height is the evader's plane.
* body: forward-right-down, turned from NED by the yaw alone.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import pymap3d

from guidance.errors import ConfigError

Vector = tuple[float, float, float]

_PX4_RADIUS_M = 6371000.0  # CONSTANTS_RADIUS_OF_EARTH
_ARDUPILOT_RADIUS_M = 0.011131884502145034e7 * 180.0 / math.pi  # LOCATION_SCALING_FACTOR, metres per 1e-7 degree


@dataclass(frozen=True, slots=True)
class Amsl:
    """Altitude above mean sea level, metres."""

    metres: float


@dataclass(frozen=True, slots=True)
class Ellipsoid:
    """Altitude above the WGS-84 ellipsoid, metres."""

    metres: float


@dataclass(frozen=True, slots=True)
class Relative:
    """Altitude above home, metres."""

    metres: float


Altitude = Amsl | Ellipsoid | Relative


class MapProjection(StrEnum):
    """How latitude and longitude become metres. An autopilot's own map must be used beside its local position.

    The autopilots take the Earth for a sphere, so that their metres differ from WGS-84's by up to 0.5 %.
    """

    WGS84 = "wgs84"
    PX4 = "px4"
    ARDUPILOT = "ardupilot"


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """North-east-down about a declared origin (GPS_GLOBAL_ORIGIN), altitudes with their datum.

    `home` is needed for `Relative` altitudes, and `undulation_m` (ellipsoid minus mean sea level at this place) for
    `Ellipsoid` ones.

    Raises:
        ConfigError: If the origin is no place on Earth.
    """

    latitude_deg: float
    longitude_deg: float
    altitude: Amsl
    home: Amsl | None = None
    undulation_m: float | None = None
    projection: MapProjection = MapProjection.WGS84

    def __post_init__(self) -> None:
        if not abs(self.latitude_deg) < 90.0:  # at a pole north has no direction
            raise ConfigError(f"latitude_deg = {self.latitude_deg}: allowed is between -90 and 90, both excluded")
        if not abs(self.longitude_deg) <= 180.0:
            raise ConfigError(f"longitude_deg = {self.longitude_deg}: allowed is -180 to 180")
        for name, value in (("altitude", self.altitude), ("home", self.home)):
            if value is not None and not (isinstance(value, Amsl) and math.isfinite(value.metres)):
                raise ConfigError(f"{name} = {value}: allowed is a finite altitude above mean sea level (Amsl)")

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
                    raise ConfigError(f"altitude = {altitude}: home's altitude is not known; wait for HOME_POSITION")
                return Amsl(self.home.metres + metres)
            case Ellipsoid(metres):
                if self.undulation_m is None:
                    raise ConfigError(f"altitude = {altitude}: undulation_m is not set; give the geoid's height here")
                return Amsl(metres - self.undulation_m)

    def ned_from_wgs84(self, latitude_deg: float, longitude_deg: float, altitude: Altitude) -> Vector:
        """Position in metres, north-east-down about the origin; NaN in gives NaN out."""
        down_m = self.altitude.metres - self.amsl(altitude).metres
        match self.projection:
            case MapProjection.WGS84:
                north_m, east_m = self._tangent_plane(latitude_deg, longitude_deg)
            case MapProjection.PX4:
                north_m, east_m = self._azimuthal(latitude_deg, longitude_deg)
            case MapProjection.ARDUPILOT:
                north_m, east_m = self._equirectangular(latitude_deg, longitude_deg)
        return (north_m, east_m, down_m)

    def wgs84_from_ned(self, position_ned_m: Vector) -> tuple[float, float, Amsl]:
        """Latitude and longitude in degrees and the altitude of a position; the inverse of `ned_from_wgs84`."""
        north_m, east_m, down_m = position_ned_m
        match self.projection:
            case MapProjection.WGS84:
                latitude, longitude = self._tangent_plane_inverse(north_m, east_m)
            case MapProjection.PX4:
                latitude, longitude = self._azimuthal_inverse(north_m, east_m)
            case MapProjection.ARDUPILOT:
                latitude, longitude = self._equirectangular_inverse(north_m, east_m)
        return latitude, _wrap_deg(longitude), Amsl(self.altitude.metres - down_m)

    def ned_in(self, other: "LocalFrame", position_ned_m: Vector) -> Vector:
        """Position in another local frame of a place that is given in this one, metres."""
        return other.ned_from_wgs84(*self.wgs84_from_ned(position_ned_m))

    def _tangent_plane(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        # Both ends at the origin's altitude: horizontal metres, free of the evader's height.
        height = self.altitude.metres
        north, east, _ = pymap3d.geodetic2ned(
            latitude_deg, longitude_deg, height, self.latitude_deg, self.longitude_deg, height
        )
        return float(north), float(east)

    def _tangent_plane_inverse(self, north_m: float, east_m: float) -> tuple[float, float]:
        height = self.altitude.metres
        # The point of the tangent plane that lies above the wanted one: it sags by s²/2R, found by fixed point.
        down_m = 0.0
        for _ in range(4):
            latitude, longitude, reached = pymap3d.ned2geodetic(
                north_m, east_m, down_m, self.latitude_deg, self.longitude_deg, height
            )
            down_m += float(reached) - height
        return float(latitude), float(longitude)

    def _azimuthal(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Azimuthal equidistant on the sphere, as PX4 (Snyder, Map Projections, eqs. 22-4, 22-5, 25-2)."""
        lat0, lat = math.radians(self.latitude_deg), math.radians(latitude_deg)
        east = math.radians(longitude_deg - self.longitude_deg)
        cosine = math.sin(lat0) * math.sin(lat) + math.cos(lat0) * math.cos(lat) * math.cos(east)
        arc = math.acos(min(1.0, max(-1.0, cosine)))
        scale_m = _PX4_RADIUS_M * (arc / math.sin(arc) if arc > 1e-9 else 1.0)
        north = math.cos(lat0) * math.sin(lat) - math.sin(lat0) * math.cos(lat) * math.cos(east)
        return scale_m * north, scale_m * math.cos(lat) * math.sin(east)

    def _azimuthal_inverse(self, north_m: float, east_m: float) -> tuple[float, float]:
        lat0, distance_m = math.radians(self.latitude_deg), math.hypot(north_m, east_m)
        if distance_m == 0.0:
            return self.latitude_deg, self.longitude_deg
        arc = distance_m / _PX4_RADIUS_M
        sine, cosine = math.sin(arc), math.cos(arc)
        lat = math.asin(cosine * math.sin(lat0) + north_m * sine * math.cos(lat0) / distance_m)
        turn = math.atan2(east_m * sine, distance_m * math.cos(lat0) * cosine - north_m * math.sin(lat0) * sine)
        return math.degrees(lat), self.longitude_deg + math.degrees(turn)

    def _equirectangular(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Equal steps of latitude and longitude, scaled at the latitude midway, as ArduPilot's `get_distance_NE`."""
        north = math.radians(latitude_deg - self.latitude_deg)
        east = math.radians(_wrap_deg(longitude_deg - self.longitude_deg))
        midway = math.cos(math.radians(0.5 * (latitude_deg + self.latitude_deg)))
        return _ARDUPILOT_RADIUS_M * north, _ARDUPILOT_RADIUS_M * east * midway

    def _equirectangular_inverse(self, north_m: float, east_m: float) -> tuple[float, float]:
        latitude = self.latitude_deg + math.degrees(north_m / _ARDUPILOT_RADIUS_M)
        midway = math.cos(math.radians(0.5 * (latitude + self.latitude_deg)))
        return latitude, self.longitude_deg + math.degrees(east_m / (_ARDUPILOT_RADIUS_M * midway))


@dataclass(frozen=True, slots=True)
class GameFrame:
    """East-north-up about a point of the evader's plane, given in NED metres."""

    origin_ned_m: Vector

    def position_from_ned(self, position_ned_m: Vector) -> Vector:
        """Position (x, y, z) in the game frame, metres."""
        (north, east, down), (north0, east0, down0) = position_ned_m, self.origin_ned_m
        return (east - east0, north - north0, down0 - down)

    def position_to_ned(self, position_game_m: Vector) -> Vector:
        """Position in NED metres of a point of the game frame."""
        (x, y, z), (north0, east0, down0) = position_game_m, self.origin_ned_m
        return (north0 + y, east0 + x, down0 - z)


def difference(one: Vector, other: Vector) -> Vector:
    """Return `one` - `other`, in whichever axes both are."""
    (x, y, z), (other_x, other_y, other_z) = one, other
    return (x - other_x, y - other_y, z - other_z)


def game_from_ned(vector_ned: Vector) -> Vector:
    """Turn a free vector (velocity, acceleration) from NED into the game frame; its own inverse."""
    north, east, down = vector_ned
    return (east, north, -down)


def ned_from_game(vector_game: Vector) -> Vector:
    """Turn a free vector from the game frame into NED."""
    x, y, z = vector_game
    return (y, x, -z)


def wrap_rad(angle_rad: float) -> float:
    """The same angle in [-π, π]."""
    return math.remainder(angle_rad, math.tau)


def _wrap_deg(angle_deg: float) -> float:
    return math.remainder(angle_deg, 360.0)
