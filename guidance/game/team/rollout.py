"""Teams played to the end of the game: all players as point masses, each evader until it is captured or arrives.

All players keep a velocity for a step. A step is never longer than the least time to a capture or arrival of an evader,
so that no end is missed; the steps shorten until the end is a nanosecond away. An evader that has ended
stays where it is, and its pursuers are matched again. Promises of the first matching are kept by the play "optimal": an
evader ends no closer to its target than promised, or no later, with an error of up to 2 (u + v) `step_s` because
velocities are held. The play "captures" keeps the captures and not the distances. A capture in TAD with less to spare
than `HELD` of this way could be lost to that error, so it is not promised.
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
from guidance.game.policies import EVADER_POLICIES, PURSUER_POLICIES, Policy
from guidance.game.records import require
from guidance.game.rollout import NANOSECOND_S, SPARE_STEPS, End, look_ahead
from guidance.game.rows import for_rows
from guidance.game.team.arguments import TeamGames, joined
from guidance.game.team.captures import Chase, Intent, first_intent, play_sequences
from guidance.game.team.matching import Matching, match_teams
from guidance.game.team.rules import TEAM_RULES, TeamRule, TeamView, chase, nearest_evader
from guidance.game.team.table import place_of, taken

_OPTIMAL = "optimal"
CAPTURES = "captures"
"""The plays of `guidance.game.team.captures` that keep promises, of distances and of captures."""

HELD = 0.1
"""Largest fall of TAD's value because velocities are held, as a share of both players' way in a step.

Of 7,432 plays against searching evaders with steps of 0.05 s at 2 and 1 m/s, 7 lost a value of 0.003 to 0.011 m, and
none more: 0.073 of the way.
"""

TeamPolicies = str | Policy | TeamRule | Sequence[str | Policy | TeamRule]
"""One policy for all players of a side, or one for each."""

_Chosen = list[str | Policy | TeamRule]


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
    pursuer_policy: TeamPolicies = _OPTIMAL,
    evader_policy: TeamPolicies = _OPTIMAL,
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
        pursuer_policy: "optimal" is the play of `match_teams`; "captures", in TAD, keeps the promised captures and not
            the distances, for more captures. A name in `TEAM_RULES`, or a `TeamRule`, is a rule without promises. Any
            other name in `PURSUER_POLICIES`, or a function like them, is played by each pursuer against its matched
            evader. It gets the evader's velocity of the step before; zero in the first step.
        evader_policy: "optimal", or a name in `EVADER_POLICIES` or a function, played against the nearest pursuer.
        capture_m: distance that counts as captured, m, beside the capture radius of the game.
        step_s: longest step, s.
        duration_s: when to stop at the latest, s.
        hysteresis: as `match_teams`.
        keep_path: whether to keep every sample.

    Raises:
        ConfigError: as `match_teams`; an unknown policy; "captures" without a target; or a number that is out of range.
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
    sides = _sides(pursuer_policy, evader_policy, n, m, in_pe=target is None)
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
    view = TeamView(pairs.game, P, E, T, np.zeros(E.shape), np.zeros(P.shape), outcomes.end == 0)
    matching = first
    intent = None
    path = []
    for _ in range(math.ceil(duration_s / step_s) + SPARE_STEPS):
        foreseen = foresee(ends, pairs.plays, P, E, T)
        outcomes = judged_ends(outcomes, foreseen, now_s, duration_s)
        running = outcomes.end == End.RUNNING
        if keep_path or sides.needs_matching:
            matching = match_teams(
                game, P, E, T, in_play=running, previous=matching, hysteresis=hysteresis
            )
        if keep_path:
            path.append(TeamSample(now_s, P, E, outcomes.end, matching))
        if not running.any():
            break
        view = view._replace(pursuers_m=P, evaders_m=E, target_m=T, in_play=running)
        course, intent = _course(view, pairs.plays, sides, matching, intent, step_s)
        run_m_s = _fled(view, sides.flee, matching)
        h = step_of(foreseen, running, course.evader_of, np.minimum(step_s, duration_s - now_s))
        P, E = moved(P, E, course.velocity_m_s, run_m_s, h, running)
        view = view._replace(
            evader_velocity_m_s=np.where(running[..., None], run_m_s, 0.0),
            pursuer_velocity_m_s=course.velocity_m_s,
        )
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
    """End of each evader's game, (..., m): its kind, or that the game runs; the time; the captor (−1 for none)."""

    end: Array
    time_s: Array
    captor: Array


class NextEvents(NamedTuple):
    """Times to the next events at the present velocities, s; inf for never.

    Attributes:
        capture_s: of an evader by a pursuer, (..., n, m).
        arrival_s: of an evader at its target, (..., m).
        turn_s: a change of a pursuer's best velocity, (..., n, m).
    """

    capture_s: Array
    arrival_s: Array
    turn_s: Array


def foresee(ends: Game, plays: Array, P: Array, E: Array, T: Array | None) -> NextEvents:
    """Look ahead for every pair of players."""
    goal = None if T is None else T[..., None, :, :]
    capture_s, arrival_s, turn_s = look_ahead(
        NUMPY, ends, P[..., :, None, :], E[..., None, :, :], goal
    )
    capture_s = np.where(plays, capture_s, math.inf)
    arrival_s = np.broadcast_to(arrival_s, capture_s.shape)[..., 0, :]
    return NextEvents(capture_s, arrival_s, np.broadcast_to(turn_s, capture_s.shape))


