"""The evader's track. An `Observer` is the memory of one evader: `observe` adds a report, `predict` returns the evader.

A report passes clock (`measurement`), frame and track (`track`), and the detection of a second source (`rivals`). The
prediction, an `EvaderEstimate`, has position, velocity, speed bound, age and uncertainty at any time of our clock. If
the origin of the local frame moves, all positions move with it (`moved`) and their uncertainty stays the same.
"""

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from guidance.estimation.filters import EvaderEstimate, predict
from guidance.estimation.measurement import ClockOffset, TrackSettings, hear, measure, synchronise
from guidance.estimation.rivals import Report, Rivals, listen
from guidance.estimation.track import ReportOutcome, Track, update
from guidance.frames import LocalFrame, Vector, difference, total
from guidance.messages import EvaderReport

__all__ = ["EvaderEstimate", "Observer", "moved", "observe", "predict"]


class Observer(NamedTuple):
    """The sender's clock, the track, and the detection of a second source. Empty at first.

    Positions of the track are in the frame of the first report; `shift_ned_m` is added for the present local frame.
    """

    clock: ClockOffset | None = None
    track: Track = Track()
    rivals: Rivals = Rivals()
    shift_ned_m: Vector = (0.0, 0.0, 0.0)


_FITS: Final[Mapping[ReportOutcome | None, bool]] = {
    **dict.fromkeys((ReportOutcome.STARTED, ReportOutcome.ACCEPTED, ReportOutcome.REORDERED), True),
    **dict.fromkeys((ReportOutcome.OUTLIER, ReportOutcome.TOO_FAR, ReportOutcome.JUMPED), False),
}


def observe(
    observer: Observer, report: EvaderReport, frame: LocalFrame, settings: TrackSettings
) -> Observer:
    """Add one report, and the answer to our TIMESYNC if the report carries one.

    Args:
        observer: The memory so far.
        report: Plausible, as sources deliver it.
        frame: The vehicle's local frame, also the frame of the track.
        settings: Noise and limits of the track.
    """
    clock = observer.clock
    answer = report.timesync
    if answer is not None:
        clock = synchronise(clock, answer.remote_ns / 1e9, answer.local_ns / 1e9, answer.received_s)
    clock = hear(clock, report.sent_s, report.received_s)
    measurement = measure(report, frame, observer.shift_ned_m, clock, settings)
    track = update(observer.track, measurement, settings)
    if track.outcome is ReportOutcome.UNUSABLE:
        return observer._replace(clock=clock, track=track)
    one = Report(report, measurement, _FITS.get(track.outcome))
    return Observer(clock, track, listen(observer.rivals, one, settings), observer.shift_ned_m)


def moved(observer: Observer, into: Callable[[Vector], Vector]) -> Observer:
    """Return the memory for a new local frame.

    Args:
        observer: In the old frame.
        into: Converts a position from the old frame to the new one, metres. Both have the same axes.
    """
    history = observer.track.history
    if not history:
        return observer
    was = total(history[-1].measurement.position_ned_m, observer.shift_ned_m)
    return observer._replace(shift_ned_m=total(observer.shift_ned_m, difference(into(was), was)))
