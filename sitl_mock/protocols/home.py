"""Home and the origin of the local frame: HOME_POSITION, GPS_GLOBAL_ORIGIN, and the messages that set them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from sitl_mock.mavlink import Message
    from sitl_mock.protocols.reply import Reply

HIGHEST_M: Final = 100_000.0
NO_ROTATION: Final = (1.0, 0.0, 0.0, 0.0)


class Place(NamedTuple):
    """A place on WGS-84.

    Attributes:
        latitude_deg: Degrees, north positive.
        longitude_deg: Degrees, east positive.
        altitude_m: Metres above mean sea level.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


SetPlace = Callable[[float, Place], bool]


def home_position(home: Place, ned_m: tuple[float, float, float], now_s: float) -> Reply:
    """Return HOME_POSITION; ``ned_m`` is home in the local frame."""
    unknown = (math.nan,) * 3
    return ("HOME_POSITION", *_integers(home), *ned_m, NO_ROTATION, *unknown, int(now_s * 1e6))


def gps_global_origin(origin: Place, now_s: float) -> Reply:
    """Return GPS_GLOBAL_ORIGIN."""
    return ("GPS_GLOBAL_ORIGIN", *_integers(origin), int(now_s * 1e6))


class HomeProtocol:
    """SET_GPS_GLOBAL_ORIGIN and SET_HOME_POSITION.

    Args:
        set_origin: ``set_origin(now_s, place)`` returns whether the vehicle takes it.
        set_home: Likewise for home; MAV_CMD_DO_SET_HOME comes as a command.
    """

    def __init__(self, set_origin: SetPlace, set_home: SetPlace) -> None:
        self._set_origin = set_origin
        self._set_home = set_home

    def handle(self, now_s: float, message: Message) -> list[Reply]:
        """Take either message; an origin that is taken is confirmed with GPS_GLOBAL_ORIGIN."""
        kind = message.get_type()
        if kind not in {"SET_GPS_GLOBAL_ORIGIN", "SET_HOME_POSITION"}:
            return []
        place = Place(message.latitude * 1e-7, message.longitude * 1e-7, message.altitude * 1e-3)
        if not on_earth(place):
            return []
        if kind == "SET_HOME_POSITION":
            self._set_home(now_s, place)
            return []
        return [gps_global_origin(place, now_s)] if self._set_origin(now_s, place) else []


def on_earth(place: Place) -> bool:
    """Whether a place is one where a vehicle can be; false for anything that is not finite."""
    latitude_deg, longitude_deg, altitude_m = place
    return abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0 and abs(altitude_m) <= HIGHEST_M


def _integers(place: Place) -> tuple[int, int, int]:
    return (round(place.latitude_deg * 1e7), round(place.longitude_deg * 1e7), round(place.altitude_m * 1e3))
