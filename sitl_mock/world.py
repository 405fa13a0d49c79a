"""Local north-east-down frames on WGS-84.

LOCAL_POSITION_NED is relative to the origin of the vehicle's estimator, by default its position at boot.
`GPS_GLOBAL_ORIGIN` and `HOME_POSITION` announce origin and home.
"""

import math
from typing import NamedTuple

from sitl_mock.vector import Vector

_SEMI_MAJOR_M = 6378137.0
_FLATTENING = 1.0 / 298.257223563
_ECCENTRICITY_2 = _FLATTENING * (2.0 - _FLATTENING)


class Home(NamedTuple):
    """A point on Earth: latitude and longitude (WGS-84, degrees), height above mean sea level (metres)."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


_home = tuple.__new__
"""Makes a point without checks, three times as fast as calling its type."""

DEFAULT_HOME = Home(47.397742, 8.545594, 488.0)
"""The field in Zurich where PX4's simulations start."""


class LocalFrame:
    """North, east, down in metres around an origin, with WGS-84's radii of curvature there.

    As in autopilots, height is the difference of altitudes, not the distance to the tangent plane. Within 1 km of the
    origin, horizontal positions agree with the tangent plane to 0.1 m.
    """

    __slots__ = ("_east_m_per_deg", "_north_m_per_deg", "origin")

    def __init__(self, origin: Home) -> None:
        self.origin = origin
        sine = math.sin(math.radians(origin.lat_deg))
        root = math.sqrt(1.0 - _ECCENTRICITY_2 * sine * sine)
        meridian_m = _SEMI_MAJOR_M * (1.0 - _ECCENTRICITY_2) / root**3
        normal_m = _SEMI_MAJOR_M / root
        degree = math.radians(1.0)
        self._north_m_per_deg = (meridian_m + origin.alt_amsl_m) * degree
        self._east_m_per_deg = (
            (normal_m + origin.alt_amsl_m) * math.cos(math.radians(origin.lat_deg)) * degree
        )

    def to_geodetic(self, north_m: float, east_m: float, down_m: float) -> Home:
        """Turn local metres into latitude, longitude (degrees) and height above mean sea level (metres)."""
        lat_deg, lon_deg, alt_amsl_m = self.origin
        lon_deg += east_m / self._east_m_per_deg
        if not -180.0 <= lon_deg < 180.0:
            lon_deg = wrap_deg(lon_deg)
        position = (lat_deg + north_m / self._north_m_per_deg, lon_deg, alt_amsl_m - down_m)
        return _home(Home, position)

    def to_local(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Vector:
        """Turn latitude, longitude (degrees) and height above mean sea level (metres) into local metres.

        A place beyond the date line is as near as it is on Earth.
        """
        origin = self.origin
        east_deg = lon_deg - origin.lon_deg
        if not -180.0 <= east_deg < 180.0:
            east_deg = wrap_deg(east_deg)
        return Vector(
            (
                (lat_deg - origin.lat_deg) * self._north_m_per_deg,
                east_deg * self._east_m_per_deg,
                origin.alt_amsl_m - alt_amsl_m,
            )
        )


def wrap_deg(angle_deg: float) -> float:
    """Bring an angle into [-180, 180); NaN and infinity stay NaN."""
    if not math.isfinite(angle_deg):
        return math.nan
    return (angle_deg + 180.0) % 360.0 - 180.0


def wrap_pi(angle_rad: float) -> float:
    """Bring an angle into [-π, π)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi
