"""The point of the evader's region closest to its target: g* of the paper, and what becomes of it in every other game.

The evader owns the points that it reaches before the pursuer can have it captured there. In the paper's game they are
the Apollonius disc, and everything is written down (`apollonius.race`). Else one unknown is left, its heading n:

    X(n) = E + v (t + τ) n,    ‖(y + m t − q, z)‖ = u t + l,    y = E − P + v τ n,    m = v n − w

t is the root of a quadratic for every point q of the stand-off disc around the pursuer, and the best q lies towards X:
the region against a disc is the intersection of the regions of the virtual pursuers P + q. It is convex while the
information is young enough (`guaranteed_age_s`), so that the distance from T has one minimum along its edge. Newton's
method finds that by the first and second derivative of t, q following X: a few steps from the closest point of a circle
that touches the edge. Few rows need more, or the bracket that holds the minimum; they get both. Beyond the guaranteed
age the region can have a dent before the pursuer, and a minimum on either side of it: the better one is taken.

A heading is written by the tangent s of its half angle from the direction to the target, as
((1 − s²) e₁ + 2 s e₂)/(1 + s²), which needs no trigonometry. A point X of the region that is closer to T than E itself
lies less than 90° off that direction (‖X − E‖ ≤ 2 n·(T − E)), so |s| ≤ 1 brackets it.
"""

from typing import Any, NamedTuple

import numpy as np
from array_api_compat import array_namespace

from guidance.game.arrays import (
    FLOATS,
    Array,
    Library,
    Plane,
    Real,
    dot2,
    is_array,
    norm2,
    positive_part,
    root,
    select,
    select2,
    unit2,
)
from guidance.game.game import (
    STILL,
    Cylinder,
    Game,
    guaranteed_age_s,
    horizontal_speed,
    is_calm,
    is_zero,
)
from guidance.game.reach import State, ball_time, head_wind, least_square_in_hand

STEPS = 5
"""Newton steps that every row takes."""

MORE_STEPS = 80
"""Steps within a bracket that end at the last bit, whatever the row."""

DISC_STEPS = 5
"""Rounds that find the best point of the stand-off disc from anywhere."""

TRACED_STEPS = 12
"""As many for the libraries that cannot ask a row how far it is."""

FAN = tuple(index / 4.0 - 1.0 for index in range(9))
"""Headings from −90° to 90°, exact in binary."""


class Edge(NamedTuple):
    """Where the evader ends, from where it is: a horizontal vector, m; when, s; how far from its target, m."""

    run: Plane
    time: Array
    left: Array


class Hunt(NamedTuple):
    """What a heading of the evader is judged by, of a Cylinder its horizontal part; see `reach` for the symbols."""

    u: Real
    v: Real
    capture: Real
    radius: Real
    lag: Real
    """How far the evader may have run unseen, v τ."""
    hand: Real
    """u² − v² less what the wind takes of it at the worst."""
    z2: Real
    """Square of the height above the disc."""
    to_evader: Plane
    to_target: Plane
    wind: Plane
    ahead: Plane
    """The direction that headings are counted from."""
    met_s: Real
    """When that height is met ..."""
    met_m: Real
    """... and the distance from the pursuer within which the evader is captured then."""


class Aim(NamedTuple):
    """A heading s, and the direction from the pursuer to the end of its run, as far as it is known."""

    s: Array
    disc: Plane


class Way(NamedTuple):
    """A heading followed to its end, vectors by their components along and across it."""

    n: Plane
    t: Array
    rho: Array
    """Length of the run."""
    left: Plane
    """From the target to the end."""
    air: Plane
    """The evader's velocity through the air."""
    flown: Plane
    """From the virtual pursuer to the end, through the air."""
    disc: Plane
    """Direction from the pursuer to the end, through the air ..."""
    to: Plane
    """... in the plane."""
    bent: Array
    """Radius of the stand-off disc over the length of that way; zero without a disc."""
    hand: Array
    delta: Array
    """The root of `ball_time`; infinite where the evader is captured before it can leave the disc, whatever it does."""


