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
from guidance.game.team.arguments import (
    TeamGame,
    TeamGames,
    joined,
    judged,
    pair_axes,
    real_argument,
)
from guidance.game.team.danger import team_most_in_danger
from guidance.game.team.open_runs import leaves_open, longest_open
from guidance.game.team.regions import (
    PlaneArrays,
    Regions,
    crossing,
    edge,
    for_each,
    halfway,
    survived,
    unit,
)
from guidance.game.team.table import (
    Goal,
    Meeting,
    PursuerGames,
    are,
    costs_of,
    place_of,
    pull_shares,
    taken,
    team_of,
    together,
)

_FEW = 8
"""Up to this number of pursuers every crossing of two edges is tried."""

_ROUNDING = 1e-11
"""Relative difference of two bounds that counts as none."""

MISSED = 1e-10
"""A run counts as longer than the longest one found if it exceeds it by this share."""

_TRIED = 180
"""Headings that are tried first for the run that ends closest to the target."""

_MINIMA = 3
"""Lowest minima among these that are followed."""

_CLOSER = 17
"""Headings between both neighbours of the best one, in each further round."""

_ROUNDS = 8
"""Rounds: the heading is found to 2e-9 rad."""

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
        multipliers: change of the value for each second that a pursuer starts late, (..., n): in PE λᵢ s
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
    game: TeamGames,
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
    P = real_argument("pursuers", pursuers, "(..., n, 3)")
    others = {
        name: real_argument(name, value, "(..., 3)")
        for name, value in arguments.items()
        if value is not None
    }
    game, P, others = _broadcast(team_game, P, others)
    with np.errstate(all="ignore"):
        team = _team(game, P, others)
        play = pursuit_of_team if target is None else defence_of_team
        answer, best = play(team, others["evader"], _best_pair(team))
        won = answer.winner > 0
        multipliers = np.zeros(team.own.shape)
        if won.any():
            multipliers = np.where(won[..., None], _multipliers(team, best), 0.0)
        answer = answer._replace(multipliers=multipliers)
    # Why a row has no answer, else 0.
    no_answer = int(Reason.NOT_FINITE)
    worst = np.max(team.alone.reason, axis=-1)
    overflow = np.where(np.isfinite(answer.value), 0, no_answer)
    fault = np.asarray(np.where(worst >= no_answer, worst, overflow))
    has_set = target is not None and not game.target_extent.is_point
    if has_set and P.shape[-2] > 1:
        answer = _against_a_set(game, P, others, answer, fault)

    def refused() -> str:
        places = {"pursuers": P} | others
        wrong = [
            f"{name} = {array!r}" for name, array in places.items() if not np.isfinite(array).all()
        ]
        named = ", ".join(wrong)
        return f"{named or 'the team'}: has"

    return judged(answer, fault, refused)


def _broadcast(
    team_game: TeamGame, P: Array, others: Mapping[str, Array]
) -> tuple[Game, Array, dict[str, Array]]:
    """Return the game, the pursuers' positions and the other vectors with all leading axes.

    Raises:
        ConfigError: the shapes do not fit each other, or the one evader has several speeds.
    """
    axes_of_teams = {"pursuers": P.shape[:-2], "game": pair_axes(team_game)[:-1]}
    axes_of_others = {name: value.shape[:-1] for name, value in others.items()}
    shape = fitting(axes_of_teams | axes_of_others)
    shape_of_pursuers = (*shape, P.shape[-2])
    game = team_game.rows(lambda value: np.broadcast_to(value, shape_of_pursuers)).game
    v = game.evader_speed_m_s
    if np.ndim(v) and np.ptp(v, axis=-1).any():
        raise ConfigError(
            f"evader_speed_m_s = {v!r}: must be one number, or an array (..., 1), for one evader"
        )
    vectors_of_rows = {name: np.broadcast_to(value, (*shape, 3)) for name, value in others.items()}
    return game, np.broadcast_to(P, (*shape_of_pursuers, 3)), vectors_of_rows


def _team(game: Game, P: Array, others: Mapping[str, Array]) -> PursuerGames:
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
        danger = team_most_in_danger(game, P, others["evader"], others["target"])
    sound = fault == 0
    margin_s = np.where(sound, danger.margin_s, answer.margin_s)
    with_margin = answer._replace(margin_s=margin_s)
    lost = np.asarray((answer.winner <= 0) & sound)
    if not lost.any():
        return with_margin
    # The lost rows again, with the point where the evader arrives as target.
    point_game = replace(game, target_extent=POINT)
    lost_games = for_rows(point_game, lambda value: value[lost])
    lost_others = {name: value[lost] for name, value in others.items()}
    lost_others["target"] = danger.point_m[lost]
    team = _team(lost_games, P[lost], lost_others)
    with np.errstate(all="ignore"):
        run, _ = defence_of_team(team, lost_others["evader"], _best_pair(team))
    parts = [np.array(part) for part in with_margin]
    for column, part in zip(parts, run, strict=True):
        column[lost] = part
    return TeamSolution(*parts)


