"""Teams against evaders: each pair's own game, everybody against everybody, and the promises of an earlier matching."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from guidance.errors import ConfigError
from guidance.game.extent import POINT
from guidance.game.solution import Solution, solve
from guidance.game.team.arguments import each_speed, fitting, in_play_of, vectors, with_speeds
from guidance.game.team.discs import Array, Discs, Meeting, Point, farthest, project

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from guidance.game.game import Game


class Team(NamedTuple):
    """Every pursuer's game against the evader, (..., n), and its disc.

    Attributes:
        u: speeds of the pursuers, m/s.
        v: speed of the evader, m/s.
        discs: the points that the evader reaches before each pursuer.
        guide: TAD: each disc's point closest to the target, from the evader, m. PE: the direction of its farthest.
        measure: TAD: the distance of that point from the target, m; zero if the target is in the disc. PE: from the
            evader, m.
        goal: the target from the evader, (...), m; None in PE.
        alone: each pursuer's own game.
    """

    u: Array
    v: Array
    discs: Discs
    guide: Point
    measure: Array
    goal: Point | None
    alone: Solution

    def pick(self, index: Any) -> Team:  # noqa: ANN401 - whatever indexes an array
        """Return the team of some pursuers: those that an index takes from arrays (..., n)."""
        discs, alone = Discs(*(part[index] for part in self.discs)), Solution(*(part[index] for part in self.alone))
        guide = self.guide[0][index], self.guide[1][index]
        return Team(self.u[index], self.v[index], discs, guide, self.measure[index], self.goal, alone)


def team_of(game: Game, u: Any, v: Any, P: Array, E: Array, T: Array | None, alone: Solution) -> Team:  # noqa: ANN401
    """Return the team whose pursuers are along the last axis but one of P.

    Args:
        game: the game.
        u: speeds of the pursuers, one number or (..., n), m/s.
        v: speed of the evader, one number or (..., 1), m/s.
        P: positions of the pursuers, (..., n, 3), m.
        E: position of the evader, (..., 1, 3), m.
        T: position of its target, (..., 1, 3), m, or None for PE.
        alone: each pursuer's own game, (..., n).
    """
    w = P - E
    zero = np.zeros(w.shape[:-1], dtype=w.dtype)
    u, v = (zero + np.asarray(speed, dtype=w.dtype) for speed in (u, v))
    discs = Discs((u - v) * (u + v) / (v * v), w[..., 0], w[..., 1], w[..., 2] - game.standoff.height_m)
    if T is None:
        run = alone.evader_velocity_m_s
        return Team(u, v, discs, (run[..., 0] / v, run[..., 1] / v), alone.value * v, None, alone)
    wins, to = alone.winner > 0, T - E
    own = np.where(wins[..., None], alone.meeting_point_m - E, to)
    measure = np.where(wins, alone.value, 0.0 * alone.value)
    return Team(u, v, discs, (own[..., 0], own[..., 1]), measure, (to[..., 0, 0], to[..., 0, 1]), alone)


def meeting_of(team: Team, index: Any = ...) -> Meeting:  # noqa: ANN401 - whatever indexes an array
    """Return where the evader is closest to its target, or else farthest from where it is, before all of a team.

    Args:
        team: the pursuers.
        index: which of them, as in `Team.pick`.
    """
    discs, measure = Discs(*(part[index] for part in team.discs)), team.measure[index]
    guide = team.guide[0][index], team.guide[1][index]
    if team.goal is None:
        return farthest(discs, guide, measure)
    beside = (..., *[None] * (measure.ndim - 1 - team.goal[0].ndim))
    return project(discs, (team.goal[0][beside], team.goal[1][beside]), guide, measure)


class Table(NamedTuple):
    """Everybody against everybody, with the leading axes made one, b.

    Attributes:
        shape: the leading axes.
        evaders: positions, (b, m, 3), m.
        target: of each, (b, m, 3), m; None in PE.
        present: which are in play, (b, m).
        all: each pair by itself, the pursuers along the last axis: (b, m, n).
        worth: of each pair, larger is better, (b, m, n): L, m, in TAD; minus the capture time, s, in PE.
        beats: whether a pursuer captures an evader that is in play alone, (b, m, n).
    """

    shape: tuple[int, ...]
    evaders: Array
    target: Array | None
    present: Array
    all: Team
    worth: Array
    beats: Array


class Kept(NamedTuple):
    """The promises of an earlier matching that still hold.

    Attributes:
        first: of its teams that still win, (b, m); −1 for none.
        second: the pursuer beside it; −1 for none.
        worth: the team's worth now (see `Table`).
        asked: of all its teams.
        pairs: in TAD, these with each pursuer beside them, (b, m, n).
    """

    first: Array
    second: Array
    worth: Array
    asked: Array
    pairs: Meeting | None


def table_of(
    game: Game, pursuers: ArrayLike, evaders: ArrayLike, target: ArrayLike | None, in_play: ArrayLike | None
) -> Table:
    """Bring the arguments to one shape, and solve each pair."""
    if game.target_extent != POINT:
        raise ConfigError(
            f"target_extent = {game.target_extent!r}: matchings defend a point; use solve_team for each evader"
        )
    u, v = each_speed(game)
    P, E = vectors("pursuers", pursuers, "(..., n, 3)"), vectors("evaders", evaders, "(..., m, 3)")
    T = None if target is None else vectors("target", target, "(..., 3)")
    n, m = P.shape[-2], E.shape[-2]
    present = in_play_of(in_play, m)
    evader_axes = {"evaders": E.shape[:-1], "in_play": present.shape, "evader_speed_m_s": np.shape(v)}
    whole = fitting(evader_axes | ({} if T is None else {"target": T.shape[:-1]}))
    shape = fitting({"pursuers": P.shape[:-2], "speed_m_s": np.shape(u)[:-1], "evaders and what they have": whole[:-1]})
    b = math.prod(shape)
    P, E = (np.broadcast_to(one, (*shape, *one.shape[-2:])).reshape(b, one.shape[-2], 3) for one in (P, E))
    T = None if T is None else np.broadcast_to(T, (*shape, m, 3)).reshape(b, m, 3)
    if np.ndim(u) or np.ndim(v):
        u = np.broadcast_to(u, (*shape, n)).reshape(b, 1, n)
        v = np.broadcast_to(v, (*shape, m)).reshape(b, m, 1)
        game = with_speeds(game, u, v)
    present = np.broadcast_to(present, (*shape, m)).reshape(b, m)
    P, one = P[:, None], E[:, :, None]
    goal = None if T is None else T[:, :, None]
    alone = solve(game, P, one, goal)
    with np.errstate(all="ignore"):
        each = team_of(game, u, v, P, one, goal, alone)
    worth = alone.value if T is not None else -alone.value
    return Table(shape, E, T, present, each, worth, (alone.winner > 0) & present[..., None])


def kept_of(table: Table, teams: tuple[Array, Array]) -> Kept:
    """Return the teams of an earlier matching that still win, with their worth now, from its `first` and `second`."""
    b, m, n = table.worth.shape
    first, second = (np.broadcast_to(who, (*table.shape, m)).reshape(b, m) for who in teams)
    first = np.where((first < n) & table.present, first, -1)
    second = np.where((second < n) & (first >= 0), second, -1)
    worth, wins, pairs = worth_of(table.worth, first), worth_of(table.beats, first), None
    if table.target is not None:
        pairs = pairs_with(table, first)
        worth = np.where(second < 0, worth, worth_of(pairs.distance, second))
        wins |= (second >= 0) & worth_of(table.beats, second)
    stays = (first >= 0) & wins
    return Kept(np.where(stays, first, -1), np.where(stays, second, -1), worth, first, pairs)


def pairs_with(table: Table, first: Array) -> Meeting:
    """Return where the first of each evader meets it together with each other pursuer, (b, m, n)."""
    b, m, n = table.worth.shape
    who = np.empty((b, m, n, 2), dtype=np.intp)
    who[..., 0], who[..., 1] = np.maximum(first, 0)[..., None], np.arange(n)
    return meeting_of(table.all, (np.arange(b)[:, None, None, None], np.arange(m)[:, None, None], who))


def worth_of(table: Array, who: Array) -> Array:
    """Take from a table (b, m, n) or (b, m, n, 3) what belongs to one pursuer of each evader, (b, m)."""
    b, m = who.shape
    return np.asarray(table[np.arange(b)[:, None], np.arange(m), np.maximum(who, 0)])
