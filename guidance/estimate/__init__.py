"""The target's track: reports in, passed in and out as a value; the target at any time out, with its uncertainty."""

from guidance.estimate.clock_offset import ClockOffset
from guidance.estimate.measurement import Measurement
from guidance.estimate.moving import moved
from guidance.estimate.observer import Observer, compare_clocks, observe, target_at
from guidance.estimate.outcome import TAKEN, Outcome
from guidance.estimate.settings import TrackSettings
from guidance.estimate.target_state import TargetState, predict
from guidance.estimate.track import Track, update

__all__ = [
    "TAKEN",
    "ClockOffset",
    "Measurement",
    "Observer",
    "Outcome",
    "TargetState",
    "Track",
    "TrackSettings",
    "compare_clocks",
    "moved",
    "observe",
    "predict",
    "target_at",
    "update",
]
