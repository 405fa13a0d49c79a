"""What passes between the kernels: a state taken apart, and an answer not yet put together."""

from typing import NamedTuple

from guidance.game.arrays import Array, Library, Plane, Space, bounded2, component, norm2
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
    seen: Plane | None
    """Observed velocity of the evader, at most v, m/s; None where it is unknown."""

    @property
    def hold(self) -> Plane:
        """Velocity of a pursuer that has nothing to gain: the evader's, or none."""
        return (0.0, 0.0) if self.seen is None else self.seen


class Play(NamedTuple):
    """A kernel's answer by components; see `Solution`."""

    winner: Array
    value: Array
    margin: Array
    meeting: Space
    time: Array
    pursuer: Space
    evader: Space
    reason: Array


def take_apart(xp: Library, game: Game, P: Array, E: Array, seen: Array | None) -> State:
    """Take a state apart, `seen` being the evader's observed velocity (..., 3) or None."""
    evader = (component(E, 0), component(E, 1))
    ground = component(E, 2)
    to_evader = (evader[0] - component(P, 0), evader[1] - component(P, 1))
    z = component(P, 2) - ground - game.standoff.height_m
    velocity = None
    if seen is not None:
        velocity = bounded2(xp, (component(seen, 0), component(seen, 1)), game.evader_speed_m_s)
    return State(evader, ground, to_evader, norm2(xp, to_evader), z, velocity)
