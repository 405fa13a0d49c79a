"""Several pursuers against one evader.

The evader reaches the points of the intersection of its regions against all pursuers (`regions`) before any of them.

TAD: if the regions are convex, one point X* of the intersection is closest to the target, and the value of the game is

    L = dist(T, ∩ᵢ regionᵢ).

For a target with an extent, T is its point that is closest to the intersection.

A team wins against a point if one pursuer wins alone, because T is outside the intersection only if it is outside one
region. A set may be apart from the intersection of two regions although it meets both: then two pursuers win together
and none alone. A second pursuer increases L, and at most two decide X*. The pursuers that decide it fly straight to X*;
then L never falls for any play of the evader. The others are free and fly to X* too.

PE with two pursuers ("two cutters": Szots & Harmati, arXiv 2403.15188; Von Moll et al., arXiv 2407.19954): the value is
the evader's time to the point X* of the intersection that is farthest from it. The evader and both pursuers go straight
to X*. With λᵢ as in `TeamSolution.multipliers`, the value changes at the rate

    −Σ λᵢ + (Σ λᵢ − 1) n·e ≤ −1    for every heading e of the evader, n the direction to X*, since Σ λᵢ ≥ 1.

Σ λᵢ ≥ 1 holds in calm air: each run ends sooner the smaller its angle with the direction to the pursuer is. If both
pursuers were less than half a turn apart on the side of X*, a heading with larger angles to both would lead farther.

No value is proven in three cases, and `TeamSolution` gives a bracket (`Reason.BRACKET`) where its ends differ:

* PE with three pursuers or more: the farthest point of the intersection is only a lower bound, because Σ λᵢ may be less
  than 1. The best pair is an upper bound: it captures in its own value alone.
* PE with several pursuers in wind: the upper bound is that of the best pursuer alone.
* TAD with Cylinders that reach their heights at different times: the intersection is not convex, and the pursuers may
  have to defend two of its points at once. They guarantee the value of the best pair with both as late as the later.

If two points are equally far (a dispersal surface), both are optimal, and the evader may choose. Of points that are
equally far to the last bit, `solve_team` takes the one with the larger y, then the larger x. Near such a surface each
new solution decides again; this costs the pursuers a time that goes to zero with the time step.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from guidance.errors import ConfigError
from guidance.game.arrays import NUMPY, Array, dot2
from guidance.game.extent import POINT
from guidance.game.game import Game, Reason, Winner
from guidance.game.records import is_zero
from guidance.game.rows import fitting, for_rows
from guidance.game.team.arguments import Games, joined, judged, pair_axes, vectors
from guidance.game.team.danger import most_in_danger
from guidance.game.team.open_runs import leaves_open, longest_open
from guidance.game.team.regions import crossing, edge, halfway, survived, unit
from guidance.game.team.table import (
    Meeting,
    Team,
    are,
    costs_of,
    place_of,
    shares_of,
    taken,
    team_of,
    together,
)

FEW = 8
"""Up to this number of pursuers every crossing of two edges is tried."""

ROUNDING = 1e-11
"""Relative difference of two bounds that counts as none."""

MISSED = 1e-10
"""Relative length by which a run is longer than the longest that was found."""

EQUAL = 1e-14
"""Relative difference of two runs that are equally long."""


class TeamSolution(NamedTuple):
    """The answer of `solve_team` for leading axes (...) and n pursuers.

    A row without an answer is NaN throughout, its winner UNDECIDED, and its reason tells why.

    Attributes:
        winner: `Winner`: 1 the team, −1 the evader, 0 neither (the barrier itself, or no answer).
        value: TAD: distance of the evader from its target at the capture, m, or, where the evader wins, the distance
            that the nearest pursuer is short of a capture then, m. PE: time to the capture, s. The pursuers' play
            guarantees it.
        lower_bound: the value that the evader's play guarantees to it. It differs from `value` only where the value is
            not proven (`Reason.BRACKET`): in PE it is then less, and in TAD more.
        margin_s: how much sooner a pursuer can guard the target than the evader can be there, s; infinite in PE.
        meeting_point_m: where the evader is when the game ends, (..., 3), m: X*, the point that gives `lower_bound`.
        meeting_time_s: when it is there, from now, s.
        binds: which pursuers decide the value, (..., n): one, or two.
        multipliers: by how much the value changes for each second that a pursuer starts late, (..., n): in PE λᵢ s
            more, in TAD λᵢ m less. Zero for pursuers that do not bind, and where the evader wins.
        pursuer_velocity_m_s: velocities of the pursuers, (..., n, 3), m/s.
        evader_velocity_m_s: velocity of the evader, (..., 3), m/s.
        reason: `Reason`: solved, a degenerate state, or why there is no answer.
    """

    winner: Array
    value: Array
    lower_bound: Array
    margin_s: Array
    meeting_point_m: Array
    meeting_time_s: Array
    binds: Array
    multipliers: Array
    pursuer_velocity_m_s: Array
    evader_velocity_m_s: Array
    reason: Array


def solve_team(
    game: Games,
    pursuers: ArrayLike,
    evader: ArrayLike,
    target: ArrayLike | None = None,
    *,
    evader_velocity_m_s: ArrayLike | None = None,
) -> TeamSolution:
    """Solve a game of several pursuers against one evader: PE without a target, TAD with one.

    A team of one has the answer of `solve`, to the bit.

    Args:
        game: without information age, for an evader in the plane. Its numbers may be arrays that broadcast with
            (..., n): (n,) where pursuers differ, (..., 1) where evaders do. Or a list of n games.
        pursuers: positions, (..., n, 3), NumPy, m.
        evader: position, (..., 3), m.
        target: position of the evader's target, (..., 3), m, or None for PE.
        evader_velocity_m_s: the evader's velocity as observed, (..., 3), where it is known; see `solve`.

    Raises:
        ConfigError: teams do not play such a game, an argument is not an array of its shape, the shapes do not fit
            each other, or a single state has no answer. In a batch such a row is NaN instead.
    """
    team_game = joined(game, "(n,)")
    arguments = {"evader": evader, "target": target, "evader_velocity_m_s": evader_velocity_m_s}
    P = vectors("pursuers", pursuers, "(..., n, 3)")
    others = {
        name: vectors(name, value, "(..., 3)")
        for name, value in arguments.items()
        if value is not None
    }
    axes = {"pursuers": P.shape[:-2], "game": pair_axes(team_game)[:-1]}
    shape = fitting(axes | {name: value.shape[:-1] for name, value in others.items()})
    P = np.broadcast_to(P, (*shape, *P.shape[-2:]))
    others = {name: np.broadcast_to(value, (*shape, 3)) for name, value in others.items()}
    game = team_game.rows(lambda value: np.broadcast_to(value, P.shape[:-1])).game
    v = game.evader_speed_m_s
    if np.ndim(v) and np.ptp(v, axis=-1).any():
        raise ConfigError(
            f"evader_speed_m_s = {v!r}: must be one number, or an array (..., 1), for one evader"
        )
    with np.errstate(all="ignore"):
        team = _team(game, P, others)
        answer, best = (chase if target is None else defence)(
            team, others["evader"], _best_pair(team)
        )
        answer = answer._replace(multipliers=_multipliers_of_won(team, best, answer.winner > 0))
    worst = np.max(team.alone.reason, axis=-1)
    none = int(Reason.NOT_FINITE)
    fault = np.where(worst >= none, worst, np.where(np.isfinite(answer.value), 0, none))
    if target is not None and not game.target_extent.is_point and P.shape[-2] > 1:
        answer = _against_a_set(game, P, others, answer, np.asarray(fault))

    def refused() -> str:
        places = {"pursuers": P} | others
        wrong = [
            f"{name} = {array!r}" for name, array in places.items() if not np.isfinite(array).all()
        ]
        return f"{', '.join(wrong) or 'the team'}: has"

    return judged(answer, np.asarray(fault), refused)


def _team(game: Game, P: Array, others: Mapping[str, Array]) -> Team:
    """Return the pursuers' games against the evader; `rest` has the other positions by the arguments' names."""
    lone = {name: value[..., None, :] for name, value in others.items()}
    return team_of(game, P, lone["evader"], lone.get("target"), lone.get("evader_velocity_m_s"))


def _against_a_set(
    game: Game, P: Array, others: Mapping[str, Array], answer: TeamSolution, fault: Array
) -> TeamSolution:
    """Return the answer for a target with an extent, with the margin over its whole set.

    An evader that wins runs to the point of the set where it arrives before every pursuer by most. The rest of its
    answer is that of the game with this point as target.
    """
    with np.errstate(all="ignore"):
        danger = most_in_danger(game, P, others["evader"], others["target"])
    margin_s = np.where(fault == 0, danger.margin_s, answer.margin_s)
    lost = np.asarray((answer.winner <= 0) & (fault == 0))
    if not lost.any():
        return answer._replace(margin_s=margin_s)
    lost_games = for_rows(replace(game, target_extent=POINT), lambda value: value[lost])
    lost_others = {name: value[lost] for name, value in others.items()} | {
        "target": danger.point_m[lost]
    }
    team = _team(lost_games, P[lost], lost_others)
    with np.errstate(all="ignore"):
        run, _ = defence(team, lost_others["evader"], _best_pair(team))
    parts = [np.array(part) for part in answer._replace(margin_s=margin_s)]
    for column, part in zip(parts, run, strict=True):
        column[lost] = part
    return TeamSolution(*parts)


def _best_pair(team: Team) -> Meeting:
    """Return what the best two pursuers guarantee, or the best one."""
    pairs = together(team, (..., pairs_of(team.own.shape[-1])))
    best = place_of(np.argmax(pairs.worth, axis=-1))
    return Meeting(*(part[best] for part in pairs))


def defence(team: Team, evader: Array, best: Meeting) -> tuple[TeamSolution, Meeting]:
    """Play TAD: see `solve_team`.

    Args:
        team: the pursuers.
        evader: position of the evader, (..., 3), m.
        best: what two of them guarantee.
    """
    alone = team.alone
    winner = np.max(alone.winner, axis=-1)
    if team.goal is not None and not team.goal.is_point:
        winner = np.where(best.worth > 0.0, np.int8(Winner.PURSUER), winner)
    won = winner > 0
    # If the evader wins, the value is that of the pursuer that comes least short, or is there at the same instant.
    least = np.argmin(np.where(alone.winner == winner[..., None], alone.value, np.inf), axis=-1)
    first = np.where(won, best.first, least)
    second = np.where(won, best.second, least)
    best = placed(
        team,
        evader,
        Meeting(*best[:2], np.where(won, best.worth, taken(alone.value, least)), first, second),
    )
    answer = assembled(team, evader, nearest_run(team, evader, best, won), best, won[..., None])
    return answer._replace(winner=winner), best


def chase(team: Team, evader: Array, best: Meeting) -> tuple[TeamSolution, Meeting]:
    """Play PE: see `solve_team` and `defence`."""
    run = longest_run(team)
    best = placed(
        team, evader, NUMPY.select_all(run.worth <= best.worth * (1.0 - ROUNDING), run, best)
    )
    return assembled(
        team, evader, run, best, are(team.own.shape[-1], best.first, best.second)
    ), best


def placed(team: Team, evader: Array, best: Meeting) -> Meeting:
    """Return a meeting at the first pursuer's own end of the game if that decides it alone."""
    end = taken(team.alone.meeting_point_m, best.first) - evader
    single = best.first == best.second
    return best._replace(
        x=np.where(single, end[..., 0], best.x), y=np.where(single, end[..., 1], best.y)
    )


