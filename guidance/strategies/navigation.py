"""The guidance laws that a pursuit game is compared with: lead pursuit and proportional navigation.

Both act in the plane, as a missile's do in its plane of engagement, and leave height to the speed set, which levels out
on the disc: a Cylinder at its own pace, a Ball in proportion.
"""

from guidance.game.arrays import Array, Library, Plane, component, dot2, norm2, pack, select2, unit2, vectors
from guidance.game.game import Game
from guidance.game.reach import State, catch_time, steer, take_apart
from guidance.game.solution import leading_shape, quiet
from guidance.game.tad import guard_time


def lead_pursuit(
    game: Game, pursuer: Array, evader: Array, target: Array | None = None, evader_velocity_m_s: Array | None = None
) -> Array:
    """Fly to where the evader is caught if it keeps its velocity (the collision course): (..., 3), m/s.

    A `Policy` as those of `guidance.game`. Without an observed velocity it is pure pursuit.
    """
    del target
    seen = {} if evader_velocity_m_s is None else {"evader_velocity_m_s": evader_velocity_m_s}
    xp, given = vectors({"pursuer": pursuer, "evader": evader} | seen)
    shape, pursuer = leading_shape(game, given), given["pursuer"]
    with quiet(xp):
        state = take_apart(xp, game, pursuer, given["evader"], given.get("evader_velocity_m_s", 0.0 * given["evader"]))
        run, wind = state.hold, game.wind_m_s
        t = catch_time(xp, game, state.to_evader, (run[0] - wind[0], run[1] - wind[1]), state.z)
        to = (state.to_evader[0] + run[0] * t, state.to_evader[1] + run[1] * t)
        gap = norm2(xp, to) - game.standoff.radius_m - game.capture_radius_m
        return pack(xp, shape, pursuer, steer(xp, game, to, gap, t, state.z, state.hold))


def proportional_navigation(
    game: Game,
    pursuer: Array,
    evader: Array,
    evader_velocity_m_s: Array,
    previous_m_s: Array | None,
    *,
    dt_s: Array | float,
    gain: float,
) -> Array:
    """Turn `gain` times as fast as the line of sight does: (..., 3), m/s.

    The law has a memory, its own last command; with none, or with one that leads away, it begins on the line of sight.

    Args:
        game: What is played.
        pursuer: P, (..., 3), m.
        evader: E, (..., 3), m.
        evader_velocity_m_s: The evader's velocity as observed, (..., 3).
        previous_m_s: What the law commanded before, (..., 3); None at the begin.
        dt_s: How long ago that was, (...).
        gain: The navigation constant N, 3 to 5 as a rule; 1 is pure pursuit.
    """
    xp, given = vectors({"pursuer": pursuer, "evader": evader, "evader_velocity_m_s": evader_velocity_m_s})
    shape, pursuer = leading_shape(game, given), given["pursuer"]
    with quiet(xp):
        state = take_apart(xp, game, *given.values())
        direction = unit2(xp, state.to_evader, state.distance)
        if previous_m_s is not None:
            previous = (component(previous_m_s, 0), component(previous_m_s, 1))
            direction = select2(
                xp, dot2(previous, direction) > 0.0, _turned(xp, state, previous, dt_s * gain), direction
            )
        to = (direction[0] * state.distance, direction[1] * state.distance)
        gap = state.distance - game.standoff.radius_m - game.capture_radius_m
        t = guard_time(xp, game, state, (to[0] - state.to_evader[0], to[1] - state.to_evader[1]))
        return pack(xp, shape, pursuer, steer(xp, game, to, gap, t, state.z, state.hold))


def _turned(xp: Library, state: State, previous: Plane, gained_s: Array | float) -> Plane:
    """Turn the last heading by the line of sight's rate times `gained_s`, which is exact for small angles."""
    r, run = state.to_evader, state.hold
    w = (run[0] - previous[0], run[1] - previous[1])
    square = dot2(r, r)
    s = 0.5 * gained_s * (r[0] * w[1] - r[1] * w[0]) / (square + (square == 0.0))
    scale = 1.0 / (1.0 + s * s)
    cosine, sine = (1.0 - s * s) * scale, 2.0 * s * scale
    heading = unit2(xp, previous, norm2(xp, previous))
    return cosine * heading[0] - sine * heading[1], sine * heading[0] + cosine * heading[1]
