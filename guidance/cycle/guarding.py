"""The vehicle's margin in TAD: how much sooner than the evader it can be on each of the evader's ways to the target.

An evader that runs straight to a point X of the target is at a place Y of this way at a known time. The vehicle's
slack at Y is that time less its own time to Y. Its slack on the way is the largest one of all Y: there it can wait for
the evader with the most time to spare. The margin is the smallest slack of the ways to the points of the target's edge.
Minima and maxima of continuous functions are continuous, so the margin is a continuous function of both players'
positions, of the vehicle's velocity and of what it was commanded: it has no meeting that can be lost from one cycle to
the next.

**The vehicle's time.** In its reaction time the vehicle comes to the velocity that it is bound for by the commands sent
so far. Then it accelerates to the one towards Y (`guidance.cycle.players.late_start`). Without the first step the play
would answer a motion that is about to end, and the vehicle would swing from one side to the other. The vehicle brakes
before the rim of the disc about an evader at Y as its approach does: to rest, or to the evader's velocity if that runs
away from it (`guidance.control.arrival`). Its time is the larger one of this and of the time to the disc's height. It
is at least the time of its change of velocity, because a vehicle that is too fast to stop at a place passes it.

**One point.** A vehicle above a point guards everything within the disc's radius. If the target is no wider than that,
the only place that counts is X itself, and the vehicle has to be slow enough at the rim of the disc about X to stop
above it. There it waits, whatever the evader does.

**Wide targets.** The vehicle flies to the place where its slack decides the margin. If that is at the end of the way,
its slack there does not fall, however the evader turns: the vehicle's time falls as fast as the clock runs, the
evader's no faster. The margin may fall meanwhile if another way becomes the worst.

**Too high.** An evader that runs at a vehicle above its disc pushes it before itself, because the vehicle keeps out of
the stand-off. Then it turns. So the vehicle is taken to have been pushed away from each Y for the time that it needs to
the disc's height, less the evader's time to the vehicle.

All velocities here are relative to the target, so a target that moves is met where it will be.
"""

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from guidance.control.arrival import Stop, closing_s, meeting_s
from guidance.cycle.players import NOWHERE, Capability, Players
from guidance.frames import Enu
from guidance.game import Extent, Game, StateSolution
from guidance.game.arrays import FLOATS, Array
from guidance.game.extent import to_set

GUARD_LAG_S: Final = 1.0
"""Time constant of the stop above the target, to which the reaction time is added."""

UNSURE_S: Final = 0.25
UNSURE: Final = 0.03
"""Allowance for errors of the estimates: a time, and a share of the time to the meeting."""

_WIDE_UNSURE_S: Final = 0.2
"""The time at a wide target, where a vehicle with the verdict "pursuer" flies so as to keep it."""

_TINY_M: Final = 1e-9
_SPACING_M: Final = 3.0
_FEWEST: Final = 8
_PLACES: Final = 16
"""The slack is computed at so many places on a way."""
_WORST: Final = 32
"""It is computed on so many ways: those with the least slack at their end. For the others that slack counts."""


class Guard(NamedTuple):
    """A flight to the target.

    Attributes:
        velocity_m_s: Of the flight, in the game frame.
        margin_s: How much sooner the vehicle can guard the target than the evader is there.
    """

    velocity_m_s: Enu
    margin_s: float


class _Race(NamedTuple):
    """Both players over the ground, relative to the target, and the vehicle's performance.

    Attributes:
        pursuer_m: Where the vehicle is, less what it loses until it has its velocity.
        pursuer_m_s: The velocity that it is bound for.
        evader_m: Position of the evader.
        target_m_s: Velocity of the target over the ground.
        speed_m_s: Speed of the vehicle over the ground.
        acceleration_m_s2: Guaranteed acceleration.
        flies_on_s: Time before it accelerates.
        height_m: Height that shares the speed with the ground; 0 if it has one of its own.
        evader_speed_m_s: Speed of the evader.
        pushed_s: For how long the evader can push the vehicle, which is too high to capture it, before itself.
    """

    pursuer_m: Array
    pursuer_m_s: Array
    evader_m: Array
    target_m_s: Array
    speed_m_s: float
    acceleration_m_s2: float
    flies_on_s: float
    height_m: float
    evader_speed_m_s: float
    pushed_s: float = 0.0


