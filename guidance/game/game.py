"""The definition of a game: speeds, capture, wind, information age; and the codes of its answer.

One record describes every combination. It checks its numbers and keeps them as floats, and arrays as floating point
arrays. Two games are equal if their numbers are; the types given do not matter.
"""

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final, Literal

from guidance.errors import ConfigError
from guidance.game.arrays import (
    Plane,
    Real,
    is_array,
    less_length,
    library_of,
    pair_length,
)
from guidance.game.extent import POINT, Extent
from guidance.game.records import (
    Numbers,
    exchanged,
    is_zero,
    names_of,
    require,
    require_kind,
    take,
    take_pair,
)
from guidance.game.speed_sets import SpeedSet

NO_WIND = (0.0, 0.0)

_SPEED_SETS: Final = (
    "a speed set, as Ball(speed_m_s) or Cylinder(horizontal_m_s, climb_m_s, descent_m_s)"
)


class Code(IntEnum):
    """A number in arrays, with a word for people and files."""

    @property
    def word(self) -> str:
        """The name in lower case, as in files, JSON and tables."""
        return self.name.lower()


class Winner(Code):
    """The winner of a game."""

    EVADER = -1
    UNDECIDED = 0
    """The state lies on the barrier, or has no answer."""
    PURSUER = 1


class Reason(Code):
    """The kind of an answer: below 10 it is finite, from 10 on it is NaN for this reason."""

    SOLVED = 0
    CAPTURED = 1
    """The evader is already captured."""
    OVERHEAD = 2
    """The pursuer is right above the evader, or will be for any heading: all headings are equally good."""
    ARRIVED = 3
    """The evader is already at its target."""
    ON_BARRIER = 4
    """Both players reach the target at the same instant."""
    TOO_OLD = 5
    """The evader's position is older than `guaranteed_age_s` (PE), or has any age (TAD). Value and winner hold for an
    evader that keeps its heading from when it was seen; others can do better, so there is no guarantee."""
    BRACKET = 6
    """Several pursuers without a proven value: `value` is their guarantee, `lower_bound` the evader's."""
    NOT_FINITE = 10
    """A position or velocity is NaN or infinite."""
    PURSUER_TOO_SLOW = 11
    """δ ≤ 1: the pursuer is not faster than evader and wind together."""
    OUT_OF_RANGE = 12
    """A parameter of this row is negative, zero or not finite, and must not be."""
    OVERFLOW = 13
    """The numbers are so large that their squares, or products of these, are infinite."""
    NO_REGION = 14
    """TAD with an old position of the evader, where no value is known. It is older than `guaranteed_age_s`, or the
    distance of the evader's straight runs from the target has no single minimum: the region that the evader reaches
    first is not convex, or a part of its spread v τ can be captured now. Play `Game.within_spread` instead."""


