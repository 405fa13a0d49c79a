"""The fences: a circle and a polygon about home, both predictive. Their margin lies inside."""

import math

from guidance.frames import Vector
from guidance.limits.envelope import Envelope
from guidance.limits.limiter import Limiter
from guidance.limits.polygon import Point
from guidance.limits.stopping import Stop
from guidance.limits.wall import Wall, wall


def polygon_walls(position_ned_m: Vector, envelope: Envelope, stop: Stop) -> tuple[Wall, ...]:
    """Inside, every edge is a wall at its nearest point: braking straight ahead crosses none, convex or not.

    Outside (or within the margin), the nearest edge forbids what leads further out, and the way in is free.
    """
    polygon = envelope.fence_polygon
    if polygon is None:
        return ()
    point = _about_home(position_ned_m, envelope)
    offsets = [(north - point[0], east - point[1]) for north, east in polygon.nearest_points(point)]
    distances = [math.hypot(*offset) for offset in offsets]
    if not polygon.contains(point):
        index = min(range(len(distances)), key=distances.__getitem__)
        (north, east), distance_m = offsets[index], distances[index]
        outward = (-north / distance_m, -east / distance_m) if distance_m > 0.0 else polygon.outward(index)
        return (wall(Limiter.FENCE_POLYGON, (*outward, 0.0), 0.0, stop),)
    return tuple(
        wall(
            Limiter.FENCE_POLYGON,
            (*((north / distance_m, east / distance_m) if distance_m > 0.0 else polygon.outward(index)), 0.0),
            distance_m - envelope.fence_margin_m,
            stop,
        )
        for index, ((north, east), distance_m) in enumerate(zip(offsets, distances, strict=True))
    )


def keep_in_circle(velocity_ned_m_s: Vector, position_ned_m: Vector, envelope: Envelope, stop: Stop) -> Vector:
    """The vehicle would come to rest within the circle, or outside no further out than it is.

    The stop point is moved onto the circle where it lies beyond: along the fence the path is bent inwards, and the
    speed over the ground never rises.
    """
    limit_m, point = _circle(position_ned_m, envelope)
    north, east = _stop_point(velocity_ned_m_s, point, stop)
    reached_m = math.hypot(north, east)
    if reached_m <= limit_m:
        return velocity_ned_m_s
    share = limit_m / reached_m
    return (
        (share * north - point[0]) / stop.ground_s,
        (share * east - point[1]) / stop.ground_s,
        velocity_ned_m_s[2],
    )


def outward_wall(position_ned_m: Vector, envelope: Envelope) -> Wall:
    """The circle as a wall to accelerations, once it acts on the velocity."""
    north, east = _about_home(position_ned_m, envelope)
    distance_m = math.hypot(north, east)
    outward = (north / distance_m, east / distance_m, 0.0) if distance_m > 0.0 else (0.0, 0.0, 0.0)
    return Wall(Limiter.FENCE_RADIUS, outward, 0.0)


def shrink_to_circle(velocity_ned_m_s: Vector, position_ned_m: Vector, envelope: Envelope, stop: Stop) -> Vector:
    """Scale the velocity over the ground down, direction kept, until the stop point is within the circle."""
    limit_m, point = _circle(position_ned_m, envelope)
    if math.hypot(*_stop_point(velocity_ned_m_s, point, stop)) <= limit_m:
        return velocity_ned_m_s
    # |point + share · travel|² = limit²; point itself is within the limit, so that one root lies in [0, 1].
    travel = (velocity_ned_m_s[0] * stop.ground_s, velocity_ned_m_s[1] * stop.ground_s)
    square = travel[0] ** 2 + travel[1] ** 2
    half = point[0] * travel[0] + point[1] * travel[1]
    spare = max(0.0, limit_m**2 - point[0] ** 2 - point[1] ** 2)
    share = max(0.0, math.sqrt(half**2 + square * spare) - half) / square
    return (share * velocity_ned_m_s[0], share * velocity_ned_m_s[1], velocity_ned_m_s[2])


def _circle(position_ned_m: Vector, envelope: Envelope) -> tuple[float, Point]:
    point = _about_home(position_ned_m, envelope)
    if envelope.fence_radius_m is None:
        return math.inf, point
    return max(envelope.fence_radius_m - envelope.fence_margin_m, math.hypot(*point)), point


def _about_home(position_ned_m: Vector, envelope: Envelope) -> Point:
    return (position_ned_m[0] - envelope.home_ned_m[0], position_ned_m[1] - envelope.home_ned_m[1])


def _stop_point(velocity_ned_m_s: Vector, point: Point, stop: Stop) -> Point:
    return (point[0] + velocity_ned_m_s[0] * stop.ground_s, point[1] + velocity_ned_m_s[1] * stop.ground_s)
