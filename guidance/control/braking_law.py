"""One constraint law for everything that a vehicle must not enter: walls, and the braking before them.

Fences, floor, ceiling, the stand-off cylinder about the evader, and cylinders about mates are measured once per cycle,
as one list of half-spaces, the walls (`measure_walls`). Of the distance to a mate each of the two may use half.

The braking law: a vehicle may close on a wall only as fast as it can stop before it. After a change of command, a
vehicle drifts on for its reaction time and then brakes. The closing speed c is allowed if

    drift + c * reaction + c^2 / (2 * braking) <= distance

Near the wall the allowed speed is proportional to the distance left, with the gain 1/reaction. A vehicle whose velocity
lags by the reaction time then stops without overshoot; both poles are at -1/reaction.

Polygons have a wall for each edge. A circle has one at its nearest point. The side that the vehicle flies to may be
another one, so `held_back` and `braked` add it (`_with_far_side`), and `obey` uses the half-space that touches the
circle there, which then bounds the feed-forward too.

A cycle applies the law to one list of walls:

1. `held_back` reduces the desired velocity before the servo shapes it, and flies back from beyond a wall.
2. `constraints_of` and `obey` reduce the velocity that is sent. They only take motion away. A vehicle at rest satisfies
   all constraints, so any number of them has a common solution.
3. `braked` adds the deceleration to the feed-forward. Without it, the autopilot brakes only after a velocity error
   appears, which is too late if its integral has adapted to a head wind that ends.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from guidance.control.limits import Envelope, Limiter
from guidance.control.polygon import Point, Polygon
from guidance.frames import Vector, difference, usable

STILL: Final[Vector] = (0.0, 0.0, 0.0)

COVER_M: Final = 0.5
"""A fleeing evader is assumed to keep fleeing if the vehicle is this far above the stand-off cylinder."""

_ON_THE_LINE_M: Final = 0.01

_SAME_SIDE: Final = 0.5
"""Cosine of the angle at home up to which a circle's nearest point stands for the part of it that is flown to."""


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

    @property
    def about_m(self) -> Point:
        """The vehicle's position about the centre of a circle."""
        away_m = self.radius_m - self.gap_m
        return (self.normal_ned[0] * away_m, self.normal_ned[1] * away_m)


class Separation(NamedTuple):
    """An upright cylinder about a mate that the vehicle stays out of: centre (NED, m), radius, and half its height."""

    position_ned_m: Vector
    radius_m: float
    height_m: float


def measure_walls(
    situation: Situation, envelope: Envelope, mates: Sequence[Separation] = ()
) -> tuple[Wall, ...]:
    """Return all walls as seen from a position. The circle comes last; see `constraints_of`."""
    (north, east, down) = situation.position_ned_m
    home = envelope.home_ned_m
    point = (north - home[0], east - home[1])
    margin_m = envelope.fence_margin_m
    height_m = home[2] - down
    spare_m = min(envelope.floor_margin_m, max(0.0, situation.height_sd_m))
    walls = _stand_off(situation, envelope)
    above_floor_m = height_m - envelope.floor_m - spare_m
    for mate in mates:
        walls += _separation(situation, mate, climbs_back=above_floor_m < 0.0)
    if envelope.fence_polygon is not None:
        edges = _edges(envelope.fence_polygon, point)
        walls += [
            Wall(Limiter.FENCE_POLYGON, (*normal, 0.0), gap_m - margin_m, margin_m)
            for normal, gap_m in edges
        ]
    walls.append(Wall(Limiter.FLOOR, (0.0, 0.0, 1.0), above_floor_m, spare_m))
    walls.append(Wall(Limiter.CEILING, (0.0, 0.0, -1.0), envelope.ceiling_m - height_m))
    if envelope.fence_radius_m is not None:
        radius_m = envelope.fence_radius_m - margin_m
        away_m = math.hypot(*point)
        outward = STILL
        if away_m > 0.0:
            outward = (point[0] / away_m, point[1] / away_m, 0.0)
        walls.append(Wall(Limiter.FENCE_RADIUS, outward, radius_m - away_m, margin_m, radius_m))
    return tuple(walls)


