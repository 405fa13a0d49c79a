"""A heading of the evader followed to the capture, and how the point where it ends moves as the heading turns.

With its heading n the evader ends at

    X(n) = E + v (t + τ) n,    ‖(y + m t − q, z)‖ = u t + l,    y = E − P + v τ n,    m = v n − w

t is the root of a quadratic for every point q of the stand-off disc around the pursuer, and the best q lies towards X:
the region against a disc is the intersection of the regions of the virtual pursuers P + q.

A heading is written by the tangent s of its half angle from the direction to the target, as
((1 − s²) e₁ + 2 s e₂)/(1 + s²), which needs no trigonometry. A point X of the region that is closer to T than E itself
lies less than 90° off that direction (‖X − E‖ ≤ 2 n·(T − E)), so |s| ≤ 1 brackets it.
"""

from typing import NamedTuple

from guidance.game.arrays import (
    Library,
    Plane,
    Real,
    Truth,
    along2,
    cross2,
    dot2,
    in_plane,
    plus2,
    times2,
)
from guidance.game.extent import ORIGIN, Extent, from_set, nearest
from guidance.game.game import NO_WIND, Game, head_wind, least_square_in_hand
from guidance.game.meeting_times import ball_time
from guidance.game.pe import Geometry
from guidance.game.records import is_zero


class Hunt(NamedTuple):
    """The state and parameters of a search for the evader's heading; for a Cylinder the horizontal ones; see `pe`."""

    u: Real
    v: Real
    capture: Real
    radius: Real
    lag: Real
    """Distance that the evader may have run unseen, v τ."""
    hand: Real
    """u² − (v + ‖w‖)²."""
    z2: Real
    """Square of the height above the disc."""
    to_evader: Plane
    target: Plane
    """To the target's position ..."""
    extent: Extent
    """... and its shape about it."""
    wind: Plane | None
    """None where the air is calm ..."""
    drift: Plane | None
    """... and where the target rests."""
    ahead: Plane
    """Direction of heading zero."""
    met_s: Real
    """When the pursuer can have this height ..."""
    met_m: Real
    """... and the distance from the pursuer within which the evader is captured then."""


class AimedHeading(NamedTuple):
    """A heading s, and the direction from the pursuer to the end of its run, as far as it is known."""

    s: Real
    disc: Plane


class HeadingRun(NamedTuple):
    """A heading followed to its end, vectors by their components along and across it."""

    n: Plane
    t: Real
    rho: Real
    """Length of the run."""
    from_target: Plane
    """From the nearest point of the target to the end ..."""
    flat: Truth
    """... which lies on a straight line of its edge."""
    air: Plane
    """The evader's velocity through the air."""
    flight: Plane
    """From the virtual pursuer to the end, through the air."""
    disc: Plane
    """Direction from the pursuer to the end, through the air ..."""
    to: Plane
    """... in the plane."""
    bent: Real
    """Radius of the stand-off disc over the length of that way; zero without a disc."""
    hand: Real
    delta: Real
    """The root of `ball_time`; infinite if the evader is captured before it can leave the disc."""


def hunt_for(xp: Library, game: Game, state: Geometry, target: Plane, goal: Plane) -> Hunt:
    """Return the state of a search, with headings counted from the direction to `goal`.

    Args:
        xp: array library.
        game: speeds, capture radius, stand-off, age, wind and drift.
        state: the state.
        target: vector from the evader to the target's position now, m.
        goal: vector from the evader to where it could meet its target, m.
    """
    u = game.pursuer.horizontal_m_s
    v = game.evader_speed_m_s
    radius, capture, z = game.pursuer.planar(
        xp, game.standoff.radius_m, game.capture_radius_m, state.z
    )
    z2 = z * z
    if type(z) is float and z == 0.0:
        met_s: Real = 0.0
        met_m = radius + capture
    else:
        met_s = xp.maximum(abs(z) - capture, 0.0) / u
        met_m = (
            radius
            if is_zero(capture)
            else radius + xp.sqrt(xp.maximum(capture * capture - z2, 0.0))
        )
    lag = v * game.information_age_s
    hand = least_square_in_hand(game)
    ahead = xp.unit2(goal, xp.norm2(goal))
    wind = None if game.calm else game.wind_m_s
    drift = None if game.target_velocity_m_s == NO_WIND else game.target_velocity_m_s
    places = (state.to_evader, target, game.target_extent, wind, drift, ahead)
    return Hunt(u, v, capture, radius, lag, hand, z2, *places, met_s, met_m)


def way_along(
    xp: Library, hunt: Hunt, aim: AimedHeading, *, with_height: bool = False
) -> HeadingRun:
    """Return the way that follows a heading to the capture.

    Args:
        xp: array library.
        hunt: the state of the search.
        aim: the heading.
        with_height: also if the pursuer's height alone decides the time of the capture.
    """
    start = _set_out(hunt, aim.s)
    flat = is_zero(hunt.radius)
    disc = NO_WIND if flat else along2(start.n, aim.disc)
    # When the virtual pursuer captures, and the root of `ball_time`.
    y = start.to_end if flat else plus2(start.to_end, -hunt.radius, disc)
    beyond = dot2(y, y) + hunt.z2 - hunt.capture * hunt.capture
    half = _along(hunt, start.air, y) - hunt.u * hunt.capture
    t, delta = ball_time(xp, start.hand, half, beyond)
    if with_height:
        at = _after(hunt, start.air, hunt.met_s, start.to_end)
        inside = dot2(at, at) <= hunt.met_m * hunt.met_m
        t = xp.select(inside, hunt.met_s, t)
        delta = xp.select(inside, float("inf"), delta)
    # From the pursuer to the end of the run, through the air.
    way = _after(hunt, start.air, t, start.to_end)
    if flat:
        flight = way
        bent = 0.0
        to = aim.disc
    else:
        far = xp.norm2(way)
        inverse = 1.0 / xp.select(far > 0, far, 1.0)
        disc = (xp.select(far > 0, way[0] * inverse, 1.0), way[1] * inverse)
        bent = hunt.radius * inverse
        flight = times2(far - hunt.radius, disc)
        to = in_plane(start.n, disc)
        slower = hunt.u * (hunt.u * t + hunt.capture) - _along(hunt, start.air, flight)
        delta = xp.select(delta < float("inf"), slower, delta) if with_height else slower
    rho = hunt.v * t + hunt.lag
    from_target, flat_edge = left_over(xp, hunt, start.n, rho, t)
    return HeadingRun(
        start.n,
        t,
        rho,
        from_target,
        flat_edge,
        start.air,
        flight,
        disc,
        to,
        bent,
        start.hand,
        delta,
    )


