"""Judges whether the stamps of an evader's reports come from a clock: it must run about as fast as ours.

Some senders stamp every report alike, count reports, use another unit, or run in a simulation at another speed. Their
stamps do not tell when a report was true, so the arrival times are used instead.

The rate compares a report with one that arrived about a second earlier. It is strange for a moment after a sender has
restarted, after one corrupt stamp and within a burst from a queue, so only a rate that stays strange counts. A clock
that has run well for a while is given up later: a delay that grows looks like a slow clock, and arrival times would
then hide the delay.
"""

import math
from typing import Final, NamedTuple

SLOWEST: Final = 0.8
FASTEST: Final = 1.25
"""Plausible rates, seconds of the sender per second of ours."""

_BASELINE_S: Final = 1.0
_APART_S: Final = 0.09
_GIVEN_UP_AFTER_S: Final = 1.5
_PROVEN_GIVEN_UP_AFTER_S: Final = 10.0
_GIVEN_UP_REPORTS: Final = 3
_PROVEN_AFTER_S: Final = 3.0
_FORGOTTEN_AFTER_S: Final = 5.0


class Stamp(NamedTuple):
    """A report's time on its sender's clock, and on ours."""

    sent_s: float
    received_s: float


class PaceMemory(NamedTuple):
    """The memory of the judgement.

    Attributes:
        usable: Whether the stamps are believed.
        proven: Whether the clock has run well for `_PROVEN_AFTER_S`.
        rate: The last measured rate, seconds of the sender per second of ours; NaN before the first one.
        recent: Stamps of the last second or so, oldest first.
        strange_since_s: Arrival of the first report of a row of strange rates; NaN after a plausible one.
        strange_reports: Number of reports in that row.
        plausible_since_s: Arrival of the first report of a row of plausible rates; NaN after a strange one.
    """

    usable: bool = True
    proven: bool = False
    rate: float = math.nan
    recent: tuple[Stamp, ...] = ()
    strange_since_s: float = math.nan
    strange_reports: int = 0
    plausible_since_s: float = math.nan


def judge_pace(pace: PaceMemory, sent_s: float, received_s: float) -> PaceMemory:
    """Add the two times of a report. Reports without a stamp (NaN) change nothing.

    Args:
        pace: The memory so far.
        sent_s: The report's stamp, seconds of the sender's clock.
        received_s: Its arrival, seconds of ours.
    """
    if not math.isfinite(sent_s):
        return pace
    stamp = Stamp(sent_s, received_s)
    if pace.recent and received_s - pace.recent[-1].received_s > _FORGOTTEN_AFTER_S:
        return PaceMemory(usable=pace.usable, rate=pace.rate, recent=(stamp,))
    earlier = [past for past in pace.recent if received_s - past.received_s >= _BASELINE_S]
    recent = pace.recent
    if not recent or received_s - recent[-1].received_s >= _APART_S:
        recent = (*earlier[-1:], *recent[len(earlier) :], stamp)
    if not earlier:
        return pace._replace(recent=recent)
    rate = (sent_s - earlier[-1].sent_s) / (received_s - earlier[-1].received_s)
    judged = pace._replace(rate=rate, recent=recent)
    if SLOWEST <= rate <= FASTEST:
        since_s = judged.plausible_since_s
        if math.isnan(since_s):
            since_s = received_s
        lasting = received_s - since_s >= _PROVEN_AFTER_S
        return judged._replace(
            usable=judged.usable or lasting,
            proven=judged.proven or lasting,
            strange_since_s=math.nan,
            strange_reports=0,
            plausible_since_s=since_s,
        )
    since_s = judged.strange_since_s
    if math.isnan(since_s):
        since_s = received_s
    reports = judged.strange_reports + 1
    limit_s = _PROVEN_GIVEN_UP_AFTER_S if judged.proven else _GIVEN_UP_AFTER_S
    given_up = received_s - since_s >= limit_s and reports >= _GIVEN_UP_REPORTS
    return judged._replace(
        usable=judged.usable and not given_up,
        proven=judged.proven and not given_up,
        strange_since_s=since_s,
        strange_reports=reports,
        plausible_since_s=math.nan,
    )
