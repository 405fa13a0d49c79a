"""Several pursuers against one evader.

TAD: the evader reaches the points of the intersection of the discs of `discs` before any pursuer. The intersection is
convex, so one point X* of it is closest to the target, and the value of the game is

    L = dist(T, ∩ᵢ discᵢ).

A target with an extent is replaced by its point T* that is closest to the intersection. A team may then win although
none of its pursuers wins alone.

The team wins if one pursuer wins alone, because T is outside the intersection only if it is outside one disc. A second
pursuer increases L, and at most two discs decide X*. The pursuers that decide it fly straight to X*; then L never
falls for any play of the evader. The others are free and fly to X* too.

PE with two pursuers ("two cutters": Szots & Harmati, arXiv 2403.15188; Von Moll et al., arXiv 2407.19954): the value is
the evader's time to the point X* of the intersection that is farthest from it. The evader and both pursuers go straight
to X*. With λᵢ as in `TeamSolution.multipliers`, the value changes at the rate

    −Σ λᵢ + (Σ λᵢ − 1) n·e ≤ −1    for every heading e of the evader, n the direction to X*, since Σ λᵢ ≥ 1.

PE with three or more: the farthest point of the intersection is only a lower bound, because Σ λᵢ may be less than 1.
The best pair is an upper bound: it captures in its own value alone. `TeamSolution` gives both.

If two points are equally far (a dispersal surface), both are optimal, and the evader may choose. Of points that are
equally far to the last bit, `solve_team` takes the one with the larger y, then the larger x. Near such a surface each
new solution decides again; this costs the pursuers a time that goes to zero with the time step.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from guidance.errors import ConfigError
from guidance.game.extent import POINT, least_at, to_set
from guidance.game.game import Game, Reason
from guidance.game.solution import Solution, solve
from guidance.game.team.arguments import fitting, speeds, spoiled, vectors
from guidance.game.team.discs import Array, Meeting, multipliers, pairs_of, taken
from guidance.game.team.table import Team, meeting_of, team_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from guidance.game.arrays import Plane


class TeamSolution(NamedTuple):
    """The answer of `solve_team` for leading axes (...) and n pursuers.

    A row without an answer is NaN throughout, its winner UNDECIDED, and its reason tells why.

    Attributes:
        winner: `Winner`: 1 the team, −1 the evader, 0 neither (the barrier itself, or no answer).
        value: TAD: distance of the evader from its target at the capture, m, or, where the evader wins, the distance
            that the nearest pursuer is short of a capture then, m. PE: time to the capture, s. For three pursuers or
            more it is an upper bound of the value, and the pursuers' play keeps it.
        lower_bound: TAD, and PE with one or two pursuers: the value again. PE with three or more: the time that the
            evader has at least, s.
        margin_s: how much sooner a pursuer can guard the target than the evader can be there, s; infinite in PE.
        meeting_point_m: where the evader is when the game ends, (..., 3), m: X*. PE with three or more: the point that
            gives `lower_bound`.
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
    game: Game,
    pursuers: ArrayLike,
    evader: ArrayLike,
    target: ArrayLike | None = None,
    *,
    evader_velocity_m_s: ArrayLike | None = None,
) -> TeamSolution:
    """Solve a game of several pursuers against one evader: PE without a target, TAD with one.

    A team of one has the answer of `solve`, to the bit.

    Args:
        game: the paper's game, at most with a height of the stand-off disc. Speeds may be arrays that broadcast with
            (..., n): (n,) where pursuers differ, (..., 1) where evaders do.
        pursuers: positions, (..., n, 3), NumPy, m.
        evader: position, (..., 3), m.
        target: position of the evader's target, (..., 3), m, or None for PE.
        evader_velocity_m_s: the evader's velocity as observed, (..., 3), where it is known; see `solve`.

    Raises:
        ConfigError: teams do not play such a game, an argument is not an array of its shape, the shapes do not fit
            each other, or a single state has no answer. In a batch such a row is NaN instead.
    """
    u, v = speeds(game)
    if np.shape(v)[-1:] not in {(), (1,)}:
        raise ConfigError(f"evader_speed_m_s = {v!r}: must be one number, or an array (..., 1), for one evader")
    given = {"evader": evader, "target": target, "evader_velocity_m_s": evader_velocity_m_s}
    P = vectors("pursuers", pursuers, "(..., n, 3)")
    rest = {name: vectors(name, one, "(..., 3)") for name, one in given.items() if one is not None}
    axes = {"pursuers": P.shape[:-2], "speed_m_s": np.shape(u)[:-1], "evader_speed_m_s": np.shape(v)[:-1]}
    shape = fitting(axes | {name: one.shape[:-1] for name, one in rest.items()})
    P = np.broadcast_to(P, (*shape, *P.shape[-2:]))
    if target is not None and game.target_extent != POINT:
        rest["target"] = _most_in_danger(
            game, P, *(np.broadcast_to(rest[name], (*shape, 3)) for name in ("evader", "target"))
        )
        game = replace(game, target_extent=POINT)
    lone = {name: np.broadcast_to(one, (*shape, 3))[..., None, :] for name, one in rest.items()}
    E, T = lone["evader"], lone.get("target")
    alone = solve(game, P, E, T, evader_velocity_m_s=lone.get("evader_velocity_m_s"))
    with np.errstate(all="ignore"):
        team, place = team_of(game, u, v, P, E, T, alone), E[..., 0, :]
        if T is None:
            answer, best = chase(team, place)
        else:
            best = meeting_of(team)
            answer = defence(team, place, best)
        won = (answer.winner > 0)[..., None]
        late = multipliers(team.discs, (team.u, team.v), team.goal, best.point, (best.first, best.second))
        answer = answer._replace(multipliers=np.where(won, late, 0.0))
        return _judged(answer, alone, {"pursuers": P, **rest})


