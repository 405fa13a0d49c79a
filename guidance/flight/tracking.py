"""Where the target is: its reports, estimated in the vehicle's local frame, and where the game is played in it."""

import math
from collections.abc import Sequence

from guidance.autopilots import AutopilotProfile
from guidance.estimate import Observer, TrackSettings, observe, target_at
from guidance.frames import GameFrame, LocalFrame
from guidance.telemetry import TargetReport
from guidance.tick import TargetNow, TickSettings
from guidance.vehicle import VehicleState, local_frame


class Tracking:
    """The memory of the target in one flight, and the two frames that follow from what the vehicle said of itself."""

    def __init__(self, settings: TickSettings, profile: AutopilotProfile) -> None:
        self._site = settings.site
        self._projection = profile.projection
        self._track = TrackSettings(declared_speed_m_s=settings.declared_evader_speed_m_s, sigmas=settings.speed_sigmas)
        self._observer = Observer()
        self._resets = 0
        self.local_frame: LocalFrame | None = None
        self.game_frame: GameFrame | None = None

    def observe(self, vehicle: VehicleState, reports: Sequence[TargetReport]) -> None:
        """Take in what was heard in one cycle."""
        frame = local_frame(vehicle, self._projection)
        if frame is None:
            return
        if frame != self.local_frame or vehicle.resets != self._resets:
            # What the track holds was said in a frame that is no more.
            self._observer, self._resets = Observer(), vehicle.resets
            self.local_frame, self.game_frame = frame, GameFrame(self._game_origin(frame))
        for report in reports:
            self._observer = observe(self._observer, report, frame, self._track)

    def silence_s(self, now_s: float) -> float:
        """Seconds since a report of the target arrived that could be used; infinite if none ever did."""
        target = target_at(self._observer, now_s, self._track)
        return math.inf if target is None else target.silence_s

    def target(self, now_s: float) -> TargetNow | None:
        """Return the estimate for now; None until the target was heard."""
        target = target_at(self._observer, now_s, self._track)
        if target is None:
            return None
        velocity = target.velocity_ned_m_s if target.velocity_known else (0.0, 0.0, 0.0)
        return TargetNow(target.position_ned_m, velocity, target.speed_bound_m_s, target.age_s)

    def _game_origin(self, frame: LocalFrame) -> tuple[float, float, float]:
        if self._site is None:
            return (0.0, 0.0, 0.0)
        latitude_deg, longitude_deg, altitude = self._site
        return frame.ned_from_wgs84(latitude_deg, longitude_deg, altitude)
