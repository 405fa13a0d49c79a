"""The certificate of a cycle: the game's result, and the promises of this vehicle.

The game's value and winner are theorems about players that change their velocity at once. The promises for this vehicle
(`time_needed_s`, `assured_distance_m`, `vehicle_winner`) take its velocity, its acceleration and the speed that it has
shown into account.

**Late start.** A vehicle that flies w, where the game asks for u, and accelerates with a, has the velocity u after
‖u − w‖/a seconds. By then it is (u − w)·‖u − w‖/(2a) metres behind. So it does as well as a pursuer of the game that
starts that much further back (`late_start`). Along a straight chase after an evader with speed v, capture comes
u²/(2a(u − v)) seconds later from hover. Ground and vertical use the same law, each with its own a.

In TAD the vehicle's verdict is "pursuer" if the vehicle can still guard the target: it flies there from its present
velocity, stops above it at the disc's height, and is there before the evader, with time to spare for wrong estimates.
The verdict is "evader" if even the game's pursuer loses, and "undecided" in between.

**Circling.** In PE the promise also counts the delay by an evader that keeps turning faster than the vehicle can
(`guidance.cycle.circling`). A vehicle that is late flies to the path which that turn predicts.

**Guarding.** The ideal pursuer turns at once, so it may fly away from the target until its margin is zero. A vehicle
that does so cannot come back in time. So the less margin a vehicle has below `SPARE_S`, the more of its velocity is
that of the flight to the target. The play looks `AHEAD_S` further than the verdict, because a turn takes effect late.
At a target wider than the disc's radius the vehicle begins earlier, at `WIDE_SPARE_S`, because a reversal takes longer
there. If its margin is negative, it flies to the target in part at most: the game's solution wins more often then. Near
the rim at the disc's height it plays the game, which captures.

**Waiting.** If the height decides a TAD game, the pursuer has time to spare over the ground. A vehicle that flew at
full speed all the same would be near the evader before it can capture. An evader that turns then passes below it,
because a vehicle does not turn at once. So a vehicle that can be at the meeting point in time flies there and brakes
for it. It stays between the evader and the target, and descends as fast as its limits allow.
"""

import math
from enum import StrEnum
from typing import Final, NamedTuple

from guidance.control import Gaps
from guidance.control.braking_law import approach_speed
from guidance.cycle.circling import Circling, meeting_velocity
from guidance.cycle.guarding import Guard, guard, is_held
from guidance.cycle.players import NOWHERE, Capability, Players, late_start
from guidance.frames import Enu, Ned
from guidance.game import Game, StateSolution, Winner, solve_state
from guidance.game.arrays import FLOATS
from guidance.game.pe import escape
from guidance.messages import UNKNOWN_VELOCITY

_NOT_OBSERVED: Final = Circling()
_TAKEN_FOR_GRANTED: Final = 0.8
"""Share of the speed that the verdict uses before the vehicle has flown its full speed."""

_FASTER: Final = 1.05
"""Least speed that the verdict uses, over the evader's; a slower pursuer has no game."""

SPARE_S: Final = 2.0
"""With this margin or more, the vehicle plays the game; at zero it flies to the target."""

AHEAD_S: Final = 0.5
"""The play looks further ahead than the verdict by this time."""

WIDE_SPARE_S: Final = 3.5
"""With this margin or more, the vehicle plays the game at a target wider than the disc's radius."""

WIDE_KEPT_S: Final = 0.5
"""Up to this margin it flies to the target only. If it is as much behind, it plays the game only."""

_SURELY: Final = 0.999
"""Share of the way within reach; at 1, the ground decides."""

_TURNS: Final = 4
"""Rounds to the direction of a pursuit that turns with the late start."""


