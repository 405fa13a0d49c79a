"""What is played: the players' speeds, what counts as capture, and what the world adds. One record for every combination."""

import math
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, TypeAlias

from guidance.errors import ConfigError
from guidance.game.arrays import Real
from guidance.game.checks import is_array, is_finite, is_number, require, require_fields

ZERO_XY = (0.0, 0.0)


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

    The defaults of PX4 are MPC_XY_VEL_MAX 12, MPC_Z_VEL_MAX_UP 3 and MPC_Z_VEL_MAX_DN 1.5 m/s. The capture radius of a
    game on this set is measured the same way: horizontal and vertical distance each by itself.

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
    """Where the pursuer shall end: the disc of `radius_m` around the evader, `height_m` above its plane.

    Zero for both is the paper's point capture, which a vehicle must never play: it ends on the ground.

    Raises:
        ConfigError: a length is negative or not finite.
    """

    radius_m: Real = 0.0
    height_m: Real = 0.0

    def __post_init__(self) -> None:
        require_fields(self, zero_allowed=True)


@dataclass(frozen=True, slots=True)
class Game:
    """One pursuer against one evader in a plane (Li, Wang & Xie, eqs. (1) to (3)), with what a vehicle adds to the paper.

    Speeds and lengths may be arrays of the leading shape of the states, one for each game of a batch. Those are not
    checked here: `solve` answers NaN, with the reason, for the rows that are not allowed.

    Attributes:
        pursuer: speed set of the pursuer through the air.
        evader_speed_m_s: bound v of the evader's speed over the ground.
        capture_radius_m: distance l from the stand-off disc that counts as capture.
        standoff: the disc (R, h) around the evader; point capture by default.
        information_age_s: age τ of the evader's position: in this time it ran on unseen, while the pursuer's is known now.
        wind_m_s: velocity (x, y) of the air, which carries the pursuer and not the evader.
        target_velocity_m_s: velocity (x, y) of the evader's target. Zero is the paper's game. Otherwise a heuristic: the
            players meet where the target will be closest at the time of meeting, on the straight line that it follows now.
        evader_space: "plane", or "space" for the evader of the paper's remark, which moves in all three dimensions.

    Raises:
        ConfigError: a number is not finite or out of range, the pursuer has no speed in hand (δ ≤ 1), the target outruns
            the evader, or an evader in space meets an extension that is defined in the plane only.
    """

    pursuer: SpeedSet
    evader_speed_m_s: Real
    capture_radius_m: Real = 0.0
    standoff: StandOff = StandOff()
    information_age_s: Real = 0.0
    wind_m_s: tuple[float, float] = ZERO_XY
    target_velocity_m_s: tuple[float, float] = ZERO_XY
    evader_space: Literal["plane", "space"] = "plane"

    def __post_init__(self) -> None:
        require("evader_speed_m_s", self.evader_speed_m_s)
        require("capture_radius_m", self.capture_radius_m, zero_allowed=True)
        require("information_age_s", self.information_age_s, zero_allowed=True)
        for name, pair in (("wind_m_s", self.wind_m_s), ("target_velocity_m_s", self.target_velocity_m_s)):
            if len(pair) != 2 or not all(is_finite(part) for part in pair):
                raise ConfigError(f"{name} = {pair!r}: give two finite numbers (x, y) in m/s")
        self._check_speeds()
        self._check_space()

    def _check_speeds(self) -> None:
        hand = speed_in_hand(self)
        if is_number(hand) and not hand > 0:
            raise ConfigError(
                f"evader_speed_m_s = {self.evader_speed_m_s!r} with {self.pursuer!r} and wind_m_s = {self.wind_m_s!r}: the "
                "pursuer must be faster than the evader and the wind together (speed ratio δ > 1); a slower pursuer is "
                "another game"
            )
        outrun = math.hypot(*self.target_velocity_m_s)
        if is_number(self.evader_speed_m_s) and not outrun < self.evader_speed_m_s:
            raise ConfigError(
                f"target_velocity_m_s = {self.target_velocity_m_s!r}: must be slower than the evader "
                f"({self.evader_speed_m_s!r} m/s), which otherwise never reaches its target"
            )

    def _check_space(self) -> None:
        if self.evader_space not in ("plane", "space"):
            raise ConfigError(f"evader_space = {self.evader_space!r}: must be 'plane' or 'space'")
        plain = self.standoff == StandOff() and self.wind_m_s == ZERO_XY and self.target_velocity_m_s == ZERO_XY
        if self.evader_space == "space" and not (plain and isinstance(self.pursuer, Ball)):
            raise ConfigError(
                "evader_space = 'space': an evader that flies is defined for the speed set Ball without stand-off, wind or "
                "moving target"
            )


def horizontal_speed(pursuer: SpeedSet) -> Real:
    """Return the largest horizontal speed of a speed set, m/s; the speed ratio δ compares this one with the evader's."""
    return pursuer.speed_m_s if isinstance(pursuer, Ball) else pursuer.horizontal_m_s


def speed_in_hand(game: Game) -> Real:
    """Return by how much the pursuer outruns the evader against the wind, m/s; without it there is no capture."""
    return horizontal_speed(game.pursuer) - game.evader_speed_m_s - math.hypot(*game.wind_m_s)


def fan_out(game: Game) -> Game:
    """Give every parameter that is an array one more axis at the end, for a fan of headings per state."""

    def opened(record: Any) -> Any:  # noqa: ANN401
        values = {field.name: getattr(record, field.name) for field in fields(record)}
        arrays = {name: value[..., None] for name, value in values.items() if is_array(value)}
        return replace(record, **arrays) if arrays else record

    pursuer, standoff = opened(game.pursuer), opened(game.standoff)
    if pursuer is not game.pursuer or standoff is not game.standoff:
        game = replace(game, pursuer=pursuer, standoff=standoff)
    return opened(game)
