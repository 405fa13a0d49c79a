"""The evader's track: reports in, passed in and out as a value; the evader at any time out, with its uncertainty.

What it offers:
    Observer: all that is remembered of the evader; a new one knows nothing. `Track` is its estimate, `TrackSettings`
        its noise and patience, `ClockOffset` what is known of the sender's clock.
    observe: takes in a report, with the answer to our TIMESYNC. compare_clocks: takes in the evader's own answer.
    update: takes in a `Measurement`; its `ReportOutcome` says whether it was used, and those in `TAKEN` were.
    predict: the evader at a time of our clock, an `EvaderState`.
    moved: all of it in another frame, after an estimator's reset.
"""

from guidance.estimation.measurement import ClockOffset, Measurement
from guidance.estimation.observer import EvaderState, Observer, compare_clocks, moved, observe, predict
from guidance.estimation.settings import TrackSettings
from guidance.estimation.track import TAKEN, ReportOutcome, Track, update

__all__ = [
    "TAKEN",
    "ClockOffset",
    "EvaderState",
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
