"""What accelerating costs: where a pursuer of the game would have to begin to come to fly beside this vehicle.

The game's pursuer is at its velocity u at once. A vehicle that flies w and changes it by a m/s² is there after
‖u − w‖/a seconds, and by then

    (u − w) · ‖u − w‖ / (2a)

behind. So it does as well as a pursuer of the game that begins that much further back, and what the game says from
there (when it captures, how far from its target the evader ends) is what this vehicle can do: along a straight chase at
u after an evader at v the capture comes that distance over u − v later, V + u²/(2a(u − v)) from hover. A vehicle that
flies faster than u begins in front. Over the ground and vertically it is the same law, each with its own a.
"""

import math
from dataclasses import dataclass

from guidance.frames import Vector


@dataclass(frozen=True, slots=True)
class Acceleration:
    """What a vehicle surely achieves, m/s²: over the ground, and vertically."""

    ground_m_s2: float
    vertical_m_s2: float


def late_start(position_m: Vector, desired_m_s: Vector, flown_m_s: Vector, acceleration: Acceleration) -> Vector:
    """Return where the game's pursuer would begin that comes to fly beside this vehicle, m.

    Args:
        position_m: Where the vehicle is; axes of any frame, the third one vertical.
        desired_m_s: The velocity that the game asks for, in the same axes.
        flown_m_s: What the vehicle flies.
        acceleration: Of the vehicle.
    """
    east, north, up = (desired - flown for desired, flown in zip(desired_m_s, flown_m_s, strict=True))
    over_ground_s = math.hypot(east, north) / (2.0 * acceleration.ground_m_s2)
    vertical_s = abs(up) / (2.0 * acceleration.vertical_m_s2)
    x, y, z = position_m
    return (x - east * over_ground_s, y - north * over_ground_s, z - up * vertical_s)
