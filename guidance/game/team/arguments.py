"""Arguments of games of teams: one game from those of all pairs, and arrays of their shapes."""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from operator import attrgetter
from typing import Any, NamedTuple, TypeAlias, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from guidance.errors import ConfigError
from guidance.game.arrays import Array, mapped
from guidance.game.game import Game, Reason, parameters
from guidance.game.records import is_zero
from guidance.game.rows import fitting, for_rows, simplified
from guidance.game.speed_sets import SpeedSet

_Outcome = TypeVar("_Outcome", bound=Any)

TeamGames: TypeAlias = "Game | Sequence[Game] | Sequence[Sequence[Game | None]]"
"""One game for all, or lists with one for each pursuer or pair; None where two do not play."""


DIFFERENT = (
    "pursuer",
    "evader_speed_m_s",
    "capture_radius_m",
    "standoff",
    "information_age_s",
    "wind_m_s",
)
"""Parameters whose numbers may differ between the games of a team."""


class TeamGame(NamedTuple):
    """The game of a team: its numbers may be arrays with one for each pair, and so is `plays`, whether the two play."""

    game: Game
    plays: Array

    def rows(self, rows: Callable[[Array], Array]) -> "TeamGame":
        """Return the game of some pairs; `rows` takes them from each array."""
        return TeamGame(for_rows(self.game, rows), rows(self.plays))


def between(
    game: Game, pursuers: Sequence[SpeedSet], evader_speeds_m_s: Sequence[float] | Array
) -> Game:
    """Return the game of every pair of some vehicles and evaders: all but the speeds is that of one vehicle's game.

    Args:
        game: of a vehicle.
        pursuers: speed sets of n vehicles, of the same kind as the game's.
        evader_speeds_m_s: of m evaders, m/s.

    Returns:
        The game whose speeds are arrays (n, 1) and (m,), for `match_teams`.
    """
    speeds: dict[str, Any] = {
        part.name: np.array([[getattr(pursuer, part.name)] for pursuer in pursuers], dtype=float)
        for part in fields(game.pursuer)
    }
    return replace(
        game,
        pursuer=replace(game.pursuer, **speeds),
        evader_speed_m_s=np.array(evader_speeds_m_s, dtype=float),
    )


def joined(games: TeamGames, shape: str) -> TeamGame:
    """Return one game whose numbers are arrays of the shape of nested lists of games.

    Args:
        games: as `match_teams`.
        shape: of the lists, "(n,)" or "(n, m)".

    Raises:
        ConfigError: If teams cannot play these games, or not together.
    """
    if isinstance(games, Game):
        return TeamGame(_playable(games), np.array(True))
    table = np.array(games, dtype=object)
    # All games of a team have to fit together.
    present_games = [game for game in table.flat if game is not None]
    nested = table.ndim == len(shape) // 3 and (table.ndim > 1 or len(present_games) == table.size)
    if not nested or not present_games or not all(isinstance(game, Game) for game in present_games):
        raise ConfigError(
            f"game = {games!r}: must be one Game, or lists {shape} of games, None where two do not play"
        )
    first: Game = present_games[0]
    shared = attrgetter("varies", "evader_space", "target_velocity_m_s", "target_extent")
    if first.varies or len({(type(game.pursuer), *shared(game)) for game in present_games}) > 1:
        same = "speed set (Ball, Cylinder …), target_velocity_m_s, target_extent and evader_space"
        raise ConfigError(
            f"game: the games of a team must have the same {same}, and single numbers"
        )
    rows = table.reshape(len(table), -1)
    alike = [next(filter(None, column), first) for column in rows.T]
    numbers_of_games = [
        attrgetter(*DIFFERENT)(template if game is None else game)
        for row in rows
        for game, template in zip(row, alike, strict=True)
    ]
    numbers = mapped(lambda *every: np.array(every).reshape(table.shape), *numbers_of_games)
    joined_game = replace(first, **dict(zip(DIFFERENT, numbers, strict=True)))
    plays = np.array([game is not None for game in table.flat]).reshape(table.shape)
    return TeamGame(_playable(simplified(joined_game)), plays)


def _playable(game: Game) -> Game:
    """Return a game if teams can play it."""
    if not is_zero(game.information_age_s):
        allowed = "must be 0 in a game of teams; use Game.within_spread"
        raise ConfigError(f"information_age_s = {game.information_age_s!r}: {allowed}")
    if game.evader_space != "plane":
        raise ConfigError(
            f"evader_space = {game.evader_space!r}: must be 'plane' in a game of teams"
        )
    return game


def pair_axes(team: TeamGame) -> tuple[int, ...]:
    """Return the common shape of a game's numbers."""
    shapes: dict[str, tuple[int, ...]] = {
        name: np.shape(value) for name, value in parameters(team.game).items()
    }
    return fitting(shapes | {"game": team.plays.shape})


def real_argument(name: str, array: ArrayLike, shape: str) -> Array:
    """Return an argument as an array of real numbers.

    Raises:
        ConfigError: If it is not an array of numbers of this shape, has masked elements, or holds no player.
    """
    numbers = _array(array)
    axes = shape.count(",")
    nobody = axes > 1 and 0 in numbers.shape[-2:-1]
    if isinstance(array, np.ma.MaskedArray):
        raise ConfigError(
            f"{name} = {array!r}: must not be a masked array; leave those players out"
        )
    if (
        numbers.ndim < axes
        or nobody
        or numbers.shape[-1:] != (3,)
        or numbers.dtype.kind not in "fiu"
    ):
        raise ConfigError(f"{name} = {array!r}: must be an array of numbers of shape {shape}")
    return numbers if numbers.dtype.kind == "f" else numbers.astype(np.float64)


def _array(values: ArrayLike) -> Array:
    try:
        return np.asarray(values)
    except ValueError:  # lists of different lengths
        return np.empty(0)


def in_play_of(mask: ArrayLike | None, m: int) -> Array:
    """Return which evaders are in play, as truths."""
    if mask is None:
        return np.ones(m, dtype=bool)
    present = _array(mask)
    truths = (present == 0) | (present == 1)
    if isinstance(mask, np.ma.MaskedArray) or present.shape[-1:] != (m,) or not truths.all():
        allowed = f"must say for each of {m} evaders whether it is in play, by true or false"
        raise ConfigError(f"in_play = {mask!r}: {allowed}")
    return present.astype(bool)


def judged(answer: _Outcome, fault: Array, fault_words: Callable[[], str]) -> _Outcome:
    """Return an answer with missing values in the rows that have a fault, or refuse a single state that has one.

    Missing values are NaN, −1 for numbers of players, and 0 for other whole numbers.

    Args:
        answer: of the leading shape of `fault`.
        fault: why a row has no answer, as `Reason`; 0 if it has one.
        fault_words: what has none, for the message.

    Raises:
        ConfigError: If a single state has no answer.
    """
    if not fault.any():
        return answer
    if fault.ndim == 0:
        raise ConfigError(f"{fault_words()} no answer: {Reason(int(fault)).word.replace('_', ' ')}")
    nothing = dict.fromkeys(("first", "second", "then", "evader_of"), -1)
    parts = {}
    for name, part in answer._asdict().items():
        lost = fault.reshape(fault.shape + (1,) * (part.ndim - fault.ndim))
        empty = (
            lost if name == "reason" else nothing.get(name, np.nan if part.dtype.kind == "f" else 0)
        )
        parts[name] = np.where(lost == 0, part, np.asarray(empty, dtype=part.dtype))
    return cast("_Outcome", answer._replace(**parts))
