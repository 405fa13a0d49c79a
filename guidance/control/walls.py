"""Walls: everything that a vehicle must not enter, as one list of half-spaces.

Fences, floor, ceiling and the stand-off cylinder about the evader are measured once per cycle (`measure_walls`).
`guidance.control.braking_law` keeps the vehicle out. Every mate is a cylinder like the stand-off's, and of the distance
to it each of the two may use half.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from guidance.control.limits import Envelope, Limiter, usable
from guidance.control.polygon import Point, Polygon
from guidance.frames import Vector, difference

STILL: Final[Vector] = (0.0, 0.0, 0.0)

COVER_M: Final = 0.5
"""A fleeing evader is assumed to keep fleeing if the vehicle is this far above the stand-off cylinder."""

_ON_THE_LINE_M: Final = 0.01


class Situation(NamedTuple):
    """State of the vehicle and the evader: NED metres, m/s, m/s² and radians; standard deviation of its height.

    There is no stand-off without an evader position. An evader without a usable velocity counts as standing still,
    which is the stricter case.
    """

    position_ned_m: Vector
    velocity_ned_m_s: Vector
    yaw_rad: float = 0.0
    evader_position_ned_m: Vector | None = None
    evader_velocity_ned_m_s: Vector | None = None
    acceleration_ned_m_s2: Vector = STILL
    height_sd_m: float = 0.0


class Wall(NamedTuple):
    """A half-space that the vehicle must not enter.

    Attributes:
        limiter: Its name.
        normal_ned: Unit vector towards what is forbidden. With a horizontal and a vertical part, both closing speeds
            share the distance.
        gap_m: Distance to the line where the vehicle has to stop; negative beyond it.
        margin_m: Distance from that line to the limit itself.
        radius_m: Radius of that line about home; infinite for a straight wall.
        velocity_ned_m_s: Velocity of the wall, away from the vehicle.
        approached: Whether the approach brakes before it; `held_back` and `braked` then leave it out.
    """

    limiter: Limiter
    normal_ned: Vector
    gap_m: float
    margin_m: float = 0.0
    radius_m: float = math.inf
    velocity_ned_m_s: Vector = STILL
    approached: bool = False


class Separation(NamedTuple):
    """An upright cylinder about a mate that the vehicle stays out of: centre (NED, m), radius, and half its height."""

    position_ned_m: Vector
    radius_m: float
    height_m: float


def measure_walls(here: Situation, envelope: Envelope, mates: Sequence[Separation] = ()) -> tuple[Wall, ...]:
    """Return all walls as seen from a position. The circle comes last; see `constraints_of`."""
    (north, east, down), home = here.position_ned_m, envelope.home_ned_m
    point, margin_m = (north - home[0], east - home[1]), envelope.fence_margin_m
    height_m, spare_m = home[2] - down, min(envelope.floor_margin_m, max(0.0, here.height_sd_m))
    walls, above_floor_m = _stand_off(here, envelope), height_m - envelope.floor_m - spare_m
    for mate in mates:
        walls += _separation(here, mate, climbs_back=above_floor_m < 0.0)
    if envelope.fence_polygon is not None:
        edges = _edges(envelope.fence_polygon, point)
        walls += [Wall(Limiter.FENCE_POLYGON, (*normal, 0.0), gap_m - margin_m, margin_m) for normal, gap_m in edges]
    walls.append(Wall(Limiter.FLOOR, (0.0, 0.0, 1.0), above_floor_m, spare_m))
    walls.append(Wall(Limiter.CEILING, (0.0, 0.0, -1.0), envelope.ceiling_m - height_m))
    if envelope.fence_radius_m is not None:
        radius_m, away_m = envelope.fence_radius_m - margin_m, math.hypot(*point)
        outward = (point[0] / away_m, point[1] / away_m, 0.0) if away_m > 0.0 else STILL
        walls.append(Wall(Limiter.FENCE_RADIUS, outward, radius_m - away_m, margin_m, radius_m))
    return tuple(walls)


def _stand_off(here: Situation, envelope: Envelope) -> list[Wall]:
    """Return the wall at the nearest point of the stand-off cylinder; inside, its side and its top.

    Above the cylinder, the wall moves with an evader that flees: if the evader stops dead, the vehicle flies past above
    it. Beside the cylinder, the evader counts as standing still, because it may stop at any time. The law changes
    gradually over the first `COVER_M` above the top. An evader that comes nearer counts as standing still.
    """
    zone, evader = envelope.stand_off, here.evader_position_ned_m
    if zone is None or evader is None:
        return []
    offset_m = difference(evader, here.position_ned_m)
    above_m = offset_m[2] - zone.height_m
    gap_m, (to_north, to_east), normals = _cylinder(offset_m, zone.radius_m, above_m, 1.0)
    flight = here.evader_velocity_ned_m_s or STILL
    fleeing = max(0.0, flight[0] * to_north + flight[1] * to_east) if usable(*flight) else 0.0
    fleeing *= min(1.0, max(0.0, above_m) / COVER_M)
    moving = (fleeing * to_north, fleeing * to_east, 0.0)
    return [Wall(Limiter.STAND_OFF, normal, gap_m, velocity_ned_m_s=moving, approached=True) for normal in normals]


def _separation(here: Situation, mate: Separation, *, climbs_back: bool) -> list[Wall]:
    """Return the walls halfway to a mate's cylinder.

    Both vehicles stop within their halves, so nobody has to know what the other will do. Braking for a distance that
    shrinks from both sides, the faster of two equal vehicles reaches its bound first. A vehicle below the floor
    `climbs_back` also towards a mate above.
    """
    offset_m = difference(mate.position_ned_m, here.position_ned_m)
    towards = 0.0 if climbs_back and offset_m[2] < 0.0 else math.copysign(1.0, offset_m[2])
    gap_m, _, normals = _cylinder(offset_m, mate.radius_m, abs(offset_m[2]) - mate.height_m, towards)
    return [Wall(Limiter.SEPARATION, normal, 0.5 * gap_m) for normal in normals]


def _cylinder(
    offset_ned_m: Vector, radius_m: float, above_m: float, downward: float
) -> tuple[float, Point, list[Vector]]:
    """Return the distance to an upright cylinder, the direction to its axis, and the normals to it; inside, two.

    Args:
        offset_ned_m: From the vehicle to a point of the axis.
        radius_m: Of the cylinder.
        above_m: Height above its top, or depth below its bottom.
        downward: 1 above, -1 below, 0 if height does not count.
    """
    away_m = math.hypot(*offset_ned_m[:2])
    to_north, to_east = (offset_ned_m[0] / away_m, offset_ned_m[1] / away_m) if away_m > 0.0 else (0.0, 0.0)
    beside_m = away_m - radius_m
    gap_m, parts = max(beside_m, above_m), [(1.0, 0.0), (0.0, 1.0)]
    if gap_m > 0.0:
        gap_m = math.hypot(max(0.0, beside_m), max(0.0, above_m))
        parts = [(max(0.0, beside_m) / gap_m, max(0.0, above_m) / gap_m)]
    normals = [(level * to_north, level * to_east, steep * downward) for level, steep in parts]
    return gap_m, (to_north, to_east), normals


def _edges(polygon: Polygon, point: Point) -> list[tuple[Point, float]]:
    """Return outward normals and distances of the polygon's edges; from outside, of the nearest ones only.

    Inside, a vehicle that stays behind the lines through the nearest points of all edges crosses no edge, whether the
    polygon is convex or not. Within `_ON_THE_LINE_M` of an edge, the direction to its nearest point is not defined
    well, and the edge's own normal is used.
    """
    inside = polygon.contains(point)
    offsets = [(north - point[0], east - point[1]) for north, east in polygon.nearest_points(point)]
    distances = [math.hypot(*offset) for offset in offsets]
    reach_m = math.inf if inside else min(distances) + _ON_THE_LINE_M
    found = []
    for index, ((north, east), distance_m) in enumerate(zip(offsets, distances, strict=True)):
        if distance_m <= _ON_THE_LINE_M:
            outward = polygon.outward(index)
            found.append((outward, north * outward[0] + east * outward[1]))
        elif distance_m <= reach_m:
            gap_m = distance_m if inside else -distance_m
            found.append(((north / gap_m, east / gap_m), gap_m))
    return found
