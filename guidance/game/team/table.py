"""Teams against evaders: each pair's own game, what two pursuers guarantee together, and the promises kept.

Two pursuers play together by their regions. The point X* of both regions is the closest to the target (TAD), or the
farthest from the evader (PE). It is the one pursuer's own end of the game if the other's region contains that, and else
the corner where the edges cross between both own ends. Cylinders play it horizontally, and the later of the two to be
at its height adds the disc that the evader reaches until then.
"""

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from guidance.errors import ConfigError
from guidance.game.arrays import NUMPY, Array, components, cross2, dot2, plus2
from guidance.game.extent import Extent, to_set
from guidance.game.game import Game, StandOff
from guidance.game.pe import Geometry, fly_to, take_apart
from guidance.game.records import is_zero
from guidance.game.rows import fitting, simplified
from guidance.game.solution import Solution, solve
from guidance.game.speed_sets import Ball
from guidance.game.team.arguments import (
    TeamGame,
    TeamGames,
    in_play_of,
    joined,
    pair_axes,
    real_argument,
)
from guidance.game.team.regions import (
    PlaneArrays,
    Regions,
    RunEnd,
    crossing,
    edge,
    for_each,
    halfway,
    regions_of,
    unit,
)

FAR_M = 1e150
"""Distance that an evader runs before a pursuer without a game captures it; its square is finite."""


class Goal(NamedTuple):
    """A target: its position from the evader, (...), m, its shape, and its velocity over the evader's speed."""

    x: Array
    y: Array
    extent: Extent
    drift: PlaneArrays

    @property
    def is_point(self) -> bool:
        """True if the target is a point."""
        return self.extent.is_point

    def pick(self, rows: Any) -> "Goal":  # noqa: ANN401 - whatever indexes an array
        """Return the targets of some rows, (...)."""
        drift_x = self.drift[0][..., 0]
        drift_y = self.drift[1][..., 0]
        drift = (drift_x[rows], drift_y[rows])
        return Goal(self.x[rows], self.y[rows], self.extent, drift)

    def rows(self, rows: Any) -> "Goal":  # noqa: ANN401 - whatever indexes an array
        """Return the targets of some rows, whose runs have an axis more, (k,)."""
        x, y, drift_x, drift_y = (np.asarray(part)[rows] for part in (self.x, self.y, *self.drift))
        return Goal(x, y, self.extent, (drift_x, drift_y))

    def pull(self, point: PlaneArrays) -> PlaneArrays:
        """Return how the distance from the target falls with the end of a run, (...), if it is picked, see `pick`."""
        x, y = self.place(point)
        run = unit(point)
        to_target = to_set(NUMPY, self.extent, (x - self.x, y - self.y))
        to = unit(to_target)
        return plus2(to, -dot2(to, self.drift), run)

    def left(self, point: PlaneArrays) -> Array:
        """Return the distances, (..., k), m, of ends of runs from the target when the evader is there."""
        x, y = self.place(point)
        from_target = (x - self.x[..., None], y - self.y[..., None])
        return NUMPY.norm2(to_set(NUMPY, self.extent, from_target))

    def place(self, point: PlaneArrays) -> PlaneArrays:
        """Return ends of runs, (..., k), from where the evader is carried with the target."""
        far = NUMPY.norm2(point)
        x, y = point
        drift_x, drift_y = self.drift
        return x - drift_x * far, y - drift_y * far

    def towards(self, reach: Array) -> PlaneArrays:
        """Return the ways, (..., k), m, to the target from the middle of all ends of runs up to some length."""
        x = -self.drift[0] * reach - self.x[..., None]
        y = -self.drift[1] * reach - self.y[..., None]
        return to_set(NUMPY, self.extent, (x, y))

    def beyond(self, reach: Array) -> Array:
        """Return the distances, (..., k), m, of the target from the ends of the evader's runs of some length."""
        beyond_m = NUMPY.norm2(self.towards(reach)) - reach
        return np.asarray(np.maximum(beyond_m, 0.0))


