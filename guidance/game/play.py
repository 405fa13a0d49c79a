"""What passes between the kernels: a state taken apart, and an answer not yet put together."""

from typing import Any, NamedTuple

from guidance.game.arrays import Array, Plane, Real, Space, component, norm2, select
from guidance.game.game import Game


class State(NamedTuple):
    """A state of the game by components, each of the leading shape, with what every kernel needs of it."""

    evader: Plane
    """Position of the evader, m."""
    ground: Array
    """Height of the evader's plane, m."""
    to_evader: Plane
    """Horizontal vector from the pursuer to the evader, m."""
    distance: Array
    """Its length d, m."""
    z: Array
    """Height of the pursuer above the stand-off disc, m."""
    drift: Plane
    """Velocity over the ground that a pursuer with nothing to gain keeps: the evader's, where it is known, m/s."""


class Play(NamedTuple):
    """A kernel's answer by components."""

    winner: Array
    value: Array
    margin: Array
    meeting: Space
    time: Array
    pursuer: Space
    evader: Space
    reason: Array


def take_apart(xp: Any, game: Game, P: Array, E: Array, seen: Array | None) -> State:  # noqa: ANN401
    """Take a state apart, `seen` being the evader's observed velocity (..., 3) or None."""
    evader = (component(E, 0), component(E, 1))
    ground = component(E, 2)
    to_evader = (evader[0] - component(P, 0), evader[1] - component(P, 1))
    z = component(P, 2) - ground - game.standoff.height_m
    still = 0.0 * z
    drift: Plane = (still, still)
    if seen is not None:
        drift = bounded(xp, (component(seen, 0), component(seen, 1)), game.evader_speed_m_s)
    return State(evader, ground, to_evader, norm2(xp, to_evader), z, drift)


def bounded(xp: Any, v: Plane, bound: Real) -> Plane:  # noqa: ANN401
    """Shorten a plane vector to a bound, keeping its direction."""
    length = norm2(xp, v)
    scale = select(xp, length > bound, bound / select(xp, length > 0, length, 1.0), 1.0)
    return v[0] * scale, v[1] * scale
