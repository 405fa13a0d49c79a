"""How soon the pursuer can have the evader: one closed form for both speed sets, capture radius, stand-off and wind.

While the pursuer flies for t seconds, the circle of ground points where it would hold an evader captured grows around it:

    Ball(u):              radius  R + √((u t + l)² − z²)   once u t + l ≥ |z|
    Cylinder(a, b):       radius  R + l + a t              once b t + l ≥ |z|

with z the pursuer's height above the stand-off disc, R the disc's radius and l the capture radius. An evader whose distance
is `gap + run · t` (gap less R) is caught when that circle has grown as far. For Ball this is the quadratic

    (u² − v²) t² + 2 (u l − v gap) t + l² − z² − gap² = 0,   v = run,

whose discriminant is written below as (u gap − v l)² + (u² − v²) z², a sum of squares: it never turns negative by rounding.
With l = R = 0 it is eq. (10) of Li, Wang & Xie. A distance that is a plane vector y + m t is the largest of its
projections on a direction; fixing the direction at the last estimate bounds it from below, so that the steps of `catch_time`
climb to the answer and never pass it (Newton's method on a concave function, quadratic at the end).
"""

from typing import Any

from guidance.game.arrays import Array, Plane, Real, Space, larger, norm2, positive_part, select, unit2
from guidance.game.game import Ball, Cylinder, Game

NEWTON_STEPS = 24


def cover_time(xp: Any, game: Game, gap: Real, run: Real, z: Real) -> Array:  # noqa: ANN401
    """Return the time from now, s, until the capture circle spans `gap + run · t`; zero if it does now.

    Args:
        xp: array library.
        game: speed set, capture radius.
        gap: horizontal distance to the stand-off disc now, m; negative inside.
        run: speed at which that distance grows, m/s, less in magnitude than the pursuer's horizontal speed.
        z: height of the pursuer above the stand-off disc, m, of either sign.
    """
    pursuer, capture = game.pursuer, game.capture_radius_m
    if isinstance(pursuer, Cylinder):
        beside = (gap - capture) / (pursuer.horizontal_m_s - run)
        above = (abs(z) - capture) / vertical_speed(xp, pursuer, z)
        return positive_part(larger(xp, beside, above))
    u = pursuer.speed_m_s
    above = (abs(z) - capture) / u
    hand = u * u - run * run
    cross = u * gap - run * capture
    t = (run * gap - u * capture + xp.sqrt(cross * cross + hand * (z * z))) / hand
    return positive_part(select(xp, gap + run * above > 0, t, above))


def vertical_speed(xp: Any, pursuer: Cylinder, z: Real) -> Array:  # noqa: ANN401
    """Return the vertical speed in the direction that is needed: descent from above the disc, climb from below."""
    return select(xp, z > 0, pursuer.descent_m_s, pursuer.climb_m_s)


def catch_time(xp: Any, game: Game, y: Plane, m: Plane, z: Real) -> Array:  # noqa: ANN401
    """Return the time from now, s, until an evader at `y` from the pursuer, moving at `m` through the air, is captured."""
    radius = game.standoff.radius_m
    if isinstance(game.pursuer, Ball) and is_zero(radius):
        return catch_in_ball(xp, game.pursuer.speed_m_s, game.capture_radius_m, y, m, z)
    if isinstance(game.pursuer, Cylinder):
        beside = planar_catch_time(xp, game, game.pursuer, y, m)
        above = (abs(z) - game.capture_radius_m) / vertical_speed(xp, game.pursuer, z)
        return larger(xp, beside, positive_part(above))
    direction = unit2(xp, y, norm2(xp, y))
    for _ in range(NEWTON_STEPS):
        t = cover_time(xp, game, dot2(direction, y) - radius, dot2(direction, m), z)
        then = (y[0] + m[0] * t, y[1] + m[1] * t)
        direction = unit2(xp, then, norm2(xp, then))
    return t


def planar_catch_time(xp: Any, game: Game, pursuer: Cylinder, y: Plane, m: Plane) -> Array:  # noqa: ANN401
    """Return the same for the horizontal part of a Cylinder alone: the planar game with capture radius R + l."""
    return catch_in_ball(xp, pursuer.horizontal_m_s, game.standoff.radius_m + game.capture_radius_m, y, m, 0.0)


def catch_in_ball(xp: Any, u: Real, capture: Real, y: Plane, m: Plane, z: Real) -> Array:  # noqa: ANN401
    """Solve ‖(y + m t, z)‖ = u t + l for its only root beyond t = −l/u, a quadratic."""
    hand = u * u - dot2(m, m)
    half = dot2(y, m) - u * capture
    beyond = dot2(y, y) + z * z - capture * capture
    t = (half + xp.sqrt(positive_part(half * half + hand * beyond))) / hand
    return select(xp, beyond > 0, positive_part(t), 0.0 * t)


def steer(xp: Any, game: Game, to: Plane, gap: Real, t: Real, z: Real, hold: Plane) -> Space:  # noqa: ANN401
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
    y = (to[0] - wind[0] * t, to[1] - wind[1] * t)
    length = norm2(xp, y)
    direction = unit2(xp, y, length)
    if isinstance(game.pursuer, Cylinder):
        beside, pace = gap > 0, game.pursuer.horizontal_m_s
        above = abs(z) > game.capture_radius_m
        vertical = select(xp, z > 0, -game.pursuer.descent_m_s, game.pursuer.climb_m_s)
    else:
        reach = positive_part(length - game.standoff.radius_m)
        distance = xp.sqrt(reach * reach + z * z)
        beside = above = t > 0
        rate = game.pursuer.speed_m_s / select(xp, distance > 0, distance, 1.0)
        pace, vertical = reach * rate, -z * rate
    return (
        select(xp, beside, pace * direction[0] + wind[0], hold[0]),
        select(xp, beside, pace * direction[1] + wind[1], hold[1]),
        select(xp, above, vertical, 0.0),
    )


def dot2(a: Plane, b: Plane) -> Array:
    """Scalar product of two plane vectors."""
    return a[0] * b[0] + a[1] * b[1]


def is_calm(game: Game) -> bool:
    """Say whether there is no wind."""
    return is_zero(game.wind_m_s[0]) and is_zero(game.wind_m_s[1])


def is_zero(value: Real) -> bool:
    """Say whether a parameter is switched off; an array of them never is."""
    return isinstance(value, (int, float)) and value == 0
