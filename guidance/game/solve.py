"""The one entry: what both players do from a state of a game, for one state or a million."""

import math
from contextlib import nullcontext
from typing import Any, NamedTuple

import numpy as np

from guidance.errors import ConfigError
from guidance.game.arrays import Array, component, is_numpy, namespace, pack, select, spread
from guidance.game.game import Game, speed_in_hand
from guidance.game.pe import pursuit
from guidance.game.play import Play, take_apart
from guidance.game.reasons import Reason, Winner
from guidance.game.tad import defence


class Solution(NamedTuple):
    """The answer of `solve`, every field of the leading shape of the state, vectors with a last axis of 3.

    A row without an answer is NaN throughout, `winner` UNDECIDED, and `reason` tells why.
    """

    winner: Array
    """`Winner`: 1 the pursuer, −1 the evader, 0 neither (the barrier itself, or no answer)."""
    value: Array
    """PE: time to capture, s. TAD: distance of the evader from its target at the capture, m; where the evader wins, the
    distance that the pursuer is short of a capture when the evader arrives, m."""
    margin_s: Array
    """How much sooner the pursuer can guard the target than the evader arrives, s; the barrier is 0. Infinite in PE."""
    meeting_point_m: Array
    """Where the evader is when the game ends: q* in PE, g* in TAD, the target where the evader wins, m."""
    meeting_time_s: Array
    """When that is, from now, s."""
    pursuer_velocity_m_s: Array
    """Optimal velocity of the pursuer over the ground (through the air plus the wind), m/s."""
    evader_velocity_m_s: Array
    """Optimal velocity of the evader, m/s."""
    reason: Array
    """`Reason`: solved, a degenerate state, or why there is no answer."""


def solve(
    game: Game, pursuer: Array, evader: Array, target: Array | None = None, *, evader_velocity_m_s: Array | None = None
) -> Solution:
    """Solve a game: PE without a target, TAD with one.

    Args:
        game: what is played.
        pursuer: position P, (..., 3), m, in the game frame: x and y in the evader's plane, z up.
        evader: position E, (..., 3), m; its height is the plane's.
        target: position T, (..., 3), m; its height does not count.
        evader_velocity_m_s: the evader's velocity as observed, (..., 3), if known. It matters only where the pursuer has
            nothing better to do than to follow: right above the evader, and once it is captured.

    Returns:
        Both players' optimal play from here. Recompute it at every step: the strategies are feedback.

    Raises:
        ConfigError: a shape does not end in 3, shapes do not fit, or a single state is not finite. In a batch such a row
            is NaN instead.
    """
    seen = evader_velocity_m_s
    given = {"pursuer": pursuer, "evader": evader}
    if target is not None:
        given["target"] = target
    if seen is not None:
        given["evader_velocity_m_s"] = seen
    shape = leading_shape(given)
    xp = namespace(*given.values())
    with np.errstate(all="ignore") if is_numpy(xp) else nullcontext():
        state = take_apart(xp, game, pursuer, evader, seen)
        if target is None:
            play = pursuit(xp, game, state)
        else:
            play = defence(xp, game, state, (component(target, 0), component(target, 1)))
        fault = _fault(xp, game, given)
        if not shape:
            _refuse(fault, given)
        return _put_together(xp, shape, pursuer, play, fault)


def leading_shape(given: dict[str, Array]) -> tuple[int, ...]:
    """Return the common leading shape of named vectors.

    Raises:
        ConfigError: one does not end in 3, or they do not broadcast.
    """
    shapes = set()
    for name, array in given.items():
        shape = getattr(array, "shape", None)
        if shape is None or not shape or shape[-1] != 3:
            raise ConfigError(
                f"{name}: an array of shape (..., 3) is needed, not {type(array).__name__} of shape {shape}"
            )
        shapes.add(tuple(shape[:-1]))
    if len(shapes) == 1:
        return shapes.pop()
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError:
        listed = ", ".join(f"{name} {tuple(array.shape)}" for name, array in given.items())
        raise ConfigError(f"shapes do not fit each other: {listed}") from None


def _fault(xp: Any, game: Game, given: dict[str, Array]) -> Array:  # noqa: ANN401
    """Return 0, or the reason why a row can have no answer."""
    total: Any = 0.0
    for array in given.values():
        total = total + component(array, 0) + component(array, 1) + component(array, 2)
    fault = select(xp, total - total == 0, 0, int(Reason.NOT_FINITE))
    hand = speed_in_hand(game)
    if hasattr(hand, "shape") and hand.shape:
        fault = select(xp, hand > 0, fault, int(Reason.PURSUER_TOO_SLOW))
    return fault


def _refuse(fault: Array, given: dict[str, Array]) -> None:
    if not fault:
        return
    for name, array in given.items():
        if not all(math.isfinite(float(part)) for part in array):
            raise ConfigError(f"{name} = {array!r}: must be finite numbers, in metres and seconds")


def _put_together(xp: Any, shape: tuple[int, ...], like: Array, play: Play, fault: Array) -> Solution:  # noqa: ANN401
    """Put the components of an answer together, with NaN in the rows that have none."""
    sound = fault == 0
    lost = float("nan")

    def number(value: Any) -> Array:  # noqa: ANN401
        return spread(xp, shape, like, select(xp, sound, value, lost))

    def vector(parts: Any) -> Array:  # noqa: ANN401
        return pack(xp, shape, like, *(select(xp, sound, part, lost) for part in parts))

    return Solution(
        winner=select(xp, sound, play.winner, int(Winner.UNDECIDED)),
        value=number(play.value),
        margin_s=number(play.margin),
        meeting_point_m=vector(play.meeting),
        meeting_time_s=number(play.time),
        pursuer_velocity_m_s=vector(play.pursuer),
        evader_velocity_m_s=vector(play.evader),
        reason=select(xp, sound, play.reason, fault),
    )
