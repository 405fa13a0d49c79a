"""The pursuit-evasion game: capture as soon as possible against delay (Li, Wang & Xie, section III).

The evader's best heading is straight away from where the wind drifts the pursuer to: then the capture circle of `reach`
needs longest to span the evader's own circle. In still air that is the paper's q*, eq. (16), with d → d + v τ − R and
z → z − h. A Ball flies straight to that meeting point, eq. (20), a Cylinder at a along the line of sight and at b
vertically, and it holds what is already met.

Where the paper is silent: right above the evader (d = 0, outside its set R₀, eq. (13)) any heading of the evader is as
good as any other, and the formulas divide by zero. The value is their limit, z/√(u² − v²). A Ball copies the evader's
observed velocity there and spends the rest of its speed on the descent, √(u² − ‖v_E‖²); over an evader that stands
still, or whose velocity is unknown, it goes straight down. The evader keeps its observed heading, or takes the x axis.
"""

from guidance.game.arrays import Library, Plane, Real, Space, Truth, dot2, norm2, root, select, select2, unit2
from guidance.game.game import Ball, Cylinder, Game, Reason, Winner, speed_in_hand
from guidance.game.reach import Geometry, Play, climb, cover_time, head_wind, steer


def pursuit(xp: Library, game: Game, state: Geometry) -> Play:
    """Play the PE game from a state taken apart; see `solve` for what the answer means."""
    v, age = game.evader_speed_m_s, game.information_age_s
    t, direction, free = _flee(xp, game, state)
    run = v * (t + age)
    dash = (run * direction[0], run * direction[1])
    gap = state.distance + (v * age - game.standoff.radius_m)
    if isinstance(game.pursuer, Cylinder):
        gap = gap - game.capture_radius_m
    to = (state.to_evader[0] + dash[0], state.to_evader[1] + dash[1])
    flown = steer(xp, game, to, gap, t, state.z, state.hold)
    overhead = free & (t > 0) & (gap + v * t > 0)
    if isinstance(game.pursuer, Ball):
        flown = _follow(xp, game, game.pursuer, state, overhead, flown)
    reason = select(xp, overhead, int(Reason.OVERHEAD), int(Reason.SOLVED))
    return Play(
        winner=int(Winner.PURSUER),
        value=t,
        margin=float("inf"),
        meeting=(state.evader[0] + dash[0], state.evader[1] + dash[1], state.ground),
        time=t,
        pursuer=flown,
        evader=(v * direction[0], v * direction[1], 0.0),
        reason=select(xp, t > 0, reason, int(Reason.CAPTURED)),
    )


def _flee(xp: Library, game: Game, state: Geometry) -> tuple[Real, Plane, Truth]:
    """Find the capture time, the evader's heading, and whether any other heading were as good."""
    v, wind = game.evader_speed_m_s, game.wind_m_s
    lead = v * game.information_age_s - game.standoff.radius_m
    if game.calm:
        distance = state.distance
        direction = unit2(xp, state.to_evader, distance)
        t = cover_time(xp, game, distance + lead, game.pursuer.horizontal_m_s - v, state.z)
    else:
        least = speed_in_hand(game)

        def cover(n: Plane) -> Real:
            return cover_time(xp, game, dot2(n, state.to_evader) + lead, least + head_wind(wind, n), state.z)

        t, direction, distance = climb(xp, state.to_evader, (-wind[0], -wind[1]), cover)
    free = distance <= 0
    if free is not False and state.seen is not None:
        direction = select2(xp, free, unit2(xp, state.seen, norm2(xp, state.seen)), direction)
    return t, direction, free


def _follow(xp: Library, game: Game, pursuer: Ball, state: Geometry, overhead: Truth, flown: Space) -> Space:
    """Above the evader: copy its velocity, and spend the rest of the speed on the height, if there is any."""
    rest = pursuer.speed_m_s
    if state.seen is not None:
        rest = root(xp, rest * rest - dot2(state.seen, state.seen))
    copied = (state.hold[0] + game.wind_m_s[0], state.hold[1] + game.wind_m_s[1])
    vertical = select(xp, state.z > 0, -rest, select(xp, state.z < 0, rest, 0.0))
    return *select2(xp, overhead, copied, (flown[0], flown[1])), select(xp, overhead, vertical, flown[2])
