"""The vehicle's margin in TAD: how much sooner it can guard the target than the evader can arrive.

All velocities here are relative to the target, so a target that moves is met where it will be. The vehicle first flies
on for its reaction time. Then it flies to a point X of the target and stops there in time. The margin of X is the
evader's time to X less the vehicle's time. The margin of the target is the smallest margin of the points of its
outline. The vehicle's velocity counts for each X separately: a vehicle that flies along a target has to reverse before
it can guard the part behind it.

**Guarded point.** The vehicle flies to the point of the target that is closest to the game's meeting point. With a
small margin, the meeting point lies near the target, and near the point that is most in danger. At a wide target it
flies to the point of the edge where its margin is smallest.

**Height.** A vehicle that descends already loses no reaction time if its height decides. So the vehicle's time is the
larger of two: reaction and flight over the ground, and descent.

**Braking.** Over the ground, the vehicle is slow enough at the rim of the disc about X to stop above X, and it brakes
before an evader at X as its approach brakes. The slower of the two counts.

**Wide targets.** A vehicle above a point guards everything within the disc's radius. On a larger target, the guarded
point moves with the evader, and the vehicle does not wait above it. It meets the evader on its way instead. For each X
its time is therefore the smaller of two: the time to the rim of the disc about X, and the time to a meeting with an
evader that runs straight to X. It flies to that meeting at full speed (`_interception_s`), or, near the rim, takes over
the evader's velocity and closes as its approach does (`_following_s`); the sooner of the two counts. A vehicle that is
still above the disc near its rim flies with the evader until it is level. So its margin counts with the evader's
velocity too (`_flies_with_evader`).

**Capture.** A vehicle at the disc's height and near its rim captures the evader before any point of a wide target is
in danger (`_capture_margin_s`). There an evader that runs straight away lasts longest: one that turns comes nearer.
"""

import math
from functools import lru_cache
from typing import Final, NamedTuple

from guidance.control.braking_law import approach_speed
from guidance.cycle.players import Capability, Players, late_start
from guidance.frames import Enu
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
"""Allowance for errors of the estimates: a time, and a share of the time to the meeting."""

_WIDE_UNSURE_S: Final = 0.15
"""The time at a wide target, where a vehicle with the verdict "pursuer" flies so as to keep it."""

_SLOWEST_M_S: Final = 0.1
_TINY_M: Final = 1e-9
_SPACING_M: Final = 3.0
_FEWEST: Final = 8
_ROUNDS: Final = 30
_SAME_S: Final = 1e-3
_SAME_M: Final = 1e-3
"""Changes from round to round that end the rounds; a meeting that still changes in the last one is not counted on."""
_NEAR_RADII: Final = 3.0
"""Largest gap, in radii of the disc; closer than this, an evader that turns is captured sooner than one that flees."""
_BESIDE_RADII: Final = 2.0
"""Largest gap, in radii of the disc, at which a vehicle above the disc flies with the evader until it is level."""


class Guard(NamedTuple):
    """A flight to the target.

    Attributes:
        velocity_m_s: Of the flight, in the game frame.
        margin_s: How much sooner the vehicle can guard the target than the evader is there. Infinite in the play on a
            wide target with one speed for ground and height, because the vehicle plays the game's solution there.
    """

    velocity_m_s: Enu
    margin_s: float


class _Lead(NamedTuple):
    """The pursuer's smallest lead over the evader, s, and the point of the edge with it; None if the game's is less."""

    sooner_s: float
    offset_m: Point | None


class _Race(NamedTuple):
    """A race to a point of the target: the pursuer's lead over the evader, and the time that the vehicle loses, s."""

    sooner_s: float
    lost_s: float


