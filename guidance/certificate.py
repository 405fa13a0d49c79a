"""The certificate of a cycle: what the game says, and what this vehicle can promise of it.

The game's value and winner are theorems about players that change their velocity at once. The promises for this vehicle
(`time_needed_s`, `assured_distance_m`, `vehicle_winner`) take its velocity, its acceleration and the speed that it has
shown into account; see `guidance.control.capability`.

In TAD the vehicle's verdict is "pursuer" if the game is won even from as far back as accelerating costs, with enough
time left to react and, over the ground, to brake to the evader's velocity. A vehicle that is not at the disc's height
promises nothing near the rim, or if it flies too fast to turn back for an evader that runs to its target from now on.
The verdict is "evader" if even the game's pursuer loses, and "undecided" in between.

**Waiting.** If the height decides a TAD game, the pursuer has time to spare over the ground. A vehicle that flew at
full speed all the same would be near the evader before it can capture. An evader that turns then passes below it,
because a vehicle does not turn at once. So a vehicle that can be at the meeting point in time flies there and brakes
for it. It stays between the evader and the target, and descends as fast as its limits allow.
"""

import math
from typing import Final, NamedTuple

from guidance.control import Acceleration, Envelope, Gaps, late_start
from guidance.control.braking_law import approach_speed
from guidance.frames import Vector, difference
from guidance.game import Ball, Game, StateSolution, Winner, solve_state
from guidance.game.arrays import FLOATS
from guidance.game.pe import escape, take_apart

_NOWHERE: Final[Vector] = (math.nan, math.nan, math.nan)
_TAKEN_FOR_GRANTED: Final = 0.8
"""Share of the speed that the verdict uses before the vehicle has flown its full speed."""

_FASTER: Final = 1.05
"""Least speed that the verdict uses, over the evader's; a slower pursuer has no game."""

_SURELY: Final = 0.999
"""Share of the way within reach; at 1, the ground decides."""


class Players(NamedTuple):
    """Positions in the game frame, m, and velocities, m/s. `target_m` is T of the TAD game, None in PE."""

    pursuer_m: Vector
    pursuer_m_s: Vector
    evader_m: Vector
    evader_m_s: Vector
    target_m: Vector | None


