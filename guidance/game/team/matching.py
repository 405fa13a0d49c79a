"""Many pursuers against many evaders: who plays against whom, and how many captures are guaranteed.

TAD: an edge is a pursuer that beats an evader alone. A pair of pursuers beats an evader only if one of the two does, as
the target is out of the intersection of two discs only where it is out of one; and more than two never bind. So a
maximum matching of single pursuers, of size m, is the most that can be guaranteed by teams for an evader each. It
guarantees m captures, because the L of each of its pairs never falls, and matching again never lowers m (Chen, Zhou &
Tomlin, ACC 2014). Among the maximum matchings the one with the largest sum of L is taken: a linear assignment. Pursuers
that are left then join the first of an evader, one each, so that the sum of what they add to L is largest. That keeps
the guarantees, since the L of a pair never falls either.

PE: as many pursuers as there are evaders are assigned so that the sum of their capture times is least. Each time is a
guarantee and an upper bound of the game's value; `lower_bound` is what the evader surely has against all of them.

Pursuers that are left still go where they come closest to a capture of their own, and guarantee nothing there.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from guidance.errors import ConfigError
from guidance.game import Game, Reason, Solution, Winner, solve
from guidance.game.team.assignment import assigned_rows
from guidance.game.team.discs import Array
from guidance.game.team.several import TeamSolution, fitting, solve_team, speeds, spoiled, vectors, with_speeds


class Matching(NamedTuple):
    """The answer of `match_teams` for leading axes (...), n pursuers and m evaders.

    A row without an answer is NaN throughout, its evaders UNDECIDED and without pursuers, and its reasons tell why.

    Attributes:
        guaranteed: number of captures that the pursuers can force at once, (...).
        total: TAD: sum of L over the evaders that are matched, m; PE: sum of their times, s; (...).
        first: number of the pursuer that guarantees the capture, (..., m); −1 where nobody does.
        second: number of the pursuer beside it, (..., m); −1 where there is none.
        evader_of: number of the evader that each pursuer plays against, (..., n); −1 where none is left.
        beats: whether a pursuer beats an evader alone, (..., n, m).
        alone: the value of each pair by itself as `solve` has it, (..., n, m); NaN for evaders out of play.
        winner: `Winner`, (..., m): 1 where the capture is guaranteed, −1 where it is not, 0 out of play.
        value: TAD: distance from its target that an evader is kept at, (..., m), m; 0 where nobody keeps it. PE: time
            in which it is captured at the latest, s; infinite where nobody is assigned. NaN out of play.
        lower_bound: TAD: the value again. PE: the time that the evader surely has, (..., m), s.
        meeting_point_m: where each evader ends, (..., m, 3), m: X*, or its target.
        pursuer_velocity_m_s: (..., n, 3), m/s; zero where no evader is left.
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
    game: Game,
    pursuers: ArrayLike,
    evaders: ArrayLike,
    target: ArrayLike | None = None,
    *,
    in_play: ArrayLike | None = None,
    previous: Matching | None = None,
    hysteresis: float = 0.0,
) -> Matching:
    """Match pursuers with evaders: TAD with a target, PE without one.

    Args:
        game: as `solve_team`. Speeds may be arrays that broadcast with the pairs, (..., n, m): (n, 1) where pursuers
            differ, (m,) where evaders do.
        pursuers: positions, (..., n, 3), NumPy, m.
        evaders: positions, (..., m, 3), m.
        target: position of each evader's target, (..., m, 3), or of the one target of all, (3,), m; None for PE.
        in_play: which evaders are still to be captured, (..., m); all of them by default.
        previous: the matching so far.
        hysteresis: what a new pair must be better by, m in TAD and s in PE, than one that is kept from `previous`.
            Guarantees do not need it; without it, pursuers between two matchings of the same sum dither.

    Raises:
        ConfigError: as `solve_team`.
    """
    if not (np.isfinite(hysteresis) and hysteresis >= 0):
        raise ConfigError(f"hysteresis = {hysteresis!r}: must be a finite number, zero or more")
    table = _table(game, pursuers, evaders, target, in_play)
    alone = table.alone
    with np.errstate(all="ignore"):
        latest = np.max(alone.value, axis=(-2, -1), keepdims=True)
        profit = latest - alone.value if target is None else alone.value
        beats = (alone.winner > 0) & table.present[..., None, :]
        first = _assigned(np.where(beats, profit, -np.inf), None if previous is None else previous.first, hysteresis)
        if target is None:
            second, played = np.full_like(first, -1), _all_against_each(table)
        else:
            second = _seconds(table, first, None if previous is None else previous.second, hysteresis)
            played = _teams(table, np.stack([first, np.where(second < 0, first, second)], axis=-1))
        return _judged(_assembled(table, beats, first, second, played), table)


