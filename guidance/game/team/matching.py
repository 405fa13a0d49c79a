"""Many pursuers against many evaders: who plays against whom, and how many captures are guaranteed.

TAD: an edge is a pursuer that beats an evader alone. A maximum matching, of size m, guarantees m captures at once, and
they stay guaranteed in play, because the L of each pair never falls (Chen, Zhou & Tomlin, ACC 2014). It is the most
that pursuers can guarantee who each capture one evader. It is not the most that they can capture: a pursuer that has
captured one evader may be in time for another one. Where that is proven (`in_turn`), `then` says so. Among the maximum
matchings the one with the largest sum of L is taken: a linear assignment. Of equal sums the one with the shortest level
ways is taken, whose ways do not cross. The remaining pursuers join the first pursuer of an evader, one each, so that
the sum of their gains of L is largest.

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

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from guidance.game.arrays import NUMPY, Array
from guidance.game.game import Reason, Winner
from guidance.game.records import require
from guidance.game.rows import for_rows
from guidance.game.team.arguments import TeamGames, judged
from guidance.game.team.in_turn import can_be_in_turn, way_by_a_capture
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

WORTH_OF_METRE: Final = 1e-9
"""Worth, m in TAD and s in PE, of a metre of level way: less than any difference that counts."""

IN_TURN: Final = 40.0
"""Spare way of a second capture in turn, over `spare_m`: velocities are held, and seen a step late."""


class Matching(NamedTuple):
    """The answer of `match_teams` for leading axes (...), n pursuers and m evaders.

    A row without an answer is NaN throughout, its evaders UNDECIDED and without pursuers, and its reasons tell why.

    Attributes:
        guaranteed: number of captures that the pursuers can force at once, (...).
        total: TAD: sum of L over the evaders that are matched, m; PE: sum of their times, s; (...).
        first: number of the pursuer that guarantees the capture, (..., m); −1 without one.
        second: number of the pursuer that supports it, (..., m); −1 without one.
        then: number of the evader that a pursuer surely captures after its own, if it gives up its distance for that,
            (..., n); −1 for none. The play "captures" of `rollout_teams` does.
        captures: number of captures that the pursuers can force one after the other, (...): `guaranteed` and `then`.
        evader_of: number of the evader of each pursuer, (..., n); −1 if no evader is in play.
        beats: whether a pursuer beats an evader alone, (..., n, m).
        alone: the value of each pair by itself as `solve` has it, (..., n, m); NaN for evaders out of play.
        winner: `Winner`, (..., m): 1 where the capture is guaranteed, −1 where it is not, 0 out of play.
        value: TAD: guaranteed distance of the evader from its target, (..., m), m; 0 without a guarantee. PE:
            guaranteed capture time, s; infinite without a guarantee. NaN out of play.
        lower_bound: guarantee of the evader's play against its team (TAD, m) or against all (PE, s), (..., m).
        meeting_point_m: end point of each evader, (..., m, 3), m: X*, or its target.
        pursuer_velocity_m_s: (..., n, 3), m/s; zero if no evader is in play.
        evader_velocity_m_s: (..., m, 3), m/s; zero out of play.
        reason: `Reason`, (..., m).
    """

    guaranteed: Array
    total: Array
    first: Array
    second: Array
    then: Array
    captures: Array
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
    game: TeamGames,
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
        hysteresis: least gain of a new pair over one of `previous`, m in TAD and s in PE. Matchings that
            differ by less may count as equal.
        spare_m: TAD: a capture with less distance to spare is not guaranteed; a number or an array for the pairs,
            (..., n, m). A promise of `previous` stays.

    Raises:
        ConfigError: as `solve_team`; `in_play` holds something other than true and false, or `hysteresis` is not a
            finite number, zero or more.
    """
    require("hysteresis", hysteresis, zero_allowed=True)
    with np.errstate(all="ignore"):
        table = table_of(game, pursuers, evaders, target, in_play)
        previous_pairs = None
        promised = None
        if previous is not None:
            previous_pairs = kept_of(table, (_with_then(table, previous), previous.second))
            promised = previous_pairs.first >= 0
        if target is not None:
            table = _with_spare(table, np.asarray(spare_m))
        edges = _with_short_ways(table, _profits(table, previous_pairs, hysteresis), hysteresis)
        first = assigned(edges, promised)
        if table.target is None:
            run = longest_run(table.all)
            nobody = np.zeros(1, dtype=bool)
            play = assembled(table.all, table.evaders, run, run, nobody)
            time_s = np.where(first < 0, np.inf, -taken(table.worth, first))
            no_second = np.full_like(first, -1)
            answer = _answer(table, first, no_second, play._replace(value=time_s))
        else:
            first, mate = _with_pairs(table, edges, previous_pairs, first)
            # The joint guarantee of each first and every other pursuer is known if these are the promised firsts.
            pairs = None
            if previous_pairs is not None and np.array_equal(first, previous_pairs.asked):
                pairs = previous_pairs.pairs
            if pairs is None:
                pairs = pairs_with(table, first)
            second = _seconds(table, pairs, first, mate, previous_pairs, hysteresis)
            answer = _target_answer(table, table.target, pairs, first, second)
            then = _in_turn(table, table.target, previous, first, answer.then)
            answer = answer._replace(
                then=then, captures=answer.guaranteed + np.count_nonzero(then >= 0, axis=-1)
            )
    parts = [part.reshape((*table.shape, *part.shape[1:])) for part in answer]
    worst = table.all.alone.reason.max(axis=(1, 2))
    fault = np.where(worst < int(Reason.NOT_FINITE), 0, worst)
    words = "pursuers, evaders: have"
    return judged(Matching(*parts), fault.reshape(table.shape), lambda: words)


