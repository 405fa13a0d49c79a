"""The search over headings, for regions without a closed form: a fan of headings, narrowed around the best one.

A heading is written by the tangent s of its half angle from the direction to the target, as
((1 − s²) e₁ + 2 s e₂)/(1 + s²), which needs no trigonometry. A point X of the evader's region that is closer to T than
E itself lies less than 90° off that direction (‖X − E‖ ≤ 2 n·(T − E)), so |s| ≤ 1 is enough. A minimum hides the last
digits of where it is: the heading is good to √ε of its precision, the value to all of it.
"""

from guidance.game.arrays import Array, Library, Plane, constant, norm2, unit2
from guidance.game.game import Cylinder, Game, for_rows
from guidance.game.play import State
from guidance.game.reach import catch_time, level_catch_time

FINENESS = 16
ROUNDS = 8
FAN = tuple(index / FINENESS - 1.0 for index in range(2 * FINENESS + 1))
"""From −1 to 1, exact in binary."""


def closest_heading(xp: Library, game: Game, state: State, to_target: Plane, goal: Plane) -> tuple[Plane, Array]:
    """Return the run (x, y) of the evader that ends closest to the target, and the time from now to its end.

    Args:
        xp: array library.
        game: the game; of a Cylinder only the horizontal part is searched.
        state: the state.
        to_target: vector from the evader to the target now, m.
        goal: vector from the evader to where it could meet its target, the middle of the fan, m.
    """
    ahead = unit2(xp, goal, norm2(xp, goal))
    fan = constant(xp, state.z, FAN)
    wide, opened_target = for_rows(game, (..., None)), _open(to_target)
    evader, ground, to_evader, distance, z = (_open(part) for part in state[:-1])
    opened = State(evader, ground, to_evader, distance, z, None)
    centre, half = 0.0 * state.z, 1.0
    for _ in range(ROUNDS):
        run, t = _run(xp, wide, opened, _open(ahead), _open(centre) + half * fan)
        best = xp.argmin(_left2(wide, opened_target, run, t), axis=-1)
        centre = centre + half * fan[best]
        half = half / FINENESS
    return _run(xp, game, state, ahead, centre)


def _run(xp: Library, game: Game, state: State, ahead: Plane, s: Array) -> tuple[Plane, Array]:
    """Follow heading s until the capture."""
    v, age, wind = game.evader_speed_m_s, game.information_age_s, game.wind_m_s
    scale = 1.0 / (1.0 + s * s)
    along, across = (1.0 - s * s) * scale, 2.0 * s * scale
    n = (along * ahead[0] - across * ahead[1], along * ahead[1] + across * ahead[0])
    y = (state.to_evader[0] + v * age * n[0], state.to_evader[1] + v * age * n[1])
    m = (v * n[0] - wind[0], v * n[1] - wind[1])
    if isinstance(game.pursuer, Cylinder):
        t = level_catch_time(xp, game, game.pursuer, y, m)
    else:
        t = catch_time(xp, game, y, m, state.z)
    length = v * (t + age)
    return (length * n[0], length * n[1]), t


def _left2(game: Game, to_target: Plane, run: Plane, t: Array) -> Array:
    """Square of the distance to the target when the run ends."""
    adrift = game.target_velocity_m_s
    x, y = to_target[0] + adrift[0] * t - run[0], to_target[1] + adrift[1] * t - run[1]
    return x * x + y * y


def _open(value: Array) -> Array:
    """Give an array, or each of a tuple of them, one more axis at the end, for the fan; a number needs none."""
    if isinstance(value, tuple):
        return tuple(_open(part) for part in value)
    return value[..., None] if hasattr(value, "shape") else value
