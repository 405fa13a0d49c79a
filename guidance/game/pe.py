"""The pursuit-evasion game: the time until the pursuer captures the evader (Li, Wang & Xie, section III).

One closed form covers both speed sets, capture radius, stand-off and wind. While the pursuer flies for t seconds, the
circle of ground points where it would hold an evader captured grows:

    Ball(u):         radius R + √((u t + l)² − z²),  from u t + l = |z| on
    Cylinder(a, b):  radius R + l + a t,             from b t + l = |z| on

with z the pursuer's height above the stand-off disc, R the disc's radius and l the capture radius. An evader whose
distance from the disc is `gap + run · t` is caught when the circle has grown as far. For Ball that is a quadratic,

    (u² − v²) t² + 2 (u l − v gap) t + l² − z² − gap² = 0,   v = run,

whose discriminant is written below as (u gap − v l)² + (u² − v²) z², a sum of squares that no rounding turns negative,
and u² − v² as (u − v)(u + v) with u − v as an argument. With R = l = 0 it is the paper's capture time.

The evader's best heading is straight away from the point to which the wind carries the pursuer: then the circle needs
longest to span the evader's own. In still air that is the paper's q*, eq. (16), with d → d + v τ − R and z → z − h. A
Ball flies straight to that meeting point, eq. (20). A Cylinder flies at a along the line of sight and at b vertically,
and holds a part that it has reached. With wind the distance is the length of a plane vector y + m t, the largest of its
projections on a direction. With the direction of the last estimate the projection is a lower bound, so the steps of
`climb` approach the answer from below: Newton's method on a concave function, quadratic at the end.

The paper leaves one case open: right above the evader (d = 0, outside its set R₀, eq. (13)) all headings of the evader
are equally good, and the formulas divide by zero. The value is their limit, z/√(u² − v²). A Ball copies the evader's
observed velocity there and uses the rest of its speed for the descent, √(u² − ‖v_E‖²); if the evader stands still, or
its velocity is unknown, the pursuer goes straight down. The evader keeps its observed heading, or takes the x axis.
"""

from typing import Any, NamedTuple

from guidance.game.arrays import Library, Plane, Real, Space, dot2
from guidance.game.extent import to_set
from guidance.game.game import NO_WIND, Game, Reason, Winner, head_wind, speed_in_hand
from guidance.game.meeting_times import climb


class Geometry(NamedTuple):
    """A state of the game by components, each of the leading shape, with quantities that all kernels use."""

    evader: Plane
    """Position of the evader, m."""
    ground: Real
    """Height of the evader's plane, m."""
    to_evader: Plane
    """Horizontal vector from the pursuer to the evader, m."""
    z: Real
    """Height of the pursuer above the stand-off disc, m."""
    hold: Plane
    """Velocity of a pursuer that has reached its goal: the evader's as observed, at most v, m/s; zero if unknown."""


class StateSolution(NamedTuple):
    """A `Solution` by components: kernels return it, and `solve_state` that of one state in plain numbers."""

    winner: int | Any
    value: Real
    margin_s: Real
    meeting_point_m: Space
    meeting_time_s: Real
    pursuer_velocity_m_s: Space
    evader_velocity_m_s: Space
    reason: int | Any


def take_apart(xp: Library, game: Game, P: Space, E: Space, observed: Space | None) -> Geometry:
    """Return a state by components.

    Args:
        xp: array library.
        game: the stand-off's height, and the evader's speed bound.
        P: position of the pursuer, m.
        E: position of the evader, m.
        observed: the evader's observed velocity, m/s, or None.
    """
    (x, y, height) = P
    (east, north, ground) = E
    to_evader = (east - x, north - y)
    z = height - ground - game.standoff.height_m
    if observed is None:
        return Geometry((east, north), ground, to_evader, z, NO_WIND)
    (seen_x, seen_y, _) = observed
    bound = game.evader_speed_m_s
    share = bound / xp.maximum(xp.sqrt(seen_x * seen_x + seen_y * seen_y), bound)
    return Geometry((east, north), ground, to_evader, z, (share * seen_x, share * seen_y))


def to_target(xp: Library, game: Game, E: Space, T: Space) -> Space:
    """Return the vector from the evader to the nearest point of its target; in the plane unless the evader flies."""
    extent = game.target_extent
    rise = T[2] - E[2] if game.evader_space == "space" else 0.0 * T[2]
    if extent.is_point:
        return T[0] + extent.corners_m[0][0] - E[0], T[1] + extent.corners_m[0][1] - E[1], rise
    return *to_set(xp, extent, (E[0] - T[0], E[1] - T[1])), rise


