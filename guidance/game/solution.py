"""Solve a game: both players' optimal play from one state or a million.

Large batches are solved in chunks that fit into the processor's cache, five times faster than in one piece. A single
state is solved with Python's floats. The answers are the same to the bit.
"""

import math
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from array_api_compat import is_jax_array
from numpy.typing import ArrayLike

from guidance.errors import ConfigError
from guidance.game.apollonius import play_in_space
from guidance.game.arrays import (
    FLOATS,
    NUMPY,
    Array,
    Library,
    Real,
    Space,
    Truth,
    components,
    vectors,
)
from guidance.game.game import Game, Reason, Winner, guaranteed_age_s
from guidance.game.pe import StateSolution, pursuit, take_apart
from guidance.game.records import is_finite
from guidance.game.rows import (
    for_rows,
    leading_shape,
    most_squares,
    refused_rows,
    simplified,
    squares,
    varying,
)
from guidance.game.tad import defence

NAMES = ("pursuer", "evader", "target", "evader_velocity_m_s")

ROWS = 12288
"""Rows of a chunk: about forty intermediate arrays of 96 KiB stay in the processor's cache."""

_FEW = 6
"""Rows that are solved one by one, because Python's floats are faster than NumPy's arrays then."""

# Glibc keeps freed memory for the next chunk only after it has seen a block of this size freed
np.empty(64 * ROWS)


class Solution(NamedTuple):
    """The answer of `solve`. Every field has the leading shape of the states, vectors a last axis of 3.

    A row without an answer is NaN throughout, its winner UNDECIDED, and its reason tells why.

    Attributes:
        winner: `Winner`: 1 the pursuer, −1 the evader, 0 neither (the barrier itself, or no answer).
        value: PE: time to the capture, s. TAD: distance of the evader from its target at the capture, m; if the
            evader wins, the distance that the pursuer is short of a capture when the evader arrives, m.
        margin_s: how much sooner the pursuer can guard the target than the evader can be there, s: 0 on the barrier,
            negative where the evader wins, infinite in PE, where a faster pursuer always captures.
        meeting_point_m: position of the evader at the end of the game, m: q* in PE, g* in TAD, its target if it wins.
        meeting_time_s: time until then, s.
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
        game: the game.
        pursuer: position P, (..., 3), m, in the game frame: x and y in the evader's plane, z up.
        evader: position E, (..., 3), m; its height is the plane's.
        target: position T, (..., 3), m; its height counts only for an evader in space.
        evader_velocity_m_s: the evader's velocity as observed, (..., 3), if known. It matters only if the pursuer
            follows the evader: right above it, or once it has reached the disc.
        out: an earlier answer of the same shape whose NumPy arrays are filled again; allocating memory takes as long
            as the mathematics.

    Integers and lists are allowed; the answer has the widest precision among the arguments.

    PyTorch and JAX differentiate `value` and `margin_s` by positions and parameters, also where a parameter is an array
    with zeros. There is no derivative where the winner changes (`value`), where the evader is captured or at its
    target, right above the evader, and where two headings or two points of a target's shape are equally good; one
    side's, or zero, is returned. Numbers that are not arrays are constants, winner and reason are codes. Meeting point
    and velocities can be differentiated only if the target is a point.

    Returns:
        Both players' optimal play from here. The policies are feedback: solve again at every step.

    Raises:
        ConfigError: an argument is no array (..., 3) of numbers, the shapes do not fit each other, or a single state is
            not finite. In a batch (and for a single JAX state, which may be traced) such a row is NaN instead.
    """
    state = (pursuer, evader, target, evader_velocity_m_s)
    named: dict[str, Any] = {
        name: value for name, value in zip(NAMES, state, strict=True) if value is not None
    }
    xp, named = vectors(named, varying(game))
    shape = leading_shape(game, named)
    if out is not None and out.value.shape != shape:
        raise ConfigError(
            f"out: its leading shape is {tuple(out.value.shape)}; must be that of the states, {shape}"
        )
    if xp is NUMPY and shape:
        return _solve_rows(simplified(game), shape, named, out)
    if xp is not NUMPY or named["pursuer"].dtype != np.float64:
        return _solve(xp, game, shape, named, out)
    # Ten times faster
    answer = solve_state(game, **{name: tuple(value.tolist()) for name, value in named.items()})
    _refuse(answer.reason, named)
    if out is None:
        out = _empty((), named["pursuer"])
    for field, value in zip(out, answer, strict=True):
        field[...] = value
    return out