def is_circle(game: Game) -> bool | Array:
    """Say whether the region, of a Cylinder its planar part, is the paper's disc; row by row where that differs."""
    if not is_calm(game) or game.target_velocity_m_s != STILL:
        return False
    lengths = (game.capture_radius_m, game.standoff.radius_m, game.information_age_s)
    if all(is_zero(length) for length in lengths):
        return True
    plain: bool | Array = True
    for length in lengths:
        plain = plain & (length == 0)
    return plain


def closest_point(xp: Library, game: Game, state: State, to_target: Plane, goal: Plane, wanted: Array) -> Edge:
    """Find the closest point of the evader's region to its target, of a Cylinder's the planar part.

    Args:
        xp: array library.
        game: the game, whose region is not the paper's disc.
        state: the state.
        to_target: vector from the evader to the target now, m.
        goal: vector from the evader to where it could meet its target, m.
        wanted: which rows are asked for; in the others the answer means nothing.
    """
    hunt = _hunt(xp, game, state, to_target, goal)
    old = game.information_age_s > guaranteed_age_s(game)
    if isinstance(wanted, np.ndarray):
        if wanted.all():
            return _closest(xp, game, hunt, old)
        if is_array(old):
            old = np.broadcast_to(old, wanted.shape)[wanted]
        found = _closest(xp, game, _rows(hunt, wanted), old)
        return Edge(*_put((to_target, 0.0, 0.0), wanted, tuple(found)))
    if isinstance(wanted, (bool, np.bool_)) and not wanted:
        return Edge(to_target, 0.0, 0.0)
    return _closest(xp, game, hunt, old)


def _hunt(xp: Library, game: Game, state: State, to_target: Plane, goal: Plane) -> Hunt:
    u, v = horizontal_speed(game.pursuer), game.evader_speed_m_s
    radius, capture = game.standoff.radius_m, game.capture_radius_m
    if isinstance(game.pursuer, Cylinder):
        radius, capture = 0.0, radius + capture
        z2, met_s, met_m = 0.0, 0.0, capture
    else:
        z2 = state.z * state.z
        met_s = positive_part(abs(state.z) - capture) / u
        met_m = radius + root(xp, positive_part(capture * capture - z2))
    return Hunt(
        u=u,
        v=v,
        capture=capture,
        radius=radius,
        lag=v * game.information_age_s,
        hand=least_square_in_hand(game),
        z2=z2,
        to_evader=state.to_evader,
        to_target=to_target,
        wind=game.wind_m_s,
        ahead=unit2(xp, goal, norm2(xp, goal)),
        met_s=met_s,
        met_m=met_m,
    )


def _closest(xp: Library, game: Game, hunt: Hunt, old: bool | Array) -> Edge:
    """Find it: by Newton's method where the run is not stopped by the pursuer's height alone."""
    drift = game.target_velocity_m_s
    met = (hunt.to_target[0] + drift[0] * hunt.met_s, hunt.to_target[1] + drift[1] * hunt.met_s)
    far = norm2(xp, met)
    straight = unit2(xp, met, far)
    rho = hunt.v * hunt.met_s + hunt.lag
    y = (
        hunt.to_evader[0] + rho * straight[0] - hunt.wind[0] * hunt.met_s,
        hunt.to_evader[1] + rho * straight[1] - hunt.wind[1] * hunt.met_s,
    )
    within = dot2(y, y) <= hunt.met_m * hunt.met_m
    aim = _search(xp, game, hunt, old, within)
    way = _follow(xp, game, hunt, aim)
    run = (way.rho * way.n[0], way.rho * way.n[1])
    return Edge(
        select2(xp, within, (rho * straight[0], rho * straight[1]), run),
        select(xp, within, hunt.met_s, way.t),
        select(xp, within, abs(far - rho), norm2(xp, way.left)),
    )


