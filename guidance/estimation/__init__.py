"""The evader's track: reports in, passed in and out as a value; the evader at any time out, with its uncertainty."""

from guidance.estimation.clock_offset import ClockOffset
from guidance.estimation.measurement import Measurement
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