def _solve(
    xp: Library, game: Game, shape: tuple[int, ...], named: dict[str, Array], out: Solution | None
) -> Solution:
    """Solve in one piece, with NaN in rows without an answer."""
    like = named["pursuer"]
    with np.errstate(all="ignore"):
        T, observed = (components(named[name]) if name in named else None for name in NAMES[2:])
        play = _play(xp, game, components(like), components(named["evader"]), T, observed)
        # The kind of each row's answer, or why it has none.
        in_pe = "target" not in named
        reason = _aged(xp, game, play, in_pe=in_pe)
        numbers = _sum(play, in_pe=in_pe)
        # A sum over all rows is finite only if every row is: most batches need no more.
        if xp is not NUMPY or xp.any(
            _is_sound(game, float(np.add.reduce(numbers, axis=None)), most_squares(named)) == 0
        ):
            sound = _is_sound(game, numbers, squares(named))
            zero = sum(0.0 * part for array in named.values() for part in components(array))
            reason = xp.select(
                sound, reason, xp.select(zero == 0, int(Reason.OVERFLOW), int(Reason.NOT_FINITE))
            )
        if game.varies:
            reason = refused_rows(xp, game, reason)
        if shape == () and not is_jax_array(like):
            _refuse(int(reason), named)
        answered = reason < int(Reason.NOT_FINITE)
        spoil = xp.select(answered, 0.0, math.nan)
        winner = xp.select(answered, play.winner, int(Winner.UNDECIDED))
        if xp is not NUMPY:
            winner, reason = (
                xp.astype(xp.pack(shape, like, code), xp.int8) for code in (winner, reason)
            )
            return Solution(
                *[winner, *(xp.pack(shape, like, part, spoil) for part in play[1:-1]), reason]
            )
        if out is None:
            out = _empty(shape, like)
        out.winner[...] = winner
        out.reason[...] = reason
        for field, part in zip(out[1:-1], play[1:-1], strict=True):
            NUMPY.fill(field, part, spoil)
        return out


def solve_state(
    game: Game,
    pursuer: Space,
    evader: Space,
    target: Space | None = None,
    *,
    evader_velocity_m_s: Space | None = None,
) -> StateSolution:
    """Solve one state of plain numbers, with the same bits as `solve` and without arrays; a flight does it every cycle.

    Args:
        game: the game, without arrays among its parameters.
        pursuer: position P, m: three floats.
        evader: position E, m.
        target: position T, m; None in PE.
        evader_velocity_m_s: the evader's velocity as observed, if known.

    Returns:
        The answer. A state without an answer is NaN throughout, as a row of a batch is.

    Raises:
        ConfigError: a parameter of the game is an array.
    """
    if game.varies:
        raise ConfigError(
            f"game = {game!r}: solve_state takes single numbers; use solve for arrays"
        )
    # Elements of a NumPy array are not Python's floats.
    state: list[Any] = [
        None if vector is None else tuple(map(float, vector))
        for vector in (pursuer, evader, target, evader_velocity_m_s)
    ]
    P, E, T, observed = state
    squares = sum(x * x + y * y + z * z for x, y, z in filter(None, state))
    try:
        play = _play(FLOATS, game, P, E, T, observed)
    except (ZeroDivisionError, ValueError):  # what NumPy answers where a number is divided by zero
        return _row_of_one(game, state)
    reason = _aged(FLOATS, game, play, in_pe=target is None)
    if reason == Reason.NO_REGION or not _is_sound(game, _sum(play, in_pe=target is None), squares):
        return _row_of_one(game, state)
    # Zero is added because a batch has no negative zeros.
    plain: list[Any] = [
        tuple([v + 0.0 for v in part]) if isinstance(part, tuple) else part + 0.0
        for part in play[1:-1]
    ]
    return StateSolution._make((int(play.winner), *plain, int(reason)))


def _row_of_one(game: Game, state: list[Space | None]) -> StateSolution:
    """Solve a single state as a batch of one."""
    named = {
        name: np.array([vector], float)
        for name, vector in zip(NAMES, state, strict=True)
        if vector is not None
    }
    row = (column[0].tolist() for column in _solve(NUMPY, game, (1,), named, None))
    plain: list[Any] = [tuple(value) if isinstance(value, list) else value for value in row]
    return StateSolution(*plain)


