"""The evader's track: `update(track, measurement)` takes a report in or drops it, with the reason counted.

A track is a value: update returns a new one. Besides the estimate it holds the last seconds of accepted reports with
the estimate after each, so that a late report is put in its place in time and the later ones are taken in again; and
a rival, fed by outliers, that takes over once several in a row agree with it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import NamedTuple

from guidance.estimation import height as vertical
from guidance.estimation import imm
from guidance.estimation.height import Height
from guidance.estimation.imm import Modes
from guidance.estimation.measurement import Measurement
from guidance.estimation.settings import TrackSettings


class ReportOutcome(StrEnum):
    """The last report's fate. The first five changed the estimate."""

    STARTED = "started"
    ACCEPTED = "accepted"
    REORDERED = "reordered"  # older than the newest one, put in its place in time
    JUMPED = "jumped"  # several outliers in a row agree with each other: the track starts anew there
    REACQUIRED = "reacquired"  # the first one after a long silence
    UNUSABLE = "unusable"  # something in it is no number, or of no size that can be
    IMPLAUSIBLE = "implausible"  # faster than anything that is being pursued
    STALE = "stale"  # too old when it arrived
    FUTURE = "future"  # from after its own arrival
    DUPLICATE = "duplicate"
    TOO_OLD = "too old"  # from before everything that can still be put in order
    OUTLIER = "outlier"


TAKEN = frozenset(
    {
        ReportOutcome.STARTED,
        ReportOutcome.ACCEPTED,
        ReportOutcome.REORDERED,
        ReportOutcome.JUMPED,
        ReportOutcome.REACQUIRED,
    }
)


# χ² at a probability of 1e-6, by the number of things measured. No tighter: at 1 Hz a sharp turn lies in the tails of
# the mixture, and to refuse it costs more than to take in what a receiver's bad moment could still hide below.
_GATE = {2: 27.63, 4: 33.38}
_SAME_TIME_S = 1e-4


class Estimate(NamedTuple):
    """Where the evader was at a time of our clock, in the plane and in height, and when that was last heard of."""

    time_s: float
    received_s: float
    modes: Modes
    height: Height