def nearest_run(
    team: Team,
    evader: Array,
    best: Meeting,
    won: Array,
    pursuers: Any = ...,  # noqa: ANN401 - an index
) -> Meeting:
    """Return the straight run of TAD that ends closest to the target, and its worth.

    If no pursuer has a height to reach, it is the run of the best pair. Else runs are tried to the pursuers' own ends
    of the game, to that of the best pair, and straight to the target until a pursuer reaches its height. Worth that
    differs from that of the best pair by rounding is the same.

    Args:
        team: the pursuers.
        evader: position of the evader, (..., 3), m.
        best: what two of them guarantee.
        won: where they win, (...); elsewhere the run is that of `best`.
        pursuers: what takes the pursuers that play from arrays (..., n); all by default.
    """
    goal = team.goal
    if goal is None or is_zero(team.regions.safe):
        return best
    regions = team.regions.pick(pursuers)
    ends = team.alone.meeting_point_m[pursuers] - evader[..., None, :]
    straight = goal.towards(regions.safe)
    x, y = (
        np.concatenate([ends[..., i], best[i][..., None], straight[i]], axis=-1) for i in (0, 1)
    )
    to = unit((x, y))
    far = np.min(survived(regions.beside(), (to[0][..., None], to[1][..., None])), axis=-1)
    x = far * to[0]
    y = far * to[1]
    distance = np.fmin(goal.left((x, y)), np.inf)
    least = place_of(np.argmin(distance, axis=-1))
    worth = distance[least]
    worth = np.where(worth <= best.worth * (1.0 + ROUNDING), best.worth, worth)
    open_ = np.where(worth > best.worth, -1, best.first)
    run = Meeting(x[least], y[least], worth, open_, np.where(worth > best.worth, -2, best.second))
    return NUMPY.select_all(won, run, best)


