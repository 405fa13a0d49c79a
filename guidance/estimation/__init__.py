"""The evader's track, a value: `observe` adds reports, `predict` returns the evader at any time with its uncertainty.

Contents:
    Observer: the memory of one evader. `Track` is its estimate, `TrackSettings` its noise and limits, `ClockOffset` the
        difference between the sender's clock and ours.
    observe: adds a report, with the answer to our TIMESYNC. compare_clocks: adds such an answer alone.
    update: adds a `Measurement` to a track. Its `ReportOutcome` is in `TAKEN` if it changed the estimate.
    predict: the evader at a time of our clock, an `EvaderEstimate`.
    moved: the same memory in another local frame, after an estimator reset.
"""

from guidance.estimation.measurement import ClockOffset, Measurement, TrackSettings
from guidance.estimation.observer import EvaderEstimate, Observer, compare_clocks, moved, observe, predict
from guidance.estimation.track import TAKEN, ReportOutcome, Track, update

__all__ = [
    "TAKEN",
    "ClockOffset",
    "EvaderEstimate",
    "Measurement",
    "Observer",
    "ReportOutcome",
    "Track",
    "TrackSettings",
    "compare_clocks",
    "moved",
    "observe",
    "predict",
    "update",
]
