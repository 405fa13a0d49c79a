"""Hover: stop over the ground, then hold the height and the place where the vehicle came to rest.

Commanding no velocity is not enough. The autopilot stands still by the velocity it believes in, and slides with that
one's error (PX4: some 0.2 m/s); the drift is therefore taken out first, and the place is held by what is left. With
vz = 0 it sinks (PX4: 6.5 m in 75 s of level flight), so that the height has an outer loop too.
"""

import math
from typing import NamedTuple

from guidance.control.envelope import Envelope
from guidance.control.shaping import approach_speed, usable
from guidance.frames import Vector

_GAIN_PER_S = 0.8
_INTEGRAL_PER_S2 = 0.08
_TRIM_LIMIT_M_S = 0.5
_TRIM_WITHIN_M = 1.5
_LONGEST_STEP_S = 0.1


class AltitudeHold(NamedTuple):
    """Memory: the height that is held (down, metres) and the vertical speed that holding it has been found to cost."""

    down_m: float
    trim_m_s: float


class Held(NamedTuple):
    """Vertical speed to command (m/s, down positive) and the memory for the next cycle."""

    velocity_down_m_s: float
    memory: AltitudeHold | None


def hold_altitude(memory: AltitudeHold | None, *, down_m: float, envelope: Envelope, dt_s: float) -> Held:
    """Vertical speed that keeps a height, for whenever no vertical motion is wanted.

    Proportional with a braking curve for far errors, and a slow, bounded integral against a steady sink, which waits
    while the error is large. The height is the one at which holding began, kept within floor and ceiling, so that a
    vehicle found outside them comes back.

    Args:
        memory: None at the first cycle of a hold.
        down_m: The present height in the local frame (down, metres); one that is no number commands no vertical motion.
        envelope: Its floor, ceiling, speeds and vertical braking are respected.
        dt_s: Time since the last cycle, seconds.
    """
    if not usable(down_m):
        return Held(0.0, memory)
    held, trim_m_s = memory if memory is not None and usable(*memory) else AltitudeHold(down_m, 0.0)
    home_down_m = envelope.home_ned_m[2]
    held = min(home_down_m - envelope.floor_m, max(home_down_m - envelope.ceiling_m, held))
    error_m = held - down_m
    if abs(error_m) < _TRIM_WITHIN_M:
        trim_m_s += _INTEGRAL_PER_S2 * error_m * min(_LONGEST_STEP_S, max(0.0, dt_s))
        trim_m_s = min(_TRIM_LIMIT_M_S, max(-_TRIM_LIMIT_M_S, trim_m_s))
    reach_m_s = approach_speed(abs(error_m), envelope.vertical_braking_m_s2, 1.0 / _GAIN_PER_S)
    desired_m_s = (reach_m_s if error_m > 0.0 else -reach_m_s) + trim_m_s
    return Held(min(envelope.descent_m_s, max(-envelope.climb_m_s, desired_m_s)), AltitudeHold(held, trim_m_s))


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
