"""What a limited stream of setpoints has to remember, and how it begins."""

from typing import NamedTuple

from guidance.frames import Vector
from guidance.limits.envelope import Envelope
from guidance.limits.shaping import clamp_speed
from guidance.limits.situation import Situation, usable

STILL: Vector = (0.0, 0.0, 0.0)


class LimitMemory(NamedTuple):
    """What was sent last: velocity, the acceleration that led to it, the feed-forward, and the yaw."""

    velocity_ned_m_s: Vector
    acceleration_ned_m_s2: Vector = STILL
    feed_forward_ned_m_s2: Vector = STILL
    yaw_rad: float = 0.0


def start(situation: Situation, envelope: Envelope) -> LimitMemory:
    """The memory at engagement: the vehicle's own velocity and heading, so that the first setpoint is no step."""
    if not usable(*situation.velocity_ned_m_s, situation.yaw_rad):
        return LimitMemory(STILL)
    return LimitMemory(clamp_speed(situation.velocity_ned_m_s, envelope), yaw_rad=situation.yaw_rad)


def restored(memory: LimitMemory | None, situation: Situation, envelope: Envelope) -> LimitMemory:
    """The memory handed in, or a new start where there is none or one that is no number."""
    if memory is None or not usable(*(number for part in memory[:3] for number in part), memory.yaw_rad):
        return start(situation, envelope)
    return memory