def _stand_off(situation: Situation, envelope: Envelope) -> list[Wall]:
    """Return the wall at the nearest point of the stand-off cylinder; inside, its side and its top.

    Above the cylinder, the wall moves with an evader that flees: if the evader stops dead, the vehicle flies past above
    it. Beside the cylinder, the evader counts as standing still, because it may stop at any time. The law changes
    gradually over the first `COVER_M` above the top. An evader that comes nearer counts as standing still.
    """
    zone = envelope.stand_off
    evader = situation.evader_position_ned_m
    if zone is None or evader is None:
        return []
    offset_m = difference(evader, situation.position_ned_m)
    above_m = offset_m[2] - zone.height_m
    gap_m, (to_north, to_east), normals = _cylinder(offset_m, zone.radius_m, above_m, 1.0)
    flight = situation.evader_velocity_ned_m_s
    fleeing = 0.0
    if flight is not None and usable(*flight):
        fleeing = max(0.0, flight[0] * to_north + flight[1] * to_east)
    fleeing *= min(1.0, max(0.0, above_m) / COVER_M)
    moving = (fleeing * to_north, fleeing * to_east, 0.0)
    return [
        Wall(Limiter.STAND_OFF, normal, gap_m, velocity_ned_m_s=moving, approached=True)
        for normal in normals
    ]


def _separation(situation: Situation, mate: Separation, *, climbs_back: bool) -> list[Wall]:
    """Return the walls halfway to a mate's cylinder.

    Both vehicles stop within their halves, so nobody has to know what the other will do. Braking for a distance that
    shrinks from both sides, the faster of two equal vehicles reaches its bound first. A vehicle below the floor
    `climbs_back` also towards a mate above.
    """
    offset_m = difference(mate.position_ned_m, situation.position_ned_m)
    towards = 0.0 if climbs_back and offset_m[2] < 0.0 else math.copysign(1.0, offset_m[2])
    gap_m, _, normals = _cylinder(
        offset_m, mate.radius_m, abs(offset_m[2]) - mate.height_m, towards
    )
    return [Wall(Limiter.SEPARATION, normal, 0.5 * gap_m) for normal in normals]


def _cylinder(
    offset_m: Vector, radius_m: float, above_m: float, downward: float
) -> tuple[float, Point, list[Vector]]:
    """Return the distance to an upright cylinder, the direction to its axis, and the normals to it; inside, two.

    Args:
        offset_m: From the vehicle to a point of the axis, NED.
        radius_m: Of the cylinder.
        above_m: Height above its top, or depth below its bottom.
        downward: 1 above, -1 below, 0 if height does not count.
    """
    away_m = math.hypot(*offset_m[:2])
    to_north = 0.0
    to_east = 0.0
    if away_m > 0.0:
        to_north = offset_m[0] / away_m
        to_east = offset_m[1] / away_m
    beside_m = away_m - radius_m
    gap_m = max(beside_m, above_m)
    parts = [(1.0, 0.0), (0.0, 1.0)]
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
    walls = []
    for index, (north, east) in enumerate(offsets):
        distance_m = distances[index]
        if distance_m <= _ON_THE_LINE_M:
            outward = polygon.outward(index)
            walls.append((outward, north * outward[0] + east * outward[1]))
        elif distance_m <= reach_m:
            gap_m = distance_m if inside else -distance_m
            walls.append(((north / gap_m, east / gap_m), gap_m))
    return walls


def _with_far_side(
    walls: tuple[Wall, ...], velocity_ned_m_s: Vector, drift_s: float, braking_m_s2: float
) -> tuple[Wall, ...]:
    """Add the circle's far side: the half-space that touches it in the direction of a stop point beyond it.

    The circle's own wall is at its nearest point. A vehicle that flies across a small circle has that wall behind or
    beside it until it has passed home, which is too late to brake.
    """
    if not walls or math.isinf(walls[-1].radius_m):
        return walls
    circle = walls[-1]
    nearest = circle.normal_ned
    seconds = drift_s + math.hypot(*velocity_ned_m_s[:2]) / (2.0 * braking_m_s2)
    north, east = circle.about_m
    normal, away_m = _direction_of_stop(circle.about_m, velocity_ned_m_s, seconds)
    beside = normal[0] * nearest[0] + normal[1] * nearest[1] > _SAME_SIDE
    if beside or away_m <= circle.radius_m:
        return walls
    gap_m = circle.radius_m - north * normal[0] - east * normal[1]
    return (*walls, circle._replace(normal_ned=normal, gap_m=gap_m))


