"""The evader's track: reports in, passed in and out as a value; the evader at any time out, with its uncertainty."""

from guidance.estimate.clock_offset import ClockOffset
from guidance.estimate.evader_state import EvaderState, predict
from guidance.estimate.measurement import Measurement
from guidance.estimate.moving import moved
from guidance.estimate.observer import Observer, compare_clocks, evader_at, observe
from guidance.estimate.outcome import TAKEN, ReportOutcome
from guidance.estimate.settings import TrackSettings
from guidance.estimate.track import Track, update

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
    "evader_at",
    "moved",
    "observe",
    "predict",
    "update",
]