@dataclass(frozen=True, slots=True, eq=False)
class StandOff(Numbers):
    """The disc that the pursuer aims for: `radius_m` around the evader, `height_m` above its plane.

    Zero for both is the paper's point capture. A vehicle must never play it, because it ends on the ground.

    Raises:
        ConfigError: a length is negative or not finite.
    """

    zero_allowed = True

    radius_m: Real = 0.0
    height_m: Real = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Game(Numbers):
    """One pursuer against one evader in a plane (Li, Wang & Xie, section II-A), with the extensions of a vehicle.

    Speeds, lengths and the age may be arrays of the leading shape of the states, one number for each game of a batch.
    Arrays are not checked here: `solve` answers NaN, with the reason, in rows with a number that is not allowed.

    Attributes:
        pursuer: speed set of the pursuer through the air.
        evader_speed_m_s: bound v of the evader's speed over the ground.
        capture_radius_m: distance l from the stand-off disc that counts as capture.
        standoff: the disc (R, h) around the evader; point capture by default.
        information_age_s: age τ of the evader's position; the pursuer's own position is up to date. In PE the value
            is guaranteed up to `guaranteed_age_s`; beyond it is open-loop (`Reason.TOO_OLD`). In TAD it is open-loop at
            any age, and unknown where the region is not convex, as beyond `guaranteed_age_s` (`Reason.NO_REGION`).
        wind_m_s: velocity (x, y) of the air, which carries the pursuer and not the evader; numbers or arrays.
        target_velocity_m_s: velocity (x, y) of the evader's target; zero in the paper's game. The answer is exact if
            this velocity is constant (it is a change of frame), and not if the target manoeuvres.
        evader_space: "plane", or "space" for the evader of the paper's remark, which moves in three dimensions.
        target_extent: the target's shape about its position; a point by default.

    Raises:
        ConfigError: a number is not finite or out of range, the pursuer is no speed set or the stand-off no disc, the
            pursuer is too slow (δ ≤ 1), the target outruns the evader, or an evader in space is combined with an
            extension that is defined in the plane only.
    """

    pursuer: SpeedSet
    evader_speed_m_s: Real
    capture_radius_m: Real = 0.0
    standoff: StandOff = field(default_factory=StandOff)
    information_age_s: Real = 0.0
    wind_m_s: Plane = NO_WIND
    target_velocity_m_s: tuple[float, float] = NO_WIND
    evader_space: Literal["plane", "space"] = "plane"
    target_extent: Extent = POINT
    varies: bool = field(init=False, repr=False)
    """True if a parameter is an array."""
    calm: bool = field(init=False, repr=False)
    """True without wind."""

    def __post_init__(self) -> None:
        require_kind("pursuer", self.pursuer, (SpeedSet,), _SPEED_SETS)
        require_kind("standoff", self.standoff, (StandOff,), "a disc, StandOff(radius_m, height_m)")
        require_kind(
            "target_extent", self.target_extent, (Extent,), "a shape, Extent(corners_m, radius_m)"
        )
        take(self, "evader_speed_m_s")
        take(self, "capture_radius_m", zero_allowed=True)
        take(self, "information_age_s", zero_allowed=True)
        take_pair(self, "wind_m_s", rows_allowed=True)
        take_pair(self, "target_velocity_m_s")
        arrays = {name: value for name, value in parameters(self).items() if is_array(value)}
        if arrays:
            library_of(arrays)
        object.__setattr__(self, "varies", bool(arrays))
        object.__setattr__(self, "calm", all(map(is_zero, self.wind_m_s)))
        self._require_speeds()
        if self.evader_space != "plane":
            if self.evader_space != "space":
                raise ConfigError(
                    f"evader_space = {self.evader_space!r}: must be 'plane' or 'space'"
                )
            plain = (
                is_zero(self.standoff.radius_m)
                and is_zero(self.standoff.height_m)
                and self.target_extent == POINT
            )
            if not (
                plain
                and self.pursuer.isotropic
                and self.calm
                and self.target_velocity_m_s == NO_WIND
            ):
                allowed = "the speed set Ball, without stand-off, wind, or a target that moves or has an extent"
                raise ConfigError(
                    f"evader_space = 'space': an evader that flies is defined for {allowed}"
                )

    def against(
        self, evader_speed_m_s: float, information_age_s: float, horizontal_m_s: float | None = None
    ) -> "Game":
        """Return the same game against an evader of this speed, seen this long ago; only these numbers are checked.

        A flight uses it every cycle: only these numbers and `within_spread` change. `horizontal_m_s` is another
        horizontal speed of the pursuer, positive; None keeps it.

        Raises:
            ConfigError: a number is not finite or out of range, or the evader is too fast.
        """
        if not (0.0 < evader_speed_m_s < math.inf and 0.0 <= information_age_s < math.inf):
            require("evader_speed_m_s", evader_speed_m_s)
            require("information_age_s", information_age_s, zero_allowed=True)
        pursuer = self.pursuer
        if horizontal_m_s is not None and horizontal_m_s != pursuer.horizontal_m_s:
            pursuer = pursuer.at(horizontal_m_s)
        speed_m_s = float(evader_speed_m_s)
        age_s = float(information_age_s)
        changed = exchanged(
            self, pursuer=pursuer, evader_speed_m_s=speed_m_s, information_age_s=age_s
        )
        target_m_s = math.hypot(*self.target_velocity_m_s)
        is_plain = self.calm and not self.varies
        if not (is_plain and target_m_s < speed_m_s < pursuer.horizontal_m_s):
            Game._require_speeds(changed)
        return changed

    def within_spread(self) -> "Game":
        """Return the game without information age whose disc is smaller by vτ, the distance that E may have run unseen.

        A pursuer that is on the smaller disc around the last known position is on the larger disc around the evader.
        """
        spread_m = self.evader_speed_m_s * self.information_age_s
        smaller = exchanged(self.standoff, radius_m=max(self.standoff.radius_m - spread_m, 0.0))
        return exchanged(self, standoff=smaller, information_age_s=0.0)

    def _require_speeds(self) -> None:
        hand = speed_in_hand(self)
        if isinstance(hand, float) and not hand > 0:
            raise ConfigError(
                f"evader_speed_m_s = {self.evader_speed_m_s!r} with {self.pursuer!r} and wind_m_s = {self.wind_m_s!r}: "
                "the pursuer must be faster than evader and wind together (speed ratio δ > 1); a slower pursuer is "
                "another game"
            )
        target = math.hypot(*self.target_velocity_m_s)
        if isinstance(self.evader_speed_m_s, float) and not target < self.evader_speed_m_s:
            allowed = f"must be slower than the evader ({self.evader_speed_m_s!r} m/s)"
            raise ConfigError(f"target_velocity_m_s = {self.target_velocity_m_s!r}: {allowed}")


