"""A height commanded beside a velocity: cut to what the autopilot's own height loop may make of it."""

from guidance.frames import Vector
from guidance.limits.altitude import floor_and_ceiling
from guidance.limits.envelope import Envelope
from guidance.limits.situation import Situation
from guidance.limits.stand_off import stand_off_walls
from guidance.limits.stopping import stop
from guidance.limits.wall import leans, slide


def cut_height(wanted_down_m: float, velocity_ned_m_s: Vector, situation: Situation, envelope: Envelope) -> float:
    """The height (down, metres) nearest to the wanted one for which the vertical speed is still within every limit.

    The autopilot adds gain · (height error) to the vertical velocity, so that sum has to respect the speed limits and
    the walls; and the height itself is never below the floor or above the ceiling, nor beyond the present height
    where the vehicle is outside them.

    Args:
        wanted_down_m: The height asked for.
        velocity_ned_m_s: The velocity that is sent with it, already within every limit.
        situation: Where the vehicle is.
        envelope: What is allowed.
    """
    present_m, gain = situation.position_ned_m[2], envelope.height_gain_per_s
    north, east, down = velocity_ned_m_s
    total = down + gain * (wanted_down_m - present_m)
    total = min(envelope.descent_m_s, max(-envelope.climb_m_s, total))
    asked = (north, east, total)
    walls = floor_and_ceiling(situation, envelope, stop(asked, envelope))
    for one in (*stand_off_walls(asked, situation, envelope), *walls):  # a fence holds no height
        if leans((north, east, total), one):
            level = one.normal_ned_s[0] == one.normal_ned_s[1] == 0.0
            total = slide((north, east, total), one)[2] if level else down
    floor_m = max(present_m, envelope.home_ned_m[2] - envelope.floor_m)
    ceiling_m = min(present_m, envelope.home_ned_m[2] - envelope.ceiling_m)
    return min(floor_m, max(ceiling_m, present_m + (total - down) / gain))