def _solve_rows(
    game: Game, shape: tuple[int, ...], named: dict[str, Array], out: Solution | None
) -> Solution:
    """Solve a batch, a short one row by row and a long one chunk by chunk."""
    count = math.prod(shape)
    like = named["pursuer"]
    if 0 < count <= _FEW and not game.varies and like.dtype == np.float64:
        vectors_of_rows = [
            np.broadcast_to(named[name], (*shape, 3)).reshape(count, 3).tolist()
            if name in named
            else [None] * count
            for name in NAMES
        ]
        answers = [
            solve_state(game, P, E, T, evader_velocity_m_s=observed)
            for P, E, T, observed in zip(*vectors_of_rows, strict=True)
        ]
        if out is None:
            out = _empty(shape, like)
        for field, column in zip(out, zip(*answers, strict=True), strict=True):
            field[...] = np.array(column).reshape(field.shape)
        return out
    # A shape takes many calls for a few rows each, which cost as much for a long chunk as for a short one
    chunk_rows = ROWS if game.target_extent.is_point else 2 * ROWS
    if count <= chunk_rows:
        if not game.target_extent.is_point:
            # Kernels choose rows by the game and the vectors, so both need the whole leading shape.
            game = for_rows(game, lambda value: np.broadcast_to(value, shape))
            if any(vector.shape[:-1] != shape for vector in named.values()):
                named = {
                    name: np.broadcast_to(vector, (*shape, 3)) for name, vector in named.items()
                }
        return _solve(NUMPY, game, shape, named, out)
    if out is None:
        out = _empty(shape, like)
    rows = {
        name: np.broadcast_to(value, (*shape, 3)).reshape(count, 3) for name, value in named.items()
    }
    game = for_rows(game, lambda value: np.broadcast_to(value, shape).reshape(count))
    flat_out = out if len(shape) == 1 else _empty((count,), like)
    for start in range(0, count, chunk_rows):
        part = slice(start, start + chunk_rows)
        chunk = {name: value[part] for name, value in rows.items()}
        chunk_game = for_rows(game, itemgetter(part))
        _solve(
            NUMPY,
            chunk_game,
            chunk["pursuer"].shape[:1],
            chunk,
            Solution(*(field[part] for field in flat_out)),
        )
    if flat_out is not out:
        for field, flat in zip(out, flat_out, strict=True):
            field[...] = flat.reshape(field.shape)
    return out


def _play(
    xp: Library, game: Game, P: Space, E: Space, T: Space | None, observed: Space | None
) -> StateSolution:
    if game.evader_space == "space":
        return play_in_space(xp, game, P, E, T, observed)
    state = take_apart(xp, game, P, E, observed)
    return pursuit(xp, game, state) if T is None else defence(xp, game, state, T[:2])


def _sum(play: StateSolution, *, in_pe: bool) -> Real:
    """Return a number that is finite if the answer is. In PE the value is the time, and the margin is infinite."""
    x, y, _ = play.meeting_point_m
    total = play.value + x + y
    return total if in_pe else total + play.meeting_time_s + play.margin_s


def _is_sound(game: Game, numbers: Real, squares: Real) -> Truth:
    """Return whether an answer is finite, and no square inside the kernels can have been infinite.

    Args:
        game: the game.
        numbers: sum of the answer's numbers.
        squares: sum of the squares of all positions and velocities, or more.
    """
    standoff = game.standoff
    u = game.pursuer.horizontal_m_s
    length = (
        standoff.radius_m + standoff.height_m + game.capture_radius_m + u * game.information_age_s
    )
    square = u * u
    total = numbers + (squares + length * length) * square * square
    return total - total == 0


def _refuse(fault: Real, named: dict[str, Array]) -> None:
    """Refuse a single state that is not finite, with the argument's name."""
    if fault == Reason.NOT_FINITE:
        wrong = [
            f"{name} = {array!r}"
            for name, array in named.items()
            if not all(map(is_finite, array.tolist()))
        ]
        raise ConfigError(f"{', '.join(wrong)}: must be finite numbers")


def _aged(xp: Library, game: Game, play: StateSolution, *, in_pe: bool) -> Real:
    """Return the reason, which is TOO_OLD or NO_REGION for a prediction from old information; facts keep theirs.

    There is no region where the evader of TAD was seen too long ago for a convex one, and the pursuer would win.
    """
    age = game.information_age_s
    guaranteed = guaranteed_age_s(game)
    fact = play.reason
    old = age > (guaranteed if in_pe else 0.0)
    reason = fact
    if old is not False:
        promise = (fact == Reason.SOLVED) | (fact == Reason.OVERHEAD) | (fact == Reason.ON_BARRIER)
        reason = xp.select(promise & old, int(Reason.TOO_OLD), fact)
    dented = not in_pe and age > guaranteed
    if dented is False:
        return reason
    return xp.select(
        dented & (play.winner > 0) & (fact != int(Reason.CAPTURED)), int(Reason.NO_REGION), reason
    )


def _empty(shape: tuple[int, ...], like: Array) -> Solution:
    """Make the arrays of an answer."""
    number = (shape, like.dtype)
    vector = ((*shape, 3), like.dtype)
    code = (shape, np.int8)
    kinds = (code, number, number, vector, number, vector, vector, code)
    return Solution(*(np.empty(size, dtype=dtype) for size, dtype in kinds))