def guard(
    game: Game,
    shown: Game,
    solution: StateSolution,
    players: Players,
    vehicle: Capability,
    flies_on_s: float,
    *,
    descends_at_once: bool = False,
) -> Guard:
    """Return the flight to the target of a vehicle that first flies on at the velocity that it is bound for.

    Args:
        game: The game.
        shown: The game with the speed that the vehicle has shown.
        solution: Solution of the game.
        players: Positions and velocities.
        vehicle: Description of the vehicle.
        flies_on_s: Time before the vehicle turns: its reaction time, or more for a play that looks further ahead.
        descends_at_once: Whether it descends in this time. The verdict counts that; the play is more cautious.
    """
    race = _race(shown, players, vehicle, flies_on_s)
    level_s = _level_s(shown, players, vehicle)
    if not descends_at_once:
        level_s += flies_on_s
    radius_m = float(shown.standoff.radius_m)
    reaction_s = vehicle.envelope.reaction_s
    approach = vehicle.approach
    at_rim = Stop(
        approach.braking_m_s2,
        approach.lag_s + approach.settle_s,
        short_m=radius_m + approach.margin_m,
        arrived_m=max(_TINY_M, vehicle.tolerance_m - approach.margin_m),
    )
    points_m = outline(shown.target_extent)
    if is_held(game):
        stop = Stop(vehicle.envelope.braking_m_s2, GUARD_LAG_S, 0.0, radius_m)
        # The flight brakes from where the vehicle will be after its reaction: as with a time constant longer by that.
        above = stop._replace(lag_s=GUARD_LAG_S + reaction_s)
        arrivals_s, _ = _arrivals(race, shown, points_m)
        rim_s = _ground_s(race, points_m, at_rim)
        above_s = flies_on_s - reaction_s + _ground_s(race, points_m, above)
        slack_s = float((arrivals_s - np.maximum(np.maximum(rim_s, above_s), level_s)).min())
        unsure_s = UNSURE_S
        goal_m = np.array(_guarded_point(game, solution, players))
    else:
        pushed_s = level_s - max(0.0, players.gaps.ground_m) / shown.evader_speed_m_s
        race = race._replace(pushed_s=max(0.0, pushed_s))
        slack_s, goal_m = _least_slack(race, shown, points_m, level_s, at_rim)
        unsure_s = _WIDE_UNSURE_S
        stop = at_rim._replace(braking_m_s2=vehicle.envelope.braking_m_s2, short_m=0.0)
    margin_s = min(slack_s, solution.margin_s) - unsure_s - UNSURE * solution.meeting_time_s
    race = race._replace(
        speed_m_s=game.pursuer.horizontal_m_s,
        flies_on_s=_looks_ahead_s(players, vehicle, flies_on_s),
    )
    east_m_s, north_m_s = (_velocity_to(race, goal_m, stop) + race.target_m_s).tolist()
    return Guard(Enu((east_m_s, north_m_s, solution.pursuer_velocity_m_s[2])), margin_s)


def is_held(game: Game) -> bool:
    """Return whether a vehicle that stops above a point of the target guards the whole target."""
    return _width_m(game.target_extent) <= float(game.standoff.radius_m)


