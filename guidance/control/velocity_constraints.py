"""A velocity constraint: what closes on something forbidden may use up no more than the distance before the stop.

Before a vehicle answers at all it drifts: reaction · (its present velocity). What is asked of it then lasts for
k = reaction + |v| / (2 · braking) seconds until a standstill, on the ground and vertically. The whole law is

    drift + v · k ≤ distance        (the place where it would come to rest is allowed)

It contains the braking curve: far from a wall the allowed speed falls as √(2 · braking · distance); near it in
proportion to what the drift leaves of the distance, with the gain 1/reaction. A vehicle whose velocity lags by no more
than the reaction then comes to rest without overshoot: with the lag as reaction, both poles are at -1/reaction. A bare
root would chatter, and without the drift the vehicle would swing through the wall.

k is taken at the speed asked for, which is never below the speed allowed in the end, so the true stop is shorter.

Only closing parts are ever taken away, each towards zero: a constraint adds no motion, reverses nothing and pushes
nowhere. Standing still satisfies every one, so that any number of them has a common answer.

Floor and ceiling above home, the stand-off cylinder about the evader, and the fences are given here as constraints, and
`feasible_velocity` keeps all of them together.
"""

import math
from typing import Final, NamedTuple

from guidance.control.envelope import Envelope, Limiter, Situation
from guidance.control.fence import FenceGeometry
from guidance.frames import Vector, difference

COVER_M = 0.5
"""Height above the lid from which on an evader that flees is trusted to go on."""

_STEADY_M_S2: Final = 0.5
"""Less than this is what velocities scatter by, not gathering speed."""

ROUNDING_M: Final = 1e-9
"""What is left of a part taken away closes on nothing: scaled down by it, what goes along would be gone too."""

_DOWN: Vector = (0.0, 0.0, 1.0)
_UP: Vector = (0.0, 0.0, -1.0)
_STILL: Vector = (0.0, 0.0, 0.0)


class Stop(NamedTuple):
    """How a vehicle comes to stand still: displacement = drift + velocity · seconds, on the ground and vertically."""

    ground_s: float
    vertical_s: float
    drift_ned_m: Vector


def stop(asked_ned_m_s: Vector, flown_ned_m_s: Vector, envelope: Envelope) -> Stop:
    """Return how a vehicle comes to stand still.

    Args:
        asked_ned_m_s: What it is asked for, which lasts for as long as it brakes.
        flown_ned_m_s: What it flies, which it drifts with before it answers.
        envelope: Its braking and reaction.
    """
    (north, east, down), (flown_north, flown_east, flown_down) = asked_ned_m_s, flown_ned_m_s
    reaction_s = envelope.reaction_s
    return Stop(
        reaction_s + math.hypot(north, east) / (2.0 * envelope.braking_m_s2),
        reaction_s + abs(down) / (2.0 * envelope.vertical_braking_m_s2),
        (flown_north * reaction_s, flown_east * reaction_s, flown_down * reaction_s),
    )


def surge_ned_m(velocity_ned_m_s: Vector, acceleration_ned_m_s2: Vector, envelope: Envelope) -> Vector:
    """How much further a vehicle goes over the ground that is gathering speed, before it comes to rest.

    It lets go of an acceleration a no faster than its jerk j allows, in t = a/j, and is faster by Δv = a·t/2 then:
    v·t + a·t²/3 on the way, and Δv·reaction + ((v + Δv)² - v²)/(2 · braking) for what has to be stopped besides. An
    acceleration against the velocity is braking, and counts for nothing.

    Args:
        velocity_ned_m_s: Its present velocity.
        acceleration_ned_m_s2: Its present acceleration.
        envelope: Its jerk, braking and reaction.
    """
    north, east = acceleration_ned_m_s2[:2]
    speed = math.hypot(*velocity_ned_m_s[:2])
    if speed > 0.0:
        along = (velocity_ned_m_s[0] / speed, velocity_ned_m_s[1] / speed)
        braking = min(0.0, north * along[0] + east * along[1])
        north, east = north - braking * along[0], east - braking * along[1]
    size = math.hypot(north, east)
    if size <= _STEADY_M_S2:
        return (0.0, 0.0, 0.0)
    held = size - _STEADY_M_S2
    lasts_s = held / envelope.easing_m_s3
    gained = 0.5 * held * lasts_s
    stopped_m = gained * envelope.reaction_s + gained * (2.0 * speed + gained) / (2.0 * envelope.braking_m_s2)
    far_m = speed * lasts_s + held * lasts_s * lasts_s / 3.0 + stopped_m
    return (far_m * north / size, far_m * east / size, 0.0)


class VelocityConstraint(NamedTuple):
    """`normal_ned_s` points at what is forbidden, scaled by the seconds until the stop; `distance_m` is never negative.

    Law: max(0, ground part of normal · velocity) + max(0, vertical part of it) ≤ distance.
    """

    limiter: Limiter
    normal_ned_s: Vector
    distance_m: float

    def closed(self) -> "VelocityConstraint":
        """The same with nothing allowed: for accelerations, which must not push where a constraint is active."""
        return self._replace(distance_m=0.0)


