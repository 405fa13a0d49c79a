"""Where the target is: its reports, turned into the vehicle's local frame, and the estimate advanced to now."""

import math
from collections.abc import Sequence

from guidance.autopilots import AutopilotProfile
from guidance.frames import Amsl, GameFrame, LocalFrame, Vector
from guidance.telemetry import TargetReport
from guidance.tick import TargetNow, TickSettings
from guidance.vehicle import VehicleState, local_frame


class Tracking:
    """The memory of the target in one flight, and the two frames that follow from what the vehicle said of itself."""

    def __init__(self, settings: TickSettings, profile: AutopilotProfile) -> None:
        self._settings = settings
        self._profile = profile
        self._last: tuple[float, Vector, Vector] | None = None
        self.local_frame: LocalFrame | None = None
        self.game_frame: GameFrame | None = None

    def observe(self, vehicle: VehicleState, reports: Sequence[TargetReport]) -> None:
        """Take in what was heard in one cycle."""
        self.local_frame = local_frame(vehicle, self._profile.projection)
        if self.local_frame is None:
            return
        self.game_frame = GameFrame(self._game_origin(self.local_frame))
        for report in reports:
            position = self.local_frame.ned_from_wgs84(
                report.latitude_deg, report.longitude_deg, Amsl(report.altitude_amsl_m)
            )
            if all(map(math.isfinite, position)):
                velocity = report.velocity_ned_m_s
                known = all(map(math.isfinite, velocity))
                self._last = (report.received_s, position, velocity if known else (0.0, 0.0, 0.0))

    def age_s(self, now_s: float) -> float:
        """Seconds since the target was last heard of; infinite if it never was."""
        return math.inf if self._last is None else now_s - self._last[0]

    def target(self, now_s: float) -> TargetNow | None:
        """Return the estimate for now; None until the target was heard."""
        if self._last is None:
            return None
        received_s, position, velocity = self._last
        age_s = now_s - received_s
        north, east, down = (p + v * age_s for p, v in zip(position, velocity, strict=True))
        bound = max(self._settings.declared_evader_speed_m_s, math.hypot(velocity[0], velocity[1]))
        return TargetNow((north, east, down), velocity, bound, age_s)

    def _game_origin(self, frame: LocalFrame) -> Vector:
        if self._settings.site is None:
            return (0.0, 0.0, 0.0)
        latitude_deg, longitude_deg, altitude = self._settings.site
        return frame.ned_from_wgs84(latitude_deg, longitude_deg, altitude)