def _race(shown: Game, players: Players, vehicle: Capability, flies_on_s: float) -> _Race:
    """Return both players over the ground, relative to the target."""
    target_m = np.array((NOWHERE if players.target_m is None else players.target_m)[:2])
    target_m_s = np.array(shown.target_velocity_m_s)
    pursuer_m = np.array(players.pursuer_m[:2])
    pursuer_m_s = np.array(players.pursuer_m_s[:2])
    if players.bound_for_m_s is not None:
        # It gains this velocity evenly in its reaction time, and loses half of what it would fly meanwhile.
        bound_for_m_s = np.array(players.bound_for_m_s[:2])
        pursuer_m -= (bound_for_m_s - pursuer_m_s) * (0.5 * vehicle.envelope.reaction_s)
        pursuer_m_s = bound_for_m_s
    return _Race(
        pursuer_m - target_m,
        pursuer_m_s - target_m_s,
        np.array(players.evader_m[:2]) - target_m,
        target_m_s,
        shown.pursuer.horizontal_m_s,
        vehicle.acceleration.ground_m_s2,
        flies_on_s,
        0.0 if shown.pursuer.separate else players.gaps.height_m,
        shown.evader_speed_m_s,
    )


def _least_slack(
    race: _Race, game: Game, points_m: Array, level_s: float, stop: Stop
) -> tuple[float, Array]:
    """Return the smallest slack of the ways to points of the target, s, and the place where the vehicle has it."""
    arrivals_s, runs_m = _arrivals(race, game, points_m)
    runs_m_s = runs_m / np.maximum(arrivals_s, _TINY_M)[:, None]
    at_end_s = arrivals_s - np.maximum(_ground_s(race, points_m, stop, runs_m_s), level_s)
    order = np.argsort(at_end_s, kind="stable")
    worst = order[:_WORST]
    # Close together at the beginning, where the vehicle may capture the evader before it passes by.
    shares = (np.arange(1, _PLACES + 1) / _PLACES) ** 2
    age_s = game.information_age_s
    times_s = np.maximum(0.0, shares * (arrivals_s[worst, None] + age_s) - age_s)
    places_m = race.evader_m + shares[:, None] * runs_m[worst, None]
    ground_s = _ground_s(race, places_m, stop, runs_m_s[worst, None])
    slack_s = times_s - np.maximum(ground_s, level_s)
    best = slack_s.argmax(axis=1)
    on_way_s = slack_s.max(axis=1)
    least = int(on_way_s.argmin())
    smallest_s = float(on_way_s[least])
    if len(order) > _WORST:
        # A way that was left out has at least this slack. So the smaller one of both is continuous, too.
        smallest_s = min(smallest_s, float(at_end_s[order[_WORST]]))
    return smallest_s, places_m[least, best[least]]


def _arrivals(race: _Race, game: Game, points_m: Array) -> tuple[Array, Array]:
    """Return when the evader can be at points of the target, s, and the ways to them, relative to the target."""
    v = game.evader_speed_m_s
    ahead_m = v * game.information_age_s
    ways_m = points_m - race.evader_m
    # |way + target's velocity · t| = v (t + age)
    drift_m_s = race.target_m_s
    square = v * v - float(drift_m_s @ drift_m_s)
    half = ways_m @ drift_m_s - v * ahead_m
    beyond = np.maximum(np.vecdot(ways_m, ways_m) - ahead_m**2, 0.0)
    arrivals_s = np.where(beyond > 0.0, (half + np.sqrt(half**2 + square * beyond)) / square, 0.0)
    return arrivals_s, ways_m