class PursuerGames(NamedTuple):
    """Every pursuer's game against the evader, (..., n), and its region.

    Attributes:
        game: the game; its numbers may be arrays (..., n).
        v: speed of the evader, (...), m/s.
        regions: the points that the evader reaches before each pursuer.
        state: the players' places.
        x: the end of each pursuer's own game (of a Cylinder, of the horizontal one), from the evader, m.
        y: the same.
        worth: of that end, larger is better: L, m, in TAD; minus the capture time, s, in PE.
        alone: each pursuer's own game.
        own: worth of that game.
        goal: the target; None in PE.
    """

    game: Game
    v: Array
    regions: Regions
    state: Geometry
    x: Array
    y: Array
    worth: Array
    alone: Solution
    own: Array
    goal: Goal | None

    def straight(self, point: PlaneArrays) -> Array:
        """Return the velocities, (..., n, 3), m/s, of pursuers that meet the evader at an end of its run, (...)."""
        x, y = for_each(point)
        to = (x - self.regions.x, y - self.regions.y)
        time = NUMPY.norm2((x, y)) / self.v[..., None]
        velocity = fly_to(NUMPY, self.game, self.state, to, time)
        return NUMPY.pack(self.own.shape, self.own, velocity)

    def worth_of(self, reach: Array) -> Array:
        """Return the worth, (..., k), of a game that ends when the evader has run for some length, m, anywhere."""
        if self.goal is None:
            return -reach / self.v[..., None]
        return self.goal.beyond(reach)


class Meeting(NamedTuple):
    """Guarantee of one or two pursuers, and its place.

    Attributes:
        x: X* of their game, (...), from the evader, m.
        y: the same.
        worth: as in `PursuerGames`, (...).
        first: number of a pursuer that decides it, (...).
        second: number of the other, or the same again if one decides it alone.
    """

    x: Array
    y: Array
    worth: Array
    first: Array
    second: Array


def team_of(
    game: Game, P: Array, E: Array, T: Array | None, evader_velocity_m_s: Array | None = None
) -> PursuerGames:
    """Return the team whose pursuers are along the last axis but one of P.

    Args:
        game: the game; its numbers may be arrays (..., n).
        P: positions of the pursuers, (..., n, 3), m.
        E: position of the evader, (..., 1, 3), m.
        T: position of its target, (..., 1, 3), m, or None for PE.
        evader_velocity_m_s: velocity of the evader as observed, (..., 1, 3), m/s, or None.
    """
    alone = solve(game, P, E, T, evader_velocity_m_s=evader_velocity_m_s)
    own_worth = worth_in(alone, T)
    regions = regions_of(game, P, E)
    v = (game.evader_speed_m_s + 0.0 * regions.x)[..., 0]
    level = alone
    worth = own_worth
    if not is_zero(regions.safe):
        ground = np.array([1.0, 1.0, 0.0])
        below = P * ground + E * (1.0 - ground)
        # Over the ground, the game of a separate set is a ball's, with the disc that is captured level.
        reach = game.standoff.radius_m + game.capture_radius_m
        ball = Ball(game.pursuer.horizontal_m_s)
        level_game = replace(game, pursuer=ball, capture_radius_m=reach, standoff=StandOff())
        level = solve(level_game, below, E, T)
        worth = worth_in(level, T)
    end = level.meeting_point_m - E
    goal = None
    if T is not None:
        to_target = (T - E)[..., 0, :]
        x_m_s, y_m_s = game.target_velocity_m_s
        speed = v[..., None]
        drift = (x_m_s / speed, y_m_s / speed)
        goal = Goal(to_target[..., 0], to_target[..., 1], game.target_extent, drift)
    state = take_apart(NUMPY, game, components(P), components(E), None)
    return PursuerGames(
        game, v, regions, state, end[..., 0], end[..., 1], worth, alone, own_worth, goal
    )


def costs_of(
    regions: Regions, v: Array, run: PlaneArrays, met: RunEnd, level: Array | bool
) -> PlaneArrays:
    """Return how the evader's lead over each pursuer changes at the edge of its region, s/m: ∇(t_E − tᵢ), (..., n).

    Args:
        regions: of the pursuers, (..., n).
        v: speed of the evader, (...), m/s.
        run: direction of a run, (...).
        met: where the run ends at the edge of each region.
        level: which pursuers are late only by their height, (..., n).
    """
    u = regions.ratio
    speed = v[..., None]
    wind = (regions.wind_x * speed, regions.wind_y * speed)
    away_m = NUMPY.norm3((*met.away, regions.z))
    rate = away_m * u * speed + dot2(met.away, wind)
    divisor = np.where(rate > 0, rate, 1.0)
    away_x = np.where(level, 0.0, met.away[0] / divisor)
    away_y = np.where(level, 0.0, met.away[1] / divisor)
    x, y = for_each((run[0] / v, run[1] / v))
    return x - away_x, y - away_y


