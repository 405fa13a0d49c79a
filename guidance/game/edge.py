"""The point of the evader's region closest to its target: g* of the paper, and what becomes of it in every other game.

Without capture radius, stand-off disc, age and wind the region is the Apollonius disc. A Cylinder's region is the
planar one together with the disc ‖X − E‖ ≤ v (t_z + τ) that the evader has while the pursuer's height is not yet spent;
its pursuer flies horizontally by the planar region alone. Every other region is searched over headings (`search`).
"""

from typing import NamedTuple

from guidance.game.arrays import Array, Library, Plane, dot2, norm2, positive_part, select, select2, unit2
from guidance.game.checks import is_zero
from guidance.game.game import STILL, Ball, Cylinder, Game, horizontal_speed, is_calm
from guidance.game.play import State
from guidance.game.reach import level_time
from guidance.game.search import closest_heading


class Edge(NamedTuple):
    """Where the evader ends, from where it is, and what the pursuer steers by horizontally."""

    run: Plane
    time: Array
    lead: Plane
    lead_time: Array
    left: Array
    """Distance from the target at the end, m."""


def edge_point(xp: Library, game: Game, state: State, to_target: Plane, goal: Plane) -> Edge:
    """Find the closest point of the evader's region to its target.

    Args:
        xp: array library.
        game: the game.
        state: the state.
        to_target: vector from the evader to the target now, m.
        goal: vector from the evader to where it could meet its target, m.
    """
    if is_circle(game):
        height = state.z if isinstance(game.pursuer, Ball) else 0.0 * state.z
        ratio = horizontal_speed(game.pursuer) / game.evader_speed_m_s
        near = circle_point(xp, ratio, state.to_evader, height, to_target)
        near_time = norm2(xp, near) / game.evader_speed_m_s
    else:
        near, near_time = closest_heading(xp, game, state, to_target, goal)
    left = norm2(xp, at_time(to_target, game, near_time, near))
    if isinstance(game.pursuer, Ball):
        return Edge(near, near_time, near, near_time, left)
    return _with_falling(xp, game, game.pursuer, state, to_target, Edge(near, near_time, near, near_time, left))


def at_time(to_target: Plane, game: Game, t: Array, run: Plane) -> Plane:
    """Return the vector from the end of the evader's run to where the target is then."""
    adrift = game.target_velocity_m_s
    if adrift == STILL:
        return to_target[0] - run[0], to_target[1] - run[1]
    return to_target[0] + adrift[0] * t - run[0], to_target[1] + adrift[1] * t - run[1]


def _with_falling(xp: Library, game: Game, pursuer: Cylinder, state: State, to_target: Plane, level: Edge) -> Edge:
    """Join the disc that the evader has while the pursuer's height is not spent to the planar region."""
    falling = positive_part(level_time(xp, game, pursuer, state.z))
    radius = game.evader_speed_m_s * (falling + game.information_age_s)
    goal = at_time(to_target, game, falling, STILL)
    far = norm2(xp, goal)
    towards = unit2(xp, goal, far)
    closer = far - radius < level.left
    return level._replace(
        run=select2(xp, closer, (radius * towards[0], radius * towards[1]), level.run),
        time=select(xp, closer, falling, level.time),
        left=select(xp, closer, abs(far - radius), level.left),
    )


def is_circle(game: Game) -> bool:
    """Say whether the region, of a Cylinder its planar part, is the Apollonius disc of the paper."""
    lengths = (game.capture_radius_m, game.standoff.radius_m, game.information_age_s)
    return is_calm(game) and game.target_velocity_m_s == STILL and all(is_zero(length) for length in lengths)


def circle_point(xp: Library, ratio: Array, to_evader: Plane, z: Array, to_target: Plane) -> Plane:
    """Return g* − E, for the Apollonius circle of centre c = E + (E − P)/(δ² − 1) (section IV-B)."""
    hand = ratio * ratio - 1.0
    centre = (to_evader[0] / hand, to_evader[1] / hand)
    radius = xp.sqrt(z * z * hand + ratio * ratio * dot2(to_evader, to_evader)) / hand
    out = (to_target[0] - centre[0], to_target[1] - centre[1])
    direction = unit2(xp, out, norm2(xp, out))
    return centre[0] + radius * direction[0], centre[1] + radius * direction[1]