def _ground_s(race: _Race, places_m: Array, stop: Stop, evader_m_s: Array | None = None) -> Array:
    """Return the vehicle's times over the ground to places.

    Args:
        race: The race.
        places_m: The places, from the target.
        stop: How it brakes before them.
        evader_m_s: Velocities of evaders that it meets there, to which it brakes if they run away from it. Without, it
            brakes to rest.
    """
    flown_m_s = _pushed_m_s(race, places_m)
    # If it would come to rest further away from the place than it is now, it has to come back from there.
    rest_m = race.pursuer_m + _lost_m(race, flown_m_s)
    ways_m = places_m - race.pursuer_m
    back_m = places_m - rest_m
    away_m = np.maximum(_length(ways_m), _TINY_M)
    far_m = _length(back_m)
    beyond = np.minimum(np.maximum(far_m / away_m - 1.0, 0.0), 1.0)
    headings = (ways_m + beyond[..., None] * back_m) / (away_m + beyond * far_m)[..., None]
    fastest_m_s = _fastest_m_s(race, headings)
    fleeing_m_s: Array | float = 0.0
    if evader_m_s is not None:
        # Within the disc, where the heading may be any, it need not flee with the evader.
        inside = np.minimum(1.0, away_m / stop.short_m)
        fleeing_m_s = np.maximum(0.0, np.vecdot(headings, evader_m_s)) * inside
    closing = 1.0 - fleeing_m_s / fastest_m_s
    # On its way back it accelerates: at half of the additional way it is as fast as counts here.
    way_m = 0.5 * (away_m + np.maximum(away_m, far_m))
    allowed_m_s = fleeing_m_s + stop.allowed_m_s(closing * (way_m - stop.short_m))
    missing_m_s = np.minimum(fastest_m_s, allowed_m_s)[..., None] * headings - flown_m_s
    late_m = race.pursuer_m - _lost_m(race, missing_m_s)
    left_m = _length(places_m - late_m) - stop.short_m
    if race.height_m != 0.0:
        left_m = np.hypot(np.maximum(left_m, 0.0), race.height_m)
    if evader_m_s is None:
        time_s = closing_s(left_m, fastest_m_s, stop)
    else:
        time_s = meeting_s(left_m, fastest_m_s, fleeing_m_s, stop)
    # A vehicle that flies too fast to stop before the place is not there before it has braked.
    return np.asarray(np.maximum(time_s, _length(missing_m_s) / race.acceleration_m_s2))


def _pushed_m_s(race: _Race, places_m: Array) -> Array:
    """Return the vehicle's velocities after an evader has pushed it away from each of the places."""
    if race.pushed_s == 0.0:
        return race.pursuer_m_s
    ways_m = places_m - race.pursuer_m
    pushed_m_s = -race.evader_speed_m_s * ways_m / np.maximum(_length(ways_m), _TINY_M)[..., None]
    change_m_s = pushed_m_s - race.pursuer_m_s
    most_m_s = race.acceleration_m_s2 * race.pushed_s
    part = np.minimum(1.0, most_m_s / np.maximum(_length(change_m_s), _TINY_M))
    return np.asarray(race.pursuer_m_s + part[..., None] * change_m_s)


def _lost_m(race: _Race, missing_m_s: Array) -> Array:
    """Return how far a vehicle falls behind one that has these velocities more at once."""
    turning_s = _length(missing_m_s) / (2.0 * race.acceleration_m_s2)
    return np.asarray(missing_m_s * (race.flies_on_s + turning_s)[..., None])


def _fastest_m_s(race: _Race, headings: Array) -> Array:
    """Return the vehicle's largest speed relative to the target, in some directions."""
    drift_m_s = race.target_m_s
    along_m_s = headings @ drift_m_s
    across_square = float(drift_m_s @ drift_m_s) - along_m_s**2
    return np.asarray(np.sqrt(race.speed_m_s**2 - across_square) - along_m_s)


def _length(vectors: Array) -> Array:
    return np.asarray(np.sqrt(np.vecdot(vectors, vectors)))


def _velocity_to(race: _Race, place_m: Array, stop: Stop) -> Array:
    """Return the velocity to a place, slow enough to stop short of it, when the vehicle has flown on for a while."""
    race = race._replace(pursuer_m=race.pursuer_m + race.pursuer_m_s * race.flies_on_s)
    way_m = place_m - race.pursuer_m
    away_m = _length(way_m)
    heading = way_m / max(float(away_m), _TINY_M)
    speed_m_s = np.minimum(_fastest_m_s(race, heading), stop.allowed_m_s(away_m - stop.short_m))
    return np.asarray(speed_m_s * heading)


