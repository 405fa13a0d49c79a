"""Where the evader is, and all places that stay where they are on Earth whatever becomes of the vehicle's local frame.

The evader's reports are estimated in that frame, home and the game are kept in it. GPS_GLOBAL_ORIGIN tells its origin
(without it, home does). A position that jumps means one of two things: the estimator has corrected where the vehicle
is, which leaves the origin where it was; or the origin was moved, which is told a moment earlier, later, or not at all.
And what is told may be wrong. GLOBAL_POSITION_INT decides: of all possible origins, the one is believed with which the
vehicle's local position lies nearest to its global one. Until the next one comes a jump is held back, so that nothing
is commanded by a place of the one frame in the other.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from guidance.autopilots import AutopilotProfile
from guidance.control import Polygon
from guidance.cycle import CycleSettings, EvaderEstimate
from guidance.estimation import Observer, ReportOutcome, TrackSettings, moved, observe, predict
from guidance.frames import Amsl, GameFrame, LocalFrame, Projection, Vector
from guidance.messages import EvaderReport, GlobalPosition, Home, LocalPosition, Message, Origin
from guidance.vehicle import VehicleState, local_frame

NOWHERE: Final[Vector] = (0.0, 0.0, 0.0)

HARMLESS_M: Final = 0.5
"""An origin told to be no further away than this is taken as it is: it was rounded, or derived from home."""

_JUDGE_AGE_S: Final = 1.0
"""Without a global position this recent there is no second source, and what is told is believed."""


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
        return rivals.why if rivals.why and rivals.there(now_s) else ""

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


class OriginEstimate:
    """The origin as believed. `held_back_ned_m` is a jump of the position whose meaning is not known yet."""

    def __init__(self, projection: Projection) -> None:
        self._projection = projection
        self._frame: LocalFrame | None = None
        self._telling: tuple[Message | None, Message | None] = (None, None)
        self._told_frame: LocalFrame | None = None
        self._jumped: Vector = (0.0, 0.0, 0.0)
        self.held_back_ned_m: Vector = NOWHERE

    def observe(self, vehicle: VehicleState) -> LocalFrame | None:
        """Take in what was heard in one cycle; None until the vehicle has told where it is."""
        told = self._told(vehicle)
        if told is None:
            return self._frame
        if vehicle.jumped_ned_m != self._jumped:
            self._note_jump(vehicle)
        if told is self._frame and self.held_back_ned_m == NOWHERE:
            return told
        if self._frame is None or _is_harmless(self._frame, told):
            self._frame = told
        if told != self._frame or self.held_back_ned_m != NOWHERE:
            self._frame = self._judged(self._frame, told, vehicle)
        return self._frame

    def _told(self, vehicle: VehicleState) -> LocalFrame | None:
        """Return the frame that the vehicle tells, reckoned anew only once it tells another."""
        telling = vehicle.latest.get(Home), vehicle.latest.get(Origin)
        if telling != self._telling:
            self._telling, told = telling, local_frame(vehicle, self._projection)
            # Heights above home may change; the frame is the same.
            self._told_frame = None if told is None else replace(told, home=None)
        return self._told_frame

    def _note_jump(self, vehicle: VehicleState) -> None:
        rows = zip(self.held_back_ned_m, vehicle.jumped_ned_m, self._jumped, strict=True)
        north, east, down = (held_back + now - was for held_back, now, was in rows)
        self._jumped, self.held_back_ned_m = vehicle.jumped_ned_m, (north, east, down)

    def _judged(self, held: LocalFrame, told: LocalFrame, vehicle: VehicleState) -> LocalFrame:
        """Choose between where the origin was, where it is told to be, and where a jump would have put it."""
        place, local = vehicle.last(GlobalPosition), vehicle.last(LocalPosition)
        if place is None or local is None or local.received_s - place.received_s > _JUDGE_AGE_S:
            self.held_back_ned_m = NOWHERE
            return told
        if place.time_boot_s < vehicle.jumped_boot_s:
            return held  # it is from before
        possible = (held, told, _jumped_origin(held, self.held_back_ned_m))
        self.held_back_ned_m = NOWHERE
        return min(possible, key=lambda frame: _apart_m(frame, place, local))


def _is_harmless(held: LocalFrame, told: LocalFrame) -> bool:
    return told != held and math.hypot(*told.ned_in(held, (0.0, 0.0, 0.0))) <= HARMLESS_M


def _jumped_origin(held: LocalFrame, jump_ned_m: Vector) -> LocalFrame:
    north, east, down = jump_ned_m
    latitude_deg, longitude_deg, altitude = held.wgs84_from_ned((-north, -east, -down))
    return replace(held, latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude=altitude)


def _apart_m(frame: LocalFrame, place: GlobalPosition, local: LocalPosition) -> float:
    """Distance between the vehicle's local and global positions, if this were the frame."""
    step_s = place.time_boot_s - local.time_boot_s
    then = [at + step_s * rate for at, rate in zip(local.position_ned_m, local.velocity_ned_m_s, strict=True)]
    altitude = Amsl(place.altitude_amsl_m)
    return math.dist(then, frame.ned_from_wgs84(place.latitude_deg, place.longitude_deg, altitude))


def polygon_about_home(corners_deg: Sequence[tuple[float, float]], home_ned_m: Vector, frame: LocalFrame) -> Polygon:
    """Return the polygon in metres about home, by the autopilot's own map between degrees and metres.

    Args:
        corners_deg: As configured.
        home_ned_m: Home in the local frame, whose origin need not be there.
        frame: The vehicle's local frame.

    Raises:
        ConfigError: If the corners make no polygon.
    """
    north_m, east_m, _ = home_ned_m
    places = [frame.ned_from_wgs84(latitude, longitude, frame.altitude) for latitude, longitude in corners_deg]
    return Polygon(tuple((north - north_m, east - east_m) for north, east, _ in places))