def _best_pair(team: PursuerGames) -> Meeting:
    """Return the guarantee of the best two pursuers, or of the best one."""
    count = team.own.shape[-1]
    pairs = together(team, (..., pairs_of(count)))
    best = place_of(np.argmax(pairs.worth, axis=-1))
    return Meeting(*(part[best] for part in pairs))


def defence_of_team(
    team: PursuerGames, evader: Array, best: Meeting
) -> tuple[TeamSolution, Meeting]:
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
    decides = alone.winner == winner[..., None]
    least = np.argmin(np.where(decides, alone.value, np.inf), axis=-1)
    first = np.where(won, best.first, least)
    second = np.where(won, best.second, least)
    worth = np.where(won, best.worth, taken(alone.value, least))
    best = placed(team, evader, Meeting(best.x, best.y, worth, first, second))
    run = nearest_run(team, evader, best, won)
    answer = assembled(team, evader, run, best, won[..., None])
    return answer._replace(winner=winner), best


def pursuit_of_team(
    team: PursuerGames, evader: Array, best: Meeting
) -> tuple[TeamSolution, Meeting]:
    """Play PE: see `solve_team` and `defence_of_team`."""
    run = longest_run(team)
    is_bracket = run.worth <= best.worth * (1.0 - _ROUNDING)
    best = placed(team, evader, NUMPY.select_all(is_bracket, run, best))
    flies = are(team.own.shape[-1], best.first, best.second)
    return assembled(team, evader, run, best, flies), best


def placed(team: PursuerGames, evader: Array, best: Meeting) -> Meeting:
    """Return a meeting at the first pursuer's own end of the game if that decides it alone."""
    end = taken(team.alone.meeting_point_m, best.first) - evader
    single = best.first == best.second
    x = np.where(single, end[..., 0], best.x)
    y = np.where(single, end[..., 1], best.y)
    return best._replace(x=x, y=y)


def nearest_run(
    team: PursuerGames,
    evader: Array,
    best: Meeting,
    won: Array,
    pursuers: Any = ...,  # noqa: ANN401 - an index
) -> Meeting:
    """Return the straight run of TAD that ends closest to the target, and its worth.

    If no pursuer has a height to reach, it is the run of the best pair. Else runs are tried to the pursuers' own ends
    of the game, to that of the best pair, and straight to the target until a pursuer reaches its height. If all of
    these are worth more than the best pair's, runs along all headings are tried. Worth that differs from that of the
    best pair by rounding is the same.

    Args:
        team: the pursuers.
        evader: position of the evader, (..., 3), m.
        best: what two of them guarantee.
        won: where they win, (...); elsewhere the run is that of `best`.
        pursuers: index of the pursuers that play in arrays (..., n); all by default.
    """
    goal = team.goal
    if goal is None or is_zero(team.regions.safe):
        return best
    regions = team.regions.pick(pursuers)
    ends = team.alone.meeting_point_m[pursuers] - evader[..., None, :]
    straight_x, straight_y = goal.towards(regions.safe)
    to_x = np.concatenate([ends[..., 0], best.x[..., None], straight_x], axis=-1)
    to_y = np.concatenate([ends[..., 1], best.y[..., None], straight_y], axis=-1)
    to_x, to_y = unit((to_x, to_y))
    far = np.min(survived(regions.beside(), for_each((to_x, to_y))), axis=-1)
    x = far * to_x
    y = far * to_y
    distance = np.fmin(goal.left((x, y)), np.inf)
    least = place_of(np.argmin(distance, axis=-1))
    shortest, x, y = (np.array(part[least]) for part in (distance, x, y))
    unmet = np.asarray(won & (shortest > best.worth * (1.0 + _ROUNDING)))
    if unmet.any():
        ends = _nearest_of_all(regions.pick(unmet), goal.rows(unmet))
        nearer = ends.worth < shortest[unmet]
        for part, found in ((x, ends.x), (y, ends.y), (shortest, ends.worth)):
            part[unmet] = np.where(nearer, found, part[unmet])
    same = shortest <= best.worth * (1.0 + _ROUNDING)
    worth = np.where(same, best.worth, shortest)
    # No pursuers decide a run that is worth more than the best pair's.
    longer = worth > best.worth
    first = np.where(longer, -1, best.first)
    second = np.where(longer, -2, best.second)
    return NUMPY.select_all(won, Meeting(x, y, worth, first, second), best)