def _most_in_danger(game: Game, P: Array, E: Array, T: Array) -> Array:
    """Return the point of the target's set that is closest to the evader's region, (..., 3).

    The distance of a point from the region is a convex function of the point. If the region meets the set, the point
    is the one where the evader arrives before every pursuer by most.
    """
    extent, point = game.target_extent, replace(game, target_extent=POINT)

    def placed(offset: Plane) -> Array:
        x, y = offset
        return np.stack([T[..., 0] + x, T[..., 1] + y, T[..., 2]], axis=-1)

    def left(offset: Plane) -> Array:
        with np.errstate(all="ignore"):
            found = solve_team(point, P, E, placed(offset))
        return np.asarray(np.where(found.winner > 0, found.value, found.margin_s))

    away = to_set(np, extent, (E[..., 0] - T[..., 0], E[..., 1] - T[..., 1]))
    arrived = np.asarray(away[0] * away[0] + away[1] * away[1] == 0)
    return np.where(arrived[..., None], E, placed(least_at(np, extent, left)))


def _judged(answer: TeamSolution, alone: Solution, given: dict[str, Array]) -> TeamSolution:
    """Spoil the rows without an answer, or refuse a single state that has none."""
    none = int(Reason.NOT_FINITE)
    worst = np.max(alone.reason, axis=-1)
    fault = np.where(worst >= none, worst, np.where(np.isfinite(answer.value), 0, none))
    sound = np.asarray(fault == 0)
    if sound.all():
        return answer
    if sound.ndim == 0:
        wrong = [f"{name} = {array!r}" for name, array in given.items() if not np.isfinite(array).all()]
        why = Reason(int(fault)).word.replace("_", " ")
        raise ConfigError(f"{', '.join(wrong) or 'the team'}: has no answer: {why}")
    parts = {name: spoiled(part, sound) for name, part in answer._asdict().items()}
    return TeamSolution(**parts)._replace(reason=np.where(sound, answer.reason, fault).astype(answer.reason.dtype))


def defence(team: Team, evader: Array, found: Meeting) -> TeamSolution:
    """Play TAD: see `solve_team`.

    Args:
        team: the pursuers.
        evader: position of the evader, (..., 3), m.
        found: `meeting_of` this team.
    """
    alone = team.alone
    winner = np.max(alone.winner, axis=-1)
    won = winner > 0
    # If the evader wins, the value is that of the pursuer that comes least short, or is there at the same instant.
    least = np.argmin(np.where(alone.winner == winner[..., None], alone.value, np.inf), axis=-1)
    first, second = np.where(won, found.first, least), np.where(won, found.second, least)
    value = np.where(won, found.distance, taken(alone.value, least))
    found = Meeting(found.point, value, first, second)
    flown = np.where(won[..., None, None], _straight(team, found), alone.pursuer_velocity_m_s)
    return _assembled(team, evader, found, found, flown)


