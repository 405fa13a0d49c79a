"""The evader's track: `update(track, measurement)` adds a report, or drops it for a reason.

A track is a value; update returns a new one. It keeps the accepted reports of the last seconds with the estimate after
each, so a late report is inserted at its time and the later ones are processed again. Outliers form a second track, the
rival, which replaces the first once several in a row agree with it.
"""

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Final, NamedTuple

from guidance.estimation import filters
from guidance.estimation.filters import Estimate, Height, advance
from guidance.estimation.measurement import Measurement, TrackSettings
from guidance.frames import Ned


class ReportOutcome(StrEnum):
    """The outcome of a report. The first five changed the estimate."""

    STARTED = "started"
    ACCEPTED = "accepted"
    REORDERED = "reordered"  # older than the newest one, inserted at its time
    JUMPED = "jumped"  # several outliers in a row agree: the track restarts there
    REACQUIRED = "reacquired"  # the first one after a long silence
    UNUSABLE = "unusable"  # a number is not finite or impossibly large
    IMPLAUSIBLE = "implausible"  # faster than any evader
    STALE = "stale"  # too old when it arrived
    FUTURE = "future"  # from after its own arrival
    DUPLICATE = "duplicate"
    TOO_OLD = "too old"  # older than all reports that are kept
    OUTLIER = "outlier"
    TOO_FAR = "too far"  # out of reach of where it was


TAKEN: Final = frozenset(
    {
        ReportOutcome.STARTED,
        ReportOutcome.ACCEPTED,
        ReportOutcome.REORDERED,
        ReportOutcome.JUMPED,
        ReportOutcome.REACQUIRED,
    }
)
"""Outcomes of the reports that changed the estimate."""

# χ² at a probability of 1e-6, by the number of measured values.
_GATE = {2: 27.63, 4: 33.38}
_SAME_TIME_S = 1e-4
_ANCHOR_EVERY_S = 0.5
_JUMP_SIGMAS = 6.0


class Accepted(NamedTuple):
    """An accepted report, and the estimate after it."""

    measurement: Measurement
    estimate: Estimate


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """The memory of an evader's motion.

    Attributes:
        history: Accepted reports of the last seconds, oldest first; empty before the first one.
        rival: A track of outliers that agree, not accepted yet.
        outcome: Of the last report.
        anchors: Some estimates of the last seconds, oldest first; they bound how far it can have moved.
        estimate: The newest one, None before the first report.
    """

    history: tuple[Accepted, ...] = ()
    rival: "Track | None" = None
    outcome: ReportOutcome | None = None
    anchors: tuple[Estimate, ...] = ()
    estimate: Estimate | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "estimate", self.history[-1].estimate if self.history else None)


def update(track: Track, measurement: Measurement, settings: TrackSettings) -> Track:
    """Add a report, or drop it; the outcome says why."""
    refused = _refusal(track, measurement, settings)
    if refused is not None:
        return replace(track, outcome=refused)
    estimate = track.estimate
    if estimate is None:
        return _new_track(track, measurement, settings)
    if measurement.received_s - estimate.received_s > settings.silence_s:
        restarted = _new_track(track, measurement, settings)
        reacquired = replace(restarted, outcome=ReportOutcome.REACQUIRED)
        return _begun_anew(track, reacquired, settings)

    earlier = len(track.history)
    while track.history[earlier - 1].measurement.time_s > measurement.time_s:
        earlier -= 1
    taken = _take(track.history[earlier - 1].estimate, measurement, settings)
    if taken is None:
        # Once enough outliers agree, the rival becomes the track.
        rival = track.rival
        if rival is not None:
            rival = update(rival, measurement, settings)
        if rival is None or rival.outcome is not ReportOutcome.ACCEPTED:
            rival = _new_track(Track(), measurement, settings)
        lasting_s = rival.history[-1].measurement.time_s - rival.history[0].measurement.time_s
        if len(rival.history) < settings.jump_reports and lasting_s < settings.jump_s:
            return replace(track, rival=rival, outcome=ReportOutcome.OUTLIER)
        restarted = replace(track, history=rival.history, rival=None, outcome=ReportOutcome.JUMPED)
        return _begun_anew(replace(track, rival=rival), restarted, settings)
    history = (*track.history[:earlier], Accepted(measurement, taken))
    for later in track.history[earlier:]:  # again, without those that no longer fit
        corrected = _take(history[-1].estimate, later.measurement, settings)
        if corrected is not None:
            history = (*history, Accepted(later.measurement, corrected))
    outcome = ReportOutcome.REORDERED if earlier < len(track.history) else ReportOutcome.ACCEPTED
    # Keep the reports, oldest first, that are at most so much older than the last one.
    oldest_s = history[-1].measurement.time_s - settings.history_s
    first = 0
    while history[first].measurement.time_s < oldest_s:
        first += 1
    recent = history[first:]
    return _anchored(Track(recent, None, outcome, track.anchors), settings)


def _anchored(track: Track, settings: TrackSettings) -> Track:
    """Add an anchor from time to time."""
    estimate = track.estimate
    anchors = track.anchors
    if estimate is None or (anchors and estimate.time_s - anchors[-1].time_s < _ANCHOR_EVERY_S):
        return track
    recent = tuple(
        anchor for anchor in anchors if estimate.time_s - anchor.time_s <= settings.history_s
    )
    if not recent:
        recent = anchors[-1:]
    return replace(track, anchors=(*recent, estimate))


def _is_within(way_m: float, estimate: Estimate, measurement: Measurement) -> bool:
    """Return whether a report is within a way over the ground from an estimate."""
    north_m, east_m, _, _ = filters.mean_of(estimate.modes)
    return math.dist((north_m, east_m), measurement.position_ned_m[:2]) <= way_m