class _End(NamedTuple):
    """The end of a run from the evader, m, and its worth."""

    x: Array
    y: Array
    worth: Array


def _nearest_of_all(regions: Regions, goal: Goal) -> _End:
    """Return the straight run along any heading that ends closest to the target, (k,).

    The lowest minima among equally spaced headings are followed, closer and closer: the distance has kinks where
    another pursuer captures first.
    """

    def ends(angle: Array) -> _End:
        heading = (np.cos(angle), np.sin(angle))
        far = np.min(survived(regions.beside(), for_each(heading)), axis=-1)
        x = far * heading[0]
        y = far * heading[1]
        return _End(x, y, np.fmin(goal.left((x, y)), np.inf))

    rows = len(goal.x)
    step = 2.0 * np.pi / _TRIED
    tried = np.broadcast_to(np.arange(_TRIED) * step, (rows, _TRIED))
    left = ends(tried).worth
    is_minimum = (left <= np.roll(left, 1, axis=-1)) & (left <= np.roll(left, -1, axis=-1))
    order = np.argsort(np.where(is_minimum, left, np.inf), axis=-1)[:, :_MINIMA]
    middle = np.take_along_axis(tried, order, axis=-1)
    shares = np.linspace(-1.0, 1.0, _CLOSER)
    for _ in range(_ROUNDS):
        near = (middle[..., None] + step * shares).reshape(rows, -1)
        left = ends(near).worth.reshape(rows, _MINIMA, _CLOSER)
        best = np.argmin(left, axis=-1)
        middle = taken(near.reshape(rows, _MINIMA, _CLOSER), best)
        step *= 2.0 / (_CLOSER - 1)
    found = ends(middle)
    least = place_of(np.argmin(found.worth, axis=-1))
    return _End(found.x[least], found.y[least], found.worth[least])


def longest_run(team: PursuerGames) -> Meeting:
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
    longer = longest * (1.0 + MISSED)
    missed = runs & leaves_open(team.regions, longer)
    if not missed.any():
        return longest_run
    regions = team.regions.pick(missed)
    run, first, second = longest_open(regions, longest[missed])
    time = NUMPY.norm2(run) / team.v[missed]
    longest_parts = (*run, -time, first, second)
    parts = [np.array(part) for part in longest_run]
    for column, part in zip(parts, longest_parts, strict=True):
        column[missed] = part
    return Meeting(*parts)


def _longest_found(team: PursuerGames) -> Meeting:
    """Return the longest of the runs to the pursuers' own ends and to crossings between these."""
    count = team.own.shape[-1]
    v = team.v[..., None]
    evader_velocity_m_s = team.alone.evader_velocity_m_s
    headings = [evader_velocity_m_s[..., axis] / v for axis in (0, 1)]
    reach = team.alone.value * v
    if count <= _FEW:
        return _longest_run(team, headings, reach)
    chosen = np.argmin(reach, axis=-1)[..., None]
    longest = _longest_run(team, headings, reach, chosen)
    while chosen.shape[-1] < count:
        far = NUMPY.norm2((longest.x, longest.y))
        x = longest.x / far
        y = longest.y / far
        ends = survived(team.regions, for_each((x, y)))
        np.put_along_axis(ends, chosen, np.inf, axis=-1)
        worst = np.argmin(ends, axis=-1)
        cut = taken(ends, worst) < far * (1.0 - 1e-13)
        if not cut.any():
            break
        added = np.where(cut, worst, chosen[..., 0])
        chosen = np.concatenate([chosen, added[..., None]], axis=-1)
        cut_run = _longest_run(team, headings, reach, chosen)
        longest = NUMPY.select_all(cut, cut_run, longest)
    return longest


