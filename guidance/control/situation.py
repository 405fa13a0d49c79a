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
    place, velocity, yaw_rad, evader, moving, acceleration = situation
    if usable(*place, *velocity, yaw_rad, *acceleration, *(evader or ()), *(moving or ())):
        return situation
    if not usable(*place, *velocity, yaw_rad, *(evader or ())):
        return None
    return situation._replace(
        acceleration_ned_m_s2=acceleration if usable(*acceleration) else (0.0, 0.0, 0.0),
        evader_velocity_ned_m_s=moving if usable(*(moving or ())) else None,
    )
