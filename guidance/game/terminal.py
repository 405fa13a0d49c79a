"""How far a state is from its end, in time: from capture, and from the evader's arrival at its target."""

import math
from typing import NamedTuple

from guidance.game.arrays import Array, Library, component, larger, norm2, positive_part, select
from guidance.game.game import Ball, Game, horizontal_speed
from guidance.game.play import take_apart
from guidance.game.reach import TOUCH_M, vertical_speed

NANOSECOND_S = 1e-9


class Ahead(NamedTuple):
    """The least time, s, that must pass whatever the players do, before ...

    Attributes:
        capture_s: the evader can be captured.
        arrival_s: the evader can be at its target; infinite without one.
        turn_s: a Cylinder that is not level with its disc is so, and holds its height; infinite for a Ball.
    """

    capture_s: Array
    arrival_s: Array
    turn_s: Array


def look_ahead(xp: Library, game: Game, pursuer: Array, evader: Array, target: Array | None) -> Ahead:
    """Return the least times to the ends of a game, from positions (..., 3).

    A Cylinder's parts are met a little outside of where its pursuer holds, for it to come there.
    """
    state = take_apart(xp, game, pursuer, evader, None)
    closing = horizontal_speed(game.pursuer) + game.evader_speed_m_s + math.hypot(*game.wind_m_s)
    capture, turn = game.capture_radius_m, math.inf
    beside = state.distance - game.standoff.radius_m
    if isinstance(game.pursuer, Ball):
        ahead = positive_part(norm2(xp, (positive_part(beside), state.z)) - capture) / closing
    else:
        met = capture + 2.0 * TOUCH_M
        above = (abs(state.z) - met) / vertical_speed(xp, game.pursuer, state.z)
        ahead = positive_part(larger(xp, (beside - met) / closing, above))
        over = abs(state.z) - capture
        inside = (over - 0.5 * TOUCH_M) / vertical_speed(xp, game.pursuer, state.z)
        turn = select(xp, over > TOUCH_M, inside, math.inf)
    if target is None:
        return Ahead(ahead, math.inf, turn)
    x, y, z = (component(target, index) - component(evader, index) for index in range(3))
    rise = z if game.evader_space == "space" else 0.0 * z
    speed = game.evader_speed_m_s + math.hypot(*game.target_velocity_m_s)
    return Ahead(ahead, xp.sqrt(x * x + y * y + rise * rise) / speed, turn)
