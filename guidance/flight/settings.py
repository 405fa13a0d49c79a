"""What a flight needs to know beforehand: how long its phases may take, and what battery it takes to come home."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import StrEnum
from types import MappingProxyType

from guidance.autopilots import Autopilot
from guidance.cycle import CycleSettings
from guidance.errors import ConfigError
from guidance.flight.table import State
from guidance.frames import Vector

Corners = tuple[tuple[float, float], ...]
"""Latitude and longitude of each corner of a fence, degrees."""


class AfterCapture(StrEnum):
    """What to do at the stand-off disc."""

    HOLD = "hold"  # hover where it was reached
    SHADOW = "shadow"  # keep station on the moving evader
    RETURN = "return"  # fly home


class EngageOn(StrEnum):
    """What begins the game, from standing by."""

    COMMAND = "command"  # an order
    PILOT_MODE = "pilot_mode"  # a pilot who switches to the guided mode; a neutral setpoint stream makes that possible


LIMITS_S: Mapping[State, float] = MappingProxyType(
    {
        State.CONNECTING: 30.0,
        State.CHECKING: 90.0,
        State.ARMING: 15.0,
        State.CLIMBING: 90.0,
        State.POSITIONING: 180.0,
        State.ENTERING: 10.0,
        State.PAUSED: 10.0,
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reserve:
    """What the way home is reckoned by: distance, height, wind and speed.

    Attributes:
        endurance_s: How long a full charge lasts in flight.
        left: Share of the charge, 0 to 1, that is to be left on the ground.
        return_speed_m_s: The autopilot's own, on its way home, through the air.
        landing_speed_m_s: Likewise, downwards.
        wind_m_s: Against it at worst.

    Raises:
        ConfigError: If a number is out of its range, or the wind as fast as the vehicle.
    """

    endurance_s: float
    left: float = 0.1
    return_speed_m_s: float = 5.0
    landing_speed_m_s: float = 0.7
    wind_m_s: float = 0.0

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            least = 0.0 if one.name in {"left", "wind_m_s"} else 1e-3
            if not least <= value <= (1.0 if one.name == "left" else 1e6):
                raise ConfigError(f"reserve.{one.name} = {value}: not in its range")
        if self.wind_m_s >= self.return_speed_m_s:
            raise ConfigError(
                f"reserve.wind_m_s = {self.wind_m_s:g}: must be below reserve.return_speed_m_s = "
                f"{self.return_speed_m_s:g}: against such a wind nothing comes home"
            )

    def needed(self, away_m: float, height_m: float) -> float:
        """Return the share of the charge that is needed to come home and land.

        Args:
            away_m: From home, over the ground.
            height_m: Above home.
        """
        home_s = away_m / (self.return_speed_m_s - self.wind_m_s)
        down_s = max(0.0, height_m) / self.landing_speed_m_s
        share = self.left + (home_s + down_s) / self.endurance_s
        return min(1.0, share) if math.isfinite(share) else 1.0


@dataclass(frozen=True, slots=True)
class FlightSettings:
    """One flight.

    Attributes:
        autopilot: Which one.
        cycle: Everything a guidance cycle needs.
        takeoff_height_m: Above home.
        start_game_m: Where the autopilot flies to before standing by, in the game frame; None stays above the take-off.
        after_capture: What to do at the stand-off disc.
        engage_on: What begins the game.
        battery_minimum: Battery remaining (0 to 1) below which the flight returns, where there is no `reserve`.
        reserve: By which the battery that is needed to come home is reckoned, from wherever the vehicle is.
        farthest_m: How far from home the fence lets it go; with a reserve it starts only with enough to come back.
        guarantee_slack_s: How much of what was promised may be lost before an alarm says so, besides what
            `guidance.monitor` allows for: s of the time of capture (PE), and the evader's way in that time (TAD).
        settle_s: How long everything must be well again before a paused game goes on.
        limits_s: Longest stay in a state, where there is a limit.
        fence_corners_deg: A polygon fence by latitude and longitude; it takes effect with HOME_POSITION, before which
            nothing flies.
        longest_chase_s: How long one chase may last, pauses included, before the vehicle is handed to its hold.
        operator_timeout_s: How long a person may give no sign of life before the vehicle is handed to its hold,
        operator_return_s: and how much longer before it returns.
        hold_on_rival: Whether the vehicle is handed to its hold when two sources report as the evader.
    """

    autopilot: Autopilot
    cycle: CycleSettings
    takeoff_height_m: float
    start_game_m: Vector | None = None
    after_capture: AfterCapture = AfterCapture.HOLD
    engage_on: EngageOn = EngageOn.COMMAND
    battery_minimum: float = 0.2
    settle_s: float = 1.0
    guarantee_slack_s: float = 0.3
    limits_s: Mapping[State, float] = field(default_factory=lambda: LIMITS_S)
    fence_corners_deg: Corners | None = None
    longest_chase_s: float = math.inf
    hold_on_rival: bool = True
    operator_timeout_s: float = math.inf
    operator_return_s: float = math.inf
    reserve: Reserve | None = None
    farthest_m: float = 0.0