class Certificate(NamedTuple):
    """Result of the game and promises of this vehicle in one cycle; NaN if there is none.

    `winner` to `meeting_time_s` belong to the ideal game, whose pursuer has its full speed immediately.

    Attributes:
        winner: `guidance.game.Winner`.
        value: PE: time to capture, s. TAD: the evader's final distance from its target, m; if the evader wins, the
            missing distance to a capture, m.
        margin_s: TAD: how much sooner the pursuer is at the target than the evader; 0 on the barrier.
        meeting_point_game_m: Where the game ends.
        meeting_time_s: Time until then.
        speed_ratio: Pursuer's speed over the evader's bound.
        evader_age_s: Age of the evader's last report.
        pursuer_game_m: Position of the vehicle.
        evader_game_m: Estimated position of the evader.
        gap_m: Horizontal distance to the rim of the disc, negative inside.
        height_gap_m: Height above the disc.
        desired_ned_m_s: Velocity desired before the servo and the limits.
        command_ned_m_s: Velocity commanded.
        active_limits: Names of the limits that changed the command.
        captured: Whether the vehicle is within tolerance of the disc, or inside it at its height.
        strayed: Whether it is more than three tolerances away.
        evader_arrived: Whether the evader is at its target, uncaptured.
        no_game: Whether the evader is too fast for this vehicle.
        policy_fault: Why the user's policy has no answer; None if it has one, or if another one is flown.
        time_needed_s: Promise of this vehicle: time to the meeting, if the evader runs away from now on (PE), or to the
            game's meeting point (TAD). An evader that turns, or passes below the vehicle, can make it later.
        assured_distance_m: Promise of this vehicle in TAD: the evader's final distance from its target, negative if
            the evader gets there.
        reason: `guidance.game.Reason`. With TOO_OLD there is no guarantee. In TAD all values are computed for a disc
            smaller by the distance that the evader may have run since its last report.
        battery_needed: Share of the charge needed to come home from here.
        allowance: How much worse a promise may become before it counts as broken, in the unit of `value`: the cost of
            accelerating once more.
        vehicle_winner: TAD: the winner for this vehicle, see above; in PE the pursuer.
        vehicle_margin_s: TAD: how much sooner this vehicle can guard the target than the evader can be there.
        reachable_speed_m_s: The pursuer's speed over the ground in the game: the configured one, or less if the vehicle
            was seen to reach less.
    """

    winner: int
    value: float
    margin_s: float
    meeting_point_game_m: Enu
    meeting_time_s: float
    speed_ratio: float
    evader_age_s: float
    pursuer_game_m: Enu
    evader_game_m: Enu
    gap_m: float
    height_gap_m: float
    desired_ned_m_s: Ned
    command_ned_m_s: Ned
    active_limits: tuple[str, ...]
    captured: bool
    strayed: bool
    evader_arrived: bool
    no_game: bool
    time_needed_s: float = math.nan
    assured_distance_m: float = math.nan
    reason: int | None = None
    battery_needed: float = math.nan
    allowance: float = math.nan
    vehicle_winner: int | None = None
    vehicle_margin_s: float = math.nan
    reachable_speed_m_s: float = math.nan
    policy_fault: str | None = None


class ChosenCourse(StrEnum):
    """The vehicle's course, and the reason for it."""

    SOLUTION = "solution"
    """The game's solution."""
    WAITING = "waiting"
    """To the meeting point, where it waits for its height."""
    GUARDING = "guarding"
    """In part or wholly to the target, because little margin is left."""
    CUTTING = "cutting"
    """In part or wholly to the path that the evader's turn predicts, because the pursuit is late."""


class Certified(NamedTuple):
    """The game of one cycle, seen from this vehicle.

    Attributes:
        solution: The game's solution from here.
        course: Where it flies.
        velocity_m_s: The velocity of that course, in the game frame.
        certificate: The certificate without a command.
        circling: How the evader turns, and how late the pursuit is (PE); for the next cycle.
    """

    solution: StateSolution
    course: ChosenCourse
    velocity_m_s: Enu
    certificate: Certificate
    circling: Circling = _NOT_OBSERVED


