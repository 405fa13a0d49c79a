"""Teams in a file: a game of many pursuers and many evaders in each row, and who is to capture whom.

Players are numbered from 0: pursuer_0_x_m, pursuer_0_y_m, pursuer_0_z_m, evader_0_x_m, evader_0_y_m and so on. A player
whose cells are empty is not there in that row, so that rows may have teams of different sizes.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from guidance.errors import ConfigError
from guidance.game import Ball, Game, Reason, Winner
from guidance.game.team import Matching, match_teams

MOST: Final = 50
"""So many players of a side at most."""

_PLAYER = re.compile(r"(pursuer|evader)_(\d+)_[xyz]_m")
_AXES: Final = {"pursuer": "xyz", "evader": "xy"}

Column = Callable[[str], NDArray[np.float64]]
"""Reads a column of numbers, NaN where a cell is empty."""

TEAM_COLUMNS: Final = tuple(
    f"{player}_{number}_{axis}_m" for player, axes in _AXES.items() for number in range(MOST) for axis in axes
)
"""Every column that such a file may have."""


def has_teams(names: set[str]) -> bool:
    """Say whether a file is one of teams, by its columns."""
    return any(_PLAYER.fullmatch(name) for name in names)


def team_answers(
    game: Game, names: set[str], column: Column, target: NDArray[np.float64] | None, lost: set[int]
) -> dict[str, Any]:
    """Return the columns of answers to the rows of a file of teams.

    Args:
        game: what is played.
        names: of the file's columns.
        column: reads one of them.
        target: (n, 3), m, or None for PE.
        lost: rows with a cell that holds no number, which have no answer.

    Raises:
        ConfigError: Players are not numbered from 0 on, there are too many, or a side has none; or as `match_teams`.
    """
    P, E = (_places(player, names, column) for player in _AXES)
    there = [np.isfinite(places).any(axis=-1) for places in (P, E)]
    answers = {name: np.full(*spec) for name, spec in _blank(len(P), P.shape[1], E.shape[1]).items()}
    patterns, rows = np.unique(np.concatenate(there, axis=1), axis=0, return_inverse=True)
    for number, pattern in enumerate(patterns):
        row = np.array([one for one in np.flatnonzero(rows.reshape(-1) == number) if one not in lost], dtype=np.intp)
        pursuers, evaders = np.flatnonzero(pattern[: P.shape[1]]), np.flatnonzero(pattern[P.shape[1] :])
        if len(row) and len(pursuers) and len(evaders):
            goal = None if target is None else target[row][:, None]
            found = match_teams(_of_rows(game, row), P[np.ix_(row, pursuers)], E[np.ix_(row, evaders)], goal)
            for name, part in _columns(found, pursuers, evaders):
                answers[name][row] = part
    return answers


def _of_rows(game: Game, row: NDArray[np.intp]) -> Game:
    """Return the game of some rows; a speed ratio of each is that of all its pursuers."""
    if not isinstance(game.pursuer, Ball) or not np.ndim(game.pursuer.speed_m_s):
        return game
    return replace(game, pursuer=Ball(np.asarray(game.pursuer.speed_m_s)[row][:, None, None]))


def _places(player: str, names: set[str], column: Column) -> NDArray[np.float64]:
    """Return the positions of a side, (n, players, 3); the ground is at 0."""
    numbers = {int(found[2]) for found in map(_PLAYER.fullmatch, names) if found and found[1] == player}
    if not numbers or numbers != set(range(len(numbers))) or len(numbers) > MOST:
        raise ConfigError(
            f"--states: the columns number the {player}s {sorted(numbers)}; they must be 0, 1, 2 and so on, "
            f"{MOST} at most: {', '.join(f'{player}_0_{axis}_m' for axis in _AXES[player])}, {player}_1_x_m …"
        )
    places = [[column(f"{player}_{number}_{axis}_m") for axis in _AXES[player]] for number in sorted(numbers)]
    level = np.moveaxis(np.array(places), -1, 0)
    ground = np.where(np.isfinite(level[..., :1]), 0.0, np.nan)
    return level if player == "pursuer" else np.concatenate([level, ground], axis=-1)


def _blank(rows: int, pursuers: int, evaders: int) -> dict[str, tuple[int, Any, Any]]:
    """Return the columns of answers by name, each with its length, what is in it where there is none, and its type."""
    nobody, number = (rows, -1, np.int64), (rows, np.nan, np.float64)
    columns: dict[str, tuple[int, Any, Any]] = {"guaranteed": (rows, 0, np.int64), "total": number}
    for i in range(pursuers):
        columns[f"pursuer_{i}_evader"] = nobody
        columns |= {f"pursuer_{i}_velocity_{axis}_m_s": number for axis in "xyz"}
    for j in range(evaders):
        columns |= {f"evader_{j}_winner": (rows, Winner.UNDECIDED.word, "<U32"), f"evader_{j}_first": nobody}
        columns |= {f"evader_{j}_second": nobody, f"evader_{j}_value": number, f"evader_{j}_lower_bound": number}
        columns |= {f"evader_{j}_meeting_point_{axis}_m": number for axis in "xy"}
        columns |= {f"evader_{j}_velocity_{axis}_m_s": number for axis in "xy"}
        columns[f"evader_{j}_reason"] = (rows, Reason.NOT_FINITE.word, "<U32")
    return columns


def _columns(found: Matching, pursuers: NDArray[np.intp], evaders: NDArray[np.intp]) -> Iterator[tuple[str, Any]]:
    """Yield the columns of a matching, its players by their numbers in the file."""
    of_pursuers, of_evaders = np.append(pursuers, -1), np.append(evaders, -1)
    yield "guaranteed", found.guaranteed
    yield "total", found.total
    for place, i in enumerate(pursuers):
        yield f"pursuer_{i}_evader", of_evaders[found.evader_of[:, place]]
        for axis, name in enumerate("xyz"):
            yield f"pursuer_{i}_velocity_{name}_m_s", found.pursuer_velocity_m_s[:, place, axis]
    for place, j in enumerate(evaders):
        yield f"evader_{j}_winner", [Winner(code).word for code in found.winner[:, place].tolist()]
        yield f"evader_{j}_first", of_pursuers[found.first[:, place]]
        yield f"evader_{j}_second", of_pursuers[found.second[:, place]]
        yield f"evader_{j}_value", found.value[:, place]
        yield f"evader_{j}_lower_bound", found.lower_bound[:, place]
        for axis, name in enumerate("xy"):
            yield f"evader_{j}_meeting_point_{name}_m", found.meeting_point_m[:, place, axis]
            yield f"evader_{j}_velocity_{name}_m_s", found.evader_velocity_m_s[:, place, axis]
        yield f"evader_{j}_reason", [Reason(code).word for code in found.reason[:, place].tolist()]