class _GuardFlight(NamedTuple):
    """A vehicle that begins to fly to the target.

    Attributes:
        game: The game.
        shown: The same with the speed that the vehicle has shown.
        players: Where both are now.
        vehicle: Description of the vehicle.
        from_m: Position of the vehicle at the end of its reaction time.
        target_m: Where the target is then, x and y.
        up_m_s: Its vertical speed.
        flies_on_s: Time at the present velocity before the vehicle turns.
        descends_at_once: Whether it descends during this time, which is then lost over the ground only.
    """

    game: Game
    shown: Game
    players: Players
    vehicle: Capability
    from_m: Enu
    target_m: Point
    up_m_s: float
    flies_on_s: float
    descends_at_once: bool


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
    """Return the flight to the target of a vehicle that first flies on at its present velocity.

    Args:
        game: The game.
        shown: The game with the speed that the vehicle has shown.
        solution: Solution of the game.
        players: Positions and velocities.
        vehicle: Description of the vehicle.
        flies_on_s: Time at the present velocity before the vehicle turns.
        descends_at_once: Whether it descends in this time. The verdict counts that; the play is more cautious.
    """
    flight = _begun(game, shown, solution, players, vehicle, flies_on_s)
    holds_target = is_held(game)
    if not holds_target and shown.pursuer.separate:
        return _guard_beside(flight, solution)
    flight = flight._replace(descends_at_once=descends_at_once and shown.pursuer.separate)
    guarding_m_s = _velocity_to(flight, _guarded_point(flight, solution), 0.0, GUARD_LAG_S)
    if not holds_target and not descends_at_once:
        return Guard(guarding_m_s, math.inf)
    levelling_s = _levelling_s(flight)
    unsure_s = UNSURE_S + UNSURE * solution.meeting_time_s
    race = _race_above if holds_target else _race_in_ball
    margin_s = math.inf
    for offset_m in outline(game.target_extent):
        for sooner_s, lost_s in race(flight, offset_m, levelling_s):
            needed_s = lost_s + unsure_s
            margin_s = min(margin_s, min(sooner_s, solution.margin_s) - needed_s)
    if not holds_target:
        margin_s = max(margin_s, _margin_at_disc_s(flight, solution))
    return Guard(guarding_m_s, margin_s)


def is_held(game: Game) -> bool:
    """Return whether a vehicle that stops above a point of the target guards all of it."""
    return _width_m(game.target_extent) <= float(game.standoff.radius_m)


def _guard_beside(flight: _GuardFlight, solution: StateSolution) -> Guard:
    """Return the flight to a wide target: to the point of its edge that is most in danger."""
    flight = flight._replace(descends_at_once=True)
    lead = _lead_beside(flight, solution.margin_s)
    sooner_s = lead.sooner_s
    if _flies_with_evader(flight):
        players = flight.players
        with_evader_m_s = players.evader_m_s.level_with(players.pursuer_m_s.up)
        beside = _begun(
            flight.game,
            flight.shown,
            solution,
            players._replace(pursuer_m_s=with_evader_m_s),
            flight.vehicle,
            flight.flies_on_s,
        )
        beside = beside._replace(descends_at_once=True)
        sooner_s = min(sooner_s, _lead_beside(beside, solution.margin_s).sooner_s)
    offset_m = lead.offset_m
    if offset_m is None:
        offset_m = _guarded_point(flight, solution)
    guarding_m_s = _velocity_to(flight, offset_m, _rest_m(flight), _approach_lag_s(flight))
    unsure_s = _WIDE_UNSURE_S + UNSURE * solution.meeting_time_s
    margin_s = max(sooner_s - unsure_s, _margin_at_disc_s(flight, solution))
    return Guard(guarding_m_s, margin_s)


def _flies_with_evader(flight: _GuardFlight) -> bool:
    """Return whether the vehicle is near the disc's rim, but not yet at its height."""
    gaps = flight.players.gaps
    is_level = abs(gaps.height_m) <= flight.vehicle.tolerance_m
    return not is_level and gaps.ground_m <= _BESIDE_RADII * flight.shown.standoff.radius_m


def _margin_at_disc_s(flight: _GuardFlight, solution: StateSolution) -> float:
    """Return the margin of a capture near the rim; negative infinity elsewhere."""
    if not is_at_disc(flight.game, flight.players, flight.vehicle):
        return -math.inf
    unsure_s = UNSURE_S + UNSURE * solution.meeting_time_s
    return min(_capture_margin_s(flight), solution.margin_s) - unsure_s


def _begun(
    game: Game,
    shown: Game,
    solution: StateSolution,
    players: Players,
    vehicle: Capability,
    flies_on_s: float,
) -> _GuardFlight:
    """Return the flight of a vehicle that has flown on for a while."""
    flown_m = players.pursuer_m + players.pursuer_m_s * flies_on_s
    from_m = flown_m.level_with(players.pursuer_m.up)
    x_m, y_m, _ = players.target_m or (math.nan, math.nan, math.nan)
    x_m_s, y_m_s = game.target_velocity_m_s
    target_m = (x_m + flies_on_s * x_m_s, y_m + flies_on_s * y_m_s)
    up_m_s = solution.pursuer_velocity_m_s[2]
    return _GuardFlight(
        game, shown, players, vehicle, from_m, target_m, up_m_s, flies_on_s, descends_at_once=False
    )