def certify(
    game: Game,
    players: Players,
    vehicle: Capability,
    before_m_s: Enu | None,
    circling: Circling = _NOT_OBSERVED,
    *,
    dt_s: float = 0.0,
) -> Certified:
    """Solve the game from here, and find its value from where a pursuer starts that does as well as this vehicle.

    In PE that value is a capture time. In TAD it is another game, with the speed that the vehicle has shown.

    Args:
        game: The present game, at the speed that the vehicle reaches.
        players: From where.
        vehicle: Its limits and accelerations.
        before_m_s: The pursuer's optimal velocity of the last cycle, None at the first.
        circling: From the last cycle.
        dt_s: Time since then.
    """
    P = players.pursuer_m
    E = players.evader_m
    T = players.target_m
    solution = solve_state(game, P, E, T, evader_velocity_m_s=players.evader_m_s)
    optimal_m_s = Enu(solution.pursuer_velocity_m_s)
    desired_m_s = optimal_m_s if before_m_s is None else before_m_s
    farthest_m = max(players.gaps.ground_m, abs(players.gaps.height_m))
    u = game.pursuer.horizontal_m_s
    certificate = Certificate(
        solution.winner,
        solution.value,
        solution.margin_s,
        Enu(solution.meeting_point_m),
        solution.meeting_time_s,
        speed_ratio=u / game.evader_speed_m_s,
        evader_age_s=players.evader_age_s,
        pursuer_game_m=P,
        evader_game_m=E,
        gap_m=players.gaps.ground_m,
        height_gap_m=players.gaps.height_m,
        desired_ned_m_s=UNKNOWN_VELOCITY,
        command_ned_m_s=UNKNOWN_VELOCITY,
        active_limits=(),
        captured=farthest_m <= vehicle.tolerance_m,
        strayed=farthest_m > 3.0 * vehicle.tolerance_m,
        evader_arrived=False,
        no_game=False,
        reason=solution.reason,
        vehicle_winner=int(Winner.PURSUER),
        reachable_speed_m_s=u,
    )
    if T is not None:
        late_m = late_start(P, desired_m_s, players.pursuer_m_s, vehicle.acceleration)
        return _defended(game, players, vehicle, late_m, solution, certificate)
    time_s, slow_s = _pursuits_s(game, players, vehicle, desired_m_s)
    allowance_s = slow_s - solution.value
    circling = circling.after(players.evader_m_s, time_s + allowance_s, dt_s)
    course = ChosenCourse.SOLUTION
    velocity_m_s = optimal_m_s
    if circling.sharpness(game, vehicle) > 0.0:
        # The evader turns faster than the vehicle can follow: cut its circle, and allow for the time that this costs.
        time_s += circling.detour_s(game, vehicle)
        share = circling.share(game, vehicle)
        if share > 0.0:
            course = ChosenCourse.CUTTING
            meeting_m_s = meeting_velocity(game, players, vehicle, circling, optimal_m_s)
            velocity_m_s = optimal_m_s + share * (meeting_m_s - optimal_m_s)
    certificate = certificate._replace(time_needed_s=time_s, allowance=allowance_s)
    return Certified(solution, course, velocity_m_s, certificate, circling)


def _pursuits_s(
    game: Game, players: Players, vehicle: Capability, desired_m_s: Enu
) -> tuple[float, float]:
    """Return when this vehicle captures an evader that runs straight away: turning at once, and after its reaction.

    Above the disc, the pursuer of the game only copies the evader's velocity, but once the evader has run out from
    below, the vehicle needs its full speed. A descent that is slower than commanded counts as a longer one.

    Args:
        game: The present game.
        players: From where.
        vehicle: Its limits and accelerations.
        desired_m_s: Velocity of the game's solution.
    """
    acceleration = vehicle.acceleration
    u = game.pursuer.horizontal_m_s
    if not game.pursuer.separate:
        u = desired_m_s.level_length()
    slower_m = max(0.0, players.gaps.height_m) * (1.0 / acceleration.descent_share - 1.0)
    missing_m_s = desired_m_s.up - players.pursuer_m_s.up
    climbing_s = abs(missing_m_s) / (2.0 * acceleration.vertical_m_s2)
    late_up_m = players.pursuer_m.up + slower_m - missing_m_s * climbing_s
    height_m = late_up_m - players.evader_m.up - game.standoff.height_m
    times_s = []
    for reaction_s in (0.0, vehicle.envelope.reaction_s):
        to_evader_m = _to_evader_m(players, u, acceleration.ground_m_s2, reaction_s)
        time_s, _, _ = escape(FLOATS, game, to_evader_m, height_m)
        times_s.append(time_s)
    return times_s[0], times_s[1]


