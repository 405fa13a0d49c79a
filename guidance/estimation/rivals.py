"""Does one evader speak, or two under one name? What a second one cannot help showing, whatever it claims.

Somebody who sends reports as the evader (a forger, or another vehicle with its identity) is not heard alone: the
evader goes on. So what is looked for is two tellings that take turns. They contradict each other

- in *place*: reports that do not fit the estimate, agree with each other, and come between those that fit, from where
  one evader cannot have got there meanwhile: one that lies about its velocity misses the estimate, but not its own way;
- by their *clock*: reports whose sender's clock is seconds away from the one believed, between those of that one;
- in *sequence*: MAVLink's numbers and the sender's time, of which one counts on and the other goes back;
- by who *sent* them, where the carrier tells (`EvaderReport.peer`);
- in *rate*, where a report has no time of its own: several times as many as there used to be.

One source that is late, doubled, out of order, silent for a while or that jumps once shows none of this. Whoever is
the wrong one is not to be told from reports.
"""

import itertools
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from guidance.messages import EvaderReport

LASTS_S: Final = 2.0
"""For so long after it was seen last a rival counts as there."""

_REACH_S: Final = 12.0
_MOST: Final = 256
_JUDGED_EVERY_S: Final = 0.2
_TURNS: Final = 3
_CLOCKS_APART_S: Final = 2.5
_CLOSE_S: Final = 0.1
_SAME_S: Final = 1e-3
_CONTRADICTIONS: Final = 6
_SENDERS_EACH: Final = 3
_RATE_WINDOW_S: Final = 2.0
_RATE_LEARNT_S: Final = 10.0
_RATE_MORE: Final = 2.5
_RATE_SPARE: Final = 4
_RATE_SPREAD: Final = 20


class Told(NamedTuple):
    """One report as it counts here.

    Attributes:
        received_s: On our clock.
        sent_s: On the sender's; NaN where it has none.
        true_s: When it was true, on our clock.
        place_m: North and east in the local frame.
        fits: Whether the estimate took it in; None where that says nothing of its place.
        apart_s: How far its sender's clock is from the one believed.
        sequence: MAVLink's number, None where there is none.
        peer: Who sent it; None where the carrier does not tell.
    """

    received_s: float
    sent_s: float
    true_s: float
    place_m: tuple[float, float]
    fits: bool | None
    apart_s: float
    sequence: int | None
    peer: str | None


class Rivals(NamedTuple):
    """What is remembered of how the evader's reports came.

    Attributes:
        recent: The last ones.
        judged_s: When they were last looked at.
        since_s: When the first one came.
        usual: How many came in two seconds at most, at the begin.
        seen_s: When two were last told from each other.
        why: By what.
    """

    recent: tuple[Told, ...] = ()
    judged_s: float = -math.inf
    since_s: float = math.nan
    usual: int = 0
    seen_s: float = -math.inf
    why: str = ""

    def there(self, now_s: float) -> bool:
        """Whether two tell of one evader now."""
        return now_s - self.seen_s <= LASTS_S


def told(
    report: EvaderReport, *, true_s: float, place_m: tuple[float, float], fits: bool | None, apart_s: float
) -> Told:
    """Make a report's entry.

    Args:
        report: As it came.
        true_s: When it was true, on our clock, s.
        place_m: North and east in the local frame.
        fits: Whether the estimate took it in.
        apart_s: How far its sender's clock is from the one believed, s.
    """
    return Told(report.received_s, report.sent_s, true_s, place_m, fits, apart_s, report.sequence, report.peer)


def listen(rivals: Rivals, one: Told, *, speed_m_s: float, margin_m: float, noise_m: float) -> Rivals:
    """Take in one report.

    Args:
        rivals: What is remembered.
        one: The report.
        speed_m_s: Reports agree whose places one evader of this speed can have been at,
        margin_m: give or take this.
        noise_m: Two reports of one place are not further apart.
    """
    now_s = one.received_s
    kept = (*rivals.recent[-_MOST + 1 :], one)
    if now_s - kept[0].received_s > _REACH_S:
        kept = tuple(each for each in kept if now_s - each.received_s <= _REACH_S)
    since_s = now_s if math.isnan(rivals.since_s) else rivals.since_s
    rivals = rivals._replace(recent=kept, since_s=since_s)
    if now_s - rivals.judged_s < _JUDGED_EVERY_S:
        return rivals
    rivals = _learnt(rivals._replace(judged_s=now_s), now_s)
    why = "place" if _in_place(rivals.recent, speed_m_s, margin_m, noise_m) else _why(rivals, now_s)
    return rivals if why is None else rivals._replace(seen_s=now_s, why=why)