def _race_above(flight: _GuardFlight, offset_m: Point, levelling_s: float) -> tuple[_Race, ...]:
    """Return the races to a point above which the vehicle stops; over the ground and in height, if those are two."""
    game = flight.shown
    late_m = _late(flight, _velocity_to(flight, offset_m, 0.0, GUARD_LAG_S))
    arrival_s, goal_m = _arrival(flight, offset_m)
    state = take_apart(FLOATS, game, late_m, flight.players.evader_m, flight.players.evader_m_s)
    braking_s = 0.0
    if _away_m(flight, offset_m, late_m) > game.standoff.radius_m:
        braking_s = _braking_above_s(flight)
    if flight.descends_at_once:
        level_s = max(0.0, game.pursuer.level_time(FLOATS, 0.0, state.z)) + levelling_s
        ground_s = guard_time(FLOATS, game, state._replace(z=0.0), goal_m)
        ideal_s = max(ground_s, _ideal_ground_s(flight, goal_m))
        ground_s = flight.flies_on_s + max(ideal_s + braking_s, _rim_s(flight, offset_m))
        return (_Race(arrival_s - max(ground_s, level_s), 0.0),)
    sooner_s = arrival_s - guard_time(FLOATS, game, state, goal_m)
    return (_Race(sooner_s, flight.flies_on_s + max(braking_s, levelling_s)),)


def _ideal_ground_s(flight: _GuardFlight, goal_m: Point) -> float:
    """Return the ideal pursuer's time over the ground to a point, from where the vehicle is now.

    So the reaction time is lost in full, also by a vehicle that flies to the point meanwhile.
    """
    players = flight.players
    state = take_apart(FLOATS, flight.game, players.pursuer_m, players.evader_m, players.evader_m_s)
    return guard_time(FLOATS, flight.game, state._replace(z=0.0), goal_m)


def _rim_s(flight: _GuardFlight, offset_m: Point) -> float:
    """Return the time to a capture at the rim of the disc about an evader at a point, as the approach brakes."""
    late_m = _late(flight, _velocity_to(flight, offset_m, _rest_m(flight), _approach_lag_s(flight)))
    left_m = _away_m(flight, offset_m, late_m) - _rest_m(flight)
    return _closing_s(flight, left_m, flight.shown.pursuer.horizontal_m_s)


def _braking_above_s(flight: _GuardFlight) -> float:
    """Return the time that the slower last part of the way to a point costs, up to the rim of the disc about it."""
    u = flight.game.pursuer.horizontal_m_s
    braking_m_s2 = flight.vehicle.envelope.braking_m_s2
    rim_m_s = approach_speed(flight.shown.standoff.radius_m, braking_m_s2, GUARD_LAG_S)
    rim_m_s = min(u, max(_SLOWEST_M_S, rim_m_s))
    braking_s = (u - rim_m_s) ** 2 / (2.0 * braking_m_s2 * u)
    return braking_s + GUARD_LAG_S * (math.log(u / rim_m_s) - 1.0 + rim_m_s / u)


def _lead_beside(flight: _GuardFlight, most_s: float) -> _Lead:
    """Return the smallest lead of a vehicle that meets the evader at a point of the target or on its way there.

    Args:
        flight: The flight.
        most_s: A lead that is not exceeded.
    """
    levelling_s = _levelling_s(flight)
    is_level = abs(flight.players.gaps.height_m) <= flight.vehicle.tolerance_m
    late_s = flight.flies_on_s
    lead = _Lead(most_s, None)
    for offset_m in outline(flight.shown.target_extent):
        arrival_s, goal_m = _arrival(flight, offset_m)
        late_m = _late(
            flight, _velocity_to(flight, offset_m, _rest_m(flight), _approach_lag_s(flight))
        )
        if not is_level:
            height_m = late_m[2] - flight.players.evader_m[2] - flight.shown.standoff.height_m
            level_s = max(0.0, flight.shown.pursuer.level_time(FLOATS, 0.0, height_m)) + levelling_s
            lead = lead._replace(sooner_s=min(lead.sooner_s, arrival_s - level_s))
        left_m = _away_m(flight, offset_m, late_m) - _rest_m(flight)
        ground_s = _closing_s(flight, left_m, flight.shown.pursuer.horizontal_m_s)
        # The other two times are asked for only where they decide.
        if arrival_s - ground_s - late_s < lead.sooner_s:
            ground_s = min(ground_s, _following_s(flight, goal_m))
        if arrival_s - ground_s - late_s < lead.sooner_s:
            ground_s = min(ground_s, _interception_s(flight, goal_m))
        if arrival_s - ground_s - late_s < lead.sooner_s:
            lead = _Lead(arrival_s - ground_s - late_s, offset_m)
    return lead