def steer(xp: Library, game: Game, to: Plane, gap: Real, t: Real, z: Real, hold: Plane) -> Space:
    """Return the pursuer's velocity over the ground, m/s, that captures the evader at a given point after `t`.

    Args:
        xp: array library.
        game: speed set, stand-off disc, wind.
        to: horizontal vector from the pursuer to the evader's position then, m.
        gap: horizontal distance left to the disc, m; only a separate speed set uses it.
        t: time to that capture, s; zero if captured.
        z: height of the pursuer above the stand-off disc, m.
        hold: horizontal velocity over the ground of a pursuer that has reached the disc.
    """
    pursuer = game.pursuer
    wind = game.wind_m_s
    y = to if game.calm else (to[0] - wind[0] * t, to[1] - wind[1] * t)
    x_m_s, y_m_s, vertical_m_s = pursuer.aim(xp, game.standoff.radius_m, y, z)
    ground = (x_m_s, y_m_s) if game.calm else (x_m_s + wind[0], y_m_s + wind[1])
    flies_level, flies_vertically = pursuer.underway(xp, game.capture_radius_m, gap, t, z)
    level = xp.select2(flies_level, ground, hold)
    return *level, xp.select(flies_vertically, vertical_m_s, 0.0)


def fly_to(xp: Library, game: Game, state: Geometry, to: Plane, t: Real) -> Space:
    """Return the pursuer's velocity, m/s, that captures an evader in time `t` that is at `to` from the pursuer then."""
    gap = xp.norm2(to) - game.standoff.radius_m if game.pursuer.separate else 0.0
    return steer(xp, game, to, gap, t, state.z, state.hold)


def pursuit(xp: Library, game: Game, state: Geometry) -> StateSolution:
    """Solve PE; see `solve` for the meaning of the answer."""
    v = game.evader_speed_m_s
    t, away, distance = escape(xp, game, state.to_evader, state.z)
    direction = xp.unit2(away, distance)
    free = distance <= 0
    overhead = xp.any(free)
    if overhead:
        direction = xp.select2(free, xp.unit2(state.hold, xp.norm2(state.hold)), direction)
    run = v * (t + game.information_age_s)
    dash = (run * direction[0], run * direction[1])
    to = (state.to_evader[0] + dash[0], state.to_evader[1] + dash[1])
    gap: Real = 0.0
    if overhead or game.pursuer.separate:
        beside = distance if game.calm else xp.norm2(state.to_evader)
        gap = beside + (v * game.information_age_s - game.standoff.radius_m)
    velocity = steer(xp, game, to, gap, t, state.z, state.hold)
    reason: Real = int(Reason.SOLVED)
    if overhead:
        if game.pursuer.separate:
            gap = gap - game.capture_radius_m
        above = free & (t > 0) & (gap + v * t > 0)
        reason = xp.select(above, int(Reason.OVERHEAD), int(Reason.SOLVED))
        if not game.pursuer.separate:
            # Right above the evader it copies the evader's velocity, and uses the rest of its speed vertically.
            copied = (state.hold[0] + game.wind_m_s[0], state.hold[1] + game.wind_m_s[1])
            vertical = game.pursuer.vertical(xp, state.hold, state.z)
            level = xp.select2(above, copied, (velocity[0], velocity[1]))
            velocity = *level, xp.select(above, vertical, velocity[2])
    return StateSolution(
        winner=int(Winner.PURSUER),
        value=t,
        margin_s=float("inf"),
        meeting_point_m=(state.evader[0] + dash[0], state.evader[1] + dash[1], state.ground),
        meeting_time_s=t,
        pursuer_velocity_m_s=velocity,
        evader_velocity_m_s=(v * direction[0], v * direction[1], 0.0),
        reason=xp.select(t > 0, reason, int(Reason.CAPTURED)),
    )


def escape(xp: Library, game: Game, to_evader: Plane, z: Real) -> tuple[Real, Plane, Real]:
    """Return the capture time, and the way to the evader then, and its length, from a pursuer that drifts.

    The evader's best heading is along that way.

    Args:
        xp: array library.
        game: the game.
        to_evader: horizontal vector from the pursuer to the evader, m.
        z: height of the pursuer above the stand-off disc, m.
    """
    v = game.evader_speed_m_s
    radius = game.standoff.radius_m
    capture = game.capture_radius_m
    lead = v * game.information_age_s - radius
    if game.calm:
        x, y = to_evader
        distance = xp.sqrt(x * x + y * y)
        spare = game.pursuer.horizontal_m_s - v
        t = game.pursuer.cover_time(xp, radius, capture, distance + lead, spare, z)
        return t, to_evader, distance
    wind = game.wind_m_s
    least = speed_in_hand(game)

    def cover(n: Plane) -> Real:
        gap = dot2(n, to_evader) + lead
        spare = least + head_wind(wind, n)
        return game.pursuer.cover_time(xp, radius, capture, gap, spare, z)

    return climb(xp, to_evader, (-wind[0], -wind[1]), cover)
