"""A fence that is given on the map, put about home: its corners are degrees, the limits work in metres."""

from guidance.control import Polygon
from guidance.frames import LocalFrame, Vector

Corners = tuple[tuple[float, float], ...]
"""Latitude and longitude of each corner, degrees."""


def polygon_about_home(corners_deg: Corners, home_ned_m: Vector, frame: LocalFrame) -> Polygon:
    """Return the polygon in metres about home, by the autopilot's own map between degrees and metres.

    Args:
        corners_deg: As configured.
        home_ned_m: Home in the local frame, which need not have its zero there.
        frame: The vehicle's local frame.

    Raises:
        ConfigError: If the corners make no polygon.
    """
    north_m, east_m, _ = home_ned_m
    places = [frame.ned_from_wgs84(latitude, longitude, frame.altitude) for latitude, longitude in corners_deg]
    return Polygon(tuple((north - north_m, east - east_m) for north, east, _ in places))