def pull_shares(pull: PlaneArrays, costs: tuple[PlaneArrays, PlaneArrays]) -> tuple[Array, Array]:
    """Return the multipliers λ of two pursuers, which solve Σ λᵢ ∇(t_E − tᵢ) = pull."""
    first, second = costs
    turn = cross2(first, second)
    return cross2(pull, second) / turn, cross2(first, pull) / turn


def worth_in(alone: Solution, T: Array | None) -> Array:
    """Return the worth of each pursuer's own game, see `PursuerGames`."""
    if T is None:
        return -alone.value
    return np.where(alone.winner > 0, alone.value, 0.0 * alone.value)


def together(team: PursuerGames, index: tuple[Any, ...]) -> Meeting:
    """Return the guarantee of each two pursuers, by one of them alone or together, (..., k).

    Args:
        team: the pursuers.
        index: index of both in arrays (..., n); the last part has their numbers, (..., k, 2) or (k, 2).
    """
    pursuers = index[-1]
    first_member = pursuers[..., 0]
    second_member = pursuers[..., 1]
    own_worth = team.own[index]
    regions = team.regions.pick(index)
    end = (team.x[index], team.y[index])
    # Both bind if each cuts the run off to the other's own end.
    far = NUMPY.norm2(end)
    other = ((end[0] / far)[..., ::-1], (end[1] / far)[..., ::-1])
    reach = edge(regions, other).reach
    cut = (reach[..., ::-1] < far).all(axis=-1)
    # No value of PE with two pursuers is proven in wind
    is_proven = team.goal is not None or team.game.calm
    bind = cut & is_proven & (first_member != second_member)
    x, y, bounded = _bounds(team, regions, end, team.worth[index], bind)
    alone = own_worth.max(axis=-1)
    single = ~bind | (alone >= bounded)
    better_alone = np.where(own_worth[..., 1] > own_worth[..., 0], second_member, first_member)
    first = np.where(single, better_alone, first_member)
    second = np.where(single, better_alone, second_member)
    return Meeting(x, y, np.where(single, alone, bounded), first, second)


def _bounds(
    team: PursuerGames, regions: Regions, end: PlaneArrays, worth: Array, bind: Array
) -> tuple[Array, Array, Array]:
    """Return where games of two pursuers end, x and y, (..., k), and the worth that they guarantee together.

    Args:
        team: the pursuers.
        regions: of both, (..., k, 2).
        end: the own ends of both, (..., k, 2).
        worth: of these ends, (..., k, 2).
        bind: where both decide the end, (..., k); else it is the better own end.
    """
    better = worth[..., 1] > worth[..., 0]
    x, y = (np.where(better, part[..., 1], part[..., 0]) for part in end)
    bounded = worth.max(axis=-1)
    rows = np.nonzero(bind)
    if len(rows[0]):
        two = regions.pick(rows)
        # The crossing between both own ends.
        own = (end[0][rows], end[1][rows])
        far = NUMPY.norm2(own)
        first_x, second_x = (own[0] / far).T
        first_y, second_y = (own[1] / far).T
        first = (first_x, first_y)
        second = (second_x, second_y)
        to = crossing(two, first, second, halfway(first, second))
        length = edge(two, for_each(to)).reach.min(axis=-1)
        x[rows] = length * to[0]
        y[rows] = length * to[1]
        goal = team.goal
        if goal is None:
            at_crossing = -NUMPY.norm2((x, y)) / team.v[..., None]
        else:
            at_crossing = goal.left((x, y))
        bounded = np.where(bind, at_crossing, bounded)
        if goal is not None and not goal.is_point:
            lost = bind & (worth.max(axis=-1) <= 0.0)
            lost[rows] &= ~_keeps(two, team.v[rows[:-1]], to, goal.pick(rows[:-1]))
            bounded = np.where(lost, 0.0, bounded)
    if not is_zero(regions.safe):
        later_m = regions.safe.max(axis=-1)
        bounded = np.minimum(bounded, team.worth_of(later_m))
    return x, y, bounded


