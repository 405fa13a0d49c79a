"""What leads out of the fence is not wanted in the first place, and a vehicle in the fence's margin is led back.

The limits only ever take motion away: they stop a vehicle at the margin, but one that believes a wrong velocity slides
on through it at some 0.1 m/s. Here the velocity to fly is held back by the same braking law, and turned inwards beyond
the margin's line, before the servo works on it.
"""

import math

from guidance.frames import Vector
from guidance.limits import Envelope
from guidance.limits.stopping import approach_speed

RETURN_PER_S = 0.5
RETURN_M_S = 1.0


def keep_inside(velocity_ned_m_s: Vector, position_ned_m: Vector, envelope: Envelope) -> Vector:
    """Hold a velocity back at the fences' margin, and turn it inwards beyond.

    Args:
        velocity_ned_m_s: What is wanted, over the ground.
        position_ned_m: Where the vehicle is.
        envelope: Its fences and their margin; without fences nothing is changed.
    """
    north, east = (position_ned_m[axis] - envelope.home_ned_m[axis] for axis in (0, 1))
    distance_m = math.hypot(north, east)
    if envelope.fence_radius_m is not None and distance_m > 0.0:
        gap_m = envelope.fence_radius_m - envelope.fence_margin_m - distance_m
        velocity_ned_m_s = _hold_back(velocity_ned_m_s, (north / distance_m, east / distance_m), gap_m, envelope)
    polygon = envelope.fence_polygon
    if polygon is None:
        return velocity_ned_m_s
    inside = polygon.contains((north, east))
    to_edges = [
        (edge_north - north, edge_east - east) for edge_north, edge_east in polygon.nearest_points((north, east))
    ]
    to_north, to_east = min(to_edges, key=lambda offset: math.hypot(*offset))
    distance_m = math.hypot(to_north, to_east)
    if distance_m == 0.0:
        return velocity_ned_m_s
    towards = 1.0 if inside else -1.0
    outward = (towards * to_north / distance_m, towards * to_east / distance_m)
    return _hold_back(velocity_ned_m_s, outward, towards * distance_m - envelope.fence_margin_m, envelope)


def _hold_back(velocity: Vector, outward: tuple[float, float], gap_m: float, envelope: Envelope) -> Vector:
    north, east, down = velocity
    leaving = north * outward[0] + east * outward[1]
    if gap_m > 0.0:
        allowed = approach_speed(gap_m, envelope.braking_m_s2, envelope.reaction_s)
    else:
        allowed = max(-RETURN_M_S, RETURN_PER_S * gap_m)
    excess = max(0.0, leaving - allowed)
    return (north - excess * outward[0], east - excess * outward[1], down)