def constrain(limiter: Limiter, normal_ned: Vector, distance_m: float, stop: Stop) -> VelocityConstraint:
    """Make a constraint.

    Args:
        limiter: Its name.
        normal_ned: Unit vector towards what is forbidden.
        distance_m: To what is forbidden, ≤ 0 beyond it.
        stop: How the vehicle comes to stand still.
    """
    (north, east, down), (drift_north, drift_east, drift_down) = normal_ned, stop.drift_ned_m
    drift_m = max(0.0, north * drift_north + east * drift_east) + max(0.0, down * drift_down)
    return VelocityConstraint(
        limiter,
        (north * stop.ground_s, east * stop.ground_s, down * stop.vertical_s),
        max(distance_m - drift_m, 0.0),
    )


def slide(velocity_ned_m_s: Vector, constraint: VelocityConstraint) -> Vector:
    """Take away what closes too fast and keep what goes along; the very same velocity where nothing does."""
    (north, east, down), (normal_north, normal_east, normal_down) = velocity_ned_m_s, constraint.normal_ned_s
    closing_ground = max(0.0, north * normal_north + east * normal_east)
    closing_vertical = max(0.0, down * normal_down)
    used_m = closing_ground + closing_vertical
    if used_m <= constraint.distance_m + ROUNDING_M:
        return velocity_ned_m_s
    taken = 1.0 - constraint.distance_m / used_m
    if closing_ground > 0.0:
        size_s = math.hypot(normal_north, normal_east)
        part = taken * closing_ground / size_s
        north, east = north - part * (normal_north / size_s), east - part * (normal_east / size_s)
    if closing_vertical > 0.0:
        down -= taken * down
    return (north, east, down)


def shrink(velocity_ned_m_s: Vector, constraint: VelocityConstraint) -> Vector:
    """Scale down, direction kept, until the constraint holds; those that held before still do."""
    (north, east, down), (normal_north, normal_east, normal_down) = velocity_ned_m_s, constraint.normal_ned_s
    closing_ground = max(0.0, north * normal_north + east * normal_east)
    closing_vertical = max(0.0, down * normal_down)
    used_m = closing_ground + closing_vertical
    if used_m <= constraint.distance_m + ROUNDING_M:
        return velocity_ned_m_s
    share = constraint.distance_m / used_m
    if closing_ground > 0.0:
        north, east = share * north, share * east
    if closing_vertical > 0.0:
        down *= share
    return (north, east, down)


def floor_or_ceiling(down_m_s: float, down_m: float, envelope: Envelope, stop: Stop) -> VelocityConstraint:
    """The vehicle would come to rest at or above the floor, or at or below the ceiling: whichever it is sent towards.

    Below the floor nothing descends, above the ceiling nothing climbs; the way back is free and not taken by itself
    (`hold_altitude` takes it).

    Args:
        down_m_s: What is asked for vertically, which no constraint reverses.
        down_m: Where the vehicle is, in its local frame.
        envelope: The limits: heights above home.
        stop: How the vehicle comes to stand still.
    """
    height_m = envelope.home_ned_m[2] - down_m
    if down_m_s > 0.0:
        return constrain(Limiter.FLOOR, _DOWN, height_m - envelope.floor_m, stop)
    return constrain(Limiter.CEILING, _UP, envelope.ceiling_m - height_m, stop)


def stand_off_constraints(
    velocity_ned_m_s: Vector, situation: Situation, envelope: Envelope
) -> tuple[VelocityConstraint, ...]:
    """The nearest point of the cylinder is forbidden; beside, above, or across its rim where both gaps are open.

    Above the cylinder, an evader that flees takes the constraint with it: only the closing speed beyond its own has to
    be braked. Should it stop dead, the vehicle flies past over it, at the height that it has. Beside the cylinder there
    is nothing to fly past over, and the law is that of an evader at rest, however fast it flees: it may stop at any
    time. In between, the last `COVER_M` above the lid, the one law goes over into the other. An evader that comes
    nearer does not push: its law is that of an evader at rest. Inside, what leads deeper is forbidden.
    """
    zone, evader = envelope.stand_off, situation.evader_position_ned_m
    if zone is None or evader is None:
        return ()
    north, east = evader[0] - situation.position_ned_m[0], evader[1] - situation.position_ned_m[1]
    distance_m = math.hypot(north, east)
    toward = (north / distance_m, east / distance_m) if distance_m > 0.0 else (0.0, 0.0)
    beside_m = max(0.0, distance_m - zone.radius_m)
    above_m = max(0.0, evader[2] - situation.position_ned_m[2] - zone.height_m)

    flight = situation.evader_velocity_ned_m_s or _STILL
    fleeing_m_s = max(0.0, flight[0] * toward[0] + flight[1] * toward[1]) * min(1.0, above_m / COVER_M)
    fleeing = (fleeing_m_s * toward[0], fleeing_m_s * toward[1], 0.0)
    seen_from_it = stop(
        difference(velocity_ned_m_s, fleeing), difference(situation.velocity_ned_m_s, fleeing), envelope
    )

    gap_m = math.hypot(beside_m, above_m)
    normals = [(beside_m / gap_m, above_m / gap_m)] if gap_m > 0.0 else [(1.0, 0.0), (0.0, 1.0)]
    found = []
    for level, steep in normals:
        one = constrain(Limiter.STAND_OFF, (level * toward[0], level * toward[1], steep), gap_m, seen_from_it)
        found.append(one._replace(distance_m=one.distance_m + level * fleeing_m_s * seen_from_it.ground_s))
    return tuple(found)


