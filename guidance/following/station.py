"""Stand still over the ground: stop, then hold the place where the vehicle came to rest.

Commanding no velocity is not enough. The autopilot stands still by the velocity it believes in, and slides with that
one's error (PX4: some 0.2 m/s); the drift is therefore taken out first, and the place is held by what is left.
"""

import math

from guidance.frames import Vector

GAIN_PER_S = 0.8
LARGEST_M_S = 0.5
AT_REST_M_S = 0.5
AWAY_M = 1.5

NorthEast = tuple[float, float]


def keep_station(
    place: NorthEast | None, position_ned_m: Vector, flown_ned_m_s: Vector
) -> tuple[NorthEast, NorthEast | None]:
    """Return the velocity over the ground that stops and holds, (north, east) in m/s, and the place for the next call.

    Args:
        place: What the last call returned; None at first.
        position_ned_m: Where the vehicle is.
        flown_ned_m_s: What it flies, drift taken out.
    """
    here = position_ned_m[:2]
    if place is None and math.hypot(*flown_ned_m_s[:2]) > AT_REST_M_S:
        return (0.0, 0.0), None
    if place is None or math.dist(place, here) > AWAY_M:
        return (0.0, 0.0), here  # blown off, or the estimate was reset: no chase for the old place
    north, east = (GAIN_PER_S * (held - now) for held, now in zip(place, here, strict=True))
    speed = math.hypot(north, east)
    share = LARGEST_M_S / speed if speed > LARGEST_M_S else 1.0
    return (share * north, share * east), place