def _keeps(two: Regions, v: Array, run: PlaneArrays, goal: Goal) -> Array:
    """Return whether two pursuers keep the evader out of its target where their regions' edges cross, (k,).

    The intersection of both regions is apart from the target's set if the crossing is its closest point, which is so if
    no multiplier is negative. Only two pursuers that lose alone need this: else the crossing is always the closest.

    Args:
        two: their regions, (k, 2).
        v: speed of the evader, (k,), m/s.
        run: direction of the run to the crossing, (k,).
        goal: the target of each.
    """
    met = edge(two, for_each(run))
    x, y = costs_of(two, v, run, met, level=False)
    cost_of_first = (x[:, 0], y[:, 0])
    cost_of_second = (x[:, 1], y[:, 1])
    length = met.reach.min(axis=-1)
    pull = goal.pull((length * run[0], length * run[1]))
    first, second = pull_shares(pull, (cost_of_first, cost_of_second))
    return np.asarray((first >= 0.0) & (second >= 0.0))


class Table(NamedTuple):
    """Everybody against everybody, with the leading axes made one, b.

    Attributes:
        shape: the leading axes.
        pursuers: positions, (b, n, 3), m.
        evaders: positions, (b, m, 3), m.
        target: of each, (b, m, 3), m; None in PE.
        present: which are in play, (b, m).
        plays: which pairs play, (b, m, n).
        all: each pair by itself, the pursuers along the last axis: (b, m, n).
        worth: of each pair, larger is better, (b, m, n): L, m, in TAD; minus the capture time, s, in PE.
        beats: whether a pursuer captures an evader that is in play alone, (b, m, n).
        spare_m: least distance of a promised capture from the target, (b, m, n), m.
    """

    shape: tuple[int, ...]
    pursuers: Array
    evaders: Array
    target: Array | None
    present: Array
    plays: Array
    all: PursuerGames
    worth: Array
    beats: Array
    spare_m: Array


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
    games: TeamGames,
    pursuers: ArrayLike,
    evaders: ArrayLike,
    target: ArrayLike | None,
    in_play: ArrayLike | None,
) -> Table:
    """Bring the arguments to one shape, and solve each pair."""
    P = real_argument("pursuers", pursuers, "(..., n, 3)")
    E = real_argument("evaders", evaders, "(..., m, 3)")
    T = None if target is None else real_argument("target", target, "(..., 3)")
    n = P.shape[-2]
    m = E.shape[-2]
    team = joined(games, "(n, m)")
    present = in_play_of(in_play, m)
    v = team.game.evader_speed_m_s
    if np.ndim(v) > 1 and np.ptp(v, axis=-2).any():
        raise ConfigError(
            f"evader_speed_m_s = {v!r}: must be the same for all pursuers of an evader, (..., 1, m)"
        )
    shape = _leading_shape(team, P, E, T, present)
    b = math.prod(shape)

    def spread(value: Array, *axes: int) -> Array:
        return np.broadcast_to(value, (*shape, *axes)).reshape((b, *axes))

    # Numbers that all pairs share are taken as one, which spares arrays
    team = TeamGame(simplified(team.game), team.plays)
    team = team.rows(lambda value: spread(value, n, m).swapaxes(1, 2))
    P = spread(P, n, 3)
    E = spread(E, m, 3)
    present = spread(present, m)
    target_of_pairs = None
    if T is not None:
        T = spread(T, m, 3)
        target_of_pairs = T[:, :, None]
    pair_teams = team_of(team.game, P[:, None], E[:, :, None], target_of_pairs)
    if not team.plays.all():
        pair_teams = _without(pair_teams, team.plays)
    worth = pair_teams.own
    if T is not None:
        worth = np.where(team.plays, worth, -np.inf)
    beats = (pair_teams.alone.winner > 0) & present[..., None] & team.plays
    spare_m = np.zeros(worth.shape)
    return Table(shape, P, E, T, present, team.plays, pair_teams, worth, beats, spare_m)