def each_speed(game: Game) -> tuple[Any, Any]:
    """Return the speeds of the pursuers, (..., n), and of the evaders, (..., m), or one number for all.

    Raises:
        ConfigError: Teams do not play such a game, or speeds differ by pair.
    """
    u, v = speeds(game)
    if np.ndim(u) and (np.ndim(u) < 2 or u.shape[-1] != 1):
        raise ConfigError(f"speed_m_s = {u!r}: must be one number, or an array (..., n, 1), for n pursuers")
    if np.ndim(v) > 1 and v.shape[-2] != 1:
        raise ConfigError(
            f"evader_speed_m_s = {v!r}: must be one number, or an array (m,) or (..., 1, m), for m evaders"
        )
    return u[..., 0] if np.ndim(u) else u, v[..., 0, :] if np.ndim(v) > 1 else v


class _Table(NamedTuple):
    """Everybody against everybody: positions (..., n, 3) and (..., m, 3), speeds, and each pair solved by itself."""

    game: Game
    u: Array
    v: Array
    pursuers: Array
    evaders: Array
    target: Array | None
    present: Array
    alone: Solution


def _table(
    game: Game, pursuers: ArrayLike, evaders: ArrayLike, target: ArrayLike | None, in_play: ArrayLike | None
) -> _Table:
    """Bring the arguments to one shape, and solve each pair."""
    u, v = each_speed(game)
    P, E = vectors("pursuers", pursuers, "(..., n, 3)"), vectors("evaders", evaders, "(..., m, 3)")
    T = None if target is None else vectors("target", target, "(..., 3)")
    present = np.ones(E.shape[-2], dtype=bool) if in_play is None else np.asarray(in_play, dtype=bool)
    if present.shape[-1:] != E.shape[-2:-1]:
        raise ConfigError(f"in_play = {in_play!r}: must say for each of {E.shape[-2]} evaders whether it is in play")
    evader_axes = {"evaders": E.shape[:-1], "in_play": present.shape, "evader_speed_m_s": np.shape(v)}
    whole = fitting(evader_axes | ({} if T is None else {"target": T.shape[:-1]}))
    shape = fitting({"pursuers": P.shape[:-2], "speed_m_s": np.shape(u)[:-1], "evaders and what they have": whole[:-1]})
    n, m = P.shape[-2], E.shape[-2]
    P, E = np.broadcast_to(P, (*shape, n, 3)), np.broadcast_to(E, (*shape, m, 3))
    T = None if T is None else np.broadcast_to(T, (*shape, m, 3))
    alone = solve(game, P[..., :, None, :], E[..., None, :, :], None if T is None else T[..., None, :, :])
    return _Table(game, u, v, P, E, T, np.broadcast_to(present, (*shape, m)), alone)


