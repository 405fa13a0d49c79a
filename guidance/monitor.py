"""The guarantee, watched in flight: under optimal play V + t never rises (PE) and L never falls (TAD).

If it does, an assumption of the game is broken: the evader is faster than its bound, the vehicle slower than the
game's, or what is known of the evader is stale. It is reported, never acted upon. Crossing the barrier, after which
the other player wins, is reported too.
"""

import math
from enum import StrEnum
from typing import NamedTuple

from guidance.game import Winner
from guidance.tick import Certificate


class Broken(StrEnum):
    """What of the guarantee did not hold."""

    CAPTURE_LATER = "guarantee: the time of capture has risen"
    EVADER_CLOSER = "guarantee: the evader's final distance to its target has fallen"
    BARRIER_LOST = "barrier: the evader can now reach its target"
    BARRIER_WON = "barrier: the evader can no longer reach its target"


class Alarm(NamedTuple):
    """What was broken and by how much: s of V + t, m of L, nothing for the barrier."""

    broken: Broken
    amount: float


class Guarantee(NamedTuple):
    """Memory: the least V + t or the largest L since the last alarm, and who was winning."""

    best: float = math.nan
    winner: int | None = None


def watch(
    memory: Guarantee, now_s: float, certificate: Certificate, *, with_target: bool, slack: float
) -> tuple[Guarantee, Alarm | None]:
    """Compare this cycle's certificate with the best before it.

    Args:
        memory: From the last call; `Guarantee()` at engagement.
        now_s: Time of the injected clock.
        certificate: This cycle's; one without a game is passed over.
        with_target: Whether the game is TAD.
        slack: How much may be lost before it is said, s (PE) or m (TAD); after an alarm the count starts anew.

    Returns:
        The memory for the next call and the alarm, if there is one.
    """
    winner = certificate.winner
    if winner == Winner.UNDECIDED or math.isnan(certificate.value):
        return memory, None
    crossed = with_target and memory.winner not in {None, winner}
    if crossed:
        broken = Broken.BARRIER_LOST if winner == Winner.EVADER else Broken.BARRIER_WON
        return Guarantee(math.nan, winner), Alarm(broken, 0.0)
    if with_target and winner == Winner.EVADER:
        return Guarantee(math.nan, winner), None
    # Larger is worse for the pursuer in either game, once L is turned around.
    cost = -certificate.value if with_target else certificate.value + now_s
    lost = cost - memory.best
    if lost > slack:
        return Guarantee(cost, winner), Alarm(Broken.EVADER_CLOSER if with_target else Broken.CAPTURE_LATER, lost)
    return Guarantee(cost if math.isnan(lost) else min(cost, memory.best), winner), None