def _race_in_ball(flight: _GuardFlight, offset_m: Point, levelling_s: float) -> tuple[_Race, ...]:
    """Return the race of a vehicle with one speed for ground and height, which meets the evader at a point."""
    game = flight.shown
    late_m = _late(flight, _velocity_to(flight, offset_m, _rest_m(flight), _approach_lag_s(flight)))
    arrival_s, goal_m = _arrival(flight, offset_m)
    left_m = _away_m(flight, offset_m, late_m) - _rest_m(flight)
    rim_s = _closing_s(flight, left_m, game.pursuer.horizontal_m_s)
    state = take_apart(FLOATS, game, late_m, flight.players.evader_m, flight.players.evader_m_s)
    ideal_s = guard_time(FLOATS, game, state, goal_m)
    if abs(flight.players.gaps.height_m) > flight.vehicle.tolerance_m:
        ideal_s += levelling_s
    return (_Race(arrival_s - max(rim_s, ideal_s), flight.flies_on_s),)


def _rest_m(flight: _GuardFlight) -> float:
    """Return the distance from the evader where the approach ends at rest."""
    return float(flight.shown.standoff.radius_m) + flight.vehicle.approach.margin_m


def _approach_lag_s(flight: _GuardFlight) -> float:
    """Return the time constant of the approach to the rim."""
    return flight.vehicle.approach.lag_s + flight.vehicle.approach.settle_s


def _rim_speed_m_s(flight: _GuardFlight, fastest_m_s: float) -> float:
    """Return the closing speed at the distance from the rim that counts as captured."""
    approach = flight.vehicle.approach
    captured_m = max(_TINY_M, flight.vehicle.tolerance_m - approach.margin_m)
    speed_m_s = approach_speed(captured_m, approach.braking_m_s2, _approach_lag_s(flight))
    return min(fastest_m_s, max(_SLOWEST_M_S, speed_m_s))


def _allowed_m_s(flight: _GuardFlight, left_m: float) -> float:
    """Return the closing speed that the approach allows at a distance from its stop."""
    return approach_speed(left_m, flight.vehicle.approach.braking_m_s2, _approach_lag_s(flight))


def _closing_s(flight: _GuardFlight, left_m: float, fastest_m_s: float) -> float:
    """Return the time to a capture for a vehicle that brakes as if to stop outside the rim.

    Args:
        flight: The flight.
        left_m: Distance to its stop.
        fastest_m_s: Its closing speed before it brakes.
    """
    approach = flight.vehicle.approach
    braking_m_s2 = approach.braking_m_s2
    lag_s = _approach_lag_s(flight)
    if left_m <= max(_TINY_M, flight.vehicle.tolerance_m - approach.margin_m):
        return 0.0
    fast_m_s = min(fastest_m_s, approach_speed(left_m, braking_m_s2, lag_s))
    rim_m_s = _rim_speed_m_s(flight, fastest_m_s)
    braking_s = (fast_m_s - rim_m_s) / braking_m_s2 + lag_s * math.log(fast_m_s / rim_m_s)
    slow_from_m = fast_m_s * lag_s + fast_m_s * fast_m_s / (2.0 * braking_m_s2)
    return braking_s + max(0.0, left_m - slow_from_m) / fastest_m_s


