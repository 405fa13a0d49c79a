"""The evader's track. `Observer` is the memory of one evader: `add_report` adds to it, `predict` returns the evader.

A report passes the judgement of its stamp (`pace`), clock and frame (`measurement`), the comparison of its velocity
with the positions (`velocity_check`), the track (`track`), and the detection of a second source (`rivals`). The
prediction, an `EvaderEstimate`, has position, velocity, speed bound, age and uncertainty at any time of our clock. If
the origin of the local frame moves, all positions move with it (`in_new_frame`) and their uncertainty stays the same.
"""

import math
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from guidance.estimation.filters import EvaderEstimate, predict
from guidance.estimation.measurement import ClockOffset, TrackSettings, hear, measure, synchronise
from guidance.estimation.pace import PaceMemory, judge_pace
from guidance.estimation.rivals import SourceMemory, SourceReport, listen
from guidance.estimation.track import ReportOutcome, Track, update
from guidance.estimation.velocity_check import VelocityCheck, check_velocity
from guidance.frames import STILL, LocalFrame, Ned
from guidance.messages import EvaderReport

__all__ = ["EvaderEstimate", "Observer", "add_report", "in_new_frame", "predict"]


class Observer(NamedTuple):
    """The sender's clock, the track, and the checks of the reports. Empty at first.

    Attributes:
        clock: The sender's clock; None before the first usable stamp.
        track: Positions are in the frame of the first report.
        rivals: The detection of a second source.
        shift_ned_m: Added to positions of the track for the present local frame.
        pace: Whether the stamps are usable.
        velocity_check: Whether the reported velocities are believed.
    """

    clock: ClockOffset | None = None
    track: Track = Track()
    rivals: SourceMemory = SourceMemory()
    shift_ned_m: Ned = STILL
    pace: PaceMemory = PaceMemory()
    velocity_check: VelocityCheck = VelocityCheck()


_FITS: Final[Mapping[ReportOutcome | None, bool]] = {
    **dict.fromkeys((ReportOutcome.STARTED, ReportOutcome.ACCEPTED, ReportOutcome.REORDERED), True),
    **dict.fromkeys((ReportOutcome.OUTLIER, ReportOutcome.TOO_FAR, ReportOutcome.JUMPED), False),
}


def add_report(
    observer: Observer, report: EvaderReport, frame: LocalFrame, settings: TrackSettings
) -> Observer:
    """Add one report, and the answer to our TIMESYNC if the report carries one.

    Args:
        observer: The memory so far.
        report: Plausible, as sources deliver it.
        frame: The vehicle's local frame, also the frame of the track.
        settings: Noise and limits of the track.
    """
    pace = judge_pace(observer.pace, report.sent_s, report.received_s)
    clock = None
    if pace.usable:
        clock = observer.clock
        answer = report.timesync
        if answer is not None:
            clock = synchronise(
                clock, answer.remote_ns / 1e9, answer.local_ns / 1e9, answer.received_s
            )
        clock = hear(clock, report.sent_s, report.received_s)
    else:
        report = report._replace(sent_s=math.nan, timesync=None)
    measurement = measure(report, frame, observer.shift_ned_m, clock, settings)
    used = measurement
    if not observer.velocity_check.believed:
        used = measurement._replace(velocity_ned_m_s=None)
    track = update(observer.track, used, settings)
    if track.outcome is ReportOutcome.UNUSABLE:
        return observer._replace(clock=clock, track=track, pace=pace)
    fits = _FITS.get(track.outcome)
    velocity_check = observer.velocity_check
    if fits:
        velocity_check = check_velocity(velocity_check, measurement)
    rivals = listen(observer.rivals, SourceReport(report, used, fits), settings)
    return Observer(clock, track, rivals, observer.shift_ned_m, pace, velocity_check)


def in_new_frame(observer: Observer, into: Callable[[Ned], Ned]) -> Observer:
    """Return the memory for a new local frame.

    Args:
        observer: In the old frame.
        into: Converts a position from the old frame to the new one, metres. Both have the same axes.
    """
    history = observer.track.history
    if not history:
        return observer
    was = history[-1].measurement.position_ned_m + observer.shift_ned_m
    return observer._replace(shift_ned_m=observer.shift_ned_m + (into(was) - was))