def _longest_run(
    team: PursuerGames, own_ends: Sequence[Array], reach: Array, chosen: Array | None = None
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
    runs = _runs_to_ends_and_crossings(regions, own_ends, reach)
    # The longest run; of equally long ones that with the larger y, then the larger x.
    far = runs.far
    tied = far >= far.max(axis=-1, keepdims=True) * (1.0 - EQUAL)
    north = np.where(tied, runs.y, -2.0)
    northmost = north == north.max(axis=-1, keepdims=True)
    east = np.where(northmost, runs.x, -2.0)
    best = np.asarray(east.argmax(axis=-1))
    at = place_of(best)
    run = runs.far[at]
    nearest = runs.nearest[at]
    decide = runs.decide[best]
    second = np.where(best >= reach.shape[-1], decide[..., 1], nearest)
    is_run = run > 0
    first = np.where(is_run, decide[..., 0], nearest)
    second = np.where(is_run, second, nearest)
    if chosen is not None:
        first = taken(chosen, first)
        second = taken(chosen, second)
    own_time = taken(team.alone.value, first)
    time = np.where(first == second, own_time, run / team.v)
    return Meeting(run * runs.x[at], run * runs.y[at], -time, first, second)


class _Runs(NamedTuple):
    """Straight runs (..., k): directions, lengths before the pursuers, and by whom they end.

    Attributes:
        x: East part of the direction.
        y: North part of the direction.
        far: Length until the first of the pursuers is there; −∞ for no run.
        nearest: Which pursuer that is.
        decide: The pursuers whose edges decide the direction, (k, 2).
    """

    x: Array
    y: Array
    far: Array
    nearest: Array
    decide: Array


def _runs_to_ends_and_crossings(regions: Regions, own_ends: Sequence[Array], reach: Array) -> _Runs:
    """Return the runs to the own end of each pursuer's game, then to one and the other crossing of every two edges."""
    count = reach.shape[-1]
    every = np.arange(count)
    pairs = pairs_of(count)
    decide = np.concatenate([every[:, None].repeat(2, axis=1), pairs, pairs])
    beside = regions.beside()
    reached = edge(beside, for_each((own_ends[0], own_ends[1]))).reach
    x, y = np.full((2, *reach.shape[:-1], len(decide)), np.nan, dtype=reach.dtype)
    ends = np.full((*x.shape, count), np.nan, dtype=reach.dtype)
    x[..., :count], y[..., :count] = own_ends
    ends[..., :count, :] = np.maximum(reached, beside.safe)
    ends[..., every, every] = reach
    # Edges cross if each is the shorter one along its own heading; this test of a pair holds for both crossings.
    i, j = pairs.T
    first_shorter = reached[..., i, i] > reached[..., i, j]
    second_shorter = reached[..., j, j] > reached[..., j, i]
    crossed = first_shorter & second_shorter
    *rows, pair = np.nonzero(np.concatenate([crossed, crossed], axis=-1))
    if len(pair):
        entry = (*rows, count + pair)
        is_second = pair >= len(pairs)
        x[entry], y[entry] = heading = _crossings(
            regions, own_ends, rows, decide[count + pair], is_second
        )
        ends[entry] = survived(regions.pick(tuple(rows)), for_each(heading))
    far = np.fmax(ends.min(axis=-1), -np.inf)
    return _Runs(x, y, far, ends.argmin(axis=-1), decide)


def _crossings(
    regions: Regions, own_ends: Sequence[Array], rows: Sequence[Array], two: Array, other: Array
) -> PlaneArrays:
    """Return the headings of the crossings of two edges, (m,).

    Args:
        regions: Of the evader before each pursuer.
        own_ends: Headings, x and y, to the own ends of the pursuers' games.
        rows: Leading indices of the pairs, each (m,).
        two: Both pursuers, (m, 2).
        other: Whether it is the crossing on the other side, not that between both own headings, (m,).
    """
    first, second = two.T
    begin = (own_ends[0][*rows, first], own_ends[1][*rows, first])
    end = (own_ends[0][*rows, second], own_ends[1][*rows, second])
    middle_x, middle_y = halfway(begin, end)
    side = np.where(other, -1.0, 1.0)
    both = regions.pick((*(row[:, None] for row in rows), two))
    return crossing(both, begin, end, (side * middle_x, side * middle_y))


def assembled(
    team: PursuerGames, evader: Array, run: Meeting, best: Meeting, flies: Array
) -> TeamSolution:
    """Return an answer, without multipliers.

    Args:
        team: the pursuers.
        evader: position of the evader, (..., 3), m.
        run: the run of the evader, and its guarantee to the evader.
        best: the pursuers' guarantee.
        flies: which pursuers fly to that together, (..., n); the others play their own game.
    """
    alone = team.alone
    count = alone.value.shape[-1]
    at = place_of(run.first)
    single = run.first == run.second
    plays_alone = np.where(best.first == best.second, best.first, -1)
    flies = flies & ~are(count, plays_alone)
    velocity_m_s = alone.pursuer_velocity_m_s
    if flies.any():
        velocity_m_s = np.where(flies[..., None], team.straight((best.x, best.y)), velocity_m_s)
    far = NUMPY.norm2((run.x, run.y))
    sign = 1.0 if team.goal is not None else -1.0
    to = np.zeros(evader.shape, evader.dtype)
    to[..., 0] = run.x
    to[..., 1] = run.y
    rate_per_s = team.v / np.where(far > 0, far, 1.0)
    velocity = rate_per_s[..., None] * to
    solved = np.where(single, alone.reason[at], np.int8(Reason.SOLVED))
    reason = np.where(best.worth == run.worth, solved, np.int8(Reason.BRACKET))
    is_single = single[..., None]
    return TeamSolution(
        winner=alone.winner.max(axis=-1),
        value=sign * best.worth,
        lower_bound=sign * run.worth,
        margin_s=alone.margin_s.max(axis=-1),
        meeting_point_m=np.where(is_single, alone.meeting_point_m[at], evader + to),
        meeting_time_s=np.where(single, alone.meeting_time_s[at], far / team.v),
        binds=are(count, best.first, best.second),
        multipliers=np.zeros(alone.value.shape),
        pursuer_velocity_m_s=velocity_m_s,
        evader_velocity_m_s=np.where(is_single, alone.evader_velocity_m_s[at], velocity),
        reason=reason,
    )


def _multipliers(team: PursuerGames, best: Meeting) -> Array:
    """Return the change of the value for each second that a pursuer starts late, (..., n).

    X* maximises the evader's time t_E (PE), or minimises its distance from the target (TAD), among the points with
    t_E(X) ≤ tᵢ(X) for every pursuer. The multipliers λᵢ of that problem solve

        Σ λᵢ ∇(t_E − tᵢ) = ∇t_E  (PE),    Σ λᵢ ∇(t_E − tᵢ) = −∇‖X − T‖  (TAD).

    If the height of the later of two Cylinders decides, X* is where the evader can be until then.
    """
    best, height = _at_later_height(team, best)
    far = NUMPY.norm2((best.x, best.y))
    run = (best.x / far, best.y / far)
    if team.goal is None:
        pull = (run[0] / team.v, run[1] / team.v)
    else:
        pull = team.goal.pick(...).pull((best.x, best.y))
    met = edge(team.regions, for_each(run))
    level = (met.reach <= team.regions.safe) | height[..., None]
    x, y = costs_of(team.regions, team.v, run, met, level)
    cost_of_first = (taken(x, best.first), taken(y, best.first))
    cost_of_second = (taken(x, best.second), taken(y, best.second))
    shares = pull_shares(pull, (cost_of_first, cost_of_second))
    single = best.first == best.second
    share = dot2(pull, cost_of_first) / dot2(cost_of_first, cost_of_first)
    first = np.where(single, share, shares[0])
    second = np.where(single, share, shares[1])
    every = np.arange(team.own.shape[-1])
    is_second = every == best.second[..., None]
    is_first = every == best.first[..., None]
    multiplier = np.where(is_second, second[..., None], 0.0)
    multiplier = np.where(is_first, first[..., None], multiplier)
    return np.where(np.isfinite(multiplier), np.maximum(multiplier, 0.0), 0.0)


def _at_later_height(team: PursuerGames, best: Meeting) -> tuple[Meeting, Array]:
    """Return the meeting at the height of the later of two Cylinders where that decides, and where it does."""
    safe = team.regions.safe
    if is_zero(safe):
        return best, np.zeros(best.worth.shape, dtype=bool)
    pair = np.stack([best.first, best.second], axis=-1)
    reaches = np.take_along_axis(safe, pair, axis=-1)
    later = taken(pair, np.argmax(reaches, axis=-1))
    reach = np.take_along_axis(safe, later[..., None], axis=-1)
    worth = team.worth_of(reach)
    to = for_each((best.x, best.y))
    if team.goal is not None:
        to = team.goal.towards(reach)
    reach = reach[..., 0]
    is_pair = best.first != best.second
    decides = is_pair & (reach > 0) & (best.worth == worth[..., 0])
    x, y = (reach * part[..., 0] for part in unit(to))
    at_height = Meeting(x, y, best.worth, later, later)
    return NUMPY.select_all(decides, at_height, best), decides


@lru_cache
def pairs_of(count: int) -> Array:
    """Return the numbers of both pursuers of every pair, (k, 2); of a single pursuer twice its own."""
    return np.stack(np.triu_indices(count, 1 if count > 1 else 0), axis=-1)