def _looks_ahead_s(players: Players, vehicle: Capability, flies_on_s: float) -> float:
    """Return how far a flight to the target looks ahead: by the reaction time that the margin counts.

    A vehicle that is too high looks as far ahead as the play, so it brakes earlier: an evader that passes below one
    that flies on is at the target first.
    """
    level = min(1.0, max(0.0, 2.0 - abs(players.gaps.height_m) / vehicle.tolerance_m))
    return flies_on_s - level * (flies_on_s - vehicle.envelope.reaction_s)


def _level_s(game: Game, players: Players, vehicle: Capability) -> float:
    """Return the time to the disc's height, within tolerance, of a vehicle that descends or climbs at once."""
    height_m = players.gaps.height_m
    rate_m_s = game.pursuer.horizontal_m_s
    if game.pursuer.separate:
        rate_m_s = game.pursuer.descent_m_s if height_m > 0.0 else game.pursuer.climb_m_s
    stop = Stop(vehicle.envelope.vertical_braking_m_s2, 0.0, 0.0, vehicle.tolerance_m)
    left_m = abs(height_m)
    missing_m_s = min(rate_m_s, float(stop.allowed_m_s(left_m)))
    missing_m_s += math.copysign(players.pursuer_m_s.up, height_m * players.pursuer_m_s.up)
    left_m += missing_m_s * abs(missing_m_s) / (2.0 * vehicle.acceleration.vertical_m_s2)
    # The tolerance is no gain: it is flown at full speed, unless the vehicle is nearly there.
    left_m += min(max(left_m - vehicle.tolerance_m, 0.0), vehicle.tolerance_m)
    return float(closing_s(left_m, rate_m_s, stop)) / vehicle.acceleration.descent_share


def _guarded_point(game: Game, solution: StateSolution, players: Players) -> tuple[float, float]:
    """Return the point of the target that is closest to the meeting point, from the target's position then."""
    x_m, y_m, _ = NOWHERE if players.target_m is None else players.target_m
    time_s = solution.meeting_time_s
    x_m = solution.meeting_point_m[0] - x_m - game.target_velocity_m_s[0] * time_s
    y_m = solution.meeting_point_m[1] - y_m - game.target_velocity_m_s[1] * time_s
    if game.target_extent.is_point:
        return game.target_extent.corners_m[0]
    to_target_m = to_set(FLOATS, game.target_extent, (x_m, y_m))
    return (x_m + to_target_m[0], y_m + to_target_m[1])


@lru_cache
def outline(extent: Extent) -> Array:
    """Return points of the target's edge, from its position, at most `_SPACING_M` apart; of a point, itself."""
    corners = extent.corners_m
    radius_m = extent.radius_m
    points: list[tuple[float, float]] = []
    if len(corners) > 1:
        for begin, end in zip(corners, (*corners[1:], corners[0]), strict=True):
            # Points of the edge, moved outwards by the radius; the corners run counterclockwise.
            way_x = end[0] - begin[0]
            way_y = end[1] - begin[1]
            length_m = math.hypot(way_x, way_y)
            out_x = radius_m * way_y / length_m
            out_y = -radius_m * way_x / length_m
            steps = max(1, math.ceil(length_m / _SPACING_M))
            for step in range(steps + 1):
                share = step / steps
                points.append((begin[0] + share * way_x + out_x, begin[1] + share * way_y + out_y))
    if radius_m == 0.0:
        return np.array(tuple(dict.fromkeys((*points, *corners))))
    steps = max(_FEWEST, math.ceil(math.tau * radius_m / _SPACING_M))
    for step in range(steps):
        x = math.cos(math.tau * step / steps)
        y = math.sin(math.tau * step / steps)
        corner = max(corners, key=lambda corner: corner[0] * x + corner[1] * y)
        points.append((corner[0] + radius_m * x, corner[1] + radius_m * y))
    return np.array(points)


@lru_cache
def _width_m(extent: Extent) -> float:
    """Return the largest distance between two points of the target."""
    corners = extent.corners_m
    widest_m = max(math.dist(corner, other) for corner in corners for other in corners)
    return widest_m + 2.0 * extent.radius_m
