"""ADSB_VEHICLE: traffic, by its ICAO address.

* Position: WGS-84 degrees. Altitude, millimetres, by `altitude_type`: QNH pressure is taken as above mean sea level,
  geometric as above the WGS-84 ellipsoid, made AMSL with the geoid's height that the frame declares.
* Velocity: course over ground and speeds, up positive, known only as far as the flags say valid.
* Clock: none (`sent_s` is NaN), but `tslc`, whole seconds since the aircraft was heard: old reports are refused.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Final

from guidance.frames import Amsl, Ellipsoid, LocalFrame, Vector
from guidance.links.decode import Fields, degrees
from guidance.links.evaders.carrier import UNKNOWN_VELOCITY, Refused, finite_altitude, velocity_over_ground
from guidance.messages import AltitudeSaid, Datum, EvaderReport

VALID_COORDINATES: Final = 1
VALID_ALTITUDE: Final = 2
VALID_HEADING: Final = 4
VALID_VELOCITY: Final = 8
VALID_VERTICAL_VELOCITY: Final = 128
ALTITUDE_GEOMETRIC: Final = 1


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
            velocity_ned_m_s=_velocity(fields),
            position_sd_m=math.nan,
            velocity_sd_m_s=math.nan,
            said=AltitudeSaid(given_m, Datum.ELLIPSOID if geometric else Datum.AMSL),
        )


def _velocity(fields: Fields) -> Vector:
    needed = VALID_HEADING | VALID_VELOCITY | VALID_VERTICAL_VELOCITY
    if fields["flags"] & needed != needed:
        return UNKNOWN_VELOCITY
    return velocity_over_ground(
        course_cdeg=fields["heading"], speed_cm_s=fields["hor_velocity"], climb_cm_s=fields["ver_velocity"]
    )
