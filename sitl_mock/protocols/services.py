"""Small services: TIMESYNC and PING, home and the origin of the local frame, SETUP_SIGNING.

Sources: https://mavlink.io/en/services/timesync.html, https://mavlink.io/en/services/ping.html,
https://mavlink.io/en/guide/message_signing.html#secret_key. Once a key is required, the decoder drops an
unsigned SETUP_SIGNING.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, NamedTuple

from sitl_mock.protocols.session import Reply, source_of

if TYPE_CHECKING:
    from sitl_mock.mavlink import Message, Signing
    from sitl_mock.protocols.session import Reply

NS: int = 1_000_000_000


class TimeProtocol:
    """Time on one link.

    Args:
        clock: Converts the caller's time to the vehicle's clock (seconds since boot), as used in telemetry.

    Attributes:
        offset_s: Peer's clock minus own, from its last answer; None before.
        round_trip_s: Round trip of that answer.
    """

    def __init__(self, clock: Callable[[float], float] = lambda now_s: now_s) -> None:
        self._clock = clock
        self._asked_ns: int | None = None
        self.offset_s: float | None = None
        self.round_trip_s: float | None = None

    def ask(self, now_s: float) -> Reply:
        """Return the vehicle's own TIMESYNC question."""
        self._asked_ns = int(self._clock(now_s) * NS)
        return ("TIMESYNC", 0, self._asked_ns)

    def handle(self, now_s: float, message: Message) -> list[Reply]:
        """Take TIMESYNC or PING."""
        kind = message.get_type()
        if kind == "TIMESYNC":
            return self._timesync(now_s, message)
        if kind == "PING" and message.target_system == 0 and message.target_component == 0:
            return [("PING", message.time_usec, message.seq, *source_of(message))]
        return []

    def _timesync(self, now_s: float, message: Message) -> list[Reply]:
        if message.tc1 == 0:
            return [("TIMESYNC", int(self._clock(now_s) * NS), message.ts1)]
        if message.ts1 == self._asked_ns:  # the answer to our last question, not to another vehicle's
            self._asked_ns = None
            now_s = self._clock(now_s)
            self.round_trip_s = now_s - message.ts1 / NS
            self.offset_s = message.tc1 / NS - (now_s + message.ts1 / NS) / 2.0
        return []


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
        set_origin: ``set_origin(now_s, place)`` returns whether the vehicle accepts the origin.
        set_home: The same for home; MAV_CMD_DO_SET_HOME is a command.
    """

    def __init__(self, set_origin: SetPlace, set_home: SetPlace) -> None:
        self._set_origin = set_origin
        self._set_home = set_home

    def handle(self, now_s: float, message: Message) -> list[Reply]:
        """Take either message; an accepted origin is confirmed with GPS_GLOBAL_ORIGIN."""
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
    """True if a position is finite and within valid ranges."""
    latitude_deg, longitude_deg, altitude_m = place
    return abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0 and abs(altitude_m) <= HIGHEST_M


def _integers(place: Place) -> tuple[int, int, int]:
    return (round(place.latitude_deg * 1e7), round(place.longitude_deg * 1e7), round(place.altitude_m * 1e3))


class SigningSetup:
    """Key setup on one link.

    Args:
        signing: The vehicle's signing, shared by its links.
        allowed: Whether this link may set the key.
    """

    def __init__(self, signing: Signing, *, allowed: bool = True) -> None:
        self._signing = signing
        self._allowed = allowed

    def handle(self, now_s: float, message: Message) -> list[Reply]:  # noqa: ARG002 - a Piece
        """Take SETUP_SIGNING; it is never answered, so that the key is not repeated."""
        if message.get_type() == "SETUP_SIGNING" and self._allowed and message.target_system != 0:
            key = bytes(message.secret_key)
            self._signing.set_key(key if any(key) else None, message.initial_timestamp)
        return []
