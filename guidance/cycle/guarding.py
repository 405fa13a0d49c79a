"""How soon this vehicle can guard the target of TAD, against the time in which the evader can be there.

All velocities here are relative to the target, so that one that moves is met where it will be. The vehicle first flies
on for a while, and then turns towards a point X of the target, where it stops in time. The margin of X is the evader's
time to X less the vehicle's, and the margin of the target is the least over its outline. The vehicle's velocity counts
for every X by itself: a vehicle that flies along a target has to reverse to guard the part behind it.

**Which point is guarded.** The vehicle flies to the point of the target that is closest to the game's meeting point.
With a small margin the meeting point lies near the target, and near the point that is most in danger.

**Reversing again.** A vehicle above a point guards everything within the disc's radius. If the target is larger, the
guarded point moves with the evader, at its speed v at most. After that the vehicle may have to reverse: the reversal
from v takes v/a longer than a start from rest, and costs v²/(2a) more metres, with the acceleration a.
"""

import math
from functools import lru_cache
from typing import Final, NamedTuple

from guidance.control.braking_law import approach_speed
from guidance.cycle.players import Players, Vehicle, late_start
from guidance.frames import Vector
from guidance.game import Extent, Game, StateSolution
from guidance.game.arrays import FLOATS
from guidance.game.extent import to_set
from guidance.game.meeting_times import catch_in_ball
from guidance.game.pe import take_apart
from guidance.game.tad import guard_time

Point = tuple[float, float]

GUARD_LAG_S: Final = 1.0
"""Time constant of the stop above the target; with the reaction time, commands that change late make it overshoot."""

UNSURE_S: Final = 0.25
UNSURE: Final = 0.03
"""Time that the estimates may be wrong by, and share of the time to the meeting."""

_SLOWEST_M_S: Final = 0.1
_TINY_M: Final = 1e-9
_SPACING_M: Final = 3.0
_FEWEST: Final = 8


class Guard(NamedTuple):
    """A flight to the target.

    Attributes:
        velocity_m_s: Of the flight, in the game frame.
        margin_s: How much sooner the vehicle can guard the target than the evader is there.
        holds_target: Whether a vehicle that stops above the guarded point guards all of the target.
    """

    velocity_m_s: Vector
    margin_s: float
    holds_target: bool


class _Flight(NamedTuple):
    """A vehicle that begins to fly to the target.

    Attributes:
        game: What is played.
        shown: The same with the speed that the vehicle has shown.
        players: Where both are now.
        vehicle: What the vehicle can do.
        from_m: Where the vehicle begins, after it has flown on.
        target_m: Where the target is then, x and y.
        up_m_s: Its vertical speed.
    """

    game: Game
    shown: Game
    players: Players
    vehicle: Vehicle
    from_m: Vector
    target_m: Point
    up_m_s: float


def guard(
    game: Game,
    shown: Game,
    solution: StateSolution,
    players: Players,
    vehicle: Vehicle,
    flies_on_s: float,
) -> Guard:
    """Return the flight to the target of a vehicle that flies on at its present velocity before.

    Args:
        game: What is played.
        shown: The same with the speed that the vehicle has shown.
        solution: Of the game.
        players: From where.
        vehicle: What it can do.
        flies_on_s: Time for which it flies on.
    """
    flight = _begun(game, shown, solution, players, vehicle, flies_on_s)
    holds_target = _width_m(game.target_extent) <= game.standoff.radius_m
    levelling_s = _levelling_s(flight)
    unsure_s = UNSURE * solution.meeting_time_s
    margin_s = math.inf
    race = _race_above if holds_target else _race_beside
    for offset_m in _outline(game.target_extent):
        sooner_s, lost_s = race(flight, offset_m, levelling_s)
        needed_s = flies_on_s + lost_s + UNSURE_S + unsure_s
        margin_s = min(margin_s, min(sooner_s, solution.margin_s) - needed_s)
    guarding_m_s = _velocity_to(flight, _guarded_point(flight, solution), 0.0, GUARD_LAG_S)
    return Guard(guarding_m_s, margin_s, holds_target)


def _begun(
    game: Game,
    shown: Game,
    solution: StateSolution,
    players: Players,
    vehicle: Vehicle,
    flies_on_s: float,
) -> _Flight:
    """Return the flight of a vehicle that has flown on for a while."""
    east_m, north_m, height_m = players.pursuer_m
    east_m_s, north_m_s, _ = players.pursuer_m_s
    from_m = (east_m + flies_on_s * east_m_s, north_m + flies_on_s * north_m_s, height_m)
    x_m, y_m, _ = players.target_m or (math.nan, math.nan, math.nan)
    x_m_s, y_m_s = game.target_velocity_m_s
    target_m = (x_m + flies_on_s * x_m_s, y_m + flies_on_s * y_m_s)
    up_m_s = solution.pursuer_velocity_m_s[2]
    return _Flight(game, shown, players, vehicle, from_m, target_m, up_m_s)