def _to_evader_m(
    players: Players, u: float, acceleration_m_s2: float, reaction_s: float
) -> tuple[float, float]:
    """Return the way over the ground, x and y, to the evader from the late start of a vehicle that turns towards it.

    The vehicle drifts on while it accelerates, so near the evader the direction of the pursuit turns with the late
    start. Number by number, because the rounds take much of the certificate's time.

    Args:
        players: From where.
        u: Speed of the pursuit over the ground.
        acceleration_m_s2: Of the vehicle over the ground.
        reaction_s: The vehicle keeps its present velocity for this time before it accelerates.
    """
    x, y, _ = players.pursuer_m
    evader_x, evader_y, _ = players.evader_m
    flown_x_m_s, flown_y_m_s, _ = players.pursuer_m_s
    way_x_m = evader_x - x
    way_y_m = evader_y - y
    for _ in range(_TURNS):
        away_m = math.hypot(way_x_m, way_y_m)
        pace = u / away_m if away_m > 0.0 else 0.0
        missing_x_m_s = pace * way_x_m - flown_x_m_s
        missing_y_m_s = pace * way_y_m - flown_y_m_s
        turning_s = math.hypot(missing_x_m_s, missing_y_m_s) / (2.0 * acceleration_m_s2)
        late_x = x - reaction_s * missing_x_m_s - missing_x_m_s * turning_s
        late_y = y - reaction_s * missing_y_m_s - missing_y_m_s * turning_s
        way_x_m = evader_x - late_x
        way_y_m = evader_y - late_y
    return way_x_m, way_y_m


def without_game(players: Players) -> Certificate:
    """Return the certificate of a cycle without a game: where both are; everything else is missing or false."""
    return Certificate(
        int(Winner.UNDECIDED),
        value=math.nan,
        margin_s=math.nan,
        meeting_point_game_m=NOWHERE,
        meeting_time_s=math.nan,
        speed_ratio=math.nan,
        evader_age_s=players.evader_age_s,
        pursuer_game_m=players.pursuer_m,
        evader_game_m=players.evader_m,
        gap_m=players.gaps.ground_m,
        height_gap_m=players.gaps.height_m,
        desired_ned_m_s=UNKNOWN_VELOCITY,
        command_ned_m_s=UNKNOWN_VELOCITY,
        active_limits=(),
        captured=False,
        strayed=False,
        evader_arrived=False,
        no_game=True,
    )


def _defended(
    game: Game,
    players: Players,
    vehicle: Capability,
    late_m: Enu,
    solution: StateSolution,
    certificate: Certificate,
) -> Certified:
    """Add this vehicle's promises in TAD, and choose its course."""
    E = players.evader_m
    T = NOWHERE if players.target_m is None else players.target_m
    u = game.pursuer.horizontal_m_s
    # The speed over the ground that the vehicle has shown, or is trusted with before.
    trusted_m_s = min(
        u, max(vehicle.shown_m_s, _TAKEN_FOR_GRANTED * u, _FASTER * game.evader_speed_m_s)
    )
    shown = game.against(game.evader_speed_m_s, game.information_age_s, trusted_m_s)
    late = solve_state(shown, late_m, E, T, evader_velocity_m_s=players.evader_m_s)
    assured_m = -late.value if late.winner == Winner.EVADER else late.value
    reaction_s = vehicle.envelope.reaction_s
    near = guard(game, shown, solution, players, vehicle, reaction_s, descends_at_once=True)
    guarding = near
    if is_held(game):
        guarding = guard(game, shown, solution, players, vehicle, reaction_s + AHEAD_S)
    course, velocity_m_s = _course(game, players, vehicle, solution, guarding, trusted_m_s)
    # The winner for this vehicle, which has a margin at the target.
    winner = Winner.PURSUER if near.margin_s > 0.0 else Winner.UNDECIDED
    if solution.winner == Winner.EVADER:
        winner = Winner.EVADER
    if certificate.captured:
        winner = Winner.PURSUER
    arrived = game.target_extent.distance_m(T, E) <= vehicle.tolerance_m
    certificate = certificate._replace(
        evader_arrived=arrived and not certificate.captured,
        time_needed_s=late.meeting_time_s,
        assured_distance_m=assured_m,
        allowance=solution.value - assured_m,
        vehicle_winner=int(winner),
        vehicle_margin_s=near.margin_s,
    )
    return Certified(solution, course, velocity_m_s, certificate)


