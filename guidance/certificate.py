"""What the game says at one cycle, and what this vehicle can do of it: solved, and laid down as the certificate.

What accelerating costs is what a vehicle can promise less than the game does. One that flies w where the game asks for
u, and changes its velocity by a m/s², is there after ‖u − w‖/a seconds, and by then

    (u − w) · ‖u − w‖ / (2a)

behind. So it does as well as a pursuer of the game that begins that much further back, and what the game says from
there (when it captures, how far from its target the evader ends) is what this vehicle can do: along a straight chase at
u after an evader at v the capture comes that distance over u − v later, V + u²/(2a(u − v)) from hover. A vehicle that
flies faster than u begins in front. Over the ground and vertically it is the same law, each with its own a.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from guidance.control.follow import Gaps
from guidance.control.setpoint_limiter import Limited
from guidance.frames import Vector
from guidance.game import Game, StateSolution, Winner, solve_state
from guidance.messages import Setpoint

_NOWHERE: Vector = (math.nan, math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class Acceleration:
    """What a vehicle surely achieves, m/s²: over the ground, and vertically."""

    ground_m_s2: float
    vertical_m_s2: float


def late_start(position_m: Vector, desired_m_s: Vector, flown_m_s: Vector, acceleration: Acceleration) -> Vector:
    """Return where the game's pursuer would begin that comes to fly beside this vehicle, m.

    Args:
        position_m: Where the vehicle is; axes of any frame, the third one vertical.
        desired_m_s: The velocity that the game asks for, in the same axes.
        flown_m_s: What the vehicle flies.
        acceleration: Of the vehicle.
    """
    east, north, up = (desired - flown for desired, flown in zip(desired_m_s, flown_m_s, strict=True))
    over_ground_s = math.hypot(east, north) / (2.0 * acceleration.ground_m_s2)
    vertical_s = abs(up) / (2.0 * acceleration.vertical_m_s2)
    x, y, z = position_m
    return (x - east * over_ground_s, y - north * over_ground_s, z - up * vertical_s)


class Players(NamedTuple):
    """Where everybody is in the game frame, m, and how they move, m/s. `target_m` is T of the TAD game, None in PE."""

    pursuer_m: Vector
    pursuer_m_s: Vector
    evader_m: Vector
    evader_m_s: Vector
    target_m: Vector | None


class Certificate(NamedTuple):
    """What the game says at this cycle, and what became of it.

    `value` is the time to capture in s (PE), or the evader's final distance from its target in m (TAD), of the game's
    pursuer, which is at full speed at once. What this vehicle can promise, from the velocity and with the acceleration
    that it has, is a capture in `time_needed_s` (TAD: the meeting) and, in TAD, to
    keep the evader `assured_distance_m` from its target: negative by what it comes short where the evader gets there,
    NaN in PE. `margin_s` is zero on the barrier. `gap_m` is the horizontal distance to the disc's rim and
    `height_gap_m` the height above the disc. `command_ned_m_s` left the limits that are named in `active_limits`.
    `reason` is the `guidance.game.Reason` of the game's answer: with TOO_OLD nothing here is guaranteed. In TAD
    everything here is said of the disc less what the evader may have run since it was seen. `battery_needed` is the
    share of the charge that it takes to come home from here, NaN where that is not reckoned.
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


class Answer(NamedTuple):
    """The game's answer, and what this vehicle can do: see `Certificate`."""

    solution: StateSolution
    time_needed_s: float
    assured_distance_m: float


def answer(game: Game, players: Players, acceleration: Acceleration, before_m_s: Vector | None) -> Answer:
    """Solve the game, and once more from where a pursuer would begin that does as well as this vehicle.

    That place is told by the optimal velocity of the last cycle.

    Args:
        game: What is played.
        players: From where.
        acceleration: Of the vehicle.
        before_m_s: The pursuer's optimal velocity of the last cycle, None at the first.
    """
    P, E, T, seen = players.pursuer_m, players.evader_m, players.target_m, players.evader_m_s
    here = solve_state(game, P, E, T, evader_velocity_m_s=seen)
    desired_m_s = here.pursuer_velocity_m_s if before_m_s is None else before_m_s
    late = late_start(P, desired_m_s, players.pursuer_m_s, acceleration)
    there = solve_state(game, late, E, T, evader_velocity_m_s=seen)
    if T is None:
        return Answer(here, there.value, math.nan)
    short = there.winner == Winner.EVADER
    return Answer(here, there.meeting_time_s, -there.value if short else there.value)


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
    """Lay down a cycle of the game.

    Args:
        game: What was played.
        answered: What the game and the vehicle's promise were.
        players: In the game frame.
        gaps: To the disc.
        limited: What was commanded, and the limits that changed it.
        desired_ned_m_s: What approach and game asked for.
        evader_age_s: Age of what is known of the evader.
        tolerance_m: How near to the disc counts as reached.
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
    )


def certify_no_game(players: Players, gaps: Gaps, setpoint: Setpoint, *, evader_age_s: float) -> Certificate:
    """Lay down a cycle in which the evader is too fast for a game. What is commanded then is a hover.

    Args:
        players: In the game frame.
        gaps: To the disc, m.
        setpoint: The hover that is commanded.
        evader_age_s: Age of what is known of the evader.
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
