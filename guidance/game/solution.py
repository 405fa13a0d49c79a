"""The one entry: what both players do from a state of a game, for one state or a million.

Millions are solved in chunks that stay in the processor's cache, at five times the speed of one call for all of them,
and one is solved in Python's own floats; the answer is the same to the bit.
"""

import math
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from array_api_compat import is_jax_namespace
from numpy.typing import ArrayLike

from guidance.errors import ConfigError
from guidance.game.arrays import (
    FLOATS,
    Array,
    Library,
    Real,
    Space,
    Truth,
    codes,
    components,
    fill,
    is_array,
    is_numpy,
    pack,
    quiet,
    select,
    spread,
    vectors,
)
from guidance.game.game import (
    Game,
    Reason,
    Winner,
    for_rows,
    guaranteed_age_s,
    parameters,
    simplified,
    speed_in_hand,
)
from guidance.game.pe import pursuit
from guidance.game.reach import Play, take_apart
from guidance.game.records import is_finite, is_zero
from guidance.game.space import play_in_space
from guidance.game.tad import defence

NAN = float("nan")
SIGNED = ("wind_x_m_s", "wind_y_m_s")
ZERO_ALLOWED = ("capture_radius_m", "information_age_s", "radius_m", "height_m")

ROWS = 8192
"""Rows of a chunk: some forty intermediate arrays of 64 KiB, about a level 2 cache's worth."""


Place: TypeAlias = tuple[float, float, float]
"""A place or a velocity of one state: x, y and z."""


class Solution(NamedTuple):
    """The answer of `solve`. Every field has the leading shape of the states, vectors a last axis of 3.

    A row without an answer is NaN throughout, its winner UNDECIDED, and its reason tells why.

    Attributes:
        winner: `Winner`: 1 the pursuer, −1 the evader, 0 neither (the barrier itself, or no answer).
        value: PE: time to the capture, s. TAD: distance of the evader from its target at the capture, m; where the
            evader wins, the distance that the pursuer is short of a capture when the evader arrives, m.
        margin_s: how much sooner the pursuer can guard the target than the evader can be there, s: 0 on the barrier,
            negative where the evader wins, infinite in PE, where a faster pursuer always captures.
        meeting_point_m: where the evader is when the game ends: q* in PE, g* in TAD, its target where it wins, m.
        meeting_time_s: when that is, from now, s.
        pursuer_velocity_m_s: the pursuer's optimal velocity over the ground (through the air plus the wind), m/s.
        evader_velocity_m_s: the evader's optimal velocity, m/s.
        reason: `Reason`: solved, a degenerate state, or why there is no answer.
    """

    winner: Array
    value: Array
    margin_s: Array
    meeting_point_m: Array
    meeting_time_s: Array
    pursuer_velocity_m_s: Array
    evader_velocity_m_s: Array
    reason: Array


class StateSolution(NamedTuple):
    """The answer of `solve_state`: what a `Solution` says of one state, in plain numbers."""

    winner: int
    value: float
    margin_s: float
    meeting_point_m: Place
    meeting_time_s: float
    pursuer_velocity_m_s: Place
    evader_velocity_m_s: Place
    reason: int


