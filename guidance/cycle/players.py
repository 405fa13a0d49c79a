"""Both players of a cycle, the vehicle's performance, and the equivalent start of a pursuer of the game."""

import math
from typing import Final, NamedTuple

from guidance.control import Acceleration, Approach, Envelope, Gaps
from guidance.frames import Enu

NOWHERE: Final = Enu((math.nan, math.nan, math.nan))
"""Position of a missing player or target, such as the target in PE."""


class Players(NamedTuple):
    """Positions in the game frame, m, velocities, m/s, distances to the disc, and the age of the evader's last report.

    `target_m` is T of the TAD game, None in PE. `bound_for_m_s` is the velocity over the ground that the pursuer will
    have when the commands sent so far have taken effect; None for its present velocity.
    """

    pursuer_m: Enu
    pursuer_m_s: Enu
    evader_m: Enu
    evader_m_s: Enu
    target_m: Enu | None
    gaps: Gaps
    evader_age_s: float
    bound_for_m_s: Enu | None = None


class Capability(NamedTuple):
    """Performance of the vehicle.

    Attributes:
        acceleration: Guaranteed acceleration.
        envelope: Limits, with braking and reaction.
        approach: How it brakes at the disc.
        shown_m_s: Largest speed flown over the ground.
        tolerance_m: Distance from the disc that counts as captured.
    """

    acceleration: Acceleration
    envelope: Envelope
    approach: Approach
    shown_m_s: float
    tolerance_m: float


def late_start(
    position_m: Enu, desired_m_s: Enu, flown_m_s: Enu, acceleration: Acceleration
) -> Enu:
    """Return where a pursuer of the game would have to start to do as well as this vehicle, m.

    Args:
        position_m: Position of the vehicle; any frame, third axis vertical.
        desired_m_s: Velocity of the game's solution, same axes.
        flown_m_s: Velocity of the vehicle.
        acceleration: Of the vehicle.
    """
    # Number by number, because a cycle asks for this many times.
    east = desired_m_s.east - flown_m_s.east
    north = desired_m_s.north - flown_m_s.north
    up = desired_m_s.up - flown_m_s.up
    over_ground_s = math.hypot(east, north) / (2.0 * acceleration.ground_m_s2)
    vertical_s = abs(up) / (2.0 * acceleration.vertical_m_s2)
    x, y, z = position_m
    return Enu((x - east * over_ground_s, y - north * over_ground_s, z - up * vertical_s))
