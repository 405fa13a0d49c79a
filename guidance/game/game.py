"""What is played: the speeds, what counts as capture, what the world adds. One record for every combination."""

import math
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

from guidance.errors import ConfigError
from guidance.game.arrays import Real
from guidance.game.checks import is_array, is_zero, require, require_fields, require_pair

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

STILL = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Ball:
    """The paper's speed set, eq. (2): the pursuer flies in any direction at up to `speed_m_s`.

    Raises:
        ConfigError: the speed is not a positive, finite number.
    """

    speed_m_s: Real

    def __post_init__(self) -> None:
        require_fields(self)


@dataclass(frozen=True, slots=True)
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

    def __post_init__(self) -> None:
        require_fields(self)


SpeedSet: TypeAlias = Ball | Cylinder


@dataclass(frozen=True, slots=True)
class StandOff:
    """Where the pursuer shall end: on the disc of `radius_m` around the evader, `height_m` above its plane.

    Zero for both is the paper's point capture. A vehicle must never play that: it ends on the ground.

    Raises:
        ConfigError: a length is negative or not finite.
    """

    radius_m: Real = 0.0
    height_m: Real = 0.0

    def __post_init__(self) -> None:
        require_fields(self, zero_allowed=True)


POINT_CAPTURE = StandOff()


@dataclass(frozen=True, slots=True)
class Game:
    """One pursuer against one evader in a plane (Li, Wang & Xie, section II-A), with what a vehicle adds to it.

    Speeds, lengths and the age may be arrays of the leading shape of the states, one number for each game of a batch.
    Those are not checked here: `solve` answers NaN, with the reason, in the rows where one is not allowed.

    Attributes:
        pursuer: speed set of the pursuer through the air.
        evader_speed_m_s: bound v of the evader's speed over the ground.
        capture_radius_m: distance l from the stand-off disc that counts as capture.
        standoff: the disc (R, h) around the evader; point capture by default.
        information_age_s: age τ of the evader's position, in which it ran on unseen; the pursuer's own is up to date.
        wind_m_s: velocity (x, y) of the air, which carries the pursuer and not the evader.
        target_velocity_m_s: velocity (x, y) of the evader's target. Zero is the paper's game. Anything else is a
            heuristic: the target is taken to keep this velocity, and the players to meet where it is closest then.
        evader_space: "plane", or "space" for the evader of the paper's remark, which moves in three dimensions.

    Raises:
        ConfigError: a number is not finite or out of range, the pursuer has no speed in hand (δ ≤ 1), the target
            outruns the evader, or an evader in space meets an extension that is defined in the plane only.
    """

    pursuer: SpeedSet
    evader_speed_m_s: Real
    capture_radius_m: Real = 0.0
    standoff: StandOff = POINT_CAPTURE
    information_age_s: Real = 0.0
    wind_m_s: tuple[float, float] = STILL
    target_velocity_m_s: tuple[float, float] = STILL
    evader_space: Literal["plane", "space"] = "plane"
    varies: bool = field(init=False, repr=False, compare=False)
    """Whether a parameter differs from row to row."""

    def __post_init__(self) -> None:
        require("evader_speed_m_s", self.evader_speed_m_s)
        require("capture_radius_m", self.capture_radius_m, zero_allowed=True)
        require("information_age_s", self.information_age_s, zero_allowed=True)
        require_pair("wind_m_s", self.wind_m_s)
        require_pair("target_velocity_m_s", self.target_velocity_m_s)
        object.__setattr__(self, "varies", any(is_array(value) for value in parameters(self).values()))
        self._require_speeds()
        self._require_space()

    def _require_speeds(self) -> None:
        hand = speed_in_hand(self)
        if not is_array(hand) and not hand > 0:
            raise ConfigError(
                f"evader_speed_m_s = {self.evader_speed_m_s!r} with {self.pursuer!r} and wind_m_s = {self.wind_m_s!r}: "
                "the pursuer must be faster than evader and wind together (speed ratio δ > 1); a slower pursuer is "
                "another game"
            )
        target = math.hypot(*self.target_velocity_m_s)
        if not is_array(self.evader_speed_m_s) and not target < self.evader_speed_m_s:
            raise ConfigError(
                f"target_velocity_m_s = {self.target_velocity_m_s!r}: must be slower than the evader "
                f"({self.evader_speed_m_s!r} m/s), which otherwise never reaches its target"
            )

    def _require_space(self) -> None:
        if self.evader_space == "plane":
            return
        if self.evader_space != "space":
            raise ConfigError(f"evader_space = {self.evader_space!r}: must be 'plane' or 'space'")
        plain = self.standoff is POINT_CAPTURE or (is_zero(self.standoff.radius_m) and is_zero(self.standoff.height_m))
        if not (plain and isinstance(self.pursuer, Ball) and is_calm(self) and self.target_velocity_m_s == STILL):
            raise ConfigError(
                "evader_space = 'space': an evader that flies is defined for the speed set Ball, without stand-off, "
                "wind or moving target"
            )


def horizontal_speed(pursuer: SpeedSet) -> Real:
    """Return the largest horizontal speed of a speed set, m/s; δ compares this one with the evader's."""
    return pursuer.speed_m_s if isinstance(pursuer, Ball) else pursuer.horizontal_m_s


def speed_in_hand(game: Game) -> Real:
    """Return by how much the pursuer outruns the evader against the wind, m/s; without it there is no capture."""
    return horizontal_speed(game.pursuer) - game.evader_speed_m_s - math.hypot(*game.wind_m_s)


def is_calm(game: Game) -> bool:
    """Say whether there is no wind."""
    return game.wind_m_s == STILL


def parameters(game: Game) -> dict[str, Real]:
    """Return every number of a game that may differ from row to row, by name."""
    own = {
        "evader_speed_m_s": game.evader_speed_m_s,
        "capture_radius_m": game.capture_radius_m,
        "information_age_s": game.information_age_s,
        "radius_m": game.standoff.radius_m,
        "height_m": game.standoff.height_m,
    }
    pursuer = game.pursuer
    if isinstance(pursuer, Ball):
        return own | {"speed_m_s": pursuer.speed_m_s}
    return own | {
        "horizontal_m_s": pursuer.horizontal_m_s,
        "climb_m_s": pursuer.climb_m_s,
        "descent_m_s": pursuer.descent_m_s,
    }


def for_rows(game: Game, index: object) -> Game:
    """Return the game of some rows: every parameter that is an array, indexed alike (`...` and None are fine too)."""
    if not game.varies:
        return game
    pursuer = replace(game.pursuer, **_indexed(game.pursuer, index))
    standoff = replace(game.standoff, **_indexed(game.standoff, index))
    return replace(game, pursuer=pursuer, standoff=standoff, **_indexed(game, index))


def _indexed(record: "DataclassInstance", index: object) -> dict[str, Real]:
    values = {part.name: getattr(record, part.name) for part in fields(record) if part.init}
    return {name: value[index] for name, value in values.items() if is_array(value)}
