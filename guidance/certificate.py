"""The certificate of a cycle: what the game says, and what this vehicle can promise of it.

The game's value and winner are theorems about players that change their velocity at once. The promises for this vehicle
(`time_needed_s`, `assured_distance_m`, `vehicle_winner`) take its velocity, its acceleration and the speeds that it has
shown into account; see `guidance.control.capability`.

In TAD the vehicle's verdict is "pursuer" only if the vehicle can be over the target, able to stay, before the evader
can arrive there: from the velocity that it flies, and also if it first gains the velocity that the game asks for.
Whatever the evader does meanwhile, it is then caught at the target at the latest. The verdict is "evader" if even the
game's pursuer loses, and "undecided" in between.
"""

import math
from typing import Final, NamedTuple

from guidance.control import Acceleration, Envelope, Gaps, Limited, Speeds, late_start, time_to_stop_at, trusted
from guidance.frames import Vector
from guidance.game import Ball, Game, StateSolution, Winner, solve_state
from guidance.messages import Setpoint

_NOWHERE: Final[Vector] = (math.nan, math.nan, math.nan)
_SLOWEST_M_S: Final = 0.01

VERTICAL_TOLERANCE_M: Final = 0.5
"""Height from the disc at which a vehicle guards the target."""

VERTICAL_SETTLE_S: Final = 0.6
"""The last metre of height is flown more slowly than braking needs (`Approach.vertical_settle_s`)."""


class Players(NamedTuple):
    """Positions in the game frame, m, and velocities, m/s. `target_m` is T of the TAD game, None in PE."""

    pursuer_m: Vector
    pursuer_m_s: Vector
    evader_m: Vector
    evader_m_s: Vector
    target_m: Vector | None


class Certificate(NamedTuple):
    """What the game and this vehicle come to at one cycle. NaN means "there is none".

    Of the ideal game, whose pursuer is at full speed at once:

    Attributes:
        winner: `guidance.game.Winner`.
        value: PE: time to capture, s. TAD: the evader's final distance from its target, m; if the evader wins, the
            distance by which the pursuer is late, m.
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
        time_needed_s: Promise of this vehicle: time to the meeting.
        assured_distance_m: Promise of this vehicle in TAD: the evader's final distance from its target, negative if
            the evader gets there.
        reason: `guidance.game.Reason`. With TOO_OLD nothing is guaranteed. In TAD everything is computed for a disc
            smaller by what the evader may have run since its last report.
        battery_needed: Share of the charge needed to come home from here.
        allowance: How much worse a promise may become before that counts as broken, in the unit of `value`: what
            accelerating costs, once more.
        vehicle_winner: TAD: the winner for this vehicle, see above; in PE the pursuer.
        vehicle_margin_s: TAD: how much sooner this vehicle is at the target, able to stay, than the evader.
        reachable_speed_m_s: Speed over the ground that the game is played with: the configured one, or less if the
            vehicle was seen to reach less.
    """

    winner: int
    value: float
    margin_s: float
    meeting_point_game_m: Vector
    meeting_time_s: float
    speed_ratio: float
    evader_age_s: float
    pursuer_game_m: Vector
    evader_game_m: Vector
    gap_m: float
    height_gap_m: float
    desired_ned_m_s: Vector
    command_ned_m_s: Vector
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


class Vehicle(NamedTuple):
    """What a promise rests on: guaranteed acceleration, braking and reaction of the limits, and the speeds shown."""

    acceleration: Acceleration
    envelope: Envelope
    shown: Speeds


class Answer(NamedTuple):
    """The game's solution, and this vehicle's promises: see `Certificate`."""

    solution: StateSolution
    time_needed_s: float
    assured_distance_m: float
    allowance: float
    vehicle_winner: int
    vehicle_margin_s: float