class Accepted(NamedTuple):
    """A report that was taken in, and the estimate after it."""

    measurement: Measurement
    estimate: Estimate


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Everything that is remembered of an evader.

    Attributes:
        history: Accepted reports of the last seconds, oldest first; empty before the first one.
        rival: A track that outliers agree on, not yet believed.
        outcome: What became of the last report.
        counts: How many reports ended with each outcome.
        nis: Normalised innovation squared of the last report that was compared with the estimate.
    """

    history: tuple[Accepted, ...] = ()
    rival: "Track | None" = None
    outcome: ReportOutcome | None = None
    counts: Mapping[ReportOutcome, int] = field(default_factory=dict)
    nis: float = float("nan")

    @property
    def estimate(self) -> Estimate | None:
        """The newest estimate, None before the first report."""
        return self.history[-1].estimate if self.history else None


def update(track: Track, measurement: Measurement, settings: TrackSettings) -> Track:
    """Take a report in, or drop it and count why."""
    refused = _refusal(track, measurement, settings)
    if refused is not None:
        return _ended(track, refused)
    estimate = track.estimate
    if estimate is None:
        return _ended(_begun(track, measurement, settings), ReportOutcome.STARTED)
    if measurement.received_s - estimate.received_s > settings.silence_s:
        return _ended(_begun(track, measurement, settings), ReportOutcome.REACQUIRED)

    earlier = len(track.history)
    while track.history[earlier - 1].measurement.time_s > measurement.time_s:
        earlier -= 1
    taken, nis = _take(track.history[earlier - 1].estimate, measurement, settings)
    if taken is None:
        return _outlier(replace(track, nis=nis), measurement, settings)
    history = _replayed((*track.history[:earlier], Accepted(measurement, taken)), track.history[earlier:], settings)
    outcome = ReportOutcome.REORDERED if earlier < len(track.history) else ReportOutcome.ACCEPTED
    return Track(_recent(history, settings), None, outcome, _counted(track, outcome), nis)


def advance(estimate: Estimate, time_s: float, settings: TrackSettings) -> Estimate:
    """Move an estimate on to a later time; an earlier one leaves it as it is."""
    dt_s = time_s - estimate.time_s
    if dt_s <= 0.0:
        return estimate
    return Estimate(
        time_s,
        estimate.received_s,
        imm.advance(estimate.modes, dt_s, settings),
        vertical.advance(estimate.height, dt_s, settings.height_noise_m2_s3),
    )


def _refusal(track: Track, measurement: Measurement, settings: TrackSettings) -> ReportOutcome | None:
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
    return _repetition(track, measurement)


def _repetition(track: Track, measurement: Measurement) -> ReportOutcome | None:
    for one in reversed(track.history):
        since_s = measurement.time_s - one.measurement.time_s
        if abs(since_s) < _SAME_TIME_S:
            return ReportOutcome.DUPLICATE
        if since_s > 0.0:
            return None
    return ReportOutcome.TOO_OLD if track.history else None


def _replayed(
    history: tuple[Accepted, ...], later: tuple[Accepted, ...], settings: TrackSettings
) -> tuple[Accepted, ...]:
    """Take the later reports in again; one that no longer fits is left out."""
    for one in later:
        again, _ = _take(history[-1].estimate, one.measurement, settings)
        if again is not None:
            history = (*history, Accepted(one.measurement, again))
    return history


def _recent(history: tuple[Accepted, ...], settings: TrackSettings) -> tuple[Accepted, ...]:
    """Leave out what is older than the history reaches back; the newest always stays."""
    oldest_s = history[-1].measurement.time_s - settings.history_s
    first = 0
    while history[first].measurement.time_s < oldest_s:
        first += 1
    return history[first:]


def _begun(track: Track, measurement: Measurement, settings: TrackSettings) -> Track:
    velocity = measurement.velocity_ned_m_s
    height = Height(
        measurement.position_ned_m[2],
        0.0 if velocity is None else velocity[2],
        measurement.position_sd_m**2,
        0.0,
        (settings.prior_speed_sd_m_s if velocity is None else measurement.velocity_sd_m_s) ** 2,
    )
    modes = imm.begin(*measurement.plane(), settings)
    first = Accepted(measurement, Estimate(measurement.time_s, measurement.received_s, modes, height))
    return replace(track, history=(first,), rival=None)


def _take(before: Estimate, measurement: Measurement, settings: TrackSettings) -> tuple[Estimate | None, float]:
    """The estimate with a report taken in, None if the report is an outlier; and its NIS."""
    moved = advance(before, measurement.time_s, settings)
    measured, noise = measurement.plane()
    innovation = imm.compare(moved.modes, measured, noise)
    if not innovation.nis <= _GATE[len(measured)]:
        return None, innovation.nis
    height = vertical.correct_down(moved.height, measurement.position_ned_m[2], measurement.position_sd_m**2)
    if measurement.velocity_ned_m_s is not None:
        height = vertical.correct_rate(height, measurement.velocity_ned_m_s[2], measurement.velocity_sd_m_s**2)
    received_s = max(before.received_s, measurement.received_s)
    return Estimate(moved.time_s, received_s, imm.correct(moved.modes, innovation), height), innovation.nis


def _outlier(track: Track, measurement: Measurement, settings: TrackSettings) -> Track:
    """Feed the rival; once enough outliers agree, it is the track."""
    rival = track.rival
    if rival is not None:
        rival = update(rival, measurement, settings)
    if rival is None or rival.outcome is not ReportOutcome.ACCEPTED:
        rival = _begun(Track(), measurement, settings)
    lasting_s = rival.history[-1].measurement.time_s - rival.history[0].measurement.time_s
    if len(rival.history) < settings.jump_reports and lasting_s < settings.jump_s:
        return _ended(replace(track, rival=rival), ReportOutcome.OUTLIER)
    return _ended(replace(track, history=rival.history, rival=None), ReportOutcome.JUMPED)


def _ended(track: Track, outcome: ReportOutcome) -> Track:
    return replace(track, outcome=outcome, counts=_counted(track, outcome))


def _counted(track: Track, outcome: ReportOutcome) -> Mapping[ReportOutcome, int]:
    return {**track.counts, outcome: track.counts.get(outcome, 0) + 1}
