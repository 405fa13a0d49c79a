"""Teams played to the end of the game: all players as point masses, each evader until it is captured or arrives.

All players keep a velocity for a step. A step is never longer than the least time in which an evader could be captured
or arrive, so that no end is missed; the steps shorten until the end is a nanosecond away. An evader that has ended
stays where it is, and its pursuers are matched again. Promises of the first matching are kept: an evader ends no closer
to its target than promised, or no later, with an error of up to 2 (u + v) `step_s` because velocities are held. A
capture in TAD with less to spare than `HELD` of this way could be lost to that error, so it is not promised.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from guidance.errors import ConfigError
from guidance.game.arrays import NUMPY, Array, components
from guidance.game.game import Game, Reason
from guidance.game.pe import to_target
from guidance.game.policies import EVADER_POLICIES, PURSUER_POLICIES, Policy, policy_of
from guidance.game.records import require
from guidance.game.rollout import NANOSECOND_S, SPARE_STEPS, End, look_ahead
from guidance.game.rows import for_rows
from guidance.game.team.arguments import TeamGames, joined
from guidance.game.team.matching import Matching, match_teams
from guidance.game.team.table import place_of, taken

OPTIMAL = "optimal"

HELD = 0.1
"""Share of both players' way in a step by which the value of TAD may fall because velocities are held.