def longest_run(team: Team) -> Meeting:
    """Return the straight run of PE that lasts longest before all pursuers.

    It leads to a pursuer's own end of the game, or to a crossing of two edges. All of a few pursuers are tried. Of many
    only a few matter: begin with the one that captures soonest, and add the one that cuts the run off most, until none
    does. A crossing that is not between the own ends of two pursuers can matter if a third cuts off both. So it is
    checked whether a longer run leaves a heading open, and then the longest one is found by its length (`open_runs`).
    """
    longest_run = _longest_found(team)
    if team.own.shape[-1] < 3:
        return longest_run
    longest = np.asarray(NUMPY.norm2((longest_run.x, longest_run.y)))
    runs = (longest > 0.0) & np.isfinite(longest)
    missed = runs & leaves_open(team.regions, longest * (1.0 + MISSED))
    if not missed.any():
        return longest_run
    run, first, second = longest_open(team.regions.pick(missed), longest[missed])
    parts = [np.array(part) for part in longest_run]
    time = NUMPY.norm2(run) / team.v[missed]
    for column, part in zip(parts, (*run, -time, first, second), strict=True):
        column[missed] = part
    return Meeting(*parts)


def _longest_found(team: Team) -> Meeting:
    """Return the longest of the runs to the pursuers' own ends and to crossings between these."""
    count = team.own.shape[-1]
    headings = [team.alone.evader_velocity_m_s[..., axis] / team.v[..., None] for axis in (0, 1)]
    reach = team.alone.value * team.v[..., None]
    if count <= FEW:
        return _among(team, headings, reach)
    chosen = np.argmin(reach, axis=-1)[..., None]
    longest = _among(team, headings, reach, chosen)
    while chosen.shape[-1] < count:
        far = NUMPY.norm2((longest.x, longest.y))
        x = longest.x / far
        y = longest.y / far
        ends = survived(team.regions, (x[..., None], y[..., None]))
        np.put_along_axis(ends, chosen, np.inf, axis=-1)
        worst = np.argmin(ends, axis=-1)
        cut = taken(ends, worst) < far * (1.0 - 1e-13)
        if not cut.any():
            break
        chosen = np.concatenate([chosen, np.where(cut, worst, chosen[..., 0])[..., None]], axis=-1)
        longest = NUMPY.select_all(cut, _among(team, headings, reach, chosen), longest)
    return longest


