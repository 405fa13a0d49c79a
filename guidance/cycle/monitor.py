"""The value monitor: compares the promises of the certificate with those made before.

Under optimal play V + t never rises and L never falls. For this vehicle that holds of `time_needed_s` and
`assured_distance_m`. If it does not, an assumption is wrong: the evader is faster than its bound, the vehicle slower
than the game's pursuer, or the evader's reports are old. Or the evader has turned: `time_needed_s` does not count that
the vehicle turns again. Alarms are reported and never acted upon.

A promise may change without any of that. This much is allowed before an alarm:

- the certificate's own `allowance`: a vehicle that has just been ordered to accelerate has not answered yet;
- estimation errors, `SCATTER_M` of position and `SCATTER_M_S` of the evader's speed for the rest of the game, divided
  by the closing speed;
- changes that last less than `LASTING_S`: the bound on the evader's speed varies by some per cent;
- the last `ARRIVAL_S` before the meeting, while the vehicle brakes to the evader's speed;
- reports that are always late: an age not much larger than the largest before.

A vehicle that does not reach its configured speed is reported once, and the promise starts anew with the speed that it
reaches. In TAD the barrier is reported: lost when the game's pursuer would lose, won when this vehicle has
won for `GUARDED_S`.
"""

import math
from enum import StrEnum
from typing import Final, NamedTuple

from guidance.cycle.certificate import Certificate
from guidance.game import Reason, Winner

SCATTER_M: Final = 1.0
SCATTER_M_S: Final = 0.05
LASTING_S: Final = 0.4
GUARDED_S: Final = 1.5
"""The barrier counts as won once the vehicle's verdict has lasted for so long: a braking vehicle turns in that time."""

ARRIVAL_S: Final = 1.5
REPORT_STALE_S: Final = 1.0
STALER: Final = 1.5
"""A report is stale if it is older than `REPORT_STALE_S` and than this many times the largest age before."""

SLOWER: Final = 0.02
"""Least relative fall of the reachable speed that makes the promise start anew."""


class Violation(StrEnum):
    """Which promise or assumption does not hold."""

    CAPTURE_LATER = "guarantee: the time of capture has risen"
    EVADER_CLOSER = "guarantee: the evader's final distance to its target has fallen"
    BARRIER_LOST = "barrier: the evader can now reach its target"
    BARRIER_WON = "barrier: the evader can no longer reach its target"
    STALE = "guarantee: nothing new is heard of the evader"
    TOO_SLOW = "vehicle: slower than game.speed_m_s"


class Alarm(NamedTuple):
    """A broken promise or assumption, and its amount.

    `amount` is in s for the time of capture and for an age, in m for L, in m/s for a speed; 0 at the barrier. `of` is
    the configured speed where the vehicle is too slow.
    """

    violation: Violation
    amount: float
    of: float = math.nan

    @property
    def by(self) -> str:
        """The amount with its unit; empty at the barrier."""
        if self.violation is Violation.TOO_SLOW:
            return f"this vehicle reaches {self.amount:.1f} of {self.of:g} m/s now"
        units = {Violation.CAPTURE_LATER: "s", Violation.STALE: "s", Violation.EVADER_CLOSER: "m"}
        return f"{self.amount:.2f} {units[self.violation]}" if self.violation in units else ""

    @property
    def words(self) -> str:
        """The violation and its amount in one line; a promised time does not hold for an evader that turns."""
        if not self.by:
            return str(self.violation)
        cause = "; the evader may have turned" if self.violation is Violation.CAPTURE_LATER else ""
        return f"{self.violation}, {self.by}{cause}"


class MonitorMemory(NamedTuple):
    """Memory of the monitor.

    Attributes:
        best: The best promise since the last alarm: smallest time, or largest L with its sign changed.
        lost: Whether the evader was winning; None before the first certificate.
        since_s: Since when the promise is worse than allowed, or the barrier is crossed; None if neither.
        oldest_s: Largest age of a report that was reported.
        reachable_m_s: Largest reachable speed since the promise started.
        reported_slow: Whether it was reported that the vehicle is too slow.
    """

    best: float = math.nan
    lost: bool | None = None
    since_s: float | None = None
    oldest_s: float = 0.0
    reachable_m_s: float = 0.0
    reported_slow: bool = False

    def restarted(self) -> "MonitorMemory":
        """Return the memory without a promise."""
        return self._replace(best=math.nan, since_s=None)

    def anew(self) -> "MonitorMemory":
        """Return the memory for the next chase: that the vehicle is too slow is not reported again."""
        return MonitorMemory(reported_slow=self.reported_slow)


