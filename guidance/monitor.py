"""The value monitor: what was promised, watched in flight.

Under optimal play V + t never rises and L never falls, for the game's pursuer; for a vehicle that has to accelerate
first it is the certificate's `time_needed_s` and `assured_distance_m` that hold. If they do not, an assumption is
violated: the evader is faster than its bound, the vehicle slower than the game's, or what is known of the evader is
stale. It is reported, never acted upon. Crossing the barrier, after which the other player wins, is reported too, and
an evader of which nothing new is heard.

An alarm that always rings is none. What a promise moves by without any of that is allowed for:

- twice what accelerating costs by the promise, for a vehicle that has not answered yet, or has little to spare;
- what estimates scatter by, as the time that it takes to make good: `SCATTER_M` of position, and `SCATTER_M_S` of the
  evader's speed for as long as the game lasts, both over the closing speed;
- what lasts no longer than `LASTING_S`: the bound on the evader's speed jumps about by some per cent, which near the
  barrier decides who wins;
- the last `ARRIVAL_S`, in which the vehicle brakes to the evader's speed, as the game's pursuer does not;
- a source that is always so slow: an age of the last report that is not much more than any before it.
"""

import math
from enum import StrEnum
from typing import Final, NamedTuple

from guidance.certificate import Certificate
from guidance.game import Reason, Winner

SCATTER_M: Final = 1.0
SCATTER_M_S: Final = 0.05
LASTING_S: Final = 0.4
ARRIVAL_S: Final = 1.5
STALE_S: Final = 1.0
STALER: Final = 1.5
"""A report is stale from `STALE_S` on, and from this many times the largest age before."""


class Violation(StrEnum):
    """What of the promise did not hold."""

    CAPTURE_LATER = "guarantee: the time of capture has risen"
    EVADER_CLOSER = "guarantee: the evader's final distance to its target has fallen"
    BARRIER_LOST = "barrier: the evader can now reach its target"
    BARRIER_WON = "barrier: the evader can no longer reach its target"
    STALE = "guarantee: nothing new is heard of the evader"


_UNITS: Final = {
    Violation.CAPTURE_LATER: "s",
    Violation.EVADER_CLOSER: "m",
    Violation.STALE: "s",
}


class Alarm(NamedTuple):
    """What was broken and by how much: s of the time of capture or of age, m of L, nothing for the barrier."""

    violation: Violation
    amount: float

    @property
    def by(self) -> str:
        """By how much, with its unit; empty for the barrier."""
        unit = _UNITS.get(self.violation)
        return "" if unit is None else f"{self.amount:.2f} {unit}"

    @property
    def words(self) -> str:
        """What and by how much, in one line."""
        return f"{self.violation}, {self.by}" if self.by else str(self.violation)


class MonitorMemory(NamedTuple):
    """Memory of the watch.

    Attributes:
        best: The best promise since the last alarm: least time, or largest L turned around.
        winner: Who was winning.
        since_s: Since when less than that is promised, or the other one wins; None while all is well.
        oldest_s: The largest age of a report that has been said.
    """

    best: float = math.nan
    winner: int | None = None
    since_s: float | None = None
    oldest_s: float = 0.0


def watch(
    memory: MonitorMemory,
    now_s: float,
    certificate: Certificate,
    *,
    with_target: bool,
    speed_m_s: float,
    slack_s: float,
) -> tuple[MonitorMemory, Alarm | None]:
    """Compare this cycle's certificate with the best before it.

    Args:
        memory: From the last call; `MonitorMemory()` at engagement.
        now_s: Time of the injected clock.
        certificate: This cycle's; one without a game is passed over.
        with_target: Whether the game is TAD.
        speed_m_s: The pursuer's in the game, over ground.
        slack_s: How much may be lost besides what is allowed for, s; in TAD, the evader's way in that time. After an
            alarm the count starts anew.

    Returns:
        The memory for the next call and the alarm, if there is one.
    """
    if certificate.winner == Winner.UNDECIDED or math.isnan(certificate.value):
        return memory, None
    age_s = certificate.evader_age_s
    if age_s > max(STALE_S, STALER * memory.oldest_s):
        return memory._replace(oldest_s=age_s), Alarm(Violation.STALE, age_s)
    if certificate.reason == Reason.TOO_OLD:  # no guarantee to watch: that begins anew with news
        memory, certificate = MonitorMemory(oldest_s=memory.oldest_s), certificate._replace(meeting_time_s=0.0)
    if with_target and memory.winner not in {None, certificate.winner}:
        return _crossed(memory, now_s, certificate.winner)
    memory = memory._replace(winner=certificate.winner)
    if (with_target and certificate.winner == Winner.EVADER) or certificate.meeting_time_s < ARRIVAL_S:
        return memory._replace(since_s=None), None
    cost, slack = _watched(now_s, certificate, speed_m_s, slack_s, with_target=with_target)
    memory, lost = _compare(memory, now_s, cost, slack)
    if lost is None:
        return memory, None
    return memory, Alarm(Violation.EVADER_CLOSER if with_target else Violation.CAPTURE_LATER, lost)


def _crossed(memory: MonitorMemory, now_s: float, winner: int) -> tuple[MonitorMemory, Alarm | None]:
    memory = _since(memory, now_s)
    if not _lasts(memory, now_s):
        return memory, None
    violation = Violation.BARRIER_LOST if winner == Winner.EVADER else Violation.BARRIER_WON
    return MonitorMemory(winner=winner, oldest_s=memory.oldest_s), Alarm(violation, 0.0)


def _compare(memory: MonitorMemory, now_s: float, cost: float, slack: float) -> tuple[MonitorMemory, float | None]:
    """Hold a cost against the best before it; return what was lost once more than the slack is, for long enough."""
    lost = cost - memory.best
    if not lost > slack:
        return memory._replace(best=cost if math.isnan(lost) else min(cost, memory.best), since_s=None), None
    memory = _since(memory, now_s)
    return (memory._replace(best=cost, since_s=None), lost) if _lasts(memory, now_s) else (memory, None)


def _since(memory: MonitorMemory, now_s: float) -> MonitorMemory:
    return memory if memory.since_s is not None else memory._replace(since_s=now_s)


def _lasts(memory: MonitorMemory, now_s: float) -> bool:
    return memory.since_s is not None and now_s - memory.since_s >= LASTING_S


def _watched(
    now_s: float, certificate: Certificate, speed_m_s: float, slack_s: float, *, with_target: bool
) -> tuple[float, float]:
    """Return what must not rise, with what accelerating costs taken twice, and how much of that may be lost.

    It is the time of capture, s; or, in m, L turned around, and for each second the evader's way in it.
    """
    evader_m_s = speed_m_s / certificate.speed_ratio
    scatter_m = SCATTER_M + SCATTER_M_S * certificate.meeting_time_s
    slack_s += scatter_m / (speed_m_s - evader_m_s)
    if with_target:
        return certificate.value - 2.0 * certificate.assured_distance_m, slack_s * evader_m_s
    return 2.0 * certificate.time_needed_s - certificate.value + now_s, slack_s