def _refusal(
    track: Track, measurement: Measurement, settings: TrackSettings
) -> ReportOutcome | None:
    velocity = measurement.velocity_ned_m_s
    if not measurement.is_usable():
        return ReportOutcome.UNUSABLE
    if velocity is not None and math.hypot(*velocity) > settings.largest_speed_m_s:
        return ReportOutcome.IMPLAUSIBLE
    age_s = measurement.received_s - measurement.time_s
    if age_s > settings.stale_s:
        return ReportOutcome.STALE
    if age_s < -settings.future_s:
        return ReportOutcome.FUTURE
    refused = _repetition(track, measurement)
    if refused is None and track.anchors:  # within the way since the oldest one?
        oldest = track.anchors[0]
        way_m = settings.way_m_s * abs(measurement.time_s - oldest.time_s) + settings.reach_m
        refused = None if _is_within(way_m, oldest, measurement) else ReportOutcome.TOO_FAR
    return refused


def _repetition(track: Track, measurement: Measurement) -> ReportOutcome | None:
    for accepted in reversed(track.history):
        since_s = measurement.time_s - accepted.measurement.time_s
        if abs(since_s) < _SAME_TIME_S:
            return ReportOutcome.DUPLICATE
        if since_s > 0.0:
            return None
    return ReportOutcome.TOO_OLD if track.history else None


def _new_track(track: Track, measurement: Measurement, settings: TrackSettings) -> Track:
    velocity = measurement.velocity_ned_m_s
    down_m_s = 0.0
    sd_m_s = settings.prior_speed_sd_m_s
    if velocity is not None:
        down_m_s = velocity[2]
        sd_m_s = measurement.velocity_sd_m_s
    height = Height(
        measurement.position_ned_m[2], down_m_s, measurement.position_sd_m**2, 0.0, sd_m_s**2
    )
    modes = filters.begin(*measurement.plane(), settings)
    first = Accepted(
        measurement, Estimate(measurement.time_s, measurement.received_s, modes, height)
    )
    return replace(track, history=(first,), rival=None, outcome=ReportOutcome.STARTED)


def _take(before: Estimate, measurement: Measurement, settings: TrackSettings) -> Estimate | None:
    """Return the estimate after a report, None if the report is an outlier."""
    moved = advance(before, measurement.time_s, settings)
    measured, variances = measurement.plane()
    if filters.distance(moved.modes, measured, variances) <= _GATE[len(measured)]:
        modes = filters.correct(moved.modes, measured, variances)
    elif _has_turned(before, moved, measurement, settings):
        modes = filters.begin(measured, variances, settings)
    else:
        return None
    height = filters.correct_down(
        moved.height, measurement.position_ned_m[2], measurement.position_sd_m**2
    )
    if measurement.velocity_ned_m_s is not None:
        height = filters.correct_rate(
            height, measurement.velocity_ned_m_s[2], measurement.velocity_sd_m_s**2
        )
    received_s = max(before.received_s, measurement.received_s)
    return Estimate(moved.time_s, received_s, modes, height)


def _has_turned(
    before: Estimate, moved: Estimate, measurement: Measurement, settings: TrackSettings
) -> bool:
    """Return whether one change of velocity since the last estimate explains a report, to a speed that is declared."""
    velocity = measurement.velocity_ned_m_s
    if velocity is None:
        return False
    spread_m_s = settings.sigmas * measurement.velocity_sd_m_s
    if math.hypot(*velocity[:2]) > settings.declared_speed_m_s + spread_m_s:
        return False
    dt_s = moved.time_s - before.time_s
    variance_m2 = (
        filters.position_variance(moved.modes.steady)
        + measurement.position_sd_m**2
        + (dt_s * measurement.velocity_sd_m_s) ** 2
    )
    return _off_the_turn_m(before, measurement, velocity, dt_s) ** 2 <= _GATE[2] * variance_m2


def _off_the_turn_m(
    before: Estimate, measurement: Measurement, velocity: Ned, dt_s: float
) -> float:
    """Return how far a position is from all that an evader reaches in dt that once exchanges its velocity."""
    north_m, east_m, north_m_s, east_m_s = filters.mean_of(before.modes)
    # Beyond where the new velocity alone leads, and how much farther each second of the old one leads
    beyond_north_m = measurement.position_ned_m[0] - north_m - velocity[0] * dt_s
    beyond_east_m = measurement.position_ned_m[1] - east_m - velocity[1] * dt_s
    more_north_m_s = north_m_s - velocity[0]
    more_east_m_s = east_m_s - velocity[1]
    square_m2_s2 = more_north_m_s**2 + more_east_m_s**2
    kept_s = 0.0
    if square_m2_s2 > 0.0:
        along = beyond_north_m * more_north_m_s + beyond_east_m * more_east_m_s
        kept_s = min(dt_s, max(0.0, along / square_m2_s2))
    return math.hypot(
        beyond_north_m - more_north_m_s * kept_s, beyond_east_m - more_east_m_s * kept_s
    )


def _begun_anew(track: Track, restarted: Track, settings: TrackSettings) -> Track:
    """Return the new track if the evader can have reached it since the last estimate, at its declared speed.

    Else keep the old one.
    """
    estimate = track.estimate
    measurement = restarted.history[-1].measurement
    if estimate is not None:
        moved = advance(estimate, measurement.time_s, settings)
        spread_m = _JUMP_SIGMAS * math.hypot(settings.position_sd_m, measurement.position_sd_m)
        moved_m = settings.jump_m_s * max(0.0, measurement.time_s - estimate.time_s)
        way_m = moved_m + max(settings.reach_m, spread_m)
        if not _is_within(way_m, moved, measurement):
            return replace(track, outcome=ReportOutcome.TOO_FAR)
    return _anchored(restarted, settings)
