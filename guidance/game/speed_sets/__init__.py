"""The pursuer's speed sets. One module describes each; `register` adds another from outside.

    SpeedSet: what a game, a flight and a simulation ask of a speed set.
    Ball, Cylinder: the paper's set, and a multicopter's.
    Planar, Short: answers of a speed set.
    SPEED_SETS: every speed set by name. `speed_set_named` looks one up.
    bounded: shortens velocities to a speed.

Examples:
    A scenario or a vehicle file names a set and gives three speeds:

    >>> from guidance.game.speed_sets import speed_set_named
    >>> speed_set_named("ball").of(12.0, 3.0, 1.5)
    Ball(speed_m_s=12.0)
"""

from guidance.game.speed_sets.ball import Ball
from guidance.game.speed_sets.cylinder import Cylinder
from guidance.game.speed_sets.speed_set import Planar, Short, SpeedSet, bounded
from guidance.registry import Registry

SPEED_SETS: Registry[type[SpeedSet]] = Registry(
    "speed set",
    "speed_set",
    "pursuit_guidance.speed_sets",
    {Ball.name: Ball, Cylinder.name: Cylinder},
)
"""The speed sets that files can name. Add one with `register`."""


def register(kind: type[SpeedSet]) -> None:
    """Add a speed set under its name, as `Registry.add` does."""
    SPEED_SETS.add(kind.name, kind)


def speed_set_named(name: str) -> type[SpeedSet]:
    """Return a speed set by its name, as `Registry.named` does."""
    return SPEED_SETS.named(name)


__all__ = [
    "SPEED_SETS",
    "Ball",
    "Cylinder",
    "Planar",
    "Short",
    "SpeedSet",
    "bounded",
    "register",
    "speed_set_named",
]