def _assigned(profit: Array, kept: Array | None, hysteresis: float) -> Array:
    """Return the pursuer of each evader, (..., m), −1 for none: as many as can be, and of those the largest profit.

    Args:
        profit: of each pair, (..., n, m), zero or more; −∞ where there is none.
        kept: who had been assigned before, (..., m).
        hysteresis: what it is worth to keep a pair.
    """
    n, m = profit.shape[-2:]
    if kept is not None:
        same = np.arange(n)[:, None] == kept[..., None, :]
        profit = np.where(same, profit + hysteresis, profit)
    edges = np.isfinite(profit)
    # One pair more is worth more than any profit; a share of it for the evaders and pursuers is never used up.
    one = 1.0 + min(n, m) * np.max(np.where(edges, profit, 0.0), axis=(-2, -1), keepdims=True)
    worth = np.where(edges, one + profit, 0.0)
    found = assigned_rows(worth)
    return np.where((found >= 0) & _of_pair(edges, found), found, -1)


def _seconds(table: _Table, first: Array, kept: Array | None, hysteresis: float) -> Array:
    """Return who joins the first of each evader, (..., m), −1 for nobody."""
    n = table.pursuers.shape[-2]
    matched = first >= 0
    busy = (np.arange(n)[:, None] == first[..., None, :]).any(axis=-1)
    if busy.all() or not matched.any():
        return np.full_like(first, -1)
    beside = np.broadcast_arrays(first[..., None, :], np.arange(n)[:, None])
    pairs = _teams(table, np.stack(beside, axis=-1))
    gain = pairs.value - _of_pair(table.alone.value, first)[..., None, :]
    useful = matched[..., None, :] & ~busy[..., None] & (gain > 0)
    return _assigned(np.where(useful, gain, -np.inf), kept, hysteresis)


def _teams(table: _Table, who: Array) -> TeamSolution:
    """Solve a team of pursuers `who` against each evader, (..., m, k), or several beside each other, (..., n, m, k)."""
    beside = who.ndim - table.evaders.ndim
    axes = (..., *[None] * beside, slice(None))
    lead = table.pursuers.shape[:-2]
    flat = np.maximum(who, 0).reshape(*lead, math.prod(who.shape[len(lead) :]))
    P = np.take_along_axis(table.pursuers, flat[..., None], axis=-2).reshape(*who.shape, 3)
    u, v = table.u, table.v
    if np.ndim(u):
        u = np.take_along_axis(np.broadcast_to(u, table.pursuers.shape[:-1]), flat, axis=-1).reshape(who.shape)
    if np.ndim(v):
        v = np.broadcast_to(v, table.present.shape)[axes][..., None]
    T = table.target
    E, T = table.evaders[(*axes, slice(None))], None if T is None else T[(*axes, slice(None))]
    return solve_team(with_speeds(table.game, u, v), P, E, T)


def _all_against_each(table: _Table) -> TeamSolution:
    """Solve the game of all pursuers against each evader."""
    u = table.u[..., None, :] if np.ndim(table.u) else table.u
    v = table.v[..., None] if np.ndim(table.v) else table.v
    return solve_team(with_speeds(table.game, u, v), table.pursuers[..., None, :, :], table.evaders, table.target)


def _assembled(table: _Table, beats: Array, first: Array, second: Array, played: TeamSolution) -> Matching:
    """Put the answer together."""
    alone, present, guarded = table.alone, table.present, first >= 0
    there = np.where(present, 0.0, np.nan)
    if table.target is None:
        value = np.where(guarded, _of_pair(alone.value, first), np.inf)
        lower, meeting, run, lost = played.lower_bound, played.meeting_point_m, played.evader_velocity_m_s, 0
        reason = played.reason
    else:
        value = lower = np.where(guarded, played.value, 0.0)
        meeting = np.where(guarded[..., None], played.meeting_point_m, table.target)
        run = np.where(guarded[..., None], played.evader_velocity_m_s, _straight(table, table.target))
        nearest = np.argmax(alone.margin_s, axis=-2)
        lost, reason = int(Winner.EVADER), np.where(guarded, played.reason, _of_pair(alone.reason, nearest))
    evader_of = _evader_of(table, first, second)
    return Matching(
        guaranteed=np.count_nonzero(guarded, axis=-1),
        total=_summed(np.where(guarded, value, 0.0)),
        first=first,
        second=second,
        evader_of=evader_of,
        beats=beats,
        alone=alone.value + there[..., None, :],
        winner=np.where(guarded, int(Winner.PURSUER), np.where(present, lost, 0)).astype(np.int8),
        value=value + there,
        lower_bound=lower + there,
        meeting_point_m=meeting + there[..., None],
        pursuer_velocity_m_s=_flown(table, first, second, evader_of, played),
        evader_velocity_m_s=np.where(present[..., None], run, 0.0 * run),
        reason=reason,
    )


