"""GLOBAL_POSITION_INT of another vehicle.

* Position: WGS-84 degrees; `alt` above mean sea level, millimetres (`relative_alt`, above its home, is not used: its
  home is not ours).
* Velocity: north, east, down, cm/s. Always given; a vehicle at rest says zero and means it.
* Clock: `time_boot_ms`, unwrapped at 2^32.
"""

import math
from dataclasses import dataclass, field
from typing import ClassVar

from guidance.links.codec import Fields, decode
from guidance.links.evaders.refusal import Refused, finite_altitude
from guidance.links.evaders.sender_clock import SenderClock, boot_ms_clock
from guidance.messages import AltitudeSaid, Datum, EvaderReport, GlobalPosition


@dataclass(slots=True)
class GlobalPositionInt:
    """Carrier of GLOBAL_POSITION_INT."""

    message: ClassVar[str] = "GLOBAL_POSITION_INT"
    clock: SenderClock = field(default_factory=boot_ms_clock)

    def report(self, fields: Fields, received_s: float) -> EvaderReport:
        """Turn the message into a report."""
        heard = decode(self.message, fields, received_s)
        if not isinstance(heard, GlobalPosition):
            raise Refused("invalid")
        return self.report_of(heard)

    def report_of(self, heard: GlobalPosition) -> EvaderReport:
        """The same from the typed value, for an evader that has a link of its own."""
        return EvaderReport(
            received_s=heard.received_s,
            sent_s=self.clock.unwrap(heard.time_boot_s * 1e3) / 1e3,
            source=self.message,
            latitude_deg=heard.latitude_deg,
            longitude_deg=heard.longitude_deg,
            altitude_amsl_m=finite_altitude(heard.altitude_amsl_m),
            velocity_ned_m_s=heard.velocity_ned_m_s,
            position_sd_m=math.nan,
            velocity_sd_m_s=math.nan,
            said=AltitudeSaid(heard.altitude_amsl_m, Datum.AMSL),
        )