def _interception_s(flight: _GuardFlight, goal_m: Point) -> float:
    """Return the time to a meeting with an evader that runs straight to a point, after the reaction time.

    The late start depends on the direction of the flight, and the direction on the meeting point, so both are computed
    in rounds, until the meeting stays where it is. If it never does, the time is infinite, because a meeting of an
    earlier round would come too early. Towards an evader that comes nearer the vehicle brakes to rest, else to the
    evader's speed.

    Args:
        flight: The flight.
        goal_m: Vector from the evader to that point.
    """
    run_m = math.hypot(*goal_m)
    if run_m == 0.0:
        return math.inf
    v = flight.shown.evader_speed_m_s
    run_m_s = (v * goal_m[0] / run_m, v * goal_m[1] / run_m)
    u = flight.shown.pursuer.horizontal_m_s
    evader_x_m = flight.players.evader_m[0] + run_m_s[0] * flight.flies_on_s
    evader_y_m = flight.players.evader_m[1] + run_m_s[1] * flight.flies_on_s
    late_m = flight.from_m
    meeting_s = math.inf
    for _ in range(_ROUNDS):
        before_s = meeting_s
        to_evader_m = (evader_x_m - late_m[0], evader_y_m - late_m[1])
        meeting_s = catch_in_ball(FLOATS, u, _rest_m(flight), to_evader_m, run_m_s, 0.0)
        x_m = evader_x_m + run_m_s[0] * meeting_s - flight.from_m[0]
        y_m = evader_y_m + run_m_s[1] * meeting_s - flight.from_m[1]
        away_m = math.hypot(x_m, y_m)
        if away_m == 0.0:
            return math.inf
        if abs(meeting_s - before_s) <= _SAME_S:
            break
        late_m = _late(flight, Enu((u * x_m / away_m, u * y_m / away_m, flight.up_m_s)))
    else:
        return math.inf
    fleeing_m_s = max(0.0, (run_m_s[0] * x_m + run_m_s[1] * y_m) / away_m)
    return meeting_s + _braking_cost_s(flight, u - fleeing_m_s)


def _following_s(flight: _GuardFlight, goal_m: Point) -> float:
    """Return the time to a capture of an evader that runs straight to a point, after the reaction time; near its rim.

    Near the rim the vehicle does not regain its full speed and brake again. It takes over the evader's velocity, and
    closes along the line of sight as fast as its approach allows.

    Args:
        flight: The flight.
        goal_m: Vector from the evader to that point.
    """
    players = flight.players
    run_m = math.hypot(*goal_m)
    if run_m == 0.0 or players.gaps.ground_m > _NEAR_RADII * flight.shown.standoff.radius_m:
        return math.inf
    v = flight.shown.evader_speed_m_s
    run_m_s = Enu((v * goal_m[0] / run_m, v * goal_m[1] / run_m, 0.0))
    begins_m = players.evader_m + run_m_s * flight.flies_on_s
    late_m = flight.from_m
    left_s = math.inf
    for _ in range(_ROUNDS):
        before_s = left_s
        to_evader_m = begins_m - late_m
        away_m = to_evader_m.level_length()
        if away_m == 0.0:
            return math.inf
        along_m_s = run_m_s.level_dot(to_evader_m) / away_m
        fastest_m_s = _fastest_m_s(flight, along_m_s)
        left_m = away_m - _rest_m(flight)
        left_s = _closing_s(flight, left_m, fastest_m_s)
        if abs(left_s - before_s) <= _SAME_S:
            return left_s
        pace = min(fastest_m_s, _allowed_m_s(flight, left_m)) / away_m
        late_m = _late(flight, (run_m_s + to_evader_m * pace).level_with(flight.up_m_s))
    return math.inf


def _fastest_m_s(flight: _GuardFlight, along_m_s: float) -> float:
    """Return how fast the vehicle closes on an evader that it keeps up with, which flies away at a speed."""
    v = flight.shown.evader_speed_m_s
    u = flight.shown.pursuer.horizontal_m_s
    return math.sqrt(u * u - v * v + along_m_s * along_m_s) - along_m_s


def _braking_cost_s(flight: _GuardFlight, closing_m_s: float) -> float:
    """Return what braking to the speed at the rim costs, beside flying on at full speed."""
    rim_m_s = _rim_speed_m_s(flight, closing_m_s)
    braking_m_s2 = flight.vehicle.approach.braking_m_s2
    braking_s = (closing_m_s - rim_m_s) ** 2 / (2.0 * braking_m_s2 * closing_m_s)
    lags = math.log(closing_m_s / rim_m_s) - 1.0 + rim_m_s / closing_m_s
    return braking_s + _approach_lag_s(flight) * lags


def is_at_disc(game: Game, players: Players, vehicle: Capability) -> bool:
    """Return whether the vehicle is at the disc's height and near its rim."""
    is_level = abs(players.gaps.height_m) <= vehicle.tolerance_m
    near_m = _NEAR_RADII * float(game.standoff.radius_m)
    return is_level and players.gaps.ground_m <= near_m


