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

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from guidance.game.arrays import NUMPY, Library, Plane, Real, Space, Truth, dot2, times2
from guidance.game.extent import to_set
from guidance.game.game import Ball, Cylinder, Game, Reason, Winner, head_wind, speed_in_hand
from guidance.game.records import is_zero

TOUCH_M = 1e-9
"""Distance that counts as reached for a pursuer that holds a part it has reached; larger than rounding errors."""

NEWTON_STEPS = 10
"""Eight reach the last bit even at δ = 1.02; larger speed ratios need four or five."""


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
        return Geometry((east, north), ground, to_evader, z, (0.0, 0.0))
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


def cover_time(xp: Library, game: Game, gap: Real, spare: Real, z: Real) -> Real:
    """Return the time from now, s, until the capture circle spans `gap + run · t`; zero if it does now.

    Args:
        xp: array library.
        game: speed set and capture radius.
        gap: horizontal distance to the stand-off disc now, m; negative inside.
        spare: the pursuer's horizontal speed less `run`, the rate at which that distance grows, m/s.
        z: height of the pursuer above the stand-off disc, m, of either sign.
    """
    pursuer = game.pursuer
    capture = game.capture_radius_m
    if isinstance(pursuer, Cylinder):
        return xp.maximum(
            xp.maximum((gap - capture) / spare, level_time(xp, game, pursuer, z)), 0.0
        )
    u = pursuer.speed_m_s
    run = u - spare
    hand = spare * (u + run)
    if is_zero(capture) and is_zero(game.standoff.radius_m):
        cross = u * gap
        return (
            run * gap + xp.sqrt(hand * (z * z) + cross * cross)
        ) / hand  # V, eq. (19), of both speeds
    above = (abs(z) - capture) / u
    half = run * gap - u * capture
    cross = u * gap - run * capture
    delta = xp.sqrt(hand * (z * z) + cross * cross)
    beyond = gap * gap + z * z - capture * capture
    # The positive root of hand·t² − 2 half·t − beyond = 0, by the form that does not cancel.
    receding = half >= 0
    t = xp.select(receding, (half + delta) / hand, beyond / xp.select(receding, 1.0, delta - half))
    return xp.maximum(xp.select(gap + run * above > 0, t, above), 0.0)


def level_time(xp: Library, game: Game, pursuer: Cylinder, z: Real) -> Real:
    """Return the time, s, until a Cylinder reaches the height of the disc; not positive within its capture radius.

    Args:
        xp: array library.
        game: the capture radius.
        pursuer: its speed set.
        z: height of the pursuer above the stand-off disc, m, of either sign.
    """
    capture = game.capture_radius_m
    return xp.maximum((z - capture) / pursuer.descent_m_s, (-z - capture) / pursuer.climb_m_s)


def vertical_speed(xp: Library, pursuer: Cylinder, z: Real) -> Real:
    """Return the vertical speed towards the disc: descent from above, climb from below."""
    return xp.select(z > 0, pursuer.descent_m_s, pursuer.climb_m_s)


def climb(
    xp: Library, y: Plane, m: Plane, cover: Callable[[Plane], Real]
) -> tuple[Real, Plane, Real]:
    """Find the largest t = cover(n) over all directions n, that of y + m t; return t, n and ‖y + m t‖.

    With NumPy a row stops once it has converged, so that its result does not depend on the other rows.

    Args:
        xp: array library.
        y: a plane vector now, m.
        m: its rate, m/s.
        cover: time, s, as a function of the direction n in n·(y + m t).
    """

    def towards(t: Real) -> tuple[Plane, Real]:
        then = (y[0] + m[0] * t, y[1] + m[1] * t)
        distance = xp.norm2(then)
        return xp.unit2(then, distance), distance

    t = cover(xp.unit2(y, xp.norm2(y)))
    converged: Truth = False
    for _ in range(NEWTON_STEPS - 1):
        further = cover(towards(t)[0])
        if not xp.differentiates:
            further = xp.select(converged, t, further)
            converged = converged | (further - t <= xp.half_of_digits(further) * further)
        t = further
        if converged is True or (converged is not False and converged.all()):
            break
    return t, *towards(t)


def catch_in_ball(xp: Library, u: Real, capture: Real, y: Plane, m: Plane, z: Real) -> Real:
    """Solve ‖(y + m t, z)‖ = u t + capture for its root t ≥ 0, with ‖m‖ < u; zero if it is captured now.

    Args:
        xp: array library.
        u: the pursuer's speed, m/s.
        capture: its reach now, m.
        y: horizontal vector from the pursuer to the evader, m.
        m: the evader's velocity less the wind, m/s.
        z: height of the pursuer above the disc, m, of either sign.
    """
    pace = xp.norm2(m)
    return ball_time(
        xp,
        (u - pace) * (u + pace),
        dot2(y, m) - u * capture,
        dot2(y, y) + z * z - capture * capture,
    )[0]


def ball_time(xp: Library, hand: Real, half: Real, beyond: Real) -> tuple[Real, Real]:
    """Solve hand·t² − 2 half·t − beyond = 0 for its root t ≥ 0, and return √(half² + hand·beyond) with it.

    If `beyond` is not positive, the time is zero.

    Args:
        xp: array library.
        hand: u² − ‖m‖², m²/s², positive.
        half: half of the linear coefficient, m²/s.
        beyond: squared distance less squared reach now, m².
    """
    inside = beyond <= 0
    receding = half >= 0
    out = xp.select(inside, 0.0, beyond)
    delta = xp.sqrt(half * half + hand * out)
    # Libraries that differentiate take the derivative of |half| at zero for zero.
    size = abs(half) if not xp.differentiates else xp.select(receding, half, -half)
    root = size + delta
    t = xp.select(receding, root, out) / xp.select(receding, hand, root)
    return xp.select(inside, 0.0 * t, t), delta


