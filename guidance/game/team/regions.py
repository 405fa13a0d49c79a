"""Evaders' regions: the points that an evader reaches before a pursuer can capture it there, seen from the evader.

Let W = P − E, δ = u/v, ω the wind over v, and l the capture radius. A run along n ends after ρ with

    ‖ρ (n − ω) − W − q‖ = δ ρ + l,

q the point of the stand-off disc closest to that point. Without a disc it is a quadratic in ρ,

    κ ρ² + 2 h ρ = ‖W‖² − l²,    κ = δ² − ‖n − ω‖²,    h = W·(n − ω) + δ l.

Apollonius' circle is the case ω = l = 0 (Li, Wang & Xie, section II-B). It is written without centre and
radius, because these go to infinity as δ → 1 and cost digits. With a disc, q is found in rounds: an error of q changes
ρ by its square. A Cylinder's region is that of its horizontal game, with the stand-off and capture radius as l,
together with the disc around the evader that this reaches before the pursuer can be at its height.

All regions contain the evader and are convex, except for that disc. So two edges cross once between a heading along
which the first reaches farther and one along which the second does. Everything about several pursuers is such a
crossing (`corner`). Functions of two regions give the same bits when the regions change places.
"""

from typing import Any, NamedTuple, TypeAlias

import numpy as np

from guidance.game.arrays import NUMPY, Array, cross2, in_plane, is_array
from guidance.game.game import Game, head_wind, least_square_in_hand
from guidance.game.records import is_zero

PlaneArrays: TypeAlias = tuple[Any, Any]
"""Arrays of x and y, from the evader, m; or of directions."""

_ROUNDS = 8
"""Rounds that find the closest point of a stand-off disc to the last bit."""

_STEPS = 80
"""Newton and bisection steps to a crossing; five are usual."""

ASIDE = 1e-15
"""Turn of the heading halfway between two, so that opposite headings have one, too."""


class Regions(NamedTuple):
    """Regions of an evader against pursuers along the last axis, every field (..., n), or one number for all.

    Attributes:
        ratio: δ.
        curvature: least κ over all headings, that up the wind.
        x: of the pursuer from the evader, m.
        y: of the pursuer from the evader, m.
        z: height of the pursuer above the stand-off disc, m; zero for a Cylinder.
        capture: capture radius l, m; of a Cylinder with its stand-off radius.
        radius: radius of the stand-off disc, m; zero for a Cylinder.
        wind_x: velocity of the air over the evader's speed.
        wind_y: velocity of the air over the evader's speed.
        safe: how far the evader runs before the pursuer can be at its height, m; zero for a Ball.
    """

    ratio: Array
    curvature: Array
    x: Array
    y: Array
    z: Array
    capture: Array
    radius: Array
    wind_x: Array
    wind_y: Array
    safe: Array

    def pick(self, index: Any) -> "Regions":  # noqa: ANN401 - whatever indexes an array
        """Return some of the regions."""
        return Regions(*(part[index] if is_array(part) else part for part in self))

    def beside(self) -> "Regions":
        """Return the regions with an axis for headings, (..., 1, n)."""
        return self.pick((..., None, slice(None)))


class RunEnd(NamedTuple):
    """The end of a run, at the edge of a region (of a Cylinder's: of its horizontal game).

    Attributes:
        reach: length of the run, m.
        away: x and y to the end from the point of the stand-off disc closest to it, carried with the air, m.
        root: half the difference of both roots of the quadratic in ρ, times κ, m.
    """

    reach: Array
    away: PlaneArrays
    root: Array


def regions_of(game: Game, P: Array, E: Array) -> Regions:
    """Return the regions of evaders E against pursuers P, (..., n, 3); numbers of the game may be arrays (..., n)."""
    w = P - E
    v = game.evader_speed_m_s
    height: Array = w[..., 2] - game.standoff.height_m
    radius, capture, z = game.pursuer.planar(
        NUMPY, game.standoff.radius_m, game.capture_radius_m, height
    )
    safe = 0.0
    if game.pursuer.separate:
        safe_s = game.pursuer.level_time(NUMPY, game.capture_radius_m, height)
        safe = np.maximum(v * safe_s, 0.0)
    least = least_square_in_hand(game) / (v * v)
    wind_x = game.wind_m_s[0] / v
    wind_y = game.wind_m_s[1] / v
    ratio = game.pursuer.horizontal_m_s / v
    return Regions(ratio, least, w[..., 0], w[..., 1], z, capture, radius, wind_x, wind_y, safe)


