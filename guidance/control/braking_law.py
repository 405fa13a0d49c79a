"""One constraint law for everything that a vehicle must not enter: walls, and the braking before them.

Fences, floor, ceiling, the stand-off cylinder about the evader, and cylinders about mates are measured once per cycle,
as one list of half-spaces, the walls (`measure_walls`). Each of two mates may use half of the distance between them.

The braking law: a vehicle may close on a wall only as fast as it can stop before it. After a change of command, a
vehicle drifts on for its reaction time and then brakes. The closing speed c is allowed if

    drift + c * reaction + c^2 / (2 * braking) <= distance

Near the wall the allowed speed is proportional to the distance left, with the gain 1/reaction. A vehicle whose velocity
lags by the reaction time then stops without overshoot; both poles are at -1/reaction.

Polygons have a wall for each edge. A circle has one at its nearest point. The side that the vehicle flies to may be
another one, so `held_back` and `braked` add it (`_far_side`), and `obey` uses the half-space that touches the
circle there, which then bounds the feed-forward too.

If walls contradict each other, the limits of the flight (floor, ceiling, fences) rank before the separation: they are
known from the vehicle's own telemetry, and a mate's word may be wrong. A vehicle beyond a limit flies back to it, also
towards a mate. No wall yields within the limits: a vehicle between walls that allow no motion stands still.

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
from guidance.frames import STILL, Ned, usable

DOWN: Final = Ned((0.0, 0.0, 1.0))
UP: Final = Ned((0.0, 0.0, -1.0))

COVER_M: Final = 0.5
"""A fleeing evader is assumed to keep fleeing if the vehicle is this far above the stand-off cylinder."""

_ON_THE_LINE_M: Final = 0.01

_NO_DIRECTION: Final = 1e-9
"""A shorter normal is rounding."""

_SAME_SIDE: Final = 0.5
"""Cosine of an angle at home: within it, a circle's nearest point also covers the side that the vehicle flies to."""


class Situation(NamedTuple):
    """State of the vehicle and the evader: NED metres, m/s, m/s² and radians; standard deviation of its height.

    There is no stand-off without an evader position. An evader without a usable velocity counts as standing still,
    which is the stricter case.
    """

    position_ned_m: Ned
    velocity_ned_m_s: Ned
    yaw_rad: float = 0.0
    evader_position_ned_m: Ned | None = None
    evader_velocity_ned_m_s: Ned | None = None
    acceleration_ned_m_s2: Ned = STILL
    height_sd_m: float = 0.0


class Wall(NamedTuple):
    """A half-space that the vehicle must not enter.

    Attributes:
        limiter: Its name.
        normal_ned: Unit vector into the forbidden side. With a horizontal and a vertical part, both closing speeds
            share the distance.
        gap_m: Distance to the line where the vehicle has to stop; negative beyond it.
        margin_m: Distance from that line to the limit itself.
        radius_m: Radius of that line about home; infinite for a straight wall.
        velocity_ned_m_s: Velocity of the wall, away from the vehicle.
        approached: Whether the approach brakes before it; `held_back` and `braked` then leave it out.
    """

    limiter: Limiter
    normal_ned: Ned
    gap_m: float
    margin_m: float = 0.0
    radius_m: float = math.inf
    velocity_ned_m_s: Ned = STILL
    approached: bool = False

    @property
    def about_m(self) -> Point:
        """The vehicle's position about the centre of a circle."""
        away_m = self.radius_m - self.gap_m
        return (self.normal_ned.north * away_m, self.normal_ned.east * away_m)


class Separation(NamedTuple):
    """An upright cylinder about a mate, closed to the vehicle: centre (NED, m), radius, and half its height."""

    position_ned_m: Ned
    radius_m: float
    height_m: float


