"""Where the evader is: its reports, estimated in the vehicle's local frame, and where the game is played in it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from guidance.autopilots import AutopilotProfile
from guidance.cycle import CycleSettings, EvaderEstimate
from guidance.estimation import Observer, ReportOutcome, TrackSettings, moved, observe, predict
from guidance.flight.local_frame import NOWHERE, OriginEstimate
from guidance.frames import Amsl, GameFrame, LocalFrame, Vector
from guidance.messages import EvaderReport, Home
from guidance.vehicle import VehicleState


class Tracking:
    """The memory of the evader in one flight, and all places that stay where they are on Earth.

    When the origin of the local frame moves, the evader's track, home and the game frame are moved into the new one.
    `held_back_ned_m` is a jump of the vehicle's position of which it is not known yet whether that origin was moved.
    """

    def __init__(self, settings: CycleSettings, profile: AutopilotProfile) -> None:
        self._site = settings.site
        self._free = TrackSettings(declared_speed_m_s=settings.declared_evader_speed_m_s, sigmas=settings.speed_sigmas)
        # An evader that is faster than the pursuer makes no game; up to there a wrong declaration is played against.
        self._track = replace(
            self._free,
            jump_m_s=settings.declared_evader_speed_m_s,
            way_m_s=max(settings.declared_evader_speed_m_s, settings.ground_speed_m_s),
        )
        self._observer = Observer()
        self._origin = OriginEstimate(profile.projection)
        self._home: Home | None = None
        self.held_back_ned_m = NOWHERE
        self.home_ned_m: Vector | None = None
        self.local_frame: LocalFrame | None = None
        self.game_frame: GameFrame | None = None

    def observe(self, vehicle: VehicleState, reports: Sequence[EvaderReport], *, in_flight: bool = True) -> None:
        """Take in what was heard in one cycle.

        Args:
            vehicle: As last heard.
            reports: Of the evader, new ones.
            in_flight: Whether a jump is bounded by the way that the evader can have gone; on the ground none is.
        """
        frame = self._origin.observe(vehicle)
        self.held_back_ned_m = self._origin.held_back_ned_m
        if frame is None:
            return
        if frame != self.local_frame:
            self._move_into(frame)
        home = vehicle.last(Home)
        if home is not None and home != self._home:
            self._home, self.home_ned_m = home, home.position_ned_m
            if not all(map(math.isfinite, home.position_ned_m)):
                altitude = Amsl(home.altitude_amsl_m)
                self.home_ned_m = frame.ned_from_wgs84(home.latitude_deg, home.longitude_deg, altitude)
        for report in reports:
            self._observer = observe(self._observer, report, frame, self._track if in_flight else self._free)

    @property
    def counts(self) -> Mapping[ReportOutcome, int]:
        """How many reports of the evader were taken in, and how many dropped, and why."""
        return self._observer.track.counts

    def rival(self, now_s: float) -> str:
        """Return by what a second source of the evader's reports shows now; empty where none does."""
        rivals = self._observer.rivals
        return rivals.why if rivals.there(now_s) else ""

    def silence_s(self, now_s: float) -> float:
        """Seconds since a report of the evader arrived that could be used; infinite if none ever did."""
        last = self._observer.track.estimate
        return math.inf if last is None else max(0.0, now_s - last.received_s)

    def evader(self, now_s: float) -> EvaderEstimate | None:
        """Return the estimate for now; None until the evader was heard."""
        state = predict(self._observer.track, now_s, self._track)
        if state is None:
            return None
        velocity = state.velocity_ned_m_s if state.velocity_known else (0.0, 0.0, 0.0)
        return EvaderEstimate(state.position_ned_m, velocity, state.speed_bound_m_s, state.age_s)

    def _move_into(self, frame: LocalFrame) -> None:
        before, self.local_frame = self.local_frame, frame
        if before is not None:
            self._observer = moved(self._observer, lambda place: before.ned_in(frame, place))
            if self.home_ned_m is not None:
                self.home_ned_m = before.ned_in(frame, self.home_ned_m)
        if before is None or self.game_frame is None or self._site is not None:
            self.game_frame = GameFrame(self._game_origin(frame))
        else:
            self.game_frame = GameFrame(before.ned_in(frame, self.game_frame.origin_ned_m))

    def _game_origin(self, frame: LocalFrame) -> Vector:
        if self._site is None:
            return (0.0, 0.0, 0.0)
        latitude_deg, longitude_deg, altitude = self._site
        return frame.ned_from_wgs84(latitude_deg, longitude_deg, altitude)