def _with_then(table: Table, previous: Matching) -> Array:
    """Return the firsts of an earlier matching; a pursuer whose own evader is out of play has the one after it."""
    b, m, n = table.worth.shape
    first = np.broadcast_to(previous.first, (*table.shape, m)).reshape(b, m)
    if not previous.then.size or not (previous.then >= 0).any():
        return first.reshape((*table.shape, m))
    then = np.broadcast_to(previous.then, (*table.shape, n)).reshape(b, n)
    engaged = ((first[..., None] == np.arange(n)) & table.present[..., None]).any(axis=1)
    rows, pursuers = np.nonzero((then >= 0) & ~engaged)
    first = first.copy()
    evaders = then[rows, pursuers]
    vacant = first[rows, evaders] < 0
    first[rows[vacant], evaders[vacant]] = pursuers[vacant]
    return first.reshape((*table.shape, m))


def _in_turn(
    table: Table, target: Array, previous: Matching | None, first: Array, nobody: Array
) -> Array:
    """Return the evader that each pursuer surely captures after its own, (b, n), −1 for none: see `in_turn`.

    Args:
        table: everybody against everybody.
        target: of each evader, (b, m, 3), m.
        previous: whose sequences are kept while they hold.
        first: the pursuer of each evader, (b, m).
        nobody: −1 for each pursuer, (b, n).
    """
    b, m, n = table.worth.shape
    left = table.present & (first < 0)
    if not can_be_in_turn(table.all.game) or not left.any() or not (first >= 0).any():
        return nobody
    holds = (first[..., None] == np.arange(n)).swapaxes(1, 2)
    own = np.argmax(holds, axis=-1)
    engaged = holds.any(axis=-1)
    possible = engaged[..., None] & left[:, None] & table.plays.swapaxes(1, 2)
    profit = _spare_in_turn(table, own, target, possible)
    if not np.isfinite(profit).any():
        return nobody
    if previous is not None and previous.then.size:
        then = np.broadcast_to(previous.then, (*table.shape, n)).reshape(b, n)
        kept = (then[..., None] == np.arange(m)) & (profit > -np.inf)
        profit = np.where(kept, profit + 1e6, profit)
    chosen = assigned(profit.swapaxes(1, 2))
    takes = (chosen[..., None] == np.arange(n)).swapaxes(1, 2)
    return np.where(takes.any(axis=-1), np.argmax(takes, axis=-1), -1)