def measure_walls(
    situation: Situation, envelope: Envelope, mates: Sequence[Separation] = ()
) -> tuple[Wall, ...]:
    """Return all walls as seen from a position. The circle comes last; see `constraints_of`."""
    position = situation.position_ned_m
    home = envelope.home_ned_m
    point = (position.north - home.north, position.east - home.east)
    margin_m = envelope.fence_margin_m
    height_m = home.down - position.down
    spare_m = min(envelope.floor_margin_m, max(0.0, situation.height_sd_m))
    walls: list[Wall] = []
    if envelope.fence_polygon is not None:
        edges = _edges(envelope.fence_polygon, point)
        walls.extend(
            Wall(Limiter.FENCE_POLYGON, Ned((*normal, 0.0)), gap_m - margin_m, margin_m)
            for normal, gap_m in edges
        )
    walls.append(Wall(Limiter.FLOOR, DOWN, height_m - envelope.floor_m - spare_m, spare_m))
    walls.append(Wall(Limiter.CEILING, UP, envelope.ceiling_m - height_m))
    if envelope.fence_radius_m is not None:
        radius_m = envelope.fence_radius_m - margin_m
        away_m = math.hypot(*point)
        outward = STILL
        if away_m > 0.0:
            outward = Ned((point[0] / away_m, point[1] / away_m, 0.0))
        walls.append(Wall(Limiter.FENCE_RADIUS, outward, radius_m - away_m, margin_m, radius_m))
    beyond = [wall.normal_ned for wall in walls if wall.gap_m < 0.0]
    separations = [wall for mate in mates for wall in _mate_walls(situation, mate, beyond)]
    return (*_stand_off(situation, envelope), *separations, *walls)


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
    offset_m = evader - situation.position_ned_m
    above_m = offset_m.down - zone.height_m
    gap_m, towards, normals = _cylinder(offset_m, zone.radius_m, above_m, 1.0)
    flight = situation.evader_velocity_ned_m_s
    fleeing = 0.0
    if flight is not None and usable(*flight):
        fleeing = max(0.0, flight.level_dot(towards))
    fleeing *= min(1.0, max(0.0, above_m) / COVER_M)
    moving = fleeing * towards
    return [
        Wall(Limiter.STAND_OFF, normal, gap_m, velocity_ned_m_s=moving, approached=True)
        for normal in normals
    ]


def _mate_walls(situation: Situation, mate: Separation, beyond: Sequence[Ned]) -> list[Wall]:
    """Return the walls halfway to a mate's cylinder.

    Both vehicles stop within their halves, so neither has to know the other's plan. Braking for a distance that
    shrinks from both sides, the faster of two equal vehicles reaches its bound first.

    Args:
        situation: State of the vehicle.
        mate: The cylinder about the mate.
        beyond: Normals of the limits that the vehicle is beyond. The way back from them is free, also towards a mate.
    """
    offset_m = mate.position_ned_m - situation.position_ned_m
    height_m = offset_m.down
    above_m = abs(height_m) - mate.height_m
    gap_m, _, normals = _cylinder(offset_m, mate.radius_m, above_m, math.copysign(1.0, height_m))
    walls = []
    for normal in normals:
        free = normal
        for outward in beyond:
            free -= min(0.0, free.dot(outward)) * outward
        if free.length() > _NO_DIRECTION:
            walls.append(Wall(Limiter.SEPARATION, free, 0.5 * gap_m))
    return walls


def _cylinder(
    offset_m: Ned, radius_m: float, above_m: float, downward: float
) -> tuple[float, Ned, list[Ned]]:
    """Return the distance to an upright cylinder, the direction to its axis, and the normals to it; inside, two.

    Args:
        offset_m: From the vehicle to a point of the axis.
        radius_m: Of the cylinder.
        above_m: Height above its top, or depth below its bottom.
        downward: 1 above, -1 below.
    """
    away_m = math.hypot(offset_m.north, offset_m.east)
    to_north = 0.0
    to_east = 0.0
    if away_m > 0.0:
        to_north = offset_m.north / away_m
        to_east = offset_m.east / away_m
    beside_m = away_m - radius_m
    gap_m = max(beside_m, above_m)
    parts = [(1.0, 0.0), (0.0, 1.0)]
    if gap_m > 0.0:
        gap_m = math.hypot(max(0.0, beside_m), max(0.0, above_m))
        parts = [(max(0.0, beside_m) / gap_m, max(0.0, above_m) / gap_m)]
    normals = [Ned((level * to_north, level * to_east, steep * downward)) for level, steep in parts]
    return gap_m, Ned((to_north, to_east, 0.0)), normals


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