def _search(xp: Library, game: Game, hunt: Hunt, old: bool | Array, within: Array) -> Aim:
    """Return the heading that ends closest to the target, for the rows that are not `within`."""
    start = _touch(xp, game, hunt)
    reach: Real = 2.0
    if is_array(old) or old:
        start = _best_of_fan(xp, game, hunt, start, old)
        reach = select(xp, old, FAN[1] - FAN[0], reach)
    if not (xp is np or xp is FLOATS):
        return _bracket(xp, game, hunt, start, reach, TRACED_STEPS)
    aim = start
    for _ in range(STEPS):
        way = _follow(xp, game, hunt, aim)
        turn, _, sound = _judge(hunt, way, game.target_velocity_m_s)
        aim = _turned(way, aim.s + 0.5 * turn * (1.0 + aim.s * aim.s))
    settled = within | (sound & (abs(turn) <= _close(turn)) & (abs(aim.s - start.s) <= reach))
    if not isinstance(settled, np.ndarray):
        return aim if settled else _bracket(xp, game, hunt, start, reach, MORE_STEPS)
    left = ~settled
    if left.any():
        few = reach[left] if is_array(reach) else reach
        found = _bracket(xp, game, _rows(hunt, left), _rows(start, left), few, MORE_STEPS)
        aim = _put(aim, left, found)
    return aim


def _touch(xp: Library, game: Game, hunt: Hunt) -> Aim:
    """Begin with the closest point of a circle that touches the region's edge on the way to the target.

    It is the paper's, of the virtual pursuer that has the evader there, seen from where both would have started without
    the lead that age, capture radius and wind give.
    """
    way_on = (hunt.to_evader[0] + hunt.to_target[0], hunt.to_evader[1] + hunt.to_target[1])
    disc = unit2(xp, way_on, norm2(xp, way_on))
    way = _follow(xp, game, hunt, Aim(0.0 * way_on[0], disc))
    u, v, wind, drift = hunt.u, hunt.v, hunt.wind, game.target_velocity_m_s
    near = norm2(xp, way.flown)
    distance = root(xp, near * near + hunt.z2)
    share = hunt.capture / select(xp, distance > 0, distance, 1.0)
    x, y = _in_plane(way.n, way.flown)
    out = (share * x + hunt.radius * disc[0], share * y + hunt.radius * disc[1])
    lag = (hunt.lag * way.n[0], hunt.lag * way.n[1])
    e0 = (
        hunt.to_evader[0] + lag[0] - out[0] - wind[0] * way.t,
        hunt.to_evader[1] + lag[1] - out[1] - wind[1] * way.t,
    )
    goal = (hunt.to_target[0] - lag[0] + drift[0] * way.t, hunt.to_target[1] - lag[1] + drift[1] * way.t)
    hand = (u - v) * (u + v)
    back = (v * v * e0[0] - hand * goal[0], v * v * e0[1] - hand * goal[1])
    span = v * root(xp, hand * ((1.0 - share) * (1.0 - share)) * hunt.z2 + (u * u) * dot2(e0, e0))
    length = norm2(xp, back)
    scale = span / select(xp, length > 0, length, 1.0)
    run = (v * v * e0[0] - scale * back[0] + hand * lag[0], v * v * e0[1] - scale * back[1] + hand * lag[1])
    over = norm2(xp, run) + dot2(run, hunt.ahead)
    s = _across(run, hunt.ahead) / select(xp, over > 0, over, 1.0)
    return _turned(way, _bounded(xp, s))


def _best_of_fan(xp: Library, game: Game, hunt: Hunt, start: Aim, old: bool | Array) -> Aim:
    """Begin with the best heading of a fan instead, where the region may have a dent."""
    best, least = start, None
    for s in FAN:
        aim = Aim(s + 0.0 * start.s, start.disc)
        aim, way = _settled(xp, game, hunt, aim, DISC_STEPS)
        left = dot2(way.left, way.left)
        better = old if least is None else old & (left < least)
        least = left if least is None else select(xp, better, left, least)
        best = Aim(select(xp, better, aim.s, best.s), select2(xp, better, aim.disc, best.disc))
    return best


