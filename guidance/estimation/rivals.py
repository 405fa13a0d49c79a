"""Detects a second source of the evader's reports: a forger, or another vehicle with the same identity.

The true evader keeps reporting, so two sources take turns. They contradict each other

- in *place*: some reports do not fit the estimate, agree with each other, and alternate with fitting ones from places
  that one evader cannot reach in between. (A single source with a wrong velocity also misses the estimate, but not its
  own path.)
- in *clock*: some senders' clocks are seconds away from the believed one, in alternation with it;
- in *sequence*: of MAVLink's frame numbers and the sender's time, one increases and the other decreases;
- in *sender*: the carrier names two senders (`EvaderReport.peer`), or counts messages from another address
  (`EvaderReport.impostors`), in alternation;
- in *rate*, if reports have no time of their own: one source sends several times as many as the busiest at first.
  Vehicles of a team that relay the same evader are one source each.

One source that is late, duplicated, reordered, silent for a while, or jumps once is not detected as two. Reports cannot
show which of two sources is the wrong one.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

from guidance.estimation.measurement import Measurement, TrackSettings
from guidance.messages import EvaderReport

LASTS_S: Final = 2.0
"""A second source counts as present for this long after it was last detected."""

_WINDOW_S: Final = 12.0
_MAX_REPORTS: Final = 256
_JUDGE_EVERY_S: Final = 0.2
_TURNS: Final = 3
_CLOCKS_APART_S: Final = 2.5
_CLOSE_S: Final = 0.1
_SAME_S: Final = 1e-3
_CONTRADICTIONS: Final = 6
_SENDER_WINDOW_S: Final = 4.0
_SENDER_CHANGES: Final = 4
_RATE_WINDOW_S: Final = 2.0
_RATE_LEARNED_S: Final = 10.0
_RATE_FACTOR: Final = 2.5
_RATE_SPARE: Final = 4
_RATE_SPREAD: Final = 20
_NOISE_SIGMAS: Final = 3.0


class SourceReport(NamedTuple):
    """The parts of one report that the detection needs.

    Attributes:
        arrived: As it came.
        measured: The same in the local frame, on our clock.
        fits: Whether the estimate accepted it; None if the outcome says nothing about its place.
        is_copy: Whether the same report has arrived before. Its stamp may be of a clock that has jumped since.
    """

    arrived: EvaderReport
    measured: Measurement
    fits: bool | None
    is_copy: bool = False


class SourceMemory(NamedTuple):
    """The memory of the detection.

    Attributes:
        recent: The last reports.
        judged_s: When they were last judged.
        since_s: When the first report arrived.
        usual: The largest number of reports of one source in two seconds, during the first seconds.
        odd_s: When a report last arrived that may be another source's. Without one, there is nothing to judge.
        seen_s: When two sources were last detected.
        why: The kind of contradiction, as in the module's list.
        newest_sent_s: The newest stamp so far. A report with a newer one is no copy.
    """

    recent: tuple[SourceReport, ...] = ()
    judged_s: float = -math.inf
    since_s: float = math.nan
    usual: int = 0
    odd_s: float = -math.inf
    seen_s: float = -math.inf
    why: str = ""
    newest_sent_s: float = -math.inf

    def there(self, now_s: float) -> bool:
        """Return whether a second source is present."""
        return now_s - self.seen_s <= LASTS_S


def listen(rivals: SourceMemory, report: SourceReport, settings: TrackSettings) -> SourceMemory:
    """Add one report and judge. Two reports agree if one evader of twice the declared speed can reach both places."""
    now_s = report.arrived.received_s
    sent_s = report.arrived.sent_s
    newest_sent_s = max(rivals.newest_sent_s, sent_s)
    if not sent_s > rivals.newest_sent_s:
        has_arrived = any(
            past.arrived.sent_s == sent_s
            and past.arrived.latitude_deg == report.arrived.latitude_deg
            and past.arrived.longitude_deg == report.arrived.longitude_deg
            for past in rivals.recent
        )
        report = report._replace(is_copy=has_arrived)
    recent = (*rivals.recent[-_MAX_REPORTS + 1 :], report)
    # A report, after the one before it, can count as a sign of a second source.
    before = recent[-2:][0]
    arrived = report.arrived
    is_odd = (
        report.fits is False
        or arrived.impostors
        or math.isnan(arrived.sent_s)
        or _is_apart(report)
        or arrived.peer != before.arrived.peer
        or _contradict(before.arrived, arrived)
    )
    odd_s = now_s if is_odd else rivals.odd_s
    since_s = now_s if math.isnan(rivals.since_s) else rivals.since_s
    if now_s - rivals.judged_s < _JUDGE_EVERY_S:
        return rivals._replace(recent=recent, odd_s=odd_s, newest_sent_s=newest_sent_s)
    recent = tuple([past for past in recent if now_s - past.arrived.received_s <= _WINDOW_S])
    learning = now_s - since_s <= _RATE_LEARNED_S
    usual = max(rivals.usual, len(_untimed(recent, now_s))) if learning else rivals.usual
    rivals = SourceMemory(
        recent, now_s, since_s, usual, odd_s, rivals.seen_s, rivals.why, newest_sent_s
    )
    if now_s - odd_s > _WINDOW_S:
        return rivals
    for sign, shows in _SIGNS.items():
        if shows(rivals, now_s, settings):
            return rivals._replace(seen_s=now_s, why=sign)
    return rivals


def _is_apart(report: SourceReport) -> bool:
    return abs(report.arrived.received_s - report.measured.time_s) > _CLOCKS_APART_S


def _in_place(recent: Sequence[SourceReport], settings: TrackSettings) -> bool:
    if sum(report.fits is False for report in recent) <= _TURNS:
        return False
    placed = [report for report in recent if report.fits is not None]
    ordered = sorted(placed, key=lambda report: report.measured.time_s)
    speed_m_s = 2.0 * settings.declared_speed_m_s
    margin_m = settings.reach_m
    noise_m = _NOISE_SIGMAS * math.hypot(settings.position_sd_m, settings.position_sd_m)
    strangers = [report for report in ordered if not report.fits]
    agreeing = sum(
        _can_follow(earlier, later, speed_m_s, margin_m)
        for earlier, later in itertools.pairwise(strangers)
    )
    # Changes to reports that do not fit and back, with an impossible step in at least one direction.
    leaps = 0
    leapt_away = None
    for earlier, later in itertools.pairwise(ordered):
        reachable = _can_follow(earlier, later, speed_m_s, noise_m)
        if earlier.fits and not later.fits:
            leapt_away = not reachable
        elif later.fits and not earlier.fits and leapt_away is not None:
            leaps += leapt_away or not reachable
    return agreeing >= _TURNS and leaps >= _TURNS


def _can_follow(
    earlier: SourceReport, later: SourceReport, speed_m_s: float, margin_m: float
) -> bool:
    before = earlier.measured
    after = later.measured
    distance_m = math.dist(before.position_ned_m[:2], after.position_ned_m[:2])
    return distance_m <= margin_m + speed_m_s * (after.time_s - before.time_s)


def _in_clock(recent: Sequence[SourceReport]) -> bool:
    are_apart = [_is_apart(report) for report in recent if not report.is_copy]
    runs = [is_apart for is_apart, _ in itertools.groupby(are_apart)]
    return sum(runs[1:-1]) >= _TURNS


def _in_sequence(recent: Sequence[SourceReport]) -> bool:
    if len({report.arrived.sequence for report in recent}) < 2:
        return False  # the sender does not count
    contradictions = sum(
        _contradict(earlier.arrived, later.arrived) for earlier, later in itertools.pairwise(recent)
    )
    return contradictions >= _CONTRADICTIONS


def _contradict(first: EvaderReport, second: EvaderReport) -> bool:
    """Return whether frame number and time of two close reports change in opposite directions."""
    if first.sequence is None or second.sequence is None:
        return False
    later_s = second.sent_s - first.sent_s
    if not (second.received_s - first.received_s <= _CLOSE_S and abs(later_s) <= _CLOSE_S):
        return False
    frames = (second.sequence - first.sequence) % 256
    if abs(later_s) < _SAME_S:
        first_deg = (first.latitude_deg, first.longitude_deg)
        second_deg = (second.latitude_deg, second.longitude_deg)
        return frames == 0 and first_deg != second_deg
    return frames == 0 or (frames < 128) is not (later_s > 0.0)


def _in_sender(recent: Sequence[SourceReport], now_s: float) -> bool:
    """Return whether the sender changes to and fro; a sender that restarts changes once."""
    reports = [
        past.arrived for past in recent if now_s - past.arrived.received_s <= _SENDER_WINDOW_S
    ]
    changes = sum(
        bool(earlier.peer and later.peer and earlier.peer != later.peer)
        for earlier, later in itertools.pairwise(reports)
    )
    beside_others = sum(bool(report.impostors) for report in reports)
    return changes >= _SENDER_CHANGES or beside_others >= _TURNS


def _untimed(recent: Sequence[SourceReport], now_s: float) -> list[float]:
    """Return the arrivals of the latest reports without a time of their own, of the source that sends most."""
    arrivals_s: dict[str, list[float]] = {}
    for report in recent:
        arrived = report.arrived
        if now_s - arrived.received_s < _RATE_WINDOW_S and math.isnan(arrived.sent_s):
            arrivals_s.setdefault(arrived.source, []).append(arrived.received_s)
    return max(arrivals_s.values(), key=len, default=[])


def _in_rate(rivals: SourceMemory, now_s: float) -> bool:
    if now_s - rivals.since_s <= _RATE_LEARNED_S or rivals.usual == 0:
        return False
    arrivals_s = _untimed(rivals.recent, now_s)
    # A queue delivers everything at once
    if 2 * len(set(arrivals_s)) < min(rivals.usual, _RATE_SPREAD):
        return False
    return len(arrivals_s) > _RATE_FACTOR * rivals.usual + _RATE_SPARE


_SIGNS: Final[Mapping[str, Callable[[SourceMemory, float, TrackSettings], bool]]] = {
    "place": lambda rivals, _, settings: _in_place(rivals.recent, settings),
    "clock": lambda rivals, *_: _in_clock(rivals.recent),
    "sequence": lambda rivals, *_: _in_sequence(rivals.recent),
    "sender": lambda rivals, now_s, _: _in_sender(rivals.recent, now_s),
    "rate": lambda rivals, now_s, _: _in_rate(rivals, now_s),
}
