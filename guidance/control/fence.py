"""The fences: a circle and a polygon about home, both predictive. Their margin lies inside.

Where the vehicle is to them is measured once a cycle (`measure_fence`), and answers three questions: which velocities
to ask for in the first place (`keep_inside`), which to forbid (`guidance.control.velocity_constraints`), and whether
the vehicle has left them.

The limits only ever take motion away: they stop a vehicle at the margin, but one that believes a wrong velocity slides
on through it at some 0.1 m/s. So what leads out is not asked for in the first place: `keep_inside` holds the velocity
to fly back by the same braking law before the servo works on it, and turns it inwards beyond the margin's line.
"""

import math
from typing import NamedTuple

from guidance.control.envelope import Envelope
from guidance.control.polygon import Point, Polygon
from guidance.control.shaping import approach_speed
from guidance.frames import Vector

RETURN_PER_S = 0.5
RETURN_M_S = 1.0
_ON_THE_LINE_M = 0.01


class Edge(NamedTuple):
    """An edge of the polygon: its outward unit normal (north, east), and the distance to it, negative beyond it."""

    outward: Point
    gap_m: float


class FenceGeometry(NamedTuple):
    """Where a vehicle is to its fences.

    Attributes:
        about_home_m: Its place (north, east) about home.
        from_home_m: Its distance over the ground from home.
        edges: Of the polygon: all of them from inside, from outside those that are nearest.
        outside: Whether it has left a fence: the limits should have kept it in.
    """

    about_home_m: Point
    from_home_m: float
    edges: tuple[Edge, ...]
    outside: bool


def measure_fence(position_ned_m: Vector, envelope: Envelope) -> FenceGeometry:
    """Measure where a vehicle is to the fences of its envelope."""
    point = (position_ned_m[0] - envelope.home_ned_m[0], position_ned_m[1] - envelope.home_ned_m[1])
    from_home_m, polygon = math.hypot(*point), envelope.fence_polygon
    outside = envelope.fence_radius_m is not None and from_home_m > envelope.fence_radius_m
    if polygon is None:
        return FenceGeometry(point, from_home_m, (), outside)
    inside = polygon.contains(point)
    return FenceGeometry(point, from_home_m, _edges(polygon, point, inside=inside), outside or not inside)


def _edges(polygon: Polygon, point: Point, *, inside: bool) -> tuple[Edge, ...]:
    """Measure the edges that hold: braking straight ahead inside all of them crosses none, convex or not.

    From outside the nearest edge forbids what leads further out, and the way in is free. Close to an edge its own
    normal holds, on either side of it: on the line itself the nearest point has no direction, and in a corner a hair's
    breadth outside one edge the other one still holds.
    """
    offsets = [(north - point[0], east - point[1]) for north, east in polygon.nearest_points(point)]
    distances = [math.hypot(*offset) for offset in offsets]
    reach_m = math.inf if inside else min(distances) + _ON_THE_LINE_M
    found = []
    for index, ((north, east), distance_m) in enumerate(zip(offsets, distances, strict=True)):
        if distance_m > reach_m:
            continue
        if distance_m <= _ON_THE_LINE_M:
            outward = polygon.outward(index)
            found.append(Edge(outward, north * outward[0] + east * outward[1]))
        else:
            gap_m = distance_m if inside else -distance_m
            found.append(Edge((north / gap_m, east / gap_m), gap_m))
    return tuple(found)


def keep_inside(velocity_ned_m_s: Vector, fence: FenceGeometry, envelope: Envelope) -> Vector:
    """Hold a velocity back at the fences' margin, and turn it inwards beyond.

    Args:
        velocity_ned_m_s: What is asked for, over the ground.
        fence: Where the vehicle is to the fences; without fences nothing is changed.
        envelope: Their radius and margin, and how the vehicle brakes.
    """
    if envelope.fence_radius_m is not None and fence.from_home_m > 0.0:
        north, east = fence.about_home_m
        gap_m = envelope.fence_radius_m - envelope.fence_margin_m - fence.from_home_m
        outward = (north / fence.from_home_m, east / fence.from_home_m)
        velocity_ned_m_s = _hold_back(velocity_ned_m_s, outward, gap_m, envelope)
    if fence.edges:
        nearest = min(fence.edges, key=lambda edge: abs(edge.gap_m))
        gap_m = nearest.gap_m - envelope.fence_margin_m
        velocity_ned_m_s = _hold_back(velocity_ned_m_s, nearest.outward, gap_m, envelope)
    return velocity_ned_m_s


def _hold_back(velocity: Vector, outward: Point, gap_m: float, envelope: Envelope) -> Vector:
    north, east, down = velocity
    leaving = north * outward[0] + east * outward[1]
    if gap_m > 0.0:
        allowed = approach_speed(gap_m, envelope.braking_m_s2, envelope.reaction_s)
    else:
        allowed = max(-RETURN_M_S, RETURN_PER_S * gap_m)
    excess = max(0.0, leaving - allowed)
    return (north - excess * outward[0], east - excess * outward[1], down)
