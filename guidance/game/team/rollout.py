"""Teams played to the end of the game: all players as point masses, each evader until it is captured or arrives.

All players keep a velocity for a step. A step is never longer than the least time in which an evader could be captured
or arrive, so that no end is missed; the steps shorten until the end is a nanosecond away. An evader that has ended
stays where it is, and its pursuers are matched again. Promises of the first matching are kept: an evader ends no closer
to its target than promised, or no later, with an error of up to 2 (u + v) `step_s` because velocities are held.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from guidance.errors import ConfigError
from guidance.game.arrays import NUMPY, components
from guidance.game.game import Game, Reason
from guidance.game.pe import to_target
from guidance.game.policies import EVADER_POLICIES, PURSUER_POLICIES, Policy
from guidance.game.records import require
from guidance.game.rollout import NANOSECOND_S, Ahead, End, look_ahead
from guidance.game.rows import for_rows
from guidance.game.team.arguments import Games, TeamGame, joined
from guidance.game.team.matching import Matching, match_teams
from guidance.game.team.regions import Array

SPARE_STEPS = 10_000
"""Steps that a game may take beyond those of its duration, to close in on its ends."""

OPTIMAL = "optimal"

Policies = str | Policy | Sequence[str | Policy]
"""One policy for all players of a side, or one for each."""


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


class _Sides(NamedTuple):
    """The constants of a rollout: the game, with numbers (..., n, m), the one by which it ends, and policies."""

    game: Game
    ends: TeamGame
    pursuers: Sequence[str | Policy]
    evaders: Sequence[str | Policy]


def rollout_teams(
    game: Games,
    pursuers: ArrayLike,
    evaders: ArrayLike,
    target: ArrayLike | None = None,
    *,
    pursuer_policy: Policies = OPTIMAL,
    evader_policy: Policies = OPTIMAL,
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
            like them, is played by each pursuer against its matched evader.
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
    first = match_teams(game, pursuers, evaders, target)
    shape, (n, m) = first.guaranteed.shape, first.beats.shape[-2:]
    pairs = joined(game, "(n, m)").rows(lambda value: np.broadcast_to(value, (*shape, n, m)))
    team = _Sides(
        pairs.game,
        pairs._replace(game=replace(pairs.game, capture_radius_m=pairs.game.capture_radius_m + capture_m)),
        _named("pursuer_policy", pursuer_policy, n, PURSUER_POLICIES),
        _named("evader_policy", evader_policy, m, EVADER_POLICIES),
    )
    T = None if target is None else np.array(np.broadcast_to(target, (*shape, m, 3)), dtype=np.float64)
    P = np.array(np.broadcast_to(pursuers, (*shape, n, 3)), dtype=np.float64)
    E = np.array(np.broadcast_to(evaders, (*shape, m, 3)), dtype=np.float64)
    end = np.where(first.reason >= int(Reason.NOT_FINITE), int(End.NO_ANSWER), int(End.RUNNING))
    now, when, captor = np.zeros(shape), np.zeros((*shape, m)), np.full((*shape, m), -1)
    matching, path = first, []
    for _ in range(math.ceil(duration_s / step_s) + SPARE_STEPS):
        capture, arrival, turn = _ahead(team, P, E, T)
        soonest = np.min(capture, axis=-2)
        running = end == End.RUNNING
        caught, arrived = running & (soonest <= NANOSECOND_S), running & (arrival <= NANOSECOND_S)
        captor = np.where(caught, np.argmin(capture, axis=-2), captor)
        late = running & (now >= duration_s)[..., None]
        end = np.select([caught, arrived, late], [int(End.CAPTURED), int(End.ARRIVED), int(End.TIME_UP)], end)
        when = np.where(running, now[..., None], when)
        running = end == End.RUNNING
        matching = match_teams(game, P, E, T, in_play=running, previous=matching, hysteresis=hysteresis)
        if keep_path:
            path.append(TeamSample(now, P, E, end, matching))
        if not running.any():
            break
        flown, run = _velocities(team, P, E, T, matching)
        free = np.where(running, np.minimum(soonest, arrival), np.inf)
        mine = np.take_along_axis(turn, np.maximum(matching.evader_of, 0)[..., None], axis=-1)[..., 0]
        least = np.minimum(np.min(free, axis=-1), np.min(mine, axis=-1))
        h = np.minimum(np.minimum(least, step_s), duration_s - now)
        h = np.where(running.any(axis=-1), h, 0.0)
        P = P + h[..., None, None] * flown
        moved = np.where(running, h[..., None], 0.0)[..., None]
        E = E + moved * run
        T = None if T is None else T + moved * [*team.game.target_velocity_m_s, 0.0]
        now = now + h
    end = np.where(end == End.RUNNING, int(End.TIME_UP), end)
    distance: Array = np.full((*shape, m), math.nan)
    if T is not None:
        distance[...] = NUMPY.norm2(to_target(NUMPY, team.game, components(E), components(T))[:2])
    return TeamRollout(end, when, captor, distance, P, E, first, tuple(path))


def _ahead(team: _Sides, P: Array, E: Array, T: Array | None) -> Ahead:
    """Return the least times, s, until an evader could be captured (..., n, m), or arrive (..., m), or it turns."""
    shape = (*P.shape[:-1], E.shape[-2])
    goal = None if T is None else T[..., None, :, :]
    capture, arrival, turn = look_ahead(NUMPY, team.ends.game, P[..., :, None, :], E[..., None, :, :], goal)
    arrival = np.broadcast_to(arrival, shape)[..., 0, :]
    return Ahead(np.where(team.ends.plays, capture, math.inf), arrival, np.broadcast_to(turn, shape))


def _velocities(team: _Sides, P: Array, E: Array, T: Array | None, matching: Matching) -> tuple[Array, Array]:
    """Return the velocities of all players, (..., n, 3) and (..., m, 3)."""
    chased = np.maximum(matching.evader_of, 0)
    w = P[..., :, None, :] - E[..., None, :, :]
    near = np.argmin(w[..., 0] ** 2 + w[..., 1] ** 2 + w[..., 2] ** 2, axis=-2)

    def chase(policy: Policy) -> Array:
        game = for_rows(team.game, lambda value: np.take_along_axis(value, chased[..., None], axis=-1)[..., 0])
        goal = None if T is None else _rows(T, chased)
        return np.asarray(policy(game, P, _rows(E, chased), goal))

    def flee(policy: Policy) -> Array:
        game = for_rows(team.game, lambda value: np.take_along_axis(value, near[..., None, :], axis=-2)[..., 0, :])
        return np.asarray(policy(game, _rows(P, near), E, T))

    flown = _each(team.pursuers, PURSUER_POLICIES, matching.pursuer_velocity_m_s, chase)
    return flown, _each(team.evaders, EVADER_POLICIES, matching.evader_velocity_m_s, flee)


def _each(
    policies: Sequence[str | Policy], catalogue: Mapping[str, Policy], optimal: Array, play: Callable[[Policy], Array]
) -> Array:
    """Return the velocities of a team's players, each by its own policy."""
    velocity = np.array(optimal, dtype=np.float64)
    for policy in dict.fromkeys(policies):
        if policy != OPTIMAL:
            mine = np.array([other == policy for other in policies])
            velocity[..., mine, :] = play(catalogue[policy] if isinstance(policy, str) else policy)[..., mine, :]
    return velocity


def _named(name: str, given: Policies, count: int, catalogue: Mapping[str, Policy]) -> Sequence[str | Policy]:
    """Return a policy for each player.

    Raises:
        ConfigError: If one is unknown, or there are not as many as players.
    """
    each = [given] * count if isinstance(given, str) or callable(given) else list(given)
    for policy in each:
        if isinstance(policy, str) and policy not in catalogue:
            raise ConfigError(f"{name} = {policy!r}: must be one of {', '.join(catalogue)}")
    if len(each) != count:
        raise ConfigError(f"{name}: {len(each)} policies for {count} players; give one for all, or one for each")
    return each


def _rows(positions: Array, index: Array) -> Array:
    return np.take_along_axis(positions, index[..., None], axis=-2)
