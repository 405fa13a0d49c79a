"""How soon the pursuer can have the evader: one closed form for both speed sets, capture radius, stand-off and wind.

While the pursuer flies for t seconds, the circle of ground points where it would hold an evader captured grows:

    Ball(u):         radius R + √((u t + l)² − z²),  from u t + l = |z| on
    Cylinder(a, b):  radius R + l + a t,             from b t + l = |z| on

with z the pursuer's height above the stand-off disc, R the disc's radius and l the capture radius. An evader whose
distance from the disc is `gap + run · t` is caught when the circle has grown as far. For Ball that is a quadratic,

    (u² − v²) t² + 2 (u l − v gap) t + l² − z² − gap² = 0,   v = run,

whose discriminant is written below as (u gap − v l)² + (u² − v²) z², a sum of squares that no rounding turns negative.
With R = l = 0 and run = v it is the paper's capture time t_E, the value of the PE game.

A distance that is a plane vector y + m t, not a straight line in t, is the largest of its projections on a direction.
Fixing the direction at the last estimate bounds it from below, so that the steps of `catch_time` climb to the answer
and never pass it: Newton's method on a concave function, quadratic at the end.
"""

from guidance.game.arrays import (
    Array,
    Library,
    Plane,
    Real,
    Space,
    dot2,
    larger,
    norm2,
    positive_part,
    select,
    select2,
    unit2,
)
from guidance.game.checks import is_zero
from guidance.game.game import Ball, Cylinder, Game, is_calm

TOUCH_M = 1e-9
"""What is left of a distance that is met, for a pursuer that is told to hold what is met: rounding leaves that much."""

NEWTON_STEPS = 10
"""Eight reach the last bit even at δ = 1.02; wider speed ratios need four or five."""


def cover_time(xp: Library, game: Game, gap: Real, run: Real, z: Real) -> Array:
    """Return the time from now, s, until the capture circle spans `gap + run · t`; zero if it does now.

    Args:
        xp: array library.
        game: speed set and capture radius.
        gap: horizontal distance to the stand-off disc now, m; negative inside.
        run: speed at which that distance grows, m/s; less in magnitude than the pursuer's horizontal speed.
        z: height of the pursuer above the stand-off disc, m, of either sign.
    """
    pursuer, capture = game.pursuer, game.capture_radius_m
    if isinstance(pursuer, Cylinder):
        beside = (gap - capture) / (pursuer.horizontal_m_s - run)
        return positive_part(larger(xp, beside, level_time(xp, game, pursuer, z)))
    u = pursuer.speed_m_s
    above = (abs(z) - capture) / u
    hand = u * u - run * run
    cross = u * gap - run * capture
    t = (run * gap - u * capture + xp.sqrt(cross * cross + hand * (z * z))) / hand
    return positive_part(select(xp, gap + run * above > 0, t, above))


def level_time(xp: Library, game: Game, pursuer: Cylinder, z: Real) -> Array:
    """Return the time, s, in which a Cylinder gains the height of the disc; negative if it has more than that."""
    return (abs(z) - game.capture_radius_m) / vertical_speed(xp, pursuer, z)


def vertical_speed(xp: Library, pursuer: Cylinder, z: Real) -> Array:
    """Return the vertical speed in the direction that is needed: descent from above the disc, climb from below."""
    return select(xp, z > 0, pursuer.descent_m_s, pursuer.climb_m_s)


def catch_time(xp: Library, game: Game, y: Plane, m: Plane, z: Real) -> Array:
    """Return the time from now, s, until an evader at `y` from the pursuer, moving at `m` in the air, is captured."""
    pursuer, radius = game.pursuer, game.standoff.radius_m
    if isinstance(pursuer, Cylinder):
        return larger(xp, level_catch_time(xp, game, pursuer, y, m), level_time(xp, game, pursuer, z))
    if is_zero(radius):
        return catch_in_ball(xp, pursuer.speed_m_s, game.capture_radius_m, y, m, z)
    direction = unit2(xp, y, norm2(xp, y))
    for _ in range(NEWTON_STEPS):
        t = cover_time(xp, game, dot2(direction, y) - radius, dot2(direction, m), z)
        then = (y[0] + m[0] * t, y[1] + m[1] * t)
        direction = unit2(xp, then, norm2(xp, then))
    return t


def level_catch_time(xp: Library, game: Game, pursuer: Cylinder, y: Plane, m: Plane) -> Array:
    """Return the same for the horizontal part of a Cylinder alone: the planar game with capture radius R + l."""
    return catch_in_ball(xp, pursuer.horizontal_m_s, game.standoff.radius_m + game.capture_radius_m, y, m, 0.0)


def catch_in_ball(xp: Library, u: Real, capture: Real, y: Plane, m: Plane, z: Real) -> Array:
    """Solve ‖(y + m t, z)‖ = u t + capture for its root t ≥ 0, with ‖m‖ < u; zero if it is captured now."""
    hand = u * u - dot2(m, m)
    half = dot2(y, m) - u * capture
    beyond = dot2(y, y) + z * z - capture * capture
    t = (half + xp.sqrt(half * half + hand * beyond)) / hand
    return select(xp, beyond > 0, t, 0.0 * t)


def steer(xp: Library, game: Game, to: Plane, gap: Real, t: Real, z: Real, hold: Plane) -> Space:
    """Return the pursuer's velocity over the ground, m/s, that has the evader captured at a given point after `t`.

    Args:
        xp: array library.
        game: speed set, stand-off disc, wind.
        to: horizontal vector from the pursuer to where the evader will be, m.
        gap: what is left to gain horizontally now, m; a Cylinder with nothing to gain holds.
        t: time to that capture, s; zero when it has come.
        z: height of the pursuer above the stand-off disc, m.
        hold: horizontal velocity over the ground of a pursuer that has nothing to gain.
    """
    wind = game.wind_m_s
    y = to if is_calm(game) else (to[0] - wind[0] * t, to[1] - wind[1] * t)
    length = norm2(xp, y)
    if isinstance(game.pursuer, Cylinder):
        beside, pace = gap > TOUCH_M, game.pursuer.horizontal_m_s
        above = abs(z) - game.capture_radius_m > TOUCH_M
        vertical = select(xp, z > 0, -game.pursuer.descent_m_s, game.pursuer.climb_m_s)
        direction = unit2(xp, y, length)
    else:
        beside = above = t > 0
        pace, vertical, direction = _aim(xp, game, game.pursuer, y, length, z)
    flown = (pace * direction[0] + wind[0], pace * direction[1] + wind[1])
    return *select2(xp, beside, flown, hold), select(xp, above, vertical, 0.0)


def _aim(xp: Library, game: Game, pursuer: Ball, y: Plane, length: Real, z: Real) -> tuple[Real, Real, Plane]:
    """Point a Ball at the disc around y: horizontal pace, vertical velocity, and what the pace multiplies."""
    radius = game.standoff.radius_m
    reach = length if is_zero(radius) else positive_part(length - radius)
    distance = xp.sqrt(reach * reach + z * z)
    rate = pursuer.speed_m_s / select(xp, distance > 0, distance, 1.0)
    if is_zero(radius):
        return rate, -z * rate, y
    return reach * rate, -z * rate, unit2(xp, y, length)