def answer(game: Game, players: Players, vehicle: Vehicle, before_m_s: Vector | None) -> Answer:
    """Solve the game from here, and from where a pursuer would start that does as well as this vehicle.

    Args:
        game: What is played, at the speed that the vehicle reaches.
        players: From where.
        vehicle: What it can do.
        before_m_s: The pursuer's optimal velocity of the last cycle, None at the first.
    """
    P, E, T, seen = players.pursuer_m, players.evader_m, players.target_m, players.evader_m_s
    here = solve_state(game, P, E, T, evader_velocity_m_s=seen)
    desired_m_s = here.pursuer_velocity_m_s if before_m_s is None else before_m_s
    late = late_start(P, desired_m_s, players.pursuer_m_s, vehicle.acceleration)
    there = solve_state(game, late, E, T, evader_velocity_m_s=seen)
    if T is None:
        return Answer(here, there.value, math.nan, there.value - here.value, int(Winner.PURSUER), math.nan)
    assured_m = -there.value if there.winner == Winner.EVADER else there.value
    arrival_s, goal = _arrival(game, E, T)
    aims = (players.pursuer_m_s, desired_m_s)
    margin_s = arrival_s - max(guard_time_s(game, P, moving, goal, vehicle) for moving in aims)
    verdict = Winner.PURSUER if margin_s > 0.0 else Winner.UNDECIDED
    if here.winner == Winner.EVADER:
        verdict = Winner.EVADER
    return Answer(here, there.meeting_time_s, assured_m, here.value - assured_m, int(verdict), margin_s)


def guard_time_s(game: Game, pursuer_m: Vector, moving_m_s: Vector, goal_m: Vector, vehicle: Vehicle) -> float:
    """Return the time until this vehicle can be at a place, able to capture whoever is there, and stay, s.

    Args:
        game: What is played.
        pursuer_m: Position of the vehicle.
        moving_m_s: Its velocity.
        goal_m: The place.
        vehicle: What it can do.
    """
    envelope, gaining_m_s2 = vehicle.envelope, vehicle.acceleration.ground_m_s2
    (x, y, z), (v_x, v_y, v_z), radius_m = pursuer_m, moving_m_s, game.standoff.radius_m
    beside_m, fall_m = math.dist(pursuer_m[:2], goal_m[:2]) - radius_m, z - goal_m[2] - game.standoff.height_m
    before_s, towards = 0.0, 0.0
    if beside_m <= 0.0:  # over the place, but perhaps not to stay: it stops first
        speed = math.hypot(v_x, v_y)
        stopped_m = speed / (2.0 * envelope.braking_m_s2)
        beside_m = math.dist((x + v_x * stopped_m, y + v_y * stopped_m), goal_m[:2]) - radius_m
        before_s = speed / envelope.braking_m_s2 if beside_m > 0.0 else 0.0
    else:
        to_x, to_y, distance_m = goal_m[0] - x, goal_m[1] - y, beside_m + radius_m
        towards = (to_x * v_x + to_y * v_y) / distance_m
        before_s = 0.5 * abs(to_x * v_y - to_y * v_x) / (distance_m * gaining_m_s2)
    top, sinks = trusted(vehicle.shown, _speeds(game, envelope, beside_m, fall_m)), fall_m > 0.0
    ground_s = before_s + time_to_stop_at(
        beside_m,
        towards,
        top_m_s=top.speed_m_s,
        gaining_m_s2=gaining_m_s2,
        braking_m_s2=envelope.braking_m_s2,
    )
    vertical_s = time_to_stop_at(
        abs(fall_m) - VERTICAL_TOLERANCE_M,
        -v_z if sinks else v_z,
        top_m_s=top.descent_m_s if sinks else top.climb_m_s,
        gaining_m_s2=vehicle.acceleration.vertical_m_s2,
        braking_m_s2=envelope.vertical_braking_m_s2,
    )
    if vertical_s > 0.0:
        vertical_s += VERTICAL_SETTLE_S
    return envelope.reaction_s + max(ground_s, vertical_s)


def _arrival(game: Game, evader_m: Vector, target_m: Vector) -> tuple[float, Vector]:
    """Return the earliest arrival of the evader at its target, s, and where the target is then."""
    v, (drift_x, drift_y) = game.evader_speed_m_s, game.target_velocity_m_s
    x, y = target_m[0] - evader_m[0], target_m[1] - evader_m[1]
    hand, along = v * v - drift_x * drift_x - drift_y * drift_y, x * drift_x + y * drift_y
    arrival_s = (along + math.sqrt(along * along + hand * (x * x + y * y))) / hand
    return arrival_s, (target_m[0] + drift_x * arrival_s, target_m[1] + drift_y * arrival_s, target_m[2])