def speed_in_hand(game: Game) -> Real:
    """Return u − v − ‖w‖, m/s: the pursuer's least closing speed on a fleeing evader."""
    if game.calm:
        return game.pursuer.horizontal_m_s - game.evader_speed_m_s
    return less_length(game.pursuer.horizontal_m_s, game.evader_speed_m_s, game.wind_m_s)


def guaranteed_age_s(game: Game) -> Real:
    """Return the age of the evader's position up to which the value of PE is guaranteed, s.

    An evader seen τ seconds ago may be anywhere within vτ. Capture is certain once the pursuer reaches all this disc.
    The points for which this holds after t grow with the players' own speeds (they form a semigroup) only while

        vτ ≤ R + (v/u) l for a Ball,    vτ ≤ R + l for a Cylinder (and for the sphere of an evader in space).

    Beyond, the value holds for an evader that keeps its heading, and another evader can beat it.

    In TAD the value can be beaten at any age, and near the pursuer there may be none (`Reason.NO_REGION`). It assumes a
    capture at the point of the region closest to the target, but the evader may be elsewhere within vτ of it. A
    guarantee up to this age is the value of `Game.within_spread`, played against the last known position, less vτ (for
    l = 0).
    """
    capture = game.capture_radius_m
    v = game.evader_speed_m_s
    if game.evader_space == "space":
        return (game.standoff.radius_m + capture) / v
    return game.pursuer.guaranteed_age_s(game.standoff.radius_m, capture, v)


def head_wind(wind: Plane, n: Plane) -> Real:
    """Return ‖w‖ + n·w, m/s: how much less the wind hinders the pursuer than the worst wind against heading n.

    It is computed as ‖w‖ ‖n + w/‖w‖‖²/2, without cancellation.
    """
    strength = pair_length(wind)
    inverse = 1.0 / (strength + (strength == 0))
    x = n[0] + wind[0] * inverse
    y = n[1] + wind[1] * inverse
    return 0.5 * strength * (x * x + y * y)


def least_square_in_hand(game: Game) -> Real:
    """Return u² − (v + ‖w‖)², for an evader that runs up the wind, m²/s².

    For an evader that runs along n it is u² − ‖v n − w‖², 2 v (‖w‖ + n·w) more; see `head_wind`.
    """
    u = game.pursuer.horizontal_m_s
    v = game.evader_speed_m_s
    return speed_in_hand(game) * (u + v + pair_length(game.wind_m_s))


def parameters(game: Game) -> dict[str, Real]:
    """Return every number of a game that may be an array, by name."""
    names = ("evader_speed_m_s", "capture_radius_m", "information_age_s")
    wind_x, wind_y = game.wind_m_s
    numbers = {name: getattr(game, name) for name in names} | {
        "wind_x_m_s": wind_x,
        "wind_y_m_s": wind_y,
    }
    others = (game.standoff, game.pursuer)
    return numbers | {name: getattr(record, name) for record in others for name in names_of(record)}