def solve(
    game: Game,
    pursuer: ArrayLike,
    evader: ArrayLike,
    target: ArrayLike | None = None,
    *,
    evader_velocity_m_s: ArrayLike | None = None,
    out: Solution | None = None,
) -> Solution:
    """Solve a game: PE without a target, TAD with one.

    Args:
        game: what is played.
        pursuer: position P, (..., 3), m, in the game frame: x and y in the evader's plane, z up.
        evader: position E, (..., 3), m; its height is the plane's.
        target: position T, (..., 3), m; its height counts only for an evader in space.
        evader_velocity_m_s: the evader's velocity as observed, (..., 3), where it is known. It matters only where the
            pursuer has nothing better to do than to follow: right above the evader, and where it has met what it can.
        out: an earlier answer of the same shape whose NumPy arrays are filled again; fresh memory costs as much as the
            mathematics.

    Numbers of any kind are real numbers, integers and lists too; the answer has the widest precision among them.

    Returns:
        Both players' optimal play from here. The strategies are feedback: solve again at every step.

    Raises:
        ConfigError: an argument is no array (..., 3) of numbers, the shapes do not fit each other, or a single state is
            not finite. In a batch (and for a single JAX state, which may be traced) such a row is NaN instead.
    """
    given = {"pursuer": pursuer, "evader": evader, "target": target, "evader_velocity_m_s": evader_velocity_m_s}
    given = {name: value for name, value in given.items() if value is not None}
    varying = [value for value in parameters(game).values() if is_array(value)] if game.varies else []
    xp, given = vectors(given, varying)
    shape = leading_shape(game, given)
    if out is not None and out.value.shape != shape:
        raise ConfigError(f"out: its leading shape is {tuple(out.value.shape)}; must be that of the states, {shape}")
    if not is_numpy(xp):
        return _solve(xp, game, shape, given, None)
    if shape == ():
        return _solve_one(game, given, out)
    return _solve_rows(simplified(game), shape, given, out)


def _solve(xp: Library, game: Game, shape: tuple[int, ...], given: dict[str, Array], out: Solution | None) -> Solution:
    """Solve in one piece."""
    with quiet(xp):
        play = _play(xp, game, given)
        fault = _fault(xp, game, given, play)
        if shape == () and not is_jax_namespace(xp):
            _refuse(int(fault), given)
        return _put_together(xp, game, shape, given["pursuer"], play, fault, out)


def _solve_one(game: Game, given: dict[str, Array], out: Solution | None) -> Solution:
    """Solve a single state: in floats, which stop where a number is divided by zero, and leave that to NumPy."""
    like = given["pursuer"]
    if like.dtype != np.float64 or game.varies:
        return _solve(np, game, (), given, out)
    floats: dict[str, Array] = {name: tuple(value.tolist()) for name, value in given.items()}
    played = _play_floats(game, floats)
    if played is None:
        return _solve(np, game, (), given, out)
    play, fault = played
    _refuse(fault, given)
    if fault or out is not None:
        return _put_together(np, game, (), like, play, fault, out)
    return Solution(
        np.array(play.winner, np.int8),
        np.array(play.value + 0.0),
        np.array(play.margin + 0.0),
        np.array(_no_minus_zero(play.meeting)),
        np.array(play.time + 0.0),
        np.array(_no_minus_zero(play.pursuer)),
        np.array(_no_minus_zero(play.evader)),
        np.array(_doubted(FLOATS, game, play), np.int8),
    )


def solve_state(
    game: Game, pursuer: Place, evader: Place, target: Place | None = None, *, evader_velocity_m_s: Place | None = None
) -> StateSolution:
    """Solve one state of plain numbers, to the bit as `solve` does, without an array: what a flight asks every cycle.

    Args:
        game: what is played; none of its parameters is an array.
        pursuer: position P, m: three floats.
        evader: position E, m.
        target: position T, m; None in PE.
        evader_velocity_m_s: the evader's velocity as observed, where it is known.

    Returns:
        The answer. A state without an answer is NaN throughout, as a row of a batch is.

    Raises:
        ConfigError: a parameter of the game is an array.
    """
    if game.varies:
        raise ConfigError(f"game = {game!r}: a single state is played with single numbers; solve takes arrays of them")
    known = {"pursuer": pursuer, "evader": evader, "target": target, "evader_velocity_m_s": evader_velocity_m_s}
    given: dict[str, Array] = {name: value for name, value in known.items() if value is not None}
    played = _play_floats(game, given)
    if played is None or played[1]:
        rows = _solve(np, game, (1,), {name: np.array([value], float) for name, value in given.items()}, None)
        return StateSolution(*(_plain(column[0].tolist()) for column in rows))
    play, _ = played
    return StateSolution(
        int(play.winner),
        play.value + 0.0,
        play.margin + 0.0,
        _no_minus_zero(play.meeting),
        play.time + 0.0,
        _no_minus_zero(play.pursuer),
        _no_minus_zero(play.evader),
        int(_doubted(FLOATS, game, play)),
    )