def _among(  # noqa: PLR0914
    team: Team, own_ends: Sequence[Array], reach: Array, chosen: Array | None = None
) -> Meeting:
    """Return the longest run before all pursuers, or before some, whose numbers are (..., k).

    It leads to a pursuer's own end of the game, or to one of both crossings of two edges. Of equally long runs the one
    with the larger y, then the larger x is taken.
    """
    regions = team.regions
    if chosen is not None:
        chosen_rows = place_of(chosen, chosen.ndim - 1)
        regions = regions.pick(chosen_rows)
        own_ends = [part[chosen_rows] for part in own_ends]
        reach = reach[chosen_rows]
    count = reach.shape[-1]
    every = np.arange(count)
    pairs = pairs_of(count)
    i, j = pairs.T
    decide = np.concatenate([every[:, None].repeat(2, axis=1), pairs, pairs])
    reached = edge(regions.beside(), (own_ends[0][..., None], own_ends[1][..., None])).reach
    crossed = (reached[..., i, i] > reached[..., i, j]) & (reached[..., j, j] > reached[..., j, i])
    x, y = np.full((2, *reach.shape[:-1], len(decide)), np.nan, dtype=reach.dtype)
    ends = np.full((*x.shape, count), np.nan, dtype=reach.dtype)
    x[..., :count], y[..., :count] = own_ends
    ends[..., :count, :] = np.maximum(reached, regions.beside().safe)
    ends[..., every, every] = reach
    *rows, pair = np.nonzero(np.concatenate([crossed, crossed], axis=-1))
    if len(pair):
        entry = (*rows, count + pair)
        # The crossing between both own headings, or that on the other side.
        begin, end = (
            (own_ends[0][*rows, pursuer], own_ends[1][*rows, pursuer])
            for pursuer in decide[count + pair].T
        )
        middle = halfway(begin, end)
        side = np.where(pair < len(i), 1.0, -1.0)
        two = regions.pick((*(row[:, None] for row in rows), decide[count + pair]))
        x[entry], y[entry] = heading = crossing(
            two, begin, end, (side * middle[0], side * middle[1])
        )
        ends[entry] = survived(
            regions.pick(tuple(rows)), (heading[0][:, None], heading[1][:, None])
        )
    far = np.fmax(ends.min(axis=-1), -np.inf)
    tied = far >= far.max(axis=-1, keepdims=True) * (1.0 - EQUAL)
    north = np.where(tied, y, -2.0)
    best = np.where(north == north.max(axis=-1, keepdims=True), x, -2.0).argmax(axis=-1)
    at = place_of(best)
    run = far[at]
    met = ends[at].argmin(axis=-1)
    first = decide[best, 0]
    second = np.where(best < count, met, decide[best, 1])
    first, second = (np.where(run > 0, part, met) for part in (first, second))
    if chosen is not None:
        first = taken(chosen, first)
        second = taken(chosen, second)
    time = np.where(first == second, taken(team.alone.value, first), run / team.v)
    return Meeting(run * x[at], run * y[at], -time, first, second)


