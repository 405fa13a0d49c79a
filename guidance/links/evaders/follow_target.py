"""FOLLOW_TARGET: what phones, ground stations and beacons send.

* Position: WGS-84 degrees; altitude above mean sea level, metres.
* Velocity: north, east, down, m/s. (0, 0, 0) means unknown, by the message's definition, as does a velocity whose
  bit in `est_capabilities` is not set although others are. Many senders fill in no capabilities at all.
* Accuracy: `position_cov` carries standard deviations (ground stations put "eph, epv" there), zero for unknown.
* Clock: milliseconds since the sender's boot, unwrapped at 2^32 since many senders count in 32 bits.
"""

import math
from dataclasses import dataclass, field
from typing import ClassVar, Final

from guidance.frames import Vector
from guidance.links.codec import Fields, degrees, number
from guidance.links.evaders.refusal import UNKNOWN_VELOCITY, finite_altitude, standard_deviation
from guidance.links.evaders.sender_clock import SenderClock, boot_ms_clock
from guidance.messages import AltitudeSaid, Datum, EvaderReport

CAPABILITY_VELOCITY: Final = 1 << 1


@dataclass(slots=True)
class FollowTarget:
    """Carrier of FOLLOW_TARGET."""

    message: ClassVar[str] = "FOLLOW_TARGET"
    clock: SenderClock = field(default_factory=boot_ms_clock)

    def report(self, fields: Fields, received_s: float) -> EvaderReport:
        """Turn the message into a report."""
        latitude, longitude = degrees(fields["lat"], fields["lon"])
        deviations = (number(value) for value in fields["position_cov"])
        return EvaderReport(
            received_s=received_s,
            sent_s=self.clock.unwrap(fields["timestamp"] % 2**32) / 1e3,
            source=self.message,
            latitude_deg=latitude,
            longitude_deg=longitude,
            altitude_amsl_m=finite_altitude(number(fields["alt"])),
            velocity_ned_m_s=_velocity(fields),
            position_sd_m=standard_deviation(*(value * abs(value) for value in deviations)),
            velocity_sd_m_s=math.nan,
            said=AltitudeSaid(number(fields["alt"]), Datum.AMSL),
        )


def _velocity(fields: Fields) -> Vector:
    north, east, down = (number(value) for value in fields["vel"])
    capabilities = fields["est_capabilities"]
    said_unknown = capabilities != 0 and not capabilities & CAPABILITY_VELOCITY
    if said_unknown or (north, east, down) == (0.0, 0.0, 0.0) or not math.isfinite(north + east + down):
        return UNKNOWN_VELOCITY
    return north, east, down