def _play_floats(game: Game, given: dict[str, Array]) -> tuple[Play, int] | None:
    """Play a single state in floats, and say what is wrong with it; None where a number is divided by zero."""
    try:
        play = _play(FLOATS, game, given)
    except (ZeroDivisionError, ValueError):
        return None
    return play, int(_fault(FLOATS, game, given, play))


def _no_minus_zero(v: Space) -> Space:
    return v[0] + 0.0, v[1] + 0.0, v[2] + 0.0


def _plain(value: Any) -> Any:  # noqa: ANN401 - of each field what it holds
    return tuple(value) if isinstance(value, list) else value


def _solve_rows(game: Game, shape: tuple[int, ...], given: dict[str, Array], out: Solution | None) -> Solution:
    """Solve a batch, a long one chunk by chunk."""
    count = math.prod(shape)
    if count <= ROWS:
        return _solve(np, game, shape, given, out)
    like = given["pursuer"]
    out = out or _empty(shape, like)
    rows = {name: np.broadcast_to(value, (*shape, 3)).reshape(count, 3) for name, value in given.items()}
    if game.varies:
        game = for_rows(game, lambda value: np.broadcast_to(value, shape).reshape(count))
    whole = out if len(shape) == 1 else _empty((count,), like)
    for start in range(0, count, ROWS):
        part = slice(start, start + ROWS)
        chunk = {name: value[part] for name, value in rows.items()}
        few = for_rows(game, partial(_part, part))
        _solve(np, few, chunk["pursuer"].shape[:1], chunk, Solution(*(field[part] for field in whole)))
    if whole is not out:
        for field, flat in zip(out, whole, strict=True):
            field[...] = flat.reshape(field.shape)
    return out


def _part(part: slice, value: Array) -> Array:
    return value[part]


def leading_shape(game: Game, given: dict[str, Array]) -> tuple[int, ...]:
    """Return the common leading shape of named vectors and of the parameters that differ from row to row.

    Raises:
        ConfigError: a vector is not an array (..., 3), or the shapes do not broadcast.
    """
    shapes = {}
    for name, array in given.items():
        shape = array.shape
        if not shape or shape[-1] != 3:
            raise ConfigError(f"{name} = {array!r}: must be an array of shape (..., 3), not {tuple(shape)}")
        shapes[name] = tuple(shape[:-1])
    if game.varies:
        shapes |= {name: tuple(getattr(value, "shape", ())) for name, value in parameters(game).items()}
    different = set(shapes.values())
    if len(different) == 1:
        return different.pop()
    try:
        return np.broadcast_shapes(*different)
    except ValueError:
        raise ConfigError(f"the leading shapes do not fit each other: {shapes}") from None


def _play(xp: Library, game: Game, given: dict[str, Array]) -> Play:
    P, E, T, seen = (given.get(name) for name in ("pursuer", "evader", "target", "evader_velocity_m_s"))
    if game.evader_space == "space":
        return play_in_space(xp, game, P, E, T, seen)
    state = take_apart(xp, game, P, E, seen)
    if T is None:
        return pursuit(xp, game, state)
    return defence(xp, game, state, components(T)[:2])


def _fault(xp: Library, game: Game, given: dict[str, Array], play: Play) -> Real:
    """Return 0, or the reason why a row can have no answer."""
    answered: Real = sum((play.value, play.time, *play.meeting, *play.pursuer, *play.evader))
    if "target" in given:
        answered = answered + play.margin
    sound = _is_finite(answered + _largest_square(game, _most_squares(given) if xp is np else _squares(given)))
    fault: Real = int(Reason.SOLVED)
    if sound is not True and (not (xp is np or xp is FLOATS) or not _all(sound)):
        sound = _is_finite(answered + _largest_square(game, _squares(given)))
        nought = sum(0.0 * part for array in given.values() for part in components(array))
        fault = select(xp, sound, fault, select(xp, nought == 0, int(Reason.OVERFLOW), int(Reason.NOT_FINITE)))
    if not game.varies:
        return fault
    fault = select(xp, speed_in_hand(game) > 0, fault, int(Reason.PURSUER_TOO_SLOW))
    for name, value in parameters(game).items():
        allowed = _is_finite(value)
        if name not in SIGNED:
            allowed = allowed & (value >= 0 if name in ZERO_ALLOWED else value > 0)
        fault = select(xp, allowed, fault, int(Reason.OUT_OF_RANGE))
    return fault