def _walls_ahead(
    walls: tuple[Wall, ...], velocity_ned_m_s: Ned, drift_s: float, envelope: Envelope
) -> list[Wall]:
    """Return the walls that may need braking, with the circle's far side; the approach has its own.

    No stop is longer than one at the whole speed with the weaker braking. A vehicle beyond a wall is flown back, which
    may lead it to any other wall.
    """
    speed = math.hypot(*velocity_ned_m_s)
    braking_m_s2 = min(envelope.braking_m_s2, envelope.vertical_braking_m_s2)
    reach_m = speed * (drift_s + speed / (2.0 * braking_m_s2))
    braked_for = [wall for wall in walls if not wall.approached]
    ahead = []
    for wall in braked_for:
        if wall.gap_m < 0.0:
            ahead = braked_for
            break
        if wall.gap_m <= reach_m:
            ahead.append(wall)
    if ahead and ahead[-1].radius_m < math.inf:
        far_side = _far_side(ahead[-1], velocity_ned_m_s, drift_s, envelope.braking_m_s2)
        if far_side is not None:
            return [*ahead, far_side]
    return ahead


def _far_side(
    circle: Wall, velocity_ned_m_s: Ned, drift_s: float, braking_m_s2: float
) -> Wall | None:
    """Return the half-space that touches a circle in the direction of a stop point beyond it; None for one within it.

    The circle's own wall is at its nearest point. A vehicle that flies across a small circle has that wall behind or
    beside it until it has passed home, which is too late to brake.
    """
    ground_m_s = math.hypot(velocity_ned_m_s.north, velocity_ned_m_s.east)
    seconds = drift_s + ground_m_s / (2.0 * braking_m_s2)
    about_m = circle.about_m
    normal, away_m = _direction_of_stop(about_m, velocity_ned_m_s, seconds)
    beside = normal.level_dot(circle.normal_ned) > _SAME_SIDE
    if beside or away_m <= circle.radius_m:
        return None
    gap_m = circle.radius_m - about_m[0] * normal.north - about_m[1] * normal.east
    return circle._replace(normal_ned=normal, gap_m=gap_m)


def _direction_of_stop(about_m: Point, velocity_ned_m_s: Ned, seconds: float) -> tuple[Ned, float]:
    """Return the direction from home to the stop point, and its distance; no direction at home."""
    stop_north_m = about_m[0] + velocity_ned_m_s[0] * seconds
    stop_east_m = about_m[1] + velocity_ned_m_s[1] * seconds
    away_m = math.hypot(stop_north_m, stop_east_m)
    if away_m == 0.0:
        return STILL, away_m
    return Ned((stop_north_m / away_m, stop_east_m / away_m, 0.0)), away_m


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


def held_back(velocity_ned_m_s: Ned, walls: tuple[Wall, ...], envelope: Envelope) -> Ned:
    """Reduce a desired velocity so that the vehicle stops before every wall, and turn it back beyond one.

    Args:
        velocity_ned_m_s: Desired velocity over the ground.
        walls: Of this cycle; the evader's are left to the approach.
        envelope: Braking and reaction of the vehicle.
    """
    reaction_s = envelope.reaction_s
    for wall in _walls_ahead(walls, velocity_ned_m_s, reaction_s, envelope):
        normal = wall.normal_ned
        gap_m = wall.gap_m
        braking_m_s2 = envelope.vertical_braking_m_s2 if normal.down else envelope.braking_m_s2
        closing = velocity_ned_m_s.dot(normal)
        stop_m = closing * (reaction_s + max(0.0, closing) / (2.0 * braking_m_s2))
        if gap_m >= 0.0 and stop_m <= gap_m:
            continue
        allowed = max(-RETURN_M_S, RETURN_PER_S * gap_m)
        if gap_m > 0.0:
            allowed = approach_speed(gap_m, braking_m_s2, reaction_s)
        velocity_ned_m_s -= max(0.0, closing - allowed) * normal
    return velocity_ned_m_s