class Certificate(NamedTuple):
    """Result of the game and promises of this vehicle in one cycle; NaN if there is none.

    `winner` to `meeting_time_s` belong to the ideal game, in which the pursuer has its full speed immediately.

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
        time_needed_s: Promise of this vehicle: time to the meeting.
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
    """Guaranteed acceleration, limits with braking and reaction, and the largest speed flown over the ground."""

    acceleration: Acceleration
    envelope: Envelope
    shown_m_s: float


def certify(
    game: Game,
    players: Players,
    vehicle: Vehicle,
    gaps: Gaps,
    before_m_s: Vector | None,
    *,
    evader_age_s: float,
    tolerance_m: float,
) -> tuple[StateSolution, Vector | None, Certificate]:
    """Solve the game from here, and find its value from where a pursuer starts that does as well as this vehicle.

    In PE that value is a capture time. In TAD it is another game, with the speed that the vehicle has shown.

    Args:
        game: What is played, at the speed that the vehicle reaches.
        players: From where.
        vehicle: What it can do.
        gaps: To the disc.
        before_m_s: The pursuer's optimal velocity of the last cycle, None at the first.
        evader_age_s: Age of the evader's last report.
        tolerance_m: Distance from the disc that counts as captured.

    Returns:
        The solution from here, the velocity of a vehicle that waits for its height, None if it does not wait, and the
        certificate without a command.
    """
    P, E, T, seen = players.pursuer_m, players.evader_m, players.target_m, players.evader_m_s
    here = solve_state(game, P, E, T, evader_velocity_m_s=seen)
    optimal_m_s = here.pursuer_velocity_m_s if before_m_s is None else before_m_s
    late = late_start(P, optimal_m_s, players.pursuer_m_s, vehicle.acceleration)
    farthest_m = max(gaps.ground_m, abs(gaps.height_m))
    certificate = without_game(players, gaps, evader_age_s)._replace(
        winner=here.winner,
        value=here.value,
        margin_s=here.margin_s,
        meeting_point_game_m=here.meeting_point_m,
        meeting_time_s=here.meeting_time_s,
        speed_ratio=game.pursuer.horizontal_m_s / game.evader_speed_m_s,
        captured=farthest_m <= tolerance_m,
        strayed=farthest_m > 3.0 * tolerance_m,
        reason=here.reason,
        vehicle_winner=int(Winner.PURSUER),
        reachable_speed_m_s=game.pursuer.horizontal_m_s,
        no_game=False,
    )
    if T is None:
        time_s, _, _ = escape(FLOATS, game, take_apart(FLOATS, game, late, E, None))
        return here, None, certificate._replace(time_needed_s=time_s, allowance=time_s - here.value)
    shown = _demonstrated(game, vehicle.shown_m_s)
    there = solve_state(shown, late, E, T, evader_velocity_m_s=seen)
    assured_m = -there.value if there.winner == Winner.EVADER else there.value
    stopping_s = _stopping_s(players, optimal_m_s, gaps, vehicle.envelope)
    margin_s = there.margin_s - stopping_s
    low, reaction_s, u = abs(gaps.height_m) <= tolerance_m, vehicle.envelope.reaction_s, game.pursuer.horizontal_m_s
    waiting_m_s = None if low else _waiting(game, here, players, vehicle, shown.pursuer.horizontal_m_s)
    if waiting_m_s:
        level_m = (late[0], late[1], E[2] + game.standoff.height_m)
        ground_s = solve_state(shown, level_m, E, T, evader_velocity_m_s=seen).margin_s - (stopping_s - reaction_s)
        late_s = (1.0 - vehicle.acceleration.descent_share) * here.meeting_time_s
        height_s = there.margin_s - late_s - _levelling_s(here, vehicle.envelope, tolerance_m)
        turn_s = reaction_s * game.evader_speed_m_s / (u - game.evader_speed_m_s)
        margin_s = min(ground_s, height_s) - max(reaction_s, turn_s)
    if (
        margin_s > 0.0
        and not low
        and (gaps.ground_m <= u * reaction_s or not _turns_back(game, here, players, vehicle))
    ):
        margin_s = 0.0
    won = Winner.PURSUER if margin_s > 0.0 else Winner.UNDECIDED
    verdict = Winner.EVADER if here.winner == Winner.EVADER else won
    certificate = certificate._replace(
        evader_arrived=not certificate.captured and game.target_extent.distance_m(T, E) <= tolerance_m,
        time_needed_s=there.meeting_time_s,
        assured_distance_m=assured_m,
        allowance=here.value - assured_m,
        vehicle_winner=int(Winner.PURSUER if certificate.captured else verdict),
        vehicle_margin_s=margin_s,
    )
    return here, waiting_m_s, certificate


def without_game(players: Players, gaps: Gaps, evader_age_s: float) -> Certificate:
    """Return the certificate of a cycle without a game."""
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
        command_ned_m_s=_NOWHERE,
        active_limits=(),
        captured=False,
        strayed=False,
        evader_arrived=False,
        no_game=True,
    )


def _demonstrated(game: Game, shown_m_s: float) -> Game:
    """Return the game with the speed over the ground that the vehicle has shown, or is trusted with before."""
    trusted_m_s = max(shown_m_s, _TAKEN_FOR_GRANTED * game.pursuer.horizontal_m_s, _FASTER * game.evader_speed_m_s)
    return game.against(game.evader_speed_m_s, game.information_age_s, min(trusted_m_s, game.pursuer.horizontal_m_s))


def _waiting(game: Game, here: StateSolution, players: Players, vehicle: Vehicle, trusted_m_s: float) -> Vector | None:
    """Return the velocity of a vehicle that waits at the meeting point for its height; None if the ground decides."""
    if here.winner != Winner.PURSUER or isinstance(game.pursuer, Ball):
        return None
    P, X, envelope = players.pursuer_m, here.meeting_point_m, vehicle.envelope
    away_m = math.dist(P[:2], X[:2])
    allowed_m_s = approach_speed(away_m, envelope.braking_m_s2, envelope.reaction_s)
    pace = min(game.pursuer.horizontal_m_s, allowed_m_s) / away_m if away_m > 0.0 else 0.0
    waiting_m_s = (pace * (X[0] - P[0]), pace * (X[1] - P[1]), here.pursuer_velocity_m_s[2])
    late = late_start(P, waiting_m_s, players.pursuer_m_s, vehicle.acceleration)
    missing_m = max(away_m, math.dist(late[:2], X[:2])) - game.standoff.radius_m
    return waiting_m_s if missing_m < _SURELY * trusted_m_s * here.meeting_time_s else None


def _levelling_s(here: StateSolution, envelope: Envelope, tolerance_m: float) -> float:
    """Return the time lost by braking to the height of the disc, until the vehicle is within tolerance, s."""
    speed_m_s, braking_m_s2 = abs(here.pursuer_velocity_m_s[2]), envelope.vertical_braking_m_s2
    excess_m_s = speed_m_s - math.sqrt(2.0 * braking_m_s2 * tolerance_m)
    return excess_m_s**2 / (2.0 * braking_m_s2 * speed_m_s) if excess_m_s > 0.0 else 0.0


def _turns_back(game: Game, here: StateSolution, players: Players, vehicle: Vehicle) -> bool:
    """Return whether this vehicle, at its velocity, can still meet an evader that runs to its target from now on."""
    P, E, T, flown = players.pursuer_m, players.evader_m, players.target_m or _NOWHERE, players.pursuer_m_s
    away_m, arrival_s = math.dist(E[:2], T[:2]), game.target_extent.distance_m(T, E) / game.evader_speed_m_s
    for time_s in (here.meeting_time_s, 0.5 * (here.meeting_time_s + arrival_s), arrival_s):
        share = game.evader_speed_m_s * time_s / away_m
        x, y = (P[k] + flown[k] * time_s - E[k] - share * (T[k] - E[k]) for k in (0, 1))
        turning_s = max(0.0, time_s - vehicle.envelope.reaction_s)
        if math.hypot(x, y) <= game.standoff.radius_m + 0.5 * vehicle.acceleration.ground_m_s2 * turning_s**2:
            return True
    return False


def _stopping_s(players: Players, optimal_m_s: Vector, gaps: Gaps, envelope: Envelope) -> float:
    """Return the time lost by reacting and by braking to the evader's velocity, s."""
    gap_m, deceleration_m_s2 = gaps.ground_m, envelope.braking_m_s2
    if gap_m <= 0.0:
        return envelope.reaction_s
    relative = difference(optimal_m_s, players.evader_m_s)
    x, y, _ = difference(players.evader_m, players.pursuer_m)
    closing_m_s = max(0.0, relative[0] * x + relative[1] * y) / math.hypot(x, y)
    if gap_m >= closing_m_s**2 / (2.0 * deceleration_m_s2):
        return envelope.reaction_s + closing_m_s / (2.0 * deceleration_m_s2)
    return envelope.reaction_s + math.sqrt(2.0 * gap_m / deceleration_m_s2) - gap_m / closing_m_s
