"""The pursuit-evasion game: capture as soon as possible against delay (Li, Wang & Xie, section III, eqs. (10) to (16)).

The evader's best heading is straight away from where the pursuer's drift carries it: then the capture circle of `reach`
needs longest to span the evader's own. Without wind that is the paper's q*, with d → d + v τ − R and z → z − h.

Where the paper is silent: right above the evader (d = 0, outside its set R₀) every heading of the evader is as good as any
other and the formulas divide by zero. The value is the limit z/√(u² − v²). A pursuer with the speed set Ball copies the
evader's observed velocity there and spends the rest of its speed on the descent, √(u² − ‖v_E‖²); against an evader that
stands still, or whose velocity is unknown, it goes straight down. The evader keeps its heading, or takes the x axis.
"""

from typing import Any

from guidance.game.arrays import Array, Plane, Space, norm2, select, unit2
from guidance.game.game import Ball, Cylinder, Game
from guidance.game.play import Play, State
from guidance.game.reach import NEWTON_STEPS, cover_time, dot2, is_calm, steer
from guidance.game.reasons import Reason, Winner


def pursuit(xp: Any, game: Game, state: State) -> Play:  # noqa: ANN401
    """Play the PE game from a state taken apart; see `solve` for what the answer means."""
    v = game.evader_speed_m_s
    head_start = v * game.information_age_s - game.standoff.radius_m
    t, direction, open_heading = _flee(xp, game, state, head_start)
    run = v * (t + game.information_age_s)
    to = (state.to_evader[0] + run * direction[0], state.to_evader[1] + run * direction[1])
    capture = game.capture_radius_m if isinstance(game.pursuer, Cylinder) else 0.0
    flown = steer(xp, game, to, state.distance + head_start - capture, t, state.z, state.drift)
    caught = t <= 0
    overhead = open_heading & (state.distance + head_start + v * t > 0)
    if isinstance(game.pursuer, Ball):
        free = overhead & ~caught
        flown = _follow(xp, game, state, free, flown)
    reason = select(xp, overhead, int(Reason.OVERHEAD), int(Reason.SOLVED))
    return Play(
        winner=int(Winner.PURSUER),
        value=t,
        margin=float("inf"),
        meeting=(state.evader[0] + run * direction[0], state.evader[1] + run * direction[1], state.ground),
        time=t,
        pursuer=flown,
        evader=(v * direction[0], v * direction[1], 0.0),
        reason=select(xp, caught, int(Reason.CAPTURED), reason),
    )


def _flee(xp: Any, game: Game, state: State, head_start: Array) -> tuple[Array, Plane, Array]:  # noqa: ANN401
    """Find the capture time, the evader's heading, and whether that heading is free."""
    v = game.evader_speed_m_s
    away, distance = state.to_evader, state.distance
    direction = unit2(xp, away, distance)
    calm = is_calm(game)
    t = 0.0 * state.z
    for _ in range(0 if calm else NEWTON_STEPS):
        gap = dot2(direction, state.to_evader) + head_start
        t = cover_time(xp, game, gap, v - dot2(direction, game.wind_m_s), state.z)
        away = (state.to_evader[0] - game.wind_m_s[0] * t, state.to_evader[1] - game.wind_m_s[1] * t)
        distance = norm2(xp, away)
        direction = unit2(xp, away, distance)
    if calm:
        t = cover_time(xp, game, distance + head_start, v, state.z)
    open_heading = distance <= 0
    kept = unit2(xp, state.drift, norm2(xp, state.drift))
    return (
        t,
        (select(xp, open_heading, kept[0], direction[0]), select(xp, open_heading, kept[1], direction[1])),
        open_heading,
    )


def _follow(xp: Any, game: Game, state: State, free: Array, flown: Space) -> Space:  # noqa: ANN401
    """Above the evader: copy its velocity, and spend the rest of the speed on the height."""
    assert isinstance(game.pursuer, Ball)
    u, wind = game.pursuer.speed_m_s, game.wind_m_s
    rest = xp.sqrt(u * u - dot2(state.drift, state.drift))
    return (
        select(xp, free, state.drift[0] + wind[0], flown[0]),
        select(xp, free, state.drift[1] + wind[1], flown[1]),
        select(xp, free, select(xp, state.z > 0, -rest, rest), flown[2]),
    )