def _spare_in_turn(table: Table, own: Array, target: Array, possible: Array) -> Array:
    """Return how much nearer to the others' targets pursuers surely are after capturing their own evaders, m.

    Args:
        table: everybody against everybody.
        own: the evader of each pursuer, (b, n).
        target: of each evader, (b, m, 3), m.
        possible: which pursuers may take which evaders then, (b, n, m).

    Returns:
        (b, n, m): the way that the pursuer has left when the evader could be at its target (`in_turn`); −∞ for none.
    """
    games = for_rows(table.all.game, lambda value: value.swapaxes(1, 2))
    to = (target - table.evaders)[:, None]
    run_m = np.sqrt(to[..., 0] ** 2 + to[..., 1] ** 2)
    ratio = games.pursuer.horizontal_m_s / games.evader_speed_m_s
    reach_m = ratio * run_m + games.capture_radius_m - IN_TURN * table.spare_m.swapaxes(1, 2)
    # By the first evader's place the way is not longer than by the worst place of its capture
    P = table.pursuers[:, :, None]
    first_m = table.evaders[place_of(own, 1)][:, :, None]
    by_place_m = np.sqrt(np.sum((P - first_m) ** 2, axis=-1))
    by_place_m = by_place_m + np.sqrt(np.sum((first_m - target[:, None]) ** 2, axis=-1))
    closer_m = 2.0 * (np.asarray(games.capture_radius_m) + games.standoff.height_m)
    row, pursuer, evader = np.nonzero(possible & (by_place_m - closer_m < reach_m))
    mine = own[row, pursuer]
    way_m = way_by_a_capture(
        for_rows(table.all.game, lambda value: value[row, mine, pursuer]),
        table.pursuers[row, pursuer],
        table.evaders[row, mine],
        target[row, mine],
        target[row, evader],
    )
    spare_m = np.full(possible.shape, -np.inf)
    left_m = np.broadcast_to(reach_m, possible.shape)[row, pursuer, evader] - way_m
    spare_m[row, pursuer, evader] = np.where(left_m > 0.0, left_m, -np.inf)
    return spare_m


def _with_spare(table: Table, spare_m: Array) -> Table:
    """Return the table in which a pursuer beats an evader only with some distance to spare."""
    _, m, n = table.worth.shape
    least = np.broadcast_to(spare_m, (*spare_m.shape[:-2], n, m))
    least_of_teams = np.broadcast_to(least, (*table.shape, n, m))
    spare = least_of_teams.reshape(-1, n, m).swapaxes(1, 2)
    enough = (spare <= 0.0) | (table.worth >= spare)
    return table._replace(beats=table.beats & enough, spare_m=spare)


def _profits(table: Table, previous_pairs: Kept | None, hysteresis: float) -> Array:
    """Return the profit of each pursuer that may guarantee the capture of an evader, (b, m, n), −∞ where it may not."""
    every = np.arange(table.worth.shape[-1])
    # The worth of each pair, less the least of a pair that wins if that is negative.
    worth_of_winners = np.where(table.beats, table.worth, np.inf)
    least = worth_of_winners.min(axis=(1, 2), keepdims=True)
    least_negative = np.minimum(np.where(np.isfinite(least), least, 0.0), 0.0)
    profit = np.asarray(table.worth - least_negative)
    if previous_pairs is None:
        return np.where(table.beats, profit, -np.inf)
    first = previous_pairs.first
    second = previous_pairs.second
    promised_worth = previous_pairs.worth[..., None]
    promised = (first >= 0)[..., None]
    old = promised & (every == first[..., None])
    needs_second = (second >= 0) & (taken(table.worth, first) < previous_pairs.worth)
    partner = needs_second[..., None] & (every == second[..., None])
    as_good = ~promised | (table.worth >= promised_worth + hysteresis)
    free = ~partner.any(axis=1)[:, None] | partner
    edges = old | (table.beats & as_good & free)
    old_profit = profit + (promised_worth - table.worth) + hysteresis
    profit = np.where(old, old_profit, profit)
    return np.where(edges, np.maximum(profit, 0.0), -np.inf)