def surge(velocity_ned_m_s: Ned, acceleration_ned_m_s2: Ned, envelope: Envelope) -> Ned:
    """Return how much longer the stop over the ground is for a vehicle that is still accelerating, m.

    The vehicle releases an acceleration a with its jerk j, in t = a/j, and is faster by dv = a t/2 then. That adds
    v t + a t^2/3 on the way, and dv * reaction + ((v + dv)^2 - v^2) / (2 braking) to the stop. Deceleration adds
    nothing.

    Args:
        velocity_ned_m_s: Present velocity.
        acceleration_ned_m_s2: Present acceleration.
        envelope: Jerk, braking and reaction of the vehicle.
    """
    gaining = acceleration_ned_m_s2
    if math.hypot(gaining.north, gaining.east) <= _STEADY_M_S2:
        return STILL
    speed = math.hypot(velocity_ned_m_s.north, velocity_ned_m_s.east)
    if speed > 0.0:
        along = velocity_ned_m_s / speed
        gaining -= min(0.0, gaining.level_dot(along)) * along
    size = math.hypot(gaining.north, gaining.east)
    if size <= _STEADY_M_S2:
        return STILL
    gaining_m_s2 = size - _STEADY_M_S2
    lasts_s = gaining_m_s2 / envelope.easing_m_s3
    gained = 0.5 * gaining_m_s2 * lasts_s
    stopped_m = gained * envelope.reaction_s + gained * (2.0 * speed + gained) / (
        2.0 * envelope.braking_m_s2
    )
    far_m = speed * lasts_s + gaining_m_s2 * lasts_s * lasts_s / 3.0 + stopped_m
    return Ned((far_m * gaining.north / size, far_m * gaining.east / size, 0.0))


class Constraint(NamedTuple):
    """A bound on a velocity (or, with seconds of 1, on an acceleration).

    max(0, ground part of normal * v) * ground_s + max(0, vertical part of it) * vertical_s <= distance_m

    With `about_m`, the position about home, the bound is a circle: |about_m + v * ground_s| <= distance_m.
    """

    limiter: Limiter
    normal_ned: Ned
    distance_m: float
    ground_s: float = 1.0
    vertical_s: float = 1.0
    about_m: Point | None = None

    def half_space(self, velocity_ned_m_s: Ned) -> "Constraint":
        """Return the half-space that touches a circle on the way to the stop point; any other constraint as it is."""
        if self.about_m is None:
            return self
        north, east = self.about_m
        normal, _ = _direction_of_stop(self.about_m, velocity_ned_m_s, self.ground_s)
        distance_m = self.distance_m - north * normal.north - east * normal.east
        return self._replace(normal_ned=normal, distance_m=distance_m, about_m=None)


def constraints_of(
    asked_ned_m_s: Ned, situation: Situation, walls: tuple[Wall, ...], envelope: Envelope
) -> tuple[Constraint, ...]:
    """Return the constraints of the walls within reach; the circle's is last, as `obey` needs it.

    Floor and ceiling are in the reach of the vertical speed alone, which `obey` never increases.

    Args:
        asked_ned_m_s: Requested velocity.
        situation: State of the vehicle.
        walls: Of this cycle.
        envelope: Braking and reaction of the vehicle.
    """
    velocity = situation.velocity_ned_m_s
    surge_ned_m = surge(velocity, situation.acceleration_ned_m_s2, envelope)
    speed = math.hypot(*asked_ned_m_s)
    braking_m_s2 = min(envelope.braking_m_s2, envelope.vertical_braking_m_s2)
    drift_m = math.hypot(*velocity) * envelope.reaction_s + math.hypot(*surge_ned_m)
    reach_m = drift_m + speed * (envelope.reaction_s + speed / (2.0 * braking_m_s2))
    vertical = abs(asked_ned_m_s.down)
    vertical_s = envelope.reaction_s + vertical / (2.0 * envelope.vertical_braking_m_s2)
    vertical_reach_m = drift_m + vertical * vertical_s
    constraints = []
    for wall in walls:
        is_level = wall.normal_ned in (UP, DOWN)
        if wall.gap_m <= (vertical_reach_m if is_level else reach_m):
            constraints.append(_constraint(wall, asked_ned_m_s, velocity, surge_ned_m, envelope))
    return tuple(constraints)


