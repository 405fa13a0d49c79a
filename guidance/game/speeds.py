"""How fast the pursuer flies: the paper's ball of velocities, or a multicopter's cylinder."""

from dataclasses import dataclass
from typing import TypeAlias

from guidance.game.arrays import Real
from guidance.game.records import record_hash, same_record, take_fields


@dataclass(frozen=True, slots=True, eq=False)
class Ball:
    """The paper's speed set, eq. (2): the pursuer flies in any direction at up to `speed_m_s`.

    Raises:
        ConfigError: the speed is not a positive, finite number.
    """

    speed_m_s: Real
    __eq__ = same_record
    __hash__ = record_hash

    def __post_init__(self) -> None:
        take_fields(self)


@dataclass(frozen=True, slots=True, eq=False)
class Cylinder:
    """A multicopter's speed set: horizontal and vertical speed bounded each by itself, climb and descent apart.

    PX4 calls the bounds MPC_XY_VEL_MAX (12 m/s), MPC_Z_VEL_MAX_UP (3 m/s) and MPC_Z_VEL_MAX_DN (1.5 m/s). The capture
    radius of a game on this set is measured in the same way: horizontal and vertical distance each by itself.

    Raises:
        ConfigError: a speed is not a positive, finite number.
    """

    horizontal_m_s: Real
    climb_m_s: Real
    descent_m_s: Real
    __eq__ = same_record
    __hash__ = record_hash

    def __post_init__(self) -> None:
        take_fields(self)


SpeedSet: TypeAlias = Ball | Cylinder


def horizontal_speed(pursuer: SpeedSet) -> Real:
    """Return the largest horizontal speed of a speed set, m/s; δ compares this one with the evader's."""
    return pursuer.speed_m_s if isinstance(pursuer, Ball) else pursuer.horizontal_m_s
