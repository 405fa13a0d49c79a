"""The evader's track, a value: `observe` adds reports, `predict` returns the evader at any time with its uncertainty.

Contents:
    Observer: the memory of one evader. `TrackSettings` has its noise and limits.
    observe: adds a report, with the answer to our TIMESYNC. `ReportOutcome` is what became of it.
    predict: the evader at a time of our clock, an `EvaderEstimate`.
    moved: the same memory in another local frame, after an estimator reset.
"""

from guidance.estimation.measurement import TrackSettings
from guidance.estimation.observer import EvaderEstimate, Observer, moved, observe, predict
from guidance.estimation.track import ReportOutcome

__all__ = [
    "EvaderEstimate",
    "Observer",
    "ReportOutcome",
    "TrackSettings",
    "moved",
    "observe",
    "predict",
]