def assembled(team: Team, evader: Array, run: Meeting, best: Meeting, flies: Array) -> TeamSolution:
    """Return an answer, without multipliers.

    Args:
        team: the pursuers.
        evader: position of the evader, (..., 3), m.
        run: the run of the evader, and what it guarantees to it.
        best: what the pursuers guarantee.
        flies: which pursuers fly to that together, (..., n); the others play their own game.
    """
    alone = team.alone
    at = place_of(run.first)
    single = run.first == run.second
    flies = flies & ~are(alone.value.shape[-1], np.where(best.first == best.second, best.first, -1))
    velocity_m_s = alone.pursuer_velocity_m_s
    if flies.any():
        velocity_m_s = np.where(flies[..., None], team.straight((best.x, best.y)), velocity_m_s)
    far = NUMPY.norm2((run.x, run.y))
    sign = 1.0 if team.goal is not None else -1.0
    to = np.zeros(evader.shape, evader.dtype)
    to[..., 0] = run.x
    to[..., 1] = run.y
    velocity = (team.v / np.where(far > 0, far, 1.0))[..., None] * to
    reason = np.where(single, alone.reason[at], np.int8(Reason.SOLVED))
    return TeamSolution(
        winner=alone.winner.max(axis=-1),
        value=sign * best.worth,
        lower_bound=sign * run.worth,
        margin_s=alone.margin_s.max(axis=-1),
        meeting_point_m=np.where(single[..., None], alone.meeting_point_m[at], evader + to),
        meeting_time_s=np.where(single, alone.meeting_time_s[at], far / team.v),
        binds=are(alone.value.shape[-1], best.first, best.second),
        multipliers=np.zeros(alone.value.shape),
        pursuer_velocity_m_s=velocity_m_s,
        evader_velocity_m_s=np.where(single[..., None], alone.evader_velocity_m_s[at], velocity),
        reason=np.where(best.worth == run.worth, reason, np.int8(Reason.BRACKET)),
    )