def judged_ends(
    outcomes: Outcomes, foreseen: NextEvents, now_s: Array, duration_s: float
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


def step_of(foreseen: NextEvents, running: Array, evader_of: Array, longest_s: Array) -> Array:
    """Return the length of the next step, s: to the next event, at most `longest_s`, and 0 where no game runs.

    Args:
        foreseen: the events.
        running: which evaders are in play, (..., m).
        evader_of: whom each pursuer chases, (..., n).
        longest_s: longest step, s.
    """
    soonest_s = np.minimum(np.min(foreseen.capture_s, axis=-2), foreseen.arrival_s)
    end_s = np.min(np.where(running, soonest_s, np.inf), axis=-1)
    turn_s = np.min(taken(foreseen.turn_s, evader_of), axis=-1)
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


class _Sides(NamedTuple):
    """The policies of the players, and which pursuers promise captures only, (n,)."""

    chase: _Chosen
    flee: _Chosen
    spends: Array

    @property
    def needs_matching(self) -> bool:
        """True if a player's policy depends on the matching."""
        has_rules_only = all(isinstance(policy, TeamRule) for policy in self.chase)
        return _OPTIMAL in self.flee or not has_rules_only


def _sides(
    pursuer_policy: TeamPolicies, evader_policy: TeamPolicies, n: int, m: int, *, in_pe: bool
) -> _Sides:
    plays = {_OPTIMAL: _OPTIMAL, CAPTURES: CAPTURES}
    chase = _named("pursuer_policy", pursuer_policy, n, {**PURSUER_POLICIES, **plays, **TEAM_RULES})
    flee = _named("evader_policy", evader_policy, m, {**EVADER_POLICIES, _OPTIMAL: _OPTIMAL})
    if CAPTURES in chase and in_pe:
        raise ConfigError("pursuer_policy = 'captures': needs a target; without one play 'optimal'")
    return _Sides(chase, flee, np.array([policy == CAPTURES for policy in chase]))


def _course(
    view: TeamView,
    plays: Array,
    sides: _Sides,
    matching: Matching,
    intent: Intent | None,
    step_s: float,
) -> tuple[Chase, Intent | None]:
    """Return the chase of the pursuers in a step, each by its own policy, and their intent after it."""
    course = Chase(matching.pursuer_velocity_m_s, matching.evader_of)
    if sides.spends.any():
        before = first_intent(view) if intent is None else intent
        course, intent = play_sequences(view, plays, matching, before, step_s, sides.spends)
    velocity = np.array(course.velocity_m_s, dtype=np.float64)
    evader_of = np.array(course.evader_of)
    for policy in dict.fromkeys(sides.chase):
        if isinstance(policy, str):
            continue
        uses_policy = np.array([player_policy == policy for player_policy in sides.chase])
        if isinstance(policy, TeamRule):
            chased = nearest_evader(view)
            flown = policy.play(view)
        else:
            chased = matching.evader_of
            flown = chase(view, chased, policy)
        velocity[..., uses_policy, :] = flown[..., uses_policy, :]
        evader_of[..., uses_policy] = chased[..., uses_policy]
    return Chase(velocity, evader_of), intent


def _fled(view: TeamView, policies: _Chosen, matching: Matching) -> Array:
    """Return the velocities of evaders, (..., m, 3), each by its own policy against the nearest pursuer."""
    P = view.pursuers_m
    E = view.evaders_m
    near = np.argmin(np.sum((P[..., :, None, :] - E[..., None, :, :]) ** 2, axis=-1), axis=-2)
    by = place_of(near, near.ndim - 1)
    games = for_rows(view.game, lambda value: taken(value.swapaxes(-1, -2), near))
    velocity = np.array(matching.evader_velocity_m_s, dtype=np.float64)
    for policy in dict.fromkeys(policies):
        if isinstance(policy, str | TeamRule):
            continue
        uses_policy = np.array([player_policy == policy for player_policy in policies])
        run = policy(games, P[by], E, view.target_m, view.evader_velocity_m_s)
        velocity[..., uses_policy, :] = run[..., uses_policy, :]
    return velocity


def _named(
    name: str,
    policies: TeamPolicies,
    count: int,
    catalogue: Mapping[str, str | Policy | TeamRule],
) -> _Chosen:
    """Return a policy for each player; the plays that keep promises by their names.

    Raises:
        ConfigError: If one is unknown, or there are not as many as players.
    """
    if isinstance(policies, str | TeamRule) or callable(policies):
        policies = [policies] * count
    chosen = []
    for policy in policies:
        if isinstance(policy, str) and policy not in catalogue:
            allowed = f"must be one of {', '.join(catalogue)}, or a function"
            others = "strategies with a memory and courses are played by scenarios"
            raise ConfigError(f"{name} = {policy!r}: {allowed}; {others}")
        chosen.append(catalogue[policy] if isinstance(policy, str) else policy)
    if len(chosen) != count:
        raise ConfigError(
            f"{name}: {len(chosen)} policies for {count} players; give one for all, or one for each"
        )
    return chosen
