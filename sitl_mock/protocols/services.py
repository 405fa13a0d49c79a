"""Small services: TIMESYNC and PING, home and the origin of the local frame, SETUP_SIGNING.

Sources: https://mavlink.io/en/services/timesync.html, https://mavlink.io/en/services/ping.html,
https://mavlink.io/en/guide/message_signing.html#secret_key. Once a key is required, the decoder drops an
unsigned SETUP_SIGNING.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final, NamedTuple

from sitl_mock.protocols.session import Reply, source_of

if TYPE_CHECKING:
    from sitl_mock.mavlink import Message, Signing

NS: int = 1_000_000_000


class TimeProtocol:
    """Time on one link.

    Args:
        clock: Converts the caller's time to the vehicle's clock (seconds since boot), as used in telemetry.
        answers_ping: PING is answered; ArduPilot ignores it.
    """

    def __init__(
        self, clock: Callable[[float], float] = lambda now_s: now_s, *, answers_ping: bool = True
    ) -> None:
        self._clock = clock
        self._answers_ping = answers_ping

    def handle(self, now_s: float, message: Message) -> list[Reply]:
        """Take TIMESYNC or PING."""
        kind = message.get_type()
        if kind == "PING" and not self._answers_ping:
            return []
        if kind == "TIMESYNC" and message.tc1 == 0:
            return [("TIMESYNC", int(self._clock(now_s) * NS), message.ts1)]
        if kind == "PING" and message.target_system == 0 and message.target_component == 0:
            return [("PING", message.time_usec, message.seq, *source_of(message))]
        return []


HIGHEST_M: Final = 100_000.0


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
        position = Place(message.latitude * 1e-7, message.longitude * 1e-7, message.altitude * 1e-3)
        if not is_on_earth(position):
            return []
        if kind == "SET_HOME_POSITION":
            self._set_home(now_s, position)
            return []
        if not self._set_origin(now_s, position):
            return []
        return [
            (
                "GPS_GLOBAL_ORIGIN",
                message.latitude,
                message.longitude,
                message.altitude,
                int(now_s * 1e6),
            )
        ]


def is_on_earth(place: Place) -> bool:
    """True if a position is finite and within valid ranges."""
    latitude_deg, longitude_deg, altitude_m = place
    return (
        abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0 and abs(altitude_m) <= HIGHEST_M
    )


class SigningSetup:
    """Key setup on one link.

    Args:
        signing: The vehicle's signing, shared by its links.
        allowed: Whether a client may set the key.
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