def chase(team: Team, evader: Array, *, bracket: bool = True) -> tuple[TeamSolution, Meeting]:
    """Play PE: see `solve_team`. The meeting is that of the pursuers that decide the value.

    Args:
        team: the pursuers.
        evader: position of the evader, (..., 3), m.
        bracket: whether to look for the best pair of three pursuers or more; else `value` is the lower bound.
    """
    alone, v = team.alone, team.v[..., 0]
    soonest, least = np.argmin(alone.value, axis=-1), np.min(alone.value, axis=-1)
    found = meeting_of(team)
    caught = least <= 0
    found = found._replace(
        distance=np.where(found.first == found.second, taken(alone.value, found.first), found.distance / v),
        first=np.where(caught, soonest, found.first),
        second=np.where(caught, soonest, found.second),
    )
    best = _best_pair(team, found, soonest) if bracket and alone.value.shape[-1] > 2 else found
    both = best.first != best.second
    every = np.arange(alone.value.shape[-1])
    flies = both[..., None] & ((every == best.first[..., None]) | (every == best.second[..., None]))
    flown = np.where(flies[..., None], _straight(team, best), alone.pursuer_velocity_m_s)
    return _assembled(team, evader, found, best, flown), best


def _best_pair(team: Team, found: Meeting, soonest: Array) -> Meeting:
    """Return the meeting of the two pursuers, or the one, that capture soonest without the others.

    Args:
        team: three pursuers or more.
        found: the meeting with all pursuers; it is exact if it is not sooner than that of the best pair.
        soonest: number of the pursuer that captures soonest alone.
    """
    i, j = pairs_of(team.measure.shape[-1])
    pairs = meeting_of(team, (..., np.stack([i, j], axis=-1)))
    time = pairs.distance / team.v[..., :1]
    time = np.where(pairs.first == pairs.second, np.inf, time)
    which = np.argmin(time, axis=-1)
    point = taken(pairs.point[0], which), taken(pairs.point[1], which)
    alone, pair = taken(team.alone.value, soonest), taken(time, which)
    single = alone <= pair
    own = [taken(part, soonest) * taken(team.measure, soonest) for part in team.guide]
    best = np.where(single, alone, pair)
    exact = found.distance >= best * (1.0 - 1e-12)
    x, y = (
        np.where(exact, of_all, np.where(single, of_one, of_two))
        for of_all, of_one, of_two in zip(found.point, own, point, strict=True)
    )
    return Meeting(
        (x, y),
        np.maximum(best, found.distance),
        np.where(exact, found.first, np.where(single, soonest, i[which])),
        np.where(exact, found.second, np.where(single, soonest, j[which])),
    )


def _assembled(team: Team, evader: Array, found: Meeting, best: Meeting, flown: Array) -> TeamSolution:
    """Return an answer without multipliers.

    Args:
        team: the pursuers.
        evader: position of the evader, (..., 3), m.
        found: the point that the evader runs to.
        best: the meeting that gives the value.
        flown: velocities of the pursuers, m/s.
    """
    alone, (x, y), first = team.alone, found.point, found.first
    single, v = found.first == found.second, team.v[..., 0]
    run = np.sqrt(x * x + y * y)
    end = evader + np.stack([x, y, np.zeros_like(x)], axis=-1)
    rate = v / np.where(run > 0, run, 1.0)
    every = np.arange(alone.value.shape[-1])
    return TeamSolution(
        winner=np.max(alone.winner, axis=-1),
        value=best.distance,
        lower_bound=found.distance,
        margin_s=np.max(alone.margin_s, axis=-1),
        meeting_point_m=_own_or(single, alone.meeting_point_m, first, end),
        meeting_time_s=np.where(single, taken(alone.meeting_time_s, first), run / v),
        binds=(every == best.first[..., None]) | (every == best.second[..., None]),
        multipliers=np.zeros(alone.value.shape),
        pursuer_velocity_m_s=flown,
        evader_velocity_m_s=_own_or(
            single, alone.evader_velocity_m_s, first, np.stack([rate * x, rate * y, np.zeros_like(x)], axis=-1)
        ),
        reason=np.where(single, taken(alone.reason, first), np.int8(Reason.SOLVED)),
    )


def _straight(team: Team, found: Meeting) -> Array:
    """Return velocities straight to the meeting point; a pursuer that decides it alone plays its own game."""
    x, y = (part[..., None] for part in found.point)
    to = x - team.discs.x, y - team.discs.y, 0.0 - team.discs.z
    length = np.sqrt(to[0] * to[0] + to[1] * to[1] + to[2] * to[2])
    rate = np.where(length > 0, team.u / length, 0.0 * length)
    every, single = np.arange(team.u.shape[-1]), found.first == found.second
    own = single[..., None] & (every == found.first[..., None])
    return np.where(own[..., None], team.alone.pursuer_velocity_m_s, np.stack([rate * part for part in to], axis=-1))


def _own_or(single: Array, own: Array, first: Array, other: Array) -> Array:
    """Return the first pursuer's own vector if it decides alone, else another."""
    picked = np.take_along_axis(own, first[..., None, None], axis=-2)[..., 0, :]
    return np.where(single[..., None], picked, other)