def _direction_of_stop(
    about_m: Point, velocity_ned_m_s: Vector, seconds: float
) -> tuple[Vector, float]:
    """Return the direction from home to the stop point, and its distance; no direction at home."""
    stop_north_m = about_m[0] + velocity_ned_m_s[0] * seconds
    stop_east_m = about_m[1] + velocity_ned_m_s[1] * seconds
    away_m = math.hypot(stop_north_m, stop_east_m)
    if away_m == 0.0:
        return STILL, away_m
    return (stop_north_m / away_m, stop_east_m / away_m, 0.0), away_m


RETURN_PER_S: Final = 0.5
RETURN_M_S: Final = 1.0
"""Gain and largest speed of flying back from beyond a wall."""

ROUNDING_M: Final = 1e-9
"""Excess that counts as rounding. Scaling it away would scale the motion along the wall to zero."""

_STEADY_M_S2: Final = 0.5
"""A smaller acceleration is estimation noise."""


def approach_speed(distance: float, deceleration: float, lag_s: float) -> float:
    """Return the largest v with v * lag + v^2 / (2 * deceleration) <= distance; 0 for a negative distance."""
    reserve = deceleration * lag_s
    return math.sqrt(reserve * reserve + 2.0 * deceleration * max(distance, 0.0)) - reserve


def held_back(velocity_ned_m_s: Vector, walls: tuple[Wall, ...], envelope: Envelope) -> Vector:
    """Reduce a desired velocity to what stops before every wall, and turn it back beyond one.

    Args:
        velocity_ned_m_s: Desired velocity over the ground.
        walls: Of this cycle; the evader's are left to the approach.
        envelope: Braking and reaction of the vehicle.
    """
    north, east, down = velocity_ned_m_s
    reaction_s = envelope.reaction_s
    for wall in _with_far_side(walls, velocity_ned_m_s, reaction_s, envelope.braking_m_s2):
        (normal_north, normal_east, normal_down) = wall.normal_ned
        gap_m = wall.gap_m
        braking_m_s2 = envelope.vertical_braking_m_s2 if normal_down else envelope.braking_m_s2
        closing = north * normal_north + east * normal_east + down * normal_down
        stop_m = closing * (reaction_s + max(0.0, closing) / (2.0 * braking_m_s2))
        if wall.approached or (gap_m >= 0.0 and stop_m <= gap_m):
            continue
        allowed = max(-RETURN_M_S, RETURN_PER_S * gap_m)
        if gap_m > 0.0:
            allowed = approach_speed(gap_m, braking_m_s2, reaction_s)
        excess = max(0.0, closing - allowed)
        north = north - excess * normal_north
        east = east - excess * normal_east
        down = down - excess * normal_down
    return (north, east, down)


def surge(velocity_ned_m_s: Vector, acceleration_ned_m_s2: Vector, envelope: Envelope) -> Vector:
    """Return how much longer the stop over the ground is for a vehicle that is still accelerating, m.

    The vehicle releases an acceleration a with its jerk j, in t = a/j, and is faster by dv = a t/2 then. That adds
    v t + a t^2/3 on the way, and dv * reaction + ((v + dv)^2 - v^2) / (2 braking) to the stop. Deceleration adds
    nothing.

    Args:
        velocity_ned_m_s: Present velocity.
        acceleration_ned_m_s2: Present acceleration.
        envelope: Jerk, braking and reaction of the vehicle.
    """
    north, east = acceleration_ned_m_s2[:2]
    speed = math.hypot(*velocity_ned_m_s[:2])
    if speed > 0.0:
        along = (velocity_ned_m_s[0] / speed, velocity_ned_m_s[1] / speed)
        braking = min(0.0, north * along[0] + east * along[1])
        north = north - braking * along[0]
        east = east - braking * along[1]
    size = math.hypot(north, east)
    if size <= _STEADY_M_S2:
        return STILL
    gaining_m_s2 = size - _STEADY_M_S2
    lasts_s = gaining_m_s2 / envelope.easing_m_s3
    gained = 0.5 * gaining_m_s2 * lasts_s
    stopped_m = gained * envelope.reaction_s + gained * (2.0 * speed + gained) / (
        2.0 * envelope.braking_m_s2
    )
    far_m = speed * lasts_s + gaining_m_s2 * lasts_s * lasts_s / 3.0 + stopped_m
    return (far_m * north / size, far_m * east / size, 0.0)


