"""The search over headings, for regions without a closed form: a fan of headings, narrowed around the best one.

Headings are written by the tangent of the half angle s from the direction to the target, ((1 − s²) e₁ + 2 s e₂) / (1 + s²),
which needs no trigonometry. A meeting point X closer to T than E itself lies less than 90° off that direction
(ρ ≤ 2 n·(T − E)), so |s| ≤ 1 is enough. The last digits of a heading are lost, √ε of it, where the value no longer
depends on it; the value keeps all of its own.
"""

from typing import Any

from guidance.game.arrays import Array, Plane, is_numpy, norm2, unit2
from guidance.game.game import Cylinder, Game, fan_out
from guidance.game.play import State
from guidance.game.reach import catch_time, planar_catch_time

FINENESS = 16
ROUNDS = 8


def closest_heading(
    xp: Any,  # noqa: ANN401
    game: Game,
    state: State,
    to_target: Plane,
    goal: Plane,
) -> tuple[Plane, Array]:
    """Return the run (x, y) of the evader that ends closest to the target, and the time to its end.

    Args:
        xp: array library.
        game: the game; of a Cylinder only the horizontal part is searched.
        state: the state.
        to_target: vector from the evader to the target now.
        goal: vector from the evader to where it could meet its target, the middle of the fan.
    """
    ahead = unit2(xp, goal, norm2(xp, goal))
    fan = _fan(xp, state.z)
    wide = fan_out(game)
    opened = State(*(_open(part) for part in state))
    to_target_wide, ahead_wide = _open(to_target), _open(ahead)
    centre, half = 0.0 * state.z, 1.0
    for _ in range(ROUNDS):
        s = _open(centre) + half * fan
        run, t = _run(xp, wide, opened, ahead_wide, s)
        best = xp.argmin(_left(xp, wide, to_target_wide, run, t), axis=-1)
        centre = centre + half * (_number(xp, best, fan) / FINENESS - 1.0)
        half = half / FINENESS
    return _run(xp, game, state, ahead, centre)


def _run(xp: Any, game: Game, state: State, ahead: Plane, s: Array) -> tuple[Plane, Array]:  # noqa: ANN401
    """Follow heading s until the capture."""
    v, age, wind = game.evader_speed_m_s, game.information_age_s, game.wind_m_s
    scale = 1.0 / (1.0 + s * s)
    along, across = (1.0 - s * s) * scale, 2.0 * s * scale
    n = (along * ahead[0] - across * ahead[1], along * ahead[1] + across * ahead[0])
    y = (state.to_evader[0] + v * age * n[0], state.to_evader[1] + v * age * n[1])
    m = (v * n[0] - wind[0], v * n[1] - wind[1])
    if isinstance(game.pursuer, Cylinder):
        t = planar_catch_time(xp, game, game.pursuer, y, m)
    else:
        t = catch_time(xp, game, y, m, state.z)
    length = v * (t + age)
    return (length * n[0], length * n[1]), t


def _left(xp: Any, game: Game, to_target: Plane, run: Plane, t: Array) -> Array:  # noqa: ANN401
    """Distance to the target when the run ends."""
    adrift = game.target_velocity_m_s
    return norm2(xp, (to_target[0] + adrift[0] * t - run[0], to_target[1] + adrift[1] * t - run[1]))


def _fan(xp: Any, like: Array) -> Array:  # noqa: ANN401
    """Return −1 … 1 in 2 · FINENESS steps, exact in binary."""
    steps = [index / FINENESS - 1.0 for index in range(2 * FINENESS + 1)]
    return (
        xp.asarray(steps, dtype=like.dtype) if is_numpy(xp) else xp.asarray(steps, dtype=like.dtype, device=like.device)
    )


def _number(xp: Any, index: Array, like: Array) -> Array:  # noqa: ANN401
    return index.astype(like.dtype) if is_numpy(xp) else xp.astype(index, like.dtype)


def _open(value: Any) -> Any:  # noqa: ANN401
    """Give a number, an array or a tuple of them one more axis at the end."""
    if isinstance(value, tuple):
        return tuple(_open(part) for part in value)
    return value[..., None] if hasattr(value, "shape") else value
