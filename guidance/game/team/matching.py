"""Many pursuers against many evaders: who plays against whom, and how many captures are guaranteed.

TAD: an edge is a pursuer that beats an evader alone. A maximum matching, of size m, guarantees m captures at once, and
they stay guaranteed in play, because the L of each pair never falls (Chen, Zhou & Tomlin, ACC 2014). It is the most
that pursuers can guarantee who each capture one evader. It is not the most that they can capture: a pursuer that has
captured one evader may be in time for another one. Among the maximum matchings the one with the largest sum of L is
taken: a linear assignment. The remaining pursuers join the first pursuer of an evader, one each, so that the sum of
their gains of L is largest.

A pair of pursuers beats an evader of a point only if one of the two does, and more than two never bind. A target with
an extent may need two: both keep the evader from different parts of it. Such pairs are edges too, and the matching is
then the largest set of edges that share no player (`packing`).

PE: as many pursuers as there are evaders are assigned so that the sum of their capture times is least. Each time is a
guarantee. `lower_bound` is the time that the evader has at least against all pursuers.

A matching keeps the promises of the one before it. An evader that was promised keeps its team, unless another pursuer
alone keeps it as far from its target, or captures it as soon. A second pursuer leaves its team only if the value stays.
A promise ends with the capture, or when the team no longer wins (the pursuers did not play their part).

Pursuers that remain go where they come closest to a capture of their own, and guarantee nothing there.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from guidance.game.arrays import NUMPY, Array
from guidance.game.game import Reason, Winner
from guidance.game.records import require
from guidance.game.team.arguments import Games, judged
from guidance.game.team.packing import assigned, packed
from guidance.game.team.several import (
    TeamSolution,
    assembled,
    longest_run,
    nearest_run,
    pairs_of,
    placed,
)
from guidance.game.team.table import (
    Kept,
    Meeting,
    Table,
    are,
    kept_of,
    pairs_with,
    place_of,
    table_of,
    taken,
    together,
)


class Matching(NamedTuple):
    """The answer of `match_teams` for leading axes (...), n pursuers and m evaders.

    A row without an answer is NaN throughout, its evaders UNDECIDED and without pursuers, and its reasons tell why.

    Attributes:
        guaranteed: number of captures that the pursuers can force at once, (...).
        total: TAD: sum of L over the evaders that are matched, m; PE: sum of their times, s; (...).
        first: number of the pursuer that guarantees the capture, (..., m); −1 without one.
        second: number of the pursuer that supports it, (..., m); −1 without one.
        evader_of: number of the evader of each pursuer, (..., n); −1 if no evader is in play.
        beats: whether a pursuer beats an evader alone, (..., n, m).
        alone: the value of each pair by itself as `solve` has it, (..., n, m); NaN for evaders out of play.
        winner: `Winner`, (..., m): 1 where the capture is guaranteed, −1 where it is not, 0 out of play.
        value: TAD: guaranteed distance of the evader from its target, (..., m), m; 0 without a guarantee. PE:
            guaranteed capture time, s; infinite without a guarantee. NaN out of play.
        lower_bound: what the evader's play guarantees to it against its team (TAD, m) or against all (PE, s), (..., m).
        meeting_point_m: end point of each evader, (..., m, 3), m: X*, or its target.
        pursuer_velocity_m_s: (..., n, 3), m/s; zero if no evader is in play.
        evader_velocity_m_s: (..., m, 3), m/s; zero out of play.
        reason: `Reason`, (..., m).
    """

    guaranteed: Array
    total: Array
    first: Array
    second: Array
    evader_of: Array
    beats: Array
    alone: Array
    winner: Array
    value: Array
    lower_bound: Array
    meeting_point_m: Array
    pursuer_velocity_m_s: Array
    evader_velocity_m_s: Array
    reason: Array


def match_teams(
    game: Games,
    pursuers: ArrayLike,
    evaders: ArrayLike,
    target: ArrayLike | None = None,
    *,
    in_play: ArrayLike | None = None,
    previous: Matching | None = None,
    hysteresis: float = 0.0,
    spare_m: ArrayLike = 0.0,
) -> Matching:
    """Match pursuers with evaders: TAD with a target, PE without one.

    Args:
        game: without information age, for evaders in the plane. Its numbers may be arrays that broadcast with the
            pairs, (..., n, m): (n, 1) where pursuers differ, (m,) where evaders do. Or n lists of m games, one for
            each pursuer and evader, and None where a pursuer has no game against an evader: it is not matched with it.
            All these games have the same speed set (Ball, Cylinder …), the same target's velocity and shape, and one
            speed of each evader.
        pursuers: positions, (..., n, 3), NumPy, m.
        evaders: positions, (..., m, 3), m.
        target: position of each evader's target, (..., m, 3), or of the one target of all, (3,), m; None for PE.
        in_play: which evaders are in play, (..., m); all by default.
        previous: the matching so far, whose promises are kept.
        hysteresis: what a new pair must be better by than one of `previous`, m in TAD and s in PE.
        spare_m: TAD: a capture with less distance to spare is not guaranteed; a number or an array for the pairs,
            (..., n, m). A promise of `previous` stays.

    Raises:
        ConfigError: as `solve_team`; `in_play` holds something other than true and false, or `hysteresis` is not a
            finite number, zero or more.
    """
    require("hysteresis", hysteresis, zero_allowed=True)
    with np.errstate(all="ignore"):
        table = table_of(game, pursuers, evaders, target, in_play)
        previous_pairs = (
            None if previous is None else kept_of(table, (previous.first, previous.second))
        )
        if target is not None:
            table = _with_spare(table, np.asarray(spare_m))
        edges = _edges(table, previous_pairs, hysteresis)
        first = assigned(edges, None if previous_pairs is None else previous_pairs.first >= 0)
        if table.target is None:
            answer = _chased(table, first)
        else:
            first, mate = _with_pairs(table, edges, previous_pairs, first)
            pairs = None
            if previous_pairs is not None and np.array_equal(first, previous_pairs.asked):
                pairs = previous_pairs.pairs
            if not pairs:
                pairs = pairs_with(table, first)
            second = _seconds(table, pairs, first, mate, previous_pairs, hysteresis)
            answer = _defended(table, table.target, pairs, first, second)
    worst = table.all.alone.reason.max(axis=(1, 2)).reshape(table.shape)
    shaped = Matching(*(part.reshape((*table.shape, *part.shape[1:])) for part in answer))
    return judged(
        shaped,
        np.where(worst < int(Reason.NOT_FINITE), 0, worst),
        lambda: "pursuers, evaders: have",
    )


def _with_spare(table: Table, spare_m: Array) -> Table:
    """Return the table in which a pursuer beats an evader only with some distance to spare."""
    n = table.worth.shape[-1]
    least = np.broadcast_to(spare_m, (*spare_m.shape[:-2], n, table.worth.shape[1]))
    least_of_teams = np.broadcast_to(least, (*table.shape, *least.shape[-2:])).reshape(
        -1, *least.shape[-2:]
    )
    spare = least_of_teams.swapaxes(1, 2)
    beats = table.beats & ((spare <= 0.0) | (table.worth >= spare))
    return table._replace(beats=beats, spare_m=spare)


def _edges(table: Table, previous_pairs: Kept | None, hysteresis: float) -> Array:
    """Return the profit of each pursuer that may guarantee the capture of an evader, (b, m, n), −∞ where it may not."""
    every = np.arange(table.worth.shape[-1])
    least = np.where(table.beats, table.worth, np.inf).min(axis=(1, 2), keepdims=True)
    profit = table.worth - np.minimum(np.where(np.isfinite(least), least, 0.0), 0.0)
    if previous_pairs is None:
        return np.where(table.beats, profit, -np.inf)
    promised = (previous_pairs.first >= 0)[..., None]
    old = promised & (every == previous_pairs.first[..., None])
    needed = (previous_pairs.second >= 0) & (
        taken(table.worth, previous_pairs.first) < previous_pairs.worth
    )
    partner = needed[..., None] & (every == previous_pairs.second[..., None])
    as_good = ~promised | (table.worth >= previous_pairs.worth[..., None] + hysteresis)
    free = ~partner.any(axis=1)[:, None] | partner
    edges = old | (table.beats & as_good & free)
    profit = np.where(
        old, profit + (previous_pairs.worth[..., None] - table.worth) + hysteresis, profit
    )
    return np.where(edges, np.maximum(profit, 0.0), -np.inf)


def _with_pairs(  # noqa: PLR0914
    table: Table, edges: Array, previous_pairs: Kept | None, first: Array
) -> tuple[Array, Array]:
    """Return firsts and mates, (b, m), where two pursuers may guarantee a capture that neither guarantees alone.

    Only a target with an extent has such pairs. They are looked for where an evader would be left over.

    Args:
        table: everybody against everybody.
        edges: profit of each pursuer alone, (b, m, n).
        previous_pairs: promises.
        first: matched by these edges, (b, m).

    Returns:
        The firsts, and for each the mate without which it guarantees nothing; −1 for none.
    """
    b, m, n = table.worth.shape
    goal = table.all.goal
    if n < 2 or goal is None or goal.is_point:
        return first, np.full_like(first, -1)
    promised = np.zeros((b, m), dtype=bool)
    partners = np.zeros((b, n), dtype=bool)
    if previous_pairs is not None:
        promised = previous_pairs.first >= 0
        partners = are(n, *previous_pairs.second.T)
    paired = np.full_like(first, -1)
    unmatched = ((first < 0) & table.present).any(axis=1)
    if unmatched.any():
        numbers = pairs_of(n)
        worth = together(table.all, (..., numbers)).worth
        alone = (table.beats | partners[:, None])[..., numbers].any(axis=-1)
        plays = (table.present[..., None] & table.plays)[..., numbers].all(axis=-1)
        enough = worth > table.spare_m[..., numbers].max(axis=-1)
        wins = plays & enough & ~alone & ~promised[..., None]
        for row in np.flatnonzero(unmatched & wins.any(axis=(1, 2))):
            profit = np.where(wins[row], worth[row], -np.inf)
            singles, mates = packed(edges[row], profit, numbers, promised[row])
            if np.count_nonzero(singles >= 0) > np.count_nonzero(first[row] >= 0):
                first[row] = singles
                paired[row] = mates
    if previous_pairs is None:
        return first, paired
    together_only = (
        promised & (first == previous_pairs.first) & ~taken(table.beats, previous_pairs.first)
    )
    return first, np.where(together_only, previous_pairs.second, paired)


def _seconds(
    table: Table,
    pairs: Meeting,
    first: Array,
    mate: Array,
    previous_pairs: Kept | None,
    hysteresis: float,
) -> Array:
    """Return the pursuer that supports the first of each evader, (b, m), −1 for none."""
    every = np.arange(table.worth.shape[-1])
    matched = first >= 0
    busy = (every == first[..., None]).any(axis=1) | (every == mate[..., None]).any(axis=1)
    if busy.all() or not matched.any():
        return mate
    gain = pairs.worth - taken(table.worth, first)[..., None]
    useful = (matched & (mate < 0))[..., None] & ~busy[:, None] & (gain > 0)
    if previous_pairs is None:
        return np.where(mate < 0, assigned(np.where(useful, gain, -np.inf)), mate)
    old = every == previous_pairs.second[..., None]
    promised = (first == previous_pairs.first) & (useful & old).any(axis=-1)
    as_good = gain >= taken(gain, previous_pairs.second)[..., None] + hysteresis
    useful &= old | as_good | ~promised[..., None]
    profit = np.where(useful, gain + np.where(old, hysteresis, 0.0), -np.inf)
    return np.where(mate < 0, assigned(profit, promised), mate)


def _chased(table: Table, first: Array) -> Matching:
    """Put the answer in PE together, (b, ...)."""
    run = longest_run(table.all)
    play = assembled(table.all, table.evaders, run, run, np.zeros(1, dtype=bool))
    value = np.where(first < 0, np.inf, -taken(table.worth, first))
    return _answer(table, first, np.full_like(first, -1), play._replace(value=value))


def _defended(table: Table, target: Array, pairs: Meeting, first: Array, second: Array) -> Matching:
    """Put the answer in TAD together, (b, ...)."""
    team = table.all
    alone = table.all.alone
    guarded = first >= 0
    beside = np.where(second < 0, first, second)
    at = place_of(beside)
    two = place_of(np.stack([first, beside], axis=-1), 2)
    best = placed(team, table.evaders, Meeting(*(part[at] for part in pairs)))
    run = nearest_run(team, table.evaders, best, guarded, two)
    play = assembled(team, table.evaders, run, best, are(table.worth.shape[-1], first, second))
    play = play._replace(
        value=np.where(guarded, play.value, 0.0),
        lower_bound=np.where(guarded, play.lower_bound, 0.0),
        meeting_point_m=np.where(guarded[..., None], play.meeting_point_m, target),
        evader_velocity_m_s=np.where(
            guarded[..., None], play.evader_velocity_m_s, _to_target(table, target)
        ),
        reason=np.where(guarded, play.reason, taken(alone.reason, alone.margin_s.argmax(axis=-1))),
    )
    return _answer(table, first, second, play)


def _answer(table: Table, first: Array, second: Array, play: TeamSolution) -> Matching:
    """Put the answer together, (b, ...), from each evader's game."""
    alone = table.all.alone
    present = table.present
    guarded = first >= 0
    zero_if_present = np.where(present, 0.0, np.nan)
    evader_of = _evader_of(table, first, second)
    velocity_m_s = taken(play.pursuer_velocity_m_s.swapaxes(1, 2), evader_of)
    lost = 0 if table.target is None else int(Winner.EVADER)
    return Matching(
        guaranteed=guarded.sum(axis=-1),
        # Added from the least to the largest: the same bits in any order and in any batch.
        total=np.asarray(sum(np.sort(np.where(guarded, play.value, 0.0), axis=-1).T)),
        first=first,
        second=second,
        evader_of=evader_of,
        beats=table.beats.swapaxes(1, 2),
        alone=(alone.value + zero_if_present[..., None]).swapaxes(1, 2),
        winner=np.where(guarded, int(Winner.PURSUER), np.where(present, lost, 0)).astype(np.int8),
        value=play.value + zero_if_present,
        lower_bound=play.lower_bound + zero_if_present,
        meeting_point_m=play.meeting_point_m + zero_if_present[..., None],
        pursuer_velocity_m_s=np.where((evader_of < 0)[..., None], 0.0 * velocity_m_s, velocity_m_s),
        evader_velocity_m_s=np.where(present[..., None], play.evader_velocity_m_s, 0.0),
        reason=play.reason,
    )


def _evader_of(table: Table, first: Array, second: Array) -> Array:
    """Return the evader of each pursuer: its own, or else the one that it is closest to capturing."""
    member = are(table.worth.shape[-1], first, second)
    unmatched = table.present & (first < 0)
    pool = np.where(unmatched.any(axis=1, keepdims=True), unmatched, table.present)[..., None]
    score = table.worth if table.target is None else table.all.alone.margin_s
    closest = np.argmax(np.where(pool & table.plays, score, -np.inf), axis=1)
    evader_of_pursuer = np.where(member.any(axis=1), np.argmax(member, axis=1), closest)
    return np.where((table.present[..., None] & table.plays).any(axis=1), evader_of_pursuer, -1)


def _to_target(table: Table, target: Array) -> Array:
    """Return the velocities of evaders that run straight to their targets, (b, m, 3), m/s."""
    to = target - table.evaders
    to[..., 2] = 0.0
    far = NUMPY.norm2((to[..., 0], to[..., 1]))
    return np.asarray(np.where(far > 0, table.all.v / far, 0.0 * far)[..., None] * to)