def _bracket(xp: Library, game: Game, hunt: Hunt, start: Aim, reach: Real, steps: int) -> Aim:
    """Find the heading by Newton's method within a bracket, which a step that would leave it halves instead."""
    aim, before, done, ends = start, 2.0, start.s != start.s, xp is np or xp is FLOATS
    low, high = _bounded(xp, start.s - reach), _bounded(xp, start.s + reach)
    for _ in range(steps):
        _, way = _settled(xp, game, hunt, aim, DISC_STEPS if ends else 2)
        turn, slope, sound = _judge(hunt, way, game.target_velocity_m_s)
        done = done | (sound & (slope == 0))
        falls = slope < 0
        low, high = select(xp, falls, aim.s, low), select(xp, falls, high, aim.s)
        new = aim.s + 0.5 * turn * (1.0 + aim.s * aim.s)
        near = sound & (abs(turn) <= _close(turn))
        taken = near | (sound & (new > low) & (new < high) & (abs(new - aim.s) <= 0.5 * before))
        new = select(xp, done, aim.s, select(xp, taken, new, 0.5 * (low + high)))
        before = abs(new - aim.s)
        aim = Aim(new, select2(xp, done, aim.disc, way.to))
        done = done | near
        if ends and np.all(done):
            break
    return aim


def _settled(xp: Library, game: Game, hunt: Hunt, aim: Aim, rounds: int) -> tuple[Aim, Way]:
    """Follow a heading until the best point of the stand-off disc is found, too, and the slope is that of the edge."""
    for _ in range(1 if is_zero(hunt.radius) else rounds):
        way = _follow(xp, game, hunt, aim, held=True)
        aim = _turned(way, aim.s)
    return aim, way


def _follow(xp: Library, game: Game, hunt: Hunt, aim: Aim, *, held: bool = False) -> Way:
    """Follow a heading to the capture; with `held` also where the pursuer's height alone decides when that is."""
    v, wind, drift, s = hunt.v, hunt.wind, game.target_velocity_m_s, aim.s
    scale = 1.0 / (1.0 + s * s)
    cosine, sine = (1.0 - s * s) * scale, (s + s) * scale
    n = (cosine * hunt.ahead[0] - sine * hunt.ahead[1], cosine * hunt.ahead[1] + sine * hunt.ahead[0])
    whole = (dot2(hunt.to_evader, n) + hunt.lag, _across(hunt.to_evader, n))
    air, hand = (v, 0.0), hunt.hand
    if not is_calm(game):
        air, hand = (v - dot2(wind, n), -_across(wind, n)), hand + 2.0 * v * head_wind(wind, n)
    flat = is_zero(hunt.radius)
    disc = (0.0, 0.0) if flat else (dot2(aim.disc, n), _across(aim.disc, n))
    y = whole if flat else (whole[0] - hunt.radius * disc[0], whole[1] - hunt.radius * disc[1])
    beyond = dot2(y, y) + hunt.z2 - hunt.capture * hunt.capture
    t, delta = ball_time(xp, hand, dot2(y, air) - hunt.u * hunt.capture, beyond)
    if held:
        at = (whole[0] + air[0] * hunt.met_s, whole[1] + air[1] * hunt.met_s)
        inside = dot2(at, at) <= hunt.met_m * hunt.met_m
        t, delta = select(xp, inside, hunt.met_s, t), select(xp, inside, float("inf"), delta)
    flown, bent, to = (y[0] + air[0] * t, y[1] + air[1] * t), 0.0, aim.disc
    if not flat:
        whole = (whole[0] + air[0] * t, whole[1] + air[1] * t)
        far = norm2(xp, whole)
        disc = unit2(xp, whole, far)
        flown = ((far - hunt.radius) * disc[0], (far - hunt.radius) * disc[1])
        bent = hunt.radius / select(xp, far > 0, far, 1.0)
        to = _in_plane(n, disc)
        slower = hunt.u * (hunt.u * t + hunt.capture) - dot2(flown, air)
        delta = select(xp, delta < float("inf"), slower, delta) if held else slower
    rho = v * t + hunt.lag
    left = (rho - dot2(hunt.to_target, n), -_across(hunt.to_target, n))
    if drift != STILL:
        left = (left[0] - dot2(drift, n) * t, left[1] - _across(drift, n) * t)
    return Way(n, t, rho, left, air, flown, disc, to, bent, hand, delta)