Of 7,432 plays against searching evaders with steps of 0.05 s at 2 and 1 m/s, 7 lost a value of 0.003 to 0.011 m, and
none more: 0.073 of the way.
"""

TeamPolicies = str | Policy | Sequence[str | Policy]
"""One policy for all players of a side, or one for each."""


_Sides = tuple[Sequence[str | Policy], Sequence[str | Policy]]


class TeamSample(NamedTuple):
    """A moment of a batch of games: time (...), positions, how each evader has ended (..., m), and the matching."""

    time_s: Array
    pursuers_m: Array
    evaders_m: Array
    end: Array
    matching: Matching


class TeamRollout(NamedTuple):
    """The end of a game of teams, or of each game of a batch.

    Attributes:
        end: `End` of each evader, (..., m).
        time_s: time of its end, (..., m).
        captor: number of the pursuer that captured it, (..., m); −1 for none.
        distance_m: final distance of each evader from its target, (..., m); NaN without one.
        pursuers_m: final positions, (..., n, 3).
        evaders_m: final positions, (..., m, 3).
        first: the matching at the beginning.
        path: every sample with `keep_path`, else empty.
    """

    end: Array
    time_s: Array
    captor: Array
    distance_m: Array
    pursuers_m: Array
    evaders_m: Array
    first: Matching
    path: tuple[TeamSample, ...]


def rollout_teams(  # noqa: PLR0914
    game: TeamGames,
    pursuers: ArrayLike,
    evaders: ArrayLike,
    target: ArrayLike | None = None,
    *,
    pursuer_policy: TeamPolicies = OPTIMAL,
    evader_policy: TeamPolicies = OPTIMAL,
    capture_m: float = 0.0,
    step_s: float = 0.05,
    duration_s: float = 600.0,
    hysteresis: float = 0.0,
    keep_path: bool = False,
) -> TeamRollout:
    """Play a game of teams to its end.

    Args:
        game: as `match_teams`.
        pursuers: initial positions, (..., n, 3), m.
        evaders: initial positions, (..., m, 3), m.
        target: each evader's target, (..., m, 3), or the one of all, (3,), m; None for PE.
        pursuer_policy: "optimal" is the play of `match_teams`. Any other name in `PURSUER_POLICIES`, or a function
            like them, is played by each pursuer against its matched evader. It is told the evader's velocity of
            the step before; before the first step that is zero.
        evader_policy: "optimal", or a name in `EVADER_POLICIES` or a function, played against the nearest pursuer.
        capture_m: distance that counts as captured, m, beside the capture radius of the game.
        step_s: longest step, s.
        duration_s: when to stop at the latest, s.
        hysteresis: as `match_teams`.
        keep_path: whether to keep every sample.

    Raises:
        ConfigError: as `match_teams`; an unknown policy; or a number that is out of range.
    """
    require("step_s", step_s)
    require("duration_s", duration_s)
    require("capture_m", capture_m, zero_allowed=True)
    spare_m = 0.0 if target is None else held_m(joined(game, "(n, m)").game, step_s)
    first = match_teams(game, pursuers, evaders, target, spare_m=spare_m)
    shape = first.guaranteed.shape
    (n, m) = first.beats.shape[-2:]
    pairs = joined(game, "(n, m)").rows(lambda value: np.broadcast_to(value, (*shape, n, m)))
    ends = replace(pairs.game, capture_radius_m=pairs.game.capture_radius_m + capture_m)
    chase = _named("pursuer_policy", pursuer_policy, n, PURSUER_POLICIES)
    flee = _named("evader_policy", evader_policy, m, EVADER_POLICIES)
    T = None
    if target is not None:
        T = np.array(np.broadcast_to(target, (*shape, m, 3)), dtype=np.float64)
    P = np.array(np.broadcast_to(pursuers, (*shape, n, 3)), dtype=np.float64)
    E = np.array(np.broadcast_to(evaders, (*shape, m, 3)), dtype=np.float64)
    outcomes = Outcomes(
        np.where(first.reason >= int(Reason.NOT_FINITE), int(End.NO_ANSWER), int(End.RUNNING)),
        np.zeros((*shape, m)),
        np.full((*shape, m), -1),
    )
    now_s = np.zeros(shape)
    seen_m_s = np.zeros(E.shape)
    matching = first
    path = []
    for _ in range(math.ceil(duration_s / step_s) + SPARE_STEPS):
        foreseen = foresee(ends, pairs.plays, P, E, T)
        outcomes = judged_ends(outcomes, foreseen, now_s, duration_s)
        running = outcomes.end == End.RUNNING
        matching = match_teams(
            game, P, E, T, in_play=running, previous=matching, hysteresis=hysteresis
        )
        if keep_path:
            path.append(TeamSample(now_s, P, E, outcomes.end, matching))
        if not running.any():
            break
        velocity_m_s, run_m_s = _played(pairs.game, (chase, flee), P, E, T, seen_m_s, matching)
        h = step_of(foreseen, running, matching, np.minimum(step_s, duration_s - now_s))
        P, E = moved(P, E, velocity_m_s, run_m_s, h, running)
        seen_m_s = np.where(running[..., None], run_m_s, 0.0)
        if T is not None:
            drift_m = np.where(running, h[..., None], 0.0)[..., None]
            T = T + drift_m * [*pairs.game.target_velocity_m_s, 0.0]
        now_s = now_s + h
    end = np.where(outcomes.end == End.RUNNING, int(End.TIME_UP), outcomes.end)
    distance_m = np.full(outcomes.time_s.shape, math.nan)
    if T is not None:
        to_targets = to_target(NUMPY, pairs.game, components(E), components(T))
        distance_m = np.asarray(NUMPY.norm2(to_targets[:2]))
    return TeamRollout(end, outcomes.time_s, outcomes.captor, distance_m, P, E, first, tuple(path))


class Outcomes(NamedTuple):
    """Of each evader, (..., m): how its game ended, or that it runs, when, and by which pursuer (−1: by none)."""

    end: Array
    time_s: Array
    captor: Array


class Foreseen(NamedTuple):
    """What would happen next at the present velocities, s from now; inf for never.

    Attributes:
        capture_s: of an evader by a pursuer, (..., n, m).
        arrival_s: of an evader at its target, (..., m).
        turn_s: a change of a pursuer's best velocity, (..., n, m).
    """

    capture_s: Array
    arrival_s: Array
    turn_s: Array


def foresee(ends: Game, plays: Array, P: Array, E: Array, T: Array | None) -> Foreseen:
    """Look ahead for every pair of players."""
    goal = None if T is None else T[..., None, :, :]
    capture_s, arrival_s, turn_s = look_ahead(
        NUMPY, ends, P[..., :, None, :], E[..., None, :, :], goal
    )
    capture_s = np.where(plays, capture_s, math.inf)
    arrival_s = np.broadcast_to(arrival_s, capture_s.shape)[..., 0, :]
    return Foreseen(capture_s, arrival_s, np.broadcast_to(turn_s, capture_s.shape))


def judged_ends(
    outcomes: Outcomes, foreseen: Foreseen, now_s: Array, duration_s: float
) -> Outcomes:
    """End the games of the evaders that are captured, have arrived, or have no time left."""
    running = outcomes.end == End.RUNNING
    caught = running & (np.min(foreseen.capture_s, axis=-2) <= NANOSECOND_S)
    arrived = running & (foreseen.arrival_s <= NANOSECOND_S)
    late = running & (now_s >= duration_s)[..., None]
    end = np.select(
        [caught, arrived, late],
        [int(End.CAPTURED), int(End.ARRIVED), int(End.TIME_UP)],
        outcomes.end,
    )
    time_s = np.where(running, now_s[..., None], outcomes.time_s)
    captor = np.where(caught, np.argmin(foreseen.capture_s, axis=-2), outcomes.captor)
    return Outcomes(end, time_s, captor)


def step_of(foreseen: Foreseen, running: Array, matching: Matching, longest_s: Array) -> Array:
    """Return the length of the next step, s: to the next event, at most `longest_s`, and 0 where no game runs."""
    soonest_s = np.minimum(np.min(foreseen.capture_s, axis=-2), foreseen.arrival_s)
    end_s = np.min(np.where(running, soonest_s, np.inf), axis=-1)
    turn_s = np.min(taken(foreseen.turn_s, matching.evader_of), axis=-1)
    return np.where(running.any(axis=-1), np.minimum(np.minimum(end_s, turn_s), longest_s), 0.0)


def moved(
    P: Array, E: Array, velocity_m_s: Array, run_m_s: Array, step_s: Array, running: Array
) -> tuple[Array, Array]:
    """Return the positions after a step (...), s; an evader that does not run, (..., m), stays."""
    moves_s = np.where(running, step_s[..., None], 0.0)[..., None]
    return P + step_s[..., None, None] * velocity_m_s, E + moves_s * run_m_s


def held_m(game: Game, step_s: float) -> Array:
    """Return how far the value of TAD may fall in a play whose velocities are held for a step, m, for each pair."""
    return np.asarray(HELD * step_s * (game.pursuer.horizontal_m_s + game.evader_speed_m_s))


def _played(
    game: Game,
    sides: _Sides,
    P: Array,
    E: Array,
    T: Array | None,
    seen_m_s: Array,
    matching: Matching,
) -> tuple[Array, Array]:
    """Return the velocities of pursuers against their evaders, (..., n, 3), and of evaders against the nearest pursuer.

    Each player moves by its own policy, (..., m, 3).
    """
    chased = matching.evader_of
    near = np.argmin(np.sum((P[..., :, None, :] - E[..., None, :, :]) ** 2, axis=-1), axis=-2)
    at, by = (place_of(index, index.ndim - 1) for index in (chased, near))
    ours = for_rows(game, lambda value: taken(value, chased))
    nearest_games = for_rows(game, lambda value: taken(value.swapaxes(-1, -2), near))
    velocities = []
    optimal = (matching.pursuer_velocity_m_s, matching.evader_velocity_m_s)
    targets = None if T is None else T[at]
    places = ((ours, P, E[at], targets, seen_m_s[at]), (nearest_games, P[by], E, T, seen_m_s))
    for policies, velocity_m_s, state in zip(sides, optimal, places, strict=True):
        velocity = np.array(velocity_m_s, dtype=np.float64)
        for policy in dict.fromkeys(policies):
            if not isinstance(policy, str):
                uses_policy = np.array([player_policy == policy for player_policy in policies])
                velocity[..., uses_policy, :] = policy(*state)[..., uses_policy, :]
        velocities.append(velocity)
    return velocities[0], velocities[1]


def _named(
    name: str, policies: TeamPolicies, count: int, catalogue: Mapping[str, Policy]
) -> list[str | Policy]:
    """Return a policy for each player, "optimal" by its name.

    Raises:
        ConfigError: If one is unknown, or there are not as many as players.
    """
    player_policies = (
        [policies] * count if isinstance(policies, str) or callable(policies) else list(policies)
    )
    if len(player_policies) != count:
        raise ConfigError(
            f"{name}: {len(player_policies)} policies for {count} players; give one for all, or one for each"
        )
    return [
        policy if policy == OPTIMAL else policy_of(name, policy, catalogue)
        for policy in player_policies
    ]