def _capture_margin_s(flight: _GuardFlight) -> float:
    """Return how much sooner a vehicle at the disc's height captures the evader than any evader is at the target."""
    game = flight.shown
    players = flight.players
    v = game.evader_speed_m_s
    closing_m_s = game.pursuer.horizontal_m_s - v
    late_m = players.pursuer_m
    left_m = math.inf
    for _ in range(_ROUNDS):
        before_m = left_m
        to_evader_m = players.evader_m - late_m
        away_m = to_evader_m.level_length()
        if away_m == 0.0:
            return -math.inf
        left_m = away_m - _rest_m(flight)
        if abs(left_m - before_m) <= _SAME_M:
            break
        pace = (v + min(closing_m_s, _allowed_m_s(flight, left_m))) / away_m
        velocity_m_s = (to_evader_m * pace).level_with(flight.up_m_s)
        missing_m_s = players.pursuer_m_s - velocity_m_s
        behind_m = players.pursuer_m + (missing_m_s * flight.flies_on_s).level()
        late_m = _late(flight._replace(from_m=behind_m), velocity_m_s)
    else:
        return -math.inf
    return _first_arrival_s(flight) - _closing_s(flight, left_m, closing_m_s)


def _first_arrival_s(flight: _GuardFlight) -> float:
    """Return when an evader is at the nearest point of the target."""
    target = flight.shown.target_extent
    return min(_arrival(flight, offset_m)[0] for offset_m in outline(target))


def _late(flight: _GuardFlight, velocity_m_s: Enu) -> Enu:
    """Return where a pursuer that has this velocity at once does as well as the vehicle."""
    flown_m_s = flight.players.pursuer_m_s
    return late_start(flight.from_m, velocity_m_s, flown_m_s, flight.vehicle.acceleration)


def _away_m(flight: _GuardFlight, offset_m: Point, from_m: Enu) -> float:
    """Return the distance over the ground from a place to a point of the target, when the flight begins."""
    x_m = flight.target_m[0] + offset_m[0] - from_m[0]
    y_m = flight.target_m[1] + offset_m[1] - from_m[1]
    return math.hypot(x_m, y_m)


def _arrival(flight: _GuardFlight, offset_m: Point) -> tuple[float, Point]:
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


def _velocity_to(flight: _GuardFlight, offset_m: Point, short_m: float, lag_s: float) -> Enu:
    """Return the velocity to a point of the target, slow enough to stop short of it, relative to the target."""
    x = flight.target_m[0] + offset_m[0] - flight.from_m[0]
    y = flight.target_m[1] + offset_m[1] - flight.from_m[1]
    away_m = math.hypot(x, y)
    x_m_s, y_m_s = flight.game.target_velocity_m_s
    if away_m == 0.0:
        return Enu((x_m_s, y_m_s, flight.up_m_s))
    u = flight.game.pursuer.horizontal_m_s
    along_m_s = (x * x_m_s + y * y_m_s) / away_m
    across_square = x_m_s * x_m_s + y_m_s * y_m_s - along_m_s * along_m_s
    fastest_m_s = math.sqrt(u * u - across_square) - along_m_s
    braking_m_s2 = flight.vehicle.envelope.braking_m_s2
    pace = min(fastest_m_s, approach_speed(away_m - short_m, braking_m_s2, lag_s)) / away_m
    return Enu((x_m_s + pace * x, y_m_s + pace * y, flight.up_m_s))


def _levelling_s(flight: _GuardFlight) -> float:
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


def _guarded_point(flight: _GuardFlight, solution: StateSolution) -> Point:
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
def outline(extent: Extent) -> tuple[Point, ...]:
    """Return points of the target's edge, from its position, at most `_SPACING_M` apart; of a point, itself."""
    corners = extent.corners_m
    radius_m = extent.radius_m
    points: list[Point] = []
    if len(corners) > 1:
        for begin, end in zip(corners, (*corners[1:], corners[0]), strict=True):
            points += _outline_of_edge(begin, end, radius_m)
    if radius_m == 0.0:
        return tuple(dict.fromkeys((*points, *corners)))
    steps = max(_FEWEST, math.ceil(math.tau * radius_m / _SPACING_M))
    for step in range(steps):
        x = math.cos(math.tau * step / steps)
        y = math.sin(math.tau * step / steps)
        corner = max(corners, key=lambda corner: corner[0] * x + corner[1] * y)
        points.append((corner[0] + radius_m * x, corner[1] + radius_m * y))
    return tuple(points)


def _outline_of_edge(begin: Point, end: Point, radius_m: float) -> list[Point]:
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