def _judge(hunt: Hunt, way: Way, drift: Plane) -> tuple[Array, Array, Array]:
    """Return Newton's turn towards the least distance, rad, that distance's slope, and whether the turn can be it.

    The first and second derivative of t by the heading are those of H = (‖y + m t − q‖² + z² − (u t + l)²)/2 = 0, for
    which ∂H/∂t = −delta. The turn is Newton's for the angle between the edge and the way to the target, whose own
    derivative is positive wherever the edge is convex and the target beyond its tangent.
    """
    v, rho, (along, across), left = hunt.v, way.rho, way.flown, way.left
    first = rho * across / way.delta
    second = rho * rho - rho * along + first * (2.0 * (v * across + rho * way.air[1]) - way.hand * first)
    if not is_zero(hunt.radius):
        swing = rho * way.disc[0] + (way.disc[0] * way.air[1] - way.disc[1] * way.air[0]) * first
        second = second - way.bent * swing * swing
    second = second / way.delta
    edge, bend = (v * first, rho), (v * second - rho, 2.0 * v * first)
    if drift != STILL:
        pulled = (dot2(drift, way.n), _across(drift, way.n))
        edge = (edge[0] - pulled[0] * first, edge[1] - pulled[1] * first)
        bend = (bend[0] - pulled[0] * second, bend[1] - pulled[1] * second)
    slope, square = dot2(left, edge), dot2(edge, edge)
    before = left[0] * edge[1] - left[1] * edge[0]
    rate = square + before * (bend[0] * edge[1] - bend[1] * edge[0]) / square
    return -slope / rate, slope, (rate > 0) & (before <= 0)


def _turned(way: Way, s: Array) -> Aim:
    return Aim(s, way.to)


def _across(v: Plane, n: Plane) -> Array:
    """Component of a plane vector across a direction, to its left."""
    return v[1] * n[0] - v[0] * n[1]


def _in_plane(n: Plane, v: Plane) -> Plane:
    """Return a vector that is given by its components along and across n."""
    return v[0] * n[0] - v[1] * n[1], v[0] * n[1] + v[1] * n[0]


def _bounded(xp: Library, s: Array) -> Array:
    return select(xp, s > 1.0, 1.0, select(xp, s < -1.0, -1.0, s))


def _close(turn: Array) -> Real:
    """Return a step, rad, after which none is needed: the next would be its square."""
    return 1e-8 if isinstance(turn, float) else array_namespace(turn).finfo(turn.dtype).eps ** 0.5


def _rows(value: Any, mask: Array) -> Any:  # noqa: ANN401 - a record of numbers and arrays
    """Return some rows of whatever is made of arrays; a number is the same for all."""
    if isinstance(value, tuple):
        parts = [_rows(part, mask) for part in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return np.broadcast_to(value, mask.shape)[mask] if isinstance(value, np.ndarray) else value


def _put(whole: Any, mask: Array, part: Any) -> Any:  # noqa: ANN401 - a record of numbers and arrays
    """Return a record with some rows of another put where they belong."""
    if isinstance(whole, tuple):
        parts = [_put(one, mask, other) for one, other in zip(whole, part, strict=True)]
        return type(whole)(*parts) if hasattr(whole, "_fields") else tuple(parts)
    filled = np.empty(mask.shape, dtype=np.result_type(part))
    filled[...] = whole
    filled[mask] = part
    return filled