class Constraint(NamedTuple):
    """A bound on a velocity (or, with seconds of 1, on an acceleration).

    max(0, ground part of normal * v) * ground_s + max(0, vertical part of it) * vertical_s <= distance_m

    With `about_m`, the position about home, the bound is a circle: |about_m + v * ground_s| <= distance_m.
    """

    limiter: Limiter
    normal_ned: Vector
    distance_m: float
    ground_s: float = 1.0
    vertical_s: float = 1.0
    about_m: Point | None = None

    def half_space(self, velocity_ned_m_s: Vector) -> "Constraint":
        """Return the half-space that touches a circle on the way to the stop point; any other constraint as it is."""
        if self.about_m is None:
            return self
        north, east = self.about_m
        normal, _ = _direction_of_stop(self.about_m, velocity_ned_m_s, self.ground_s)
        distance_m = self.distance_m - north * normal[0] - east * normal[1]
        return self._replace(normal_ned=normal, distance_m=distance_m, about_m=None)


def constraints_of(
    asked_ned_m_s: Vector, situation: Situation, walls: tuple[Wall, ...], envelope: Envelope
) -> tuple[Constraint, ...]:
    """Return the constraints of the walls within reach; the circle's is last, as `obey` needs it.

    Args:
        asked_ned_m_s: Velocity asked for.
        situation: State of the vehicle.
        walls: Of this cycle.
        envelope: Braking and reaction of the vehicle.
    """
    surge_ned_m = surge(situation.velocity_ned_m_s, situation.acceleration_ned_m_s2, envelope)
    speed = math.hypot(*asked_ned_m_s)
    braking_m_s2 = min(envelope.braking_m_s2, envelope.vertical_braking_m_s2)
    drift_m = math.hypot(*situation.velocity_ned_m_s) * envelope.reaction_s + math.hypot(
        *surge_ned_m
    )
    reach_m = drift_m + speed * (envelope.reaction_s + speed / (2.0 * braking_m_s2))
    near = (wall for wall in walls if wall.gap_m <= reach_m)
    velocity = situation.velocity_ned_m_s
    return tuple(_constraint(wall, asked_ned_m_s, velocity, surge_ned_m, envelope) for wall in near)


def _constraint(  # noqa: PLR0914
    wall: Wall, desired: Vector, velocity: Vector, surge_ned_m: Vector, envelope: Envelope
) -> Constraint:
    """Make the constraint of a wall, from the velocities relative to it.

    Braking is computed from the speed asked for. The speed sent is never larger, so the true stop is shorter.
    """
    moving = wall.velocity_ned_m_s
    normal = wall.normal_ned
    reaction_s = envelope.reaction_s
    about_m = None
    speed = math.hypot(desired[0] - moving[0], desired[1] - moving[1])
    ground_s = reaction_s + speed / (2.0 * envelope.braking_m_s2)
    vertical_s = reaction_s + abs(desired[2] - moving[2]) / (2.0 * envelope.vertical_braking_m_s2)
    # The approach to the evader brakes by itself, so an acceleration that it is about to end is not counted.
    extra_ned_m = STILL if wall.approached else surge_ned_m
    rows = zip(velocity, moving, extra_ned_m, strict=True)
    north_m, east_m, down_m = ((v - v_wall) * reaction_s + extra_m for v, v_wall, extra_m in rows)
    if math.isinf(wall.radius_m):
        drift_m = max(0.0, normal[0] * north_m + normal[1] * east_m) + max(0.0, normal[2] * down_m)
        receding_m_s = normal[0] * moving[0] + normal[1] * moving[1]
        distance_m = max(0.0, wall.gap_m - drift_m) + receding_m_s * ground_s
    else:
        away_m = wall.radius_m - wall.gap_m
        about_m = wall.about_m
        drift_m = max(0.0, math.hypot(about_m[0] + north_m, about_m[1] + east_m) - away_m)
        distance_m = max(wall.radius_m - drift_m, away_m)
    return Constraint(wall.limiter, normal, distance_m, ground_s, vertical_s, about_m)