def _race_above(flight: _Flight, offset_m: Point, levelling_s: float) -> tuple[float, float]:
    """Return how much sooner than the evader a vehicle is at a point above which it stops, and the time lost, s."""
    game = flight.shown
    braking_m_s2 = flight.vehicle.envelope.braking_m_s2
    late_m = _late(flight, _velocity_to(flight, offset_m, 0.0, GUARD_LAG_S))
    arrival_s, goal_m = _arrival(flight, offset_m)
    state = take_apart(FLOATS, game, late_m, flight.players.evader_m, flight.players.evader_m_s)
    sooner_s = arrival_s - guard_time(FLOATS, game, state, goal_m)
    radius_m = game.standoff.radius_m
    if _away_m(flight, offset_m, late_m) <= radius_m:
        return sooner_s, levelling_s
    # Of the whole way to the point at the game's speed, the last part is slower.
    u = flight.game.pursuer.horizontal_m_s
    rim_m_s = approach_speed(radius_m, braking_m_s2, GUARD_LAG_S)
    rim_m_s = min(u, max(_SLOWEST_M_S, rim_m_s))
    braking_s = (u - rim_m_s) ** 2 / (2.0 * braking_m_s2 * u)
    braking_s += GUARD_LAG_S * (math.log(u / rim_m_s) - 1.0 + rim_m_s / u)
    return sooner_s, max(braking_s, levelling_s)


def _race_beside(flight: _Flight, offset_m: Point, levelling_s: float) -> tuple[float, float]:
    """Return the same for a vehicle that stops at the rim of the disc of an evader at that point."""
    game = flight.shown
    vehicle = flight.vehicle
    approach = vehicle.approach
    rest_m = game.standoff.radius_m + approach.margin_m
    braking_m_s2 = approach.braking_m_s2
    lag_s = approach.lag_s + approach.settle_s
    late_m = _late(flight, _velocity_to(flight, offset_m, rest_m, lag_s))
    arrival_s, goal_m = _arrival(flight, offset_m)
    state = take_apart(FLOATS, game, late_m, flight.players.evader_m, flight.players.evader_m_s)
    ideal_s = guard_time(FLOATS, game, state, goal_m)
    # It brakes as if to come to rest outside the rim, and captures before that.
    left_m = _away_m(flight, offset_m, late_m) - rest_m
    capture_m = max(_TINY_M, vehicle.tolerance_m - approach.margin_m)
    flown_s = 0.0
    if left_m > capture_m:
        u = game.pursuer.horizontal_m_s
        fast_m_s = min(u, approach_speed(left_m, braking_m_s2, lag_s))
        rim_m_s = min(u, max(_SLOWEST_M_S, approach_speed(capture_m, braking_m_s2, lag_s)))
        flown_s = (fast_m_s - rim_m_s) / braking_m_s2 + lag_s * math.log(fast_m_s / rim_m_s)
        slow_from_m = fast_m_s * lag_s + fast_m_s * fast_m_s / (2.0 * braking_m_s2)
        flown_s += max(0.0, left_m - slow_from_m) / u
    if abs(flight.players.gaps.height_m) <= vehicle.tolerance_m:
        levelling_s = 0.0
    return arrival_s - max(flown_s, ideal_s + levelling_s), 0.0


def _late(flight: _Flight, velocity_m_s: Vector) -> Vector:
    """Return where a pursuer that has this velocity at once does as well as the vehicle."""
    flown_m_s = flight.players.pursuer_m_s
    return late_start(flight.from_m, velocity_m_s, flown_m_s, flight.vehicle.acceleration)


def _away_m(flight: _Flight, offset_m: Point, from_m: Vector) -> float:
    """Return the distance over the ground from a place to a point of the target, when the flight begins."""
    x_m = flight.target_m[0] + offset_m[0] - from_m[0]
    y_m = flight.target_m[1] + offset_m[1] - from_m[1]
    return math.hypot(x_m, y_m)


def _arrival(flight: _Flight, offset_m: Point) -> tuple[float, Point]:
    """Return when the evader can be at a point of the target, and the vector from the evader to where that is then."""
    game = flight.shown
    players = flight.players
    x_m, y_m, _ = players.target_m or (math.nan, math.nan, math.nan)
    x_m += offset_m[0] - players.evader_m[0]
    y_m += offset_m[1] - players.evader_m[1]
    to_point_m = (x_m, y_m)
    v = game.evader_speed_m_s
    age_s = game.information_age_s
    x_m_s, y_m_s = game.target_velocity_m_s
    if x_m_s == 0.0 and y_m_s == 0.0:
        return max(FLOATS.norm2(to_point_m) / v - age_s, 0.0), to_point_m
    time_s = catch_in_ball(FLOATS, v, v * age_s, to_point_m, (x_m_s, y_m_s), 0.0)
    return time_s, (to_point_m[0] + x_m_s * time_s, to_point_m[1] + y_m_s * time_s)