def edge(regions: Regions, heading: PlaneArrays) -> RunEnd:  # noqa: PLR0914
    """Return how far a run along a heading of length 1 goes."""
    ratio, curvature, x, y, z, capture, radius, *wind, _ = regions
    nx, ny = heading
    if not all(map(is_zero, wind)):
        curvature = curvature + 2.0 * head_wind((wind[0], wind[1]), heading)
        nx = nx - wind[0]
        ny = ny - wind[1]
    behind_x = x
    behind_y = y
    open_region = not is_zero(radius)
    lead = ratio * capture
    beyond = z * z - capture * capture
    for _ in range(_ROUNDS if open_region else 1):
        power = x * x + y * y + beyond
        half = x * nx + y * ny + lead
        root = np.sqrt(half * half + curvature * power)
        ahead = half > 0
        roots = abs(half) + root
        reach = np.where(ahead, power, roots) / np.where(ahead, roots, curvature)
        away = reach * nx - behind_x, reach * ny - behind_y
        if open_region:
            far = NUMPY.norm2(away)
            share = radius / np.where(far > 0, far, 1.0)
            x = behind_x + share * away[0]
            y = behind_y + share * away[1]
    if open_region:
        met = np.maximum(abs(z) - capture, 0.0) / ratio
        within = radius + np.sqrt(np.maximum(-beyond, 0.0))
        above = NUMPY.norm2((met * nx - behind_x, met * ny - behind_y)) <= within
        share = np.where(above, 0.0, np.maximum(1.0 - share, 0.0))
        reach = np.where(above, met, reach)
        away = (share * away[0], share * away[1])
    return RunEnd(np.maximum(reach, 0.0), away, root)


def survived(regions: Regions, heading: PlaneArrays) -> Array:
    """Return how far a run goes along a heading, (..., 1), before each pursuer captures the evader, (..., n)."""
    return np.maximum(edge(regions, heading).reach, regions.safe)


def crossing(
    pairs: Regions, begin: PlaneArrays, end: PlaneArrays, middle: PlaneArrays
) -> PlaneArrays:
    """Return the heading along which both of two regions reach equally far, (...).

    Args:
        pairs: the two regions, (..., 2).
        begin: a heading along which the first reaches farther, (...).
        end: a heading along which the second does, (...).
        middle: the heading halfway between them, on the side where the edges cross.
    """
    mx, my = middle
    low, high = (cross2(middle, to) / (1.0 + mx * to[0] + my * to[1]) for to in (begin, end))
    settled = low == high
    half = NUMPY.half_of_digits(mx)
    s = _without_disc(pairs, middle)
    s = np.where((s - low) * (s - high) < 0, s, 0.0)
    for _ in range(_STEPS):
        # By how much the first of two regions reaches farther, and its rate by the heading.
        heading = _turned(middle, s)
        headings = for_each(heading)
        ends = edge(pairs, headings)
        turn = ends.reach * cross2(headings, ends.away) / ends.root
        gap = ends.reach[..., 0] - ends.reach[..., 1]
        rate = turn[..., 0] - turn[..., 1]
        low = np.where(gap > 0, s, low)
        high = np.where(gap > 0, high, s)
        newton = s - 0.5 * (1.0 + s * s) * gap / rate
        bisected = 0.5 * (low + high)
        met = gap == 0
        sound = ((newton - low) * (newton - high) < 0) | met
        new = np.where(met, s, np.where(sound, newton, bisected))
        near = abs(new - s) <= half * (sound + half)
        s = np.where(settled, s, new)
        settled = settled | near
        if settled.all():
            break
    return _turned(middle, s)


def _without_disc(pairs: Regions, middle: PlaneArrays) -> Array:
    """Return the tangent of half the angle from `middle` to the crossing, if capture, disc and wind only add to ‖W‖².

    The edges are circles then, κ X² + 2 W·X = ‖W‖², and cross on a line a·X = b. The crossing is given times κ a².
    """
    curvature = pairs.curvature + 0.0 * pairs.x
    power = pairs.z * pairs.z - pairs.capture * pairs.capture
    power = power + (pairs.x * pairs.x + pairs.y * pairs.y)
    parts = (pairs.x, pairs.y, 0.5 * power)
    ax, ay, b = (
        curvature[..., 1] * part[..., 0] - curvature[..., 0] * part[..., 1] for part in parts
    )
    curvature, x, y, power = (
        part[..., 0] + part[..., 1] for part in (curvature, pairs.x, pairs.y, power)
    )
    half = ax * y - ay * x
    lead = curvature * b
    beyond = power * (ax * ax + ay * ay) - b * (lead + 2.0 * (ax * x + ay * y))
    root = np.sqrt(half * half + curvature * beyond)
    along = np.copysign(root, cross2((ax, ay), middle)) - half
    to = (lead * ax - along * ay, lead * ay + along * ax)
    ahead = NUMPY.norm2(to) + middle[0] * to[0] + middle[1] * to[1]
    return np.asarray(cross2(middle, to) / ahead)


def halfway(begin: PlaneArrays, end: PlaneArrays) -> PlaneArrays:
    """Return the heading halfway between two; between opposite ones that with larger y, then larger x."""
    x = begin[0] - end[0]
    y = begin[1] - end[1]
    is_negative = (x < 0) | ((x == 0) & (y > 0))
    side = np.where(is_negative, -ASIDE, ASIDE)
    return unit((begin[0] + end[0] - side * y, begin[1] + end[1] + side * x))


def _turned(middle: PlaneArrays, s: Array) -> PlaneArrays:
    """Return a heading by the tangent of half its angle from another."""
    scale = 1.0 / (1.0 + s * s)
    cosine = (1.0 - s * s) * scale
    sine = (s + s) * scale
    return in_plane(middle, (cosine, sine))


def for_each(point: PlaneArrays) -> PlaneArrays:
    """Return a vector (...) with one more axis, for all pursuers of its row."""
    return point[0][..., None], point[1][..., None]


def unit(v: PlaneArrays) -> PlaneArrays:
    """Return the direction of plane vectors."""
    size = NUMPY.norm2(v)
    return v[0] / size, v[1] / size
