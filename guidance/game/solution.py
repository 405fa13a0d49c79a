"""The one entry: what both players do from a state of a game, for one state or a million."""

from contextlib import AbstractContextManager, nullcontext
from typing import NamedTuple

import numpy as np
from array_api_compat import is_jax_namespace

from guidance.errors import ConfigError
from guidance.game.arrays import (
    Array,
    Library,
    Real,
    Space,
    codes,
    component,
    is_numpy,
    namespace,
    pack,
    select,
    spread,
)
from guidance.game.checks import is_finite
from guidance.game.game import Game, parameters, speed_in_hand
from guidance.game.pe import pursuit
from guidance.game.play import Play, take_apart
from guidance.game.reasons import Reason, Winner
from guidance.game.space import play_in_space
from guidance.game.tad import defence

NAN = float("nan")
ZERO_ALLOWED = ("capture_radius_m", "information_age_s", "radius_m", "height_m")


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


def solve(
    game: Game,
    pursuer: Array,
    evader: Array,
    target: Array | None = None,
    *,
    evader_velocity_m_s: Array | None = None,
) -> Solution:
    """Solve a game: PE without a target, TAD with one.

    Args:
        game: what is played.
        pursuer: position P, (..., 3), m, in the game frame: x and y in the evader's plane, z up.
        evader: position E, (..., 3), m; its height is the plane's.
        target: position T, (..., 3), m; its height counts only for an evader in space.
        evader_velocity_m_s: the evader's velocity as observed, (..., 3), where it is known. It matters only where the
            pursuer has nothing better to do than to follow: right above the evader, and once that is captured.

    Returns:
        Both players' optimal play from here. The strategies are feedback: solve again at every step.

    Raises:
        ConfigError: an argument is not an array (..., 3), the shapes do not fit each other, or a single state is not
            finite. In a batch (and for a single JAX state, which may be traced) such a row is NaN instead.
    """
    seen = evader_velocity_m_s
    given = {"pursuer": pursuer, "evader": evader, "target": target, "evader_velocity_m_s": seen}
    given = {name: array for name, array in given.items() if array is not None}
    shape = leading_shape(game, given)
    xp = namespace(*given.values())
    with quiet(xp):
        play = _play(xp, game, pursuer, evader, target, seen)
        fault = _fault(xp, game, given)
        if shape == () and not is_jax_namespace(xp):
            _refuse(fault, given)
        return _put_together(xp, shape, pursuer, play, fault)


def leading_shape(game: Game, given: dict[str, Array]) -> tuple[int, ...]:
    """Return the common leading shape of named vectors and of the parameters that differ from row to row.

    Raises:
        ConfigError: a vector is not an array (..., 3), or the shapes do not broadcast.
    """
    shapes = {}
    for name, array in given.items():
        shape = getattr(array, "shape", None)
        if not shape or shape[-1] != 3:
            raise ConfigError(f"{name} = {array!r}: must be an array of shape (..., 3), not {shape}")
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


def quiet(xp: Library) -> AbstractContextManager[object]:
    """Keep NumPy from warning about the rows that `Reason` reports."""
    return np.errstate(all="ignore") if is_numpy(xp) else nullcontext()


def _play(xp: Library, game: Game, P: Array, E: Array, T: Array | None, seen: Array | None) -> Play:
    if game.evader_space == "space":
        return play_in_space(xp, game, P, E, T, seen)
    state = take_apart(xp, game, P, E, seen)
    if T is None:
        return pursuit(xp, game, state)
    return defence(xp, game, state, (component(T, 0), component(T, 1)))


def _fault(xp: Library, game: Game, given: dict[str, Array]) -> Array:
    """Return 0, or the reason why a row can have no answer. NaN and infinity stay what they are in a sum."""
    total: Real = 0.0
    for array in given.values():
        total = total + (component(array, 0) + component(array, 1) + component(array, 2))
    fault = select(xp, total - total == 0, int(Reason.SOLVED), int(Reason.NOT_FINITE))
    if not game.varies:
        return fault
    fault = select(xp, speed_in_hand(game) > 0, fault, int(Reason.PURSUER_TOO_SLOW))
    for name, value in parameters(game).items():
        allowed = (value >= 0 if name in ZERO_ALLOWED else value > 0) & (value - value == 0)
        fault = select(xp, allowed, fault, int(Reason.OUT_OF_RANGE))
    return fault


def _refuse(fault: Array, given: dict[str, Array]) -> None:
    """Refuse a single state that is not finite, by name."""
    if fault == Reason.NOT_FINITE:
        wrong = [f"{name} = {array!r}" for name, array in given.items() if not all(map(is_finite, array.tolist()))]
        raise ConfigError(f"{', '.join(wrong) or 'the sum of all positions'}: must be finite numbers")


def _put_together(xp: Library, shape: tuple[int, ...], like: Array, play: Play, fault: Array) -> Solution:
    """Put the components of an answer together, with NaN in the rows that have none."""
    sound = fault == 0
    spoil = select(xp, sound, 0.0, NAN)

    def number(value: Real) -> Array:
        return spread(xp, shape, like, value, spoil)

    def vector(v: Space) -> Array:
        return pack(xp, shape, like, v, spoil)

    return Solution(
        winner=codes(xp, shape, like, select(xp, sound, play.winner, int(Winner.UNDECIDED))),
        value=number(play.value),
        margin_s=number(play.margin),
        meeting_point_m=vector(play.meeting),
        meeting_time_s=number(play.time),
        pursuer_velocity_m_s=vector(play.pursuer),
        evader_velocity_m_s=vector(play.evader),
        reason=codes(xp, shape, like, select(xp, sound, play.reason, fault)),
    )
