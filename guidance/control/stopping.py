"""The stopping distance: what turns every limit in space into a limit on velocity.

Before a vehicle answers at all it drifts: reaction · (its present velocity). What is asked of it then lasts for
k = reaction + |v| / (2 · braking) seconds until a standstill, on the ground and vertically. The whole law is

    drift + v · k ≤ distance        (the place where it would come to rest is allowed)

It contains the braking curve: far from a wall the allowed speed falls as √(2 · braking · distance); near it in
proportion to what the drift leaves of the distance, with the gain 1/reaction. A vehicle whose velocity lags by no more
than the reaction then comes to rest without overshoot: with the lag as reaction, both poles are at -1/reaction. A bare
root would chatter, and without the drift the vehicle would swing through the wall.

k is taken at the speed asked for, which is never below the speed allowed in the end, so the true stop is shorter.
"""

import math
from typing import Final, NamedTuple

from guidance.control.envelope import Envelope
from guidance.frames import Vector

_STEADY_M_S2: Final = 0.5
"""Less than this is what velocities scatter by, not gathering speed."""


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


def drift_ned_m(velocity_ned_m_s: Vector, envelope: Envelope) -> Vector:
    """Where a vehicle with this velocity goes before it answers."""
    north, east, down = velocity_ned_m_s
    return (north * envelope.reaction_s, east * envelope.reaction_s, down * envelope.reaction_s)


def surge_ned_m(velocity_ned_m_s: Vector, acceleration_ned_m_s2: Vector, envelope: Envelope) -> Vector:
    """How much further a vehicle goes over the ground that is gathering speed, before it comes to rest.

    It lets go of an acceleration a no faster than its jerk j allows, in t = a/j, and is faster by Δv = a·t/2 then:
    v·t + a·t²/3 on the way, and Δv·reaction + ((v + Δv)² - v²)/(2 · braking) for what has to be stopped besides. An
    acceleration against the velocity is braking, and counts for nothing.

    Args:
        velocity_ned_m_s: Its present velocity.
        acceleration_ned_m_s2: Its present acceleration.
        envelope: Its jerk, braking and reaction.
    """
    north, east = acceleration_ned_m_s2[:2]
    speed = math.hypot(*velocity_ned_m_s[:2])
    if speed > 0.0:
        along = (velocity_ned_m_s[0] / speed, velocity_ned_m_s[1] / speed)
        braking = min(0.0, north * along[0] + east * along[1])
        north, east = north - braking * along[0], east - braking * along[1]
    size = math.hypot(north, east)
    if size <= _STEADY_M_S2:
        return (0.0, 0.0, 0.0)
    held = size - _STEADY_M_S2
    lasts_s = held / envelope.easing_m_s3
    gained = 0.5 * held * lasts_s
    stopped_m = gained * envelope.reaction_s + gained * (2.0 * speed + gained) / (2.0 * envelope.braking_m_s2)
    far_m = speed * lasts_s + held * lasts_s * lasts_s / 3.0 + stopped_m
    return (far_m * north / size, far_m * east / size, 0.0)


def approach_speed(distance: float, deceleration: float, lag_s: float) -> float:
    """The largest v with v · lag + v²/(2 · deceleration) ≤ distance; 0 where the distance is none or negative."""
    reserve = deceleration * lag_s
    return math.sqrt(reserve * reserve + 2.0 * deceleration * max(distance, 0.0)) - reserve