def _squares(given: dict[str, Array]) -> Real:
    """Return the sum of the squares of all components, row by row."""
    total: Real = 0.0
    for array in given.values():
        x, y, z = array if type(array) is tuple else components(array)
        total = total + (x * x + y * y + z * z)
    return total


def _most_squares(given: dict[str, Array]) -> Real:
    """Return no less than any row's: of contiguous numbers the largest costs a tenth of the squares of all."""
    total: Real = 0.0
    for array in given.values():
        most = 2.0 * abs(array).max(initial=0.0)
        total = total + most * most
    return total


def _largest_square(game: Game, sizes: Real) -> Real:
    """Return more than any square that the kernels take: where it is infinite, theirs may have been."""
    standoff, u = game.standoff, game.pursuer.horizontal_m_s
    length = standoff.radius_m + standoff.height_m + game.capture_radius_m + u * game.information_age_s
    square = u * u
    return (sizes + length * length) * square * square


def _is_finite(value: Real) -> Truth:
    return value - value == 0


def _all(sound: Truth) -> bool:
    return sound if isinstance(sound, bool) else bool(sound.all())


def _refuse(fault: Real, given: dict[str, Array]) -> None:
    """Refuse a single state that is not finite, by name."""
    if fault == Reason.NOT_FINITE:
        wrong = [f"{name} = {array!r}" for name, array in given.items() if not all(map(is_finite, array.tolist()))]
        raise ConfigError(f"{', '.join(wrong)}: must be finite numbers")


def _put_together(
    xp: Library, game: Game, shape: tuple[int, ...], like: Array, play: Play, fault: Real, out: Solution | None
) -> Solution:
    """Put the components of an answer together, with NaN in the rows that have none."""
    sound = fault == 0
    spoil = select(xp, sound, 0.0, NAN)
    winner = select(xp, sound, play.winner, int(Winner.UNDECIDED))
    reason = select(xp, sound, _doubted(xp, game, play), fault)
    if not is_numpy(xp):
        return Solution(
            codes(xp, shape, like, winner),
            spread(xp, shape, like, play.value + spoil),
            spread(xp, shape, like, play.margin + spoil),
            pack(xp, shape, like, play.meeting, spoil),
            spread(xp, shape, like, play.time + spoil),
            pack(xp, shape, like, play.pursuer, spoil),
            pack(xp, shape, like, play.evader, spoil),
            codes(xp, shape, like, reason),
        )
    out = out or _empty(shape, like)
    parts = (winner, play.value, play.margin, play.meeting, play.time, play.pursuer, play.evader, reason)
    for field, part in zip(out, parts, strict=True):
        if isinstance(part, tuple):
            for index, one in enumerate(part):
                fill(field[..., index], one, spoil)
        elif field.dtype == np.int8:
            field[...] = part
        else:
            fill(field, part, spoil)
    return out


def _doubted(xp: Library, game: Game, play: Play) -> Real:
    """Say of what would be solved that the information is too old for it; a fact of this moment stays what it is.

    PE is known by its margin, infinite.
    """
    reason, age = play.reason, game.information_age_s
    if is_zero(age):
        return reason
    promise = (reason == Reason.SOLVED) | (reason == Reason.OVERHEAD) | (reason == Reason.ON_BARRIER)
    young = guaranteed_age_s(game) if isinstance(play.margin, float) and math.isinf(play.margin) else 0.0
    return select(xp, promise & (age > young), int(Reason.TOO_OLD), reason)


def _empty(shape: tuple[int, ...], like: Array) -> Solution:
    """Make the arrays of an answer."""
    number, vector, code = (shape, like.dtype), ((*shape, 3), like.dtype), (shape, np.int8)
    kinds = (code, number, number, vector, number, vector, vector, code)
    return Solution(*(np.empty(size, dtype=dtype) for size, dtype in kinds))
