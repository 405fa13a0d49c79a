"""The stopping distance, as seconds: what turns every limit in space into a limit on velocity.

A vehicle told to stop goes on for v · k metres, with k = reaction + |v| / (2 · braking), on the ground and vertically.
"The place where it would come to rest is allowed" then is the whole law. It contains the braking curve: far from a
wall the allowed speed falls as √(2 · braking · distance), near it in proportion to the distance, with the gain
1/reaction, where a bare root would chatter.

k is taken at the speed asked for, which is never below the speed allowed in the end, so the true stop is shorter.
"""

import math
from typing import NamedTuple

from guidance.frames import Vector
from guidance.limits.envelope import Envelope


class Stop(NamedTuple):
    """Seconds of travel until standing still: displacement = velocity · seconds."""

    ground_s: float
    vertical_s: float


def stop(velocity_ned_m_s: Vector, envelope: Envelope) -> Stop:
    """Seconds of travel from this velocity until a standstill."""
    north, east, down = velocity_ned_m_s
    return Stop(
        envelope.reaction_s + math.hypot(north, east) / (2.0 * envelope.braking_m_s2),
        envelope.reaction_s + abs(down) / (2.0 * envelope.vertical_braking_m_s2),
    )


def approach_speed(distance: float, deceleration: float, lag_s: float) -> float:
    """The largest v with v · lag + v²/(2 · deceleration) ≤ distance; 0 where the distance is none or negative."""
    reserve = deceleration * lag_s
    return math.sqrt(reserve * reserve + 2.0 * deceleration * max(distance, 0.0)) - reserve
