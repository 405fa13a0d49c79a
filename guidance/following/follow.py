"""From the velocity that the game asks for to what is commanded: drift ▸ catching up ▸ the approach ▸ the servo.

All of it works with the velocity over the ground as positions tell it; the command is given in the autopilot's own
terms, whose velocity differs by the drift.
"""

from dataclasses import dataclass
from typing import NamedTuple

from guidance.following.approach import Approach, Gaps, approach
from guidance.following.catch_up import CatchUp, catch_up
from guidance.following.drift import Drift, observe_drift
from guidance.following.servo import ServoGains, ServoMemory, serve
from guidance.frames import Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class Following:
    """How one vehicle is made to fly what the game asks for."""

    servo: ServoGains
    approach: Approach
    catch_up: CatchUp


class FollowMemory(NamedTuple):
    """What one call leaves to the next: the servo's memory, the way that is owed (m), and the drift."""

    servo: ServoMemory = ServoMemory()
    owed_m: float = 0.0
    drift: Drift = Drift()


class Motion(NamedTuple):
    """Position and velocity of the vehicle as reported, and the evader's velocity as estimated; NED."""

    position_ned_m: Vector
    velocity_ned_m_s: Vector
    evader_velocity_ned_m_s: Vector


class Followed(NamedTuple):
    """What to command, before the limits; the velocity wanted after the approach; the memory for the next call."""

    velocity_ned_m_s: Vector
    acceleration_ned_m_s2: Vector | None
    wanted_ned_m_s: Vector
    memory: FollowMemory


def follow(
    wanted_ned_m_s: Vector,
    motion: Motion,
    gaps: Gaps,
    following: Following | None,
    memory: FollowMemory,
    *,
    most: float,
    dt_s: float,
) -> Followed:
    """Follow the game's velocity for one cycle; None for `following` sends it as it is.

    Args:
        wanted_ned_m_s: What the game asks for.
        motion: Of both.
        gaps: To the disc.
        following: How this vehicle is made to.
        memory: From the last call.
        most: The largest multiple of the game's velocity with which way that is owed is made good.
        dt_s: Seconds since the last call.
    """
    if following is None:
        return Followed(wanted_ned_m_s, None, wanted_ned_m_s, memory)
    drift = observe_drift(memory.drift, motion.position_ned_m, motion.velocity_ned_m_s, dt_s=dt_s)
    flown = less_drift(motion.velocity_ned_m_s, drift)
    caught_up = catch_up(wanted_ned_m_s, flown, memory.owed_m, following.catch_up, most=most, dt_s=dt_s)
    wanted, braking = approach(
        caught_up.velocity_ned_m_s, flown, motion.evader_velocity_ned_m_s, gaps, following.approach
    )
    # What braking at the disc costs is not owed.
    owed_m = memory.owed_m if braking else caught_up.owed_m
    served = serve(wanted, flown, memory.servo, following.servo, dt_s=dt_s)
    return Followed(
        with_drift(served.velocity_ned_m_s, drift),
        served.acceleration_ned_m_s2,
        wanted,
        FollowMemory(served.memory, owed_m, drift),
    )


def with_drift(velocity_ned_m_s: Vector, drift: Drift) -> Vector:
    """Return a velocity over the ground in the autopilot's own terms."""
    (north, east, down), (by_north, by_east, by_down) = velocity_ned_m_s, drift.velocity_ned_m_s
    return (north + by_north, east + by_east, down + by_down)


def less_drift(velocity_ned_m_s: Vector, drift: Drift) -> Vector:
    """Return a reported velocity as one over the ground."""
    (north, east, down), (by_north, by_east, by_down) = velocity_ned_m_s, drift.velocity_ned_m_s
    return (north - by_north, east - by_east, down - by_down)
