"""Way lost to acceleration is made good: by flying a little faster than the game's pursuer, and never ahead of it.

The game's pursuer is at full speed at once; a vehicle that starts from hover is some metres behind for the rest of the
game, and would be later by just that. So its along-track deficit is kept account of, and worked off with what the
speed limits leave above the game's speed; where they leave nothing, nothing is made good. The deficit is gone when the
vehicle has flown as far as the game's pursuer would have: over any game its mean speed stays within the game's bound,
and its value is never beaten in this way. A vehicle that flies faster than the limits, though no command says so, is
told to fly slower: ArduCopter makes good by itself what it has lagged behind its setpoints, for seconds.
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
