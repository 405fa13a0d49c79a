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


class Report(NamedTuple):
    """What the detection needs of one report.

    Attributes:
        told: As it arrived.
        measured: The same in the local frame, on our clock.
        fits: Whether the estimate accepted it; None if the outcome says nothing about its place.
    """

    told: EvaderReport
    measured: Measurement
    fits: bool | None


class Rivals(NamedTuple):
    """The memory of the detection.

    Attributes:
        recent: The last reports.
        judged_s: When they were last judged.
        since_s: When the first report arrived.
        usual: The largest number of reports of one source in two seconds, during the first seconds.
        odd_s: When a report last arrived that may be another source's. Without one, there is nothing to judge.
        seen_s: When two sources were last detected.
        why: The kind of contradiction, as in the module's list.
    """

    recent: tuple[Report, ...] = ()
    judged_s: float = -math.inf
    since_s: float = math.nan
    usual: int = 0
    odd_s: float = -math.inf
    seen_s: float = -math.inf
    why: str = ""

    def there(self, now_s: float) -> bool:
        """Return whether a second source is present."""
        return now_s - self.seen_s <= LASTS_S


def listen(rivals: Rivals, one: Report, settings: TrackSettings) -> Rivals:
    """Add one report and judge. Two reports agree if one evader of twice the declared speed can reach both places."""
    now_s = one.told.received_s
    recent = (*rivals.recent[-_MAX_REPORTS + 1 :], one)
    odd_s = now_s if _is_odd(recent[-2:][0], one) else rivals.odd_s
    since_s = now_s if math.isnan(rivals.since_s) else rivals.since_s
    if now_s - rivals.judged_s < _JUDGE_EVERY_S:
        return rivals._replace(recent=recent, odd_s=odd_s)
    recent = tuple([each for each in recent if now_s - each.told.received_s <= _WINDOW_S])
    learning = now_s - since_s <= _RATE_LEARNED_S
    usual = max(rivals.usual, len(_untimed(recent, now_s))) if learning else rivals.usual
    rivals = Rivals(recent, now_s, since_s, usual, odd_s, rivals.seen_s, rivals.why)
    if now_s - odd_s > _WINDOW_S:
        return rivals
    why = next((sign for sign, shows in _SIGNS.items() if shows(rivals, now_s, settings)), None)
    return rivals if why is None else rivals._replace(seen_s=now_s, why=why)


def _is_odd(before: Report, one: Report) -> bool:
    """Return whether a report, after the one before it, can count as a sign of a second source."""
    told = one.told
    last = before.told
    strange = (
        one.fits is False
        or abs(told.received_s - one.measured.time_s) > _CLOCKS_APART_S
        or bool(told.impostors)
    )
    return strange or math.isnan(told.sent_s) or told.peer != last.peer or _contradict(last, told)


def _in_place(recent: Sequence[Report], settings: TrackSettings) -> bool:
    if sum(one.fits is False for one in recent) <= _TURNS:
        return False
    ordered = sorted(
        (one for one in recent if one.fits is not None), key=lambda one: one.measured.time_s
    )
    speed_m_s = 2.0 * settings.declared_speed_m_s
    margin_m = settings.reach_m
    noise_m = _NOISE_SIGMAS * math.hypot(settings.position_sd_m, settings.position_sd_m)
    strangers = [one for one in ordered if not one.fits]
    agreeing = sum(
        _can_follow(one, other, speed_m_s, margin_m) for one, other in itertools.pairwise(strangers)
    )
    return agreeing >= _TURNS and _leaps(ordered, speed_m_s, noise_m) >= _TURNS


def _leaps(ordered: Sequence[Report], speed_m_s: float, noise_m: float) -> int:
    """Count changes to reports that do not fit and back, with an impossible step in at least one direction."""
    leaps = 0
    out = None
    for one, other in itertools.pairwise(ordered):
        if one.fits and not other.fits:
            out = not _can_follow(one, other, speed_m_s, noise_m)
        elif other.fits and not one.fits and out is not None:
            leaps += out or not _can_follow(one, other, speed_m_s, noise_m)
    return leaps


def _can_follow(one: Report, other: Report, speed_m_s: float, margin_m: float) -> bool:
    far_m = math.dist(one.measured.position_ned_m[:2], other.measured.position_ned_m[:2])
    return far_m <= margin_m + speed_m_s * (other.measured.time_s - one.measured.time_s)


def _in_clock(recent: Sequence[Report]) -> bool:
    ages_s = (one.told.received_s - one.measured.time_s for one in recent)
    runs = [
        apart for apart, _ in itertools.groupby(abs(age_s) > _CLOCKS_APART_S for age_s in ages_s)
    ]
    return sum(runs[1:-1]) >= _TURNS


def _in_sequence(recent: Sequence[Report]) -> bool:
    if len({one.told.sequence for one in recent}) < 2:
        return False  # the sender does not count
    return (
        sum(_contradict(one.told, other.told) for one, other in itertools.pairwise(recent))
        >= _CONTRADICTIONS
    )


def _contradict(one: EvaderReport, other: EvaderReport) -> bool:
    """Return whether frame number and time of two close reports change in opposite directions."""
    if one.sequence is None or other.sequence is None:
        return False
    later_s = other.sent_s - one.sent_s
    if not (other.received_s - one.received_s <= _CLOSE_S and abs(later_s) <= _CLOSE_S):
        return False
    on = (other.sequence - one.sequence) % 256
    if abs(later_s) < _SAME_S:
        return on == 0 and (other.latitude_deg, other.longitude_deg) != (
            one.latitude_deg,
            one.longitude_deg,
        )
    return on == 0 or (on < 128) is not (later_s > 0.0)


def _in_sender(recent: Sequence[Report], now_s: float) -> bool:
    """Return whether the sender changes to and fro; a sender that restarts changes once."""
    lately = [one.told for one in recent if now_s - one.told.received_s <= _SENDER_WINDOW_S]
    changes = sum(
        bool(one.peer and other.peer and one.peer != other.peer)
        for one, other in itertools.pairwise(lately)
    )
    return changes >= _SENDER_CHANGES or sum(bool(one.impostors) for one in lately) >= _TURNS


def _untimed(recent: Sequence[Report], now_s: float) -> list[float]:
    """Return the arrivals of the latest reports without a time of their own, of the source that sends most."""
    arrivals_s: dict[str, list[float]] = {}
    for report in recent:
        told = report.told
        if now_s - told.received_s < _RATE_WINDOW_S and math.isnan(told.sent_s):
            arrivals_s.setdefault(told.source, []).append(told.received_s)
    return max(arrivals_s.values(), key=len, default=[])


def _in_rate(rivals: Rivals, now_s: float) -> bool:
    if now_s - rivals.since_s <= _RATE_LEARNED_S or rivals.usual == 0:
        return False
    arrivals_s = _untimed(rivals.recent, now_s)
    # A queue delivers everything at once
    spread = 2 * len(set(arrivals_s)) >= min(rivals.usual, _RATE_SPREAD)
    return spread and len(arrivals_s) > _RATE_FACTOR * rivals.usual + _RATE_SPARE


_SIGNS: Final[Mapping[str, Callable[[Rivals, float, TrackSettings], bool]]] = {
    "place": lambda rivals, _, settings: _in_place(rivals.recent, settings),
    "clock": lambda rivals, *_: _in_clock(rivals.recent),
    "sequence": lambda rivals, *_: _in_sequence(rivals.recent),
    "sender": lambda rivals, now_s, _: _in_sender(rivals.recent, now_s),
    "rate": lambda rivals, now_s, _: _in_rate(rivals, now_s),
}