def watch(
    memory: MonitorMemory,
    now_s: float,
    latest: Certificate,
    *,
    with_target: bool,
    speed_m_s: float,
    slack_s: float,
) -> tuple[MonitorMemory, Alarm | None]:
    """Compare this cycle's certificate with the best promise before it.

    Args:
        memory: From the last call; `MonitorMemory()` at engagement.
        now_s: Time of the injected clock.
        latest: Certificate of this cycle; one without a game is ignored.
        with_target: Whether the game is TAD.
        speed_m_s: The configured speed over the ground.
        slack_s: Permitted loss beyond the allowances above, s; in TAD, the distance that the evader covers in
            that time. After an alarm the count starts anew.

    Returns:
        The memory for the next call, and the alarm if there is one.
    """
    if latest.winner == Winner.UNDECIDED or math.isnan(latest.value):
        return memory, None
    age_s = latest.evader_age_s
    if age_s > max(REPORT_STALE_S, STALER * memory.oldest_s):
        return memory._replace(oldest_s=age_s), Alarm(Violation.STALE, age_s)
    if latest.reason == Reason.TOO_OLD:  # no promise now; it starts anew with the next report
        memory = memory.restarted()._replace(lost=None)
        latest = latest._replace(meeting_time_s=0.0)
    alarm = None
    reachable_m_s = latest.reachable_speed_m_s
    if reachable_m_s < (1.0 - SLOWER) * (memory.reachable_m_s or speed_m_s):
        alarm = (
            None if memory.reported_slow else Alarm(Violation.TOO_SLOW, reachable_m_s, speed_m_s)
        )
        memory = memory.restarted()._replace(reachable_m_s=reachable_m_s, reported_slow=True)
    elif reachable_m_s > memory.reachable_m_s:
        memory = memory._replace(reachable_m_s=reachable_m_s)
    if alarm is None and with_target:
        memory, alarm = _barrier_crossing(memory, now_s, latest)
    if alarm is not None or (with_target and (memory.lost or latest.winner == Winner.EVADER)):
        return memory, alarm
    return _watch_promise(memory, now_s, latest, slack_s, with_target=with_target)


def _watch_promise(
    memory: MonitorMemory,
    now_s: float,
    certificate: Certificate,
    slack_s: float,
    *,
    with_target: bool,
) -> tuple[MonitorMemory, Alarm | None]:
    """Watch the cost that must not rise, PE: the time of capture, s; TAD: L with its sign changed, m."""
    if certificate.meeting_time_s < ARRIVAL_S:
        return memory._replace(since_s=None), None
    evader_m_s = certificate.reachable_speed_m_s / certificate.speed_ratio
    scatter_m = SCATTER_M + SCATTER_M_S * certificate.meeting_time_s
    slack = slack_s + scatter_m / (certificate.reachable_speed_m_s - evader_m_s)
    cost = certificate.time_needed_s + certificate.allowance + now_s
    violation = Violation.CAPTURE_LATER
    if with_target:  # a second of slack is the evader's way in it
        cost = certificate.allowance - certificate.assured_distance_m
        violation = Violation.EVADER_CLOSER
        slack *= evader_m_s
    lost = cost - memory.best
    if 0.0 <= lost <= slack and memory.since_s is None:
        return memory, None
    if not lost > slack:
        return memory._replace(
            best=cost if math.isnan(lost) else min(cost, memory.best), since_s=None
        ), None
    memory, lasts = _lasting(memory, now_s)
    return (
        (memory._replace(best=cost, since_s=None), Alarm(violation, lost))
        if lasts
        else (memory, None)
    )


def _barrier_crossing(
    memory: MonitorMemory, now_s: float, certificate: Certificate
) -> tuple[MonitorMemory, Alarm | None]:
    """Report the barrier: lost by the ideal game's verdict, won by this vehicle's."""
    losing = certificate.winner == Winner.EVADER
    if memory.lost is None:
        return memory._replace(lost=losing), None
    won = certificate.vehicle_winner == Winner.PURSUER and not losing
    if not (won if memory.lost else losing):
        return memory if not memory.lost else memory._replace(since_s=None), None
    memory, lasts = _lasting(memory, now_s, GUARDED_S if memory.lost else LASTING_S)
    if not lasts:
        return memory, None
    violation = Violation.BARRIER_WON if memory.lost else Violation.BARRIER_LOST
    return memory.restarted()._replace(lost=not memory.lost), Alarm(violation, 0.0)


def _lasting(
    memory: MonitorMemory, now_s: float, for_s: float = LASTING_S
) -> tuple[MonitorMemory, bool]:
    """Note since when a promise is worse than allowed or a barrier is crossed, and return whether that lasts."""
    since_s = now_s if memory.since_s is None else memory.since_s
    return memory._replace(since_s=since_s), now_s - since_s >= for_s