def _with_short_ways(table: Table, profit: Array, hysteresis: float) -> Array:
    """Return profits that also decide between matchings of equal worth: for the shorter ways, which do not cross.

    Of two pairs whose straight ways cross, the other two pairs of the same players have the shorter ways together.

    Args:
        table: everybody against everybody.
        profit: of each pair, (b, m, n), −∞ where there is none.
        hysteresis: worths this far apart may be equal; a hundredth of it counts for each metre.
    """
    ends = table.all.alone.meeting_point_m
    to = ends - table.pursuers[:, None]
    way_m = np.sqrt(to[..., 0] ** 2 + to[..., 1] ** 2)
    counts = (profit > -np.inf) & np.isfinite(way_m)
    longest_m = np.max(np.where(counts, way_m, 0.0), axis=(1, 2), keepdims=True)
    worth_of_metre = WORTH_OF_METRE + 0.01 * hysteresis
    return np.where(counts, profit + worth_of_metre * (longest_m - way_m), profit)


def _with_pairs(
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
    mates = np.full_like(first, -1)
    if n < 2 or goal is None or goal.is_point:
        return first, mates
    promised = np.zeros((b, m), dtype=bool)
    partners = np.zeros((b, n), dtype=bool)
    if previous_pairs is not None:
        promised = previous_pairs.first >= 0
        partners = are(n, *previous_pairs.second.T)
    unmatched = ((first < 0) & table.present).any(axis=1)
    if unmatched.any():
        profit = _profit_of_pairs(table, promised, partners)
        has_pair = (profit > -np.inf).any(axis=(1, 2))
        for row in np.flatnonzero(unmatched & has_pair):
            row_firsts, row_mates = packed(edges[row], profit[row], pairs_of(n), promised[row])
            matched = np.count_nonzero(first[row] >= 0)
            if np.count_nonzero(row_firsts >= 0) > matched:
                first[row] = row_firsts
                mates[row] = row_mates
    if previous_pairs is None:
        return first, mates
    is_kept = promised & (first == previous_pairs.first)
    together_only = is_kept & ~taken(table.beats, previous_pairs.first)
    return first, np.where(together_only, previous_pairs.second, mates)


def _profit_of_pairs(table: Table, promised: Array, partners: Array) -> Array:
    """Return the worth of each pair that wins together and not alone, (b, m, k); −∞ for every other pair.

    Args:
        table: everybody against everybody.
        promised: evaders that have a first already, (b, m).
        partners: pursuers that are a second already, (b, n).
    """
    numbers = pairs_of(table.worth.shape[-1])
    worth = together(table.all, (..., numbers)).worth
    engaged = table.beats | partners[:, None]
    playing = table.present[..., None] & table.plays
    plays = playing[..., numbers].all(axis=-1)
    alone = engaged[..., numbers].any(axis=-1)
    enough = worth > table.spare_m[..., numbers].max(axis=-1)
    wins = plays & enough & ~alone & ~promised[..., None]
    return np.asarray(np.where(wins, worth, -np.inf))


def _seconds(
    table: Table,
    pairs: Meeting,
    first: Array,
    mate: Array,
    previous_pairs: Kept | None,
    hysteresis: float,
) -> Array:
    """Return the pursuer that supports the first of each evader, (b, m), −1 for none."""
    count = table.worth.shape[-1]
    matched = first >= 0
    busy = _are_chosen(count, first) | _are_chosen(count, mate)
    if busy.all() or not matched.any():
        return mate
    without_mate = mate < 0
    worth_alone = taken(table.worth, first)
    gain = pairs.worth - worth_alone[..., None]
    may_help = (matched & without_mate)[..., None] & ~busy[:, None]
    useful = may_help & (gain > 0)
    if previous_pairs is None:
        profit = np.where(useful, gain, -np.inf)
        return np.where(without_mate, assigned(profit), mate)
    old = np.arange(count) == previous_pairs.second[..., None]
    keeps_first = first == previous_pairs.first
    promised = keeps_first & (useful & old).any(axis=-1)
    old_gain = taken(gain, previous_pairs.second)
    as_good = gain >= old_gain[..., None] + hysteresis
    useful &= old | as_good | ~promised[..., None]
    kept_bonus = np.where(old, hysteresis, 0.0)
    profit = np.where(useful, gain + kept_bonus, -np.inf)
    return np.where(without_mate, assigned(profit, promised), mate)


def _are_chosen(count: int, chosen: Array) -> Array:
    """Return which of some pursuers are chosen for an evader, (b, n), from their numbers (b, m)."""
    numbers = np.arange(count)
    return np.asarray((numbers == chosen[..., None]).any(axis=1))


def _target_answer(
    table: Table, target: Array, pairs: Meeting, first: Array, second: Array
) -> Matching:
    """Put the answer in TAD together, (b, ...)."""
    alone = table.all.alone
    guarded = first >= 0
    beside = np.where(second < 0, first, second)
    meetings = [part[place_of(beside)] for part in pairs]
    best = placed(table.all, table.evaders, Meeting(*meetings))
    two = place_of(np.stack([first, beside], axis=-1), 2)
    run = nearest_run(table.all, table.evaders, best, guarded, two)
    flies = are(table.worth.shape[-1], first, second)
    play = assembled(table.all, table.evaders, run, best, flies)
    is_guarded = guarded[..., None]
    to = target - table.evaders
    to[..., 2] = 0.0
    far = NUMPY.norm2((to[..., 0], to[..., 1]))
    rate_per_s = np.where(far > 0, table.all.v / far, 0.0 * far)
    straight_m_s = np.asarray(rate_per_s[..., None] * to)
    nearest_reason = taken(alone.reason, alone.margin_s.argmax(axis=-1))
    play = play._replace(
        value=np.where(guarded, play.value, 0.0),
        lower_bound=np.where(guarded, play.lower_bound, 0.0),
        meeting_point_m=np.where(is_guarded, play.meeting_point_m, target),
        evader_velocity_m_s=np.where(is_guarded, play.evader_velocity_m_s, straight_m_s),
        reason=np.where(guarded, play.reason, nearest_reason),
    )
    return _answer(table, first, second, play)


def _answer(table: Table, first: Array, second: Array, play: TeamSolution) -> Matching:
    """Put the answer together, (b, ...), from each evader's game."""
    present = table.present
    guarded = first >= 0
    zero_if_present = np.where(present, 0.0, np.nan)
    plain_zero = zero_if_present[..., None]
    alone = table.all.alone.value + plain_zero
    # Added from the least to the largest: the same bits in any order and in any batch.
    rising = np.sort(np.where(guarded, play.value, 0.0), axis=-1)
    evader_of = _evader_of(table, first, second)
    velocities_m_s = taken(play.pursuer_velocity_m_s.swapaxes(1, 2), evader_of)
    is_idle = (evader_of < 0)[..., None]
    lost = 0 if table.target is None else int(Winner.EVADER)
    unguarded = np.where(present, lost, 0)
    winner = np.where(guarded, int(Winner.PURSUER), unguarded)
    return Matching(
        guaranteed=guarded.sum(axis=-1),
        total=np.asarray(sum(rising.T)),
        first=first,
        second=second,
        then=np.full_like(evader_of, -1),
        captures=guarded.sum(axis=-1),
        evader_of=evader_of,
        beats=table.beats.swapaxes(1, 2),
        alone=alone.swapaxes(1, 2),
        winner=winner.astype(np.int8),
        value=play.value + zero_if_present,
        lower_bound=play.lower_bound + zero_if_present,
        meeting_point_m=play.meeting_point_m + plain_zero,
        pursuer_velocity_m_s=np.where(is_idle, 0.0 * velocities_m_s, velocities_m_s),
        evader_velocity_m_s=np.where(present[..., None], play.evader_velocity_m_s, 0.0),
        reason=play.reason,
    )


def _evader_of(table: Table, first: Array, second: Array) -> Array:
    """Return the evader of each pursuer: its own, or else the one that it is closest to capturing."""
    member = are(table.worth.shape[-1], first, second)
    unmatched = table.present & (first < 0)
    any_unmatched = unmatched.any(axis=1, keepdims=True)
    pool = np.where(any_unmatched, unmatched, table.present)
    candidates = pool[..., None] & table.plays
    score = table.worth if table.target is None else table.all.alone.margin_s
    closest = np.argmax(np.where(candidates, score, -np.inf), axis=1)
    assigned_evader = np.argmax(member, axis=1)
    evader_of_pursuer = np.where(member.any(axis=1), assigned_evader, closest)
    playing = table.present[..., None] & table.plays
    return np.where(playing.any(axis=1), evader_of_pursuer, -1)
