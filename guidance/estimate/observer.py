"""Everything remembered of one evader, and how a report from the wire enters it: clock ▸ frame ▸ track."""

import math
from typing import NamedTuple

from guidance.estimate.clock_offset import ClockOffset, hear, synchronise
from guidance.estimate.evader_state import EvaderState, predict
from guidance.estimate.measurement import measure
from guidance.estimate.settings import TrackSettings
from guidance.estimate.track import Track, update
from guidance.frames import LocalFrame
from guidance.messages import EvaderReport, Timesync


class Observer(NamedTuple):
    """The sender's clock and the track. A new one knows nothing."""

    clock: ClockOffset | None = None
    track: Track = Track()


def observe(observer: Observer, report: EvaderReport, frame: LocalFrame, settings: TrackSettings) -> Observer:
    """Take in one report of the one evader, and the answer to our TIMESYNC that it may bring along."""
    if report.timesync is not None:
        observer = compare_clocks(observer, report.timesync)
    clock = hear(observer.clock, report.sent_s, report.received_s)
    measurement = measure(report, frame, _true_at(report, clock, settings), settings)
    return Observer(clock, update(observer.track, measurement, settings))


def compare_clocks(observer: Observer, answer: Timesync) -> Observer:
    """Take in the evader's own answer to our TIMESYNC."""
    clock = synchronise(observer.clock, answer.remote_ns / 1e9, answer.local_ns / 1e9, answer.received_s)
    return observer._replace(clock=clock)


def evader_at(observer: Observer, now_s: float, settings: TrackSettings) -> EvaderState | None:
    """The evader at a time of our clock; None before the first report."""
    return predict(observer.track, now_s, settings)


def _true_at(report: EvaderReport, clock: ClockOffset | None, settings: TrackSettings) -> float:
    """When the report was true: by its sender's clock where it has one, else by its arrival less the latency."""
    if math.isnan(report.sent_s) or clock is None:
        return report.received_s - settings.latency_s
    return clock.ours(report.sent_s) - (0.0 if clock.measured else settings.latency_s)
