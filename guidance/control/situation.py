"""Where the vehicle and its evader are when a command is limited."""

from typing import NamedTuple

from guidance.frames import Vector

_LARGEST = 1e8


class Situation(NamedTuple):
    """Own position (metres), velocity (m/s), yaw (radians) and acceleration, and the evader's place where known. NED.

    None for an evader that is not known: then there is no stand-off to keep. An unknown velocity of a known evader is
    None too (or NaN), and is taken for rest, which is the strict side here.
    """

    position_ned_m: Vector
    velocity_ned_m_s: Vector
    yaw_rad: float = 0.0
    evader_position_ned_m: Vector | None = None
    evader_velocity_ned_m_s: Vector | None = None
    acceleration_ned_m_s2: Vector = (0.0, 0.0, 0.0)


def usable(*numbers: float) -> bool:
    """Whether every number is finite and of a size that something in flight can have."""
    return all(abs(number) <= _LARGEST for number in numbers)


def known(situation: Situation) -> Situation | None:
    """The situation with an evader velocity that is a number or None; None where it cannot be judged."""
    evader, velocity = situation.evader_position_ned_m or (), situation.evader_velocity_ned_m_s
    if not usable(*situation.position_ned_m, *situation.velocity_ned_m_s, situation.yaw_rad, *evader):
        return None
    if not usable(*situation.acceleration_ned_m_s2):
        situation = situation._replace(acceleration_ned_m_s2=(0.0, 0.0, 0.0))
    return situation if velocity is None or usable(*velocity) else situation._replace(evader_velocity_ned_m_s=None)
