"""Arguments of games of teams: which games they play, and arrays of their shapes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from guidance.errors import ConfigError
from guidance.game.game import Ball, Game

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from guidance.game.team.discs import Array

ALLOWED: dict[str, Any] = {
    "capture_radius_m": 0.0,
    "information_age_s": 0.0,
    "wind_m_s": (0.0, 0.0),
    "target_velocity_m_s": (0.0, 0.0),
    "evader_space": "plane",
}
"""The settings of a team's game that have one allowed value."""


_NO_DISC = "because only then the points that an evader reaches first form a disc"


def speeds(game: Game) -> tuple[Any, Any]:
    """Return the speeds of pursuers and evader of a game that teams play.

    Raises:
        ConfigError: If teams cannot play this game.
    """
    if not isinstance(game.pursuer, Ball):
        raise ConfigError(f"pursuer = {game.pursuer!r}: must be a Ball in a game of teams, {_NO_DISC}")
    for name, allowed in ALLOWED.items():
        value = getattr(game, name)
        varies = any(map(np.ndim, value if isinstance(value, tuple) else (value,)))
        if varies or value != allowed:
            raise ConfigError(f"{name} = {value!r}: must be {allowed!r} in a game of teams, {_NO_DISC}")
    radius_m, height_m = game.standoff.radius_m, game.standoff.height_m
    if np.ndim(radius_m) or radius_m != 0.0:
        raise ConfigError(f"standoff.radius_m = {radius_m!r}: must be 0.0 in a game of teams, {_NO_DISC}")
    if np.ndim(height_m):
        raise ConfigError(f"standoff.height_m = {height_m!r}: must be one number in a game of teams")
    return game.pursuer.speed_m_s, game.evader_speed_m_s


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


def with_speeds(game: Game, u: Any, v: Any) -> Game:  # noqa: ANN401 - numbers or arrays
    """Return a game with other speeds."""
    return replace(game, pursuer=Ball(u), evader_speed_m_s=v)


def vectors(name: str, array: ArrayLike, shape: str) -> Array:
    """Return an argument as an array of real numbers.

    Raises:
        ConfigError: If it is not an array of numbers of this shape, has masked elements, or holds no player.
    """
    try:
        found = np.asarray(array)
    except ValueError:  # lists of different lengths
        found = np.empty(0)
    axes = shape.count(",")
    nobody = axes > 1 and 0 in found.shape[-2:-1]
    if isinstance(array, np.ma.MaskedArray):
        raise ConfigError(f"{name} = {array!r}: must not be a masked array; leave those players out")
    if found.ndim < axes or nobody or found.shape[-1:] != (3,) or found.dtype.kind not in "fiu":
        raise ConfigError(f"{name} = {array!r}: must be an array of numbers of shape {shape}")
    return found if found.dtype.kind == "f" else found.astype(np.float64)


def fitting(shapes: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """Return the common shape of leading axes.

    Raises:
        ConfigError: If they do not fit each other.
    """
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        raise ConfigError(f"the leading shapes do not fit each other: {shapes}") from None


def in_play_of(given: ArrayLike | None, m: int) -> Array:
    """Return which evaders are in play, as truths."""
    if given is None:
        return np.ones(m, dtype=bool)
    try:
        present = np.asarray(given)
    except ValueError:  # lists of different lengths
        present = np.empty(0)
    if isinstance(given, np.ma.MaskedArray) or present.shape[-1:] != (m,) or not np.isin(present, (0, 1)).all():
        raise ConfigError(
            f"in_play = {given!r}: must say for each of {m} evaders whether it is in play, by true or false"
        )
    return present.astype(bool)


def spoiled(part: Array, sound: Array) -> Array:
    """Return a field of an answer with NaN, or zero where it holds no real numbers, in the rows without an answer."""
    mask = sound[(..., *[None] * (part.ndim - sound.ndim))]
    return np.where(mask, part, np.asarray(np.nan if part.dtype.kind == "f" else 0, dtype=part.dtype))