def _velocity_to(flight: _Flight, offset_m: Point, short_m: float, lag_s: float) -> Vector:
    """Return the velocity to a point of the target, slow enough to stop short of it, relative to the target."""
    x = flight.target_m[0] + offset_m[0] - flight.from_m[0]
    y = flight.target_m[1] + offset_m[1] - flight.from_m[1]
    away_m = math.hypot(x, y)
    x_m_s, y_m_s = flight.game.target_velocity_m_s
    if away_m == 0.0:
        return (x_m_s, y_m_s, flight.up_m_s)
    u = flight.game.pursuer.horizontal_m_s
    along_m_s = (x * x_m_s + y * y_m_s) / away_m
    across_square = x_m_s * x_m_s + y_m_s * y_m_s - along_m_s * along_m_s
    fastest_m_s = math.sqrt(u * u - across_square) - along_m_s
    braking_m_s2 = flight.vehicle.envelope.braking_m_s2
    pace = min(fastest_m_s, approach_speed(away_m - short_m, braking_m_s2, lag_s)) / away_m
    return (x_m_s + pace * x, y_m_s + pace * y, flight.up_m_s)


def _levelling_s(flight: _Flight) -> float:
    """Return the time lost by braking to the height of the disc, until the vehicle is within tolerance."""
    rate_m_s = abs(flight.up_m_s)
    if rate_m_s == 0.0:
        return 0.0
    vehicle = flight.vehicle
    players = flight.players
    braking_m_s2 = vehicle.envelope.vertical_braking_m_s2
    excess_m_s = max(0.0, rate_m_s - math.sqrt(2.0 * braking_m_s2 * vehicle.tolerance_m))
    height_m = players.pursuer_m[2] - players.evader_m[2] - flight.game.standoff.height_m
    slower_s = (1.0 - vehicle.acceleration.descent_share) * abs(height_m) / rate_m_s
    return excess_m_s**2 / (2.0 * braking_m_s2 * rate_m_s) + slower_s


def _guarded_point(flight: _Flight, solution: StateSolution) -> Point:
    """Return the point of the target that is closest to the meeting point, from the target's position then."""
    game = flight.game
    x_m, y_m, _ = flight.players.target_m or (math.nan, math.nan, math.nan)
    time_s = solution.meeting_time_s
    x_m = solution.meeting_point_m[0] - x_m - game.target_velocity_m_s[0] * time_s
    y_m = solution.meeting_point_m[1] - y_m - game.target_velocity_m_s[1] * time_s
    if game.target_extent.is_point:
        return game.target_extent.corners_m[0]
    to_target_m = to_set(FLOATS, game.target_extent, (x_m, y_m))
    return (x_m + to_target_m[0], y_m + to_target_m[1])


@lru_cache
def _outline(extent: Extent) -> tuple[Point, ...]:
    """Return points of the target's edge, from its position, at most `_SPACING_M` apart; of a point, itself."""
    corners = extent.corners_m
    radius_m = extent.radius_m
    points: list[Point] = []
    if len(corners) > 1:
        for begin, end in zip(corners, (*corners[1:], corners[0]), strict=True):
            points += _edge(begin, end, radius_m)
    if radius_m == 0.0:
        return tuple(dict.fromkeys((*points, *corners)))
    steps = max(_FEWEST, math.ceil(math.tau * radius_m / _SPACING_M))
    for step in range(steps):
        x = math.cos(math.tau * step / steps)
        y = math.sin(math.tau * step / steps)
        corner = max(corners, key=lambda corner: corner[0] * x + corner[1] * y)
        points.append((corner[0] + radius_m * x, corner[1] + radius_m * y))
    return tuple(points)


def _edge(begin: Point, end: Point, radius_m: float) -> list[Point]:
    """Return points of an edge, moved outwards by a radius; the corners run counterclockwise."""
    way_x = end[0] - begin[0]
    way_y = end[1] - begin[1]
    length_m = math.hypot(way_x, way_y)
    out_x = radius_m * way_y / length_m
    out_y = -radius_m * way_x / length_m
    steps = max(1, math.ceil(length_m / _SPACING_M))
    points = []
    for step in range(steps + 1):
        share = step / steps
        points.append((begin[0] + share * way_x + out_x, begin[1] + share * way_y + out_y))
    return points


@lru_cache
def _width_m(extent: Extent) -> float:
    """Return the largest distance between two points of the target."""
    corners = extent.corners_m
    widest_m = max(math.dist(corner, other) for corner in corners for other in corners)
    return widest_m + 2.0 * extent.radius_m