def obey(
    vector_ned: Vector, constraints: tuple[Constraint, ...]
) -> tuple[Vector, tuple[Constraint, ...]]:
    """Reduce a vector until all constraints hold; return it with the half-spaces that reduced it.

    First it slides along every constraint in turn, which keeps the part along the wall. A later one may turn it back
    into an earlier one, so at last it is scaled down, which violates no constraint that already holds. A circle must be
    the last one. Neither the ground speed nor the vertical speed ever increases, and no part changes its sign.

    Args:
        vector_ned: A velocity or an acceleration.
        constraints: In the same unit.
    """
    result = vector_ned
    active = []
    for constraint in constraints:
        half_space = constraint.half_space(result)
        slid = reduced(result, half_space, along=True)
        if slid is not result:
            active.append(half_space)
            result = slid
    if active:
        for constraint in constraints:
            result = reduced(result, constraint.half_space(result), along=False)
    return result, tuple(active)


def reduced(vector_ned: Vector, constraint: Constraint, *, along: bool) -> Vector:
    """Take away what exceeds a half-space and keep the part along the wall, or scale the closing parts down."""
    (north, east, down) = vector_ned
    (normal_north, normal_east, normal_down) = constraint.normal_ned
    ground = max(0.0, north * normal_north + east * normal_east)
    vertical = max(0.0, down * normal_down)
    used_m = ground * constraint.ground_s + vertical * constraint.vertical_s
    if used_m <= constraint.distance_m + ROUNDING_M:
        return vector_ned
    share = constraint.distance_m / used_m
    if ground > 0.0 and along:
        size = math.hypot(normal_north, normal_east)
        part = (1.0 - share) * ground / size
        north = north - part * (normal_north / size)
        east = east - part * (normal_east / size)
    elif ground > 0.0:
        north = share * north
        east = share * east
    return (north, east, share * down if vertical > 0.0 else down)


def braked(
    fed_ned_m_s2: Vector | None, situation: Situation, walls: tuple[Wall, ...], envelope: Envelope
) -> Vector | None:
    """Return a feed-forward that decelerates at least as every wall requires; unchanged if none does.

    Args:
        fed_ned_m_s2: Feed-forward without walls; None for none.
        situation: State of the vehicle.
        walls: Of this cycle; the evader's are left to the approach.
        envelope: Braking and reaction of the vehicle.
    """
    velocity = situation.velocity_ned_m_s
    fed = fed_ned_m_s2
    drift_s = 2.0 * envelope.reaction_s
    for wall in _with_far_side(walls, velocity, drift_s, envelope.braking_m_s2):
        north, east, down = wall.normal_ned
        closing = velocity[0] * north + velocity[1] * east + velocity[2] * down
        braking_m_s2 = envelope.vertical_braking_m_s2 if down else envelope.braking_m_s2
        stop_m = closing * (drift_s + closing / (2.0 * braking_m_s2))
        if wall.approached or closing <= 0.0 or stop_m <= wall.gap_m:
            continue
        a_north, a_east, a_down = STILL if fed is None else fed
        # The excess over the allowed closing speed has to be gone within half the reaction time.
        allowed = approach_speed(
            wall.gap_m - closing * envelope.reaction_s, braking_m_s2, envelope.reaction_s
        )
        needed = 2.0 * (closing - allowed) / envelope.reaction_s
        missing = max(0.0, a_north * north + a_east * east + a_down * down + needed)
        fed = (a_north - missing * north, a_east - missing * east, a_down - missing * down)
    return fed