def _evader_of(table: _Table, first: Array, second: Array) -> Array:
    """Return whom each pursuer plays against: its own evader, or else the one it is closest to capturing."""
    n = np.arange(table.pursuers.shape[-2])[:, None]
    mine = (n == first[..., None, :]) | (n == second[..., None, :])
    left = table.present & (first < 0)
    pool = np.where(left.any(axis=-1, keepdims=True), left, table.present)[..., None, :]
    score = -table.alone.value if table.target is None else table.alone.margin_s
    closest = np.argmax(np.where(pool, score, -np.inf), axis=-1)
    own = np.where(mine.any(axis=-1), np.argmax(mine, axis=-1), closest)
    return np.where(table.present.any(axis=-1, keepdims=True), own, -1)


def _flown(table: _Table, first: Array, second: Array, evader_of: Array, played: TeamSolution) -> Array:
    """Return the pursuers' velocities: in TAD those of a pair together, else each its own game's."""
    place = np.maximum(evader_of, 0)
    own = np.take_along_axis(table.alone.pursuer_velocity_m_s, place[..., None, None], axis=-2)[..., 0, :]
    flown = np.where((evader_of < 0)[..., None], 0.0 * own, own)
    if table.target is None:
        return flown
    n = np.arange(table.pursuers.shape[-2])
    for slot, who in enumerate((first, second)):
        chosen = np.take_along_axis(who, place, axis=-1) == n
        together = np.take_along_axis(played.pursuer_velocity_m_s[..., slot, :], place[..., None], axis=-2)
        flown = np.where(chosen[..., None], together, flown)
    return flown


def _straight(table: _Table, target: Array) -> Array:
    """Return the velocities of evaders that run straight to their targets, (..., m, 3), m/s."""
    x, y = (target[..., axis] - table.evaders[..., axis] for axis in (0, 1))
    length = np.sqrt(x * x + y * y)
    rate = np.where(length > 0, table.v / length, 0.0 * length)
    return np.stack([rate * x, rate * y, 0.0 * rate], axis=-1)


def _of_pair(table: Array, who: Array) -> Array:
    """Take from a table (..., n, m) what belongs to one pursuer for each evader, (..., m)."""
    return np.take_along_axis(table, np.maximum(who, 0)[..., None, :], axis=-2)[..., 0, :]


def _summed(parts: Array) -> Array:
    """Add along the last axis, from the least to the largest: the same bits in any order and in any batch."""
    return np.asarray(sum(np.moveaxis(np.sort(parts, axis=-1), -1, 0)))


def _judged(answer: Matching, table: _Table) -> Matching:
    """Spoil the rows without an answer, or refuse a single state that has none."""
    worst = np.max(table.alone.reason, axis=(-2, -1))
    sound = np.asarray(worst < int(Reason.NOT_FINITE))
    if sound.all():
        return answer
    if sound.ndim == 0:
        raise ConfigError(f"pursuers, evaders: have no answer: {Reason(int(worst)).word.replace('_', ' ')}")
    nobody = dict.fromkeys(("first", "second", "evader_of"), -1)
    parts = {
        name: np.where(_over(sound, part), part, nobody[name]) if name in nobody else spoiled(part, sound)
        for name, part in answer._asdict().items()
    }
    reason = np.where(_over(sound, answer.reason), answer.reason, _over(worst, answer.reason))
    return Matching(**parts)._replace(reason=reason.astype(np.int8))


def _over(rows: Array, part: Array) -> Array:
    return rows[(..., *[None] * (part.ndim - rows.ndim))]
