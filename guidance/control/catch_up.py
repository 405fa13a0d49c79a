"""Way lost to acceleration is made good: by flying a little faster than the game's pursuer, and never ahead of it.

The game's pursuer is at full speed at once; a vehicle that starts from hover is some metres behind for the rest of the
game, and would be later by just that. So its along-track deficit is kept account of, and worked off with what the
speed limits leave above the game's speed; where they leave nothing, nothing is made good. The deficit is gone when the
vehicle has flown as far as the game's pursuer would have: over any game its mean speed stays within the game's bound,
and its value is never beaten in this way. A vehicle that flies faster than the limits, though no command says so, is
told to fly slower: ArduCopter makes good by itself what it has lagged behind its setpoints, for seconds.

What accelerating costs is also what a vehicle can promise less than the game does. One that flies w where the game asks
for u, and changes its velocity by a m/s², is there after ‖u − w‖/a seconds, and by then

    (u − w) · ‖u − w‖ / (2a)

behind. So it does as well as a pursuer of the game that begins that much further back, and what the game says from
there (when it captures, how far from its target the evader ends) is what this vehicle can do: along a straight chase at
u after an evader at v the capture comes that distance over u − v later, V + u²/(2a(u − v)) from hover. A vehicle that
flies faster than u begins in front. Over the ground and vertically it is the same law, each with its own a.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from guidance.frames import Vector

OVER = 0.02
"""Share of the limit by which a vehicle may be faster before it is told to fly slower: what estimates scatter by."""
EASE = 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class CatchUp:
    """How the along-track deficit is worked off.

    Attributes:
        gain_per_s: Speed added per metre of deficit, where it is small.
        limit_m: The deficit is never more than this: a vehicle that cannot keep up at all does not race for ever after.
    """

    gain_per_s: float = 0.5
    limit_m: float = 15.0


class CaughtUp(NamedTuple):
    """The velocity with what catching up adds to it, and the along-track deficit now, in metres."""

    velocity_ned_m_s: Vector
    deficit_m: float


def catch_up(
    desired_ned_m_s: Vector,
    flown_ned_m_s: Vector,
    deficit_m: float,
    settings: CatchUp,
    *,
    most: float,
    dt_s: float,
) -> CaughtUp:
    """Add to a velocity what makes up for the along-track deficit over the ground.

    Args:
        desired_ned_m_s: What the game asks for.
        flown_ned_m_s: What the vehicle flies.
        deficit_m: From the last call; 0 at engagement.
        settings: How fast it is worked off.
        most: The largest multiple of the velocity, which is what the speed limits are of the game's speeds; at least 1.
        dt_s: Seconds since the last call.
    """
    speed = math.hypot(*desired_ned_m_s[:2])
    if speed <= 0.0:
        return CaughtUp(desired_ned_m_s, deficit_m)
    along = sum(w * f for w, f in zip(desired_ned_m_s[:2], flown_ned_m_s[:2], strict=True)) / speed
    deficit_m = min(settings.limit_m, max(0.0, deficit_m + (speed - along) * dt_s))
    over = max(0.0, along / speed - (1.0 + OVER) * most)
    scale = max(0.0, min(most, 1.0 + settings.gain_per_s * deficit_m / speed) - EASE * over)
    north, east, down = desired_ned_m_s
    return CaughtUp((scale * north, scale * east, scale * down), deficit_m)


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
