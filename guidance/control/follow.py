"""From the velocity that the game asks for to what is commanded: drift ▸ catching up ▸ the approach ▸ the servo.

All of it works with the velocity over the ground as positions tell it; the command is given in the autopilot's own
terms, whose velocity differs by the drift: reported velocity less the rate of the reported position.

An estimator's velocity carries an error that wanders slowly (PX4: 0.2 to 0.4 m/s over many seconds, north, east and
down), its position is drawn back by GPS and barometer. The autopilot flies the velocity it believes in, so that a
vehicle told to stand still moves, and one told to fly at 6 m/s gains on its evader by 5 % too little. The game is
played in positions: what counts is how they change. An observer of second order, with both poles at -1/settle, tells
the difference from the two, and is no slower than the error itself.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from guidance.control.approach import Approach, Gaps, approach
from guidance.control.catch_up import CatchUp, catch_up
from guidance.control.servo import ServoGains, ServoMemory, serve
from guidance.control.situation import Situation
from guidance.frames import Vector

SETTLE_S = 1.2
LARGEST_M_S = 0.6
JUMP_M = 1.0
_LONGEST_STEP_S = 0.1
_STILL: Vector = (0.0, 0.0, 0.0)


class Drift(NamedTuple):
    """Reported velocity less rate of the reported position, and the position by the two; None before the first call."""

    velocity_ned_m_s: Vector = (0.0, 0.0, 0.0)
    position_ned_m: Vector | None = None


def observe_drift(drift: Drift, position_ned_m: Vector, velocity_ned_m_s: Vector, *, dt_s: float) -> Drift:
    """Take in one report of position and velocity, `dt_s` after the last.

    A position that is further off than any drift could have it (`JUMP_M`: the estimator was reset) is taken as it is,
    and nothing is learned from it.

    Args:
        drift: What is known so far.
        position_ned_m: As reported now.
        velocity_ned_m_s: As reported now.
        dt_s: Since the last report.
    """
    if drift.position_ned_m is None:
        return Drift(drift.velocity_ned_m_s, position_ned_m)
    dt_s = min(max(dt_s, 0.0), _LONGEST_STEP_S)
    places, drifts = [], []
    for place_m, drift_m_s, reported_m, velocity_m_s in zip(
        drift.position_ned_m, drift.velocity_ned_m_s, position_ned_m, velocity_ned_m_s, strict=True
    ):
        expected_m = place_m + (velocity_m_s - drift_m_s) * dt_s
        off_m = reported_m - expected_m
        learned_m_s = drift_m_s - off_m * dt_s / SETTLE_S**2
        places.append(expected_m + 2.0 * off_m * dt_s / SETTLE_S)
        drifts.append(max(-LARGEST_M_S, min(LARGEST_M_S, learned_m_s)))
    if math.dist(position_ned_m, places) > JUMP_M:
        return Drift(drift.velocity_ned_m_s, position_ned_m)
    (north, east, down), (drift_north, drift_east, drift_down) = places, drifts
    return Drift((drift_north, drift_east, drift_down), (north, east, down))


@dataclass(frozen=True, slots=True, kw_only=True)
class Following:
    """How one vehicle is made to fly what the game asks for."""

    servo: ServoGains
    approach: Approach
    catch_up: CatchUp


class FollowMemory(NamedTuple):
    """What one call leaves to the next: the servo's memory, the along-track deficit (m), and the drift."""

    servo: ServoMemory = ServoMemory()
    deficit_m: float = 0.0
    drift: Drift = Drift()


class Followed(NamedTuple):
    """What to command, before the limits; the velocity desired after the approach; the memory for the next call."""

    velocity_ned_m_s: Vector
    acceleration_ned_m_s2: Vector | None
    desired_ned_m_s: Vector
    memory: FollowMemory


def follow(
    desired_ned_m_s: Vector,
    here: Situation,
    gaps: Gaps,
    following: Following | None,
    memory: FollowMemory,
    *,
    most: float,
    dt_s: float,
) -> Followed:
    """Follow the game's velocity for one cycle; None for `following` sends it as it is.

    Args:
        desired_ned_m_s: What the game asks for.
        here: Where the vehicle is and how it moves, and the evader's velocity.
        gaps: To the disc.
        following: How this vehicle is made to.
        memory: From the last call.
        most: The largest multiple of the game's velocity with which the along-track deficit is worked off.
        dt_s: Seconds since the last call.
    """
    if following is None:
        return Followed(desired_ned_m_s, None, desired_ned_m_s, memory)
    drift = observe_drift(memory.drift, here.position_ned_m, here.velocity_ned_m_s, dt_s=dt_s)
    flown = less_drift(here.velocity_ned_m_s, drift)
    caught_up = catch_up(desired_ned_m_s, flown, memory.deficit_m, following.catch_up, most=most, dt_s=dt_s)
    desired, braking = approach(
        caught_up.velocity_ned_m_s, flown, here.evader_velocity_ned_m_s or _STILL, gaps, following.approach
    )
    # Braking at the disc adds nothing to the deficit.
    deficit_m = memory.deficit_m if braking else caught_up.deficit_m
    served = serve(desired, flown, memory.servo, following.servo, dt_s=dt_s)
    return Followed(
        with_drift(served.velocity_ned_m_s, drift),
        served.acceleration_ned_m_s2,
        desired,
        FollowMemory(served.memory, deficit_m, drift),
    )


def with_drift(velocity_ned_m_s: Vector, drift: Drift) -> Vector:
    """Return a velocity over the ground in the autopilot's own terms."""
    (north, east, down), (by_north, by_east, by_down) = velocity_ned_m_s, drift.velocity_ned_m_s
    return (north + by_north, east + by_east, down + by_down)


def less_drift(velocity_ned_m_s: Vector, drift: Drift) -> Vector:
    """Return a reported velocity as one over the ground."""
    (north, east, down), (by_north, by_east, by_down) = velocity_ned_m_s, drift.velocity_ned_m_s
    return (north - by_north, east - by_east, down - by_down)