def polygon_constraints(fence: FenceGeometry, envelope: Envelope, stop: Stop) -> tuple[VelocityConstraint, ...]:
    """Return what the polygon forbids: to come to rest beyond an edge, less the margin.

    Args:
        fence: Where the vehicle is to the fences.
        envelope: The limits, of which the fence's margin is kept.
        stop: How the vehicle comes to stand still.
    """
    return tuple(
        constrain(Limiter.FENCE_POLYGON, (*edge.outward, 0.0), edge.gap_m - envelope.fence_margin_m, stop)
        for edge in fence.edges
    )


def keep_in_circle(velocity_ned_m_s: Vector, fence: FenceGeometry, envelope: Envelope, stop: Stop) -> Vector:
    """The vehicle would come to rest within the circle, or outside no further out than it is.

    The stop point is moved onto the circle where it lies beyond: along the fence the path is bent inwards, and the
    speed over the ground never rises.

    Args:
        velocity_ned_m_s: What is asked for.
        fence: Where the vehicle is to the fences.
        envelope: The limits: radius and margin.
        stop: How the vehicle comes to stand still.
    """
    if envelope.fence_radius_m is None:
        return velocity_ned_m_s
    north_m, east_m = fence.about_home_m
    drift_m = max(0.0, math.hypot(north_m + stop.drift_ned_m[0], east_m + stop.drift_ned_m[1]) - fence.from_home_m)
    limit_m = max(envelope.fence_radius_m - envelope.fence_margin_m - drift_m, fence.from_home_m)
    north, east = north_m + velocity_ned_m_s[0] * stop.ground_s, east_m + velocity_ned_m_s[1] * stop.ground_s
    reached_m = math.hypot(north, east)
    if reached_m <= limit_m:
        return velocity_ned_m_s
    share = limit_m / reached_m
    return (
        (share * north - north_m) / stop.ground_s,
        (share * east - east_m) / stop.ground_s,
        velocity_ned_m_s[2],
    )


def circle_constraint(fence: FenceGeometry) -> VelocityConstraint:
    """Return the circle as a constraint on accelerations, once it acts on the velocity."""
    return VelocityConstraint(Limiter.FENCE_RADIUS, (*fence.about_home_m, 0.0), 0.0)


class Feasible(NamedTuple):
    """A velocity that every limit in space allows, and the constraints that took something away from the one asked."""

    velocity_ned_m_s: Vector
    active: tuple[VelocityConstraint, ...]


def feasible_velocity(
    velocity_ned_m_s: Vector, situation: Situation, fence: FenceGeometry, envelope: Envelope
) -> Feasible:
    """Slide along every limit in turn, then scale until all hold at once.

    The sliding keeps as much of the motion as may be; the scaling makes it exact where limits meet in a corner, and
    leaves the circle's law alone: what may be may also be slower. Speed over the ground and vertical speed never rise.

    Args:
        velocity_ned_m_s: What is asked for.
        situation: Where vehicle and evader are.
        fence: Where the vehicle is to the fences.
        envelope: What is allowed.
    """
    stopping = stop(velocity_ned_m_s, situation.velocity_ned_m_s, envelope)
    surge = surge_ned_m(situation.velocity_ned_m_s, situation.acceleration_ned_m_s2, envelope)
    north_m, east_m, down_m = stopping.drift_ned_m
    stopping = stopping._replace(drift_ned_m=(north_m + surge[0], east_m + surge[1], down_m))
    constraints = (
        *stand_off_constraints(velocity_ned_m_s, situation, envelope),
        *polygon_constraints(fence, envelope, stopping),
        floor_or_ceiling(velocity_ned_m_s[2], situation.position_ned_m[2], envelope, stopping),
    )
    active: list[VelocityConstraint] = []
    velocity = velocity_ned_m_s
    for one in constraints:
        slid = slide(velocity, one)
        if slid is not velocity:
            active.append(one)
            velocity = slid
    inside = keep_in_circle(velocity, fence, envelope, stopping)
    if inside is not velocity:
        active.append(circle_constraint(fence))
        velocity = inside
    for one in constraints if active else ():
        velocity = shrink(velocity, one)
    return Feasible(velocity, tuple(active))
