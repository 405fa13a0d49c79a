"""Tracks the evader, home and the game frame when the vehicle's local frame moves.

Evader, home and game are kept in the local frame, whose origin GPS_GLOBAL_ORIGIN reports (or else home). A jump of the
position has two possible causes. Either the estimator corrected the vehicle's position and the origin stays, or the
origin moved, which may be reported earlier, later, never or wrongly. GLOBAL_POSITION_INT decides: the chosen origin is
the one with the local position nearest to the global one. Until the next GLOBAL_POSITION_INT the jump is held back, so
no command mixes the two frames.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from guidance.boot_clock import elapsed_s
from guidance.estimation import EvaderEstimate, Observer, add_report, in_new_frame, predict
from guidance.estimation.measurement import TrackSettings
from guidance.estimation.pace import FASTEST, SLOWEST
from guidance.estimation.track import TAKEN
from guidance.flight.settings import FlightSettings
from guidance.frames import Amsl, GameFrame, LocalFrame, Ned
from guidance.messages import EvaderReport, GlobalPosition, Home, LocalPosition, Message, Origin
from guidance.vehicle import VehicleState, local_frame

NOWHERE: Final = Ned((0.0, 0.0, 0.0))

_UNHEARD: Final = Observer()

_SAME_M: Final = 0.5
"""A reported origin within this distance is accepted: it was rounded, or derived from home."""

_STILL_REPORTS_S: Final = 2.0

HOME_NOTE_M: Final = 3.0
"""A home that is so far from the flight's own and from the last one noted is noted. PX4's wanders by up to 2 m."""

_JUDGE_AGE_S: Final = 1.0
"""Without a global position this recent, the reported origin is accepted."""


class Tracking:
    """The tracks of the evaders, home and the game frame of one flight.

    They move with the origin of the local frame. `held_back_ned_m` is a jump of the vehicle's position whose cause is
    not known yet. `playing` is the evader of the game; "" is the only evader of a vehicle that has no team.

    Attributes:
        news: Changed doubts about reports, for people; the code that shows them empties the list.
        refused: By evader, why its source refuses reports, for people; set by the reader of the source's counters.
    """

    def __init__(self, settings: FlightSettings) -> None:
        self._settings = settings
        self.playing = ""
        declared_m_s = settings.cycle.game.evader_speed_m_s
        sigmas = settings.cycle.speed_sigmas
        speeds = {"": declared_m_s, **settings.evaders}
        self._free = {
            name: TrackSettings(declared_speed_m_s=speed_m_s, sigmas=sigmas)
            for name, speed_m_s in speeds.items()
        }
        # A wrong declaration is tolerated up to the pursuer's speed; a faster evader is no game.
        way_m_s = max(declared_m_s, settings.cycle.game.pursuer.horizontal_m_s)
        self._bounded = {
            name: replace(track, jump_m_s=declared_m_s, way_m_s=way_m_s)
            for name, track in self._free.items()
        }
        self.observers: dict[str, Observer] = {}
        self._dropped: dict[str, Counter[str]] = {}
        self._reported_s: dict[str, float] = {}
        self.news: list[str] = []
        self.refused: dict[str, str] = {}
        self._reported: tuple[Message | None, Message | None] = (None, None)
        self._reported_frame: LocalFrame | None = None
        self._jumped_ned_m = NOWHERE
        self._home: Home | None = None
        self._other_home: Home | None = None
        self._noted_home_ned_m: Ned | None = None
        self.held_back_ned_m = NOWHERE
        self.home_ned_m: Ned | None = None
        self.local_frame: LocalFrame | None = None
        self.game_frame: GameFrame | None = None

    def observe(
        self, vehicle: VehicleState, reports: Sequence[EvaderReport], *, in_flight: bool = True
    ) -> None:
        """Update with the inputs of one cycle.

        Args:
            vehicle: Last known state of the vehicle.
            reports: New reports of the evader.
            in_flight: Whether a jump is bounded by the distance the evader can have covered; not on the ground.
        """
        frame = self._accepted(vehicle)
        if frame is None:
            return
        if frame is not self.local_frame and frame != self.local_frame:
            self._move_into(frame)
        home = vehicle.latest.get(Home)
        if home is not None and home != self._home:
            self._home = home
            self.home_ned_m = home.position_ned_m
            if not all(map(math.isfinite, home.position_ned_m)):
                altitude = Amsl(home.altitude_amsl_m)
                self.home_ned_m = frame.ned_from_wgs84(
                    home.latitude_deg, home.longitude_deg, altitude
                )
        settings = self._bounded if in_flight else self._free
        for report in reports:
            name = "" if report.evader is None else report.evader
            before = self.observers.get(name, _UNHEARD)
            after = add_report(before, report, frame, settings.get(name, settings[""]))
            self.observers[name] = after
            self._reported_s[name] = report.received_s
            outcome = after.track.outcome
            if outcome is not None and outcome not in TAKEN:
                counts = self._dropped.setdefault(name, Counter())
                counts[str(outcome)] += 1
            called = f"evader {name}" if name else "evader"
            if after.pace.usable is not before.pace.usable:
                words = "its stamps are used again" if after.pace.usable else _pace_words(after)
                self.news.append(f"{called}: {words}")
            if after.velocity_check.believed is not before.velocity_check.believed:
                self.news.append(
                    f"{called}: {_velocity_words(after) or 'its velocities are used again'}"
                )

    def other_home(self, vehicle: VehicleState) -> str:
        """Return in words where home is reported instead of where the flight has it, once for each place."""
        other = vehicle.home_refused
        frame = self.local_frame
        home_ned_m = self.home_ned_m
        if other is None or other is self._other_home or frame is None or home_ned_m is None:
            return ""
        self._other_home = other
        other_ned_m = frame.ned_from_wgs84(
            other.latitude_deg, other.longitude_deg, Amsl(other.altitude_amsl_m)
        )
        noted_ned_m = home_ned_m if self._noted_home_ned_m is None else self._noted_home_ned_m
        if math.dist(other_ned_m, noted_ned_m) <= HOME_NOTE_M:
            return ""
        self._noted_home_ned_m = other_ned_m
        level_m = math.dist(other_ned_m[:2], home_ned_m[:2])
        above_m = home_ned_m[2] - other_ned_m[2]
        return (
            f"the autopilot's home is {level_m:.1f} m away from this flight's and {above_m:.1f} m above it; "
            "the fence stays"
        )

    def _accepted(self, vehicle: VehicleState) -> LocalFrame | None:
        """Return the frame about the accepted origin; None until the vehicle has reported one."""
        home = vehicle.latest.get(Home)
        origin = vehicle.latest.get(Origin)
        if (home, origin) != self._reported:  # only a new report is computed
            self._reported = (home, origin)
            self._reported_frame = local_frame(vehicle, self._settings.autopilot.projection)
            if self._reported_frame is not None:
                # Heights above home may change; the frame is the same.
                self._reported_frame = replace(self._reported_frame, home=None)
        reported = self._reported_frame
        before = self.local_frame
        if reported is None:
            return before
        if vehicle.jumped_ned_m != self._jumped_ned_m:
            jump = self.held_back_ned_m + vehicle.jumped_ned_m - self._jumped_ned_m
            self._jumped_ned_m = vehicle.jumped_ned_m
            self.held_back_ned_m = jump
        if before is None:
            before = reported
        is_moved = reported is not before and reported != before
        # A rounded origin, say, is the same one.
        if is_moved and math.hypot(*reported.ned_in(before, NOWHERE)) <= _SAME_M:
            before = reported
            is_moved = False
        if is_moved or self.held_back_ned_m != NOWHERE:
            # Choose between the old origin, the reported one, and the one that explains the jump.
            position = vehicle.latest.get(GlobalPosition)
            local = vehicle.latest.get(LocalPosition)
            if position is None or local is None:
                self.held_back_ned_m = NOWHERE
                return reported
            if local.received_s - position.received_s > _JUDGE_AGE_S:
                self.held_back_ned_m = NOWHERE
                return reported
            if elapsed_s(vehicle.jumped_boot_s, position.time_boot_s) < 0.0:
                return before  # older than the jump
            origin_ned_m = -1.0 * self.held_back_ned_m
            latitude_deg, longitude_deg, altitude = before.wgs84_from_ned(origin_ned_m)
            jumped = replace(
                before, latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude=altitude
            )
            self.held_back_ned_m = NOWHERE
            return min(
                (before, reported, jumped), key=lambda frame: _apart_m(frame, position, local)
            )
        return before

    def rival(self, now_s: float) -> str:
        """Return the evidence of a second source of evader reports; empty if there is none."""
        rivals = self.observers.get(self.playing, _UNHEARD).rivals
        return rivals.why if rivals.why and rivals.there(now_s) else ""

    def doubts(self, evader: str | None = None) -> tuple[str, ...]:
        """Return the unused parts of an evader's reports, by default of the game's evader, in words for people."""
        observer = self.observers.get(self.playing if evader is None else evader, _UNHEARD)
        return tuple(filter(None, (_pace_words(observer), _velocity_words(observer))))

    def dropped(self, evader: str | None = None) -> Mapping[str, int]:
        """Return how many reports of an evader were dropped, by default of the game's, by `ReportOutcome`."""
        return self._dropped.get(self.playing if evader is None else evader, {})

    def unusable_words(self, now_s: float) -> str:
        """Return why the reports of the game's evader are not used if they still arrive; else an empty string."""
        refused = self.refused.get(self.playing)
        if refused:
            return refused
        observer = self.observers.get(self.playing, _UNHEARD)
        outcome = observer.track.outcome
        reported_s = self._reported_s.get(self.playing, -math.inf)
        if outcome is None or outcome in TAKEN or now_s - reported_s > _STILL_REPORTS_S:
            return ""
        return f'its reports still arrive, and are dropped as "{outcome}"'

    def height_refusal(self, now_s: float) -> str:
        """Return why the height of the game's evader bars an engagement; empty if it does not."""
        limit_m = self._settings.evader_height_limit_m
        if limit_m is None:
            return ""
        evader = self.evader(now_s)
        if evader is None or self.home_ned_m is None:
            return "the evader's height above home is not known"
        height_m = self.home_ned_m[2] - evader.position_ned_m[2]
        if abs(height_m) <= limit_m:
            return ""
        above = "above" if height_m > 0.0 else "below"
        allowed = f"at most {limit_m:g} m is allowed (preflight.evader_height_limit_m)"
        advice = "are its altitudes above another zero? See evader.altitude_datum"
        return (
            f"the evader reports {abs(height_m):.1f} m {above} home's ground; {allowed}; {advice}"
        )

    def silence_s(self, now_s: float, evader: str | None = None) -> float:
        """Seconds since the last usable report of an evader, by default the game's; infinite before the first one."""
        last = self.observers.get(
            self.playing if evader is None else evader, _UNHEARD
        ).track.estimate
        return math.inf if last is None else max(0.0, now_s - last.received_s)

    def evader(self, now_s: float, evader: str | None = None) -> EvaderEstimate | None:
        """Return the estimate of an evader, by default the game's, at `now_s`; None before the first report."""
        name = self.playing if evader is None else evader
        observer = self.observers.get(name, _UNHEARD)
        last = observer.track.estimate
        if last is None:
            return None
        return predict(
            last, observer.shift_ned_m, now_s, self._bounded.get(name, self._bounded[""])
        )

    def _move_into(self, frame: LocalFrame) -> None:
        before = self.local_frame
        self.local_frame = frame
        if before is not None:
            for name, observer in self.observers.items():
                self.observers[name] = in_new_frame(
                    observer, lambda position_ned_m: before.ned_in(frame, position_ned_m)
                )
            if self.home_ned_m is not None:
                self.home_ned_m = before.ned_in(frame, self.home_ned_m)
        if (site := self._settings.cycle.site) is not None:
            self.game_frame = GameFrame(frame.ned_from_wgs84(*site))
        elif before is None or self.game_frame is None:
            self.game_frame = GameFrame(NOWHERE)
        else:
            self.game_frame = GameFrame(before.ned_in(frame, self.game_frame.origin_ned_m))


def _pace_words(observer: Observer) -> str:
    pace = observer.pace
    if pace.usable:
        return ""
    runs = f"its clock runs at {pace.rate:.3g} times ours"
    allowed = f"{SLOWEST:g} to {FASTEST:g} is plausible"
    return f"{runs} ({allowed}): its stamps are not used, ages count from arrival"


def _velocity_words(observer: Observer) -> str:
    check = observer.velocity_check
    if check.believed:
        return ""
    return (
        f"its velocities contradict its positions by {check.error_m_s:.1f} m/s: they are not used"
    )


def _apart_m(frame: LocalFrame, position: GlobalPosition, local: LocalPosition) -> float:
    """Distance between the vehicle's local and global positions in this frame."""
    step_s = elapsed_s(local.time_boot_s, position.time_boot_s)
    advanced_ned_m = [
        metres + step_s * rate
        for metres, rate in zip(local.position_ned_m, local.velocity_ned_m_s, strict=True)
    ]
    altitude = Amsl(position.altitude_amsl_m)
    measured_ned_m = frame.ned_from_wgs84(position.latitude_deg, position.longitude_deg, altitude)
    return math.dist(advanced_ned_m, measured_ned_m)