def _speeds(game: Game, envelope: Envelope, beside_m: float, fall_m: float) -> Speeds:
    """Return the game's speeds over the ground, up and down; a Ball's are those of a straight way."""
    pursuer = game.pursuer
    if not isinstance(pursuer, Ball):
        return Speeds(pursuer.horizontal_m_s, pursuer.climb_m_s, pursuer.descent_m_s)
    way_m = math.hypot(max(beside_m, 0.0), fall_m)
    level = max(beside_m, 0.0) / way_m if way_m > 0.0 else 1.0
    vertical = pursuer.speed_m_s * (abs(fall_m) / way_m if way_m > 0.0 else 1.0)
    return Speeds(
        pursuer.speed_m_s * level,
        max(min(vertical, envelope.climb_m_s), _SLOWEST_M_S),
        max(min(vertical, envelope.descent_m_s), _SLOWEST_M_S),
    )


def certify(
    game: Game,
    answered: Answer,
    players: Players,
    gaps: Gaps,
    limited: Limited,
    *,
    desired_ned_m_s: Vector,
    evader_age_s: float,
    tolerance_m: float,
    reason: int,
) -> Certificate:
    """Write the certificate of a cycle with a game.

    Args:
        game: What was played.
        answered: Solution and promises.
        players: In the game frame.
        gaps: To the disc.
        limited: What was commanded, and the limits that changed it.
        desired_ned_m_s: Velocity desired before the servo and the limits.
        evader_age_s: Age of the evader's last report.
        tolerance_m: Distance from the disc that counts as captured.
        reason: `guidance.game.Reason`.
    """
    solution, at = answered.solution, players.target_m
    reached = gaps.ground_m <= tolerance_m and abs(gaps.height_m) <= tolerance_m
    return Certificate(
        winner=solution.winner,
        value=solution.value,
        margin_s=solution.margin_s,
        meeting_point_game_m=solution.meeting_point_m,
        meeting_time_s=solution.meeting_time_s,
        speed_ratio=game.pursuer.horizontal_m_s / game.evader_speed_m_s,
        evader_age_s=evader_age_s,
        pursuer_game_m=players.pursuer_m,
        evader_game_m=players.evader_m,
        gap_m=gaps.ground_m,
        height_gap_m=gaps.height_m,
        desired_ned_m_s=desired_ned_m_s,
        command_ned_m_s=limited.setpoint.velocity_ned_m_s,
        active_limits=tuple(str(one) for one in limited.active),
        captured=reached,
        strayed=gaps.ground_m > 3.0 * tolerance_m or abs(gaps.height_m) > 3.0 * tolerance_m,
        evader_arrived=at is not None and not reached and math.dist(at[:2], players.evader_m[:2]) <= tolerance_m,
        no_game=False,
        time_needed_s=answered.time_needed_s,
        assured_distance_m=answered.assured_distance_m,
        reason=reason,
        allowance=answered.allowance,
        vehicle_winner=int(Winner.PURSUER) if reached else answered.vehicle_winner,
        vehicle_margin_s=answered.vehicle_margin_s,
        reachable_speed_m_s=game.pursuer.horizontal_m_s,
    )


def certify_no_game(players: Players, gaps: Gaps, setpoint: Setpoint, *, evader_age_s: float) -> Certificate:
    """Write the certificate of a cycle in which the evader is too fast for a game: the vehicle hovers.

    Args:
        players: In the game frame.
        gaps: To the disc, m.
        setpoint: The hover that is commanded.
        evader_age_s: Age of the evader's last report.
    """
    return Certificate(
        winner=0,
        value=math.nan,
        margin_s=math.nan,
        meeting_point_game_m=_NOWHERE,
        meeting_time_s=math.nan,
        speed_ratio=math.nan,
        evader_age_s=evader_age_s,
        pursuer_game_m=players.pursuer_m,
        evader_game_m=players.evader_m,
        gap_m=gaps.ground_m,
        height_gap_m=gaps.height_m,
        desired_ned_m_s=_NOWHERE,
        command_ned_m_s=setpoint.velocity_ned_m_s,
        active_limits=(),
        captured=False,
        strayed=False,
        evader_arrived=False,
        no_game=True,
    )