def steer(xp: Library, game: Game, to: Plane, gap: Real, t: Real, z: Real, hold: Plane) -> Space:
    """Return the pursuer's velocity over the ground, m/s, that captures the evader at a given point after `t`.

    Args:
        xp: array library.
        game: speed set, stand-off disc, wind.
        to: horizontal vector from the pursuer to the evader's position then, m.
        gap: horizontal distance left to the disc, m; a Cylinder holds if it is zero.
        t: time to that capture, s; zero if captured.
        z: height of the pursuer above the stand-off disc, m.
        hold: horizontal velocity over the ground of a pursuer that has reached the disc.
    """
    wind = game.wind_m_s
    y = to if game.calm else (to[0] - wind[0] * t, to[1] - wind[1] * t)
    if isinstance(game.pursuer, Cylinder):
        ahead = xp.unit2(y, xp.sqrt(y[0] * y[0] + y[1] * y[1]))
        pace = game.pursuer.horizontal_m_s
        air = (pace * ahead[0], pace * ahead[1])
        vertical = xp.select(z > 0, -game.pursuer.descent_m_s, game.pursuer.climb_m_s)
    else:
        air, vertical = _aim(xp, game, game.pursuer, y, z)
    ground = air if game.calm else (air[0] + wind[0], air[1] + wind[1])
    if isinstance(game.pursuer, Ball):
        met = t <= 0
        return *xp.select2(met, hold, ground), xp.select(met, 0.0, vertical)
    above = abs(z) - game.capture_radius_m
    return *xp.select2(gap > TOUCH_M, ground, hold), xp.select(above > TOUCH_M, vertical, 0.0)


def fly_to(xp: Library, game: Game, state: Geometry, to: Plane, t: Real) -> Space:
    """Return the pursuer's velocity, m/s, that captures an evader in time `t` that is at `to` from the pursuer then."""
    gap = (
        0.0
        if isinstance(game.pursuer, Ball)
        else xp.norm2(to) - game.standoff.radius_m - game.capture_radius_m
    )
    return steer(xp, game, to, gap, t, state.z, state.hold)


def _aim(xp: Library, game: Game, pursuer: Ball, y: Plane, z: Real) -> tuple[Plane, Real]:
    """Point a Ball at the disc around y: horizontal and vertical velocity through the air."""
    square = dot2(y, y)
    share = 1.0
    if not is_zero(game.standoff.radius_m):
        length = xp.norm2(y)
        reach = xp.maximum(length - game.standoff.radius_m, 0.0)
        square = reach * reach
        share = reach / xp.select(length > 0, length, 1.0)
    distance = xp.sqrt(square + z * z)
    rate = pursuer.speed_m_s / xp.select(distance > 0, distance, 1.0)
    return times2(rate * share, y), -z * rate


def pursuit(xp: Library, game: Game, state: Geometry) -> StateSolution:
    """Solve PE; see `solve` for the meaning of the answer."""
    v = game.evader_speed_m_s
    age = game.information_age_s
    t, direction, distance = escape(xp, game, state)
    gap = (distance if game.calm else xp.norm2(state.to_evader)) + (
        v * age - game.standoff.radius_m
    )
    free = distance <= 0
    if free is not False:
        direction = xp.select2(free, xp.unit2(state.hold, xp.norm2(state.hold)), direction)
    run = v * (t + age)
    dash = (run * direction[0], run * direction[1])
    if isinstance(game.pursuer, Cylinder):
        gap = gap - game.capture_radius_m
    to = (state.to_evader[0] + dash[0], state.to_evader[1] + dash[1])
    velocity = steer(xp, game, to, gap, t, state.z, state.hold)
    reason: Real = int(Reason.SOLVED)
    if free is not False and (xp is not NUMPY or np.any(free)):
        above = free & (t > 0) & (gap + v * t > 0)
        reason = xp.select(above, int(Reason.OVERHEAD), int(Reason.SOLVED))
        if isinstance(game.pursuer, Ball):
            copied, vertical = _overhead(xp, game, game.pursuer, state)
            velocity = (
                *xp.select2(above, copied, (velocity[0], velocity[1])),
                xp.select(above, vertical, velocity[2]),
            )
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


def escape(xp: Library, game: Game, state: Geometry) -> tuple[Real, Plane, Real]:
    """Return the capture time, the evader's best heading, and its distance then from a pursuer that drifts."""
    v = game.evader_speed_m_s
    lead = v * game.information_age_s - game.standoff.radius_m
    if game.calm:
        x, y = state.to_evader
        distance = xp.sqrt(x * x + y * y)
        t = cover_time(xp, game, distance + lead, game.pursuer.horizontal_m_s - v, state.z)
        return t, xp.unit2(state.to_evader, distance), distance
    wind = game.wind_m_s
    least = speed_in_hand(game)

    def cover(n: Plane) -> Real:
        return cover_time(
            xp, game, dot2(n, state.to_evader) + lead, least + head_wind(wind, n), state.z
        )

    return climb(xp, state.to_evader, (-wind[0], -wind[1]), cover)


def _overhead(xp: Library, game: Game, pursuer: Ball, state: Geometry) -> tuple[Plane, Real]:
    """Above the evader a Ball copies its velocity, and uses the rest of its speed vertically."""
    spare = xp.sqrt(pursuer.speed_m_s * pursuer.speed_m_s - dot2(state.hold, state.hold))
    copied = (state.hold[0] + game.wind_m_s[0], state.hold[1] + game.wind_m_s[1])
    return copied, xp.select(state.z > 0, -spare, xp.select(state.z < 0, spare, 0.0))
