"""A report of the evader made ready for the filter: local metres, our clock, and honest spreads."""

import math
from typing import NamedTuple

import numpy as np

from guidance.estimation.imm import Array
from guidance.estimation.settings import TrackSettings
from guidance.frames import Amsl, LocalFrame, Vector
from guidance.messages import EvaderReport
from guidance.plausible import is_plausible

_LARGEST = 1e8
_NOWHERE: Vector = (math.nan, math.nan, math.nan)
_LEAST_SD, _LARGEST_SD = 0.01, 1e4


class Measurement(NamedTuple):
    """Position (NED, m), velocity (NED, m/s) or None where it is not known, and when it was true on our clock."""

    time_s: float
    received_s: float
    position_ned_m: Vector
    velocity_ned_m_s: Vector | None
    position_sd_m: float
    velocity_sd_m_s: float

    def is_usable(self) -> bool:
        """Whether everything in it is a number of a size that can be, the spreads included."""
        numbers = (*self[:2], *self.position_ned_m, *(self.velocity_ned_m_s or ()))
        spreads_fit = all(_LEAST_SD <= spread <= _LARGEST_SD for spread in self[4:])
        return spreads_fit and all(abs(number) < _LARGEST for number in numbers)

    def plane(self) -> tuple[Array, Array]:
        """What is measured in the plane, (2,) or with a velocity (4,), and its covariance."""
        place = self.position_sd_m**2
        if self.velocity_ned_m_s is None:
            return np.array(self.position_ned_m[:2]), np.array([[place, 0.0], [0.0, place]])
        rate = self.velocity_sd_m_s**2
        return (
            np.array(self.position_ned_m[:2] + self.velocity_ned_m_s[:2]),
            np.array([[place, 0, 0, 0], [0, place, 0, 0], [0, 0, rate, 0], [0, 0, 0, rate]], dtype=np.float64),
        )


def measure(report: EvaderReport, frame: LocalFrame, time_s: float, settings: TrackSettings) -> Measurement:
    """Bring a report into the local frame.

    A velocity of which any part is NaN is not known, and none is invented. A spread that is not given, or not
    positive, is the setting's; nobody is believed to a millimetre. A place that is none on Earth is not usable.

    Args:
        report: As the source gave it.
        frame: The vehicle's local frame.
        time_s: When it was true, on our clock.
        settings: For spreads that are not given.
    """
    known = not any(math.isnan(part) for part in report.velocity_ned_m_s)
    if not is_plausible(report):
        return Measurement(time_s, report.received_s, _NOWHERE, None, math.nan, math.nan)
    return Measurement(
        time_s,
        report.received_s,
        frame.ned_from_wgs84(report.latitude_deg, report.longitude_deg, Amsl(report.altitude_amsl_m)),
        report.velocity_ned_m_s if known else None,
        max(_LEAST_SD, report.position_sd_m) if report.position_sd_m > 0.0 else settings.position_sd_m,
        max(_LEAST_SD, report.velocity_sd_m_s) if report.velocity_sd_m_s > 0.0 else settings.velocity_sd_m_s,
    )