def _multipliers_of_won(team: Team, best: Meeting, won: Array) -> Array:
    """Return the multipliers where the team wins, (..., n), and zero where the evader does."""
    if not won.any():
        return np.zeros(team.own.shape)
    return np.where(won[..., None], _multipliers(team, best), 0.0)


def _multipliers(team: Team, best: Meeting) -> Array:  # noqa: PLR0914
    """Return by how much the value changes for each second that a pursuer starts late, (..., n).

    X* maximises the evader's time t_E (PE), or minimises its distance from the target (TAD), among the points with
    t_E(X) ≤ tᵢ(X) for every pursuer. The multipliers λᵢ of that problem solve

        Σ λᵢ ∇(t_E − tᵢ) = ∇t_E  (PE),    Σ λᵢ ∇(t_E − tᵢ) = −∇‖X − T‖  (TAD).

    If the height of the later of two Cylinders decides, X* is where the evader can be until then.
    """
    best, height = _at_height(team, best)
    far = NUMPY.norm2((best.x, best.y))
    run = best.x / far, best.y / far
    pull = run[0] / team.v, run[1] / team.v
    if team.goal is not None:
        pull = team.goal.pick(...).pull((best.x, best.y))
    met = edge(team.regions, (run[0][..., None], run[1][..., None]))
    level = (met.reach <= team.regions.safe) | height[..., None]
    x, y = costs_of(team.regions, team.v, run, met, level)
    q = (taken(x, best.first), taken(y, best.first)), (taken(x, best.second), taken(y, best.second))
    shares = shares_of(pull, q)
    single = best.first == best.second
    share = dot2(pull, q[0]) / dot2(q[0], q[0])
    first = np.where(single, share, shares[0])
    second = np.where(single, share, shares[1])
    every = np.arange(team.own.shape[-1])
    multiplier = np.where(every == best.second[..., None], second[..., None], 0.0)
    multiplier = np.where(every == best.first[..., None], first[..., None], multiplier)
    return np.where(np.isfinite(multiplier), np.maximum(multiplier, 0.0), 0.0)


def _at_height(team: Team, best: Meeting) -> tuple[Meeting, Array]:
    """Return the meeting at the height of the later of two Cylinders where that decides, and where it does."""
    safe = team.regions.safe
    pair = np.stack(best[3:], axis=-1)
    if is_zero(safe):
        return best, np.zeros(best.worth.shape, dtype=bool)
    later = taken(pair, np.argmax(np.take_along_axis(safe, pair, axis=-1), axis=-1))[..., None]
    reach = np.take_along_axis(safe, later, axis=-1)
    worth = -reach / team.v[..., None] if team.goal is None else team.goal.beyond(reach)
    decides = (best.first != best.second) & (reach > 0)[..., 0] & (best.worth == worth[..., 0])
    to = (best.x[..., None], best.y[..., None]) if team.goal is None else team.goal.towards(reach)
    x, y = (reach[..., 0] * part[..., 0] for part in unit(to))
    return NUMPY.select_all(
        decides, Meeting(x, y, best.worth, later[..., 0], later[..., 0]), best
    ), decides


@lru_cache
def pairs_of(count: int) -> Array:
    """Return the numbers of both pursuers of every pair, (k, 2); of a single pursuer twice its own."""
    return np.stack(np.triu_indices(count, 1 if count > 1 else 0), axis=-1)
