"""The fences: a circle and a polygon about home, both predictive. Their margin lies inside.

The limits only ever take motion away: they stop a vehicle at the margin, but one that believes a wrong velocity slides
on through it at some 0.1 m/s. So what leads out is not wanted in the first place: `keep_inside` holds the velocity to
fly back by the same braking law before the servo works on it, and turns it inwards beyond the margin's line.
"""

import math

from guidance.control.envelope import Envelope, Limiter
from guidance.control.polygon import Point
from guidance.control.situation import Situation
from guidance.control.stopping import Stop, approach_speed, drift_ned_m
from guidance.control.velocity_constraints import Wall, wall
from guidance.frames import Vector

_ON_THE_LINE_M = 0.01


def polygon_walls(situation: Situation, envelope: Envelope, stop: Stop) -> tuple[Wall, ...]:
    """Inside, every edge is a wall at its nearest point: braking straight ahead crosses none, convex or not.

    Outside (or within the margin), the nearest edge forbids what leads further out, and the way in is free. Close to
    an edge its own normal is the wall's, on either side of it: on the line itself the nearest point has no direction,
    and in a corner a hair's breadth outside one edge the other one still holds.
    """
    polygon = envelope.fence_polygon
    if polygon is None:
        return ()
    point, drift = _about_home(situation, envelope), drift_ned_m(situation.velocity_ned_m_s, envelope)
    offsets = [(north - point[0], east - point[1]) for north, east in polygon.nearest_points(point)]
    distances = [math.hypot(*offset) for offset in offsets]
    inside = polygon.contains(point)
    reach_m = math.inf if inside else min(distances) + _ON_THE_LINE_M
    found = []
    for index, ((north, east), distance_m) in enumerate(zip(offsets, distances, strict=True)):
        if distance_m > reach_m:
            continue
        if distance_m <= _ON_THE_LINE_M:
            outward = polygon.outward(index)
            gap_m = north * outward[0] + east * outward[1]
        else:
            gap_m = distance_m if inside else -distance_m
            outward = (north / gap_m, east / gap_m)
        found.append(wall(Limiter.FENCE_POLYGON, (*outward, 0.0), gap_m - envelope.fence_margin_m, stop, drift))
    return tuple(found)


def keep_in_circle(velocity_ned_m_s: Vector, situation: Situation, envelope: Envelope, stop: Stop) -> Vector:
    """The vehicle would come to rest within the circle, or outside no further out than it is.

    The stop point is moved onto the circle where it lies beyond: along the fence the path is bent inwards, and the
    speed over the ground never rises.
    """
    limit_m, point = _circle(situation, envelope)
    north, east = point[0] + velocity_ned_m_s[0] * stop.ground_s, point[1] + velocity_ned_m_s[1] * stop.ground_s
    reached_m = math.hypot(north, east)
    if reached_m <= limit_m:
        return velocity_ned_m_s
    share = limit_m / reached_m
    return (
        (share * north - point[0]) / stop.ground_s,
        (share * east - point[1]) / stop.ground_s,
        velocity_ned_m_s[2],
    )


def outward_wall(situation: Situation, envelope: Envelope) -> Wall:
    """The circle as a wall to accelerations, once it acts on the velocity."""
    north, east = _about_home(situation, envelope)
    return Wall(Limiter.FENCE_RADIUS, (north, east, 0.0), 0.0)


def _circle(situation: Situation, envelope: Envelope) -> tuple[float, Point]:
    point = _about_home(situation, envelope)
    if envelope.fence_radius_m is None:
        return math.inf, point
    drift, distance_m = drift_ned_m(situation.velocity_ned_m_s, envelope), math.hypot(*point)
    drift_m = max(0.0, math.hypot(point[0] + drift[0], point[1] + drift[1]) - distance_m)
    return max(envelope.fence_radius_m - envelope.fence_margin_m - drift_m, distance_m), point


def _about_home(situation: Situation, envelope: Envelope) -> Point:
    return (
        situation.position_ned_m[0] - envelope.home_ned_m[0],
        situation.position_ned_m[1] - envelope.home_ned_m[1],
    )


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