class Start(NamedTuple):
    """A heading, the vector to the end of the lag along and across it, the speed in the air, and u² less its square."""

    n: Plane
    to_end: Plane
    air: Plane
    hand: Real


def _set_out(hunt: Hunt, s: Real) -> Start:
    """Return the evader's start along a heading."""
    square = s * s
    scale = 1.0 / (1.0 + square)
    n = in_plane(hunt.ahead, ((1.0 - square) * scale, (s + s) * scale))
    to_end = (dot2(hunt.to_evader, n) + hunt.lag, cross2(n, hunt.to_evader))
    wind = hunt.wind
    if wind is None:
        return Start(n, to_end, (hunt.v, 0.0), hunt.hand)
    air = (hunt.v - dot2(wind, n), cross2(wind, n))
    return Start(n, to_end, air, hunt.hand + 2.0 * hunt.v * head_wind(wind, n))


def aimed_at(xp: Library, hunt: Hunt, t: Real, point: Plane = ORIGIN) -> tuple[Plane, Truth]:
    """Return the vector from E to the target's point nearest to a point (E) after t, and whether that is on a line."""
    target = hunt.target if hunt.drift is None else plus2(hunt.target, t, hunt.drift)
    near, flat = nearest(xp, hunt.extent, plus2(point, -1.0, target))
    return from_set(target, near), flat


def left_over(xp: Library, hunt: Hunt, n: Plane, rho: Real, t: Real) -> tuple[Plane, Truth]:
    """Return the vector from the target to the end of a run, along and across it; see `HeadingRun`."""
    if len(hunt.extent.corners_m) == 1:
        corner = from_set(hunt.target, hunt.extent.corners_m[0])
        from_target = (rho - dot2(corner, n), cross2(corner, n))
        return (
            from_target if hunt.drift is None else plus2(from_target, -t, along2(n, hunt.drift))
        ), False
    end = times2(rho, n)
    goal, flat = aimed_at(xp, hunt, t, end)
    return along2(n, plus2(end, -1.0, goal)), flat


def _along(hunt: Hunt, air: Plane, p: Plane) -> Real:
    """Return p·air; without wind the evader moves along its heading alone."""
    return air[0] * p[0] if hunt.wind is None else dot2(p, air)


def _after(hunt: Hunt, air: Plane, t: Real, p: Plane) -> Plane:
    """Return p + air·t."""
    return p[0] + air[0] * t, p[1] if hunt.wind is None else p[1] + air[1] * t


def judge(hunt: Hunt, path: HeadingRun) -> tuple[Real, Real, Truth]:
    """Return Newton's turn towards the least distance, rad, the slope of the distance, and whether the turn is sound.

    The first and second derivative of t by the heading are those of H = (‖y + m t − q‖² + z² − (u t + l)²)/2 = 0, for
    which ∂H/∂t = −delta. The turn is Newton's for the angle between the edge and the way to the target, whose own
    derivative is positive if the edge is convex and the target lies beyond its tangent.
    """
    edge, bend = _edge(hunt, path)
    from_target = path.from_target
    slope = dot2(from_target, edge)
    square = dot2(edge, edge)
    before = cross2(from_target, edge)
    # Seen from a line it keeps its direction
    turns = square if path.flat is False else square * (1.0 - 1.0 * path.flat)
    rate = turns + before * cross2(bend, edge) / square
    return -slope / rate, slope, (rate > 0) & (before <= 0)


def _edge(hunt: Hunt, path: HeadingRun) -> tuple[Plane, Plane]:
    """Return the first and second derivative of the end of a run by the heading, m/rad and m/rad²."""
    v = hunt.v
    rho = path.rho
    (along, aside) = path.flight
    first = rho * aside / path.delta
    calm = hunt.wind is None
    pushed = v * aside if calm else v * aside + rho * path.air[1]
    second = rho * (rho - along) + first * (2.0 * pushed - path.hand * first)
    if not is_zero(hunt.radius):
        swing = (
            rho * path.disc[0] - (v * path.disc[1] if calm else cross2(path.air, path.disc)) * first
        )
        second = second - path.bent * swing * swing
    second = second / path.delta
    edge = (v * first, rho)
    bend = (v * second - rho, 2.0 * v * first)
    if hunt.drift is None:
        return edge, bend
    pulled = along2(path.n, hunt.drift)
    return plus2(edge, -first, pulled), plus2(bend, -second, pulled)


def clipped(xp: Library, s: Real) -> Real:
    """Keep a heading within 90° of straight ahead."""
    return xp.select(s > 1.0, 1.0, xp.select(s < -1.0, -1.0, s))