def _leading_shape(
    team: TeamGame, P: Array, E: Array, T: Array | None, present: Array
) -> tuple[int, ...]:
    """Return the leading axes of a game's numbers and of positions.

    Raises:
        ConfigError: the shapes do not fit each other.
    """
    n = P.shape[-2]
    m = E.shape[-2]
    game_axes = pair_axes(team)
    axes = {"pursuers": (n, 1), "evaders": (1, m), "game": game_axes}
    leading = {"pursuers": P.shape[:-2], "evaders": E.shape[:-2], "in_play": present.shape[:-1]}
    leading["game"] = game_axes[:-2]
    if T is not None:
        axes["target"] = (1, *T.shape[-2:-1])
        leading["target"] = T.shape[:-2]
    if fitting(axes)[-2:] != (n, m) or team.plays.shape not in {(), (n, m)}:
        raise ConfigError(
            f"game: its numbers have the shape {game_axes}; must fit {n} pursuers and {m} evaders"
        )
    return fitting(leading)


def _without(team: PursuerGames, plays: Array) -> PursuerGames:
    """Return the team without captures by pairs that do not play."""
    regions = team.regions._replace(safe=np.where(plays, team.regions.safe, FAR_M))
    nothing = -np.inf if team.goal is None else 0.0
    worth, own_worth = (np.where(plays, part, nothing) for part in (team.worth, team.own))
    value = np.where(plays, team.alone.value, np.nan)
    reason = np.where(plays, team.alone.reason, 0)
    return team._replace(
        regions=regions,
        worth=worth,
        own=own_worth,
        alone=team.alone._replace(value=value, reason=reason),
    )


def kept_of(table: Table, teams: tuple[Array, Array]) -> Kept:
    """Return the teams of an earlier matching that still win, with their worth now, from its `first` and `second`."""
    b, m, n = table.worth.shape
    first, second = (np.broadcast_to(members, (*table.shape, m)).reshape(b, m) for members in teams)
    first = np.where((first < n) & table.present, first, -1)
    second = np.where((second < n) & (first >= 0), second, -1)
    worth = taken(table.worth, first)
    wins = taken(table.beats, first)
    pairs = None
    if table.target is not None:
        pairs = pairs_with(table, first)
        worth = np.where(second < 0, worth, taken(pairs.worth, second))
        wins |= (second >= 0) & (taken(table.beats, second) | (worth > 0.0))
    stays = (first >= 0) & wins
    kept_first = np.where(stays, first, -1)
    kept_second = np.where(stays, second, -1)
    return Kept(kept_first, kept_second, worth, first, pairs)


def pairs_with(table: Table, first: Array) -> Meeting:
    """Return the guarantee of each evader's first pursuer with each other, (b, m, n); alone beside another's first."""
    b, m, n = table.worth.shape
    every = np.arange(n)
    own_index = np.maximum(first, 0)[..., None]
    is_first = (every == first[..., None]).any(axis=1)
    without_first = first < 0
    busy = is_first[:, None] | without_first[..., None]
    members = np.empty((b, m, n, 2), dtype=first.dtype)
    members[..., 0] = own_index
    members[..., 1] = np.where(busy, own_index, every)
    return together(table.all, place_of(members, 2))


def are(count: int, *members: Array) -> Array:
    """Return which players, (..., count), are among the members, each the number of a player, (...)."""
    numbers = np.stack(members, axis=-1)
    is_member = numbers[..., None] == np.arange(count)
    return np.asarray(is_member.any(axis=-2))


def taken(array: Array, index: Array) -> Array:
    """Take one element along the axis behind those of the index, (..., n) or (..., n, 3); the first one for −1."""
    return np.asarray(array[place_of(index)])


def place_of(index: Array, axes: int | None = None) -> tuple[Array, ...]:
    """Return the index of elements along the axis after some first axes of an array, by default those of the index."""
    leading = index.shape
    if axes is not None:
        leading = index.shape[:axes] + (1,) * (index.ndim - axes)
    return (*_leading(leading)[:axes], np.maximum(index, 0))


@lru_cache(maxsize=16)
def _leading(shape: tuple[int, ...]) -> tuple[Array, ...]:
    return np.indices(shape, sparse=True)