def _course(
    game: Game,
    players: Players,
    vehicle: Capability,
    solution: StateSolution,
    guarding: Guard,
    trusted_m_s: float,
) -> tuple[ChosenCourse, Enu]:
    """Return the vehicle's course in TAD, and its velocity."""
    course = ChosenCourse.SOLUTION
    optimal_m_s = Enu(solution.pursuer_velocity_m_s)
    velocity_m_s = optimal_m_s
    if abs(players.gaps.height_m) > vehicle.tolerance_m:
        waiting_m_s = _waiting(game, solution, players, vehicle, trusted_m_s)
        if waiting_m_s is not None:
            course = ChosenCourse.WAITING
            velocity_m_s = waiting_m_s
    if solution.winner != Winner.PURSUER:
        return course, velocity_m_s
    share = _guarding_share(game, players.gaps, vehicle.tolerance_m, guarding.margin_s)
    if share > 0.0:
        course = ChosenCourse.GUARDING
        guarding_m_s = velocity_m_s + share * (guarding.velocity_m_s - velocity_m_s)
        velocity_m_s = guarding_m_s.level_with(optimal_m_s.up)
    return course, velocity_m_s


def _guarding_share(game: Game, gaps: Gaps, tolerance_m: float, margin_s: float) -> float:
    """Return the share of the vehicle's velocity that is that of the flight to the target."""
    if is_held(game):
        return _up_to_one(1.0 - (margin_s + AHEAD_S) / SPARE_S)
    little = _up_to_one((WIDE_SPARE_S - margin_s) / (WIDE_SPARE_S - WIDE_KEPT_S))
    kept = _up_to_one(1.0 + margin_s / WIDE_KEPT_S)
    radius_m = max(float(game.standoff.radius_m), tolerance_m)
    near = _up_to_one(2.0 - gaps.ground_m / radius_m)
    level = _up_to_one(2.0 - abs(gaps.height_m) / tolerance_m)
    return min(little, kept) * (1.0 - near * level)


def _up_to_one(share: float) -> float:
    return min(1.0, max(0.0, share))


def _waiting(
    game: Game, here: StateSolution, players: Players, vehicle: Capability, trusted_m_s: float
) -> Enu | None:
    """Return the velocity of a vehicle that waits at the meeting point for its height; None if the ground decides."""
    if here.winner != Winner.PURSUER or not game.pursuer.separate:
        return None
    P = players.pursuer_m
    X = Enu(here.meeting_point_m)
    envelope = vehicle.envelope
    way_m = X - P
    away_m = way_m.level_length()
    allowed_m_s = approach_speed(away_m, envelope.braking_m_s2, envelope.reaction_s)
    pace = min(game.pursuer.horizontal_m_s, allowed_m_s) / away_m if away_m > 0.0 else 0.0
    waiting_m_s = (way_m * pace).level_with(here.pursuer_velocity_m_s[2])
    late = late_start(P, waiting_m_s, players.pursuer_m_s, vehicle.acceleration)
    missing_m = max(away_m, math.dist(late[:2], X[:2])) - game.standoff.radius_m
    return waiting_m_s if missing_m < _SURELY * trusted_m_s * here.meeting_time_s else None