def _why(rivals: Rivals, now_s: float) -> str | None:
    recent = rivals.recent
    if _by_clock(recent):
        return "clock"
    if _in_sequence(recent):
        return "sequence"
    if _by_sender(recent, now_s):
        return "sender"
    return "rate" if _in_rate(rivals, now_s) else None


def _turns(marks: Sequence[bool]) -> int:
    """How often False lies between True and True."""
    runs = [mark for index, mark in enumerate(marks) if index == 0 or mark is not marks[index - 1]]
    inner = runs[1:-1] if runs else []
    return sum(not mark for mark in inner)


def _in_place(recent: Sequence[Told], speed_m_s: float, margin_m: float, noise_m: float) -> bool:
    if sum(one.fits is False for one in recent) <= _TURNS:
        return False
    ordered = sorted((one for one in recent if one.fits is not None), key=lambda one: one.true_s)
    strangers = [one for one in ordered if not one.fits]
    agreeing = sum(_can_follow(one, other, speed_m_s, margin_m) for one, other in itertools.pairwise(strangers))
    return agreeing >= _TURNS and _leaps(ordered, speed_m_s, noise_m) >= _TURNS


def _leaps(ordered: Sequence[Told], speed_m_s: float, noise_m: float) -> int:
    """How often the telling goes over to those that do not fit, and back, by a leap at least one way."""
    leaps, out = 0, None
    for one, other in itertools.pairwise(ordered):
        if one.fits and not other.fits:
            out = not _can_follow(one, other, speed_m_s, noise_m)
        elif other.fits and not one.fits and out is not None:
            leaps += out or not _can_follow(one, other, speed_m_s, noise_m)
    return leaps


def _can_follow(one: Told, other: Told, speed_m_s: float, margin_m: float) -> bool:
    return math.dist(one.place_m, other.place_m) <= margin_m + speed_m_s * (other.true_s - one.true_s)


def _by_clock(recent: Sequence[Told]) -> bool:
    apart = [one for one in recent if abs(one.apart_s) > _CLOCKS_APART_S]
    return len(apart) >= _TURNS and _turns([abs(one.apart_s) <= _CLOCKS_APART_S for one in recent]) >= _TURNS


def _in_sequence(recent: Sequence[Told]) -> bool:
    if len({one.sequence for one in recent}) < 2:
        return False  # a sender whose number never changes does not count at all
    return sum(itertools.starmap(_contradict, itertools.pairwise(recent))) >= _CONTRADICTIONS


def _contradict(one: Told, other: Told) -> bool:
    """Whether of two reports that came close together numbers and times count in opposite ways."""
    if one.sequence is None or other.sequence is None:
        return False
    later_s = other.sent_s - one.sent_s
    if not (other.received_s - one.received_s <= _CLOSE_S and abs(later_s) <= _CLOSE_S):
        return False
    on = (other.sequence - one.sequence) % 256
    if abs(later_s) < _SAME_S:
        return on == 0 and other.place_m != one.place_m
    return on == 0 or (on < 128) is not (later_s > 0.0)


def _by_sender(recent: Sequence[Told], now_s: float) -> bool:
    peers = [one.peer for one in recent if one.peer and now_s - one.received_s <= LASTS_S]
    return sum(peers.count(peer) >= _SENDERS_EACH for peer in set(peers)) > 1


def _untimed(recent: Sequence[Told], now_s: float) -> list[float]:
    """When reports without a time of their own came lately."""
    return [one.received_s for one in recent if now_s - one.received_s < _RATE_WINDOW_S and math.isnan(one.sent_s)]


def _learnt(rivals: Rivals, now_s: float) -> Rivals:
    if now_s - rivals.since_s > _RATE_LEARNT_S:
        return rivals
    return rivals._replace(usual=max(rivals.usual, len(_untimed(rivals.recent, now_s))))


def _in_rate(rivals: Rivals, now_s: float) -> bool:
    if now_s - rivals.since_s <= _RATE_LEARNT_S or rivals.usual == 0:
        return False
    came_s = _untimed(rivals.recent, now_s)
    spread = 2 * len(set(came_s)) >= min(rivals.usual, _RATE_SPREAD)  # what waited in a queue comes all at once
    return spread and len(came_s) > _RATE_MORE * rivals.usual + _RATE_SPARE