def _constraint(
    wall: Wall, desired: Ned, velocity: Ned, surge_ned_m: Ned, envelope: Envelope
) -> Constraint:
    """Make the constraint of a wall, from the velocities relative to it.

    Braking is computed from the requested speed. The speed sent is never larger, so the true stop is shorter.
    """
    moving = wall.velocity_ned_m_s
    normal = wall.normal_ned
    reaction_s = envelope.reaction_s
    about_m = None
    closing = desired - moving
    ground_m_s = math.hypot(closing.north, closing.east)
    ground_s = reaction_s + ground_m_s / (2.0 * envelope.braking_m_s2)
    vertical_s = reaction_s + abs(closing.down) / (2.0 * envelope.vertical_braking_m_s2)
    drifted_m = (velocity - moving) * reaction_s
    # The approach to the evader brakes by itself, so an acceleration that it is about to end is not counted.
    if not wall.approached:
        drifted_m += surge_ned_m
    if math.isinf(wall.radius_m):
        ground_m = max(0.0, normal.level_dot(drifted_m))
        drift_m = ground_m + max(0.0, normal.down * drifted_m.down)
        distance_m = max(0.0, wall.gap_m - drift_m)
        if moving != STILL:
            distance_m += normal.level_dot(moving) * ground_s
    else:
        away_m = wall.radius_m - wall.gap_m
        about_m = wall.about_m
        stop_m = math.hypot(about_m[0] + drifted_m.north, about_m[1] + drifted_m.east)
        drift_m = max(0.0, stop_m - away_m)
        distance_m = max(wall.radius_m - drift_m, away_m)
    return Constraint(wall.limiter, normal, distance_m, ground_s, vertical_s, about_m)


def obey(
    vector_ned: Ned, constraints: tuple[Constraint, ...]
) -> tuple[Ned, tuple[Constraint, ...]]:
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
        half_space = constraint
        if constraint.about_m is not None:
            half_space = constraint.half_space(result)
        slid = reduced(result, half_space, along=True)
        if slid is not result:
            active.append(half_space)
            result = slid
    if active:
        for constraint in constraints:
            result = reduced(result, constraint.half_space(result), along=False)
    return result, tuple(active)


def reduced(vector_ned: Ned, constraint: Constraint, *, along: bool) -> Ned:
    """Take away the excess over a half-space and keep the part along the wall, or scale the closing parts down."""
    normal = constraint.normal_ned
    ground = max(0.0, vector_ned.level_dot(normal))
    vertical = max(0.0, vector_ned.down * normal.down)
    used_m = ground * constraint.ground_s + vertical * constraint.vertical_s
    if used_m <= constraint.distance_m + ROUNDING_M:
        return vector_ned
    share = constraint.distance_m / used_m
    down = vector_ned.down
    if vertical > 0.0:
        down = share * down
    result = vector_ned
    if ground > 0.0 and along:
        size = math.hypot(normal.north, normal.east)
        result = vector_ned - (1.0 - share) * ground / size * (normal / size)
    elif ground > 0.0:
        result = share * vector_ned
    return Ned((result.north, result.east, down))


def braked(
    fed_ned_m_s2: Ned | None, situation: Situation, walls: tuple[Wall, ...], envelope: Envelope
) -> Ned | None:
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
    for wall in _walls_ahead(walls, velocity, drift_s, envelope):
        normal = wall.normal_ned
        closing = velocity.dot(normal)
        braking_m_s2 = envelope.vertical_braking_m_s2 if normal.down else envelope.braking_m_s2
        stop_m = closing * (drift_s + closing / (2.0 * braking_m_s2))
        if closing <= 0.0 or stop_m <= wall.gap_m:
            continue
        present = STILL if fed is None else fed
        # The excess over the allowed closing speed has to be gone within half the reaction time.
        allowed = approach_speed(
            wall.gap_m - closing * envelope.reaction_s, braking_m_s2, envelope.reaction_s
        )
        needed = 2.0 * (closing - allowed) / envelope.reaction_s
        fed = present - max(0.0, present.dot(normal) + needed) * normal
    return fed
