"""What aircraft broadcast of themselves, as a receiver relays it by MAVLink: ADS-B, and remote identification.

ADSB_VEHICLE: traffic, by its ICAO address.

* Position: WGS-84 degrees. Altitude, millimetres, by `altitude_type`: QNH pressure is taken as above mean sea level,
  geometric as above the WGS-84 ellipsoid, made AMSL with the geoid's height that the frame declares.
* Velocity: course over ground and speeds, up positive, known only as far as the flags say valid.
* Clock: none (`sent_s` is NaN), but `tslc`, whole seconds since the aircraft was heard: old reports are refused.

OPEN_DRONE_ID_LOCATION: remote identification, about once a second (ASTM F3411).

* Position: WGS-84 degrees, 0/0 for unknown. Altitude: `altitude_geodetic`, above the WGS-84 ellipsoid, metres, made
  AMSL with the geoid's height that the frame declares; the barometric altitude (against 1013.25 hPa) is not used.
* Velocity: course over ground and speeds, up positive; sentinels 36100, 25500 and 6300 mean unknown.
* Accuracy: classes that bound 95 % of the errors, so half of the bound is taken for a standard deviation.
* Clock: seconds of the hour UTC, unwrapped at 3600; 0xFFFF for unknown.
"""

import math
from dataclasses import dataclass, field
from typing import ClassVar, Final

from guidance.frames import Amsl, Ellipsoid, LocalFrame, Vector
from guidance.links.decode import Fields, degrees
from guidance.links.evaders.carrier import UNKNOWN_VELOCITY, Refused, SenderClock, finite_altitude, velocity_over_ground
from guidance.messages import AltitudeSaid, Datum, EvaderReport

VALID_COORDINATES: Final = 1
VALID_ALTITUDE: Final = 2
VALID_HEADING: Final = 4
VALID_VELOCITY: Final = 8
VALID_VERTICAL_VELOCITY: Final = 128
ALTITUDE_GEOMETRIC: Final = 1

UNKNOWN_DIRECTION_CDEG: Final = 36100
UNKNOWN_SPEED_CM_S: Final = 25500
UNKNOWN_CLIMB_CM_S: Final = 6300
UNKNOWN_ALTITUDE_M: Final = -1000.0
HORIZONTAL_BOUNDS_M: Final = (
    math.nan,
    18520.0,
    7408.0,
    3704.0,
    1852.0,
    926.0,
    555.6,
    185.2,
    92.6,
    30.0,
    10.0,
    3.0,
    1.0,
)
SPEED_BOUNDS_M_S: Final = (math.nan, 10.0, 3.0, 1.0, 0.3)


@dataclass(frozen=True, slots=True)
class AdsbVehicle:
    """Carrier of ADSB_VEHICLE, one aircraft. `frame` declares the undulation."""

    frame: LocalFrame
    icao_address: int
    oldest_s: int = 2
    message: ClassVar[str] = "ADSB_VEHICLE"

    def __post_init__(self) -> None:
        """Find out now whether ellipsoidal heights can be used.

        Raises:
            ConfigError: If the frame does not declare the geoid's height.
        """
        self.frame.amsl(Ellipsoid(0.0))

    def report(self, fields: Fields, received_s: float) -> EvaderReport:
        """Turn the message into a report."""
        if fields["ICAO_address"] != self.icao_address:
            raise Refused("other_id")
        if fields["tslc"] > self.oldest_s:
            raise Refused("old")
        if not fields["flags"] & VALID_COORDINATES:
            raise Refused("position")
        if not fields["flags"] & VALID_ALTITUDE:
            raise Refused("altitude")
        latitude, longitude = degrees(fields["lat"], fields["lon"])
        given_m = fields["altitude"] / 1e3
        geometric = fields["altitude_type"] == ALTITUDE_GEOMETRIC
        altitude = Ellipsoid(given_m) if geometric else Amsl(given_m)
        return EvaderReport(
            received_s=received_s,
            sent_s=math.nan,
            source=self.message,
            latitude_deg=latitude,
            longitude_deg=longitude,
            altitude_amsl_m=finite_altitude(self.frame.amsl(altitude).metres),
            velocity_ned_m_s=_adsb_velocity(fields),
            position_sd_m=math.nan,
            velocity_sd_m_s=math.nan,
            said=AltitudeSaid(given_m, Datum.ELLIPSOID if geometric else Datum.AMSL),
        )


def _adsb_velocity(fields: Fields) -> Vector:
    needed = VALID_HEADING | VALID_VELOCITY | VALID_VERTICAL_VELOCITY
    if fields["flags"] & needed != needed:
        return UNKNOWN_VELOCITY
    return velocity_over_ground(
        course_cdeg=fields["heading"], speed_cm_s=fields["hor_velocity"], climb_cm_s=fields["ver_velocity"]
    )


def _hour_clock() -> SenderClock:
    return SenderClock(period=3600.0)


@dataclass(slots=True)
class OpenDroneIdLocation:
    """Carrier of OPEN_DRONE_ID_LOCATION. `frame` declares the undulation; `id_or_mac` pins one of those relayed."""

    frame: LocalFrame
    id_or_mac: bytes | None = None
    message: ClassVar[str] = "OPEN_DRONE_ID_LOCATION"
    clock: SenderClock = field(default_factory=_hour_clock)

    def __post_init__(self) -> None:
        """Find out now whether ellipsoidal heights can be used.

        Raises:
            ConfigError: If the frame does not declare the geoid's height.
        """
        self.frame.amsl(Ellipsoid(0.0))

    def report(self, fields: Fields, received_s: float) -> EvaderReport:
        """Turn the message into a report."""
        if self.id_or_mac is not None and bytes(fields["id_or_mac"]) != self.id_or_mac.ljust(20, b"\0"):
            raise Refused("other_id")
        latitude, longitude = degrees(fields["latitude"], fields["longitude"])
        geodetic_m = fields["altitude_geodetic"]
        if not geodetic_m > UNKNOWN_ALTITUDE_M:
            raise Refused("altitude")
        return EvaderReport(
            received_s=received_s,
            sent_s=self._sent(fields["timestamp"]),
            source=self.message,
            latitude_deg=latitude,
            longitude_deg=longitude,
            altitude_amsl_m=finite_altitude(self.frame.amsl(Ellipsoid(geodetic_m)).metres),
            velocity_ned_m_s=_identified_velocity(fields),
            position_sd_m=_half(HORIZONTAL_BOUNDS_M, fields["horizontal_accuracy"]),
            velocity_sd_m_s=_half(SPEED_BOUNDS_M_S, fields["speed_accuracy"]),
            said=AltitudeSaid(geodetic_m, Datum.ELLIPSOID),
        )

    def _sent(self, second_of_hour: float) -> float:
        return self.clock.unwrap(second_of_hour) if 0.0 <= second_of_hour <= 3600.0 else math.nan


def _identified_velocity(fields: Fields) -> Vector:
    direction, speed, climb = fields["direction"], fields["speed_horizontal"], fields["speed_vertical"]
    if direction >= UNKNOWN_DIRECTION_CDEG or speed >= UNKNOWN_SPEED_CM_S or climb >= UNKNOWN_CLIMB_CM_S:
        return UNKNOWN_VELOCITY
    return velocity_over_ground(course_cdeg=direction, speed_cm_s=speed, climb_cm_s=climb)


def _half(bounds: tuple[float, ...], number: int) -> float:
    return bounds[number] / 2.0 if 0 <= number < len(bounds) else math.nan
