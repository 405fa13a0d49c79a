"""Proportional navigation, a guidance law for comparison with the game.

Pure proportional navigation in space (Zarchan, "Tactical and Strategic Missile Guidance", ch. 2 and 20; Shneydor,
"Missile Guidance and Pursuit", ch. 5): the velocity turns N times as fast as the line of sight to the stand-off disc,

    ω = N r × (v_E − v_P) / ‖r‖²,   v̇_P = ω × v_P.

A Ball turns its whole velocity. A Cylinder has separate speed bounds, so it uses the law in the plane, and flies to the
height of the disc at its vertical speed.

The additional term of augmented navigation, N/2 times the evader's acceleration, is zero here: an evader of these games
turns at once and runs straight between its turns.
"""

from typing import NamedTuple

from guidance.game.arrays import (
    Array,
    Library,
    Real,
    Space,
    dot3,
    plus2,
    plus3,
    times2,
    times3,
)
from guidance.game.game import Game
from guidance.game.pe import Geometry, fly_to, take_apart
from guidance.game.rows import vector_of
from guidance.game.tad import guard_time


class StrategyMemory(NamedTuple):
    """A policy's last command (..., 3), None at the start, and the time since its start (...).

    `turning_rad_s` is the mean rate of turn since the last command, (..., 3), where a simulation knows it; only
    proportional navigation uses it.
    """

    velocity_m_s: Array | None = None
    played_s: Real = 0.0
    turning_rad_s: Array | None = None


def proportional_navigation(
    game: Game,
    pursuer: Array,
    evader: Array,
    seen_m_s: Array,
    memory: StrategyMemory,
    *,
    dt_s: Real,
    gain: float,
) -> Array:
    """Turn `gain` times as fast as the line of sight does: (..., 3), m/s.

    The law needs its last command; without it, or if it leads away, the law starts on the line of sight.

    Args:
        game: The game.
        pursuer: P, (..., 3), m.
        evader: E, (..., 3), m.
        seen_m_s: The evader's velocity as observed, (..., 3).
        memory: The last command; without a mean rate of turn since then, that of this state is used.
        dt_s: Time since the last command, (...).
        gain: The navigation constant N, 3 to 5 as a rule; 1 is pure pursuit.
    """

    def law(
        xp: Library,
        game: Game,
        P: Space,
        E: Space,
        evader_velocity: Space,
        last: Space | None,
        rate: Space | None,
    ) -> Space:
        state = take_apart(xp, game, P, E, evader_velocity)
        before = (0.0, 0.0, 0.0) if last is None else last
        if rate is None:
            rate = _rate(xp, game, state, before, gain)
        turn = times3(dt_s, rate)
        if game.pursuer.separate:
            # Turn the horizontal velocity, and fly to the disc's height.
            zero = 0.0 * state.z
            sight = (*state.to_evader, zero)
            level_before = (before[0], before[1], zero)
            course = _turned(xp, sight, level_before, turn)
            to = times2(xp.norm2(state.to_evader), course[:2])
            from_evader = plus2(to, -1.0, state.to_evader)
            time_s = guard_time(xp, game, state, from_evader)
            return fly_to(xp, game, state, to, time_s)
        # Turn the whole velocity.
        sight = _sight(xp, game, state)
        wind = game.wind_m_s
        course = _turned(xp, sight, before, turn)
        pace = game.pursuer.ground_pace(xp, course, wind)
        met = game.pursuer.captured(
            xp, game.capture_radius_m, state.z, lambda: xp.norm2((sight[0], sight[1]))
        )
        ahead = (pace * course[0], pace * course[1])
        level = xp.select2(met, state.hold, ahead)
        return *level, xp.select(met, 0.0, pace * course[2])

    arguments = {"pursuer": pursuer, "evader": evader, "evader_velocity_m_s": seen_m_s}
    remembered = {"previous_m_s": memory.velocity_m_s, "turning_rad_s": memory.turning_rad_s}
    return vector_of(law, game, arguments | remembered)


def turning(
    game: Game, pursuer: Array, evader: Array, seen_m_s: Array, velocity_m_s: Array, gain: float
) -> Array:
    """Return the law's rate of turn, (..., 3), rad/s; arguments as of `proportional_navigation`."""

    def rate(
        xp: Library, game: Game, P: Space, E: Space, evader_velocity: Space, velocity: Space
    ) -> Space:
        return _rate(xp, game, take_apart(xp, game, P, E, evader_velocity), velocity, gain)

    arguments = {"pursuer": pursuer, "evader": evader, "evader_velocity_m_s": seen_m_s}
    return vector_of(rate, game, arguments | {"velocity_m_s": velocity_m_s})


def _rate(xp: Library, game: Game, state: Geometry, velocity: Space, gain: float) -> Space:
    """Return N r × (v_E − v_P) / ‖r‖², of a separate speed set in the plane."""
    (x, y, z) = velocity
    (run, rise) = state.hold
    sight = (*state.to_evader, 0.0 * state.z)
    climb = 0.0
    if not game.pursuer.separate:
        sight = _sight(xp, game, state)
        climb = z
    square = dot3(sight, sight)
    share = gain / (square + (square == 0))
    receding = (run - x, rise - y, 0.0 - climb)
    return times3(share, _cross(sight, receding))


def _sight(xp: Library, game: Game, state: Geometry) -> Space:
    """Return the vector from the pursuer to the nearest point of the disc."""
    distance = xp.norm2(state.to_evader)
    e = xp.unit2(state.to_evader, distance)
    reach = xp.maximum(distance - game.standoff.radius_m, 0.0)
    return reach * e[0], reach * e[1], -state.z


def _turned(xp: Library, sight: Space, previous: Space, turn: Space) -> Space:
    """Return the direction of the last course turned by a rotation vector, rad; the line of sight if that led away.

    The turn is Rodrigues' by the tangent of its half angle, which is exact for small angles and keeps the length.
    """
    far = xp.norm3(sight)
    ahead = times3(1.0 / xp.select(far > 0, far, 1.0), sight)
    half = times3(0.5, turn)
    speed = xp.norm3(previous)
    course = times3(1.0 / xp.select(speed > 0, speed, 1.0), previous)
    once = _cross(half, course)
    twice = _cross(half, plus3(course, 1.0, once))
    share = 2.0 / (1.0 + dot3(half, half))
    return xp.select_all(dot3(previous, sight) > 0, plus3(course, share, twice), ahead)


def _cross(a: Space, b: Space) -> Space:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
